"""A plant model fitted to a recording by least squares, each number with its interval.

The model is simulated with the recorded input (`models.py`), and its initial state is fitted too, so that the input may
be anything and the plant need not be at rest.  Where the recording cannot tell whether it was, it is taken to be.

A change of the input is known only to lie in the gap between two lines: the last with the old value and the first with
the new one.  The fit takes it at the latter.  If it came earlier by d, the dead time is longer by d, while the other
numbers are unchanged.  So the upper end of the interval of the dead time is raised by the gap, and a fitted dead time
may be negative by up to the gap.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fopi_tune.core.bode_form import Array
from fopi_tune.errors import DomainError
from fopi_tune.identification.covariance import ROUNDING_SHARE
from fopi_tune.identification.dropouts import without_dropouts
from fopi_tune.identification.models import FitModel
from fopi_tune.identification.outliers import without_outliers
from fopi_tune.identification.recording import Recording
from fopi_tune.identification.residuals import residual_notes
from fopi_tune.identification.scaling import scaled
from fopi_tune.identification.solution import ZERO_DEAD_TIME, Solution, solved, without_unknown_past

_WORDS = {
    "static_gain": "static gain",
    "time_constant_s": "time constant",
    "dead_time_s": "dead time",
    "numerator[0]": "static gain",
    "denominator[0]": "coefficient of s^2",
    "denominator[1]": "of s",
    "gain": "gain",
}
_MODELS = (FitModel.LAG, FitModel.SECOND_ORDER, FitModel.INTEGRATOR)


@dataclass(frozen=True)
class Interval:
    """A fitted number and the interval of 95 % around it, low <= value <= high.

    Args:
        value: the fitted one, in the number's unit.
        low: lower end, in the number's unit.
        high: upper end, in the number's unit.
    """

    value: float
    low: float
    high: float


@dataclass(frozen=True, eq=False)
class Fit:
    """A fitted plant.

    Args:
        name: the recording's.
        model: what was fitted; with AUTO, what was chosen.
        numbers: the plant's numbers by their names in a spec: `static_gain`, `time_constant_s`, `dead_time_s` of a lag;
            `numerator[0]`, `denominator[0]`, `denominator[1]`, `dead_time_s` of a second order, whose last coefficient
            is 1; `gain`, `dead_time_s` of an integrator.  A dead time's value is that of a change of the input at the
            first line with the new value, its upper end that of one right after the line before.
        residual_std: standard deviation of the residuals, in the output's unit.
        aicc: Akaike's criterion, corrected for the number of samples; dimensionless, less is better.
        modelled: shape (n,), the model's output at the times of the outputs that were used, in its unit.
        rows: shape (n,), the rows of these outputs in the recording.
        notes: what the recording and the residuals show, a sentence each.
    """

    name: str
    model: FitModel
    numbers: Mapping[str, Interval]
    residual_std: float
    aicc: float
    modelled: Array
    rows: NDArray[np.int64]
    notes: tuple[str, ...]

    def __getitem__(self, number: str) -> Interval:
        """One of the numbers, by its name in a spec; `number` is a key of `numbers`."""
        return self.numbers[number]

    def summary(self) -> list[str]:
        """The numbers with their intervals, and the notes: lines of text."""

        def shown(name: str, unit: str = "") -> str:
            number = self.numbers[name]
            return f"{_WORDS[name]} {number.value:.5g} ({number.low:.5g} ... {number.high:.5g}){unit}"

        units = {"time_constant_s": " s", "dead_time_s": " s", "denominator[0]": " s^2", "denominator[1]": " s"}
        numbers = ", ".join(shown(name, units.get(name, "")) for name in self.numbers)
        told = [f"{self.name}: {numbers}, noise {self.residual_std:.3g}"]
        return told + [f"{self.name}: {note}" for note in self.notes]


def fit_plant(recording: Recording, model: FitModel = FitModel.LAG) -> Fit:
    """The plant that a recording shows, with intervals.

    Each interval is value +- t sqrt(c), with c from the covariance of the residuals, correlated or not, and the
    quantile t of Student's distribution (`covariance.py`); a coarse sensor's rounding is added.  The upper end of the
    dead time is raised by the gap between the lines around a change of the input.  A fitted dead time below 0 becomes
    0.  If it is below 0 by more than the gap, it is fixed at minus the gap and the other numbers are fitted again.
    Outliers are left out and named in a note, as is what the residuals show.

    Args:
        recording: of any input that moves.
        model: AUTO takes the one with the least AICc.

    Raises:
        DomainError: the recording cannot tell the numbers; the message says which and what to record instead.
    """
    try:
        if model is FitModel.AUTO:
            return _best(recording)
        return _fit(recording, model)
    except DomainError as error:
        guess = f" ({recording.guess}; are they others?)" if recording.guess else ""
        raise DomainError(f"{recording.name}: {error}{guess}") from None


def _best(recording: Recording) -> Fit:
    """The fit of least AICc, and a note that says so."""
    fits: list[Fit] = []
    failed: list[str] = []
    for model in _MODELS:
        try:
            fits.append(_fit(recording, model))
        except DomainError as error:
            failed.append(f"{model.value}: {error}")
    if not fits:
        raise DomainError("no model can be fitted; " + "; ".join(failed))
    fits.sort(key=lambda each: each.aicc)
    others = [f"{each.model.value} {each.aicc - fits[0].aicc:.3g} more" for each in fits[1:]]
    others += [f"{each.partition(':')[0]} cannot be told" for each in failed]
    note = f"the model is {fits[0].model.value}, which has the least AICc: {', '.join(others)}"
    return dataclasses.replace(fits[0], notes=(note, *fits[0].notes))


def _fit(recording: Recording, model: FitModel) -> Fit:
    recording = without_dropouts(recording)
    problem = scaled(recording)
    problem, outliers = without_outliers(problem, model)
    notes = list(recording.notes)
    if outliers.size:
        values = ", ".join(f"{value:g}" for value in recording.output[outliers[:4]].tolist())
        notes.append(f"{recording.where(outliers)}: far from the others ({values}), left out")
    solution = solved(problem, model)
    solution = without_unknown_past(problem, solution) or solution
    problem = solution.problem
    notes += solution.notes(recording)
    _check(solution)
    residuals = problem.signals.output - solution.modelled
    notes += residual_notes(recording, problem, solution.structure, solution.parameters, solution.spread)
    modelled = solution.modelled * problem.height + problem.level
    k = solution.structure.size + 1
    # of Gaussian residuals:  n log(RSS/n) + 2 k + 2 k (k + 1)/(n - k - 1)
    rounding = problem.n * ROUNDING_SHARE**2 * 1e-6
    aicc = problem.n * math.log((float(residuals @ residuals) + rounding) / problem.n)
    aicc += 2 * k + 2 * k * (k + 1) / max(problem.n - k - 1, 1)
    return Fit(
        recording.name,
        model,
        _numbers(solution),
        solution.spread.residual_std * problem.height,
        aicc,
        modelled,
        problem.rows,
        tuple(notes),
    )


# -- the numbers -----------------------------------------------------------------------------------------------------


def _check(solution: Solution) -> None:
    gain = solution.structure.linear - 1
    half, value = solution.spread.half, solution.parameters
    if half[gain] >= abs(value[gain]):
        raise DomainError(
            "the output does not move beyond its noise: the static gain may be 0; record a larger step or less noise"
        )
    for name, number in _numbers(solution).items():
        if name != "dead_time_s" and not (number.low > 0 or number.high < 0):
            what = {"time_constant_s": "the time constant", "denominator[0]": "the coefficient of s^2"}.get(name, name)
            unit = " s^2" if name == "denominator[0]" else " s"
            around = max(number.high - number.value, number.value - number.low)
            hint = ", or a larger step" if name == "time_constant_s" else ", or fit a lag"
            raise DomainError(
                f"{what} is {number.value:.3g} +- {around:.3g}{unit}, which may be 0; record more samples on the "
                f"rise{hint}"
            )


def _numbers(solution: Solution) -> dict[str, Interval]:
    """The plant's numbers in its units, by their names in a spec."""
    problem, structure = solution.problem, solution.structure
    value, half = solution.parameters, solution.spread.half
    seconds, gain = problem.length_s, structure.linear - 1
    unit = problem.height / problem.input_height
    if structure.model is FitModel.INTEGRATOR:
        unit /= seconds
    low, high = sorted((value[gain] + sign * half[gain]) * unit for sign in (-1.0, 1.0))
    size = Interval(float(value[gain] * unit), float(low), float(high))
    ends = (float(value[-1]), float(value[-1] - half[-1]), max(solution.upper, float(value[-1])))
    # below a rounding error of the times it is 0
    dead = Interval(*(end * seconds if end > ZERO_DEAD_TIME else 0.0 for end in ends))
    if structure.model is FitModel.INTEGRATOR:
        return {"gain": size, "dead_time_s": dead}
    if structure.model is FitModel.LAG:
        tau = math.exp(value[gain + 1]) * seconds
        # half is that of log tau, so that of tau is tau times it
        return {"static_gain": size, "time_constant_s": _around(tau, tau * half[gain + 1]), "dead_time_s": dead}
    square, twice = np.exp(value[gain + 1 : -1]) * np.array([seconds**2, seconds])
    return {
        "numerator[0]": size,
        "denominator[0]": _around(square, square * half[gain + 1]),
        "denominator[1]": _around(twice, twice * half[gain + 2]),
        "dead_time_s": dead,
    }


def _around(value: float, half: float) -> Interval:
    return Interval(float(value), float(value - half), float(value + half))
