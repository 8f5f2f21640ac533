"""The JSON Schema of the spec language agrees with the parser."""

from __future__ import annotations

import copy
import dataclasses
import json
from pathlib import Path
from typing import Any

import jsonschema
import pytest
from cases.project import ROOT
from hypothesis import given, settings
from hypothesis import strategies as st
from ruamel.yaml import YAML

from fopi_tune.core.plant import PLANT_MODELS
from fopi_tune.errors import SpecError
from fopi_tune.quantities import QUANTITIES
from fopi_tune.quantities.objectives import OBJECTIVES
from fopi_tune.spec import parse_spec
from fopi_tune.spec.language import json_schema
from fopi_tune.spec.templates.template import template
from fopi_tune.spec.yaml.scalars import SMALLEST

SPECS = sorted((ROOT / "specs").glob("*.yaml"))
SCHEMA = json_schema()
VALIDATOR = jsonschema.Draft202012Validator(SCHEMA)
BASE: dict[str, Any] = {
    "schema": 1,
    "name": "a",
    "plant": {"model": "lag", "static_gain": 1.0, "time_constant_s": {"min": 1.0, "max": 2.0}},
    "requirements": [{"phase_margin_deg": {"at_least": 60}}],
}


def yaml_of(document: Any) -> str:
    # JSON is YAML 1.2, but for numbers like Infinity, which are not generated here
    return json.dumps(document)


def parses(document: Any) -> bool:
    try:
        parse_spec(yaml_of(document))
    except SpecError:
        return False
    return True


def test_the_schema_is_a_valid_schema_of_its_draft() -> None:
    jsonschema.Draft202012Validator.check_schema(SCHEMA)
    assert SCHEMA["$schema"] == "https://json-schema.org/draft/2020-12/schema"
    assert json.loads(json.dumps(SCHEMA)) == SCHEMA


def with_defaults(schema: dict[str, Any], document: dict[str, Any]) -> tuple[dict[str, Any], int]:
    """A mapping with what the schema says of its left-out keys written down, and how many those are."""
    found = {
        key: value["default"]
        for key, value in schema["properties"].items()
        if "default" in value and key not in document
    }
    return {**found, **document}, len(found)


def test_a_default_that_the_schema_states_is_what_holds_when_the_key_is_left_out() -> None:
    sections: dict[str, Any] = {
        "controller": {},
        "digital": {"sample_time_s": 0.2},
        "validation": {},
        "scenarios": [{"name": "step", "duration_s": 9.0, "reference": [{"at_s": 0, "value": 1}]}],
    }
    short = BASE | sections
    keys = SCHEMA["properties"]
    scenario = keys["scenarios"]["items"]
    written = {name: with_defaults(keys[name], sections[name]) for name in ("controller", "digital", "validation")}
    step, step_count = with_defaults(scenario, sections["scenarios"][0])
    knot, knot_count = with_defaults(scenario["properties"]["reference"]["items"], {"at_s": 0, "value": 1})
    plant, plant_count = with_defaults(keys["plant"]["oneOf"][0], BASE["plant"])
    margin = next(r for r in keys["requirements"]["items"]["oneOf"] if "phase_margin_deg" in r["properties"])
    requirement, requirement_count = with_defaults(margin, BASE["requirements"][0])
    long = {
        **BASE,
        **{name: section for name, (section, _) in written.items()},
        "plant": plant,
        "requirements": [requirement],
        "scenarios": [step | {"reference": [knot]}],
    }
    counts = [count for _, count in written.values()]
    # structure, alpha and the setpoint's weight; seven of the filter; four of the draws
    assert [*counts, step_count, knot_count, plant_count, requirement_count] == [3, 7, 4, 6, 1, 1, 1]
    assert VALIDATOR.is_valid(long)
    said, left_out = parse_spec(yaml_of(long)), parse_spec(yaml_of(short))
    assert dataclasses.replace(said, text_sha256="") == dataclasses.replace(left_out, text_sha256="")


