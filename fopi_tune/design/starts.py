"""Where the solver starts:  closed forms, and a coarse look at what they are worth.

With a crossover omega, a phase margin phi and alpha given, the gains follow (PAPER's eqs. (3)-(6) solved for them):

    X = e^{j (phi - pi)} / P(j omega) ,
    ki = -Im X omega^alpha / sin(alpha pi/2) ,     kp = Re X - ki omega^-alpha cos(alpha pi/2) .

Where the spec fixes crossover and margin of the nominal plant, alpha alone is left and the starts are exact.
"""

from __future__ import annotations

import itertools
import math

import numpy as np
from numpy.typing import NDArray

from fopi_tune.core.bode_form import Array, Complex
from fopi_tune.core.controller import FoPi
from fopi_tune.core.crossings import gain_crossovers, phase_crossovers
from fopi_tune.core.loops import Loops, Plants
from fopi_tune.core.stability import is_stable
from fopi_tune.design.constraints import Bound, Constraint, Scale
from fopi_tune.design.loop_grid import numbers_at
from fopi_tune.design.margin_sides import sides_of
from fopi_tune.errors import DomainError
from fopi_tune.quantities.base import EvaluatedAt
from fopi_tune.quantities.objectives import ObjectiveKind
from fopi_tune.spec.model import ControllerSpec, DesignSpec, GainRange

_SCREEN_OMEGAS = 60
_PORTION = 200
_EXACT = 240
#: starts whose merit is this near (neper) to the best one's count as good
_NEARLY_AS_GOOD = 0.5
#: what a gain margin that does not end is taken for, neper
_ENDLESS_MARGIN = 6.0


def closed_form_gains(plant_response: Complex, omega_rad_s: Array, phase_margin_rad: Array, alpha: Array) -> Array:
    """(kp, ki) that give this crossover and margin; all arguments of shape (n,), result (n, 2).

    Args:
        plant_response: P(j omega), dead time included.
        omega_rad_s: the crossover.
        phase_margin_rad: the margin there; negative where it is one by lead.
        alpha: the order, in (0, 2).
    """
    x = np.exp(1j * (phase_margin_rad - np.pi)) / plant_response
    ki = -x.imag * omega_rad_s**alpha / np.sin(0.5 * np.pi * alpha)
    kp = x.real - ki * omega_rad_s**-alpha * np.cos(0.5 * np.pi * alpha)
    return np.stack([kp, ki], axis=1)


def starts(
    spec: DesignSpec, scale: Scale, constraints: tuple[Constraint, ...], objective: ObjectiveKind, most: int
) -> list[FoPi]:
    """At most `most` starts, the most promising first, none close to another."""
    candidates = _candidates(spec, scale, constraints)
    if not len(candidates):
        return []
    merit = _merit(spec, scale, constraints, objective, candidates)
    order = np.argsort(merit)
    ranked, merit = candidates[order], merit[order]
    # What the grid cannot tell, exact crossovers of the nominal plant can, for the best of them.
    merit[:_EXACT] += _exact_violation(spec, constraints, ranked[:_EXACT])
    best = np.argsort(merit[:_EXACT])
    ranked[:_EXACT], merit[:_EXACT] = ranked[best], merit[best]
    best = np.lexsort((merit, _place_in_group(ranked[:, 2])))
    ranked, merit = ranked[best], merit[best]
    # Stable ones; should there be none, the solver may still find its way.
    stable = _first_stable(spec, ranked, most)
    shortlist = stable if len(stable) else np.arange(min(len(ranked), 12 * most))
    shortlist = shortlist[np.argsort(merit[shortlist])]
    near = shortlist[merit[shortlist] < merit[shortlist[0]] + _NEARLY_AS_GOOD]
    shortlist = near if len(near) >= most else shortlist[:most]
    rows = ranked[shortlist]
    return _spread_out(scale, rows, most, _preference_alone(objective, scale, rows))


def _preference_alone(objective: ObjectiveKind, scale: Scale, candidates: Array) -> Array:
    """The part of `_preference` that needs no frequency response."""
    if objective not in (ObjectiveKind.KI, ObjectiveKind.IAE_DISTURBANCE):
        return np.zeros(len(candidates))
    return _preference(objective, scale, candidates, np.zeros((len(candidates), 1, 1)))


