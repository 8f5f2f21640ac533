"""The shapes of `scenarios:` and `limits:`, and designs for what scenarios measure.

Requirements and an objective on measures of scenarios are about the loop as it runs: on samples, with its limits.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

from fopi_tune.spec.measure_words import requirement_as_measure
from fopi_tune.spec.measures import ACCELERATION, DESIGNED_MEASURES, NEVER_NEGATIVE, acceleration_problem, velocity_unit
from fopi_tune.spec.model import (
    MEASURES,
    DesignSpec,
    DigitalSpec,
    Knot,
    Limit,
    MeasureKind,
    Objective,
    Relation,
    Requirement,
    ScenarioSpec,
)
from fopi_tune.spec.yaml.advice import Advised, relation_advice
from fopi_tune.spec.yaml.nodes import Place
from fopi_tune.spec.yaml.records import Key, OneKeyOf, Record, Values, with_defaults_of
from fopi_tune.spec.yaml.shapes import Choice, ListOf, Number, Text

MAX_SCENARIOS, MAX_KNOTS, MAX_SAMPLES = 100, 10_000, 1_000_000
_NAME_PATTERN = "[A-Za-z0-9][A-Za-z0-9._-]{0,63}"
_NAME_RULE = "a scenario's name has 1 to 64 letters, digits, '.', '_' or '-', the first a letter or digit"
_LIMIT_EXAMPLE = "{overshoot: {at_most: 0.1}}"
_CONTINUOUS = (
    "requirements and objectives of scenarios are about the loop as it runs; write design: sampled, or leave it out"
)
QUANTUM = (
    "no gains are designed for a quantised measurement, in which every measure jumps; leave quantum out of scenarios "
    "that requirements or the objective are about"
)


@dataclass(frozen=True)
class PlacedLimit:
    """A limit and where it is written."""

    limit: Limit
    place: Place


def scenarios_shape() -> ListOf:
    """Reads to a list of `ScenarioSpec`."""
    return ListOf("what is simulated", _scenario_shape(), 0, MAX_SCENARIOS)


def limits_shape() -> ListOf:
    """Reads to a list of `PlacedLimit`."""
    records = limit_records(MEASURES)
    one = OneKeyOf(
        "one measure of a simulation with its limit", "measure", records, _LIMIT_EXAMPLE, requirement_as_measure
    )
    return ListOf("what simulations are judged by, plant by plant", one, 0, 500)


def limit_records(names: Collection[str]) -> dict[str, Record]:
    """The shapes of measures with their limits, by name; each reads to a `PlacedLimit`."""
    return {name: _limit_record(MEASURES[name]) for name in names}


def _scenario_shape() -> Record:
    knots, load = (ListOf("values from a time on", _knot_shape(), least, MAX_KNOTS) for least in (1, 0))
    keys = {
        "name": Key(Text("name of the scenario", _NAME_PATTERN, _NAME_RULE)),
        "duration_s": Key(Number("how long it lasts, s", above=0)),
        "reference": Key(knots),
        "load": Key(load, required=False),
        "initial_output": Key(Number("output at the start, in its unit"), required=False),
        "before": Key(Choice("what the plant's input was before", ("rest", "free")), required=False),
        "bumpless": Key(Choice("whether the controller starts at that input", ("no", "yes")), required=False),
        "noise_std": Key(
            Number("standard deviation of the measurement's noise", at_least=0, at_most=1e100), required=False
        ),
        "quantum": Key(Number("step of the measurement; 0 for none", at_least=0), required=False),
        "rate_per_s": Key(Number("fastest change of the control, per s", above=0), required=False),
        "settling_band": Key(
            Number("half-width of what counts as settled, output unit; 2 % of each step when left out", above=0), False
        ),
        "judged_from_s": Key(
            Number("from when on it is judged, s; a step that is over by then is none", at_least=0), required=False
        ),
    }
    example = "{name: step, duration_s: 60, reference: [{at_s: 0, value: 1}]}"
    keys = with_defaults_of(ScenarioSpec, keys) | {"bumpless": replace(keys["bumpless"], default="no")}
    return Record("one thing to simulate", keys, _build_scenario, example)


def _knot_shape() -> Record:
    keys = {
        "at_s": Key(Number("time, s", at_least=0)),
        "value": Key(Number("value from then on")),
        "ramp_s": Key(
            Number("time in which it is reached, in a straight line; 0 for a step", at_least=0), required=False
        ),
    }
    return Record(
        "a value from a time on",
        with_defaults_of(Knot, keys),
        lambda values, place: Knot(**values),
        "{at_s: 0, value: 1}",
    )


def _build_scenario(values: Values, place: Place) -> ScenarioSpec | None:
    plain: dict[str, Any] = {
        key: value for key, value in values.items() if key not in ("reference", "load", "bumpless")
    }
    reference, load = tuple(values["reference"]), tuple(values.get("load", ()))
    found = ScenarioSpec(**plain, reference=reference, load=load, bumpless=values.get("bumpless", "no") == "yes")
    valid = True
    for name, knots in (("reference", found.reference), ("load", found.load)):
        for index, (before, after) in enumerate(itertools.pairwise(knots), 1):
            if after.at_s < before.at_s + before.ramp_s or after.at_s == before.at_s:
                where = place.child(name).item(index).child("at_s")
                where.refuse(f"{after.at_s} is not after {before.at_s + before.ramp_s}, where the entry before ends")
                valid = False
        for index, knot in enumerate(knots):
            if knot.at_s >= found.duration_s:
                where = place.child(name).item(index).child("at_s")
                where.refuse(f"{knot.at_s} is not before the end at {found.duration_s}")
                valid = False
    if found.judged_from_s >= found.duration_s:
        place.child("judged_from_s").refuse(f"{found.judged_from_s} is not before the end at {found.duration_s}")
        valid = False
    return found if valid else None


def _limit_record(kind: MeasureKind) -> Record:
    number = Number(f"the limit, {kind.unit}")
    records = {word: _relation_record(kind, word, number) for word in ("at_most", "at_least")}
    relation = Advised(
        OneKeyOf("how the measure relates to its limit", "relation", records, "{at_most: 2.0}"),
        relation_advice(tuple(records)),
    )
    keys = {
        kind.name: Key(relation),
        "scenario": Key(Text("the only scenario it is about"), required=False),
    }
    build: Callable[[Values, Place], Any] = partial(_build_limit, kind)
    return Record(kind.meaning, keys, build, _LIMIT_EXAMPLE)


def _relation_record(kind: MeasureKind, word: str, number: Number) -> Record:
    return Record(
        f"{kind.name} {word.replace('_', ' ')} the limit",
        {word: Key(number)},
        lambda values, place: (Relation(word), values[word]),
        "{at_most: 2.0}",
    )


def _build_limit(kind: MeasureKind, values: Values, place: Place) -> PlacedLimit:
    relation, limit = values[kind.name]
    return PlacedLimit(Limit(kind.name, relation, float(limit), values.get("scenario"), place.mark.line), place)


def refuse_unknown_scenarios(scenarios: list[ScenarioSpec], limits: list[PlacedLimit], place: Place) -> None:
    """Reports limits on unknown scenarios, limits without any scenario, and duplicate names."""
    names = [scenario.name for scenario in scenarios]
    for index, name in enumerate(names):
        if name in names[:index]:
            place.child("scenarios").item(index).child("name").refuse(f"{name} is the name of an earlier scenario too")
    for each in limits:
        scenario_name = each.limit.scenario
        if scenario_name is not None and scenario_name not in names:
            known = f"; there is {', '.join(names[:20])}" if names else "; there is none"
            each.place.child("scenario").refuse(f"no scenario has this name{known}")
        elif not names:
            each.place.refuse("there is no scenario to judge by it; add one under scenarios")


def refuse_impossible_limits(limits: Sequence[PlacedLimit]) -> None:
    """Reports every requirement on a measure that nothing meets, alone or with an earlier one in a scenario of both."""
    for number, later in enumerate(limits):
        limit, place = later.limit, _in_words(later)[1]
        if limit.relation is Relation.AT_MOST and limit.limit < 0.0 and limit.measure in NEVER_NEGATIVE:
            place.refuse(f"{limit.limit:g} is never met, {limit.measure} is not negative; write a limit of 0 or more")
            continue
        earlier = next((each for each in limits[:number] if _contradict(each.limit, later.limit)), None)
        if earlier is not None:
            (here, where), (there, _) = _in_words(later), _in_words(earlier)
            lines = where.mark.line, earlier.place.mark.line
            where.refuse(f"{here} on line {lines[0]} contradicts {there} on line {lines[1]}; relax one")


def _contradict(a: Limit, b: Limit) -> bool:
    if a.measure != b.measure or a.relation is b.relation:
        return False
    most, least = (a, b) if a.relation is Relation.AT_MOST else (b, a)
    # every plant of the family has to keep both, in each scenario that both are about
    return most.limit < least.limit and (a.scenario == b.scenario or None in (a.scenario, b.scenario))


def _in_words(placed: PlacedLimit) -> tuple[str, Place]:
    limit = placed.limit
    return f"{limit.relation.value} {limit.limit:g}", placed.place.child(limit.measure).child(limit.relation.value)


def refuse_accelerations(limits: list[PlacedLimit], measurement_unit: str) -> None:
    """Reports limits of the acceleration where the output is no velocity."""
    if velocity_unit(measurement_unit) is None:
        for each in limits:
            if each.limit.measure == ACCELERATION:
                each.place.child(ACCELERATION).refuse(acceleration_problem(measurement_unit))


def refuse_too_many_samples(scenarios: list[ScenarioSpec], sample_time_s: float, place: Place) -> None:
    """Reports scenarios of more than `MAX_SAMPLES` samples."""
    for index, scenario in enumerate(scenarios):
        samples = scenario.duration_s / sample_time_s
        if samples > MAX_SAMPLES:
            where = place.child("scenarios").item(index).child("duration_s")
            where.refuse(f"{math.ceil(samples) if samples < 1e15 else samples} samples are more than {MAX_SAMPLES}")


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
        objective = with_scenario(objective, scenarios, place.child("objective"))
        found["objective"] = objective
        names.add(objective.scenario)
        if objective.quantity == ACCELERATION and digital and velocity_unit(digital.measurement_unit) is None:
            place.child("objective").child("minimize").refuse(acceleration_problem(digital.measurement_unit))
    for index, scenario in enumerate(scenarios):
        if scenario.quantum and (None in names or scenario.name in names):
            place.child("scenarios").item(index).child("quantum").refuse(QUANTUM)
    if digital is not None:
        if place.child("digital").has("design") and not digital.designs_sampled:
            place.child("digital").child("design").refuse(_CONTINUOUS)
        found["digital"] = replace(digital, design="sampled")
    return found


def with_scenario(objective: Objective, scenarios: Sequence[ScenarioSpec], place: Place) -> Objective:
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
