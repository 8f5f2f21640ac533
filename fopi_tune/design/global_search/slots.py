"""Findings -> slots of the program:  each worst plant and frequency becomes an equation and a row."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from fopi_tune.core.bode_form import Array
from fopi_tune.design.global_search.compiled import (
    COEFFICIENTS,
    CROSSOVER,
    CS,
    DELAY,
    DELAY_MARGIN,
    DISCOUNTED_ERROR,
    GAIN_AT_REFERENCE,
    GAIN_MARGIN,
    LOOP_GAIN,
    PHASE_MARGIN,
    PHASE_SLOPE,
    PS,
    Rows,
    S,
    T,
)
from fopi_tune.design.global_search.controllers import FILTER, MU
from fopi_tune.design.global_search.families.fractional import sides_at_real
from fopi_tune.design.global_search.nonlinear.program import (
    ERRORS,
    INDEX,
    KNOTS,
    MEASURED_PARAMETERS,
    PARAMETERS,
    PARAMETERS_WITH_ORDERS,
)
from fopi_tune.design.global_search.responses import (
    AT_FIXED,
    AT_GAIN,
    AT_INFINITY,
    AT_PEAK,
    AT_PHASE,
    AT_REFERENCE,
    loop_at,
)
from fopi_tune.design.global_search.tables import Scaled
from fopi_tune.design.global_search.worst_case import FIELDS, MODE, NEAR, ROW, SLACK, TARGET, V

_PI = math.pi
#: rad a unit of ln omega; a phase crossover with less slope than |L| is kept at its gain instead
_STEEP = 0.3
_EQUATION = {AT_PEAK: "peak", AT_FIXED: "fixed", AT_GAIN: "gain", AT_PHASE: "phase", AT_REFERENCE: "reference"}
_STEP = 1e-5
#: ln|L| below which |S| = 1
_NO_LOOP = -16.0
_MARGINS = (PHASE_MARGIN, GAIN_MARGIN, DELAY_MARGIN)
#: |v| within which a finding replaces an older one of the same row and plant; how many are kept
_SAME_PEAK, _SAME_CROSSING, _MOST_KEPT = 0.5, 0.2, 28


@dataclass(frozen=True)
class Slot:
    """One slot's parameters.

    Args:
        p: shape (PARAMETERS,), with a fractional plant (PARAMETERS_WITH_ORDERS,).
        v: where its frequency starts.
        row: index of the row it stands for; -1 of the reference.
        is_equal: whether its row is an equality.
        by_level: whether the row's limit stands in the equation (a gain margin kept at its gain).
    """

    p: Array
    v: float
    row: int
    is_equal: bool = False
    by_level: bool = False


def idle_slot(plant: Array, is_measured: bool = False) -> Slot:
    """A slot that asks for nothing.

    Args:
        plant: its coefficients.
        is_measured: whether the program's plants are measured curves.
    """
    p = _parameters_of(plant)
    if is_measured:
        p = np.concatenate([p, np.zeros(MEASURED_PARAMETERS - PARAMETERS)])
        p[PARAMETERS : PARAMETERS + KNOTS] = np.arange(float(KNOTS))
    p[INDEX["fixed"]] = p[INDEX["limit"]] = p[INDEX["sign"]] = 1.0
    return Slot(p, 0.0, -1)


def _parameters_of(plant: Array) -> Array:
    """A slot's parameters with its plant alone."""
    p = np.zeros(PARAMETERS if len(plant) == COEFFICIENTS else PARAMETERS_WITH_ORDERS)
    p[:COEFFICIENTS], p[PARAMETERS:] = plant[:COEFFICIENTS], plant[COEFFICIENTS:]
    return p


def reference_slot(plant: Array, x: Array, v: float, near: float) -> Slot:
    """The nominal plant's crossover as the first slot; its angle to -1 is what spreads are measured from.

    Args:
        plant: its coefficients.
        x: what `controller_of` makes of the gains.
        v: the crossover.
        near: the undelayed phase there.
    """
    slot = idle_slot(plant)
    slot.p[INDEX["fixed"]] = 0.0
    slot.p[INDEX["gain"]], slot.p[INDEX["near"]] = 1.0, near
    _set_angle(slot.p, x, plant, v, near)
    # the row asks for nothing:  1 - angle + 9 >= 0
    slot.p[INDEX["limit"]] = 10.0
    return Slot(slot.p, v, -1)