def _spread_out(scale: Scale, shortlist: Array, most: int, preference: Array) -> list[FoPi]:
    """The first, the one the objective likes best, then again and again the one farthest from those chosen.

    Local optima lie apart.
    """
    gains = [FoPi(*(float(v) for v in row)) for row in shortlist]
    places = np.array([_place(scale.scaled(g)) for g in gains])
    chosen = [0] if not preference.any() else list(dict.fromkeys((0, int(np.argmin(preference)))))
    distance = np.min([np.max(np.abs(places - places[c]), axis=1) for c in chosen], axis=0)
    while len(chosen) < min(most, len(gains)) and distance.max() > 0.1:
        chosen.append(int(np.argmax(distance)))
        distance = np.minimum(distance, np.max(np.abs(places - places[chosen[-1]]), axis=1))
    return [gains[i] for i in chosen]


def _place_in_group(alpha: Array) -> NDArray[np.intp]:
    """Of each row, how many rows before it have the same alpha: the best of every order come before any second best."""
    place = np.zeros(len(alpha), dtype=np.intp)
    for value in np.unique(alpha):
        mine = np.flatnonzero(alpha == value)
        place[mine] = np.arange(len(mine))
    return place


def _first_stable(spec: DesignSpec, ranked: Array, most: int) -> NDArray[np.intp]:
    """Indices of the first rows, in their order and looked for in portions, that are stable with the nominal plant."""
    nominal = Plants.members(spec.plant, spec.plant.nominal_point[None, :])
    found: list[NDArray[np.intp]] = []
    for first in range(0, len(ranked), _PORTION):
        part = ranked[first : first + _PORTION]
        rows = np.zeros(len(part), dtype=np.intp)
        stable = is_stable(Loops(part[:, 0], part[:, 1], part[:, 2], nominal.take(rows)))
        found.append(first + np.flatnonzero(stable))
        if sum(len(f) for f in found) >= 12 * most:
            break
    return np.concatenate(found)


def _place(scaled: Array) -> Array:
    return np.array([np.arcsinh(scaled[0] / 0.1), np.arcsinh(scaled[1] / 0.1), 2.0 * scaled[2]])


def _candidates(spec: DesignSpec, scale: Scale, constraints: tuple[Constraint, ...]) -> Array:
    """Gains (n, 3) from a lattice of crossovers, margins and orders, moved into the box."""
    box = spec.controller
    omegas, exact_omega = _crossovers(scale, constraints)
    margins, exact_margin = _phase_margins(constraints)
    count = 41 if exact_omega and exact_margin else 13
    alphas = np.linspace(box.alpha.min, box.alpha.max, 1 if box.alpha.is_fixed else count)
    lattice = np.array(list(itertools.product(omegas, margins, alphas)))
    omega, margin, alpha = lattice.T
    nominal = Plants.members(spec.plant, spec.plant.nominal_point[None, :])
    rows = np.zeros(len(omega), dtype=np.intp)
    response = nominal.response(rows, omega) * np.exp(-1j * omega * nominal.dead_time_s[0])
    gains = closed_form_gains(response, omega, margin, alpha)
    inside = np.stack([_clipped(gains[:, 0], box.kp), _clipped(gains[:, 1], box.ki), alpha], axis=1)
    inside = np.concatenate([inside, _nearly_off(spec, scale, alphas)])
    usable = np.isfinite(inside).all(axis=1) & ((inside[:, 0] != 0) | (inside[:, 1] != 0))
    return inside[usable]


def _clipped(values: Array, bounds: GainRange) -> Array:
    """Into the range, a hair inside a round upper end: kp = 1 on a plant of gain 1 lies on |L(0)| = 1 itself."""
    inside = np.clip(values, bounds.min, bounds.max)
    at_end = (inside == bounds.max) & (inside > bounds.min)
    return np.where(at_end, np.maximum(inside - 1e-6 * np.abs(inside), bounds.min), inside)


def small_starts(spec: DesignSpec, scale: Scale) -> list[FoPi]:
    """Starts with small gains, with which the nominal loop is stable."""
    box = spec.controller
    rows = np.unique(_nearly_off(spec, scale, np.array([box.alpha.min, box.alpha.max])), axis=0)
    rows = rows[(rows[:, 0] != 0.0) | (rows[:, 1] != 0.0)]
    return [FoPi(*(float(v) for v in rows[i])) for i in _first_stable(spec, rows, 1)] if len(rows) else []


def _nearly_off(spec: DesignSpec, scale: Scale, alphas: Array) -> Array:
    """Small gains (n, 3): what meets every bound of a sensitivity of a plant that is stable by itself."""
    box = spec.controller
    sizes = np.array([1e-4, 1e-3, 1e-2, 1e-1])
    rows = []
    for size, alpha, sign in itertools.product(sizes, alphas, (1.0, -1.0)):
        gains = scale.controller(np.array([sign * size, sign * size, alpha]))
        kp, ki = _clipped(np.array([gains.kp]), box.kp)[0], _clipped(np.array([gains.ki]), box.ki)[0]
        rows.append((kp, ki, alpha))
    return np.array(rows)


