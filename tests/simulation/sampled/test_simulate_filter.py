"""A measurement filter: the compiled simulation against the plain one, the runtime and the continuous loop."""

from __future__ import annotations

import numpy as np
import pytest
from cases.traces import assert_demands_of_the_runtime, assert_equal_but_for_rounding

from fopi_tune.core.controller import FoPi, FoPid, Pid
from fopi_tune.core.loops import Plants
from fopi_tune.core.terms.measurement_filter import MeasurementFilter
from fopi_tune.digital import sections_of
from fopi_tune.digital.realise import Precision
from fopi_tune.digital.runtime import Runtime
from fopi_tune.errors import DomainError
from fopi_tune.simulation.sampled.plants import discretize_plants
from fopi_tune.simulation.sampled.reference import simulate_reference
from fopi_tune.simulation.sampled.simulate import simulate
from fopi_tune.simulation.scenario import Actuator, Hybrid, Mode, Scenario, Sensor, Signals, Start
from fopi_tune.spec.model import DigitalSpec

TS = 0.1
LEVELS = np.repeat([1.0, -0.5, 2.0], 80)
#: rounding of the plant's sums taken in another order, relative to signals of size 1 to 10
ROUNDING = 1e-12
FILTERS = [MeasurementFilter(1, 0.3), MeasurementFilter(2, 0.2)]
GAINS = [Pid(2.0, 1.0, 0.8, 0.15), FoPi(1.0, 0.7, 0.7), FoPi(1.5, 0.0, 1.0), FoPid(2.0, 1.0, 0.9, 0.4, 0.7, 0.15)]


def made(gains: FoPi, used: MeasurementFilter | None, weight: float = 1.0, rate: float | None = 1.0) -> Runtime:
    limits = None if rate is None else (-0.8, 2.5)
    return Runtime.of(sections_of(gains, DigitalSpec(TS)), Precision.FLOAT64, limits, rate, weight, used)


def lags(m: int) -> Plants:
    rng = np.random.default_rng(3)
    bottoms = np.array([np.poly(-rng.uniform(0.3, 2.0, 2)) for _ in range(m)]).astype(np.float64)
    return Plants(bottoms[:, -1:] * rng.uniform(0.8, 1.2, (m, 1)), bottoms, rng.uniform(0.0, 0.3, m))


@pytest.mark.thinned(3)
@pytest.mark.parametrize("used", FILTERS, ids=["first", "second"])
@pytest.mark.parametrize("gains", GAINS, ids=["pid", "fopi", "gain", "fopid"])
def test_the_kernel_with_a_filter_is_the_runtime_bit_for_bit(gains: FoPi, used: MeasurementFilter) -> None:
    for weight, sensor, actuator, start in (
        (1.0, Sensor(), Actuator(), Start()),
        (0.5, Sensor(0.02, 0.01, 5), Actuator(2.0, 1.3), Start(1.0)),
        (1.0, Sensor(0.02, 0.0, 5), Actuator(), Start(1.0, bumpless=True)),
    ):
        controller = made(gains, used, weight)
        mode, scenario = Mode(controller, lags(5)), Scenario(TS, Signals(LEVELS), sensor, actuator, start)
        traces = simulate([mode], scenario)
        held = discretize_plants(lags(5), TS, actuator.delay_samples)
        plain = simulate_reference([controller], [held], scenario)
        assert_equal_but_for_rounding(traces, plain, ROUNDING)
        if not start.bumpless:
            assert_demands_of_the_runtime(traces, controller, LEVELS)


@pytest.mark.long
@pytest.mark.parametrize("used", FILTERS, ids=["first", "second"])
def test_a_hundred_thousand_samples_with_a_filter_are_the_runtime_bit_for_bit(used: MeasurementFilter) -> None:
    levels = np.repeat(np.random.default_rng(8).uniform(-2.0, 3.0, 500), 200)
    controller = made(GAINS[0], used, 0.5)
    traces = simulate([Mode(controller, lags(1))], Scenario(TS, Signals(levels), Sensor(0.02, 0.01, 5)))
    assert_demands_of_the_runtime(traces, controller, levels)


@pytest.mark.parametrize("used", FILTERS, ids=["first", "second"])
def test_an_overflow_behind_a_filter_is_held_with_all_states(used: MeasurementFilter) -> None:
    unstable = Plants(np.full((1, 1), 4.0), np.array([[1.0, -2.0]]), np.zeros(1))
    controller = made(GAINS[0], used)
    traces = simulate([Mode(controller, unstable)], Scenario(TS, Signals(np.full(6000, 5.0))))
    assert not np.isfinite(traces.output).all()
    assert_demands_of_the_runtime(traces, controller, np.full(6000, 5.0))


@pytest.mark.parametrize("used", FILTERS, ids=["first", "second"])
def test_a_step_is_that_of_the_continuous_loop_as_samples_get_short(used: MeasurementFilter) -> None:
    from scipy.signal import lti
    from scipy.signal import step as step_of

    # r -> y of C P/(1 + F C P): the setpoint does not pass the filter
    kp, ki, tau, ts = 1.0, 0.7, 1.5, 0.002
    time = used.time_constant_s
    divisor = np.array([time, 1.0] if used.order == 1 else [time**2 / 2, time, 1.0])
    c, d = np.array([kp, ki]), np.polymul([1.0, 0.0], [tau, 1.0])
    t = np.arange(0.0, 8.0, ts)
    loop = lti(np.polymul(c, divisor), np.polyadd(np.polymul(d, divisor), c))
    wanted = np.asarray(step_of(loop, T=t)[1])
    sections = sections_of(FoPi(kp, ki, 1.0), DigitalSpec(ts))
    controller = Runtime.of(sections, Precision.FLOAT64, measurement_filter=used)
    plant = Plants(np.array([[1.0]]), np.array([[tau, 1.0]]), np.zeros(1))
    found = simulate([Mode(controller, plant)], Scenario(ts, Signals(np.ones(len(t))))).output[0]
    # a hold is late by half a sample, and the trapezoidal integral has half a sample at once
    assert np.abs(found - wanted).max() < 2.0 * ts


def test_two_controllers_that_take_turns_have_no_filter() -> None:
    modes = [Mode(made(FoPi(1.0, 1.0, 1.0), used, rate=None), lags(1)) for used in (FILTERS[0], None)]
    with pytest.raises(DomainError, match="no measurement_filter"):
        simulate(modes, Scenario(TS, Signals(LEVELS), hybrid=Hybrid(0.1)))
