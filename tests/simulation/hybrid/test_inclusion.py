"""The hybrid car: against closed forms, SciPy's integrator with events, and a dense grid of samples."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import mpmath
import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp
from scipy.special import lambertw

from fopi_tune.core.controller import FoPi
from fopi_tune.core.plant import Plant
from fopi_tune.digital.oustaloup import ZeroPoleGain, oustaloup
from fopi_tune.errors import DomainError
from fopi_tune.simulation.fractional.linear import Signal, exact_response
from fopi_tune.simulation.hybrid.flow import Flow, ModeLoop, Regime
from fopi_tune.simulation.hybrid.inclusion import simulate_hybrid
from fopi_tune.simulation.hybrid.model import (
    Corner,
    HybridCar,
    HybridOutcome,
    HybridResponse,
    HybridStart,
    Memory,
    Mode,
    Watch,
)

Array = NDArray[np.float64]
BAND = (1e-3, 1e3)
FREE = (-math.inf, math.inf)
IDLE = FoPi(0.0, 0.0, 1.0)
#: tolerance of event times, s
LOCATED_S = 1e-9


def papers_car(eps: float, memory: Memory = Memory.HELD, limited: bool = False) -> HybridCar:
    throttle = ModeLoop(4.39, 0.1746, FoPi(0.09, 0.025, 0.8), oustaloup(0.8, 7, BAND), (0.0, 1.0) if limited else FREE)
    brake = ModeLoop(
        1 / 2.25, 1 / 2.25, FoPi(0.07, 0.11, 0.45), oustaloup(0.45, 7, BAND), (-1.0, 0.0) if limited else FREE
    )
    return HybridCar(throttle, brake, eps, memory)


PAPERS_STEPS = (Corner(0.0, 30.0), Corner(20.0, 15.0), Corner(60.0, 25.0))
#: y = 30 km/h held by the throttle
CRUISING_CONTROL = 0.1746 * 30.0 / 4.39
CRUISING = HybridStart(30.0, Mode.THROTTLE, CRUISING_CONTROL)


def coasting(pole: float, eps: float = 0.0) -> HybridCar:
    """Both modes y' = -pole y, without control."""
    return HybridCar(ModeLoop(1.0, pole, IDLE), ModeLoop(1.0, pole, IDLE), eps)


def times_of(run: HybridResponse) -> list[float]:
    return [event.time_s for event in run.events]


# --- oracles: closed forms -----------------------------------------------------------------------------------------


def test_a_proportional_car_cycles_with_the_period_of_its_two_exponentials() -> None:
    # throttle downhill: y' = 0.1 y + 2 (10 - y), brake: y' = -0.5 y + 0.3 (10 - y), both first order
    car = HybridCar(ModeLoop(4.0, -0.1, FoPi(0.5, 0.0, 1.0)), ModeLoop(1.0, 0.5, FoPi(0.3, 0.0, 1.0)), eps=0.25)
    run = simulate_hybrid(car, [Corner(0.0, 10.0)], 200.0, [], watch=replace(Watch(), most_output=100.0))
    (rise, above), (fall, below) = (1.9, 20.0 / 1.9), (0.8, 3.0 / 0.8)
    up = math.log((above - 9.75) / (above - 10.25)) / rise
    down = math.log((10.25 - below) / (9.75 - below)) / fall
    expected = [math.log(above / (above - 10.25)) / rise]
    while expected[-1] < 200.0:
        expected.append(expected[-1] + (down if len(expected) % 2 else up))
    # hundreds of jumps: roundings of each add up
    np.testing.assert_allclose(times_of(run), expected[:-1], rtol=0.0, atol=1e-11)
    assert len(run.events) > 300
    assert run.outcome is HybridOutcome.FINISHED