def test_every_object_is_closed_and_every_key_described() -> None:
    def visit(schema: Any) -> None:
        if isinstance(schema, list):
            for item in schema:
                visit(item)
        elif isinstance(schema, dict):
            if schema.get("type") == "object":
                assert schema["additionalProperties"] is False
                # a union of mappings is described as a whole, and so is each of its kinds
                assert all(key.get("description") or "anyOf" in key for key in schema["properties"].values())
            for value in schema.values():
                visit(value)

    visit(SCHEMA)


def test_the_schema_names_everything_in_the_registries() -> None:
    text = json.dumps(SCHEMA)
    words = (word for words in OBJECTIVES.values() for word in words)
    assert all(f'"{name}"' in text for name in (*PLANT_MODELS, *QUANTITIES, *words))


@pytest.mark.parametrize("path", SPECS, ids=lambda path: path.stem)
def test_every_shipped_spec_is_valid(path: Path) -> None:
    VALIDATOR.validate(YAML(typ="safe", pure=True).load(path.read_text(encoding="utf-8")))


def test_the_template_is_valid() -> None:
    VALIDATOR.validate(YAML(typ="safe", pure=True).load(template("a")))


# where, and what is put there; None removes the key
MISTAKES: list[tuple[tuple[str | int, ...], Any]] = [
    (("schema",), 2),
    (("schema",), None),
    (("name",), "../x"),
    (("name",), 5),
    (("extra",), 1),
    (("plant",), None),
    (("plant",), []),
    (("plant", "model"), "lagg"),
    (("plant", "model"), None),
    (("plant", "gain"), 1),
    (("plant", "static_gain"), None),
    (("plant", "static_gain"), "1.0"),
    (("plant", "static_gain"), True),
    (("plant", "time_constant_s"), {"min": 1}),
    (("plant", "time_constant_s"), {"min": 1, "max": 2, "mean": 1.5}),
    (("plant",), {"model": "transfer_function", "numerator": [], "denominator": [1]}),
    (("plant",), {"model": "transfer_function", "numerator": [1], "denominator": [1] * 33}),
    (("controller",), {"kp": "1"}),
    (("controller",), {"structure": "pid"}),
    (("controller",), {"structure": "fopid", "mu": 0.5}),
    (("controller",), {"structure": "fopid", "mu": 1.2, "derivative_filter_time_constant_s": 1}),
    (("controller",), {"structure": "fopid", "mu": {"max": 1.2}, "derivative_filter_time_constant_s": 1}),
    (("controller",), {"structure": "fopid", "mu": {"min": 0}, "derivative_filter_time_constant_s": 1}),
    (("controller",), {"structure": "pid", "mu": 0.5, "derivative_filter_time_constant_s": 1}),
    (("controller",), {"mu": 0.5}),
    (("controller",), {"structure": "pi", "alpha": 0.8}),
    (("controller",), {"structure": "pi", "alpha": {"min": 0.8, "max": 1}}),
    (("digital",), {"sample_time_s": 0.2, "output_rate_per_s": 0}),
    (("digital",), {"sample_time_s": 0.2, "output_rate_per_s": None}),
    (("controller",), {"alpha": 2}),
    (("controller",), {"alpha": {"min": 0}}),
    (("controller",), {"kd": 1}),
    (("controller",), {"setpoint_weight": {"min": 0, "max": 1, "nominal": 0.5}}),
    (("controller",), {"measurement_filter": {"order": 3, "time_constant_s": 1}}),
    (("controller",), {"measurement_filter": {"order": 1, "time_constant_s": {"min": 1, "nominal": 2}}}),
    (("controller",), {"measurement_filter": {"time_constant_s": 1}}),
    (("requirements",), []),
    (("requirements",), None),
    (("requirements",), {}),
    (("requirements", 0), {}),
    (("requirements", 0), {"on": "nominal"}),
    (("requirements", 0, "on"), "nominl"),
    (("requirements", 0, "at_rad_s"), 1),
    (("requirements", 0, "gain_margin_db"), {"at_least": 1}),
    (("requirements", 0, "phase_margin_deg"), 60),
    (("requirements", 0, "phase_margin_deg"), {}),
    (("requirements", 0, "phase_margin_deg"), {"at_least": 60, "at_most": 70}),
    (("requirements", 0, "phase_margin_deg"), {"between": [60]}),
    (("requirements", 0), {"sensitivity_db": {"at_most": 6}, "at_rad_s": 1, "to_rad_s": 2}),
    (("requirements", 0), {"sensitivity_db": {"at_most": 6}, "from_rad_s": 0}),
    (("requirements", 0), {"sensitivity_db": {"equals": 6}, "on": "nominal"}),
    (("objective",), {}),
    (("objective",), {"maximize": "kp"}),
    (("objective",), {"maximize": "ki", "minimize": "iae_disturbance"}),
    (("objective",), {"minimize": "sensitivity_peak_db", "horizon_s": 1}),
    (("objective",), {"minimize": "iae_disturbance", "horizon_s": 0}),
    (("digital",), {}),
    (("digital",), {"sample_time_s": 0}),
    (("digital",), {"sample_time_s": 1, "poles": 51}),
    (("digital",), {"sample_time_s": 1, "poles": 1.5}),
    (("digital",), {"sample_time_s": 1, "rule": "euler"}),
    (("digital",), {"sample_time_s": 1, "band_rad_s": [0, 1]}),
    (("digital",), {"sample_time_s": 1, "delay_samples": -1}),
    (("validation",), {"samples": 0}),
    (("validation",), {"seed": 2**63}),
    (("validation",), {"distributions": "uniform"}),
    (("validation",), {"distributions": {"tau-1": "uniform"}}),
    (("validation",), {"distributions": {"numerator[01]": "uniform"}}),
    (("validation",), {"distributions": {"time_constant_s": "normal"}}),
    (("validation",), {"distributions": {"time_constant_s": {}}}),
    (("validation",), {"distributions": {"time_constant_s": {"uniform": {}}}}),
    (("validation",), {"distributions": {"time_constant_s": {"beta": {"a": 1}}}}),
    (("validation",), {"distributions": {"time_constant_s": {"beta": {"a": 1, "b": 0}}}}),
    (("validation",), {"distributions": {"time_constant_s": {"truncated_normal": {"mean": 1, "std": 0}}}}),
    (
        ("validation",),
        {"distributions": {"time_constant_s": {"truncated_normal": {"mean": 1, "std": 1, "clip": [1, 2]}}}},
    ),
    (("validation",), {"distributions": {"time_constant_s": {"normal": {"mean": 1, "std": 1, "clip": [1]}}}}),
    (("validation",), {"distributions": {"time_constant_s": {"nominal_plus_noise": {"mean": 1}}}}),
    (("validation",), {"distributions": {"time_constant_s": {"nominal_plus_noise": {"shape": "normal", "mean": 1}}}}),
    (("validation",), {"distributions": {"time_constant_s": {"nominal_plus_noise": {"shape": "uniform", "mean": 0}}}}),
    (
        ("validation",),
        {"distributions": {"time_constant_s": {"nominal_plus_noise": {"shape": "uniform", "mean": 0.0}}}},
    ),
    (("validation",), {"samples_file": ""}),
    (("validation",), {"samples_file": 1}),
    (("validation",), {"samples_file": "f.csv", "design": "sobol"}),
    (("validation",), {"samples_file": "f.csv", "distributions": {}}),
]


