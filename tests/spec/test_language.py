"""The spec language: what a file says."""

from __future__ import annotations

import hashlib
import math
from pathlib import Path

import pytest
from cases.project import CONTINUOUS

from fopi_tune.core.plant import PLANT_MODELS, PlantModel, Uncertain
from fopi_tune.errors import DomainError, SpecError
from fopi_tune.quantities import QUANTITIES
from fopi_tune.quantities.objectives import OBJECTIVES
from fopi_tune.spec import load_spec, parse_spec
from fopi_tune.spec.model import (
    ControllerSpec,
    DigitalSpec,
    GainRange,
    Objective,
    Relation,
    Requirement,
    Scope,
    Sense,
    ValidationSpec,
)
from fopi_tune.spec.templates.template import template

SPECS = sorted(CONTINUOUS.glob("*.yaml"))
BRAKE = (CONTINUOUS / "brake.yaml").read_text(encoding="utf-8")
POLE = "schema: 1\nname: a\nplant: {model: pole, gain: 2, pole_rad_s: 0.5}\n"
LAG = "schema: 1\nname: a\nplant: {model: lag, static_gain: 1, time_constant_s: {min: 1, max: 3}}\n"


def lines(text: str) -> list[str]:
    with pytest.raises(SpecError) as caught:
        parse_spec(text, "s.yaml")
    return [str(problem) for problem in caught.value.problems]


def brake_with(old: str, new: str) -> str:
    assert old in BRAKE
    return BRAKE.replace(old, new, 1)


def plant(text: str) -> dict[str, Uncertain]:
    return dict(parse_spec(f"schema: 1\nname: a\nplant: {text}\nobjective: {{maximize: ki}}\n").plant.parameters)


def plant_lines(text: str) -> list[str]:
    return lines(f"schema: 1\nname: a\nobjective: {{maximize: ki}}\nplant: {text}\n")


def controller(text: str) -> ControllerSpec:
    return parse_spec(f"{POLE}objective: {{minimize: sensitivity_peak_db}}\ncontroller: {text}\n").controller


def requirements(*items: str, head: str = LAG) -> str:
    return head + "requirements:\n" + "".join(f"- {item}\n" for item in items)


@pytest.mark.parametrize("path", SPECS, ids=lambda path: path.stem)
def test_every_shipped_spec_is_readable(path: Path) -> None:
    spec = load_spec(path)
    assert spec.name == path.stem
    assert spec.sha256 == hashlib.sha256(path.read_bytes()).hexdigest()


def test_the_brake_spec_says_what_its_file_says() -> None:
    spec = load_spec(str(CONTINUOUS / "brake.yaml"))
    known = Uncertain.exactly
    assert spec.plant.model == "lag"
    assert spec.plant.parameters == {
        "static_gain": known(1.0),
        "time_constant_s": Uncertain(2.25, 1.6, 3.1),
        "dead_time_s": known(0.0),
    }
    assert spec.controller == ControllerSpec(GainRange(0.0, 10.0), GainRange(0.0, 10.0), GainRange(0.3, 1.5))
    nominal = Scope.NOMINAL
    assert spec.requirements == (
        Requirement("crossover_rad_s", Relation.EQUALS, (0.3,), nominal, line=14),
        Requirement("phase_margin_deg", Relation.EQUALS, (90.0,), nominal, line=16),
        Requirement("phase_margin_deg", Relation.AT_LEAST, (80.0,), line=18),
        Requirement("gain_margin_db", Relation.AT_LEAST, (12.04,), line=19),
        Requirement("sensitivity_db", Relation.AT_MOST, (-20.0,), to_rad_s=0.02, line=20),
    )
    assert spec.objective == Objective(Sense.MINIMIZE, "phase_margin_spread_deg")
    assert spec.digital == DigitalSpec(0.2, "oustaloup", 7, (1e-3, 1e3), "tustin", 0.0, measurement_unit="km/h")
    assert spec.validation == ValidationSpec(10_000, 1)
    assert spec.schema == 1


def test_a_design_spec_is_loaded_as_it_is() -> None:
    spec = parse_spec(BRAKE)
    assert load_spec(spec) is spec


def test_text_and_bytes_say_the_same() -> None:
    assert parse_spec(BRAKE) == parse_spec(BRAKE.encode())


def test_windows_line_ends_do_not_move_places() -> None:
    assert lines(brake_with("2.25", "x").replace("\n", "\r\n")) == lines(brake_with("2.25", "x"))


