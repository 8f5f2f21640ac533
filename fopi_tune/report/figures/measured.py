"""Figures of measured responses:  Bode and Nyquist plots of the loop with the measured points, and sensitivities."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from fopi_tune.core.bode_form import Array
from fopi_tune.core.controller import FoPi
from fopi_tune.core.measured.family import MeasuredFamily
from fopi_tune.core.measured.loops import LoopPoints, MeasuredLoop
from fopi_tune.core.text_tables.words import agreeing, counted
from fopi_tune.quantities import QUANTITIES
from fopi_tune.report.documents import ResultDocuments
from fopi_tune.report.figures.forbidden_regions import (
    fit_with_limits,
    fit_y_limits,
    forbid_arcs,
    forbid_crossovers,
    forbid_discs,
    forbid_values,
    mark_critical_phases,
)
from fopi_tune.report.figures.picture import STYLES, TWO_PANELS, WIDE, Picture, label_axes, legend_below, log_axes
from fopi_tune.report.text.formatting import number

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_DB = 20.0 / math.log(10.0)
#: columns that are drawn: no more can be told apart
_MOST_POINTS = 600
_NYQUIST_VIEW = (-2.2, 1.2, -1.9, 1.5)
_WORDS = {
    "sensitivity_db": "S",
    "complementary_sensitivity_db": "T",
    "control_sensitivity_db": "C S",
    "load_sensitivity_db": "P S",
}


@dataclass(frozen=True)
class MeasuredMembers:
    """The loops of a design with every member of a measured family.

    Args:
        documents: of a design that has gains.
        gains: of the design.
        family: the members.
    """

    documents: ResultDocuments
    gains: FoPi
    family: MeasuredFamily

    @cached_property
    def loops(self) -> tuple[MeasuredLoop, ...]:
        """A loop for each member, the nominal one first."""
        band = self.family.band_rad_s
        return tuple(MeasuredLoop(self.gains, member.table, band) for member in self.family.members)

    @cached_property
    def u(self) -> Array:
        """ln omega of the columns that are drawn."""
        grid = self.loops[0].grid
        return grid[:: max(1, len(grid) // _MOST_POINTS)]

    @cached_property
    def points(self) -> tuple[LoopPoints, ...]:
        """Every loop there."""
        return tuple(loop.at(self.u) for loop in self.loops)

    @cached_property
    def measured(self) -> LoopPoints:
        """The nominal loop at the measured frequencies in the band."""
        u = self.family.members[0].table.u
        return self.loops[0].at(u[(u >= self.u[0]) & (u <= self.loops[0].grid[-1])])

    @property
    def phrase(self) -> str:
        """Whose loops are drawn, in words."""
        others = len(self.loops) - 1
        fill = f"{counted(others, 'more member')} {agreeing(others, 'fills', 'fill')}"
        beside = f", and the band that {fill}" if others else ""
        return f"of the nominal response{beside}; dots are the measured frequencies, the line is interpolated"


def measured_members(documents: ResultDocuments) -> MeasuredMembers | None:
    """What the figures draw; None without gains, or of a plant that is not measured."""
    family, gains = documents.spec.plant, documents.gains
    if not isinstance(family, MeasuredFamily) or gains is None or gains.is_zero:
        return None
    return MeasuredMembers(documents, gains, family)


def measured_bode(members: MeasuredMembers) -> Picture:
    """Gain and phase of L over the measured band, with the measured points."""
    requirements, omega = members.documents.spec.requirements, np.exp(members.u)
    at = members.loops[0].at(members.loops[0].gain_crossovers)

    def draw(figure: Figure) -> None:
        gain, phase = figure.subplots(2, 1, sharex=True)
        gains = [_DB * points.log_gain for points in members.points]
        phases = [np.degrees(points.phase_rad) for points in members.points]
        dots = members.measured
        for axes, lines, values in (
            (gain, gains, _DB * dots.log_gain),
            (phase, phases, np.degrees(dots.phase_rad)),
        ):
            _draw_lines(axes, omega, lines)
            axes.plot(np.exp(dots.u), values, ".", color="0.25", markersize=3, label="measured", zorder=3)
        fit_y_limits(gain, gains, 160.0)
        fit_y_limits(phase, phases, 720.0)
        mark_critical_phases(phase, np.degrees(at.phase_rad))
        gain.axhline(0.0, color="black", linewidth=0.6)
        gain.plot(at.omega_rad_s, np.zeros(len(at.u)), "o", color=STYLES[0][0], markersize=5, zorder=4)
        phase.plot(at.omega_rad_s, np.degrees(at.phase_rad), "o", color=STYLES[0][0], markersize=5, zorder=4)
        forbid_values(gain, requirements, "loop_gain_db")
        forbid_crossovers(gain, requirements)
        label_axes(gain, "|L|, dB")
        label_axes(phase, "arg L, deg", "omega, rad/s")
        legend_below(figure, gain)

    found = ", ".join(number(omega, 4) for omega in at.omega_rad_s)
    crossing = f"gain crossovers at {found} rad/s" if found else "no gain crossover in the band"
    said = f"Gain and phase of the loop over the measured band, {members.phrase}; {crossing}."
    return Picture(f"{members.documents.spec.name}: Bode, the loop L = C P", said, draw, TWO_PANELS)


def measured_nyquist(members: MeasuredMembers) -> Picture:
    """L in the complex plane, with the measured points and the forbidden discs."""
    requirements = members.documents.spec.requirements

    def draw(figure: Figure) -> None:
        from matplotlib.patches import Circle

        axes = figure.subplots()
        for points in members.points[1:]:
            axes.plot(*_in_plane(points), color="0.75", linewidth=0.6)
        axes.plot(*_in_plane(members.points[0]), color=STYLES[0][0], label="nominal")
        axes.plot(*_in_plane(members.measured), ".", color="0.25", markersize=3, label="measured")
        axes.add_patch(Circle((0.0, 0.0), 1.0, fill=False, linewidth=0.6, linestyle=":"))
        forbid_discs(axes, requirements)
        forbid_arcs(axes, requirements)
        axes.plot([-1.0], [0.0], "k+", markersize=9)
        axes.set_xlim(*_NYQUIST_VIEW[:2])
        axes.set_ylim(*_NYQUIST_VIEW[2:])
        axes.set_aspect("equal")
        label_axes(axes, "Im L", "Re L")
        legend_below(figure, axes)

    said = f"The loop in the complex plane near -1, {members.phrase}. Hatched: what the requirements forbid."
    return Picture(f"{members.documents.spec.name}: Nyquist, the loop L = C P", said, draw)


def measured_sensitivities(members: MeasuredMembers) -> Picture:
    """|S|, |T|, |C S| and |P S| over the measured band with their bounds."""
    requirements, omega = members.documents.spec.requirements, np.exp(members.u)
    every = {
        word: [_DB * np.asarray(QUANTITIES[word].natural(points), dtype=float) for points in members.points]
        for word in _WORDS
    }

    def draw(figure: Figure) -> None:
        panels = figure.subplots(len(every), 1, sharex=True)
        for axes, (word, lines) in zip(panels, every.items(), strict=True):
            _draw_lines(axes, omega, lines)
            fit_with_limits(axes, lines, requirements, word)
            label_axes(axes, f"|{_WORDS[word]}|, dB")
        panels[-1].set_xlabel("omega, rad/s")
        legend_below(figure, panels[0])

    peaks = ", ".join(f"{_WORDS[word]} {number(max(float(line.max()) for line in lines), 4)} dB"
                      for word, lines in every.items())  # fmt: skip
    said = f"Sensitivities over the measured band, {members.phrase}. Largest values drawn: {peaks}."
    return Picture(f"{members.documents.spec.name}: sensitivities", said, draw, (WIDE, 8.6))


def _in_plane(points: LoopPoints) -> tuple[Array, Array]:
    """Real and imaginary part of L."""
    size = np.exp(points.log_gain)
    return size * np.cos(points.phase_rad), size * np.sin(points.phase_rad)


def _draw_lines(axes: Axes, omega: Array, lines: Sequence[Array]) -> None:
    """The nominal line, and the band of all members where there are several."""
    log_axes(axes)
    if len(lines) > 1:
        axes.fill_between(
            omega, np.min(lines, axis=0), np.max(lines, axis=0), color="#56b4e9", alpha=0.35, linewidth=0.0,
            label="all members",
        )  # fmt: skip
    axes.plot(omega, lines[0], color=STYLES[0][0], label="nominal")