@pytest.mark.parametrize(("where", "value"), MISTAKES, ids=str)
def test_schema_and_parser_refuse_the_same_mistakes(where: tuple[str | int, ...], value: Any) -> None:
    document: Any = copy.deepcopy(BASE)
    assert VALIDATOR.is_valid(document)
    assert parses(document)
    *parents, last = where
    holder = document
    for key in parents:
        holder = holder[key]
    if value is None:
        del holder[last]
    else:
        holder[last] = value
    assert not VALIDATOR.is_valid(document)
    assert not parses(document)


def test_a_file_of_samples_is_valid_where_it_is_given() -> None:
    document = BASE | {"validation": {"samples_file": "f.csv", "samples": 1, "confidence": 0.9}}
    VALIDATOR.validate(document)
    found = parse_spec(yaml_of(document), files={"f.csv": b"time_constant_s\n1\n2\n"}).validation
    assert found is not None
    assert found.samples == 1


def _with_some(required: dict[str, Any], optional: dict[str, Any]) -> st.SearchStrategy[dict[str, Any]]:
    return st.fixed_dictionaries(required, optional=optional)


def _floats(low: float, high: float) -> st.SearchStrategy[float]:
    """Numbers that can be computed with: a schema does not see those that are too close to 0."""
    return st.floats(low, high).filter(lambda x: x == 0.0 or abs(x) >= SMALLEST)