def test_a_coasting_car_meets_a_rising_ramp_where_lamberts_function_says() -> None:
    # 20 e^{-t/2} = 3 t:  (t/2) e^{t/2} = 20/6
    start = HybridStart(20.0, Mode.BRAKE)
    run = simulate_hybrid(coasting(0.5), [Corner(0.0, 0.0, 3.0)], 10.0, [], start=start)
    assert times_of(run) == pytest.approx([2.0 * float(lambertw(20.0 / 6.0).real)], abs=1e-13)


def test_an_ordinary_pi_reaches_the_line_when_its_second_order_loop_does() -> None:
    # 1/s with PI: y'' + kp y' + ki y = kp r' + ki r: from rest y = 1 - e^{-at} (cos wt - (kp - a)/w sin wt)
    kp, ki = 1.0, 2.0
    car = HybridCar(ModeLoop(1.0, 0.0, FoPi(kp, ki, 1.0)), ModeLoop(1.0, 1.0, IDLE), eps=0.05)
    run = simulate_hybrid(car, [Corner(0.0, 1.0)], 1.5, [])
    a, w = kp / 2.0, math.sqrt(ki - kp**2 / 4.0)
    mpmath.mp.dps = 30
    root = mpmath.findroot(
        lambda t: -mpmath.exp(-a * t) * (mpmath.cos(w * t) - (kp - a) / w * mpmath.sin(w * t)) - 0.05, (0.8, 1.3)
    )
    assert run.events[0].time_s == pytest.approx(float(root), abs=1e-13)


def test_a_limit_is_left_when_the_demand_returns_within_it() -> None:
    # y' = -0.2 y + 1 until 2 (10 - y) = 1, from y = 0: y = 5 (1 - e^{-0.2 t}) never gets there; with 4: 20 (1 - ...)
    car = HybridCar(ModeLoop(4.0, 0.2, FoPi(2.0, 0.0, 1.0), limits=(0.0, 1.0)), ModeLoop(1.0, 1.0, IDLE), eps=1.0)
    leaves = -math.log(1.0 - 9.5 / 20.0) / 0.2
    times = np.linspace(0.0, 10.0, 301)
    run = simulate_hybrid(car, [Corner(0.0, 10.0)], 10.0, times)
    rest = 80.0 / 8.2
    linear = rest + (9.5 - rest) * np.exp(-8.2 * (times - leaves).clip(0.0))
    expected = np.where(times < leaves, 20.0 * (1.0 - np.exp(-0.2 * times)), linear)
    np.testing.assert_allclose(run.output, expected, rtol=0.0, atol=1e-12)
    np.testing.assert_allclose(run.control, np.clip(2.0 * (10.0 - expected), 0.0, 1.0), rtol=0.0, atol=1e-11)


def test_the_flow_is_exact_to_rounding_also_with_poles_from_milliseconds_to_hours() -> None:
    for pedal in (papers_car(0.0).throttle, papers_car(0.0).brake):
        flow = Flow(pedal, Regime.WITHIN)
        mpmath.mp.dps = 40
        for level in (0, 5, 20):
            exact: Any = mpmath.expm(mpmath.matrix(flow.matrix.tolist()) * flow.steps_s[level], method="taylor")
            less = np.array((exact - mpmath.eye(len(flow.matrix))).tolist(), dtype=float)
            # a few roundings of the largest entry, 1
            np.testing.assert_allclose(
                flow.exponential_less_one[level], less, rtol=0.0, atol=1e-15 * np.abs(less).max()
            )


def test_without_jumps_it_is_the_fractional_loop_within_the_filters_error() -> None:
    gains = FoPi(0.5, 0.6, 0.55)
    pedal = ModeLoop(1 / 2.35, 1 / 2.35, gains, oustaloup(0.55, 30, (1e-6, 1e6)))
    times = np.array([0.5, 5.0, 20.0, 100.0])
    run = simulate_hybrid(HybridCar(pedal, pedal, eps=10.0), [Corner(0.0, 1.0)], 100.0, times)
    exact = exact_response(gains, Plant((1.0,), (2.35, 1.0)), Signal.OUTPUT_AFTER_REFERENCE, times)
    # the filter's ripple with thirty poles over twelve decades, 1e-4
    np.testing.assert_allclose(run.output, exact, rtol=0.0, atol=3e-4)


