"""Controllers that limit their output's rate: the compiled simulation against the plain one, one loop and two modes."""

from __future__ import annotations

import dataclasses
from functools import cache

import numpy as np
import pytest

from fopi_tune.core.controller import FoPi
from fopi_tune.core.loops import Plants
from fopi_tune.digital.discretize import discretize
from fopi_tune.digital.realise import Precision
from fopi_tune.digital.runtime import Runtime
from fopi_tune.digital.vectors import Op, Operation, replay
from fopi_tune.simulation.sampled.plants import discretize_plants
from fopi_tune.simulation.sampled.reference import simulate_reference
from fopi_tune.simulation.sampled.simulate import measure, simulate
from fopi_tune.simulation.scenario import (
    Actuator,
    Horizon,
    Hybrid,
    InactiveController,
    InitialInput,
    Mode,
    Scenario,
    Sensor,
    Signals,
    Start,
    Traces,
)
from fopi_tune.spec.model import DigitalSpec

#: to measure what rounding does to a filter takes a tenth of a second
discretized = cache(discretize)

TS = 0.2
STEPS = 150
LEVELS = np.repeat([18.0, 6.0, 10.0], STEPS // 3)
#: rounding of the plant's sums taken in another order, relative to signals of size 1 to 30
ROUNDING = 1e-12


def made(gains: FoPi, limits: tuple[float, float], rate_per_s: float | None, poles: int = 7) -> Runtime:
    sections = discretized(gains, DigitalSpec(TS, "oustaloup", poles)).sections
    return Runtime.of(sections, Precision.FLOAT64, limits, rate_per_s)


def second_order(m: int) -> Plants:
    rng = np.random.default_rng(3)
    bottoms = np.array([np.poly(-rng.uniform(0.1, 2.0, 2)) for _ in range(m)]).astype(np.float64)
    return Plants(rng.uniform(0.2, 1.0, (m, 2)), bottoms, rng.uniform(0.0, 0.9, m))


def two_modes(rates: tuple[float | None, float | None], m: int = 10) -> list[Mode]:
    rng = np.random.default_rng(1)
    throttle = Plants(rng.uniform(4.0, 5.0, (m, 1)), np.c_[np.ones(m), rng.uniform(0.1, 0.3, m)], np.zeros(m))
    brake = Plants(np.ones((m, 1)), np.c_[rng.uniform(1.6, 3.1, m), np.ones(m)], np.zeros(m))
    controllers = (
        made(FoPi(0.09, 0.025, 0.8), (-0.2, 1.0), rates[0]),
        made(FoPi(0.07, 0.11, 0.45), (-1.0, 0.1), rates[1], 5),
    )
    return [Mode(controller, plants) for controller, plants in zip(controllers, (throttle, brake), strict=True)]


def plainly(modes: list[Mode], scenario: Scenario) -> Traces:
    held = [
        discretize_plants(mode.plants, TS, scenario.actuator.delay_samples)
        for mode in modes
        if isinstance(mode.plants, Plants)
    ]
    return simulate_reference([mode.controller for mode in modes], held, scenario)


def assert_same(one: Traces, two: Traces) -> None:
    for name in ("output", "measured", "error", "demanded", "applied", "mode"):
        np.testing.assert_allclose(getattr(one, name), getattr(two, name), rtol=ROUNDING, atol=ROUNDING, err_msg=name)


@pytest.mark.thinned(2)
@pytest.mark.parametrize(
    "actuator", [Actuator(), Actuator(2.0, 1.3), Actuator(0.4)], ids=["none", "faster and late", "slower"]
)
def test_the_kernel_limits_the_rate_as_the_runtime_does(actuator: Actuator) -> None:
    modes = [Mode(made(FoPi(0.3, 0.1, 0.7), (-4.0, 30.0), 1.0), second_order(5))]
    for sensor, start in ((Sensor(), Start(2.0, bumpless=True)), (Sensor(0.05, 0.2, 5), Start())):
        scenario = Scenario(TS, Signals(LEVELS), sensor, actuator, start)
        traces = simulate(modes, scenario)
        assert_same(traces, plainly(modes, scenario))
        moves = np.abs(np.diff(traces.demanded, axis=1))
        assert moves.max() <= 0.2 * (1.0 + 1e-12)
        assert np.mean(moves > 0.199) > 0.1
        # the controller's arithmetic is the runtime's to the last bit, where it starts as `init` does
        if not start.bumpless:
            steps = zip(LEVELS.tolist(), traces.measured[0].tolist(), strict=True)
            own = replay(modes[0].controller, [Operation(Op.STEP, r, y) for r, y in steps])
            assert own.tobytes() == traces.demanded[0].tobytes()


def test_an_output_that_overflows_is_held_at_its_rate() -> None:
    unstable = Plants(np.full((1, 1), 4.0), np.array([[1.0, -2.0]]), np.zeros(1))
    modes = [Mode(made(FoPi(0.3, 0.1, 0.7), (-4.0, 4.0), 1.0), unstable)]
    scenario = Scenario(TS, Signals(np.full(3000, 5.0)))
    traces = simulate(modes, scenario)
    assert not np.isfinite(traces.output).all()
    steps = [Operation(Op.STEP, 5.0, float(y)) for y in traces.measured[0]]
    assert replay(modes[0].controller, steps).tobytes() == traces.demanded[0].tobytes()


@pytest.mark.thinned(4)
@pytest.mark.parametrize("rates", [(0.3, 0.5), (None, 0.5), (0.3, None)], ids=["both", "brake", "throttle"])
@pytest.mark.parametrize("inactive", InactiveController)
def test_modes_take_over_the_output_of_each_other(
    inactive: InactiveController, rates: tuple[float | None, float | None]
) -> None:
    modes = two_modes(rates)
    for sensor, actuator, first in ((Sensor(0.01, 0.2, 5), Actuator(), 1), (Sensor(), Actuator(1.0, 0.6), 2)):
        hybrid = Hybrid(0.3, inactive, first, 3, 1.5)
        start = Start(2.0, InitialInput.FREE)
        scenario = Scenario(TS, Signals(LEVELS), sensor, actuator, start, hybrid)
        traces = simulate(modes, scenario)
        assert_same(traces, plainly(modes, scenario))
        assert set(np.unique(traces.mode)) == {1, 2}
        if actuator.rate_per_s == np.inf:
            # the shared actuator: over a change of the mode too, but for the cut to the new mode's limits
            for mode, rate in zip((1, 2), rates, strict=True):
                own = (traces.mode[:, 1:] == mode) & (rate is not None)
                low, high = modes[mode - 1].controller.limits
                before = np.clip(traces.demanded[:, :-1], low, high)
                moves = np.abs(traces.demanded[:, 1:] - before)[own]
                assert moves.max(initial=0.0) <= (rate or 0.0) * TS * (1.0 + 1e-12)


def test_a_rate_that_is_never_reached_changes_no_bit_of_the_measures() -> None:
    for inactive in InactiveController:
        scenario = Scenario(TS, Signals(LEVELS), Sensor(0.0, 0.2, 5), hybrid=Hybrid(0.3, inactive))
        found = [measure(two_modes(rates), scenario, Horizon(0.5)) for rates in ((None, None), (1e3, 1e3))]
        for field in dataclasses.fields(found[0]):
            np.testing.assert_array_equal(getattr(found[0], field.name), getattr(found[1], field.name))
