"""Two controllers that take turns: the compiled simulation's arithmetic bit for bit, and samples that are held."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from fopi_tune.core.controller import FoPi
from fopi_tune.core.loops import Plants
from fopi_tune.digital.discretize import discretize
from fopi_tune.digital.realise import Precision
from fopi_tune.digital.runtime import Runtime
from fopi_tune.digital.switched_runtime import (
    Memory,
    SwitchedRuntime,
    SwitchedState,
    Switching,
    init,
    replay,
    reset,
    step,
)
from fopi_tune.digital.vectors import Op, Operation
from fopi_tune.errors import DomainError
from fopi_tune.simulation.sampled.simulate import simulate
from fopi_tune.simulation.scenario import (
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


def made(gains: FoPi, limits: tuple[float, float], precision: Precision = Precision.FLOAT64, poles: int = 7) -> Runtime:
    return Runtime.of(discretized(gains, DigitalSpec(TS, "oustaloup", poles)).sections, precision, limits)


def pair_of(switching: Switching, precision: Precision = Precision.FLOAT64) -> SwitchedRuntime:
    throttle = made(FoPi(0.09, 0.025, 0.8), (0.0, 1.0), precision)
    return SwitchedRuntime((throttle, made(FoPi(0.07, 0.11, 0.45), (-1.0, 0.0), precision, 5)), switching)


def simulated(pair: SwitchedRuntime, samples: int, noise_std: float, wild: bool = False) -> tuple[np.ndarray, Traces]:
    """The reference and the traces of six plants; of a wild pair the first one's output overflows."""
    rng = np.random.default_rng(3)
    throttle = np.c_[np.ones(6), rng.uniform(0.1, 0.3, 6)]
    brake = np.c_[rng.uniform(1.6, 3.1, 6), np.ones(6)]
    if wild:
        throttle[0, 1], brake[0, 1] = -8.0, -12.0
    plants = Plants(rng.uniform(4.0, 5.0, (6, 1)), throttle, np.zeros(6)), Plants(np.ones((6, 1)), brake, np.zeros(6))
    modes = [Mode(controller, each) for controller, each in zip(pair.controllers, plants, strict=True)]
    # steps large enough for both limits, and a rest in which everything decays
    levels = np.repeat(np.array([18.0, 6.0, 10.0, 24.0, 3.0, 0.0]), -(-samples // 6))[:samples]
    hybrid = Hybrid(
        pair.lines,
        InactiveController.of(pair.switching.memory),
        1 + pair.switching.first,
        min_dwell_samples=pair.switching.min_dwell_samples,
    )
    scenario = Scenario(
        TS, Signals(levels), Sensor(0.0, noise_std, 5), start=Start(2.0, InitialInput.FREE), hybrid=hybrid
    )
    return levels, simulate(modes, scenario)


@pytest.mark.thinned(5)
@pytest.mark.parametrize("dwell", [0, 1, 2, 9])
@pytest.mark.parametrize("memory", Memory)
def test_the_pair_is_the_compiled_simulation_bit_for_bit(memory: Memory, dwell: int) -> None:
    switches, both_limits = 0, set[float]()
    for first, noise in ((0, 0.3), (1, 0.0)):
        pair = pair_of(Switching(0.4, memory, dwell, first))
        levels, traces = simulated(pair, 600, noise)
        for measured, demanded, mode in zip(traces.measured, traces.demanded, traces.mode, strict=True):
            steps = zip(levels, measured, strict=True)
            outputs, modes = replay(pair, [Operation(Op.STEP, float(r), float(y)) for r, y in steps])
            assert outputs.tobytes() == demanded.tobytes()
            np.testing.assert_array_equal(modes + 1, mode)
            switches += int(np.sum(mode[1:] != mode[:-1]))
            both_limits |= {-1.0, 0.0, 1.0} & set(demanded.tolist())
    assert switches > 40
    assert both_limits >= {-1.0, 1.0}


@pytest.mark.parametrize("memory", Memory)
def test_an_output_that_overflows_is_held_as_in_the_compiled_simulation(memory: Memory) -> None:
    pair = pair_of(Switching(0.4, memory, 3))
    levels, traces = simulated(pair, 700, 0.3, wild=True)
    measured = traces.measured[0]
    assert not np.isfinite(measured).all()
    outputs, modes = replay(
        pair, [Operation(Op.STEP, float(r), float(y)) for r, y in zip(levels, measured, strict=True)]
    )
    assert outputs.tobytes() == traces.demanded[0].tobytes()
    np.testing.assert_array_equal(modes + 1, traces.mode[0])


def driven(pair: SwitchedRuntime, state: SwitchedState, measurements: list[float]) -> list[SwitchedState]:
    found = []
    for measurement in measurements:
        state = step(pair, state, 10.0, measurement)
        found.append(state)
    return found


@pytest.mark.thinned(5)
@pytest.mark.parametrize("precision", Precision)
@pytest.mark.parametrize("memory", Memory)
@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
def test_a_measurement_that_is_no_number_changes_nothing_but_the_time(
    value: float, memory: Memory, precision: Precision
) -> None:
    pair = pair_of(Switching(0.5, memory, 4), precision)
    states = driven(pair, init(pair), [8.0, 9.0, 12.0, 11.0])
    before = states[-1]
    assert [each.mode for each in states] == [0, 0, 1, 1]
    held = driven(pair, before, [value])[0]
    assert (held.mode, held.output) == (1, before.output)
    for one, two in zip(held.controllers, before.controllers, strict=True):
        assert one.x.tobytes() == two.x.tobytes()
    # two samples of the dwell are over; the third was the bad one; the fourth may leave
    after = driven(pair, held, [5.0, 5.0])
    assert [each.mode for each in after] == [1, 0]
    assert held.stayed == before.stayed + 1


def test_the_first_mode_may_be_left_at_once_and_a_reset_begins_there_at_rest() -> None:
    for first in (0, 1):
        pair = pair_of(Switching(0.5, Memory.HELD, 50, first))
        assert step(pair, init(pair), 10.0, 30.0 if first == 0 else 2.0).mode == 1 - first
        state = reset(pair, 0.25 - first)
        assert state.mode == first
        assert step(pair, state, 10.0, 10.0).output == 0.25 - first


@pytest.mark.thinned(2)
@pytest.mark.parametrize("precision", Precision)
def test_at_rest_the_states_become_zero(precision: Precision) -> None:
    for memory in Memory:
        pair = pair_of(Switching(0.5, memory), precision)
        state = driven(pair, init(pair), [8.0, 9.0, 12.0, 11.0])[-1]
        for _ in range(4000):
            state = step(pair, state, 10.0, 10.0)
        flush = float(pair.precision.flush_below)
        decaying = [controller.x[1:] for controller in state.controllers]
        assert all(np.all((row == 0.0) | (np.abs(row) >= flush)) for row in decaying)
        # the fast sections of the active controller have forgotten
        assert np.any(decaying[state.mode] == 0.0) or precision is Precision.FLOAT64


def test_what_is_no_pair_is_refused() -> None:
    with pytest.raises(DomainError, match="hysteresis"):
        pair_of(Switching(1e39), Precision.FLOAT32)
    with pytest.raises(DomainError, match="hysteresis"):
        pair_of(Switching(-0.1))
    with pytest.raises(DomainError, match="dwell"):
        pair_of(Switching(0.5, min_dwell_samples=-1))
    with pytest.raises(DomainError, match="first"):
        pair_of(replace(Switching(0.5), first=2))
    with pytest.raises(DomainError, match="no operation track"):
        replay(pair_of(Switching(0.5)), [Operation(Op.TRACK)])