# --- oracle: scipy's integrator with events ------------------------------------------------------------------------


@dataclass
class ByScipy:
    """The same car by DOP853, with the limits as a clip in the right-hand side."""

    car: HybridCar
    reference: tuple[Corner, ...]

    def at(self, t: float) -> tuple[float, float]:
        corner = [c for c in self.reference if c.time_s <= t][-1]
        return corner.value + corner.slope_per_s * (t - corner.time_s), corner.slope_per_s

    def demand(self, mode: Mode, corner: Corner, t: float, y: float, x: Array) -> float:
        pedal = self.car.loop(mode)
        r = corner.value + corner.slope_per_s * (t - corner.time_s)
        parts = pedal.gains.ki * pedal.integral.residues @ x if pedal.gains.ki else 0.0
        return pedal.gains.kp * (r - y) + float(parts)

    def run(self, y: float, mode: Mode, end: float) -> tuple[list[float], Array]:
        """Jump times, and the output at the end."""
        memory = {m: np.zeros(len(self.car.loop(m).integral.poles)) for m in Mode}
        events: list[float] = []
        state, free_at = np.append(y, memory[mode]), 0.0
        for corner, until in zip(self.reference, [*(c.time_s for c in self.reference[1:]), end], strict=True):
            t = corner.time_s
            while t < until:
                if t < free_at:
                    t, state, hit = self.flow(mode, corner, t, min(until, free_at), state, watched=False)
                elif mode.outwards * (state[0] - self.at(t)[0]) >= self.car.eps:
                    hit = True
                else:
                    t, state, hit = self.flow(mode, corner, t, until, state)
                if hit:
                    events.append(t)
                    free_at = t + self.car.min_dwell_s
                    memory[mode], mode = state[1:], mode.other
                    kept = memory[mode] if self.car.memory is Memory.HELD else 0.0 * memory[mode]
                    state = np.append(state[0], kept)
        return events, state

    def flow(
        self, mode: Mode, corner: Corner, t: float, until: float, state: Array, watched: bool = True
    ) -> tuple[float, Array, bool]:
        pedal = self.car.loop(mode)
        poles = np.array(pedal.integral.poles)

        def rate(t: float, s: Array) -> Array:
            r = corner.value + corner.slope_per_s * (t - corner.time_s)
            v = np.clip(self.demand(mode, corner, t, s[0], s[1:]), *pedal.limits)
            return np.append(-pedal.pole_rad_s * s[0] + pedal.gain * v, poles * s[1:] + r - s[0])

        def line(t: float, s: Array) -> float:
            r = corner.value + corner.slope_per_s * (t - corner.time_s)
            return mode.outwards * (s[0] - r) - self.car.eps

        line.terminal = True  # type: ignore[attr-defined]
        found: Any = solve_ivp(
            rate, (t, until), state, method="DOP853", events=line if watched else None, rtol=1e-12, atol=1e-13,
            max_step=0.05,
        )  # fmt: skip
        return float(found.t[-1]), found.y[:, -1], found.status == 1


