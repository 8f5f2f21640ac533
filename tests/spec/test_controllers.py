"""Controllers in specs: the setpoint's weight, orders of a derivative, which digests depend on them, and refusals."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

import fopi_tune as ft
from fopi_tune.core.controller import FoPid
from fopi_tune.core.terms.controller_spec import GainRange
from fopi_tune.errors import DomainError, SpecError
from fopi_tune.results.to_control import to_control
from fopi_tune.simulation.fractional.poles import principal_poles
from fopi_tune.spec import parse_spec
from fopi_tune.spec.digests import DESIGN_PARTS, DIGITAL_PARTS, digests_of
from fopi_tune.spec.load import load_system

SPEC = """\
schema: 1
name: a
plant: {model: lag, static_gain: 1, time_constant_s: 2}
digital: {sample_time_s: 0.1, design: sampled}
requirements: [{phase_margin_deg: {at_least: 60}}]
scenarios: [{name: one, duration_s: 10, reference: [{at_s: 0, value: 1}]}]
"""
PID = "structure: pid, derivative_filter_time_constant_s: 0.2"
#: of the section `controller`, of a pid and of a fopi, before there was an order of the derivative
KNOWN_DIGESTS = ["2718e1830669774d", "519008aa094b1398"]


@pytest.mark.parametrize("structure", ["structure: fopi", "structure: pi", PID])
def test_every_structure_takes_any_finite_weight(structure: str) -> None:
    for weight in (0, 0.5, 1, 1.5, -1):
        assert (
            parse_spec(f"{SPEC}controller: {{{structure}, setpoint_weight: {weight}}}\n").controller.setpoint_weight
            == weight
        )
    assert parse_spec(f"{SPEC}controller: {{{structure}}}\n").controller.setpoint_weight == 1.0


@pytest.mark.parametrize("structure", ["structure: fopi", PID])
def test_what_runs_depends_on_the_weight_and_the_loop_does_not(structure: str) -> None:
    plain, one, half = (
        digests_of(parse_spec(f"{SPEC}controller: {{{structure}{weight}}}\n"))
        for weight in ("", ", setpoint_weight: 1", ", setpoint_weight: 0.5")
    )
    assert plain == one
    assert {part for part in plain if plain[part] != half[part]} == {"digital"}
    assert "digital" in set(DIGITAL_PARTS) - set(DESIGN_PARTS)


def test_every_structure_is_designed_for_scenarios() -> None:
    text = SPEC.replace("at_least: 60}}]", "at_least: 60}}, {overshoot: {at_most: 0.2}, scenario: one}]")
    filtered = ", measurement_filter: {order: 1, time_constant_s: 0.1}"
    for words in ("setpoint_weight: 0.5", PID, f"{PID}, setpoint_weight: 0.5{filtered}", f"structure: pi{filtered}"):
        spec = parse_spec(f"{text}controller: {{{words}}}\nobjective: {{minimize: iae, scenario: one}}\n")
        assert len(spec.scenario_requirements) == 1
        assert spec.digital is not None
        assert spec.digital.designs_sampled


def test_a_weight_with_a_range_is_decided_by_a_step_of_the_setpoint_alone() -> None:
    ranged = f"controller: {{{PID}, setpoint_weight: {{min: 0.2, max: 0.9}}}}\n"
    aim = "objective: {minimize: iae, scenario: one}\n"
    box = parse_spec(f"{SPEC}{ranged}{aim}").controller
    assert box.setpoint_weight_range == GainRange(0.2, 0.9)
    assert list(box.ranges) == ["kp", "ki", "kd", "setpoint_weight"]
    # one number in two words
    same = ranged.replace("0.9", "0.2")
    assert parse_spec(f"{SPEC}{same}").controller.setpoint_weight == 0.2
    resting = SPEC.replace("value: 1", "value: 0")
    for text in (f"{SPEC}{ranged}", f"{resting}{ranged}{aim}"):
        with pytest.raises(SpecError, match="only what a scenario with a step or ramp of the setpoint measures"):
            parse_spec(text)


def test_gains_that_are_designed_for_scenarios_depend_on_the_weight() -> None:
    aim = "objective: {minimize: iae, scenario: one}\n"
    text = f"{SPEC}{aim}controller: {{{PID}, setpoint_weight: "
    half, one = (digests_of(parse_spec(f"{text}{weight}}}\n")) for weight in (0.5, 1))
    assert {part for part in half if half[part] != one[part]} == {"loop", "digital"}
    assert "loop" in DESIGN_PARTS


def test_a_filter_with_a_range_beside_requirements_about_scenarios_is_refused() -> None:
    text = SPEC.replace("at_least: 60}}]", "at_least: 60}}, {overshoot: {at_most: 0.2}, scenario: one}]")
    words = PID.replace("0.2", "{min: 0.1, max: 1}")
    assert words != PID
    with pytest.raises(SpecError, match=r"write one number, or write what scenarios have to meet under `limits:`"):
        parse_spec(f"{text}controller: {{{words}}}\n")


@pytest.mark.parametrize("weight", ["0.5", "{min: 0, max: 1}"])
def test_a_weight_in_a_mode_is_refused(weight: str, tmp_path: Path) -> None:
    aim = "objective: {minimize: iae, scenario: one}\n"
    (tmp_path / "mode.yaml").write_text(f"{SPEC}{aim}controller: {{setpoint_weight: {weight}}}\n")
    (tmp_path / "s.yaml").write_text(
        "schema: 1\nname: s\n"
        "system: {throttle: {spec: mode.yaml}, brake: {spec: mode.yaml}, hysteresis: 0.5}\n"
        "scenarios: [{name: one, duration_s: 10, reference: [{at_s: 0, value: 1}]}]\n"
    )
    with pytest.raises(SpecError, match="a mode's controller has setpoint_weight: 1"):
        load_system(tmp_path / "s.yaml")


FOPID = "structure: fopid, derivative_filter_time_constant_s: 0.2"


def test_a_fopid_has_an_order_of_its_derivative() -> None:
    text = SPEC.replace("digital: {sample_time_s: 0.1, design: sampled}\n", "")
    text = text[: text.index("scenarios")]
    box = parse_spec(f"{text}controller: {{{FOPID}}}\n").controller
    assert (box.structure, box.mu, box.alpha) == ("fopid", GainRange(0.1, 1.0), GainRange(0.1, 1.9))
    box = parse_spec(f"{text}controller: {{{FOPID}, alpha: 0.9, mu: {{min: 0.5}}, kd: 1}}\n").controller
    assert (box.mu, box.alpha, box.kd) == (GainRange(0.5, 1.0), GainRange(0.9, 0.9), GainRange(1.0, 1.0))
    # every number but the setpoint's weight belongs to the loop
    digests = [
        digests_of(parse_spec(f"{text}controller: {{{FOPID}, {more}}}\n"))
        for more in ("alpha: 0.9, mu: 0.5", "alpha: 0.9, mu: 0.6", "alpha: 0.8, mu: 0.5", "alpha: 0.9, mu: 0.5, kp: 1")
    ]
    assert len({each["controller"] for each in digests}) == 4
    assert len({each["plant"] for each in digests}) == 1


def test_what_does_not_know_the_orders_of_a_fopid_refuses_them() -> None:
    made = parse_spec(f"{SPEC}controller: {{{FOPID}}}\n")
    gains = FoPid(1.0, 1.0, 0.8, 0.1, 0.5, 0.2)
    for refused in (
        lambda: ft.simulate(replace(made, digital=None, scenarios=()), gains, exact=True),
        lambda: to_control(gains, made.plant),
        lambda: principal_poles(gains, made.plant.member(made.plant.nominal_point)),
    ):
        with pytest.raises(DomainError, match="not available for structure: fopid in this version"):
            refused()


def test_digests_of_other_structures_are_what_they_were() -> None:
    specs = (f"{SPEC}controller: {{{PID}}}\n", f"{SPEC}controller: {{alpha: 0.8}}\n")
    found = [digests_of(parse_spec(text))["controller"][:16] for text in specs]
    assert found == KNOWN_DIGESTS


@pytest.mark.parametrize("structure", ["structure: pi", "structure: fopi", PID, FOPID])
def test_a_measurement_filter_is_read_for_every_structure_and_is_part_of_the_controllers_digest(structure: str) -> None:
    used = [
        f", measurement_filter: {{order: {order}, time_constant_s: {time_s}}}"
        for order, time_s in ((1, 0.1), (2, 0.1), (2, 0.2))
    ]
    specs = [parse_spec(f"{SPEC}controller: {{{structure}{each}}}\n") for each in ("", *used)]
    filters = [spec.controller.measurement_filter for spec in specs]
    assert filters == [None, ft.MeasurementFilter(1, 0.1), ft.MeasurementFilter(2, 0.1), ft.MeasurementFilter(2, 0.2)]
    digests = [digests_of(spec) for spec in specs]
    assert len({each["controller"] for each in digests}) == 4
    for part in ("plant", "requirements", "loop"):
        assert len({each[part] for each in digests}) == 1, part
    made = specs[2].controller.controller(1.0, 0.5, 1.0, 0.1, 1.0)
    assert made.measurement_filter == ft.MeasurementFilter(2, 0.1)


def test_gains_hold_a_weight_where_the_spec_has_a_range_of_it_and_nowhere_else() -> None:
    given, ranged = (
        parse_spec(f"{SPEC}objective: {{minimize: iae, scenario: one}}\ncontroller: {{setpoint_weight: {weight}}}\n")
        for weight in ("0.5", "{min: 0, max: 1}")
    )
    for stage in (ft.prove, ft.discretize, ft.simulate, ft.validate):
        with pytest.raises(DomainError, match="give gains with a setpoint_weight"):
            stage(ranged, ft.FoPi(0.3, 0.1, 1.0))
        with pytest.raises(DomainError, match="leave it out of the gains"):
            stage(given, ft.FoPi(0.3, 0.1, 1.0, setpoint_weight=0.5))
    assert ranged.controller.weight_of(ft.FoPi(0.3, 0.1, 1.0, setpoint_weight=0.2)) == 0.2
    assert given.controller.weight_of(ft.FoPi(0.3, 0.1, 1.0)) == 0.5
