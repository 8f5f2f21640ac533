"""The shapes of `scenarios:` and `limits:`:  what is simulated, and limits on measures of the simulations."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Collection
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

from fopi_tune.spec.measure_words import requirement_as_measure
from fopi_tune.spec.measures import ACCELERATION, acceleration_problem, velocity_unit
from fopi_tune.spec.model import MEASURES, Knot, Limit, MeasureKind, Relation, ScenarioSpec
from fopi_tune.spec.yaml.advice import Advised, relation_advice
from fopi_tune.spec.yaml.nodes import Place
from fopi_tune.spec.yaml.records import Key, OneKeyOf, Record, Values, with_defaults_of
from fopi_tune.spec.yaml.shapes import Choice, ListOf, Number, Shape, Text

MAX_SCENARIOS, MAX_KNOTS, MAX_SAMPLES = 100, 10_000, 1_000_000
_NAME_PATTERN = "[A-Za-z0-9][A-Za-z0-9._-]{0,63}"
_NAME_RULE = "a scenario's name has 1 to 64 letters, digits, '.', '_' or '-', the first a letter or digit"
_LIMIT_EXAMPLE = "{overshoot: {at_most: 0.1}}"


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


def limit_records(names: Collection[str]) -> dict[str, Shape]:
    """The shapes of measures with their limits, by name; each reads to a `PlacedLimit`."""
    return {name: _limit_record(MEASURES[name]) for name in names}


def _scenario_shape() -> Record:
    knots = ListOf("values from a time on", _knot_shape(), 1, MAX_KNOTS)
    keys = {
        "name": Key(Text("name of the scenario", _NAME_PATTERN, _NAME_RULE)),
        "duration_s": Key(Number("how long it lasts, s", above=0)),
        "reference": Key(knots),
        "load": Key(knots, required=False),
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


def refuse_accelerations(limits: list[PlacedLimit], measurement_unit: str) -> None:
    """Reports limits of the acceleration where the output is no velocity."""
    if velocity_unit(measurement_unit) is None:
        for each in limits:
            if each.limit.measure == ACCELERATION:
                each.place.child(ACCELERATION).refuse(acceleration_problem(measurement_unit))


def refuse_too_many_samples(scenarios: list[ScenarioSpec], sample_time_s: float, place: Place) -> None:
    """Reports scenarios of more than `MAX_SAMPLES` samples."""
    for index, scenario in enumerate(scenarios):
        if scenario.duration_s / sample_time_s > MAX_SAMPLES:
            where = place.child("scenarios").item(index).child("duration_s")
            where.refuse(f"{math.ceil(scenario.duration_s / sample_time_s)} samples are more than {MAX_SAMPLES}")
