"""The loop as it runs:  every scenario of a spec, driven on samples with plants of the family -> a picture each.

With the filter, the computing delay, the control's limits and rate; what `fopi simulate` does for one plant.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from fopi_tune.core.bode_form import Array
from fopi_tune.errors import DomainError
from fopi_tune.pipeline.responses import FamilyResponse, family_responses
from fopi_tune.report.documents import ResultDocuments
from fopi_tune.report.figures.members import Member, Members
from fopi_tune.report.figures.picture import STYLES, TWO_PANELS, Picture, label_axes, legend_below
from fopi_tune.report.figures.step_responses import corner_points
from fopi_tune.report.text.formatting import number

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: scenarios that have a figure; all are in the table
MOST_DRAWN = 6
#: parts of the time axis; each shows the extremes of what happens in it
_PARTS = 180
_BAND = {"color": "#56b4e9", "alpha": 0.35, "linewidth": 0.0}


@dataclass(frozen=True)
class DrivenLoops:
    """The scenarios of a spec, driven with plants of its family.

    Args:
        documents: of a design that has gains.
        named: the plants that are drawn as lines of their own, the nominal one first.
        responses: one a scenario; the first plants of each are those of `named`.
        why_none: why there are no responses; empty where there are some.
    """

    documents: ResultDocuments
    named: tuple[Member, ...]
    responses: tuple[FamilyResponse, ...]
    why_none: str = ""

    @cached_property
    def pictures(self) -> dict[str, Callable[[DrivenLoops], Picture | None]]:
        """Name of a figure -> how it is drawn, one a scenario; of the first few."""
        return {f"scenario_{k + 1}": _picture_of(response) for k, response in enumerate(self.responses[:MOST_DRAWN])}


def driven_loops(documents: ResultDocuments, members: Members | None) -> DrivenLoops:
    """Drive nominal plant, worst plants of the requirements, and plants at the ends of the family's ranges.

    Args:
        documents: of the design.
        members: the family to draw; None where there is no loop.
    """
    spec, gains = documents.spec, documents.gains
    if gains is None or members is None or documents.digital is None:
        return DrivenLoops(documents, (), (), "there is no digital controller with these gains")
    named = np.array([member.point for member in members.named], dtype=float)
    points = np.vstack([named.reshape(len(members.named), -1), corner_points(members)])
    first = np.sort(np.unique(points, axis=0, return_index=True)[1])
    try:
        return DrivenLoops(documents, members.named, family_responses(spec, gains, points[first]))
    except DomainError as error:
        return DrivenLoops(documents, (), (), str(error))


def _picture_of(response: FamilyResponse) -> Callable[[DrivenLoops], Picture | None]:
    def make(loops: DrivenLoops) -> Picture | None:
        return _picture(loops, response)

    return make


def _picture(loops: DrivenLoops, response: FamilyResponse) -> Picture:
    """Setpoint and output, and the control with its limits, of the family over time."""
    traces, run, spec = response.traces, response.run, loops.documents.spec
    digital = spec.digital
    drawn = min(len(loops.named), len(response.points))
    output, control = (signal[:, : len(traces.time_s)] for signal in (traces.output, traces.applied))
    kept = shown_samples(np.vstack([output[:drawn], control[:drawn]]))
    t, finite = traces.time_s[kept], response.measures.finite
    limits = [] if digital is None else list(digital.output_limits or ())

    def draw(figure: Figure) -> None:
        above, below = figure.subplots(2, 1, sharex=True)
        above.step(t, run.signals.reference[kept], where="post", color="black", linewidth=0.8, linestyle=":",
                   label="setpoint")  # fmt: skip
        for axes, signal in ((above, output), (below, control)):
            if len(signal) > 1 and np.any(finite):
                low, high = signal[finite].min(axis=0)[kept], signal[finite].max(axis=0)[kept]
                axes.fill_between(t, low, high, label="family", **_BAND)
            for k in range(drawn):
                colour, dashes = STYLES[k]
                axes.plot(t, signal[k][kept], color=colour, linestyle=dashes, label=loops.named[k].label)
        for limit in limits:
            below.axhline(limit, color="0.3", linewidth=0.8, linestyle="--")
        above.set_xlim(0.0, float(t[-1]))
        label_axes(above, _with_unit("output", digital.measurement_unit if digital else ""))
        label_axes(below, _with_unit("control", digital.output_unit if digital else ""), "time, s")
        legend_below(figure, above)

    title = f"{spec.name}: {response.scenario.name}, the loop as it runs"
    return Picture(title, _words(response, drawn, limits), draw, TWO_PANELS)


def _words(response: FamilyResponse, drawn: int, limits: list[float]) -> str:
    many, finite = len(response.points), response.measures.finite
    said = (
        f"Output and control over {number(response.scenario.duration_s)} s, simulated on samples of "
        f"{number(response.run.sample_time_s)} s with filter, delay and limits: {drawn} plants as lines"
    )
    said += f", {many} of the family as a band." if many > drawn else "."
    if limits:
        said += f" Dashed: the control's limits, {' and '.join(number(limit) for limit in limits)}."
    if not np.all(finite):
        return f"{said} The output of {int((~finite).sum())} of the {many} plants does not stay finite."
    peak, control = response.traces.output.max(), np.abs(response.traces.applied).max()
    return f"{said} The largest output is {number(float(peak), 4)}, the largest control {number(float(control), 4)}."


def shown_samples(rows: Array) -> NDArray[np.intp]:
    """Indices of the samples to draw: of each part of the time axis its ends, and the extremes of every row.

    Args:
        rows: signals, shape (m, steps).
    """
    count = rows.shape[1]
    if count <= 4 * _PARTS:
        return np.arange(count)
    edges = np.linspace(0, count - 1, _PARTS + 1).astype(int)
    kept = set(edges.tolist())
    for begin, end in pairwise(edges.tolist()):
        part = rows[:, begin:end]
        kept.update((begin + part.argmax(axis=1)).tolist())
        kept.update((begin + part.argmin(axis=1)).tolist())
    return np.array(sorted(kept))


def _with_unit(word: str, unit: str) -> str:
    return f"{word}, {unit}" if unit.strip() else word
