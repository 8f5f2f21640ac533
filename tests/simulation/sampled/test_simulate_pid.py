"""A derivative and a setpoint weight: the compiled simulation against the plain one, the runtime and recursions."""

from __future__ import annotations

import math

import numpy as np
import pytest
from cases.traces import assert_demands_of_the_runtime, assert_equal_but_for_rounding

from fopi_tune.core.controller import FoPi, FoPid, Pid
from fopi_tune.core.loops import Plants
from fopi_tune.digital import sections_of
from fopi_tune.digital.realise import Precision
from fopi_tune.digital.runtime import Runtime, init, step
from fopi_tune.errors import DomainError
from fopi_tune.simulation.sampled.plants import discretize_plants
from fopi_tune.simulation.sampled.reference import simulate_reference
from fopi_tune.simulation.sampled.simulate import measure, simulate
from fopi_tune.simulation.scenario import Actuator, Horizon, Hybrid, Mode, Scenario, Sensor, Signals, Start, Traces
from fopi_tune.spec.model import DigitalSpec

TS = 0.1
STEPS = 240
LEVELS = np.repeat([1.0, -0.5, 2.0], STEPS // 3)
#: rounding of the plant's sums taken in another order, relative to signals of size 1 to 10
ROUNDING = 1e-12
PID = Pid(2.0, 1.0, 0.8, 0.15)
FOPID = FoPid(2.0, 1.0, 0.9, 0.8, 0.7, 0.15)
LAG_S = 1.5
RATE = 1.0


def made(
    gains: FoPi, weight: float = 1.0, limits: tuple[float, float] | None = None, rate_per_s: float | None = None
) -> Runtime:
    return Runtime.of(sections_of(gains, DigitalSpec(TS)), Precision.FLOAT64, limits, rate_per_s, weight)


def lags(m: int, order: int = 2) -> Plants:
    rng = np.random.default_rng(3)
    bottoms = np.array([np.poly(-rng.uniform(0.3, 2.0, order)) for _ in range(m)]).astype(np.float64)
    return Plants(bottoms[:, -1:] * rng.uniform(0.8, 1.2, (m, 1)), bottoms, rng.uniform(0.0, 0.3, m))


def plainly(mode: Mode, scenario: Scenario) -> Traces:
    assert isinstance(mode.plants, Plants)
    held = discretize_plants(mode.plants, TS, scenario.actuator.delay_samples)
    return simulate_reference([mode.controller], [held], scenario)


def by_hand(pid: Pid, b: float, reference: list[float], start: float) -> list[float]:
    """The output of a lag behind a hold and a PID as in a textbook: its derivative by differences of y."""
    tf, decay = pid.derivative_filter_time_constant_s, math.exp(-TS / LAG_S)
    y, integral, derivative, before, error_before, found = start, start, 0.0, start, 0.0, []
    # at rest the control that holds y is y, with r = y before the first sample
    integral -= pid.kp * (b - 1.0) * start
    for k, r in enumerate(reference):
        found.append(y)
        # trapezoidal integral; Tustin's rule for D (Tf s + 1) = -kd s y
        integral += pid.ki * 0.5 * TS * ((r - y) + error_before)
        if k > 0:
            derivative = ((2.0 * tf - TS) * derivative - 2.0 * pid.kd * (y - before)) / (2.0 * tf + TS)
        u = pid.kp * (b * r - y) + integral + derivative
        error_before, before = r - y, y
        y = decay * y + (1.0 - decay) * u
    return found


@pytest.mark.parametrize("b", [0.0, 0.4, 1.0])
@pytest.mark.parametrize("start", [0.0, 3.0])
def test_a_step_of_a_pid_is_that_of_a_textbooks_recursion(b: float, start: float) -> None:
    plant = Plants(np.array([[1.0]]), np.array([[LAG_S, 1.0]]), np.zeros(1))
    reference = np.repeat([start + 1.0, start - 2.0], STEPS // 2)
    scenario = Scenario(TS, Signals(reference), start=Start(start, bumpless=True))
    found = simulate([Mode(made(PID, b), plant)], scenario).output[0]
    np.testing.assert_allclose(found, by_hand(PID, b, reference.tolist(), start), rtol=0.0, atol=1e-12)
    # the loop settles, so that the comparison is of a response and not of a divergence
    assert abs(found[-1] - reference[-1]) < 0.05


@pytest.mark.thinned(10)
@pytest.mark.parametrize(
    "gains",
    [PID, Pid(2.0, 0.0, 0.8, 0.15), Pid(0.0, 1.0, 0.3, 0.05), FoPi(2.0, 1.0, 0.7), FOPID,
     FoPid(2.0, 0.0, 1.0, 0.8, 0.4, 0.15)],
    ids=str,
)  # fmt: skip
@pytest.mark.parametrize("b", [0.0, 0.5, 1.0])
def test_the_kernel_is_the_runtime_bit_for_bit(gains: FoPi, b: float) -> None:
    controller = made(gains, b, (-0.8, 2.5), RATE)
    mode = Mode(controller, lags(5))
    for sensor, actuator, start in (
        (Sensor(), Actuator(), Start()),
        (Sensor(0.02, 0.01, 5), Actuator(2.0, 1.3), Start(1.0)),
        (Sensor(0.02, 0.0, 5), Actuator(), Start(1.0, bumpless=True)),
    ):
        scenario = Scenario(TS, Signals(LEVELS), sensor, actuator, start)
        traces, plain = simulate([mode], scenario), plainly(mode, scenario)
        assert_equal_but_for_rounding(traces, plain, ROUNDING)
        if not start.bumpless:
            assert_demands_of_the_runtime(traces, controller, LEVELS)
        # limits and rate are reached, so that the anti-windup is compared too
        assert gains.ki == 0.0 or np.mean(np.abs(np.diff(traces.demanded, axis=1)) > 0.999 * TS * RATE) > 0.01
        assert 0.0 in (gains.kp, gains.ki) or np.mean(traces.demanded == -0.8) > 0.01


@pytest.mark.long
@pytest.mark.parametrize("gains", [PID, FOPID], ids=["pid", "fopid"])
def test_a_hundred_thousand_samples_are_the_runtime_bit_for_bit(gains: FoPid) -> None:
    controller, levels = made(gains, 0.5, (-0.8, 2.5), RATE), np.random.default_rng(8).uniform(-2.0, 3.0, 500)
    scenario = Scenario(TS, Signals(np.repeat(levels, 200)), Sensor(0.02, 0.01, 5))
    traces = simulate([Mode(controller, lags(1))], scenario)
    assert_demands_of_the_runtime(traces, controller, np.repeat(levels, 200))


@pytest.mark.parametrize("gains", [PID, FOPID], ids=["pid", "fopid"])
@pytest.mark.parametrize("b", [0.0, 1.0])
def test_an_output_that_overflows_is_held_with_all_states(gains: FoPid, b: float) -> None:
    unstable = Plants(np.full((1, 1), 4.0), np.array([[1.0, -2.0]]), np.zeros(1))
    controller = made(gains, b, (-0.5, 0.5))
    scenario = Scenario(TS, Signals(np.full(6000, 5.0)))
    traces = simulate([Mode(controller, unstable)], scenario)
    assert not np.isfinite(traces.output).all()
    assert_demands_of_the_runtime(traces, controller, np.full(6000, 5.0))


@pytest.mark.parametrize("gains", [Pid(2e101, 1e101, 1e101, 0.15), FoPid(2e101, 1e101, 0.8, 1e101, 0.6, 0.15)], ids=str)
@pytest.mark.parametrize("b", [0.0, 0.5])
def test_coefficients_so_large_that_every_number_is_checked_change_no_bit(gains: FoPid, b: float) -> None:
    controller = made(gains, b, (-1.0, 1.0))
    traces = simulate([Mode(controller, lags(3))], Scenario(TS, Signals(LEVELS), Sensor(0.1, 0.0, 2)))
    assert_demands_of_the_runtime(traces, controller, LEVELS)


def test_a_step_of_the_setpoint_is_no_kick_of_the_derivative() -> None:
    plant = Plants(np.array([[1.0]]), np.array([[LAG_S, 1.0]]), np.zeros(1))
    first = {}
    for b in (0.0, 0.5, 1.0):
        traces = simulate([Mode(made(PID, b), plant)], Scenario(TS, Signals(np.ones(20))))
        first[b] = traces.demanded[0, 0]
    # kp b and the half sample of the trapezoidal integral; kd/Tf would be 5.3 more
    assert first == {b: pytest.approx(PID.kp * b + 0.5 * TS * PID.ki, rel=1e-14) for b in first}


@pytest.mark.parametrize("gains", [PID, FOPID], ids=["pid", "fopid"])
def test_a_loop_that_starts_at_rest_stays_there_whatever_the_weight_and_the_level(gains: FoPid) -> None:
    for b in (0.0, 0.5, 1.0):
        scenario = Scenario(TS, Signals(np.full(50, 20.0)), start=Start(20.0, bumpless=True))
        traces = simulate([Mode(made(gains, b), lags(3))], scenario)
        # rounding of numbers of size 40, and of the initial state that holds the plant there
        np.testing.assert_allclose(traces.output, 20.0, atol=1e-10)


def test_measures_are_those_of_the_traces() -> None:
    mode, scenario = Mode(made(PID, 0.5, (-0.8, 2.5)), lags(40)), Scenario(TS, Signals(np.ones(200)))
    traces, found = simulate([mode], scenario), measure([mode], scenario, Horizon(0.02))
    np.testing.assert_allclose(found.iae, TS * np.abs(1.0 - traces.output).sum(axis=1), rtol=1e-12)
    np.testing.assert_allclose(found.peak_control, np.abs(traces.demanded).max(axis=1), rtol=1e-15)


def test_two_modes_refuse_a_weight() -> None:
    plant = Plants(np.array([[1.0]]), np.array([[LAG_S, 1.0]]), np.zeros(1))
    scenario = Scenario(TS, Signals(np.ones(5)), hybrid=Hybrid(0.1))
    for controller in (made(PID, 0.5), made(FOPID, 0.5), made(FoPi(1.0, 1.0, 0.8), 0.5)):
        with pytest.raises(DomainError, match="that take turns have setpoint_weight: 1"):
            simulate([Mode(controller, plant), Mode(controller, plant)], scenario)


def overshoot_of(pid: Pid, low: float, high: float, rate_per_s: float, reference: float, steps: int) -> float:
    """Overshoot of a textbook's PID without anti-windup, before limits of value and rate and two equal lags."""
    tf, decay = pid.derivative_filter_time_constant_s, math.exp(-TS / LAG_S)
    x = y = integral = derivative = before = last = peak = 0.0
    for _ in range(steps):
        derivative = ((2.0 * tf - TS) * derivative - 2.0 * pid.kd * (y - before)) / (2.0 * tf + TS)
        before, e = y, reference - y
        wanted = min(max(pid.kp * e + integral + derivative, low), high)
        last = min(max(wanted, last - rate_per_s * TS), last + rate_per_s * TS)
        integral += pid.ki * TS * e
        x, y = decay * x + (1.0 - decay) * last, decay * y + (1.0 - decay) * x
        peak = max(peak, y)
    return peak / reference - 1.0


@pytest.mark.parametrize(("alpha", "mu"), [(1.0, 1.0), (1.05, 0.9), (0.95, 0.95)])
def test_the_integral_does_not_wind_up_at_limits_of_value_and_rate(alpha: float, mu: float) -> None:
    pid, limits, rate = Pid(6.0, 2.0, 4.0, 0.2), (-1.5, 1.5), 0.8
    # two equal lags in a row, sampled one behind the other as in `overshoot_of`
    decay = math.exp(-TS / LAG_S)
    assert overshoot_of(pid, *limits, rate, 1.0, 300) > 0.2
    controller = made(FoPid(6.0, 2.0, alpha, 4.0, mu, 0.2), 1.0, limits, rate)
    x = y = peak = 0.0
    state = init(controller)
    for _ in range(300):
        state = step(controller, state, 1.0, y)
        u = float(state.output)
        x, y = decay * x + (1.0 - decay) * u, decay * y + (1.0 - decay) * x
        peak = max(peak, y)
    assert peak - 1.0 < 0.05
    # a slow integral creeps to the setpoint
    assert abs(y - 1.0) < (1e-3 if alpha == 1.0 else 2e-2)