def test_sections_that_may_be_missing_take_their_defaults() -> None:
    spec = parse_spec(POLE + "objective: {maximize: ki}\n")
    assert spec.controller == ControllerSpec(GainRange(), GainRange(), GainRange(0.1, 1.9))
    assert spec.requirements == ()
    assert spec.digital is None
    assert spec.validation is None
    assert spec.description == ""
    assert parse_spec(POLE + "objective: {maximize: ki}\ndigital: {sample_time_s: 1}\n").digital == DigitalSpec(1.0)
    assert parse_spec(POLE + "objective: {maximize: ki}\nvalidation: {}\n").validation == ValidationSpec()


@pytest.mark.parametrize(
    ("text", "value"),
    [("1", 1.0), ("-2.5", -2.5), ("1e-3", 1e-3), ("1.0e-3", 1e-3), (".5", 0.5), ("+3", 3.0), ("5.", 5.0), ("2E4", 2e4)],
)
def test_a_number_may_be_written_as(text: str, value: float) -> None:
    assert plant(f"{{model: pole, gain: {text}, pole_rad_s: 1}}")["gain"] == Uncertain.exactly(value)


def test_an_uncertain_number_is_nominally_at_its_midpoint() -> None:
    numbers = plant("{model: pole, gain: {min: 1, max: 4}, pole_rad_s: {nominal: 1, min: 1, max: 2}, dead_time_s: 0.5}")
    assert numbers == {
        "gain": Uncertain(2.5, 1.0, 4.0),
        "pole_rad_s": Uncertain(1.0, 1.0, 2.0),
        "dead_time_s": Uncertain.exactly(0.5),
    }


def test_a_transfer_function_has_one_parameter_a_coefficient() -> None:
    numbers = plant("{model: transfer_function, numerator: [2, {min: 1, max: 3}], denominator: [1, 3, 1]}")
    assert list(numbers) == [
        "numerator[0]",
        "numerator[1]",
        "denominator[0]",
        "denominator[1]",
        "denominator[2]",
        "dead_time_s",
    ]
    assert numbers["numerator[1]"] == Uncertain(2.0, 1.0, 3.0)
    assert numbers["dead_time_s"] == Uncertain.exactly(0.0)


def test_another_plant_model_needs_no_change_in_the_language(monkeypatch: pytest.MonkeyPatch) -> None:
    def check(name: str, value: Uncertain) -> str | None:
        return "must be positive" if name == "stiffness" and value.min <= 0 else None

    model = PlantModel(
        "spring",
        ("stiffness", "dead_time_s"),
        ("masses",),
        lambda p: ([1.0], [p["masses[0]"], p["stiffness"]], 0.0),
        check,
    )
    monkeypatch.setitem(PLANT_MODELS, "spring", model)
    assert list(plant("{model: spring, stiffness: {min: 1, max: 2}, masses: [3]}")) == [
        "masses[0]",
        "stiffness",
        "dead_time_s",
    ]
    assert plant_lines("{model: spring, stiffness: -1, masses: [3]}") == [
        "s.yaml:4:35: plant.stiffness: must be positive"
    ]


@pytest.mark.parametrize(
    ("text", "box"),
    [
        ("{}", (GainRange(), GainRange(), GainRange(0.1, 1.9))),
        ("{structure: fopi, kp: 2, ki: {max: 3}}", (GainRange(2, 2), GainRange(-math.inf, 3), GainRange(0.1, 1.9))),
        ("{kp: {min: -1}, alpha: 1}", (GainRange(-1, math.inf), GainRange(), GainRange(1, 1))),
        ("{alpha: {min: 0.5}}", (GainRange(), GainRange(), GainRange(0.5, 1.9))),
        ("{structure: pi}", (GainRange(), GainRange(), GainRange(1, 1))),
        ("{structure: pi, kp: 2, alpha: 1}", (GainRange(2, 2), GainRange(), GainRange(1, 1))),
        ("{structure: pi, alpha: {min: 1, max: 1}}", (GainRange(), GainRange(), GainRange(1, 1))),
        ("{alpha: {max: 1.99}, kp: {min: 1, max: 1}}", (GainRange(1, 1), GainRange(), GainRange(0.1, 1.99))),
    ],
)
def test_gains_may_be_fixed_bounded_or_free(text: str, box: tuple[GainRange, GainRange, GainRange]) -> None:
    assert controller(text) == ControllerSpec(*box)


