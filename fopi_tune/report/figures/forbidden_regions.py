"""Forbidden regions:  requirements as hatched areas of a figure, readable without colour."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from fopi_tune.core.bode_form import Array
from fopi_tune.spec.model import Relation, Requirement, Scope

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_STYLE = {"facecolor": "none", "edgecolor": "0.45", "linewidth": 0.6, "zorder": 0.5}
#: for requirements on the family, and on the nominal plant alone
_HATCH = {Scope.FAMILY: "////", Scope.NOMINAL: "\\\\\\\\"}
#: dB; half the height of the marks on the line |L| = 1
_MARK_DB = 4.0
#: deg; a phase axis is not widened beyond this
_MOST_DEG = 900.0
#: factor by which a band around crossovers is widened
_WIDEN = 1.05


def forbid(axes: Axes, x: tuple[float, float], y: tuple[float, float], scope: Scope = Scope.FAMILY) -> None:
    """Hatch a rectangle, slanted the other way for the nominal plant; infinite sides end at the axes."""
    from matplotlib.patches import Rectangle

    (left, right), (bottom, top) = sorted(axes.get_xlim()), sorted(axes.get_ylim())
    a, b = max(x[0], left), min(x[1], right)
    c, d = max(y[0], bottom), min(y[1], top)
    if a < b and c < d:
        axes.add_patch(Rectangle((a, c), b - a, d - c, hatch=_HATCH[scope], **_STYLE))


def fit_with_limits(axes: Axes, values: Sequence[Array], requirements: Sequence[Requirement], quantity: str) -> None:
    """`fit_y_limits` over 90 dB with 3 dB beyond every limit of a function, and its forbidden values."""
    fit_y_limits(axes, values, 90.0)
    bounds = [limit for r in requirements if r.quantity == quantity for limit in r.every_limit]
    low, high = axes.get_ylim()
    axes.set_ylim(min([low, *(b - 3.0 for b in bounds)]), max([high, *(b + 3.0 for b in bounds)]))
    forbid_values(axes, requirements, quantity)


def forbid_values(axes: Axes, requirements: Sequence[Requirement], quantity: str) -> None:
    """Hatch the forbidden values of a function of frequency over each band; the axes' limits stay."""
    for r in requirements:
        if r.quantity != quantity:
            continue
        band = (r.from_rad_s, r.to_rad_s)
        if band[0] == band[1] or r.relation is Relation.EQUALS:
            for limit in r.limits:
                axes.plot([band[0]] if band[0] == band[1] else band, [limit] * (1 if band[0] == band[1] else 2), "kx-")
            continue
        if r.end_limit is not None:
            _forbid_beyond_line(axes, r)
            continue
        forbid(axes, band, (r.upper, math.inf), r.scope)
        forbid(axes, band, (-math.inf, r.lower), r.scope)


def _forbid_beyond_line(axes: Axes, r: Requirement) -> None:
    """Hatch what lies beyond a limit that is straight over log omega."""
    from matplotlib.patches import Polygon

    (bottom, top), (left, right) = sorted(axes.get_ylim()), sorted(axes.get_xlim())
    low, high = max(r.from_rad_s, left), min(r.to_rad_s, right)
    if low >= high:
        return
    edge = top if r.relation is Relation.AT_MOST else bottom
    ends = [(omega, min(max(r.limit_at(omega), bottom), top)) for omega in (low, high)]
    axes.add_patch(Polygon([*ends, (high, edge), (low, edge)], hatch=_HATCH[r.scope], **_STYLE))


def forbid_along(axes: Axes, requirements: Sequence[Requirement], quantity: str, nominal: float) -> None:
    """Hatch the forbidden values over an uncertain number; a cross for an equality, at the nominal plant."""
    for r in requirements:
        if r.quantity != quantity:
            continue
        if r.relation is Relation.EQUALS:
            axes.plot([nominal], [r.limits[0]], "kx", markersize=7)
        elif r.scope is Scope.FAMILY:
            forbid(axes, (-math.inf, math.inf), (r.upper, math.inf))
            forbid(axes, (-math.inf, math.inf), (-math.inf, r.lower))


def forbid_crossovers(axes: Axes, requirements: Sequence[Requirement]) -> None:
    """Hatch the frequencies where |L| may not cross 1, around 0 dB; a cross where it must cross."""
    for r in requirements:
        if r.quantity != "crossover_rad_s":
            continue
        if r.relation is Relation.EQUALS:
            axes.plot([r.limits[0]], [0.0], "kx", markersize=7)
            continue
        forbid(axes, (r.upper, math.inf), (-_MARK_DB, _MARK_DB), r.scope)
        forbid(axes, (-math.inf, r.lower), (-_MARK_DB, _MARK_DB), r.scope)


def sensitivity_discs(requirements: Sequence[Requirement]) -> list[tuple[float, Scope]]:
    """Radii of the discs around -1 that a bound M of |S| at every frequency forbids: |S| <= M is |1 + L| >= 1/M."""
    return [
        (10.0 ** (-r.upper / 20.0), r.scope)
        for r in requirements
        if r.quantity == "sensitivity_db" and math.isfinite(r.upper) and r.from_rad_s == 0.0 and r.to_rad_s == math.inf
    ]