def random_case(seed: int, limited: bool) -> tuple[HybridCar, tuple[Corner, ...], HybridStart]:
    """Plants, gains, alpha = 1 and fractional, ki = 0 among them, steps and ramps."""
    rng = np.random.default_rng(seed)
    pedals: list[ModeLoop] = []
    for sign in (1.0, -1.0):
        alpha = float(rng.choice([1.0, rng.uniform(0.3, 1.6)]))
        ki = float(rng.choice([0.0, 1.0], p=[0.2, 0.8]) * rng.uniform(0.05, 0.6))
        limits = (-0.2, 1.0) if sign > 0.0 else (-1.0, 0.2)
        gains = FoPi(float(rng.uniform(0.05, 0.6)), ki, alpha)
        filtered = oustaloup(alpha, 3, (0.03, 10.0))
        pedal = ModeLoop(float(rng.uniform(1.0, 4.0)), float(rng.uniform(-0.05, 0.4)), gains, filtered)
        pedals.append(replace(pedal, limits=limits) if limited else pedal)
    memory = Memory.HELD if rng.random() < 0.5 else Memory.RESET
    corners = [
        Corner(6.0 * k, float(rng.uniform(2.0, 12.0)), float(rng.choice([0.0, rng.uniform(-1.0, 1.0)])))
        for k in range(3)
    ]
    start = HybridStart(float(rng.uniform(0.0, 12.0)), Mode(int(rng.integers(1, 3))))
    return HybridCar(pedals[0], pedals[1], float(rng.uniform(0.1, 0.5)), memory), tuple(corners), start


@pytest.mark.thinned(2)
@pytest.mark.parametrize("limited", [False, True])
def test_events_agree_with_an_integrator_at_tight_tolerances(limited: bool) -> None:
    jumps = 0
    for seed in range(6):
        car, corners, start = random_case(seed, limited)
        run = simulate_hybrid(car, corners, 18.0, [18.0], start=start)
        events, state = ByScipy(car, corners).run(start.output, start.mode, 18.0)
        # the integrator's own error where it steps over a corner of the clip
        tolerance = 1e-8 if limited else LOCATED_S
        np.testing.assert_allclose(times_of(run), events, rtol=0.0, atol=tolerance, err_msg=str(seed))
        assert run.output[0] == pytest.approx(state[0], abs=10.0 * tolerance)
        jumps += len(events)
    assert jumps > 20


@pytest.mark.thinned(2)
@pytest.mark.parametrize("dwell", [1.0, 3.0])
def test_events_after_a_minimum_dwell_agree_with_an_integrator(dwell: float) -> None:
    jumps, waited = 0, 0
    for seed in range(6):
        plain, corners, start = random_case(seed, True)
        car = replace(plain, min_dwell_s=dwell)
        run = simulate_hybrid(car, corners, 18.0, np.linspace(0.0, 18.0, 2001), start=start)
        events, state = ByScipy(car, corners).run(start.output, start.mode, 18.0)
        # as above; where the dwell ends the jump's time is exact
        np.testing.assert_allclose(times_of(run), events, rtol=0.0, atol=1e-8, err_msg=str(seed))
        assert run.output[-1] == pytest.approx(state[0], abs=1e-7)
        gaps = np.diff(times_of(run))
        assert np.all(gaps >= dwell - 1e-12)
        jumps, waited = jumps + len(events), waited + int(np.sum(gaps < dwell + 1e-9))
    assert jumps > 8
    assert waited > 1


def test_without_a_dwell_the_run_is_the_same_to_the_last_bit() -> None:
    car, corners, start = random_case(3, True)
    one, two = (
        simulate_hybrid(each, corners, 18.0, np.linspace(0.0, 18.0, 50), start=start)
        for each in (car, replace(car, min_dwell_s=0.0))
    )
    assert one.output.tobytes() == two.output.tobytes()
    with pytest.raises(DomainError, match="min_dwell_s"):
        replace(car, min_dwell_s=math.nan)


# --- no event is missed --------------------------------------------------------------------------------------------


def test_on_a_dense_grid_no_mode_is_ever_found_beyond_its_line() -> None:
    for seed in range(30):
        car, corners, start = random_case(1000 + seed, seed % 2 == 0)
        run = simulate_hybrid(car, corners, 18.0, np.linspace(0.0, 18.0, 4001), start=start)
        outwards = np.where(run.mode == 1, -run.error, run.error)
        # the rounding that counts as touching: 2^-46 of the greatest numbers
        assert isinstance(car.eps, float)
        assert np.all(outwards < car.eps + 1e-12), seed


