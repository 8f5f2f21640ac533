"""Forbidden regions:  requirements as hatched areas of a figure, readable without colour."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from fopi_tune.spec.model import Relation, Requirement, Scope

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_STYLE = {"facecolor": "none", "edgecolor": "0.45", "linewidth": 0.6, "zorder": 0.5}
#: for requirements on the family, and on the nominal plant alone
_HATCH = {Scope.FAMILY: "////", Scope.NOMINAL: "\\\\\\\\"}
#: dB; half the height of the marks on the line |L| = 1
_MARK_DB = 4.0
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
        forbid(axes, band, (r.upper, math.inf), r.scope)
        forbid(axes, band, (-math.inf, r.lower), r.scope)


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


def forbid_phases(
    axes: Axes, requirements: Sequence[Requirement], crossovers: tuple[float, float], nominal: np.ndarray
) -> None:
    """Hatch the phases that a phase margin forbids, over the range of gain crossovers; a cross for an equality.

    Args:
        axes: of the phase, deg.
        requirements: all of them.
        crossovers: lowest and highest of the family, rad/s.
        nominal: those of the nominal plant, rad/s; shape (n,).
    """
    own = (float(nominal.min()), float(nominal.max())) if len(nominal) else crossovers
    for r in requirements:
        if r.quantity != "phase_margin_deg":
            continue
        if r.relation is Relation.EQUALS:
            axes.plot([own[1]], [r.limits[0] - 180.0], "kx", markersize=7)
            continue
        ends = own if r.scope is Scope.NOMINAL else crossovers
        # a rectangle needs a width, also with a single plant
        band = (ends[0] / _WIDEN, ends[1] * _WIDEN)
        forbid(axes, band, (-math.inf, r.lower - 180.0), r.scope)
        forbid(axes, band, (r.upper - 180.0, math.inf), r.scope)


def fit_y_limits(axes: Axes, values: Sequence[np.ndarray], most: float) -> None:
    """Set the limits of the vertical axis to the range of values and a margin; at most `most` below the largest."""
    finite = np.concatenate([each[np.isfinite(each)].ravel() for each in values])
    if len(finite):
        low, high = float(finite.min()), float(finite.max())
        low = max(low, high - most)
        margin = 0.08 * (high - low) + 1.0
        axes.set_ylim(low - margin, high + margin)
