"""DesignSpec -> constraints of the solver, and their scaling.

Every requirement becomes one-sided inequalities or an equality in natural units (neper, radian).  With a characteristic
frequency omega_s and the gain g_s = |P(j omega_s)| of the nominal plant the loop is scaled by

    v = ln(omega/omega_s),   kp' = kp g_s,   ki' = ki g_s omega_s^-alpha,   kd' = kd g_s omega_s ,
    so that   C g_s = kp' + ki' e^{-alpha (v + j pi/2)} ,
    with a derivative   C g_s = kp' + ki'/s + kd' s/(Tf omega_s s + 1)   at   s = j e^v ,
    and with orders kd' = kd g_s omega_s^mu in the same way.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from enum import Enum

import numpy as np

from fopi_tune.core.bode_form import Array
from fopi_tune.core.controller import FoPi, FoPid, Pid, derivative_of
from fopi_tune.core.loops import Plants
from fopi_tune.core.peaks import Tilt
from fopi_tune.core.terms.measurement_filter import MeasurementFilter
from fopi_tune.quantities import QUANTITIES, Quantity
from fopi_tune.quantities.base import EvaluatedAt
from fopi_tune.spec.model import DesignSpec, Relation, Requirement, Scope

#: The design keeps |S| below this for every plant and frequency, with or without a requirement: a modulus margin of
#: 0.01. The loop's distance from -1 then stays positive, so that stability of one member implies that of the connected
#: family.
STABILITY_GUARD_DB = 40.0
#: 2 arcsin(0.01/2), the phase margin that corresponds to this modulus margin
STABILITY_GUARD_DEG = 0.573
#: `Constraint.requirement` of the stability guards, which belong to no requirement
STABILITY_GUARD = -1
#: objectives that are better the slower the loop is
_SLOW = ("sensitivity_peak_db", "control_sensitivity_peak_db")


class Bound(Enum):
    """Which way a constraint bounds its quantity; the value is the slack's sign: slack = value (limit - quantity)."""

    LOWER = -1
    UPPER = 1
    EQUAL = 0


@dataclass(frozen=True)
class Constraint:
    """One bound of one requirement, or a stability guard.

    Args:
        requirement: index in the spec's list, or STABILITY_GUARD.
        quantity: what is bounded.
        bound: which way.
        limit: in natural units (neper or radian).
        limit_public: in the quantity's public unit.
        scale: multiplies the slack; see `Quantity.natural_scale`.
        nominal: whether it holds for the nominal plant only.
        from_rad_s, to_rad_s: the band, for frequency functions.
        tilt: of a limit that is a line over ln omega; `limit` is then that at its lower end.
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
    tilt: Tilt | None = None

    @property
    def where(self) -> EvaluatedAt:
        """At which frequencies the quantity is evaluated."""
        return self.quantity.where

    @property
    def ends(self) -> tuple[float, ...]:
        """Of 0 and inf, the frequencies whose limits count: of a band, and of margins that have a lower limit.

        1/|L| where L tends to a negative number is a gain margin, and where |L| stays above 1 there is no delay margin.
        """
        if self.where is EvaluatedAt.BAND:
            both = (0.0, self.from_rad_s == 0.0), (math.inf, self.to_rad_s == math.inf)
            return tuple(end for end, counts in both if counts)
        if self.bound is not Bound.LOWER:
            return ()
        return {"gain_margin_db": (0.0, math.inf), "delay_margin_s": (math.inf,)}.get(self.quantity.name, ())

    def slack(self, natural: float) -> float:
        """Distance of a value from the limit, positive inside; of an equality, minus the absolute distance."""
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


def constraints_of(spec: DesignSpec) -> tuple[Constraint, ...]:
    """The constraints of every requirement, then the two stability guards.

    The guard of |S| counts in the depth (the smallest slack) only when no other constraint does.  The guard of the
    phase margin excludes unstable loops: |S| <= M alone also holds for some of them.
    """
    constraints = [
        constraint for i, requirement in enumerate(spec.requirements) for constraint in _split(i, requirement)
    ]
    peak = Requirement("sensitivity_db", Relation.AT_MOST, (STABILITY_GUARD_DB,))
    margin = Requirement("phase_margin_deg", Relation.AT_LEAST, (STABILITY_GUARD_DEG,))
    alone = not any(constraint.in_depth for constraint in constraints)
    return (
        *constraints,
        _constraint(STABILITY_GUARD, peak, Bound.UPPER, STABILITY_GUARD_DB, alone),
        _constraint(STABILITY_GUARD, margin, Bound.LOWER, STABILITY_GUARD_DEG, False),
    )


def _split(index: int, requirement: Requirement) -> list[Constraint]:
    if requirement.relation is Relation.EQUALS:
        return [_constraint(index, requirement, Bound.EQUAL, requirement.limits[0], False)]
    constraints = []
    if math.isfinite(requirement.lower):
        constraints.append(_constraint(index, requirement, Bound.LOWER, requirement.lower, True))
    if math.isfinite(requirement.upper):
        constraints.append(_constraint(index, requirement, Bound.UPPER, requirement.upper, True))
    return constraints


def _constraint(index: int, requirement: Requirement, bound: Bound, limit: float, in_depth: bool) -> Constraint:
    quantity = QUANTITIES[requirement.quantity]
    return Constraint(
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
        tilt=requirement.tilt,
    )


_POINTS_PER_DECADE = 16
#: decades of the grid beyond the lowest and highest characteristic frequency; more where gains are left open
_DECADES_BEYOND = 3.0
_DECADES_BEYOND_OPEN = 5.0


@dataclass(frozen=True)
class Scale:
    """The scaling of a spec, and its frequency grid.

    Args:
        omega_rad_s: omega_s.
        gain: g_s = |P(j omega_s)| of the nominal plant.
        omega_grid: shape (n,), rad/s, where the oracle evaluates the constraints.
        filter_s: Tf of the derivative, 0 where there is none.
        has_orders: whether the structure is fopid.
        measurement_filter: F, which the search counts to the plant: C P = (C/F) (F P).
    """

    omega_rad_s: float
    gain: float
    omega_grid: Array
    filter_s: float = 0.0
    has_orders: bool = False
    measurement_filter: MeasurementFilter | None = None

    @property
    def lag_and_square(self) -> tuple[float, float]:
        """a and b of 1/F = 1 + a s + b s^2 in scaled s; both 0 without a filter."""
        if self.measurement_filter is None:
            return 0.0, 0.0
        square, lag, _ = (0.0, *self.measurement_filter.slower(self.omega_rad_s).coefficients)[-3:]
        return lag, square

    def scaled(self, controller: FoPi) -> Array:
        """(kp', ki', alpha), with a derivative (kp', ki', kd'), with orders (kp', ki', kd', alpha, mu)."""
        ki = controller.ki * self.gain * self.omega_rad_s**-controller.alpha
        third, derivative = controller.alpha, derivative_of(controller)
        if self.filter_s:
            third = derivative.kd * self.gain * self.omega_rad_s**derivative.mu
        orders = [controller.alpha, derivative.mu] if self.has_orders else []
        return np.array([controller.kp * self.gain, ki, third, *orders])

    def controller(self, scaled: Array) -> FoPi:
        """The gains in the user's units."""
        return replace(self._terms(scaled), measurement_filter=self.measurement_filter)

    def _terms(self, scaled: Array) -> FoPi:
        kp, ki, third, *orders = (float(x) for x in scaled)
        if self.has_orders:
            alpha, mu = orders
            kd = third / (self.gain * self.omega_rad_s**mu)
            return FoPid(kp / self.gain, ki / self.gain * self.omega_rad_s**alpha, alpha, kd, mu, self.filter_s)
        if self.filter_s:
            kd = third / (self.gain * self.omega_rad_s)
            return Pid(kp / self.gain, ki / self.gain * self.omega_rad_s, kd, self.filter_s)
        return FoPi(kp / self.gain, ki / self.gain * self.omega_rad_s**third, third)


