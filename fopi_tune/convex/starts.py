"""Starts at one alpha:  closed-form gains for many crossovers and phase margins, and of these the best distinct ones.

With crossover omega_c and phase margin phi of the nominal plant P, X = e^{j(phi - pi)}/P(j omega_c) and

    ki = -Im X omega_c^alpha/sin(alpha pi/2) ,      kp = Re X - ki omega_c^-alpha cos(alpha pi/2) .                  (1)

Where the spec fixes one of the two or both, only that value is used.

Source: derived from L(j omega_c) = e^{j(phi - pi)}, two real equations that are linear in the gains.
"""

from __future__ import annotations

import itertools
import math

import numpy as np

from fopi_tune.convex.convex_concave import Members
from fopi_tune.convex.evaluate import Evaluation, evaluate, nominal_violations
from fopi_tune.convex.limits import OPEN_GAIN, Bound, Task
from fopi_tune.core.bode_form import Array
from fopi_tune.core.loops import Plants
from fopi_tune.errors import DomainError
from fopi_tune.quantities.base import EvaluatedAt

#: crossovers a decade, and decades on either side of the characteristic frequency
_PER_DECADE, _DECADES = 3, 2.0
_MARGINS_DEG = (35.0, 55.0, 75.0, 95.0, 120.0)
_SMALL = (1e-3, 1e-2, 1e-1)
#: gains of the lattice that are evaluated with all limits and members
_EVALUATED = 12
#: neper or radian; the start with the best objective may violate the limits by this much more than the best start
_NEARLY_AS_GOOD = 0.5
#: starts must differ by this much in asinh(10 x)
_APART = 0.4


def starts(task: Task, members: Members, alpha: float, most: int) -> list[Evaluation]:
    """At most `most` starts at one alpha, the best first; empty when no gains are usable."""
    lattice = [task.gains(x, alpha) for x in _lattice(task, alpha)]
    lattice = [g for g in dict.fromkeys(lattice) if g.kp != 0.0 or g.ki != 0.0]
    if not lattice:
        return []
    try:
        first = np.argsort(nominal_violations(task, lattice), kind="stable")[:_EVALUATED]
    except DomainError:
        # one of them has |L| = 1 over a whole range: evaluate all of them one by one
        first = np.arange(len(lattice))
    evaluated = [evaluate(task, lattice[i], members.plants) for i in first]
    evaluated = [found for found in evaluated if math.isfinite(found.violation)]
    ranked = sorted(evaluated, key=_rank)
    # the start with the best objective may lead to another, better optimum
    by_objective = min(
        (found for found in ranked if found.violation < ranked[0].violation + _NEARLY_AS_GOOD),
        key=lambda found: found.cost,
        default=None,
    )
    chosen: list[Evaluation] = []
    for found in (*ranked[:1], *([by_objective] if by_objective else []), *ranked[1:]):
        place = np.arcsinh(10.0 * task.scaled(found.gains))
        near = (np.abs(place - np.arcsinh(10.0 * task.scaled(c.gains))).max() < _APART for c in chosen)
        if not any(near):
            chosen.append(found)
        if len(chosen) == most:
            break
    return chosen


def _rank(found: Evaluation) -> tuple[float, float]:
    return found.violation, found.cost


def _lattice(task: Task, alpha: float) -> list[Array]:
    """Values of x, clipped to their bounds."""
    low, high = task.box(alpha)
    omega, margin = np.array(list(itertools.product(_crossovers(task), _margins(task)))).T
    plant = Plants.members(task.spec.plant, task.spec.plant.nominal_point[None, :])
    rows = np.zeros(len(omega), dtype=np.intp)
    response = plant.response(rows, omega) * np.exp(-1j * omega * plant.dead_time_s[0])
    # formula (1)
    wanted = np.exp(1j * (margin - np.pi)) / response
    ki = -wanted.imag * omega**alpha / math.sin(0.5 * math.pi * alpha)
    kp = wanted.real - ki * omega**-alpha * math.cos(0.5 * math.pi * alpha)
    x = np.stack([kp, ki], axis=1) / task.unit(alpha)
    small = np.array([(a * size, b * size) for size in _SMALL for a, b in ((1, 1), (-1, -1), (0, 1), (1, 0))])
    x = np.concatenate([x[np.isfinite(x).all(axis=1)], small])
    inside = np.clip(x, low, high)
    # at an upper end such as kp = 1 with a plant of gain 1, |L| = 1 may hold over a whole range
    at_end = (inside == high) & (inside > low) & (high < OPEN_GAIN)
    return list(np.where(at_end, inside - 1e-6 * np.abs(inside), inside))


def _crossovers(task: Task) -> Array:
    low, high = task.omega_rad_s * 10.0**-_DECADES, task.omega_rad_s * 10.0**_DECADES
    for limit in task.limits:
        if limit.where is EvaluatedAt.HIGHEST_GAIN_CROSSOVER and limit.quantity == "crossover_rad_s":
            if limit.bound is Bound.EQUAL:
                return np.array([math.exp(limit.limit)])
            low = max(low, math.exp(limit.limit)) if limit.bound is Bound.LOWER else low
            high = min(high, math.exp(limit.limit)) if limit.bound is Bound.UPPER else high
    low, high = min(low, high), max(low, high)
    return np.geomspace(low, high, max(2, round(_PER_DECADE * math.log10(high / low)) + 1))


def _margins(task: Task) -> Array:
    for limit in task.limits:
        if limit.quantity == "phase_margin_deg" and limit.bound is Bound.EQUAL:
            return np.array([limit.limit])
    return np.radians(_MARGINS_DEG)
