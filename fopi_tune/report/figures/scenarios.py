"""The loop as it runs:  every scenario of a spec or a system, driven on samples with many plants -> a picture each.

With the filter, the computing delay, the control's limits and rate; what `fopi simulate` does for one plant.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property, partial
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from fopi_tune.core.bode_form import Array
from fopi_tune.core.controller import FoPi
from fopi_tune.core.plant import PlantFamily
from fopi_tune.errors import DomainError
from fopi_tune.pipeline.responses import FamilyResponse, family_responses, system_responses
from fopi_tune.report.documents import ResultDocuments
from fopi_tune.report.figures.members import Members
from fopi_tune.report.figures.picture import STYLES, TWO_PANELS, Picture, label_axes, legend_below, with_unit_label
from fopi_tune.report.figures.plots import shade_second_mode
from fopi_tune.report.figures.step_responses import corner_points
from fopi_tune.report.text.formatting import number
from fopi_tune.spec.model import Limit, SystemSpec

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: scenarios that have a figure; all are in the table
MOST_DRAWN = 6
#: pairs of plants of a system that are driven at most
_MOST_PAIRS = 17
#: parts of the time axis; each shows the extremes of what happens in it
_PARTS = 180
_BAND = {"color": "#56b4e9", "alpha": 0.35, "linewidth": 0.0}


@dataclass(frozen=True)
class DrivenLoops:
    """The scenarios of a spec or a system, driven with plants of its family.

    Args:
        name: of the spec or the system.
        family: of the plants.
        labels: of the plants that are drawn as lines of their own, the first of each response; the nominal one first.
        responses: one a scenario.
        units: of the output and of the control; empty where they are not told.
        limits: of the control; none without.
        judged: limits of the scenarios' measures.
        second_mode: the name of a system's second mode; empty for a loop.
        own_scenarios: whether they are the spec's, not the default one.
        why_none: why there are no responses; empty where there are some.
    """

    name: str
    family: PlantFamily
    labels: tuple[str, ...] = ()
    responses: tuple[FamilyResponse, ...] = ()
    units: tuple[str, str] = ("", "")
    limits: tuple[float, ...] = ()
    judged: tuple[Limit, ...] = ()
    second_mode: str = ""
    own_scenarios: bool = True
    why_none: str = ""

    @cached_property
    def pictures(self) -> dict[str, Callable[[DrivenLoops], Picture | None]]:
        """Name of a figure -> how it is drawn, one a scenario; of the first few."""
        return {f"scenario_{k + 1}": partial(_picture, k) for k in range(min(len(self.responses), MOST_DRAWN))}


def driven_loops(documents: ResultDocuments, members: Members | None) -> DrivenLoops:
    """Drive nominal plant, worst plants of the requirements, and plants at the ends of the family's ranges.

    Args:
        documents: of the design.
        members: the family to draw; None where there is no loop.
    """
    spec, gains, digital = documents.spec, documents.gains, documents.spec.digital
    if gains is None or members is None or documents.digital is None or digital is None:
        return DrivenLoops(spec.name, spec.plant, why_none="there is no digital controller with these gains")
    named = np.array([member.point for member in members.named], dtype=float)
    points = np.vstack([named.reshape(len(members.named), -1), corner_points(members)])
    first = np.sort(np.unique(points, axis=0, return_index=True)[1])
    try:
        responses = family_responses(spec, gains, points[first])
    except DomainError as error:
        return DrivenLoops(spec.name, spec.plant, why_none=str(error))
    return DrivenLoops(
        spec.name,
        spec.plant,
        tuple(member.label for member in members.named),
        responses,
        (digital.measurement_unit, digital.output_unit),
        digital.output_limits or (),
        spec.judged_limits,
        own_scenarios=bool(spec.scenarios),
    )


def driven_system(system: SystemSpec, gains: Mapping[str, FoPi]) -> DrivenLoops:
    """Drive the nominal pair of plants of a system, and pairs at the corners of the ranges."""
    try:
        responses = system_responses(system, gains, system.family.corners(_MOST_PAIRS))
    except DomainError as error:
        return DrivenLoops(system.name, system.family, why_none=str(error))
    digitals = [mode.spec.digital for mode in system.modes if mode.spec.digital is not None]
    units = {digital.output_unit for digital in digitals}
    return DrivenLoops(
        system.name,
        system.family,
        ("nominal",),
        responses,
        (system.measurement_unit, units.pop() if len(units) == 1 else ""),
        judged=system.judged_limits,
        second_mode=system.modes[1].name,
    )


def _picture(index: int, loops: DrivenLoops) -> Picture:
    """Setpoint and output, and the control with its limits, of the family over time."""
    response = loops.responses[index]
    traces, run = response.traces, response.run
    drawn = min(len(loops.labels), len(response.points))
    output, control = traces.output, traces.applied
    kept = shown_samples(np.vstack([output[:drawn], control[:drawn]]))
    t, finite = traces.time_s[kept], response.measures.finite

    def draw(figure: Figure) -> None:
        above, below = figure.subplots(2, 1, sharex=True)
        if loops.second_mode:
            shade_second_mode((above, below), traces.time_s, traces.mode[0], loops.second_mode)
        reference = run.signals.reference[kept]
        above.step(t, reference, where="post", color="black", linewidth=0.8, linestyle=":", label="setpoint")
        for axes, signal in ((above, output), (below, control)):
            if len(signal) > 1 and np.any(finite):
                low, high = signal[finite].min(axis=0)[kept], signal[finite].max(axis=0)[kept]
                axes.fill_between(t, low, high, label="family", **_BAND)
            for k in range(drawn):
                if finite[k] or not np.any(finite):
                    colour, dashes = STYLES[k]
                    axes.plot(t, signal[k][kept], color=colour, linestyle=dashes, label=loops.labels[k])
        for limit in loops.limits:
            below.axhline(limit, color="0.3", linewidth=0.8, linestyle="--")
        above.set_xlim(0.0, float(t[-1]))
        label_axes(above, with_unit_label("output", loops.units[0]))
        label_axes(below, with_unit_label("control", loops.units[1]), "time, s")
        legend_below(figure, above)

    title = f"{loops.name}: {response.scenario.name}, the loop as it runs"
    return Picture(title, _words(loops, response, drawn), draw, TWO_PANELS)


def _words(loops: DrivenLoops, response: FamilyResponse, drawn: int) -> str:
    many, finite = len(response.points), response.measures.finite
    said = (
        f"Output and control over {number(response.scenario.duration_s)} s, simulated on samples of "
        f"{number(response.run.sample_time_s)} s with filter, delay and limits: {drawn} "
        f"{'plant as a line' if drawn == 1 else 'plants as lines'}"
    )
    said += f", {many} of the family as a band." if many > drawn else "."
    if loops.second_mode:
        said += f" Shaded: the {loops.second_mode} acts, with the nominal plants."
    if loops.limits:
        said += f" Dashed: the control's limits, {' and '.join(number(limit) for limit in loops.limits)}."
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
