"""DesignSpec -> Task:  limits in natural units (neper, radian), the objective and the scaling.

Every limit is one bound of one requirement, or one of the two stability guards, which keep a small distance from -1.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import Enum
from functools import cached_property

import numpy as np

from fopi_tune.convex.loops import LoopKind
from fopi_tune.core.bode_form import Array
from fopi_tune.core.controller import FoPi
from fopi_tune.core.loops import Plants
from fopi_tune.core.peaks import Response
from fopi_tune.quantities import QUANTITIES
from fopi_tune.quantities.base import EvaluatedAt
from fopi_tune.quantities.objectives import ObjectiveKind, default_horizon_s
from fopi_tune.quantities.responses import FrequencyFunction
from fopi_tune.spec.model import DesignSpec, Relation, Requirement, Scope

#: stability guards: the largest |S| and the smallest phase margin of every plant, whatever the requirements
GUARD_DB, GUARD_DEG = 40.0, 0.573
#: `Limit.requirement` of the stability guards, which belong to no requirement
STABILITY_GUARD = -1
#: inequalities are designed this much tighter (natural units), so that rounding does not undo them
TIGHTENING = 4e-7
#: a gain the spec leaves open is searched this far, in the plants' own scale
OPEN_GAIN = 1e4
#: scaled; the cost of ki changes from logarithmic to linear below this
_SMALL_KI = 1e-4
#: quantities at crossings whose derivatives `cone_constraints` has
CROSSING_QUANTITIES = (
    "crossover_rad_s",
    "phase_margin_deg",
    "gain_margin_db",
    "delay_margin_s",
    "phase_slope_deg_per_decade",
)


class Bound(Enum):
    """Which way a limit bounds its quantity; the value is the slack's sign: slack = value (limit - quantity)."""

    LOWER = -1
    UPPER = 1
    EQUAL = 0


@dataclass(frozen=True)
class Limit:
    """One bound of one requirement, or a stability guard.

    Args:
        requirement: index in the spec's list, or STABILITY_GUARD.
        quantity: its name.
        where: at which frequencies it is evaluated.
        response: of a frequency function; else None.
        bound: lower, upper or equality.
        limit: in natural units, inequalities tightened.
        scale: multiplies the slack, so that it is dimensionless.
        nominal: whether it holds for the nominal plant only.
        from_rad_s, to_rad_s: the band of a frequency function.
    """

    requirement: int
    quantity: str
    where: EvaluatedAt
    response: Response | None
    bound: Bound
    limit: float
    scale: float
    nominal: bool
    from_rad_s: float
    to_rad_s: float

    def slack(self, value: Array) -> Array:
        """Distance of values from the limit, positive inside; of an equality, minus the absolute distance."""
        if self.bound is Bound.EQUAL:
            return -np.abs(self.limit - value) * self.scale
        return self.bound.value * (self.limit - value) * self.scale


@dataclass(frozen=True)
class Task:
    """A spec in the form of the convex design.

    With a characteristic frequency omega_s (`omega_rad_s`) and g_s = |P(j omega_s)| (`gain`) of the nominal plant the
    variables are x = (kp g_s, ki g_s omega_s^-alpha).  The limits are about the loop of `kind`.
    """

    spec: DesignSpec
    limits: tuple[Limit, ...]
    objective: ObjectiveKind
    horizon_s: float
    omega_rad_s: float
    gain: float
    kind: LoopKind

    def ki_cost(self, gains: FoPi) -> tuple[float, float]:
        """The cost of `maximize: ki`, -asinh(ki/small), and its derivative by ki.

        The cost is -ln ki but for a constant where ki is large, and finite at ki = 0.
        """
        order = 0.5 * (self.spec.controller.alpha.min + self.spec.controller.alpha.max)
        small = _SMALL_KI * self.omega_rad_s**order / self.gain
        return -math.asinh(gains.ki / small), -1.0 / math.hypot(gains.ki, small)

    @cached_property
    def equalities(self) -> int:
        """Number of limits that are equalities."""
        return sum(limit.bound is Bound.EQUAL for limit in self.limits)

    def scaled(self, gains: FoPi) -> Array:
        """x of gains, shape (2,)."""
        return np.array([gains.kp * self.gain, gains.ki * self.gain * self.omega_rad_s**-gains.alpha])

    def unit(self, alpha: float) -> Array:
        """(kp, ki) per unit of x, shape (2,)."""
        return np.array([1.0 / self.gain, self.omega_rad_s**alpha / self.gain])

    def gains(self, x: Array, alpha: float) -> FoPi:
        """The gains at x, clipped to the spec's ranges."""
        box, (kp, ki) = self.spec.controller, (x * self.unit(alpha)).tolist()
        return FoPi(min(max(kp, box.kp.min), box.kp.max), min(max(ki, box.ki.min), box.ki.max), alpha)

    def box(self, alpha: float) -> tuple[Array, Array]:
        """Lower and upper bounds of x, shape (2,) each."""
        ranges, unit = (self.spec.controller.kp, self.spec.controller.ki), self.unit(alpha)
        low = np.array([max(r.min / u, -OPEN_GAIN) for r, u in zip(ranges, unit, strict=True)])
        high = np.array([min(r.max / u, OPEN_GAIN) for r, u in zip(ranges, unit, strict=True)])
        return low, high


