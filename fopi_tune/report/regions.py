"""Requirements as forbidden regions of a figure, hatched so that they read without colour."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from fopi_tune.spec.model import Relation, Requirement

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_STYLE = {"facecolor": "none", "edgecolor": "0.45", "hatch": "////", "linewidth": 0.6, "zorder": 0.5}
#: dB; half the height of the marks on the line |L| = 1
_MARK_DB = 4.0


def forbid(axes: Axes, x: tuple[float, float], y: tuple[float, float]) -> None:
    """Hatch a rectangle; what is infinite ends where the axes do."""
    from matplotlib.patches import Rectangle

    (left, right), (bottom, top) = sorted(axes.get_xlim()), sorted(axes.get_ylim())
    a, b = max(x[0], left), min(x[1], right)
    c, d = max(y[0], bottom), min(y[1], top)
    if a < b and c < d:
        axes.add_patch(Rectangle((a, c), b - a, d - c, **_STYLE))


def forbid_values(axes: Axes, requirements: Sequence[Requirement], quantity: str) -> None:
    """What a function of frequency may not reach, over the band of each requirement; sets no limits of the axes."""
    for r in requirements:
        if r.quantity != quantity:
            continue
        band = (r.from_rad_s, r.to_rad_s)
        if band[0] == band[1] or r.relation is Relation.EQUALS:
            for limit in r.limits:
                axes.plot([band[0]] if band[0] == band[1] else band, [limit] * (1 if band[0] == band[1] else 2), "kx-")
            continue
        forbid(axes, band, (r.upper, math.inf))
        forbid(axes, band, (-math.inf, r.lower))


def forbid_along(axes: Axes, requirements: Sequence[Requirement], quantity: str) -> None:
    """The same against a plant's number, where every requirement holds for all of it."""
    for r in requirements:
        if r.quantity != quantity:
            continue
        if r.relation is Relation.EQUALS:
            axes.axhline(r.limits[0], color="0.45", linewidth=0.8, linestyle=(0, (1, 2)))
        elif r.scope.value == "family":
            forbid(axes, (-math.inf, math.inf), (r.upper, math.inf))
            forbid(axes, (-math.inf, math.inf), (-math.inf, r.lower))


def forbid_crossovers(axes: Axes, requirements: Sequence[Requirement]) -> None:
    """Where |L| may not cross 1, as marks on the line of 0 dB; a cross where it has to."""
    for r in requirements:
        if r.quantity != "crossover_rad_s":
            continue
        if r.relation is Relation.EQUALS:
            axes.plot([r.limits[0]], [0.0], "kx", markersize=7)
            continue
        forbid(axes, (r.upper, math.inf), (-_MARK_DB, _MARK_DB))
        forbid(axes, (-math.inf, r.lower), (-_MARK_DB, _MARK_DB))


def forbid_phases(axes: Axes, requirements: Sequence[Requirement], crossovers: tuple[float, float]) -> None:
    """Phases that a phase margin forbids, over the gain crossovers of the family; a cross for an equality.

    Args:
        axes: of the phase, deg.
        requirements: all of them.
        crossovers: lowest and highest, rad/s.
    """
    middle = math.sqrt(crossovers[0] * crossovers[1])
    # a rectangle needs a width, also where there is one plant only
    low, high = min(crossovers[0], middle / 1.1), max(crossovers[1], middle * 1.1)
    for r in requirements:
        if r.quantity != "phase_margin_deg":
            continue
        if r.relation is Relation.EQUALS:
            axes.plot([middle], [r.limits[0] - 180.0], "kx", markersize=7)
            continue
        forbid(axes, (low, high), (-math.inf, r.lower - 180.0))
        forbid(axes, (low, high), (r.upper - 180.0, math.inf))


def room(axes: Axes, values: Sequence[np.ndarray], most: float) -> None:
    """Limits of the vertical axis around values, a little wider; at most so far below the largest."""
    finite = np.concatenate([each[np.isfinite(each)].ravel() for each in values])
    if len(finite):
        low, high = float(finite.min()), float(finite.max())
        low = max(low, high - most)
        margin = 0.08 * (high - low) + 1.0
        axes.set_ylim(low - margin, high + margin)
