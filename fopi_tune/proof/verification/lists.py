"""The verification of a list of plants:  those of its members -> one, in which the worst member decides."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

from fopi_tune.core.families.plant_list import PlantList
from fopi_tune.proof.verification.objectives import smallest_slack
from fopi_tune.proof.verification.requirements import assess_requirement
from fopi_tune.proof.verification.results import Extreme, Outcome, Place, RequirementResult, Stability, Verification
from fopi_tune.quantities import QUANTITIES
from fopi_tune.quantities.objectives import ObjectiveKind
from fopi_tune.spec.lists.members import requirements_of
from fopi_tune.spec.model import DesignSpec, Requirement, Scope


def of_members(spec: DesignSpec, plants: PlantList, members: Sequence[Verification]) -> Verification:
    """The verification of a list from those of its members' specs.

    Args:
        spec: with the list.
        plants: the list.
        members: of `spec.lists.members.member_specs`, in order.
    """
    first = members[0]
    found = [_at_members(plants, k, each) for k, each in enumerate(members)]
    stability = _stability(found)
    requirements = tuple(
        _requirement(spec, index, requirement, found, stability) for index, requirement in enumerate(spec.requirements)
    )
    objective, place = _objective(spec, found, requirements)
    return replace(
        first,
        stability=stability,
        requirements=requirements,
        objective=objective,
        objective_worst=place,
        members=tuple(members),
    )


def place_in_list(plants: PlantList, member: int, place: Place) -> Place:
    """A place of a member's box as one of the list."""
    return replace(place, point=(float(member), *place.point), member=plants.members[member].name)


def _at_members(plants: PlantList, k: int, found: Verification) -> Verification:
    """A member's verification with its places in the list."""

    def moved(place: Place) -> Place:
        return place_in_list(plants, k, place)

    requirements = tuple(
        replace(
            result,
            worst=moved(result.worst),
            extremes=tuple(replace(extreme, worst=moved(extreme.worst)) for extreme in result.extremes),
        )
        for result in found.requirements
    )
    return replace(
        found,
        stability=replace(found.stability, worst=moved(found.stability.worst)),
        requirements=requirements,
        objective_worst=None if found.objective_worst is None else moved(found.objective_worst),
    )


def _stability(found: Sequence[Verification]) -> Stability:
    """Of the first member that is not stable, else of the one that comes closest to -1."""
    unstable = next((each.stability for each in found if not each.stability.stable), None)
    return unstable or max((each.stability for each in found), key=lambda each: each.peak_sensitivity_db)


def _requirement(
    spec: DesignSpec, index: int, requirement: Requirement, found: Sequence[Verification], stability: Stability
) -> RequirementResult:
    """The worst over the members that a requirement is about."""
    results = [
        each.requirements[requirements_of(spec.requirements, k).index(index)]
        for k, each in enumerate(found)
        if k == 0 or requirement.scope is Scope.FAMILY
    ]
    if len(results) == 1 or results[0].outcome is Outcome.BEYOND_NYQUIST:
        return results[0]
    sides = zip(*(result.extremes for result in results), strict=True)
    extremes = tuple(_worst_extreme(side) for side in sides)
    if not stability.stable and QUANTITIES[requirement.quantity].is_margin:
        # what has a margin is not decided member by member: a family with an unstable plant has none
        extremes = tuple(Extreme(each.largest, None, replace(stability.worst, omega_rad_s=None)) for each in extremes)
    return assess_requirement(requirement, extremes, found[0].tolerance)


def _worst_extreme(side: Sequence[Extreme]) -> Extreme:
    """The first without a value, else the one with the largest value, or the smallest."""
    sign = 1.0 if side[0].largest else -1.0
    missing = next((each for each in side if each.achieved is None), None)
    return missing or max(side, key=lambda each: sign * (each.achieved or 0.0))


def _objective(
    spec: DesignSpec, found: Sequence[Verification], requirements: tuple[RequirementResult, ...]
) -> tuple[float | None, Place | None]:
    """The worst value over the members; without an objective the smallest slack of all requirements."""
    if spec.objective is None and (depth := smallest_slack(requirements)) is not None:
        return depth
    if spec.objective is not None and spec.objective.quantity == ObjectiveKind.KI.value:
        return found[0].objective, found[0].objective_worst
    missing = next((each for each in found if each.objective is None), None)
    if missing is not None:
        return None, missing.objective_worst
    # what is minimised is worst where it is largest; -ln of the largest |S|, of no requirement, where it is smallest
    sign = -1.0 if spec.objective is None else 1.0
    worst = max(found, key=lambda each: sign * (-math.inf if each.objective is None else each.objective))
    return worst.objective, worst.objective_worst
