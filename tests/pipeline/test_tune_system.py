"""Tuning of systems: what is designed, checked, told and refused."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from cases.project import ROOT

from fopi_tune.core.controller import FoPi
from fopi_tune.errors import DomainError, SpecError
from fopi_tune.pipeline.systems import validate_system
from fopi_tune.pipeline.tune_system import tune_system
from fopi_tune.report import system_design_text
from fopi_tune.results.status import Status
from fopi_tune.results.system_design import DesignedSystem
from fopi_tune.spec import load_system
from fopi_tune.spec.model import Knot, Limit, Relation, SystemSpec

CAR = ROOT / "systems" / "car_comfort.yaml"


def stop(**changes: Any) -> SystemSpec:
    """The car on its way from 30 km/h to a stop alone."""
    system = load_system(CAR)
    assert system.objective is not None
    return replace(
        system,
        scenarios=(replace(system.scenarios[2], **changes),),
        objective=replace(system.objective, scenario=system.scenarios[2].name),
    )


@pytest.fixture(scope="module", params=["stop", pytest.param("whole", marks=pytest.mark.long)])
def designed(request: pytest.FixtureRequest) -> DesignedSystem:
    return tune_system(CAR if request.param == "whole" else stop())


def test_the_car_keeps_its_comfort_with_every_pair_that_is_drawn(designed: DesignedSystem) -> None:
    assert designed.status is Status.SOLVED
    assert designed.gains is not None
    (comfort,) = designed.requirements
    assert (comfort.drawn.met, comfort.drawn.total) == (10_000, 10_000)
    # coasting from 30 km/h with the throttle closed is the most there is
    assert comfort.achieved == pytest.approx(30.0 * 0.1746 / 3.6, rel=1e-6)
    assert set(designed.loops) == {"throttle", "brake"}
    assert all(found.all_met for found in designed.loops.values())
    # another draw, by the validation
    evidence = validate_system(load_system(CAR), designed.gains, samples=500, seed=7).evidence
    assert evidence.all_met


def test_it_is_told_as_checked_and_never_as_proved(designed: DesignedSystem) -> None:
    told = system_design_text(designed).plain
    assert "checked, not proved" in told
    assert "checked   acceleration_m_s2 <= 2" in told
    assert "proved    " not in told
    said, objective = designed.to_dict(), designed.spec.objective
    assert objective is not None
    assert said["status"] == "solved"
    assert [each["verdict"] for each in said["requirements"]] == ["checked"]
    assert said["objective_quantity"] == f"minimize iae in scenario {objective.scenario}, the worst pair's"


def test_what_cannot_be_kept_is_infeasible_with_its_reason() -> None:
    # the setpoint jumps to 10 km/h
    asked = replace(stop(reference=(Knot(0.0, 10.0),), duration_s=20.0), tuned=("brake",))
    found = tune_system(asked, {"throttle": FoPi(0.09, 0.025, 0.8)})
    assert found.status is Status.INFEASIBLE
    assert "slows by 5.21" in found.message
    assert not found.requirements[0].is_met
    assert "violated  acceleration_m_s2 <= 2" in system_design_text(found).plain


def test_a_system_that_does_not_say_what_to_tune_is_refused() -> None:
    system = replace(load_system(CAR), tuned=())
    with pytest.raises(DomainError, match=r"add tune: \[brake\]"):
        tune_system(system)


def test_gains_that_are_given_are_not_tuned(tmp_path: Path) -> None:
    text = CAR.read_text(encoding="utf-8").replace("comfort/", f"{ROOT.as_posix()}/systems/comfort/")
    given = text.replace("brake.yaml, output", "brake.yaml, gains: {kp: 1, ki: 1, alpha: 1}, output")
    (tmp_path / "car.yaml").write_text(given, encoding="utf-8")
    with pytest.raises(SpecError, match="the brake is under tune"):
        load_system(tmp_path / "car.yaml")


def test_requirements_of_a_system_are_judged_as_its_limits_are() -> None:
    system = load_system(CAR)
    assert system.judged_limits[0] == Limit(
        "acceleration_m_s2", Relation.AT_MOST, 2.0, line=system.requirements[0].line
    )
