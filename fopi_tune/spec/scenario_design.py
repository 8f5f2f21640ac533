"""Designs for what scenarios measure:  the rules between requirements, objective, scenarios and digital controller."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from fopi_tune.spec.measures import ACCELERATION, DESIGNED_MEASURES, acceleration_problem, velocity_unit
from fopi_tune.spec.model import DesignSpec, DigitalSpec, Limit, Objective, Requirement, ScenarioSpec
from fopi_tune.spec.scenarios import PlacedLimit
from fopi_tune.spec.yaml.nodes import Place
from fopi_tune.spec.yaml.records import Values

_CONTINUOUS = (
    "requirements and objectives of scenarios are about the loop as it runs; write design: sampled, or leave it out"
)
_QUANTUM = (
    "no gains are designed for a quantised measurement, in which every measure jumps; leave quantum out of scenarios "
    "that requirements or the objective are about"
)


def frequency_part(spec: DesignSpec) -> DesignSpec:
    """The spec without what scenarios measure: its requirements and objective on the loop's frequency response."""
    if not spec.designs_scenarios:
        return spec
    by_scenario = spec.objective is not None and spec.objective.scenario is not None
    return replace(spec, objective=None if by_scenario else spec.objective, scenario_requirements=())


def every_requirement(spec: DesignSpec) -> tuple[Requirement | Limit, ...]:
    """The requirements on the loop's frequency response, then those on measures of scenarios."""
    return (*spec.requirements, *spec.scenario_requirements)


def designed_scenarios(spec: DesignSpec) -> tuple[ScenarioSpec, ...]:
    """The scenarios that requirements or the objective are about, in the order of the spec."""
    names = {limit.scenario for limit in spec.scenario_requirements}
    names |= {spec.objective.scenario} if spec.objective is not None and spec.objective.scenario is not None else set()
    return tuple(each for each in spec.scenarios if None in names or each.name in names)


def check_scenario_design(values: Values, measured: Sequence[PlacedLimit], place: Place) -> Values:
    """The sections that such a design changes, after reporting what contradicts it.

    Args:
        values: of all sections.
        measured: the requirements on measures of scenarios.
        place: of the whole spec.

    Returns:
        The objective with the name of its scenario, and the digital controller on samples; nothing where no scenario
        is designed for.
    """
    objective: Objective | None = values.get("objective")
    scenarios: list[ScenarioSpec] = values.get("scenarios") or []
    digital: DigitalSpec | None = values.get("digital")
    of_objective = objective is not None and objective.quantity in DESIGNED_MEASURES
    if (not measured and not of_objective) or (place.has("scenarios") and not scenarios):
        return {}
    found: Values = {}
    names = {each.limit.scenario for each in measured}
    if objective is not None and of_objective:
        objective = _with_scenario(objective, scenarios, place.child("objective"))
        found["objective"] = objective
        names.add(objective.scenario)
        if objective.quantity == ACCELERATION and digital and velocity_unit(digital.measurement_unit) is None:
            place.child("objective").child("minimize").refuse(acceleration_problem(digital.measurement_unit))
    for index, scenario in enumerate(scenarios):
        if scenario.quantum and (None in names or scenario.name in names):
            place.child("scenarios").item(index).child("quantum").refuse(_QUANTUM)
    if digital is not None:
        if place.child("digital").has("design") and not digital.designs_sampled:
            place.child("digital").child("design").refuse(_CONTINUOUS)
        found["digital"] = replace(digital, design="sampled")
    return found


def _with_scenario(objective: Objective, scenarios: Sequence[ScenarioSpec], place: Place) -> Objective:
    """The objective with its scenario: the only one where the spec names none."""
    names = [each.name for each in scenarios]
    if objective.scenario is None and len(names) == 1:
        return replace(objective, scenario=names[0])
    known = ", ".join(names[:20])
    if not names:
        place.refuse(f"{objective.quantity} is measured in a scenario and there is none; add one under scenarios")
    elif objective.scenario is None:
        place.refuse(f"{objective.quantity} of which scenario? add scenario: {names[0]} (there is {known})")
    elif objective.scenario not in names:
        place.child("scenario").refuse(f"no scenario has this name; there is {known}")
    return objective
