"""The members of a list of plants as specs of their own:  DesignSpec -> a DesignSpec with one family each.

Requirements hold for every member, so that a list is checked and proved member by member.  What is about the nominal
plant alone belongs to the first member; the others keep it as what spreads are measured from.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from fopi_tune.core.families.plant_list import PlantList
from fopi_tune.core.measured.family import NO_COEFFICIENTS
from fopi_tune.errors import DomainError
from fopi_tune.quantities.objectives import ObjectiveKind, default_horizon_s
from fopi_tune.spec.model import DesignSpec, Objective, Requirement, Scope


def member_specs(spec: DesignSpec) -> tuple[DesignSpec, ...]:
    """A spec of each member of a list of plants; of any other spec, itself.

    The time of `iae_disturbance` is that of the list's nominal plant in all of them.
    """
    if not isinstance(spec.plant, PlantList):
        return (spec,)
    objective = with_horizon(spec)
    return tuple(
        replace(
            spec,
            plant=member.family,
            requirements=tuple(spec.requirements[i] for i in requirements_of(spec.requirements, k)),
            objective=objective,
            reference=None if k == 0 else spec.plant.first,
        )
        for k, member in enumerate(spec.plant.members)
    )


def refuse_list(spec: DesignSpec, what: str) -> None:
    """Refuse a list of plants where this version knows one plant alone.

    Args:
        spec: the spec.
        what: what is asked, as in "the proof of the optimum".

    Raises:
        DomainError: the spec has one.
    """
    if isinstance(spec.plant, PlantList):
        raise DomainError(f"{what} is for one plant in this version, not for a list; write plant: with one of them")


def refuse_measured(spec: DesignSpec, what: str) -> None:
    """Refuse measured responses where a transfer function is needed.

    Args:
        spec: the spec.
        what: what is asked, as in "the proof of the optimum".

    Raises:
        DomainError: the spec has them.
    """
    if spec.is_measured:
        raise DomainError(f"{what}: {NO_COEFFICIENTS}")


def requirements_of(requirements: Sequence[Requirement], member: int) -> tuple[int, ...]:
    """Indices of the requirements that are about a member: those on the nominal plant alone are about the first."""
    return tuple(i for i, each in enumerate(requirements) if member == 0 or each.scope is Scope.FAMILY)


def with_horizon(spec: DesignSpec) -> Objective | None:
    """The spec's objective, with its time where that follows from the nominal plant."""
    objective = spec.objective
    if (
        objective is None
        or objective.quantity != ObjectiveKind.IAE_DISTURBANCE.value
        or objective.horizon_s is not None
    ):
        return objective
    return replace(objective, horizon_s=default_horizon_s(spec.nominal_family))
