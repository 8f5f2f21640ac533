"""Figures of several designs in the same axes:  loops, sensitivities, step responses and margins."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from fopi_tune.core.bode_form import Array
from fopi_tune.core.crossings import gain_crossovers
from fopi_tune.errors import DomainError
from fopi_tune.report.comparison import ComparedDesign, Comparison
from fopi_tune.report.figures.forbidden_regions import fit_y_limits, forbid_values, mark_critical_phases
from fopi_tune.report.figures.frequency import decibels, margin_curves, without_a_curve
from fopi_tune.report.figures.members import Members, members_of
from fopi_tune.report.figures.picture import STYLES, TWO_PANELS, WIDE, Picture, label_axes, legend_below, log_axes
from fopi_tune.report.figures.step_responses import step_response, times_s
from fopi_tune.report.text.formatting import number
from fopi_tune.report.words import axis_label, name_and_unit
from fopi_tune.simulation.fractional.linear import Signal
from fopi_tune.spec.model import Requirement

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_DB = 20.0 / math.log(10.0)
#: step responses drawn of a family: every fifth value of one uncertain number, or corners
_EVERY, _MOST_CORNERS = 5, 8
#: the longest time axis, relative to that of the fastest design
_LONGER = 4.0


@dataclass(frozen=True)
class OverlaidDesign:
    """A design with a loop to draw, and the index of its line style."""

    entry: ComparedDesign
    members: Members
    style: int

    @property
    def label(self) -> str:
        """For a legend, where a dollar sign would start mathematics."""
        return self.entry.label.replace("$", r"\$")


@dataclass(frozen=True)
class Overlay:
    """All designs on the same axes.

    Args:
        comparison: of which designs.
    """

    comparison: Comparison

    @cached_property
    def designs(self) -> tuple[OverlaidDesign, ...]:
        """The designs with a loop, all over the same frequency axis."""
        found = [(k, each, members_of(each.documents)) for k, each in enumerate(self.comparison.entries)]
        there = [(k, entry, members) for k, entry, members in found if members is not None]
        ends = [members.omega[[0, -1]].tolist() for _, _, members in there]
        low, high = min((a for a, _ in ends), default=0.1), max((b for _, b in ends), default=10.0)
        return tuple(OverlaidDesign(entry, replace(members, range_rad_s=(low, high)), k) for k, entry, members in there)

    @property
    def left_out(self) -> str:
        """A sentence about the designs without a loop; empty if all have one."""
        drawn = {each.entry.letter for each in self.designs}
        missing = [entry.label for entry in self.comparison.entries if entry.letter not in drawn]
        return f" Not drawn, for there is no loop: {', '.join(missing)}." if missing else ""

    @property
    def caution(self) -> str:
        """A sentence if the designs have different plants or loops."""
        return " The designs are not all about the same plants and loop." if len(self.comparison.groups) > 1 else ""

    @property
    def shared(self) -> tuple[Requirement, ...]:
        """The requirements that all specs have, whatever their lines in the files."""
        every = [{replace(r, line=0) for r in entry.documents.spec.requirements} for entry in self.comparison.entries]
        first = self.comparison.entries[0].documents.spec.requirements
        return tuple(r for r in first if all(replace(r, line=0) in each for each in every))


def overlay_pictures() -> Mapping[str, Callable[[Overlay], Picture | None]]:
    """Name of each figure -> how it is drawn, in the order of the page."""
    return {
        "compare_bode": _bode,
        "compare_sensitivities": _sensitivities,
        "compare_responses": _responses,
        "compare_margins": _margins,
    }


def _bode(overlay: Overlay) -> Picture | None:
    if not overlay.designs:
        return None

    def draw(figure: Figure) -> None:
        gain, phase = figure.subplots(2, 1, sharex=True)
        gains, phases, at_crossovers = [], [], [np.zeros(0)]
        for each in overlay.designs:
            family, nominal = each.members.family_log_loop, each.members.named_log_loop[0]
            _plot_family(gain, each, _DB * family.real, _DB * nominal.real)
            _plot_family(phase, each, np.degrees(family.imag), np.degrees(nominal.imag))
            gains.append(_DB * nominal.real)
            phases.append(np.degrees(nominal.imag))
            crossings = gain_crossovers(each.members.named_loops)
            own = crossings.row == 0
            at_crossovers.append(np.degrees(crossings.phase_rad[own]))
            for omega, arg in zip(crossings.omega_rad_s[own], at_crossovers[-1], strict=True):
                gain.plot([omega], [0.0], "o", color=STYLES[each.style][0], markersize=5)
                phase.plot([omega], [arg], "o", color=STYLES[each.style][0], markersize=5)
        fit_y_limits(gain, gains, 160.0)
        fit_y_limits(phase, [*phases, np.array([-180.0])], 300.0)
        gain.axhline(0.0, color="black", linewidth=0.6)
        mark_critical_phases(phase, np.concatenate(at_crossovers))
        label_axes(gain, "|L|, dB")
        label_axes(phase, "arg L, deg", "ω, rad/s")
        legend_below(figure, gain)

    told = "; ".join(f"{each.entry.label}: {_crossover(each.members)}" for each in overlay.designs)
    said = (
        "Gain and phase of each loop: the nominal plant as a line with a dot at its gain crossover, the family as a "
        f"band. {told}.{overlay.caution}{overlay.left_out}"
    )
    return Picture("Bode, the loops L = C P", said, draw, TWO_PANELS)


def _sensitivities(overlay: Overlay) -> Picture | None:
    if not overlay.designs:
        return None
    words = (("sensitivity_db", "|S|, dB"), ("control_sensitivity_db", "|C S|, dB"))
    found = [(each, *_family_and_nominal_db(each.members)) for each in overlay.designs]

    def draw(figure: Figure) -> None:
        every = figure.subplots(2, 1, sharex=True)
        for axes, (word, label) in zip(every, words, strict=True):
            for each, family, nominal in found:
                _plot_family(axes, each, family[word], nominal[word])
            fit_y_limits(axes, [value[word] for _, family, nominal in found for value in (family, nominal)], 90.0)
            forbid_values(axes, overlay.shared, word)
            label_axes(axes, label)
        every[-1].set_xlabel("ω, rad/s")
        legend_below(figure, every[0])

    peaks = "; ".join(
        f"{each.entry.label}: largest |S| drawn {number(float(family['sensitivity_db'].max()), 4)} dB, "
        f"largest |C S| drawn {number(float(family['control_sensitivity_db'].max()), 4)} dB"
        for each, family, _ in found
    )
    hatched = " Hatched: what the requirements forbid that all specs have." if overlay.shared else ""
    said = f"Sensitivity and control sensitivity: nominal plant as a line, family as a band. {peaks}.{hatched}"
    return Picture("Sensitivities", f"{said}{overlay.caution}{overlay.left_out}", draw, TWO_PANELS)


def _responses(overlay: Overlay) -> Picture | None:
    if not overlay.designs:
        return None
    horizons = [float(times_s(each.members)[-1]) for each in overlay.designs]
    # long enough for the slowest, unless the fastest could not be seen then
    t = times_s(overlay.designs[0].members) * (min(max(horizons), _LONGER * min(horizons)) / horizons[0])
    signals = (
        (Signal.OUTPUT_AFTER_REFERENCE, "output, step of reference"),
        (Signal.OUTPUT_AFTER_LOAD, "output, step of load"),
    )
    found = {
        signal: [(each, *_family_steps(each.members, signal, t)) for each in overlay.designs] for signal, _ in signals
    }
    if all(nominal is None for rows in found.values() for _, nominal, _ in rows):
        return None

    def draw(figure: Figure) -> None:
        every = figure.subplots(2, 1, sharex=True)
        for axes, (signal, label) in zip(every, signals, strict=True):
            for each, nominal, others in found[signal]:
                if nominal is not None:
                    colour, dashes = STYLES[each.style]
                    axes.plot(t, nominal, color=colour, linestyle=dashes, label=each.label)
                    stack = np.array([nominal, *others])
                    axes.fill_between(t, stack.min(axis=0), stack.max(axis=0), color=colour, alpha=0.15, linewidth=0.0)
            step = signal is Signal.OUTPUT_AFTER_REFERENCE
            axes.axhline(1.0 if step else 0.0, color="black", linewidth=0.6, linestyle=":")
            label_axes(axes, label)
            axes.set_xlim(0.0, float(t[-1]))
        every[-1].set_xlabel("time, s")
        legend_below(figure, every[0])

    told = "; ".join(
        f"{each.entry.label}: largest {number(float(nominal.max()), 4)}, at the end {number(float(nominal[-1]), 4)}"
        for each, nominal, _ in found[Signal.OUTPUT_AFTER_REFERENCE]
        if nominal is not None
    )
    said = (
        "Output after a unit step of the reference and of a load at the plant's input, ideal controllers in continuous "
        f"time: nominal plant as a line, plants of the family as a band. After the reference's step, {told}."
    )
    return Picture("Unit steps of reference and load", f"{said}{overlay.caution}{overlay.left_out}", draw, TWO_PANELS)


def _margins(overlay: Overlay) -> Picture | None:
    names = [each.members.numbers[:1] for each in overlay.designs]
    name = next((first[0] for first in names if first), None)
    if name is None:
        return None
    called = name_and_unit(name)[0]
    found: list[tuple[OverlaidDesign, Array, dict[str, Array]]] = []
    for each, first in zip(overlay.designs, names, strict=True):
        try:
            if first == (name,):
                found.append((each, each.members.parameter_values, margin_curves(each.members)))
        except DomainError:
            continue  # more crossings than can be listed
    words = (("phase_margin_deg", "phase margin, deg"), ("gain_margin_db", "gain margin, dB"))
    finite = {word: [each for each in found if np.any(np.isfinite(each[2][word]))] for word, _ in words}

    def draw(figure: Figure) -> None:
        every = figure.subplots(2, 1, sharex=True)
        for axes, (word, label) in zip(every, words, strict=True):
            for each, values, curves in found:
                colour, dashes = STYLES[each.style]
                curve = np.where(np.isfinite(curves[word]), curves[word], np.nan)
                axes.plot(values, curve, color=colour, linestyle=dashes, label=each.label)
            if not finite[word]:
                every_curve = np.concatenate([np.zeros(0), *(curves[word] for _, _, curves in found)])
                axes.text(0.5, 0.5, without_a_curve(every_curve), transform=axes.transAxes, ha="center")
                axes.set_yticks([])
            label_axes(axes, label)
        every[-1].set_xlabel(axis_label(name))
        legend_below(figure, every[0])

    told = "; ".join(
        f"{each.entry.label}: phase margin {_range(curves['phase_margin_deg'], 'deg')}, "
        f"gain margin {_range(curves['gain_margin_db'], 'dB')}"
        for each, _, curves in found
    )
    others = [each.entry.letter for each, first in zip(overlay.designs, names, strict=True) if first != (name,)]
    missing = f" Without this uncertain number: {', '.join(others)}." if others else ""
    said = f"Phase margin and gain margin against the {called}, other uncertain numbers nominal; {told}.{missing}"
    return Picture(f"Margins against the {called}", f"{said}{overlay.caution}{overlay.left_out}", draw, (WIDE, 4.6))


def _plot_family(axes: Axes, each: OverlaidDesign, family: Array, nominal: Array) -> None:
    """Plot the family as a pale band and the nominal plant as a line."""
    colour, dashes = STYLES[each.style]
    omega = each.members.omega
    if not axes.lines:
        log_axes(axes)
        axes.set_xlim(float(omega[0]), float((each.members.range_rad_s or omega[[0, -1]])[1]))
    if len(family) > 1:
        axes.fill_between(omega, family.min(axis=0), family.max(axis=0), color=colour, alpha=0.15, linewidth=0.0)
    axes.plot(omega, nominal, color=colour, linestyle=dashes, label=each.label)


def _family_and_nominal_db(members: Members) -> tuple[dict[str, Array], dict[str, Array]]:
    named = decibels(members, members.named_log_loop[:1])
    return decibels(members, members.family_log_loop), {word: values[0] for word, values in named.items()}


def _family_steps(members: Members, signal: Signal, t: Array) -> tuple[Array | None, list[Array]]:
    """Step responses of the nominal plant and of some plants of its family; None and none where not accurate."""
    family = members.documents.spec.plant
    alone = family.has_one_plant
    points = (
        members.points_along(members.parameter_values[::_EVERY])
        if len(members.numbers) == 1
        else family.corners(_MOST_CORNERS)[1:]
    )
    nominal = step_response(members, tuple(family.nominal_point.tolist()), signal, t)
    rows = [step_response(members, tuple(point), signal, t) for point in ([] if alone else points.tolist())]
    return nominal, [row for row in rows if row is not None]


def _crossover(members: Members) -> str:
    crossings = gain_crossovers(members.named_loops)
    own = crossings.omega_rad_s[crossings.row == 0]
    return f"nominal gain crossover {number(float(own[-1]), 4)} rad/s" if len(own) else "no nominal gain crossover"


def _range(curve: Array, unit: str) -> str:
    finite: Sequence[float] = curve[np.isfinite(curve)].tolist()
    if not finite:
        return "none: unstable" if np.all(np.isnan(curve)) else "infinite"
    return f"{number(min(finite), 4)} to {number(max(finite), 4)} {unit}"
