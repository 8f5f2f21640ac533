"""Evaluate one requirement for one controller:  worst value over scope and band, slack, score and outcome."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from fopi_tune.core.bode_form import Array
from fopi_tune.core.loops import Loops
from fopi_tune.proof.verification.crossing_changes import SamplePair
from fopi_tune.proof.verification.results import Extreme, Outcome, Place, RequirementResult, Stability
from fopi_tune.proof.verification.sample import with_work
from fopi_tune.proof.verification.worst_case import find_worst_case, place_of
from fopi_tune.quantities import QUANTITIES
from fopi_tune.spec.model import Relation, Requirement, Scope

#: exp overflows beyond this
_LARGEST_EXPONENT = 700.0


def check_requirement(
    requirement: Requirement, samples: SamplePair, stability: Stability, tolerance: float
) -> RequirementResult:
    """Find the worst value of the requirement's quantity and score it.

    Args:
        requirement: to be checked.
        samples: the family with the controller.
        stability: of the family: an unstable member has no margin.
        tolerance: allowed violation, in natural units.
    """
    implementation = samples.base.implementation
    if implementation is not None and implementation.is_beyond_nyquist(requirement.from_rad_s):
        place = place_of(samples.base, samples.base.nominal_x, requirement.from_rad_s)
        return RequirementResult(requirement, None, Outcome.BEYOND_NYQUIST, None, None, place)
    sides = [largest for largest in (False, True) if _has_side(requirement, largest)]
    if not stability.stable and QUANTITIES[requirement.quantity].is_margin and requirement.scope is Scope.FAMILY:
        unstable = replace(stability.worst, omega_rad_s=None)
        return assess_requirement(requirement, tuple(Extreme(s, None, unstable) for s in sides), tolerance)
    results = [_one_side(requirement, samples, largest) for largest in sides]
    extremes = tuple(
        Extreme(largest, None if math.isnan(achieved) else achieved, place)
        for largest, (achieved, place) in zip(sides, results, strict=True)
    )
    return assess_requirement(requirement, extremes, tolerance)


def assess_requirement(requirement: Requirement, extremes: tuple[Extreme, ...], tolerance: float) -> RequirementResult:
    """Slack, score and outcome of a requirement from the extremes of its quantity; only this step uses the limits."""
    slacks = []
    for extreme in extremes:
        if extreme.achieved is None:
            missing = Outcome.UNSTABLE if QUANTITIES[requirement.quantity].is_margin else Outcome.NO_CROSSOVER
            return RequirementResult(requirement, None, missing, None, None, extreme.worst, extremes)
        slacks.append(_slack(requirement, extreme.achieved))
    k = int(np.argmin(slacks))
    achieved, slack = extremes[k].achieved, slacks[k]
    assert achieved is not None  # the loop above returns otherwise
    score = _score(requirement, slack, tolerance)
    outcome = _outcome(requirement, achieved, score)
    return RequirementResult(requirement, achieved, outcome, slack, score, extremes[k].worst, extremes)


def _has_side(requirement: Requirement, largest: bool) -> bool:
    return math.isfinite(requirement.upper if largest else requirement.lower)


def _one_side(requirement: Requirement, samples: SamplePair, largest: bool) -> tuple[float, Place]:
    """The largest or the smallest value over the scope and the band; nan where a member has none."""
    quantity, sign = QUANTITIES[requirement.quantity], 1.0 if largest else -1.0

    def criterion(loops: Loops) -> tuple[Array, Array, Array]:
        found = quantity.measure(loops, largest, requirement.from_rad_s, requirement.to_rad_s, requirement.tilt)
        return with_work(sign * found.value, found.omega_rad_s, found.work)

    # Frequency functions are continuous over the box; values at crossings jump where the number of crossings changes.
    nominal = requirement.scope is Scope.NOMINAL
    sample = samples.base if nominal or quantity.takes_band else samples.refined
    if nominal:
        value, omega, _ = criterion(sample.nominal_loop)
        return sign * float(value[0]), place_of(sample, sample.nominal_x, float(omega[0]))
    worst = find_worst_case(sample, criterion)
    return sign * worst.value, worst.place(sample)


def _slack(requirement: Requirement, achieved: float) -> float:
    """The distance inside the limit or limits, negative outside; minus the distance for `equals`."""
    above = _distance(requirement, achieved, requirement.lower)
    below = -_distance(requirement, achieved, requirement.upper)
    return min(above, below)


def _distance(requirement: Requirement, achieved: float, limit: float) -> float:
    """achieved - limit in natural units; a delay margin's is relative to its limit."""
    if math.isinf(limit):
        return -math.copysign(math.inf, limit)
    if requirement.quantity == "delay_margin_s":
        return (achieved - limit) / abs(limit)
    quantity = QUANTITIES[requirement.quantity]
    natural = math.copysign(math.inf, achieved) if math.isinf(achieved) else quantity.to_natural(achieved)
    return natural - quantity.to_natural(limit)


def _score(requirement: Requirement, slack: float, tolerance: float) -> float:
    if requirement.relation is Relation.EQUALS:
        return -slack / tolerance
    return math.exp(min(-(slack + tolerance), _LARGEST_EXPONENT))


def _outcome(requirement: Requirement, achieved: float, score: float) -> Outcome:
    if QUANTITIES[requirement.quantity].is_margin and math.isinf(achieved):
        return Outcome.INFINITE
    return Outcome.MET if score <= 1.0 else Outcome.VIOLATED