@pytest.mark.parametrize(
    ("keys", "band"),
    [
        ("", (0.0, math.inf)),
        ("from_rad_s: 1", (1.0, math.inf)),
        ("to_rad_s: 2", (0.0, 2.0)),
        ("from_rad_s: 1, to_rad_s: 2", (1.0, 2.0)),
        ("at_rad_s: 3", (3.0, 3.0)),
    ],
)
def test_a_function_of_frequency_holds_over_its_band(keys: str, band: tuple[float, float]) -> None:
    (requirement,) = parse_spec(requirements(f"{{loop_gain_db: {{at_most: 0}}, {keys}}}")).requirements
    assert (requirement.from_rad_s, requirement.to_rad_s) == band


@pytest.mark.parametrize("quantity", QUANTITIES)
@pytest.mark.parametrize("relation", ["equals: 60", "at_least: 60", "at_most: 60", "between: [50, 60]"])
def test_every_quantity_takes_every_relation(quantity: str, relation: str) -> None:
    at = ", at_rad_s: 1" if QUANTITIES[quantity].takes_band else ""
    (requirement,) = parse_spec(requirements(f"{{{quantity}: {{{relation}}}, on: nominal{at}}}")).requirements
    assert requirement.quantity == quantity
    assert requirement.relation.value == relation.partition(":")[0]
    assert requirement.limits == ((50.0, 60.0) if "between" in relation else (60.0,))
    assert requirement.scope is Scope.NOMINAL


@pytest.mark.parametrize(("sense", "word"), [(sense, word) for sense, words in OBJECTIVES.items() for word in words])
def test_every_objective_is_readable(sense: str, word: str) -> None:
    assert parse_spec(POLE + f"objective: {{{sense}: {word}}}\n").objective == Objective(Sense(sense), word)


def test_the_error_objective_takes_a_horizon() -> None:
    text = POLE + "objective: {minimize: iae_disturbance, horizon_s: 30}\n"
    assert parse_spec(text).objective == Objective(Sense.MINIMIZE, "iae_disturbance", 30.0)


def test_whole_numbers_may_have_an_exponent() -> None:
    text = POLE + "objective: {maximize: ki}\nvalidation: {samples: 1e6, seed: 9223372036854775807}\n"
    assert parse_spec(text).validation == ValidationSpec(1_000_000, 2**63 - 1)


def test_equal_limits_at_a_boundary_are_consistent() -> None:
    consistent = (
        ("{phase_margin_deg: {equals: 90}, on: nominal}", "phase_margin_deg: {at_least: 80}"),
        ("{phase_margin_deg: {equals: 90}, on: nominal}", "phase_margin_deg: {at_least: 90}"),
        ("phase_margin_deg: {at_most: 80}", "phase_margin_deg: {at_least: 80}"),
        ("phase_margin_deg: {between: [60, 70]}", "phase_margin_deg: {between: [70, 80]}"),
        ("{sensitivity_db: {at_most: -20}, to_rad_s: 1}", "{sensitivity_db: {at_least: 0}, from_rad_s: 1.1}"),
        ("{sensitivity_db: {at_most: -20}, at_rad_s: 1}", "{sensitivity_db: {equals: 0}, at_rad_s: 2, on: nominal}"),
    )
    for pair in consistent:
        assert len(parse_spec(requirements(*pair)).requirements) == 2


def test_an_equality_over_a_family_without_uncertain_numbers_is_kept_as_it_is() -> None:
    (requirement,) = parse_spec(requirements("phase_margin_deg: {equals: 60}", head=POLE)).requirements
    assert requirement.scope is Scope.FAMILY


def test_the_template_is_a_spec_that_explains_every_section() -> None:
    text = template("my_loop-2.b")
    spec = parse_spec(text)
    brake = parse_spec(BRAKE)
    assert spec.name == "my_loop-2.b"
    assert (spec.plant, spec.controller, spec.objective) == (brake.plant, brake.controller, brake.objective)
    # and one more, against slow disturbances: without it a first design creeps
    assert [r.limits for r in spec.requirements] == [*(r.limits for r in brake.requirements), (-40.0,)]
    assert all(f"\n{section}:" in text for section in ("plant", "controller", "requirements", "digital", "validation"))
    assert all(word in text for word in (*QUANTITIES, *PLANT_MODELS))
    assert max(len(line) for line in text.splitlines()) <= 120


@pytest.mark.parametrize("name", ["1e3", "true", "2024", "null"])
def test_a_template_keeps_a_name_that_looks_like_a_number(name: str) -> None:
    assert parse_spec(template(name)).name == name


@pytest.mark.parametrize("name", ["", "../x", "a b", "a\n", "-a", "x" * 65])
def test_a_template_needs_a_name_that_a_folder_can_have(name: str) -> None:
    with pytest.raises(DomainError):
        template(name)
