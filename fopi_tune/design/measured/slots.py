"""Findings of measured responses -> slots of the program:  the curve about each frequency, and its row.

As `global_search/slots.py`, with a curve in place of a transfer function: a slot's plant is a piece of the curve
(`global_search/nonlinear/program.py`).
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from fopi_tune.core.bode_form import Array
from fopi_tune.core.measured.curve import Curve, hermite
from fopi_tune.core.measured.loops import MeasuredLoop
from fopi_tune.design.constraints import Scale
from fopi_tune.design.global_search.compiled import (
    DELAY,
    DELAY_MARGIN,
    GAIN_AT_REFERENCE,
    GAIN_MARGIN,
    LAG,
    LAG_SQUARE,
    PHASE_MARGIN,
    Rows,
)
from fopi_tune.design.global_search.nonlinear.program import INDEX, KNOTS, MEASURED_PARAMETERS, PARAMETERS
from fopi_tune.design.global_search.responses import AT_FIXED, AT_GAIN, AT_PEAK, AT_PHASE, AT_REFERENCE
from fopi_tune.design.global_search.slots import Slot, set_function, set_lag
from fopi_tune.design.global_search.worst_case import FIELDS, MODE, NEAR, ROW, SLACK, TARGET, V

_PI = math.pi
#: points of the curve itself, and distances in v of further ones from these; together as many as the program has
_OWN, _FURTHER = 4, np.array([0.06, 0.2, 0.6])
_EQUATION = {AT_PEAK: "peak", AT_FIXED: "fixed", AT_GAIN: "gain", AT_PHASE: "phase", AT_REFERENCE: "reference"}
_MARGINS = (PHASE_MARGIN, GAIN_MARGIN, DELAY_MARGIN)


def plant_at(curve: Curve, v: float, scale: Scale) -> Array:
    """A slot's parameters with its plant about a frequency, the others 0; shape (MEASURED_PARAMETERS,).

    The piece of the curve on which it is and both of its neighbours are those of the curve itself; further away there
    are fewer points.

    Args:
        curve: the response.
        v: ln(omega/omega_s).
        scale: of the search's numbers.
    """
    unit = math.log(scale.omega_rad_s)
    k = int(np.clip(np.searchsorted(curve.u, v + unit, side="right") - 1, 0, len(curve.u) - 2))
    first = min(max(k - 1, 0), len(curve.u) - _OWN)
    own = curve.u[first : first + _OWN]
    u = np.concatenate([own[0] - _FURTHER[::-1], own, own[-1] + _FURTHER])
    inside = np.clip(u, curve.u[0], curve.u[-1])
    p = np.zeros(MEASURED_PARAMETERS)
    p[DELAY] = curve.dead_time_s * scale.omega_rad_s
    p[LAG], p[LAG_SQUARE] = scale.lag_and_square
    knots = p[PARAMETERS:].reshape(5, KNOTS)
    knots[0] = u - unit
    for row, values, slopes in zip((1, 3), (curve.log_gain, curve.phase_rad), curve.slopes, strict=True):
        value, slope = hermite(curve.u, values, slopes, inside)
        # beyond its ends the curve goes on straight
        knots[row], knots[row + 1] = value + slope * (u - inside), slope
    knots[1] -= math.log(scale.gain)
    return p


def reference_slot(loop: MeasuredLoop, scale: Scale, by_margin: bool) -> Slot:
    """The nominal crossover as the first slot; its angle to -1 is what spreads are measured from.

    Args:
        loop: the nominal one, with a gain crossover.
        scale: of the search's numbers.
        by_margin: whether it is the crossover closest to -1, or the highest one.
    """
    u = loop.gain_crossovers
    u = u[[int(loop.at(u).phase_margin_rad.argmin())]] if by_margin else u[-1:]
    phase, v = float(loop.at(u).phase_rad[0]), float(u[0]) - math.log(scale.omega_rad_s)
    p = plant_at(loop.curve, v, scale)
    p[INDEX["sign"]] = p[INDEX["gain"]] = 1.0
    p[INDEX["near"]] = phase + math.exp(u[0]) * loop.curve.dead_time_s
    _set_angle(p, phase)
    # the row asks for nothing:  1 - angle + 9 >= 0
    p[INDEX["limit"]] = 10.0
    return Slot(p, v, -1)


def measured_slots(
    findings: list[Array], loops: list[MeasuredLoop], rows: Rows, scale: Scale, in_t: Array, spread: int
) -> list[Slot]:
    """The slots of findings.

    Args:
        findings: shape (k, 7).
        loops: of every member, at the gains at which they were found.
        rows: what is asked.
        scale: of the search's numbers.
        in_t: of each row, whether its slack has to exceed t (1), t is at least minus its slack (-1), or neither (0).
        spread: rows from this one on are angles measured from the first slot's.
    """
    slots: list[Slot] = []
    for finding in findings:
        q = int(finding[ROW])
        slot = _slot(finding, q, loops[int(finding[FIELDS])], rows, scale, float(in_t[q]))
        slots.append(slot)
        if q >= spread:
            #  t - side (angle - reference) >= 0
            slot.p[INDEX["limit"]], slot.p[INDEX["with_reference"]] = 0.0, float(rows.side[q])
        if rows.kind[q] == GAIN_AT_REFERENCE or (rows.side[q] == 0 and in_t[q]):
            # t >= |limit - value|
            slots.append(_opposite(slot))
        elif slot.is_equal and rows.kind[q] in _MARGINS and _is_another_crossing(finding, findings):
            # the smallest margin equals the limit, so that of another crossing is no smaller:  value - limit >= 0
            slots[-1] = _opposite(slot)
    return slots


def at_fixed_frequency(slot: Slot) -> Slot:
    """A slot that follows a peak, kept at the frequency where it starts; another is itself."""
    if not slot.p[INDEX["peak"]]:
        return slot
    p = slot.p.copy()
    p[INDEX["peak"]], p[INDEX["fixed"]] = 0.0, 1.0
    return replace(slot, p=p)


def _opposite(slot: Slot) -> Slot:
    p = slot.p.copy()
    p[INDEX["sign"]] = -p[INDEX["sign"]]
    return Slot(p, slot.v, slot.row)


def _is_another_crossing(finding: Array, findings: list[Array]) -> bool:
    """Whether another finding of the same row and member is closer to the limit."""
    same = [f for f in findings if f[ROW] == finding[ROW] and f[FIELDS] == finding[FIELDS]]
    return any(f[SLACK] > finding[SLACK] for f in same)


def _slot(finding: Array, q: int, loop: MeasuredLoop, rows: Rows, scale: Scale, in_t: float) -> Slot:
    kind, side, mode, v = int(rows.kind[q]), int(rows.side[q]), int(finding[MODE]), float(finding[V])
    p = plant_at(loop.curve, v, scale)
    p[INDEX["near"]], p[INDEX["v0"]] = finding[NEAR], v
    p[INDEX["sign"]] = (float(side) if side else 1.0) * rows.scale[q]
    p[INDEX["limit"]] = rows.limit[q]
    # a slack that has to exceed t:  slack - t >= 0;  t at least minus the slack:  slack + t >= 0
    p[INDEX["with_t"]] = -in_t
    p[INDEX[_EQUATION[mode]]] = 1.0
    phase = float(loop.at(np.array([v + math.log(scale.omega_rad_s)])).phase_rad[0])
    set_function(p, kind, float(rows.tilt[q]))
    if kind == GAIN_MARGIN:
        p[INDEX["log_l"]], p[INDEX["offset"]] = -1.0, -float(finding[TARGET])
    elif kind == PHASE_MARGIN:
        _set_angle(p, phase)
    elif kind == DELAY_MARGIN:
        set_lag(p, phase)
    return Slot(p, v, q, side == 0 and not in_t)


def _set_angle(p: Array, phase: float) -> None:
    """The smallest angle to -1 as the slot's angle, on the side of -1 where L is."""
    turns = round((phase + _PI) / (2.0 * _PI))
    p[INDEX["offset"]] = _PI - 2.0 * _PI * turns
    p[INDEX["angle"]] = 1.0 if phase + p[INDEX["offset"]] >= 0.0 else -1.0
