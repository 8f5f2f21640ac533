"""Verify gains against a spec in floating point.

Crossings and peaks of each plant are computed exactly by `core/`.  The worst plant is searched for in the whole box of
uncertain numbers, including its interior.
"""

from __future__ import annotations

from dataclasses import replace

from fopi_tune.core.controller import FoPi, refuse_zero_gains
from fopi_tune.core.families.plant_list import PlantList
from fopi_tune.core.margins import margins_of
from fopi_tune.core.measured.family import MeasuredFamily
from fopi_tune.core.parallel_form import Implementation
from fopi_tune.errors import DomainError, UnstableLoopError
from fopi_tune.proof.verification.crossing_changes import SamplePair
from fopi_tune.proof.verification.lists import of_members
from fopi_tune.proof.verification.measured import reassessed, verify_measured
from fopi_tune.proof.verification.objectives import evaluate_objective, smallest_slack
from fopi_tune.proof.verification.requirements import assess_requirement, check_requirement
from fopi_tune.proof.verification.results import MeasureResult, Verification
from fopi_tune.proof.verification.sample import Sample
from fopi_tune.proof.verification.stability import check_stability
from fopi_tune.spec.lists.members import member_specs
from fopi_tune.spec.model import DesignSpec
from fopi_tune.spec.scenarios import frequency_part

#: natural units; a requirement that is missed by less is met
TOLERANCE = 1e-6


def verify(
    spec: DesignSpec, gains: FoPi, tolerance: float = TOLERANCE, implementation: Implementation | None = None
) -> Verification:
    """Check stability, every requirement and the objective.

    Args:
        spec: plant family, requirements and objective; its box of gains is not used.
        gains: the controller.
        tolerance: allowed violation of a requirement, in neper or radian (of a delay margin: relative).
        implementation: the digital controller that approximates the gains; the loop is then the one on its samples,
            up to Nyquist's frequency.  None checks the ideal controller in continuous time.

    Of a list of plants each member is verified, and the worst of all counts.  Measured responses are verified as they
    are interpolated, of the ideal controller.

    Raises:
        UnstableLoopError: some loop is unstable, and turns too often to be searched.
        DomainError: all gains are 0, or a dead time so long that the loop's crossings cannot be listed.
    """
    refuse_zero_gains(gains)
    if isinstance(spec.plant, PlantList):
        return of_members(spec, spec.plant, _verified_members(spec, spec.plant, gains, tolerance, implementation))
    if isinstance(spec.plant, MeasuredFamily):
        return verify_measured(spec, spec.plant, gains, tolerance)
    loop = frequency_part(spec)
    samples = SamplePair(Sample.of(spec.plant, gains, implementation, spec.reference))
    stability = check_stability(samples.base)
    requirements = tuple(
        check_requirement(requirement, samples, stability, tolerance) for requirement in spec.requirements
    )
    measures: tuple[MeasureResult, ...] = ()
    objective, objective_worst = evaluate_objective(loop.objective, samples, requirements)
    if spec.designs_scenarios and implementation is not None:
        # what simulates is loaded for this alone
        from fopi_tune.proof.verification.scenarios import check_scenarios, scenario_objective

        measures = check_scenarios(spec, implementation, tolerance)
        if loop.objective is not spec.objective:
            objective, objective_worst = scenario_objective(spec, implementation)
    return Verification(
        gains=gains,
        stability=stability,
        requirements=requirements,
        objective=objective,
        objective_worst=objective_worst,
        nominal=margins_of(samples.base.nominal_loop),
        tolerance=tolerance,
        measures=measures,
    )


def _verified_members(
    spec: DesignSpec, plants: PlantList, gains: FoPi, tolerance: float, implementation: Implementation | None
) -> list[Verification]:
    """The verification of each member alone; what cannot be checked names its member."""
    found = []
    for own, member in zip(member_specs(spec), plants.members, strict=True):
        try:
            found.append(verify(own, gains, tolerance, implementation))
        except DomainError as error:
            kind = UnstableLoopError if isinstance(error, UnstableLoopError) else DomainError
            raise kind(f"{member.name}: {error}") from None
    return found


def reassess(spec: DesignSpec, found: Verification) -> Verification:
    """Verification of the same gains against a spec that differs only in its requirements' limits.

    The measured extremes do not depend on the limits and are reused.

    Args:
        spec: the same quantities and relations in the same order, with other limits.
        found: verification of the gains.
    """
    if isinstance(spec.plant, PlantList):
        each = zip(member_specs(spec), found.members, strict=True)
        return of_members(spec, spec.plant, [reassess(member, known) for member, known in each])
    if spec.is_measured:
        return reassessed(spec, found)
    pairs = zip(spec.requirements, found.requirements, strict=True)
    requirements = tuple(assess_requirement(requirement, old.extremes, found.tolerance) for requirement, old in pairs)
    measures = found.measures
    if spec.scenario_requirements:
        from fopi_tune.proof.verification.scenarios import with_limit

        limits = zip(spec.scenario_requirements, found.measures, strict=True)
        measures = tuple(with_limit(old, limit, found.tolerance) for limit, old in limits)
    depth = smallest_slack(requirements) if spec.objective is None else None
    objective, place = (found.objective, found.objective_worst) if depth is None else depth
    return replace(found, requirements=requirements, objective=objective, objective_worst=place, measures=measures)