def task_of(spec: DesignSpec, crossover_rad_s: float | None = None) -> Task:
    """Limits, objective and scaling of a spec.

    Args:
        spec: the spec.
        crossover_rad_s: where the filter of a loop on samples is exact, if that depends on a crossover.
    """
    limits = tuple(limit for i, r in enumerate(spec.requirements) for limit in _split(i, r))
    peak = Requirement("sensitivity_db", Relation.AT_MOST, (GUARD_DB,))
    margin = Requirement("phase_margin_deg", Relation.AT_LEAST, (GUARD_DEG,))
    guards = (
        _limit(STABILITY_GUARD, peak, Bound.UPPER, GUARD_DB),
        _limit(STABILITY_GUARD, margin, Bound.LOWER, GUARD_DEG),
    )
    objective = ObjectiveKind(spec.objective.quantity) if spec.objective else ObjectiveKind.DEPTH
    if objective is ObjectiveKind.DEPTH and all(limit.bound is Bound.EQUAL for limit in limits):
        objective = ObjectiveKind.SENSITIVITY_PEAK  # the depth is then the distance from -1
    horizon = spec.objective.horizon_s if spec.objective else None
    omega = _characteristic_frequency(spec)
    nominal = Plants.members(spec.plant, spec.plant.nominal_point[None, :])
    gain = float(np.abs(nominal.response(np.zeros(1, dtype=np.intp), np.array([omega])))[0])
    usable = math.isfinite(gain) and gain > 0.0
    kind = LoopKind(spec.sampled_design).exact_at(crossover_rad_s)
    scale = gain if usable else 1.0
    return Task(spec, (*limits, *guards), objective, horizon or default_horizon_s(spec.plant), omega, scale, kind)


def unsupported(spec: DesignSpec) -> str | None:
    """Why the convex design cannot take a spec, or None."""
    digital, alpha = spec.sampled_design, spec.controller.alpha
    if spec.controller.has_derivative:
        return f"the convex path knows no derivative; use the solver ipopt for structure: {spec.controller.structure}"
    if spec.controller.measurement_filter is not None:
        return "the convex path knows no measurement_filter; use the solver ipopt"
    if digital is not None and digital.method == "fit" and not alpha.is_fixed:
        return "the convex path takes a fitted filter for a fixed alpha only: it is no smooth function of alpha"
    for requirement in spec.requirements:
        quantity = QUANTITIES[requirement.quantity]
        known = isinstance(quantity, FrequencyFunction) or requirement.quantity in CROSSING_QUANTITIES
        if not known:
            return f"the convex path does not know {requirement.quantity}; use the solver ipopt"
        if requirement.end_limit is not None:
            return f"the convex path does not know {requirement.quantity} by_frequency; use the solver ipopt"
        band = requirement.from_rad_s < requirement.to_rad_s
        if requirement.relation is Relation.EQUALS and quantity.takes_band and band:
            name = requirement.quantity
            return f"the convex path takes {name} equals at one frequency only (at_rad_s); use the solver ipopt"
    return None


def _split(index: int, requirement: Requirement) -> list[Limit]:
    if requirement.relation is Relation.EQUALS:
        return [_limit(index, requirement, Bound.EQUAL, requirement.limits[0])]
    ends = ((Bound.LOWER, requirement.lower), (Bound.UPPER, requirement.upper))
    return [_limit(index, requirement, bound, end) for bound, end in ends if math.isfinite(end)]


def _limit(index: int, requirement: Requirement, bound: Bound, public: float) -> Limit:
    quantity = QUANTITIES[requirement.quantity]
    scale = quantity.natural_scale(public)
    tightening = 0.0 if index == STABILITY_GUARD else TIGHTENING / scale
    return Limit(
        requirement=index,
        quantity=requirement.quantity,
        where=quantity.where,
        response=quantity.response if isinstance(quantity, FrequencyFunction) else None,
        bound=bound,
        limit=quantity.to_natural(public) - bound.value * tightening,
        scale=scale,
        nominal=requirement.scope is Scope.NOMINAL,
        from_rad_s=requirement.from_rad_s,
        to_rad_s=requirement.to_rad_s,
    )


def _characteristic_frequency(spec: DesignSpec) -> float:
    """omega_s: the crossover that the spec names, else the geometric mean of corner frequencies and 1/dead times."""
    for requirement in spec.requirements:
        if requirement.quantity == "crossover_rad_s":
            return requirement.limits[0]
    plants = Plants.members(spec.plant, spec.plant.corners())
    roots = np.concatenate([plants.zeros.ravel(), plants.poles.ravel()])
    roots = np.abs(roots[np.isfinite(roots) & (roots != 0.0)])
    own = np.concatenate([roots, 1.0 / plants.dead_time_s[plants.dead_time_s > 0.0]])
    named = [w for r in spec.requirements for w in (r.from_rad_s, r.to_rad_s) if 0.0 < w < math.inf]
    known = own if len(own) else np.array(named)
    return float(np.exp(np.mean(np.log(known)))) if len(known) else 1.0
