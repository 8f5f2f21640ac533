"""What specs with measured plants cannot ask for: every refusal has its line and says what to do."""

from __future__ import annotations

import pytest
from cases.measured import LAG, csv, text_of

from fopi_tune.errors import SpecError
from fopi_tune.spec.load import parse_spec
from fopi_tune.spec.model import DesignSpec

PLANT = "{model: frequency_response, file: f.csv, unstable_poles: 0}"
STEP = "scenarios: [{name: s, duration_s: 5, reference: [{at_s: 1, value: 1}]}]"
ASKED = "[{phase_margin_deg: {at_least: 50}}]"


def _parse(
    requirements: str = ASKED, objective: str = "{maximize: ki}", more: str = "", controller: str = ""
) -> DesignSpec:
    data = csv(LAG, 0.01, 100.0, 61)
    return parse_spec(text_of(PLANT, requirements, objective, controller, more), files={"f.csv": data})


def _problems(**asked: str) -> list[str]:
    with pytest.raises(SpecError) as refused:
        _parse(**asked)
    return [str(problem) for problem in refused.value.problems]


@pytest.mark.parametrize(
    ("asked", "told"),
    [
        ({"objective": "{minimize: iae_disturbance}"}, "6:23: objective.minimize: iae_disturbance needs the plant"),
        ({"objective": ""}, "requirements: no requirement asks the loop to act and there is no objective"),
        ({"more": "digital: {sample_time_s: 0.1, design: sampled}"}, "7:39: digital.design: the loop on"),
        ({"more": "validation: {samples: 100}"}, "validation: plants are drawn from the ranges"),
        ({"more": f"digital: {{sample_time_s: 0.1}}\n{STEP}"},
         "scenarios: simulations need the plant's transfer function"),
        ({"requirements": "[{sensitivity_db: {at_most: 6}, from_rad_s: 200}]"},
         "from_rad_s: lies outside of the measured band, 0.01 to 100 rad/s"),
        ({"requirements": "[{sensitivity_db: {at_most: -6}, to_rad_s: 0.001}]"}, "to_rad_s: lies outside of"),
        ({"requirements": "[{sensitivity_db: {at_most: -6}, at_rad_s: 0.001}]"}, "at_rad_s: lies outside of"),
        ({"requirements": "[{crossover_rad_s: {at_least: 200}}]"}, "at_least: 200 rad/s lies outside of the measured"),
    ],
)  # fmt: skip
def test_what_needs_more_than_the_data_is_refused(asked: dict[str, str], told: str) -> None:
    assert any(told in problem for problem in _problems(**asked)), _problems(**asked)


def test_every_refusal_is_told_at_once() -> None:
    found = _problems(
        objective="{minimize: iae_disturbance}", more="digital: {sample_time_s: 0.1, design: sampled}\nvalidation: {}"
    )
    assert len(found) == 3


def test_an_equality_over_several_members_is_refused() -> None:
    text = text_of(PLANT.replace("file: f.csv", "files: [f.csv, g.csv]"), "[{crossover_rad_s: {equals: 1}}]")
    with pytest.raises(SpecError, match="write between, or on: nominal"):
        parse_spec(text, files={"f.csv": csv(LAG), "g.csv": csv(LAG)})


def test_a_band_that_reaches_outside_is_taken() -> None:
    assert _parse(requirements="[{sensitivity_db: {at_most: 6}}, {crossover_rad_s: {at_least: 0.5}}]").is_measured


def test_fixed_gains_need_no_objective() -> None:
    assert _parse(objective="", controller="{kp: 1, ki: 1, alpha: 1}").is_measured


def test_a_mode_of_a_system_is_no_measured_plant() -> None:
    from fopi_tune.spec.systems import read_system
    from fopi_tune.spec.yaml.composer import compose
    from fopi_tune.spec.yaml.nodes import Place
    from fopi_tune.spec.yaml.problems import ProblemCollector

    spec = _parse(more="digital: {sample_time_s: 0.1}")
    text = "schema: 1\nname: s\nsystem:\n  hysteresis: 0.1\n  throttle: {spec: a.yaml}\n  brake: {spec: b.yaml}\n"
    text += STEP + "\n"
    collector = ProblemCollector("s.yaml")
    read_system(Place(compose(text, collector), "", collector), "", lambda _: spec, lambda _: b"")
    assert any("which a measured response cannot be" in str(problem) for problem in collector.problems)
