"""The search for orbits finds none where settling is proved, and takes the setpoints it is told."""

from __future__ import annotations

from dataclasses import replace

import pytest
from cases import switched

from fopi_tune.proof.switched.cycle_search import prove_cycles
from fopi_tune.proof.switched.cycles import verify_cycle


@pytest.mark.parametrize("memory", ["reset", "tracking"])
def test_what_settles_has_no_orbit(memory: str) -> None:
    assert prove_cycles(switched.model(memory), switched.SETPOINTS) == ()


def test_a_single_setpoint_is_tried_with_every_corner_of_the_plants() -> None:
    found = prove_cycles(switched.model("held"), (6.0, 6.0))
    assert {each.setpoint for each in found} == {6.0}
    assert {each.plants[1]["time_constant_s"] for each in found} == {1.6, 2.25, 3.1}


def test_without_limits_the_setpoints_are_taken_from_the_hysteresis() -> None:
    held = switched.model("held")
    largest = 1.7976931348623157e308
    loops = [replace(loop, controller=replace(loop.controller, limits=(-largest, largest))) for loop in held.loops]
    model = replace(held, loops=(loops[0], loops[1]))
    found = prove_cycles(model, None)
    assert all(verify_cycle(model, each) is not None for each in found)
    assert all(each.setpoint <= 50.0 * held.upper for each in found)
