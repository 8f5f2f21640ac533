"""Proof obligations of a requirement:  one relation at one level -> claims in ball arithmetic.

`certify` proves these claims and `recheck` checks their records, so a certificate cannot leave a claim out.  That one
plant violates a level is the opposite claim for this plant alone.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields, replace
from functools import cached_property
from typing import Any

import numpy as np
from flint import arb

from fopi_tune.core.controller import FoPi
from fopi_tune.core.parallel_form import Implementation
from fopi_tune.core.peaks import Response
from fopi_tune.core.plant import PlantFamily
from fopi_tune.proof.balls.box import Box, Interval, point_box
from fopi_tune.proof.balls.loop import BallLoop
from fopi_tune.proof.balls.sampled import SampledBallLoop
from fopi_tune.proof.claims.bound import Bound, Line
from fopi_tune.proof.claims.claim import Claim
from fopi_tune.proof.claims.crossing_quantities import CrossingEvaluator, CrossingQuantity
from fopi_tune.proof.claims.crossings import EveryCrossover, EveryPhaseCrossover
from fopi_tune.proof.claims.existence import SomeCrossover, SomePhaseCrossover
from fopi_tune.proof.claims.lag import closed_form
from fopi_tune.proof.claims.poles import (
    NoPoleAtTheEnds,
    StableOnEveryPiece,
    count_unstable_poles,
    is_structurally_unstable,
)
from fopi_tune.quantities import QUANTITIES
from fopi_tune.quantities.base import EvaluatedAt
from fopi_tune.quantities.responses import FrequencyFunction
from fopi_tune.spec.model import Requirement, Scope

#: quantity of a spec -> quantity at a gain crossover, and natural units per unit of it
CROSSING_QUANTITIES: dict[str, tuple[CrossingQuantity, float]] = {
    "phase_margin_deg": (CrossingQuantity.PHASE_MARGIN, 1.0),
    "delay_margin_s": (CrossingQuantity.DELAY_MARGIN, 1.0),
    "phase_slope_deg_per_decade": (CrossingQuantity.PHASE_SLOPE, math.log(10.0)),
    "crossover_rad_s": (CrossingQuantity.CROSSOVER, 1.0),
}

_EVERYWHERE: Interval = (-math.inf, math.inf)
#: below every u
_NOWHERE = -1e300
#: |u| at which one plant is evaluated for the limits omega -> 0 and omega -> inf
_FAR = 120.0
#: ln of a turn in rad beyond which the rounding of u = ln omega moves the phase of a dead time by more than 1e-7 rad
_MOST_LOG_TURN = math.log(1e7)


@dataclass(frozen=True)
class Case:
    """Loop of a certificate: controller and plants, without the requirements.

    Args:
        gains: the controller.
        family: the plants.
        origin: a value of u near the crossover, where the frequency axis is cut first; u = ln omega, on samples
            ln tan(omega Ts/2).
        nominal_crossings: u of the nominal plant's gain crossovers; None when they are not known.
        implementation: the digital controller, when the loop is the one on samples.
    """

    gains: FoPi
    family: PlantFamily
    origin: float
    nominal_crossings: tuple[float, ...] | None = None
    implementation: Implementation | None = None

    def __getstate__(self) -> dict[str, Any]:
        """What makes the case, without what was computed of it: balls cannot be copied to another process."""
        return {field.name: getattr(self, field.name) for field in fields(self)}

    @cached_property
    def loop(self) -> BallLoop:
        """The loop in ball arithmetic."""
        if self.implementation is None:
            return BallLoop(self.gains, self.family)
        return SampledBallLoop(self.gains, self.family, self.implementation)

    @cached_property
    def evaluator(self) -> CrossingEvaluator:
        """Evaluates quantities at crossings."""
        return CrossingEvaluator(self.loop, self.nominal_crossings)

    @property
    def plants(self) -> Box:
        """The whole box of uncertain numbers."""
        return self.loop.family_box

    @property
    def nominal(self) -> tuple[float, ...]:
        """The nominal plant's uncertain numbers."""
        return tuple(self.family.nominal_point.tolist())

    def plants_of(self, requirement: Requirement) -> Box:
        """The plants in a requirement's scope."""
        return point_box(self.nominal) if requirement.scope is Scope.NOMINAL else self.plants


def level_claims(case: Case, requirement: Requirement, upper: bool, level: float) -> list[Claim]:
    """Claims that together mean: for every plant in the requirement's scope the value is on this side of a level.

    Args:
        case: gains and family.
        requirement: gives quantity, scope and band; its limits are not used.
        upper: the value is at most the level; else at least.
        level: in the quantity's natural unit.
    """
    return _in_closed_form(_level_claims(case, requirement, upper, level, case.plants_of(requirement)))


def violation_claims(
    case: Case, requirement: Requirement, upper: bool, level: float, point: tuple[float, ...], omega: float | None
) -> list[Claim]:
    """Claims that together mean: this plant's value is at least the level (upper), or at most (not upper).

    Args:
        case: gains and family.
        requirement: gives quantity and band.
        upper: the side that is violated.
        level: in the quantity's natural unit.
        point: the plant's uncertain numbers.
        omega: frequency of a frequency function, rad/s; 0 and inf are limits.
    """
    if QUANTITIES[requirement.quantity].takes_band:
        if omega is None or math.isnan(omega) or _is_beyond_nyquist(case, requirement):
            return []
        u = min(max(_log_frequency(case, omega), -_FAR), _FAR)
        if u == _FAR:
            u = _aligned_far_out(case, point, upper)
        low, high = _band(case, requirement)
        u = min(max(u, low), high)
        return [_bound(case, requirement, not upper, level, (u, u), point_box(point))]
    claims = _level_claims(case, requirement, not upper, level, point_box(point))
    if omega is None or math.isnan(omega):
        return claims
    return [replace(c, hint=_log_frequency(case, omega)) if isinstance(c, SomePhaseCrossover) else c for c in claims]