# ends are drawn apart so that few specs are refused for reasons that a schema cannot see; some still are
NUMBER = _floats(-100, 100) | st.integers(-100, 100)
POSITIVE = st.floats(0.01, 100) | st.integers(1, 100)
RANGE = _with_some({"min": st.floats(1, 2), "max": st.floats(3, 4)}, {"nominal": st.floats(2, 3)})
UNCERTAIN = POSITIVE | RANGE
COEFFICIENTS = st.lists(UNCERTAIN, min_size=1, max_size=4)
PLANT = st.one_of(
    _with_some(
        {"model": st.just("lag"), "static_gain": UNCERTAIN, "time_constant_s": UNCERTAIN}, {"dead_time_s": POSITIVE}
    ),
    _with_some({"model": st.just("pole"), "gain": UNCERTAIN, "pole_rad_s": UNCERTAIN}, {"dead_time_s": RANGE}),
    _with_some(
        {"model": st.just("transfer_function"), "numerator": COEFFICIENTS, "denominator": COEFFICIENTS},
        {"dead_time_s": UNCERTAIN},
    ),
)
GAIN = NUMBER | _with_some({}, {"min": _floats(-5, 0), "max": st.floats(1, 5)})
ALPHA = st.floats(0.01, 1.99) | _with_some({}, {"min": st.floats(0.01, 1), "max": st.floats(1, 1.99)})
FILTER = st.fixed_dictionaries({"order": st.integers(1, 2), "time_constant_s": POSITIVE})
CONTROLLER = _with_some(
    {}, {"structure": st.just("fopi"), "kp": GAIN, "ki": GAIN, "alpha": ALPHA, "measurement_filter": FILTER}
) | _with_some(
    {"structure": st.just("pi")}, {"kp": GAIN, "ki": GAIN, "alpha": st.sampled_from([1, {"min": 1, "max": 1}])}
)
MU = st.floats(0.01, 1.0) | _with_some({}, {"min": st.floats(0.01, 0.9), "max": st.floats(0.9, 1.0)})
CONTROLLER |= _with_some(
    {"structure": st.just("fopid"), "derivative_filter_time_constant_s": POSITIVE},
    {"kd": GAIN, "alpha": ALPHA, "mu": MU},
)
RELATION = st.one_of(
    st.fixed_dictionaries({"at_least": POSITIVE}),
    st.fixed_dictionaries({"at_most": POSITIVE}),
    st.fixed_dictionaries({"equals": POSITIVE}),
    st.fixed_dictionaries({"between": st.tuples(st.floats(1, 2), st.floats(3, 4)).map(list)}),
)
BAND = {"from_rad_s": st.floats(0.1, 1), "to_rad_s": st.floats(2, 3), "at_rad_s": st.floats(1, 2)}
REQUIREMENT = st.sampled_from(sorted(QUANTITIES)).flatmap(
    lambda name: _with_some(
        {name: RELATION}, {"on": st.sampled_from(["family", "nominal"])} | (BAND if QUANTITIES[name].takes_band else {})
    )
)
OBJECTIVE = st.sampled_from([(sense, word) for sense, words in OBJECTIVES.items() for word in words]).flatmap(
    lambda pair: _with_some(
        {pair[0]: st.just(pair[1])}, {"horizon_s": POSITIVE} if pair[1] == "iae_disturbance" else {}
    )
)
DIGITAL = _with_some(
    {"sample_time_s": POSITIVE},
    {
        "method": st.sampled_from(["oustaloup", "modified_oustaloup", "fit"]),
        "poles": st.integers(1, 50),
        "band_rad_s": st.tuples(st.floats(0.01, 1), st.floats(2, 1e6)).map(list),
        "rule": st.sampled_from(["tustin", "matched"]),
        "delay_samples": _floats(0, 5),
        "output_rate_per_s": POSITIVE,
    },
)
MEAN, STD = st.floats(1, 2), st.floats(0.1, 9)
NOISE = st.one_of(
    _with_some({"shape": st.just("normal"), "mean": MEAN, "std": STD}, {}),
    _with_some({"shape": st.sampled_from(["half_normal", "uniform"]), "mean": MEAN}, {}),
)
DISTRIBUTION = st.one_of(
    st.just("uniform"),
    _with_some({"truncated_normal": _with_some({"mean": MEAN, "std": STD}, {})}, {}),
    _with_some({"beta": _with_some({"a": POSITIVE, "b": POSITIVE}, {})}, {}),
    _with_some({"normal": _with_some({"mean": MEAN, "std": STD}, {"clip": st.just([1, 2])})}, {}),
    _with_some({"nominal_plus_noise": NOISE}, {}),
)
VALIDATION = _with_some(
    {},
    {
        "samples": st.integers(1, 10**7),
        "seed": st.integers(0, 2**63 - 1),
        "design": st.sampled_from(["random", "latin_hypercube", "sobol"]),
        "distributions": _with_some({}, {"time_constant_s": DISTRIBUTION}),
    },
)
SPEC = _with_some(
    {"schema": st.just(1), "name": st.from_regex("[A-Za-z][A-Za-z0-9._-]{0,63}", fullmatch=True), "plant": PLANT},
    {
        "description": st.text("abc :#'\"äΩ", max_size=20),
        "controller": CONTROLLER,
        "requirements": st.lists(REQUIREMENT, max_size=4),
        "objective": OBJECTIVE,
        "digital": DIGITAL,
        "validation": VALIDATION,
    },
)


