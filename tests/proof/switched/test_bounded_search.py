"""The search for bounds: as few samples as needed, and the least numbers that the program allows."""

from __future__ import annotations

from dataclasses import replace

import pytest
from cases import switched

from fopi_tune.core.plant import PlantFamily, Uncertain
from fopi_tune.proof.switched.bounded import verify_bounded
from fopi_tune.proof.switched.bounded_search import prove_bounded


@pytest.mark.thinned(2)
@pytest.mark.parametrize("memory", ["reset", "tracking"])
def test_smaller_bounds_are_not_accepted(memory: str) -> None:
    model = switched.model(memory)
    found = prove_bounded(model, None).proof
    assert found is not None
    assert verify_bounded(model, found)
    first, second = found.memories
    assert first is not None
    assert second is not None
    # the slowest other section's bound is at its least: all shrunk together are too small
    shrunk = replace(first, sections=tuple(0.98 * each for each in first.sections))
    assert not verify_bounded(model, replace(found, memories=(shrunk, second)))
    assert not verify_bounded(model, replace(found, memories=(first, replace(second, total=0.98 * second.total))))


def test_a_loop_outside_of_the_methods_is_told() -> None:
    model = switched.model("reset")
    late = replace(model.loops[0], delay_samples=1.5)
    found = prove_bounded(replace(model, loops=(late, model.loops[1])), None)
    assert found.proof is None
    assert found.reason.startswith("throttle: ")


def test_an_output_that_is_no_double_is_bounded() -> None:
    # 2.5 times the double -0.4 lies below -1, by less than a double there can tell
    model = switched.model("reset")
    throttle, brake = model.loops
    strong = PlantFamily("lag", {**brake.plant.parameters, "static_gain": Uncertain(2.5, 2.5, 2.5)})
    weak = replace(brake, plant=strong, controller=replace(brake.controller, limits=(-0.4, 0.0)))
    found = prove_bounded(replace(model, loops=(throttle, weak)), None)
    assert found.reason == ""
    assert found.proof is not None
    assert -1.2 < found.proof.outputs[0] < -1.0
