"""Design of the loop on samples, `design: sampled`, through a continuous stand-in:  DesignSpec -> CheckedCandidate.

The requirements are then about the loop with the real filter, the hold and the delays.  It is designed on a stand-in,
the continuous loop with half a sample and the computing delay as dead time, whose limits are moved by what the stand-in
was found to be off:

    limit' = limit + (value of the stand-in - value of the loop on samples) ,                                      (1)

at the gains of the round before, until the loop on samples meets the limits themselves.  What decides is always the
verification of that loop; the stand-in has no say in it.

Source: derived; where the stand-in is at limit', the loop on samples is at the limit itself.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from fopi_tune.core.controller import FoPi
from fopi_tune.core.parallel_form import Implementation
from fopi_tune.core.plant import PlantFamily, Uncertain
from fopi_tune.digital.implementation import digital_section_of, implementation_of
from fopi_tune.proof import Verification, certify, verify
from fopi_tune.quantities import QUANTITIES
from fopi_tune.quantities.objectives import ObjectiveKind
from fopi_tune.results.candidate import CheckedCandidate
from fopi_tune.results.stamp import certificate_versions
from fopi_tune.results.status import Relaxation, Status
from fopi_tune.spec.model import DesignSpec, Requirement

if TYPE_CHECKING:
    from fopi_tune.results.candidate import Candidate

_MOST_ROUNDS = 12
#: natural units; limits that move by less from one round to the next have settled
_SETTLED = 1e-4
#: relative; a round whose objective is worse than the last one's by more may have met another optimum
_WORSE = 0.02
#: (requirement, upper side) -> by how much its limit is moved, natural units
Shifts = Mapping[tuple[int, bool], float]


@dataclass(frozen=True)
class _Round:
    """A candidate of the stand-in, the controller that runs, and what is true of the loop with it."""

    candidate: Candidate
    gains: FoPi
    implementation: Implementation
    found: Verification


def sampled_attempt(spec: DesignSpec, proof: bool) -> CheckedCandidate:
    """Gains whose loop on samples meets the spec.

    Args:
        spec: with `design: sampled`.
        proof: whether to certify them.

    Returns:
        The last candidate whose loop meets the spec, with the best objective among such; else the last one.

    Raises:
        DomainError: the digital controller cannot be made.
    """
    shifts: Shifts = {}
    best: _Round | None = None
    last: _Round | None = None
    for _ in range(_MOST_ROUNDS):
        tried = _tried(spec, shifts, last)
        if not isinstance(tried, _Round):
            if best is None:
                return CheckedCandidate(_unmoved(spec, tried, shifts), _found(spec, tried.gains))
            break
        last = tried
        if tried.found.all_met and (best is None or not _is_worse(spec, tried.found, best.found, 0.0)):
            best = tried
        moved = moved_further(spec, tried.gains, tried.found, shifts)
        change = max((abs(moved[key] - shifts.get(key, 0.0)) for key in moved), default=0.0)
        if tried.found.all_met and change <= _SETTLED:
            break
        shifts = moved
    chosen = best or last
    assert chosen is not None  # the first round ended in a round or above
    if not proof or not chosen.found.all_met:
        return CheckedCandidate(chosen.candidate, chosen.found)
    certificate = certify(spec, chosen.found, certificate_versions(), chosen.implementation)
    return CheckedCandidate(chosen.candidate, chosen.found, certificate)


def _tried(spec: DesignSpec, shifts: Shifts, last: _Round | None) -> _Round | Candidate:
    """One round, from the last gains, and from everywhere when that ends worse; or a candidate that is no answer."""
    from fopi_tune.design import design  # loads CasADi

    model = stand_in(spec, shifts)
    candidate = design(model, (), last.gains if last is not None else None)
    tried = _checked(spec, candidate)
    if last is None or not isinstance(tried, _Round) or not _is_worse(spec, tried.found, last.found, _WORSE):
        return tried
    again = _checked(spec, design(model))
    return again if isinstance(again, _Round) and _is_worse(spec, tried.found, again.found, 0.0) else tried


def _checked(spec: DesignSpec, candidate: Candidate) -> _Round | Candidate:
    gains = candidate.gains
    if candidate.status is not Status.SOLVED or gains is None or (gains.kp == 0.0 and gains.ki == 0.0):
        return candidate
    implementation = implementation_of(spec, gains)
    return _Round(candidate, gains, implementation, verify(spec, gains, implementation=implementation))


def _found(spec: DesignSpec, gains: FoPi | None) -> Verification | None:
    """What is true of gains that are no solution."""
    if gains is None or (gains.kp == 0.0 and gains.ki == 0.0):
        return None
    return verify(spec, gains, implementation=implementation_of(spec, gains))


def _is_worse(spec: DesignSpec, one: Verification, other: Verification, by: float) -> bool:
    """Whether one objective is worse than another by more than this part of it."""
    if one.objective is None or other.objective is None:
        return one.objective is None and other.objective is not None
    largest = spec.objective is None or spec.objective.quantity == ObjectiveKind.KI
    loss = other.objective - one.objective if largest else one.objective - other.objective
    return loss > by * abs(other.objective)


def _unmoved(spec: DesignSpec, candidate: Candidate, shifts: Shifts) -> Candidate:
    """What a candidate says, about the limits of the spec instead of those of the stand-in."""
    clash = []
    for give in candidate.clash:
        requirement = spec.requirements[give.requirement]
        quantity, limit = QUANTITIES[requirement.quantity], give.new_limit
        upper = math.isfinite(requirement.upper)
        if limit is not None:
            limit = quantity.from_natural(quantity.to_natural(limit) - shifts.get((give.requirement, upper), 0.0))
        clash.append(Relaxation(give.requirement, give.amount, limit))
    if not candidate.message:
        return replace(candidate, clash=tuple(clash))
    message = f"with the hold and the computing delay as half a sample and more of dead time, {candidate.message}"
    return replace(candidate, clash=tuple(clash), message=message)


def stand_in(spec: DesignSpec, shifts: Shifts) -> DesignSpec:
    """The continuous spec whose solution is tried on samples: dead time for hold and delay, limits moved by (1)."""
    digital = digital_section_of(spec)
    late_s = (0.5 + digital.delay_samples) * digital.sample_time_s
    parameters = dict(spec.plant.parameters)
    dead_time = parameters.get("dead_time_s", Uncertain.exactly(0.0))
    parameters["dead_time_s"] = Uncertain(dead_time.nominal + late_s, dead_time.min + late_s, dead_time.max + late_s)
    requirements = tuple(_moved(requirement, i, shifts) for i, requirement in enumerate(spec.requirements))
    return replace(spec, plant=PlantFamily(spec.plant.model, parameters), requirements=requirements)


def _moved(requirement: Requirement, index: int, shifts: Shifts) -> Requirement:
    quantity = QUANTITIES[requirement.quantity]
    sides = {True: (True,), False: (False,)} if len(requirement.limits) == 2 else {}
    limits = []
    for position, limit in enumerate(requirement.limits):
        upper = position == 1 if sides else requirement.upper == limit and math.isfinite(requirement.upper)
        moved = quantity.from_natural(quantity.to_natural(limit) + shifts.get((index, upper), 0.0))
        # a limit that a quantity cannot have is left where it was
        limits.append(limit if quantity.check_limit(moved) is not None else moved)
    if len(limits) == 2 and not limits[0] < limits[1]:
        limits = list(requirement.limits)
    return replace(requirement, limits=tuple(limits))


def moved_further(spec: DesignSpec, gains: FoPi, found: Verification, shifts: Shifts) -> Shifts:
    """(1) at these gains; a side whose value is infinite in one of the loops stays as it was.

    Args:
        spec: with the limits as they are.
        gains: of the last round.
        found: of the loop on samples with them.
        shifts: of the last round.
    """
    model = verify(stand_in(spec, {}), gains)
    new = dict(shifts)
    for i, (ours, theirs) in enumerate(zip(found.requirements, model.requirements, strict=True)):
        quantity = QUANTITIES[ours.requirement.quantity]
        for real, modelled in zip(ours.extremes, theirs.extremes, strict=False):
            values = (modelled.achieved, real.achieved)
            if all(value is not None and math.isfinite(value) for value in values):
                new[i, real.largest] = quantity.to_natural(values[0] or 0.0) - quantity.to_natural(values[1] or 0.0)
    return new