def forbid_discs(axes: Axes, requirements: Sequence[Requirement]) -> None:
    """Hatch the discs around -1 that no loop may enter; the axes' limits stay."""
    from matplotlib.patches import Circle

    for radius, scope in sensitivity_discs(requirements):
        axes.add_patch(Circle((-1.0, 0.0), radius, hatch=_HATCH[scope], **_STYLE))


def forbid_arcs(axes: Axes, requirements: Sequence[Requirement]) -> None:
    """Thicken the arcs of the unit circle about -1 that a phase margin forbids; crosses for an equality."""
    for r in requirements:
        if r.quantity != "phase_margin_deg":
            continue
        if r.relation is Relation.EQUALS:
            angle = math.radians(180.0 - r.limits[0])
            axes.plot([math.cos(angle)] * 2, [math.sin(angle), -math.sin(angle)], "kx", markersize=7, zorder=4)
        elif r.lower > 0.0:
            angle = np.radians(180.0 + np.linspace(-r.lower, r.lower, 181))
            dashes = "--" if r.scope is Scope.NOMINAL else "-"
            axes.plot(np.cos(angle), np.sin(angle), color="0.45", linewidth=3.0, linestyle=dashes, zorder=0.5)


def critical_phases(phase_deg: Array) -> Array:
    """The phase of -1 nearest to each phase, -180 deg or whole turns from it; deg, shape (n,)."""
    return -180.0 - 360.0 * np.floor(-np.asarray(phase_deg, dtype=float) / 360.0)


def mark_critical_phases(axes: Axes, phase_deg: Array) -> None:
    """Show -180 deg and the other phases of -1 that phase margins of these crossovers are distances to.

    Args:
        axes: of the phase, deg; its limits are widened where needed.
        phase_deg: at gain crossovers; shape (n,).
    """
    lines = np.unique(np.append(critical_phases(phase_deg), -180.0))
    low, high = axes.get_ylim()
    top = max(high, float(lines.max()) + 10.0)
    # a long dead time turns L many times before a crossover: not all of it is shown
    axes.set_ylim(min(low, max(float(lines.min()) - 10.0, top - _MOST_DEG)), top)
    for line in lines.tolist():
        axes.axhline(line, color="black", linewidth=0.6)


def forbid_phases(
    axes: Axes, requirements: Sequence[Requirement], crossovers: tuple[float, float], nominal: tuple[Array, Array]
) -> None:
    """Hatch the phases that a phase margin forbids, over the range of gain crossovers; a cross for an equality.

    These are the phases within the margin of -180 deg and of whole turns from it.

    Args:
        axes: of the phase, deg.
        requirements: all of them.
        crossovers: lowest and highest of the family, rad/s.
        nominal: those of the nominal plant, rad/s, and its unwrapped phase there, deg; shape (n,) each.
    """
    omega, phase = nominal
    own = (float(omega.min()), float(omega.max())) if len(omega) else crossovers
    low, high = axes.get_ylim()
    turns = 360.0 * np.arange(math.floor((low - 180.0) / 360.0), math.ceil((high + 180.0) / 360.0) + 1)
    for r in requirements:
        if r.quantity != "phase_margin_deg":
            continue
        if r.relation is Relation.EQUALS:
            axes.plot(*_exact_margin(r.limits[0], omega, phase, own[1]), "kx", markersize=7)
            continue
        ends = own if r.scope is Scope.NOMINAL else crossovers
        # a rectangle needs a width, also with a single plant
        band = (ends[0] / _WIDEN, ends[1] * _WIDEN)
        for centre in (turns - 180.0).tolist():
            forbid(axes, band, (centre - r.lower, centre + r.lower), r.scope)
            forbid(axes, band, (centre + r.upper, centre + 360.0 - r.upper), r.scope)


def _exact_margin(margin_deg: float, omega: Array, phase: Array, usual: float) -> tuple[list[float], list[float]]:
    """Where the crossover that sets the phase margin has to lie: on its own side of the phase of -1 next to it."""
    if not len(omega):
        return [usual], [margin_deg - 180.0]
    critical = critical_phases(phase)
    k = int(np.argmin(np.abs(phase - critical)))
    return [float(omega[k])], [float(critical[k] + math.copysign(margin_deg, phase[k] - critical[k]))]


def fit_y_limits(axes: Axes, values: Sequence[np.ndarray], most: float) -> None:
    """Set the limits of the vertical axis to the range of values and a margin; at most `most` below the largest."""
    finite = np.concatenate([each[np.isfinite(each)].ravel() for each in values])
    if len(finite):
        low, high = float(finite.min()), float(finite.max())
        low = max(low, high - most)
        margin = 0.08 * (high - low) + 1.0
        axes.set_ylim(low - margin, high + margin)