def slots_of(findings: list[Array], x: Array, rows: Rows, scaled: Scaled, in_t: Array, spread: int) -> list[Slot]:
    """The slots of findings, except those of the discounted error.

    Args:
        findings: shape (k, 6 + p).
        x: what `controller_of` makes of the gains at which they were found.
        rows: as in `worst_cases`.
        scaled: the plants and the filter.
        in_t: of each row, whether its slack has to exceed t (1), t is at least minus its slack (-1), or neither (0).
        spread: rows from this one on are angles measured from the first slot's.
    """
    slots, beyond = [], []
    for finding in findings:
        q = int(finding[ROW])
        if rows.kind[q] == DISCOUNTED_ERROR:
            continue
        plant = scaled.member(finding[FIELDS:])
        if rows.kind[q] == CS and loop_at(x, plant, finding[V], finding[NEAR])[0] < _NO_LOOP:
            # |C S| = |C| whatever the plant: the same row again and again would be degenerate
            known = any(slot.row == q and abs(slot.v - finding[V]) < _SAME_PEAK for slot in beyond)
            if known:
                continue
            beyond.append(_slot(finding, q, plant, x, rows, float(in_t[q])))
        slots.append(_slot(finding, q, plant, x, rows, float(in_t[q])))
        if q >= spread:
            #  t - side (angle - reference) >= 0
            p = slots[-1].p
            p[INDEX["limit"]], p[INDEX["with_reference"]] = 0.0, float(rows.side[q])
        if rows.kind[q] == GAIN_AT_REFERENCE:
            other = slots[-1].p.copy()
            other[INDEX["sign"]] = -other[INDEX["sign"]]
            slots.append(Slot(other, slots[-1].v, q))
        elif rows.side[q] == 0 and in_t[q]:
            # an equality that may be missed by t:  t >= |limit - value|
            other = slots[-1].p.copy()
            other[INDEX["sign"]] = -other[INDEX["sign"]]
            slots.append(Slot(other, slots[-1].v, q))
        elif slots[-1].is_equal and rows.kind[q] in _MARGINS and _is_another_crossing(finding, findings):
            # the smallest margin equals the limit, so that of another crossing is no smaller:  value - limit >= 0
            other = slots[-1].p.copy()
            other[INDEX["sign"]] = -other[INDEX["sign"]]
            slots[-1] = Slot(other, slots[-1].v, q)
    return slots


def _is_another_crossing(finding: Array, findings: list[Array]) -> bool:
    """Whether another finding of the same row and plant is closer to the limit."""
    same = [f for f in findings if f[ROW] == finding[ROW] and np.array_equal(f[FIELDS:], finding[FIELDS:])]
    return any(f[SLACK] > finding[SLACK] for f in same)


def error_rows(findings: list[Array], rows: Rows, scaled: Scaled, log_horizon: float) -> Array:
    """Parameters of the rows of the discounted error, shape (ERRORS, 3)."""
    parameters = np.zeros((ERRORS, 3))
    parameters[:, 0], parameters[:, 1] = 1.0, -log_horizon
    found = [f for f in findings if rows.kind[int(f[ROW])] == DISCOUNTED_ERROR][:ERRORS]
    s = math.exp(-log_horizon)
    for k, finding in enumerate(found):
        plant = scaled.member(finding[FIELDS:])
        top, bottom = sides_at_real(plant, s)
        value = top / bottom
        value *= scaled.delayed_at_real(s, plant[DELAY])
        parameters[k] = value, -log_horizon, 1.0
    return parameters


def _slot(finding: Array, q: int, plant: Array, x: Array, rows: Rows, in_t: float) -> Slot:
    kind, side, mode = int(rows.kind[q]), int(rows.side[q]), int(finding[MODE])
    v, near = float(finding[V]), float(finding[NEAR])
    p = _parameters_of(plant)
    p[INDEX["near"]], p[INDEX["v0"]] = near, v
    is_equal = side == 0 and not in_t
    sign = float(side) if side else 1.0
    p[INDEX["sign"]] = sign * rows.scale[q]
    p[INDEX["limit"]] = rows.limit[q]
    # a slack that has to exceed t:  slack - t >= 0;  t at least minus the slack:  slack + t >= 0
    p[INDEX["with_t"]] = -in_t
    if mode == AT_INFINITY:
        p[INDEX["fixed"]] = p[INDEX["log_end"]] = 1.0
        p[INDEX["v0"]] = 0.0
        p[INDEX["is_first"]] = float(len(x) > 3 and x[FILTER] > 0.0 and x[MU] == 1.0)
        return Slot(p, 0.0, q, is_equal)
    p[INDEX[_EQUATION[mode]]] = 1.0
    set_function(p, kind, float(rows.tilt[q]))
    if kind == GAIN_MARGIN:
        return _gain_margin(p, finding, q, plant, x, rows, in_t, is_equal)
    if kind == PHASE_MARGIN:
        _set_angle(p, x, plant, v, near)
    elif kind == DELAY_MARGIN:
        set_lag(p, loop_at(x, plant, v, near)[1])
    return Slot(p, v, q, is_equal)


