"""Recordings to a family of plants for a spec:  the smallest box that contains the intervals of all fits."""

from __future__ import annotations

import statistics
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from fopi_tune.core.plant import PlantFamily, Uncertain
from fopi_tune.errors import DomainError
from fopi_tune.identification.fit import Fit, Interval, fit_plant
from fopi_tune.identification.models import FitModel
from fopi_tune.identification.recording import Recording, recording_from_arrays
from fopi_tune.spec.templates.fitted import sections_for_fitted
from fopi_tune.spec.templates.sections import TemplateSections
from fopi_tune.spec.templates.template import template

_SPEC_MODELS = {
    FitModel.LAG: "lag",
    FitModel.SECOND_ORDER: "transfer_function",
    FitModel.INTEGRATOR: "pole",
}


@dataclass(frozen=True, eq=False)
class Identified:
    """A family of plants identified from recordings, and the fits.

    Args:
        fits: one a recording, in their order.
        model: what was fitted.
        plant: the family; each number's range is the hull of the fits' intervals, its nominal value the median of the
            fitted ones.
    """

    fits: tuple[Fit, ...]
    model: FitModel
    plant: PlantFamily

    @property
    def notes(self) -> tuple[str, ...]:
        """What the recordings and the residuals show, a sentence each."""
        return tuple(note for fit in self.fits for note in fit.notes)

    def __getitem__(self, number: str) -> Uncertain:
        """One of the plant's numbers, by its name in a spec, as `static_gain` or `denominator[0]`: `number`."""
        return self.plant.parameters[number]

    def spec_text(self, name: str) -> str:
        """A commented spec for these plants, as `fopi init --from-step-data` writes it.

        Args:
            name: the design's.

        Raises:
            DomainError: the name cannot be a folder's.
        """
        return template(name, self.sections())

    def sections(self) -> TemplateSections:
        """The plant-dependent sections of `spec_text`."""
        about = [
            *self.summary(),
            "Each range holds the 95 % intervals of these fits to the recorded input and output; nominal is the median "
            "of the fitted values.",
            "The dead time's upper end is for a change of the input right after the last line with the old input, its "
            "fitted value for one at the first line with the new input: the recording does not show which.",
        ]
        return sections_for_fitted(self.plant, about)

    def summary(self) -> list[str]:
        """Fitted numbers with their intervals, and the notes: lines of text."""
        return [line for fit in self.fits for line in fit.summary()]


def identify(
    time_s: Any,
    input: Any,
    output: Any,
    model: FitModel | str = FitModel.LAG,
    start_s: float | None = None,
    end_s: float | None = None,
    name: str = "data",
) -> Identified:
    """A plant with intervals from a recording in arrays: what `fopi init --from-step-data` does with a file.

    The model is simulated with the recorded input, held from each sample to the next, and its initial state is fitted;
    so the input may be anything that moves.

    Args:
        time_s: shape (n,), s, not descending: an array, a list, or a column of a data frame.
        input: shape (n,), the plant's input in its unit.
        output: shape (n,), the plant's output in its unit; NaN where it is missing.
        model: "lag", "second_order", "integrator", or "auto" for the one with the least AICc.
        start_s: the fit is about the outputs from this time on, s.
        end_s: and until this time, s.
        name: what messages call the recording.

    Raises:
        DomainError: data of which no plant can be told; the message says what was seen.
    """
    try:
        wanted = FitModel(model)
    except ValueError:
        known = ", ".join(each.value for each in FitModel)
        raise DomainError(f"there is no model {str(model)!r}; it is one of {known}") from None
    return identify_recordings([recording_from_arrays(time_s, input, output, start_s, end_s, name)], wanted)


def identify_recordings(recordings: Sequence[Recording], model: FitModel = FitModel.LAG) -> Identified:
    """The smallest box of plants that contains the intervals of all recordings' fits.

    A joint fit would assume one plant for all recordings.  The median is robust against a single outlier.

    Args:
        recordings: at least one, of one plant or of several that one controller shall serve.
        model: of all; with AUTO the one that has the least sum of AICc.

    Raises:
        DomainError: no recording, one that cannot be fitted, or gains of both signs.
    """
    if not recordings:
        raise DomainError("there is no recording to fit; give at least one")
    fits = tuple(fit_plant(recording, model) for recording in recordings)
    chosen = {fit.model for fit in fits}
    if len(chosen) > 1:
        best = min(chosen, key=lambda each: (-sum(fit.model is each for fit in fits), each.value))
        fits = tuple(
            fit if fit.model is best else fit_plant(recording, best)
            for fit, recording in zip(fits, recordings, strict=True)
        )
    number = next(iter(fits[0].numbers))
    gains = [fit[number].value for fit in fits]
    if min(gains) < 0 < max(gains):
        up, down = fits[gains.index(max(gains))], fits[gains.index(min(gains))]
        raise DomainError(
            f"the static gain is {max(gains):.3g} in {up.name} and {min(gains):.3g} in {down.name}: no controller "
            "serves both signs; check the columns, or make a spec of each"
        )
    numbers = {name: _hull([fit[name] for fit in fits]) for name in fits[0].numbers}
    if fits[0].model is FitModel.SECOND_ORDER:
        numbers["denominator[2]"] = Uncertain.exactly(1.0)
    if fits[0].model is FitModel.INTEGRATOR:
        numbers["pole_rad_s"] = Uncertain.exactly(0.0)
    dead = numbers.pop("dead_time_s")
    return Identified(fits, fits[0].model, PlantFamily(_SPEC_MODELS[fits[0].model], {**numbers, "dead_time_s": dead}))


def _hull(intervals: list[Interval]) -> Uncertain:
    nominal = statistics.median(each.value for each in intervals)
    return Uncertain(nominal, min(each.low for each in intervals), max(each.high for each in intervals))