def _crossovers(scale: Scale, constraints: tuple[Constraint, ...]) -> tuple[Array, bool]:
    low, high = scale.omega_grid[0] * 10.0, scale.omega_grid[-1] / 10.0
    for constraint in constraints:
        if constraint.quantity.name == "crossover_rad_s":
            if constraint.bound is Bound.EQUAL:
                return np.array([constraint.limit_public]), True
            if constraint.bound is Bound.LOWER:
                low = max(low, constraint.limit_public)
            else:
                high = min(high, constraint.limit_public)
    if low > high:
        low, high = high, low
    count = int(np.clip(6 * math.log10(high / low), 3, 40))
    return np.geomspace(low, high, count), False


def _phase_margins(constraints: tuple[Constraint, ...]) -> tuple[Array, bool]:
    low = math.radians(20.0)
    for constraint in constraints:
        if constraint.quantity.name == "phase_margin_deg":
            if constraint.bound is Bound.EQUAL:
                # by lag or by lead
                return np.array([constraint.limit, -constraint.limit]), True
            if constraint.bound is Bound.LOWER:
                low = max(low, constraint.limit)
    return np.linspace(low, max(math.radians(130.0), low + 0.2), 8), False


def _merit(
    spec: DesignSpec, scale: Scale, constraints: tuple[Constraint, ...], objective: ObjectiveKind, candidates: Array
) -> Array:
    """Violation of what a coarse grid shows, plus a little of the objective; smaller is better; shape (n,)."""
    family = spec.plant
    points = family.corners(8)
    plants = Plants.members(family, points)
    omega = np.unique(np.concatenate([_thinned(scale.omega_grid), *_band_ends(constraints)]))
    rows = np.repeat(np.arange(len(points)), len(omega))
    tiled = np.tile(omega, len(points))
    response = plants.response(rows, tiled) * np.exp(-1j * tiled * plants.dead_time_s[rows])
    response = response.reshape(1, len(points), len(omega))
    kp, ki, alpha = (candidates[:, i][:, None, None] for i in range(3))
    controller = kp + ki * np.exp(-alpha * (np.log(omega) + 0.5j * np.pi))
    loop = controller * response
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        log_sensitivity = -np.log(np.abs(1.0 + loop))
        log_gain = np.log(np.abs(loop))
        log_controller = np.log(np.abs(controller)) + 0.0 * log_gain
    total = np.zeros(len(candidates))
    responses = {
        "sensitivity_db": log_sensitivity,
        "complementary_sensitivity_db": log_gain + log_sensitivity,
        "control_sensitivity_db": log_controller + log_sensitivity,
        "loop_gain_db": log_gain,
    }
    for constraint in constraints:
        values = responses.get(constraint.quantity.name)
        if values is None:
            continue
        band = (omega >= constraint.from_rad_s * (1 - 1e-9)) & (omega <= constraint.to_rad_s * (1 + 1e-9))
        if not band.any():
            continue
        violation = np.nan_to_num((values[:, :, band] - constraint.limit) * (constraint.bound.value or 1), nan=1e3)
        if constraint.nominal:
            violation = violation[:, :1]
        total += np.maximum(violation.max(axis=(1, 2)), 0.0)
    total += _crossing_violation(constraints, log_gain, loop, omega)
    peak = np.nan_to_num(log_sensitivity.max(axis=(1, 2)), nan=1e3, posinf=1e3)
    return total + 0.02 * peak + 0.01 * _preference(objective, scale, candidates, log_controller + log_sensitivity)


def _exact_violation(spec: DesignSpec, constraints: tuple[Constraint, ...], candidates: Array) -> Array:
    """Violation of what is read at the nominal plant's gain crossovers, equalities included; shape (n,)."""
    wanted = [s for s in constraints if s.where in (EvaluatedAt.GAIN_CROSSOVERS, EvaluatedAt.HIGHEST_GAIN_CROSSOVER)]
    n = len(candidates)
    nominal = Plants.members(spec.plant, spec.plant.nominal_point[None, :])
    kp, ki, alpha = candidates.T
    loops = Loops(kp, ki, alpha, nominal.take(np.zeros(n, dtype=np.intp)))
    try:
        crossings, margin_violation = gain_crossovers(loops), _gain_margin_violation(constraints, loops)
    except DomainError:
        # One of the candidates lies on |L| = 1 or on -180 deg over a whole range: the coarse look has to do.
        return np.zeros(n)
    sides = sides_of(loops, crossings)
    numbers = numbers_at(loops, crossings.row, crossings.u, sides.side, sides.angle_rad)
    total = np.zeros(n)
    for constraint in wanted:
        distance = (constraint.limit - constraint.quantity.natural(numbers)) * constraint.scale
        violation = (
            np.abs(distance) if constraint.bound is Bound.EQUAL else np.maximum(-constraint.bound.value * distance, 0.0)
        )
        worst = np.zeros(n)
        np.maximum.at(worst, crossings.row, violation)
        total += worst
    return total + margin_violation