def _without_what_a_schema_cannot_see(document: dict[str, Any]) -> dict[str, Any]:
    """Most drawn specs contradict themselves; this leaves few that do."""
    kept: dict[str, Any] = {}
    for drawn in document.get("requirements", []):
        requirement = dict(drawn)
        name = next(key for key in requirement if key in QUANTITIES)
        if "equals" in requirement[name]:
            requirement |= {"on": "nominal"} | ({"at_rad_s": 1.5} if QUANTITIES[name].takes_band else {})
        if "at_rad_s" in requirement:
            requirement = {key: value for key, value in requirement.items() if key not in ("from_rad_s", "to_rad_s")}
        kept[name] = requirement
    if kept:
        document = document | {"requirements": list(kept.values())}
    numerator, denominator = document["plant"].get("numerator", []), document["plant"].get("denominator", [])
    if len(numerator) > len(denominator):
        document = document | {"plant": BASE["plant"]}
    return document


LISTED = st.lists(
    st.tuples(PLANT, _with_some({}, {"name": st.from_regex("[a-z][a-z ]{0,3}", fullmatch=True), "weight": NUMBER})).map(
        lambda pair: pair[0] | pair[1]
    ),
    max_size=9,
)


@pytest.mark.parametrize("examples", [30, pytest.param(150, marks=pytest.mark.long)])
def test_what_the_parser_accepts_of_lists_of_plants_the_schema_accepts(examples: int) -> None:
    seen: list[bool] = []

    @settings(max_examples=examples, deadline=None, derandomize=True)
    @given(LISTED, st.booleans())
    def check(plants: list[Any], both: bool) -> None:
        document = BASE | {"plants": plants}
        if not both:
            document.pop("plant")
        seen.append(parses(document))
        if seen[-1]:
            VALIDATOR.validate(document)

    check()
    assert any(seen)


@pytest.mark.parametrize("examples", [40, pytest.param(150, marks=pytest.mark.long)])
def test_what_the_parser_accepts_the_schema_accepts(examples: int) -> None:
    @settings(max_examples=examples, deadline=None, derandomize=True)
    @given(SPEC | SPEC.map(_without_what_a_schema_cannot_see))
    def check(document: dict[str, Any]) -> None:
        if parses(document):
            VALIDATOR.validate(document)

    check()


@settings(max_examples=60, deadline=None, derandomize=True)
@given(SPEC.filter(lambda document: "objective" in document))
def test_without_requirements_the_parser_accepts_what_the_schema_accepts(document: dict[str, Any]) -> None:
    document.pop("requirements", None)
    # these two need several numbers to see
    document["plant"] = BASE["plant"]
    document.pop("controller", None)
    assert VALIDATOR.is_valid(document)
    assert parses(document)
