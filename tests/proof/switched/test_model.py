"""The model of a system:  what it holds, which plants its vertices enclose, and what it cannot be made of."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from cases import switched
from cases.parametric_plants import family_of
from flint import arb

from fopi_tune.core.plant import PlantFamily, Uncertain
from fopi_tune.errors import DomainError
from fopi_tune.proof.switched.definite import midpoints
from fopi_tune.proof.switched.model import SwitchedLoop, SwitchedModel, lag_at, lag_range, loop_matrices, plant_obstacle


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


def test_plants_by_named_parameters_are_refused_by_name() -> None:
    linked = family_of({"T": (1.0, 2.0)}, ["T"], ["T", 1])
    assert plant_obstacle(loop_with(linked)).startswith("plants by named parameters")


@pytest.mark.parametrize("family", FAMILIES)
def test_every_member_lies_between_the_ends(family: PlantFamily) -> None:
    loop, rng = loop_with(family), np.random.default_rng(1)
    ends = lag_range(loop, 0.2)
    for _ in range(50):
        point = {name: rng.uniform(n.min, n.max) for name, n in family.parameters.items() if not n.is_exact}
        lag = lag_at(loop, 0.2, point)
        # balls of the same number overlap
        for number, (low, high) in ((lag.share, ends.shares), (lag.gain, ends.gains)):
            assert not number < low
            assert not number > high
    assert len(ends.vertices) == (2 if family.parameters.get("pole_rad_s", Uncertain(0, 0, 1)).is_exact else 4)


def test_a_loop_keeps_its_equilibrium_and_follows_its_equations() -> None:
    loop = switched.model("reset").loops[0]
    lag = lag_at(loop, 0.2, {})
    share, gain = lag.share, lag.gain
    assert float(share) == pytest.approx(-math.expm1(-0.1746 * 0.2), rel=1e-15)
    assert float(gain) == pytest.approx(4.39 / 0.1746, rel=1e-15)
    a, b, c = (midpoints(part) for part in loop_matrices(loop.controller, lag))
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
        ((throttle, replace(brake, delay_samples=1.5)), "computing delay"),
        ((replace(throttle, plant=unstable), brake), "not stable by itself"),
        ((throttle, replace(brake, controller=wide)), "overlap"),
    ):
        assert words in replace(model, loops=loops).obstacle


def test_the_output_at_rest_needs_the_control_over_the_gain() -> None:
    lag = lag_at(switched.model("reset").loops[0], 0.2, {})
    assert abs(float(lag.share * lag.gain * (arb(10) / lag.gain) - lag.share * 10)) < 1e-15


@pytest.mark.parametrize("family", FAMILIES[:2])
@pytest.mark.parametrize("delay", [0.0, 0.3, 1.0])
def test_every_member_is_a_mixture_of_the_vertices(family: PlantFamily, delay: float) -> None:
    loop, rng = replace(loop_with(family), delay_samples=delay), np.random.default_rng(2)
    vertices = lag_range(loop, 0.2).vertices
    ends = [[float(getattr(each, name) or 0.0) for each in vertices] for name in ("late", "share", "gain")]
    for _ in range(20):
        point = {name: rng.uniform(n.min, n.max) for name, n in family.parameters.items() if not n.is_exact}
        lag = lag_at(loop, 0.2, point)
        numbers = [float(lag.late or 0.0), float(lag.share), float(lag.gain)]
        # the product of where each number lies between its ends
        weights = np.ones(len(vertices))
        for number, values in zip(numbers, ends, strict=True):
            low, high = min(values), max(values)
            part = (number - low) / (high - low) if high > low else 1.0
            weights *= [part if value == high else 1.0 - part for value in values]
        assert weights.min() >= -1e-12
        assert weights.sum() == pytest.approx(1.0)
        mixed = sum(w * midpoints(loop_matrices(loop.controller, v)[0]) for w, v in zip(weights, vertices, strict=True))
        assert mixed == pytest.approx(midpoints(loop_matrices(loop.controller, lag)[0]), abs=1e-13)


def test_a_late_control_acts_as_in_continuous_time() -> None:
    loop = replace(switched.model("reset").loops[0], delay_samples=0.3)
    a, b, c = (midpoints(part) for part in loop_matrices(loop.controller, lag_at(loop, 0.2, {})))
    rng = np.random.default_rng(3)
    z = rng.normal(size=len(a))
    demanded = (c @ z)[0]
    y, pole, gain = z[0], 0.1746, 4.39 / 0.1746
    for control, time in ((z[-1], 0.06), (demanded - 0.7, 0.14)):
        y = y * math.exp(-pole * time) - math.expm1(-pole * time) * gain * control
    after = a @ z + 0.7 * b[:, 0]
    assert after[0] == pytest.approx(y, rel=1e-13)
    assert after[-1] == pytest.approx(demanded - 0.7, rel=1e-13)


def test_delays_that_differ_are_told() -> None:
    model = switched.model("reset", 0.4)
    assert model.obstacle == ""
    other = replace(model.loops[1], delay_samples=0.0)
    assert "delays that differ" in replace(model, loops=(model.loops[0], other)).obstacle