def _log_frequency(case: Case, omega: float) -> float:
    """u at a frequency in rad/s; infinite at the ends of the axis."""
    if omega == 0.0:
        return -math.inf
    return math.inf if case.loop.is_beyond(omega) else case.loop.u_of(math.log(omega))


def _aligned_far_out(case: Case, point: tuple[float, ...], upper: bool) -> float:
    """u at which a plant shows its limit omega -> inf, or what comes closest to it.

    Behind a dead time a direct path has no limit: L turns on a circle.  S, T and C S are largest where L is nearest to
    -1 and least where it is nearest to +1, which happens once a turn; u is such a place where L has come as close to
    that circle as a double can still tell the phase.
    """
    loop = case.loop
    plant = loop.plant([arb(value) for value in point])
    dead_time_s = float(plant.dead_time.value.mid())
    if isinstance(loop, SampledBallLoop) or dead_time_s <= 0.0 or not plant.has_direct_path:
        return _FAR
    direct = float((loop.structure.at_infinity * plant.numerator[0].value / plant.denominator[0].value).mid())
    corner = float(loop.loops_at(np.array([point], dtype=float)).log.corners()[1][0])
    half_turns = math.exp(min(corner + math.log(dead_time_s), _MOST_LOG_TURN)) / math.pi
    # e^{-j omega L} = -1 at odd numbers of half turns
    odd = (direct > 0.0) is upper
    whole = 2 * math.ceil(0.5 * half_turns) + (1 if odd else 2)
    return math.log(whole * math.pi / dead_time_s)


def is_unstable(case: Case, point: tuple[float, ...]) -> bool:
    """Whether this plant's loop is shown to be unstable."""
    poles = count_unstable_poles(case.loop, point, case.origin)
    return bool(poles) or (poles is None and is_structurally_unstable(case.loop, point))


def no_crossover_claims(case: Case, point: tuple[float, ...]) -> list[Claim]:
    """Claims that together mean: this plant has no gain crossover."""
    domain = (_EVERYWHERE, *point_box(point))
    return [EveryCrossover(case.loop, CrossingQuantity.CROSSOVER, _NOWHERE, True, domain, case.origin, case.evaluator)]


def stability_claims(case: Case, level: float) -> list[Claim]:
    """Claims that together mean, if the nominal plant is stable: no plant of the family has an unstable pole.

    Args:
        case: gains and family.
        level: |S| is at most e^level for every plant at every frequency.
    """
    domain = (_EVERYWHERE, *case.plants)
    bound = Bound(case.loop, Response.SENSITIVITY, level, True, domain, case.origin)
    # on samples the ends of the axis are points of the unit circle, which the bound includes
    if not isinstance(case.loop, SampledBallLoop):
        return _in_closed_form([NoPoleAtTheEnds(case.loop, domain, case.origin), bound])
    pieces = [StableOnEveryPiece(case.loop, domain, case.origin, case.nominal)] if case.loop.cuts else []
    return _in_closed_form([bound, *pieces])


def _in_closed_form(claims: list[Claim]) -> list[Claim]:
    return [closed_form(claim) for claim in claims]


def _is_beyond_nyquist(case: Case, requirement: Requirement) -> bool:
    """Whether the loop on samples has no response in the requirement's band."""
    return case.implementation is not None and case.implementation.is_beyond_nyquist(requirement.from_rad_s)


def _band(case: Case, requirement: Requirement) -> Interval:
    return case.loop.band(requirement.from_rad_s, requirement.to_rad_s)


def _bound(case: Case, requirement: Requirement, upper: bool, level: float, band: Interval, plants: Box) -> Bound:
    quantity = QUANTITIES[requirement.quantity]
    assert isinstance(quantity, FrequencyFunction)
    line = Line.of(requirement)
    return Bound(case.loop, quantity.response, level, upper, (band, *plants), case.origin, line)


def _level_claims(case: Case, requirement: Requirement, upper: bool, level: float, plants: Box) -> list[Claim]:
    loop, origin = case.loop, case.origin
    quantity = QUANTITIES[requirement.quantity]
    if quantity.takes_band:
        if _is_beyond_nyquist(case, requirement):
            return []
        return [_bound(case, requirement, upper, level, _band(case, requirement), plants)]
    domain = (_EVERYWHERE, *plants)
    if quantity.where is EvaluatedAt.PHASE_CROSSOVERS:
        if upper:
            return [SomePhaseCrossover(loop, level, domain, origin)]
        return [EveryPhaseCrossover(loop, level, domain, origin)]
    if requirement.quantity not in CROSSING_QUANTITIES:
        return []
    crossing_quantity, scale = CROSSING_QUANTITIES[requirement.quantity]
    level = level / scale
    if crossing_quantity is CrossingQuantity.CROSSOVER:
        level = loop.inner_u_of(level, upper)
    some = SomeCrossover(loop, crossing_quantity, level, upper, domain, origin, case.evaluator)
    every = EveryCrossover(loop, crossing_quantity, level, upper, domain, origin, case.evaluator)
    crosses = replace(some, level=None)
    if crossing_quantity is CrossingQuantity.CROSSOVER:
        if math.isinf(level):  # every crossover is below Nyquist's frequency
            return [crosses] if upper else []
        above = replace(every, domain=((level, math.inf), *plants))
        return [above, crosses] if upper else [some]
    if crossing_quantity is CrossingQuantity.PHASE_SLOPE:
        return [every, crosses]
    # a margin: infinite without a crossover
    return [some] if upper else [every]