@pytest.mark.long
def test_the_bounds_on_the_curvature_hold_between_two_steps() -> None:
    rng = np.random.default_rng(7)
    share = np.linspace(0.0, 1.0, 201)
    tightest = np.inf
    for seed in range(40):
        pedal = random_case(seed, True)[0].throttle
        for regime in pedal.regimes():
            flow = Flow(pedal, regime)
            w = np.append(rng.normal(size=len(flow.matrix) - 1) * 10 ** rng.uniform(-2, 2), 1.0)
            level = int(rng.integers(0, 8))
            begin, most = flow.derivatives(w), flow.derivative_changes(flow.derivatives(w), level)
            for part in share * flow.steps_s[level]:
                at = flow.derivatives(w + ahead(flow, float(part)) @ w)
                assert abs(at.offset[2] - begin.offset[2]) <= most[0] * (1.0 + 1e-9) + 1e-9
                assert abs(at.demand[2] - begin.demand[2]) <= most[1] * (1.0 + 1e-9) + 1e-9
                tightest = min(tightest, most[0] / max(abs(at.offset[2] - begin.offset[2]), 1e-12))
    assert tightest < 10.0


def ahead(flow: Flow, step: float) -> Array:
    """e^{Mh} - 1 from the table: h in binary."""
    product = np.eye(len(flow.matrix))
    for level in range(1, 40):
        if step >= flow.steps_s[level]:
            step -= flow.steps_s[level]
            product = product + flow.exponential_less_one[level] @ product
    return product - np.eye(len(flow.matrix))


def brushing(gap: float, end: float = 5.0) -> HybridResponse:
    """A braking car, y = 10 e^{-t}, and a falling ramp whose tangent in t = 1 is `gap` lower than y."""
    slope = -10.0 * math.exp(-1.0)
    return simulate_hybrid(
        coasting(1.0), [Corner(0.0, -2.0 * slope - gap, slope)], end, [], start=HybridStart(10.0, Mode.BRAKE)
    )


@pytest.mark.parametrize("gap", [1e-4, 1e-8, 1e-11])
def test_a_ramp_that_is_almost_touched_gives_no_event_and_one_just_crossed_gives_two(gap: float) -> None:
    assert brushing(gap).events == ()
    run = brushing(-gap)
    # y - r = e^{-1} 10 ((t - 1)^2/2 - (t - 1)^3/6) - gap: brake to throttle, and back on the other side
    half = math.sqrt(2.0 * gap * math.e / 10.0)
    # the cubic term moves both by half^2/6; y's rounding of 4e-15 moves them by 1e-15/(3.7 half)
    assert times_of(run) == pytest.approx([1.0 - half, 1.0 + half], abs=half**2 + 4e-15 / half)
    assert run.outcome is HybridOutcome.FINISHED


def test_a_touching_is_a_jump_and_the_car_flows_on() -> None:
    run = brushing(0.0)
    assert run.outcome is HybridOutcome.FINISHED
    assert [event.after for event in run.events] == [Mode.THROTTLE, Mode.BRAKE]
    # where y - r is within its rounding, sqrt(2^-46 20/1.8)
    assert times_of(run) == pytest.approx([1.0, 1.0], abs=1e-6)


# --- switching -----------------------------------------------------------------------------------------------------


def test_without_hysteresis_the_papers_switching_line_holds_the_car() -> None:
    run = simulate_hybrid(papers_car(0.0), PAPERS_STEPS, 120.0, np.linspace(0.0, 120.0, 121), start=CRUISING)
    assert run.outcome is HybridOutcome.CHATTERING
    assert "sliding" in run.reason
    assert "21.4733" in run.reason
    assert len(run.events) == 22
    assert run.reached_s == run.events[-1].time_s == run.events[1].time_s
    assert run.time_s[-1] == 21.0


