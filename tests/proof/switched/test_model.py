"""The model of a system:  what it holds, which plants its vertices enclose, and what it cannot be made of."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from cases import switched
from flint import arb

from fopi_tune.core.plant import PlantFamily, Uncertain
from fopi_tune.errors import DomainError
from fopi_tune.proof.switched.definite import midpoints
from fopi_tune.proof.switched.model import SwitchedLoop, SwitchedModel, lag_at, lag_range, loop_matrices


def loop_with(family: PlantFamily) -> SwitchedLoop:
    return replace(switched.model("reset").loops[1], plant=family)


FAMILIES = [
    PlantFamily("lag", {
        "static_gain": Uncertain(1.0, 0.8, 1.3),
        "time_constant_s": Uncertain(2.0, 1.6, 3.1),
        "dead_time_s": Uncertain.exactly(0.0),
    }),
    PlantFamily("pole", {
        "gain": Uncertain(4.0, 3.5, 4.6),
        "pole_rad_s": Uncertain(0.2, 0.15, 0.3),
        "dead_time_s": Uncertain.exactly(0.0),
    }),
    PlantFamily("pole", {
        "gain": Uncertain(4.0, 3.5, 4.6),
        "pole_rad_s": Uncertain.exactly(0.2),
        "dead_time_s": Uncertain.exactly(0.0),
    }),
]  # fmt: skip


@pytest.mark.parametrize("family", FAMILIES)
def test_every_member_lies_between_the_ends(family: PlantFamily) -> None:
    loop, rng = loop_with(family), np.random.default_rng(1)
    ends = lag_range(loop, 0.2)
    for _ in range(50):
        point = {name: rng.uniform(n.min, n.max) for name, n in family.parameters.items() if not n.is_exact}
        share, gain = lag_at(loop, 0.2, point)
        # balls of the same number overlap
        for number, (low, high) in ((share, ends.shares), (gain, ends.gains)):
            assert not number < low
            assert not number > high
    assert len(ends.vertices) == (2 if family.parameters.get("pole_rad_s", Uncertain(0, 0, 1)).is_exact else 4)


def test_a_loop_keeps_its_equilibrium_and_follows_its_equations() -> None:
    loop = switched.model("reset").loops[0]
    share, gain = lag_at(loop, 0.2, {})
    assert float(share) == pytest.approx(-math.expm1(-0.1746 * 0.2), rel=1e-15)
    assert float(gain) == pytest.approx(4.39 / 0.1746, rel=1e-15)
    a, b, c = (midpoints(part) for part in loop_matrices(loop.controller, (share, gain)))
    # a step of 2 at rest: the output is pulled by the direct path alone
    z = np.eye(9)[0] * 2.0
    assert (c @ z)[0] == -2.0 * loop.controller.direct
    assert (a @ z)[0] == pytest.approx(2.0 * (1 - float(share)) - 2.0 * float(share * gain) * loop.controller.direct)
    # what is cut off does not reach the plant
    assert b[0, 0] == pytest.approx(-float(share * gain), rel=1e-15)


def test_a_mode_without_gains_is_named() -> None:
    with pytest.raises(DomainError, match="there are no gains of brake"):
        SwitchedModel.of(switched.CAR, {"throttle": switched.GAINS["throttle"]})


def test_what_is_outside_of_the_methods_is_said() -> None:
    model = switched.model("tracking")
    throttle, brake = model.loops
    late = PlantFamily("lag", {**brake.plant.parameters, "dead_time_s": Uncertain.exactly(0.1)})
    unstable = PlantFamily("pole", {**throttle.plant.parameters, "pole_rad_s": Uncertain.exactly(-0.1)})
    wide = replace(brake.controller, limits=(-1.0, 0.5))
    assert model.obstacle == ""
    for loops, words in (
        ((throttle, replace(brake, plant=late)), "dead time"),
        ((throttle, replace(brake, delay_samples=1.0)), "computing delay"),
        ((replace(throttle, plant=unstable), brake), "not stable by itself"),
        ((throttle, replace(brake, controller=wide)), "overlap"),
    ):
        assert words in replace(model, loops=loops).obstacle


def test_the_output_at_rest_needs_the_control_over_the_gain() -> None:
    share, gain = lag_at(switched.model("reset").loops[0], 0.2, {})
    assert abs(float(share * gain * (arb(10) / gain) - share * 10)) < 1e-15
