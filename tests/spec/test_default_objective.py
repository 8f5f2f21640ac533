"""Which specs without an objective get one, and what is added for it."""

from __future__ import annotations

import pytest

from fopi_tune.spec import parse_spec
from fopi_tune.spec.default_objective import default_notes, with_default_objective
from fopi_tune.spec.model import DesignSpec

HEAD = """schema: 1
name: x
plant: {model: lag, static_gain: 1, time_constant_s: 2}
controller: {kp: {min: 0, max: 10}, ki: {min: 0, max: 10}, alpha: 1}
"""


def spec_with(*requirements: str, objective: str = "") -> DesignSpec:
    lines = "".join(f"  - {requirement}\n" for requirement in requirements)
    return parse_spec(f"{HEAD}requirements:\n{lines}{objective}")


@pytest.mark.parametrize(
    "requirement",
    [
        "crossover_rad_s: {at_least: 0.3}",
        "crossover_rad_s: {equals: 0.3}",
        "crossover_rad_s: {between: [0.3, 1]}",
        "{sensitivity_db: {at_most: -20}, to_rad_s: 0.01}",
        "{loop_gain_db: {at_least: 20}, to_rad_s: 0.01}",
        "load_sensitivity_db: {at_most: -6}",
        "{complementary_sensitivity_db: {at_least: -3}, to_rad_s: 0.5}",
    ],
)
def test_a_requirement_that_asks_the_loop_to_act_needs_no_objective(requirement: str) -> None:
    spec = spec_with(requirement, "phase_margin_deg: {at_least: 60}")
    assert with_default_objective(spec) is spec
    assert default_notes(spec) == ()


def test_an_objective_of_the_spec_stays() -> None:
    spec = spec_with("phase_margin_deg: {at_least: 60}", objective="objective: {maximize: ki}\n")
    assert with_default_objective(spec) is spec


@pytest.mark.parametrize(
    ("requirement", "adds"),
    [
        ("phase_margin_deg: {at_least: 60}", False),
        ("phase_margin_deg: {at_most: 60}", True),
        ("sensitivity_db: {at_most: 4}", False),
        ("{sensitivity_db: {at_most: 4}, to_rad_s: 1}", True),
        ("gain_margin_db: {at_least: 6}", True),
        ("crossover_rad_s: {at_most: 1}", True),
        ("control_sensitivity_db: {at_most: 10}", True),
        ("{load_sensitivity_db: {at_least: -60}, at_rad_s: 1}", True),
    ],
)
def test_bounds_alone_get_the_best_rejection_and_a_bounded_peak(requirement: str, adds: bool) -> None:
    spec = spec_with(requirement)
    used = with_default_objective(spec)
    assert used.objective is not None
    assert used.objective.quantity == "iae_disturbance"
    added = used.requirements[len(spec.requirements) :]
    assert [(r.quantity, r.upper) for r in added] == ([("sensitivity_db", 6.0)] if adds else [])
    assert len(default_notes(spec)) == 1 + adds


def test_a_bound_of_the_nominal_plant_alone_bounds_no_other() -> None:
    nominal = "{phase_margin_deg: {at_least: 60}, on: nominal}"
    known = spec_with(nominal)
    assert len(with_default_objective(known).requirements) == 1
    uncertain = parse_spec(
        f"{HEAD.replace('time_constant_s: 2', 'time_constant_s: {min: 1, max: 3}')}requirements:\n  - {nominal}\n"
    )
    assert len(with_default_objective(uncertain).requirements) == 2
    assert "of every plant" in default_notes(uncertain)[1]