@pytest.mark.parametrize("limited", [False, True])
def test_with_hysteresis_and_held_memories_the_papers_car_hunts(limited: bool) -> None:
    run = simulate_hybrid(papers_car(0.5, limited=limited), PAPERS_STEPS, 120.0, [59.0], start=CRUISING)
    assert run.outcome is HybridOutcome.FINISHED
    assert len(run.events) > 100
    assert abs(run.error[0]) <= 0.5


@pytest.mark.parametrize("memory", [Memory.RESET, Memory.TRACKING])
def test_with_memories_reset_or_tracking_the_papers_car_comes_to_rest(memory: Memory) -> None:
    run = simulate_hybrid(papers_car(0.5, memory), PAPERS_STEPS, 120.0, [20.0, 119.0], start=CRUISING)
    assert [event.after for event in run.events] == [Mode.BRAKE, Mode.THROTTLE]
    assert abs(run.error[1]) < 0.4
    # braked by more than its lag alone, 30/2.25 km/h per s, against the paper's comfort limit of 7.2
    assert run.rate[0] < -30.0 / 2.25


def test_a_car_at_rest_on_the_line_does_not_jump() -> None:
    run = simulate_hybrid(papers_car(0.0), [Corner(0.0, 30.0)], 100.0, [100.0], start=CRUISING)
    assert (run.events, run.outcome) == ((), HybridOutcome.FINISHED)
    assert run.output[0] == pytest.approx(30.0, abs=1e-12)
    nothing = simulate_hybrid(papers_car(0.0), [Corner(0.0, 0.0)], 10.0, [10.0])
    assert (nothing.events, nothing.output[0]) == ((), 0.0)


def test_a_car_beyond_its_line_jumps_at_once() -> None:
    run = simulate_hybrid(coasting(0.1), [Corner(0.0, 5.0)], 1.0, [0.0], start=HybridStart(9.0, Mode.THROTTLE))
    assert [(event.time_s, event.before, event.after) for event in run.events] == [(0.0, Mode.THROTTLE, Mode.BRAKE)]
    assert run.mode.tolist() == [2]


def test_jumps_too_fast_for_the_watch_are_chattering_though_there_is_hysteresis() -> None:
    car = HybridCar(ModeLoop(4.0, -0.1, FoPi(0.5, 0.0, 1.0)), ModeLoop(1.0, 0.5, FoPi(0.3, 0.0, 1.0)), eps=1e-3)
    run = simulate_hybrid(car, [Corner(0.0, 10.0)], 100.0, [], watch=Watch(most_jumps=20, window_s=0.5))
    assert run.outcome is HybridOutcome.CHATTERING
    assert "eps is too small" in run.reason


@pytest.mark.parametrize("eps", [1e-15, 1e-12, 1e-9])
def test_a_hysteresis_of_almost_nothing_ends_too(eps: float) -> None:
    run = simulate_hybrid(papers_car(eps), PAPERS_STEPS, 120.0, [], start=CRUISING)
    assert run.outcome is HybridOutcome.CHATTERING
    assert len(run.events) < 30


def test_an_unstable_car_diverges() -> None:
    car = HybridCar(
        ModeLoop(-1.0, 0.1, FoPi(2.0, 0.1, 0.7), oustaloup(0.7, 5, BAND)), ModeLoop(1.0, 1.0, IDLE), eps=1.0
    )
    run = simulate_hybrid(car, [Corner(0.0, 1.0)], 1000.0, [0.0, 999.0])
    assert run.outcome is HybridOutcome.DIVERGED
    assert run.reached_s < 20.0
    assert len(run.time_s) == 1


# --- states across a jump ------------------------------------------------------------------------------------------


