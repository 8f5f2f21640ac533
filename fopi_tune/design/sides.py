"""Requirements as one-sided inequalities and equalities in natural units: what a solver works with; and their scale.

In the plant's own time and gain every design problem looks alike, be it in microseconds or in hours.  With omega_s
and g_s the loop is scaled by

    v = ln(omega/omega_s),   kp' = kp g_s,   ki' = ki g_s omega_s^-alpha ,
    so that   C g_s = kp' + ki' e^{-alpha (v + j pi/2)} .
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import Enum

import numpy as np

from fopi_tune.core.controller import FoPi
from fopi_tune.core.logform import Array
from fopi_tune.core.loops import Plants
from fopi_tune.quantities import QUANTITIES, Quantity
from fopi_tune.quantities.base import Where
from fopi_tune.spec.model import DesignSpec, Relation, Requirement, Scope

#: The design keeps |S| below this for every plant and frequency, whether or not a requirement says so: the loop's
#: distance from -1 stays above 0.01, so that stability at one member carries over to the connected family.
STABILITY_GUARD_DB = 40.0
#: 2 arcsin(0.01/2): the phase margin that goes with that distance
STABILITY_GUARD_DEG = 0.573
#: the guard's place in lists of requirements
GUARD = -1


class Bound(Enum):
    """Which way a side bounds its quantity; the value is the slack's sign: slack = value (limit - quantity)."""

    LOWER = -1
    UPPER = 1
    EQUAL = 0


@dataclass(frozen=True)
class Side:
    """One side of one requirement.

    Args:
        requirement: index in the spec's list, or GUARD.
        quantity: what is bounded.
        bound: which way.
        limit: in natural units (neper or radian).
        limit_public: in the quantity's public unit.
        scale: multiplies the slack; see `Quantity.natural_scale`.
        nominal: only the nominal member counts.
        from_rad_s, to_rad_s: the band, for frequency functions.
        in_depth: whether its slack counts when the smallest slack is the objective.
    """

    requirement: int
    quantity: Quantity
    bound: Bound
    limit: float
    limit_public: float
    scale: float
    nominal: bool
    from_rad_s: float
    to_rad_s: float
    in_depth: bool

    @property
    def where(self) -> Where:
        """At which frequencies the quantity is read."""
        return self.quantity.where

    def slack(self, natural: float) -> float:
        """How far inside the limit a value is; of an equality, minus the distance."""
        if self.bound is Bound.EQUAL:
            return -abs(self.limit - natural) * self.scale
        return self.bound.value * (self.limit - natural) * self.scale

    def natural_per_public(self) -> float:
        """d limit / d limit_public, by a central difference (exact for the linear units)."""
        step = 1e-6 * max(1.0, abs(self.limit_public))
        if self.limit_public - step <= 0.0 < self.limit_public:
            step = 1e-6 * self.limit_public
        up, down = (self.quantity.to_natural(self.limit_public + d) for d in (step, -step))
        return (up - down) / (2.0 * step)


def sides_of(spec: DesignSpec) -> tuple[Side, ...]:
    """Every side of every requirement, then the two stability guards.

    The guard of |S| counts in the depth only when nothing else does.  The small phase margin steers away from
    unstable loops that meet all the rest: |S| <= M alone is also true of some of them.
    """
    sides = [side for i, requirement in enumerate(spec.requirements) for side in _split(i, requirement)]
    peak = Requirement("sensitivity_db", Relation.AT_MOST, (STABILITY_GUARD_DB,))
    margin = Requirement("phase_margin_deg", Relation.AT_LEAST, (STABILITY_GUARD_DEG,))
    alone = not any(side.in_depth for side in sides)
    return (
        *sides,
        _side(GUARD, peak, Bound.UPPER, STABILITY_GUARD_DB, alone),
        _side(GUARD, margin, Bound.LOWER, STABILITY_GUARD_DEG, False),
    )


def _split(index: int, requirement: Requirement) -> list[Side]:
    if requirement.relation is Relation.EQUALS:
        return [_side(index, requirement, Bound.EQUAL, requirement.limits[0], False)]
    sides = []
    if math.isfinite(requirement.lower):
        sides.append(_side(index, requirement, Bound.LOWER, requirement.lower, True))
    if math.isfinite(requirement.upper):
        sides.append(_side(index, requirement, Bound.UPPER, requirement.upper, True))
    return sides