def _gain_margin_violation(constraints: tuple[Constraint, ...], loops: Loops) -> Array:
    """Violation of the gain margins, shape (m,); an infinite margin misses an upper limit by a lot."""
    wanted = [s for s in constraints if s.where is EvaluatedAt.PHASE_CROSSOVERS]
    total = np.zeros(len(loops))
    if not wanted:
        return total
    crossings = phase_crossovers(loops)
    margin = np.full(len(loops), _ENDLESS_MARGIN)
    small = crossings.gain <= 1.0
    np.minimum.at(margin, crossings.row[small], -np.log(crossings.gain[small]))
    for constraint in wanted:
        distance = (constraint.limit - margin) * constraint.scale
        total += (
            np.abs(distance) if constraint.bound is Bound.EQUAL else np.maximum(-constraint.bound.value * distance, 0.0)
        )
    return total


def _preference(objective: ObjectiveKind, scale: Scale, candidates: Array, log_cs: Array) -> Array:
    """A rough idea of the objective, in natural units."""
    if objective in (ObjectiveKind.KI, ObjectiveKind.IAE_DISTURBANCE):
        scaled = candidates[:, 1] * scale.gain * scale.omega_rad_s ** -candidates[:, 2]
        return -np.arcsinh(scaled)
    if objective is ObjectiveKind.CONTROL_SENSITIVITY_PEAK:
        return np.nan_to_num(log_cs.max(axis=(1, 2)), nan=1e3, posinf=1e3)
    return np.zeros(len(candidates))


def _crossing_violation(constraints: tuple[Constraint, ...], log_gain: Array, loop: Complex, omega: Array) -> Array:
    """Violation of phase margins and crossovers, read off at the grid's last |L| >= 1; shape (n,)."""
    wanted = [s for s in constraints if s.where in (EvaluatedAt.GAIN_CROSSOVERS, EvaluatedAt.HIGHEST_GAIN_CROSSOVER)]
    if not wanted:
        return np.zeros(len(log_gain))
    above = log_gain >= 0
    last = above.shape[2] - 1 - np.argmax(above[:, :, ::-1], axis=2)
    nowhere = ~above.any(axis=2)
    at = np.where(nowhere, 0, last)
    phase = np.angle(np.take_along_axis(loop, at[:, :, None], axis=2)[:, :, 0])
    margin = np.pi + np.where(phase > 0.5, phase - 2 * np.pi, phase)
    log_omega = np.log(omega)[at]
    values = {"phase_margin_deg": margin, "crossover_rad_s": log_omega, "delay_margin_s": margin * np.exp(-log_omega)}
    total = 2.0 * np.max(nowhere, axis=1)
    for constraint in wanted:
        value = values.get(constraint.quantity.name)
        if value is None or constraint.bound is Bound.EQUAL:
            continue
        violation = (value - constraint.limit) * constraint.bound.value * constraint.scale
        if constraint.nominal:
            violation = violation[:, :1]
        # The grid is coarse: what is missed by less than half its step is no violation.
        total += np.maximum(violation.max(axis=1) - 0.1, 0.0)
    return total


def _thinned(grid: Array) -> Array:
    return np.geomspace(grid[0], grid[-1], _SCREEN_OMEGAS)


def _band_ends(constraints: tuple[Constraint, ...]) -> list[Array]:
    ends = [w for constraint in constraints for w in (constraint.from_rad_s, constraint.to_rad_s) if 0.0 < w < math.inf]
    return [np.array(ends)]


def fixed_gains(box: ControllerSpec) -> FoPi | None:
    """The gains when the spec leaves none of them open."""
    if box.kp.is_fixed and box.ki.is_fixed and box.alpha.is_fixed:
        return FoPi(box.kp.min, box.ki.min, box.alpha.min)
    return None


def has_no_integral(box: ControllerSpec) -> bool:
    """Whether ki is fixed at 0."""
    return box.ki.is_fixed and box.ki.min == 0.0