@pytest.mark.parametrize("memory", list(Memory))
def test_jumps_keep_the_output_and_tracking_keeps_the_control_too(memory: Memory) -> None:
    seen = simulate_hybrid(papers_car(0.5, memory), PAPERS_STEPS, 60.0, [], start=CRUISING).events
    event = seen[1]
    around = [event.time_s - 1e-10, event.time_s + 1e-10]
    run = simulate_hybrid(papers_car(0.5, memory), PAPERS_STEPS, 60.0, around, start=CRUISING)
    assert run.mode.tolist() == [2, 1]
    # over 2e-10 s, at 13 km/h per s
    assert run.output[0] == pytest.approx(run.output[1], abs=3e-9)
    if memory is Memory.TRACKING:
        assert run.control[0] == pytest.approx(run.control[1], abs=1e-8)
    elif memory is Memory.RESET:
        assert run.control[1] == pytest.approx(0.09 * 0.5, abs=1e-8)
    else:
        # at 20 s the throttle's integral held 30 km/h
        assert run.control[1] == pytest.approx(CRUISING_CONTROL + 0.09 * 0.5, abs=1e-8)


def test_a_tracking_control_is_continuous_as_far_as_the_new_limits_let_it() -> None:
    car = papers_car(0.5, Memory.TRACKING, limited=True)
    car = replace(car, brake=replace(car.brake, limits=(-1.0, -0.05)))
    events = simulate_hybrid(car, PAPERS_STEPS, 60.0, [], start=CRUISING).events
    jumps = [event.time_s for event in events[:2]]
    run = simulate_hybrid(car, PAPERS_STEPS, 60.0, jumps, start=CRUISING)
    assert run.mode.tolist() == [2, 1]
    # 0 is above what the brake may, and -0.05 or less is below what the throttle may
    np.testing.assert_allclose(run.control, [-0.05, 0.0], rtol=0.0, atol=1e-14)


# --- properties ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("factor", [4.0, 3.7, 0.01])
def test_slower_time_gives_the_same_car(factor: float) -> None:
    for seed in (2, 3, 11):
        car, corners, start = random_case(seed, seed % 2 == 0)
        pedals = [slower(pedal, factor) for pedal in (car.throttle, car.brake)]
        late = [Corner(c.time_s * factor, c.value, c.slope_per_s / factor) for c in corners]
        times = np.linspace(0.0, 18.0, 50)
        run = simulate_hybrid(car, corners, 18.0, times, start=start)
        scaled = HybridCar(pedals[0], pedals[1], car.eps, car.memory)
        watch = Watch(window_s=0.2 * factor)
        slow = simulate_hybrid(scaled, late, 18.0 * factor, times * factor, start=start, watch=watch)
        np.testing.assert_allclose(np.array(times_of(slow)) / factor, times_of(run), rtol=0.0, atol=LOCATED_S)
        np.testing.assert_allclose(slow.output, run.output, rtol=0.0, atol=1e-9)


def slower(pedal: ModeLoop, factor: float) -> ModeLoop:
    gains, integral = pedal.gains, pedal.integral
    zeros, poles = (tuple(root / factor for root in roots) for roots in (integral.zeros, integral.poles))
    # F(s) = gain prod(s - z)/prod(s - p) keeps its value at s/c, and ki s^-alpha its meaning with ki/c^alpha
    excess = len(poles) - len(zeros)
    scaled = ZeroPoleGain(zeros, poles, integral.gain * factor ** (gains.alpha - excess))
    return replace(
        pedal, gain=pedal.gain / factor, pole_rad_s=pedal.pole_rad_s / factor, integral=scaled,
        gains=FoPi(gains.kp, gains.ki / factor**gains.alpha, gains.alpha),
    )  # fmt: skip


