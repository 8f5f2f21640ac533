"""Which setpoints the search finds, and what it says of the others."""

from __future__ import annotations

from dataclasses import replace

import pytest
from cases import switched

from fopi_tune.core.plant import PlantFamily, Uncertain
from fopi_tune.proof.switched.bounded_search import prove_bounded
from fopi_tune.proof.switched.settling import verify_settling
from fopi_tune.proof.switched.settling_search import prove_settling


@pytest.mark.thinned(2)
@pytest.mark.parametrize("memory", ["reset", "tracking"])
def test_without_a_question_the_widest_range_is_found(memory: str) -> None:
    model = switched.model(memory)
    found = prove_settling(model, None)
    assert found.proof is not None
    assert found.reason == ""
    low, high = found.proof.setpoints
    # the brake needs a setpoint above the hysteresis, and the throttle holds at most 4.39/0.1746 = 25.14
    assert low <= 1.0
    assert 25.0 <= high < 25.15
    wider = replace(found.proof, setpoints=(low, 25.15))
    assert verify_settling(model, wider) is None


def test_a_range_that_can_be_proved_in_part_says_what_ends_it() -> None:
    found = prove_settling(switched.model("reset"), (5.0, 30.0))
    assert found.proof is not None
    assert found.proof.setpoints[0] == 5.0
    # three digits of the width, inwards
    assert found.proof.setpoints[1] == 25.1
    assert found.reason.startswith("above 25.1")


def test_setpoints_out_of_reach_have_no_proof() -> None:
    found = prove_settling(switched.model("reset"), (26.0, 30.0))
    assert found.proof is None
    assert "above 25.1" in found.reason


def test_what_is_not_handled_is_said() -> None:
    held, reset = switched.model("held"), switched.model("reset")
    throttle, brake = reset.loops
    uncertain = PlantFamily("pole", {**throttle.plant.parameters, "gain": Uncertain(4.39, 4.0, 5.0)})
    assert "held memory" in prove_settling(held, None).reason
    assert "hysteresis greater than 0" in prove_settling(replace(reset, hysteresis=0.0), None).reason
    several = replace(reset, loops=(replace(throttle, plant=uncertain), brake))
    assert "its plant is uncertain" in prove_settling(several, None).reason


def test_a_throttle_that_overshoots_is_proved_only_where_it_does_not_reach_the_brake() -> None:
    throttle, brake = switched.model("reset").loops
    # ten times the integral action: the output swings over the upper line
    eager = replace(throttle.controller, residues=tuple(10.0 * each for each in throttle.controller.residues))
    model = replace(switched.model("reset"), loops=(replace(throttle, controller=eager), brake))
    found = prove_settling(model, switched.SETPOINTS)
    assert found.proof is not None
    assert found.proof.setpoints[1] < 11.0
    assert found.proof.overshoot < model.upper
    assert found.reason == f"above {10.5:g}: the output overshoots by the hysteresis"
    assert prove_settling(model, (12.0, 22.0)).proof is None


def test_a_brake_without_limits_is_named() -> None:
    model = switched.model("reset")
    throttle, brake = model.loops
    free = replace(brake, controller=replace(brake.controller, limits=(-1.7e308, 1.7e308)))
    found = prove_settling(replace(model, loops=(throttle, free)), None)
    assert found.proof is None
    assert found.reason.startswith("brake: without output_limits")


def test_the_smallest_limits_and_setpoints_are_no_error() -> None:
    model = switched.model("tracking")
    throttle, brake = model.loops
    tiny = replace(throttle, controller=replace(throttle.controller, limits=(0.0, 1e-323)))
    small = replace(model, loops=(tiny, replace(brake, controller=replace(brake.controller, limits=(-1e-323, 0.0)))))
    bounded = prove_bounded(small, None).proof
    assert bounded is not None
    assert bounded.outputs[0] < 0.0 < bounded.outputs[1] < 1e-299
    # an overshooting loop's responses vanish below the smallest double: no warning, and no proof
    found = prove_settling(small, None)
    assert found.proof is None
    assert found.reason.startswith("no setpoint: ")


def test_a_throttle_without_limits_settles_on_what_is_asked_for() -> None:
    model = switched.model("reset")
    throttle, brake = model.loops
    endless = replace(throttle, controller=replace(throttle.controller, limits=(-1e300, 1e300)))
    model = replace(model, loops=(endless, brake))
    widest, asked = prove_settling(model, None), prove_settling(model, (2.0, 500.0))
    assert widest.reason == asked.reason == ""
    assert widest.proof is not None
    assert widest.proof.setpoints[1] > 100.0
    assert asked.proof is not None
    assert asked.proof.setpoints == (2.0, 500.0)


def test_a_level_set_that_is_not_reached_is_the_reason() -> None:
    # so slow an integrator that 40,000 samples are not enough
    throttle, brake = switched.model("reset").loops
    slow = replace(throttle.controller, residues=tuple(1e-5 * each for each in throttle.controller.residues))
    model = replace(switched.model("reset"), loops=(replace(throttle, controller=slow), brake))
    for asked in (None, switched.SETPOINTS, (0.0, 30.0)):
        assert prove_settling(model, asked).reason.startswith("the level set is not reached")