def scale_of(spec: DesignSpec, crossover_rad_s: float | None = None) -> Scale:
    """Scaling and frequency grid, from the plants' corner frequencies and dead times and the spec's own frequencies.

    Args:
        spec: the spec.
        crossover_rad_s: of gains that are known to meet it, omega_s then; None for a guess.
    """
    family = spec.plant
    plants = Plants.members(family, family.corners())
    roots = plants.corner_roots
    own = np.concatenate([np.abs(roots), 1.0 / plants.dead_time_s[plants.dead_time_s > 0]])
    named, box = _named_frequencies(spec), spec.controller
    filter_s = box.derivative_filter_time_constant_s
    filtered = box.measurement_filter
    filters = [1.0 / filter_s] if filter_s else []
    filters += [1.0 / filtered.time_constant_s] if filtered else []
    everything = np.concatenate([own, named, filters])
    everything = everything if len(everything) else np.array([1.0])
    omega_s = _characteristic(spec, own, named) if crossover_rad_s is None else crossover_rad_s
    is_open = any(math.isinf(v) for gain in (box.kp, box.ki, box.kd) for v in (gain.min, gain.max))
    span = 10.0 ** (_DECADES_BEYOND_OPEN if is_open else _DECADES_BEYOND)
    low, high = everything.min() / span, everything.max() * span
    count = int(_POINTS_PER_DECADE * math.log10(high / low)) + 2
    grid = np.geomspace(low, high, count)
    damped = roots[np.abs(roots.real) < 0.5 * np.abs(roots.imag)]
    resonances = [abs(r.imag) * (1.0 + k * abs(r.real) / abs(r)) for r in damped for k in (-4.0, -1.0, 0.0, 1.0, 4.0)]
    grid = np.unique(np.concatenate([grid, np.array(resonances), named]))
    nominal = plants.take(np.array([0]))
    gain = float(np.abs(nominal.response(np.array([0]), np.array([omega_s])))[0])
    unit = gain if math.isfinite(gain) and gain > 0 else 1.0
    return Scale(omega_s, unit, grid[grid > 0], filter_s, box.has_derivative_order, filtered)


def _named_frequencies(spec: DesignSpec) -> Array:
    named = []
    for requirement in spec.requirements:
        named += [w for w in (requirement.from_rad_s, requirement.to_rad_s) if 0.0 < w < math.inf]
        if requirement.quantity == "crossover_rad_s":
            named += list(requirement.limits)
    return np.array(named)


def _characteristic(spec: DesignSpec, own: Array, named: Array) -> float:
    """omega_s: the geometric mean of the plants' corner frequencies, or the next crossover that the spec allows.

    A loop whose objective grows with the crossover comes close to a lower limit: omega_s is between that and the mean.
    """
    values = own if len(own) else named
    found = float(np.exp(np.mean(np.log(values)))) if len(values) else 1.0
    limits = [requirement for requirement in spec.requirements if requirement.quantity == "crossover_rad_s"]
    lowest = max((requirement.lower for requirement in limits), default=0.0)
    nearest = max(min([found, *(requirement.upper for requirement in limits)]), lowest)
    is_slow = spec.objective is not None and spec.objective.quantity in _SLOW
    return math.sqrt(lowest * nearest) if is_slow and lowest > 0.0 else nearest