def test_samples_do_not_change_the_run_and_lie_on_one_curve() -> None:
    few = simulate_hybrid(papers_car(0.5), PAPERS_STEPS, 80.0, [25.0], start=CRUISING)
    many = simulate_hybrid(papers_car(0.5), PAPERS_STEPS, 80.0, np.linspace(0.0, 80.0, 161), start=CRUISING)
    assert few.events == many.events
    assert few.output[0] == many.output[50]
    # within a mode, each sample is the one before plus the mean rate, to the trapezoidal rule's error
    fine = simulate_hybrid(papers_car(0.5, Memory.RESET), PAPERS_STEPS, 80.0, np.linspace(62.0, 80.0, 3601))
    climbed = np.cumsum(0.0025 * (fine.rate[1:] + fine.rate[:-1]))
    np.testing.assert_allclose(fine.output[1:] - fine.output[0], climbed, rtol=0.0, atol=1e-5)


# --- errors --------------------------------------------------------------------------------------------------------

BAD_REFERENCES = [
    ([], "reference is empty"),
    ([Corner(1.0, 2.0)], "must be at 0"),
    ([Corner(0.0, 2.0), Corner(3.0, 1.0), Corner(3.0, 2.0)], r"reference\[2\] at 3.0 s does not come after"),
    ([Corner(0.0, math.nan)], r"reference\[0\].*not finite"),
    ([Corner(0.0, 1.0, math.inf)], r"reference\[0\].*not finite"),
]


@pytest.mark.parametrize(("reference", "message"), BAD_REFERENCES)
def test_a_reference_that_is_none_is_refused(reference: list[Corner], message: str) -> None:
    with pytest.raises(DomainError, match=message):
        simulate_hybrid(papers_car(0.5), reference, 10.0, [])


@pytest.mark.parametrize(
    ("end", "times", "message"),
    [
        (0.0, [], "end_s"),
        (math.nan, [], "end_s"),
        (1e9, [], "end earlier"),
        (10.0, [1.0, 1.0], "increase"),
        (10.0, [2.0, 1.0], "increase"),
        (10.0, [math.nan], "finite"),
        (10.0, [11.0], "must lie in"),
        (10.0, [-1.0], "must lie in"),
    ],
)
def test_times_that_make_no_sense_are_refused(end: float, times: list[float], message: str) -> None:
    with pytest.raises(DomainError, match=message):
        simulate_hybrid(papers_car(0.5), PAPERS_STEPS, end, times)


@pytest.mark.parametrize("eps", [-0.1, math.nan, math.inf])
def test_a_half_width_that_is_none_is_refused(eps: float) -> None:
    with pytest.raises(DomainError, match="eps"):
        papers_car(eps)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"gain": 0.0}, "gain = 0"),
        ({"gain": math.nan}, "gain = nan"),
        ({"pole_rad_s": math.inf}, "pole_rad_s"),
        ({"limits": (1.0, 1.0)}, "no room"),
        ({"limits": (math.nan, 1.0)}, "no room"),
        ({"integral": ZeroPoleGain((), (-1.0,), 1.0)}, "one pole at 0"),
        ({"integral": ZeroPoleGain((-2.0,), (0.0, 1.0), 1.0)}, "one pole at 0"),
        ({"integral": ZeroPoleGain((-2.0,), (0.0, -1.0, -1.0), 1.0)}, "all different"),
        ({"integral": ZeroPoleGain((-2.0,), (0.0,), 1.0)}, "fewer zeros"),
        ({"integral": ZeroPoleGain((), (0.0,), math.nan)}, "not finite"),
    ],
)
def test_a_pedal_that_is_none_is_refused(change: dict[str, Any], message: str) -> None:
    with pytest.raises(DomainError, match=message):
        replace(papers_car(0.0).throttle, **change)


def test_what_needs_an_integral_says_so() -> None:
    with pytest.raises(DomainError, match="TRACKING needs ki"):
        replace(coasting(1.0), memory=Memory.TRACKING)
    with pytest.raises(DomainError, match="control needs an integral"):
        simulate_hybrid(coasting(1.0), [Corner(0.0, 1.0)], 1.0, [], start=HybridStart(control=1.0))
    with pytest.raises(DomainError, match="start: output"):
        HybridStart(math.nan)
    with pytest.raises(DomainError, match="greater than 0"):
        Watch(window_s=0.0)
