"""`parameters:` beside `plants:`: the plants that have the numbers written in each, and its mistakes."""

from __future__ import annotations

import jsonschema
from cases.plant_lists import problems

from fopi_tune.spec import parse_spec
from fopi_tune.spec.digests import digests_of
from fopi_tune.spec.language import json_schema

HEAD = "schema: 1\nname: a\nobjective: {minimize: iae_disturbance}\n"
THROTTLE = "model: transfer_function, numerator: [1.5], denominator: [m, 40], dead_time_s: L"
BRAKE = "model: transfer_function, numerator: [k], denominator: [m, 1e-3]"


def test_two_plants_that_share_a_mass_are_those_with_the_mass_in_each() -> None:
    shared = parse_spec(
        f"{HEAD}parameters: {{m: {{min: 900, max: 1400}}, L: 0.2}}\n"
        f"plants:\n  - {{{THROTTLE}}}\n  - {{parameters: {{k: {{min: 1, max: 2}}}}, {BRAKE}}}\n"
        "  - {model: lag, static_gain: 1, time_constant_s: 2}\n"
    )
    written = parse_spec(
        f"{HEAD}plants:\n  - {{parameters: {{m: {{min: 900, max: 1400}}, L: 0.2}}, {THROTTLE}}}\n"
        f"  - {{parameters: {{m: {{min: 900, max: 1400}}, k: {{min: 1, max: 2}}}}, {BRAKE}}}\n"
        "  - {model: lag, static_gain: 1, time_constant_s: 2}\n"
    )
    assert shared.plant == written.plant
    assert digests_of(shared) == digests_of(written)


def test_all_mistakes_of_shared_parameters_are_reported_once_with_their_places() -> None:
    text = (
        f"{HEAD}parameters: {{m: {{min: 3, max: 2}}, k: 1, u: 5, 2x: 1}}\n"
        f"plants:\n  - {{model: pole, gain: 1, pole_rad_s: m}}\n  - {{parameters: {{k: 2}}, {BRAKE}}}\n"
    )
    assert problems(text) == [
        "s.yaml:4:23: parameters.m.min: min 3.0 is greater than max 2.0; swap them",
        "s.yaml:4:41: parameters.u: is not used in any plant; use it in a coefficient or remove it",
        "s.yaml:4:47: parameters.2x: is no name of a parameter; write a letter, then letters, digits and _, at most "
        "40 in all",
        "s.yaml:7:19: plants[1].parameters.k: is a parameter that all plants may use, from line 4; give one of them "
        "another name",
    ]


def test_an_expression_that_a_shared_parameter_makes_impossible_is_told_where_it_stands() -> None:
    plant = "{model: lag, static_gain: 1, time_constant_s: 1 / m}"
    text = f"{HEAD}parameters: {{m: {{min: -1, max: 2}}}}\nplants:\n  - {plant}\n"
    (said,) = problems(text)
    assert said.startswith("s.yaml:6:")
    assert "plants[0].time_constant_s" in said


def test_shared_parameters_are_for_lists() -> None:
    text = f"{HEAD}parameters: {{m: 1}}\nplant: {{model: lag, static_gain: 1, time_constant_s: 2}}\n"
    assert problems(text) == [
        "s.yaml:4:1: parameters: parameters stand here for the plants of a list; write them inside of plant:"
    ]


def test_the_schema_takes_shared_parameters_beside_plants_alone() -> None:
    validator = jsonschema.Draft202012Validator(json_schema())
    base = {"schema": 1, "name": "a", "objective": {"minimize": "iae_disturbance"}, "parameters": {"m": 2}}
    plants = [{"model": "lag", "static_gain": 1, "time_constant_s": "2 * m"}]
    assert validator.is_valid({**base, "plants": plants})
    assert validator.is_valid({**base, "plants": [{**plants[0], "parameters": {"k": 1}}]})
    assert not validator.is_valid({**base, "plant": {"model": "lag", "static_gain": 1, "time_constant_s": 2}})
    assert not validator.is_valid({**base, "plants": plants, "parameters": {}})
