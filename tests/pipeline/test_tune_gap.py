"""How much better anything else can be, as results say it."""

from __future__ import annotations

from dataclasses import replace

import pytest
from cases.project import CONTINUOUS

import fopi_tune as ft
from fopi_tune.report.text.design import design_text

CLASH = (
    "schema: 1\nname: x\n"
    "plant: {model: lag, static_gain: {min: 1.5, max: 2.6}, time_constant_s: {min: 3, max: 6}, dead_time_s: 0.9}\n"
    "controller: {kp: {min: 0, max: 20}, ki: {min: 0.001, max: 20}, alpha: {min: 0.6, max: 1.4}}\n"
    "requirements:\n  - {sensitivity_db: {at_most: 0.2}}\n  - {sensitivity_db: {at_most: -20}, to_rad_s: 0.2}\n"
    "objective: {maximize: ki}\n"
)


def test_a_design_says_how_much_better_anything_else_can_be() -> None:
    design = ft.tune(CONTINUOUS / "throttle.yaml", proof=False)
    assert design.gap == 0.001
    assert design.to_dict()["gap"] == 0.001
    assert "nothing better by more than 0.1 % is possible (checked)" in design_text(design).plain


def sampled(name: str, **options: object) -> ft.DesignSpec:
    spec = ft.load_spec(CONTINUOUS / f"{name}.yaml")
    assert spec.digital is not None
    return replace(spec, digital=replace(spec.digital, design="sampled", **options))


def test_a_design_on_samples_says_it_too() -> None:
    assert ft.tune(sampled("throttle"), proof=False, bracket=True).gap == 0.001


@pytest.mark.parametrize("option", [{"prewarp": "crossover"}, {"rule": "matched"}])
def test_a_filter_that_changes_with_the_crossover_leaves_it_unsaid(option: dict[str, str]) -> None:
    # other gains have another filter than the one that a bound would be about
    design = ft.tune(sampled("throttle", **option), proof=False, bracket=True)
    assert design.status.value == "solved"
    assert design.gap is None


def test_a_design_from_a_start_alone_says_nothing_about_others() -> None:
    first = ft.tune(CONTINUOUS / "throttle.yaml", proof=False, bracket=False)
    assert first.gap is None
    again = ft.tune(CONTINUOUS / "throttle.yaml", proof=False, start=first.gains)
    assert again.gap is None
    assert "is possible (checked)" not in design_text(again).plain


def test_an_infeasible_spec_says_how_completely_its_box_was_searched() -> None:
    design = ft.tune(ft.parse_spec(CLASH), proof=False)
    assert design.status.value == "infeasible"
    assert design.gap is None
    assert design.message.endswith("the whole box was excluded, in floating point")


@pytest.mark.long
def test_so_does_one_on_samples() -> None:
    text = CLASH + "digital: {sample_time_s: 0.3, design: sampled}\n"
    said = "the whole box was excluded, in floating point"
    assert ft.tune(ft.parse_spec(text), proof=False, bracket=True).message.endswith(said)
    without = ft.tune(ft.parse_spec(text.replace("sampled", "sampled, prewarp: crossover")), proof=False, bracket=True)
    assert without.status.value == "infeasible"
    assert "excluded" not in without.message