def set_function(p: Array, kind: int, tilt: float) -> None:
    """What the row of a slot with parameters p is, where it is no margin.

    Args:
        p: the parameters; changed.
        kind: of the row.
        tilt: power of the limit's frequency.
    """
    if kind in (S, T, CS, PS):
        # ln|P| = ln|L| - ln|C|
        p[INDEX["log_s"]] = 1.0
        p[INDEX["log_l"]], p[INDEX["log_c"]] = float(kind in (T, PS)), float(kind == CS) - float(kind == PS)
        p[INDEX["log_omega"]] = -tilt
    elif kind in (LOOP_GAIN, GAIN_AT_REFERENCE):
        p[INDEX["log_l"]], p[INDEX["log_omega"]] = 1.0, -tilt
        if kind == GAIN_AT_REFERENCE:
            p[INDEX["limit"]] = 0.0
    elif kind == CROSSOVER:
        p[INDEX["log_omega"]] = 1.0
    elif kind == PHASE_SLOPE:
        p[INDEX["slope"]] = 1.0


def set_lag(p: Array, phase_rad: float) -> None:
    """The lag from L, whose phase is `phase_rad`, to -1 as the row of a slot with parameters p, over omega."""
    p[INDEX["lag"]] = 1.0
    p[INDEX["offset"]] = _PI - 2.0 * _PI * math.floor((phase_rad + _PI) / (2.0 * _PI))


def _set_angle(p: Array, x: Array, plant: Array, v: float, near: float) -> None:
    """The smallest angle to -1 as the slot's angle, on the side of -1 where L is."""
    phase = loop_at(x, plant, v, near)[1]
    turns = round((phase + _PI) / (2.0 * _PI))
    p[INDEX["offset"]] = _PI - 2.0 * _PI * turns
    p[INDEX["angle"]] = 1.0 if phase + p[INDEX["offset"]] >= 0.0 else -1.0


def _gain_margin(
    p: Array, finding: Array, q: int, plant: Array, x: Array, rows: Rows, in_t: float, is_equal: bool
) -> Slot:
    """Kept at the phase crossover, or, where the phase hardly changes, at |L| = 1/limit with the phase on its side."""
    v, near, target, mode = float(finding[V]), float(finding[NEAR]), float(finding[TARGET]), int(finding[MODE])
    p[INDEX["log_l"]] = -1.0
    if mode != AT_PHASE:
        return Slot(p, v, q, is_equal)
    p[INDEX["offset"]] = -target
    here, there = loop_at(x, plant, v, near), loop_at(x, plant, v + _STEP, near)
    gain_slope, phase_slope = (there[0] - here[0]) / _STEP, (there[1] - here[1]) / _STEP
    if abs(phase_slope) >= _STEEP or is_equal or abs(gain_slope) < abs(phase_slope) or in_t < 0:
        return Slot(p, v, q, is_equal)
    p[INDEX["phase"]], p[INDEX["log_l"]], p[INDEX["gain"]], p[INDEX["angle"]] = 0.0, 0.0, 1.0, 1.0
    p[INDEX["level"]], p[INDEX["level_t"]] = rows.limit[q], max(in_t, 0.0)
    p[INDEX["limit"]] = p[INDEX["with_t"]] = 0.0
    side = -float(rows.side[q]) * math.copysign(1.0, gain_slope * phase_slope)
    p[INDEX["sign"]] = -side
    return Slot(p, v, q, is_equal, by_level=True)


def order_of(findings: list[Array], rows: Rows, real_rows: int) -> list[Array]:
    """The findings by importance: those of the objective, then the smallest slacks."""
    return sorted(findings, key=lambda f: f[SLACK] if f[ROW] < real_rows else -9.0)


def merged(pool: list[Array], new: Array) -> list[Array]:
    """New findings, and those older ones of which none is the same row, plant and peak."""
    merged = list(new)
    for old in pool:
        apart = _SAME_CROSSING if old[MODE] in (AT_GAIN, AT_PHASE) else _SAME_PEAK
        near = new[(new[:, ROW] == old[ROW]) & (np.abs(new[:, V] - old[V]) < apart)]
        same = np.all(np.abs(near[:, FIELDS:] - old[FIELDS:]) < 1e-6 * (1.0 + np.abs(old[FIELDS:])), axis=1)
        if not same.any():
            merged.append(old)
    return merged[:_MOST_KEPT]


def has_vanished(pool: list[Array], found: Array) -> bool:
    """Whether the program knew a crossing that the loops at the present gains do not have."""
    crossings = [old for old in pool if old[MODE] in (AT_GAIN, AT_PHASE)]
    apart = [np.abs(found[found[:, ROW] == old[ROW], V] - old[V]) for old in crossings]
    return any(np.min(distances, initial=math.inf) >= _SAME_CROSSING for distances in apart)