def _side(index: int, requirement: Requirement, bound: Bound, limit: float, in_depth: bool) -> Side:
    quantity = QUANTITIES[requirement.quantity]
    return Side(
        requirement=index,
        quantity=quantity,
        bound=bound,
        limit=quantity.to_natural(limit),
        limit_public=limit,
        scale=quantity.natural_scale(limit),
        nominal=requirement.scope is Scope.NOMINAL,
        from_rad_s=requirement.from_rad_s,
        to_rad_s=requirement.to_rad_s,
        in_depth=in_depth,
    )


_POINTS_PER_DECADE = 16
#: decades searched beyond the slowest and the fastest thing the spec names; with gains left open more
_DECADES_BEYOND = 3.0
_DECADES_BEYOND_OPEN = 5.0


@dataclass(frozen=True)
class Scale:
    """The scale of a spec.

    Args:
        omega_rad_s: omega_s.
        gain: g_s = |P(j omega_s)| of the nominal plant.
        omega_grid: shape (n,), rad/s, where violations are looked for.
    """

    omega_rad_s: float
    gain: float
    omega_grid: Array

    def scaled(self, controller: FoPi) -> Array:
        """(kp', ki', alpha), shape (3,)."""
        ki = controller.ki * self.gain * self.omega_rad_s**-controller.alpha
        return np.array([controller.kp * self.gain, ki, controller.alpha])

    def controller(self, scaled: Array) -> FoPi:
        """The gains in the user's units."""
        kp, ki, alpha = (float(x) for x in scaled[:3])
        return FoPi(kp / self.gain, ki / self.gain * self.omega_rad_s**alpha, alpha)


def scale_of(spec: DesignSpec) -> Scale:
    """Scale and frequency grid of a spec: from its plants' corners and dead times, and the frequencies it names."""
    family = spec.plant
    plants = Plants.members(family, family.corners())
    roots = np.concatenate([plants.zeros.ravel(), plants.poles.ravel()])
    roots = roots[np.isfinite(roots) & (roots != 0)]
    own = np.concatenate([np.abs(roots), 1.0 / plants.dead_time_s[plants.dead_time_s > 0]])
    named = _named_frequencies(spec)
    everything = np.concatenate([own, named]) if len(own) + len(named) else np.array([1.0])
    omega_s = _characteristic(spec, own, named)
    box = spec.controller
    is_open = any(math.isinf(v) for gain in (box.kp, box.ki) for v in (gain.min, gain.max))
    span = 10.0 ** (_DECADES_BEYOND_OPEN if is_open else _DECADES_BEYOND)
    low, high = everything.min() / span, everything.max() * span
    count = int(_POINTS_PER_DECADE * math.log10(high / low)) + 2
    grid = np.geomspace(low, high, count)
    damped = roots[np.abs(roots.real) < 0.5 * np.abs(roots.imag)]
    resonances = [abs(r.imag) * (1.0 + k * abs(r.real) / abs(r)) for r in damped for k in (-4.0, -1.0, 0.0, 1.0, 4.0)]
    grid = np.unique(np.concatenate([grid, np.array(resonances), named]))
    nominal = plants.take(np.array([0]))
    gain = float(np.abs(nominal.response(np.array([0]), np.array([omega_s])))[0])
    return Scale(omega_s, gain if math.isfinite(gain) and gain > 0 else 1.0, grid[grid > 0])


def _named_frequencies(spec: DesignSpec) -> Array:
    named = []
    for requirement in spec.requirements:
        named += [w for w in (requirement.from_rad_s, requirement.to_rad_s) if 0.0 < w < math.inf]
        if requirement.quantity == "crossover_rad_s":
            named += list(requirement.limits)
    return np.array(named)


def _characteristic(spec: DesignSpec, own: Array, named: Array) -> float:
    """The crossover where the spec fixes one, else the geometric middle of the plant's corners."""
    for requirement in spec.requirements:
        if requirement.quantity == "crossover_rad_s":
            return requirement.limits[0]
    values = own if len(own) else named
    return float(np.exp(np.mean(np.log(values)))) if len(values) else 1.0
