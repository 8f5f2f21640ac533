"""Simulation on samples: the compiled kernel against the reference, and both against independent solutions."""

from __future__ import annotations

import dataclasses
import os
import shutil
import subprocess
import sys
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy.signal
import scipy.special
from cases.project import ROOT
from cases.thinned import thinned

from fopi_tune.core.controller import FoPi
from fopi_tune.core.loops import Plants
from fopi_tune.core.parallel_form import Implementation, Sections
from fopi_tune.core.plant import Plant, PlantFamily, Uncertain
from fopi_tune.core.sampled_loops import SampledLoops
from fopi_tune.core.zero_order_hold import companion, constant_input_step
from fopi_tune.digital.discretize import discretize
from fopi_tune.digital.realise import Precision
from fopi_tune.digital.runtime import Runtime, init, reset, step, track
from fopi_tune.digital.vectors import Op, Operation, replay
from fopi_tune.errors import DomainError
from fopi_tune.simulation.fractional.linear import Signal, exact_response
from fopi_tune.simulation.fractional.time_stepping import simulate_fractional
from fopi_tune.simulation.measures import measures_of
from fopi_tune.simulation.sampled.plants import DiscretePlants, discretize_plants
from fopi_tune.simulation.sampled.reference import simulate_reference
from fopi_tune.simulation.sampled.simulate import measure, measure_chunks, simulate
from fopi_tune.simulation.scenario import (
    Actuator,
    Horizon,
    Hybrid,
    InactiveController,
    InitialInput,
    Measures,
    Mode,
    Scenario,
    Sensor,
    Signals,
    Start,
    Step,
    Traces,
)
from fopi_tune.spec.model import DigitalSpec

#: to measure what rounding does to a filter takes a tenth of a second
discretized = cache(discretize)

TS = 0.2
STEPS = 150
WIDE = (-1e6, 1e6)
#: rounding of sums taken in another order, relative to signals of size 1 to 30; measured: 1e-13
ROUNDING = 1e-12
NAMES = [field.name for field in dataclasses.fields(Measures)]


def made(gains: FoPi, limits: tuple[float, float], poles: int = 7) -> Runtime:
    return Runtime.of(discretized(gains, DigitalSpec(TS, "oustaloup", poles)).sections, Precision.FLOAT64, limits)


THROTTLE = made(FoPi(0.09, 0.025, 0.8), (0.0, 1.0))
BRAKE = made(FoPi(0.07, 0.11, 0.45), (-1.0, 0.0), poles=5)


def throttle_plants(m: int, seed: int = 1) -> Plants:
    rng = np.random.default_rng(seed)
    return Plants(rng.uniform(4.0, 5.0, (m, 1)), np.c_[np.ones(m), rng.uniform(0.1, 0.3, m)], np.zeros(m))


def brake_plants(m: int, seed: int = 2) -> Plants:
    return Plants(np.ones((m, 1)), np.c_[np.random.default_rng(seed).uniform(1.6, 3.1, m), np.ones(m)], np.zeros(m))


def levels(steps: int = STEPS) -> np.ndarray:
    """Three levels of velocity: up, hard down, up."""
    return np.repeat([18.0, 6.0, 10.0], -(-steps // 3))[:steps]


def random_plants(order: int, m: int, seed: int, direct: bool = False, late: bool = True) -> Plants:
    rng = np.random.default_rng(seed)
    bottoms = np.array([np.poly(-rng.uniform(0.1, 2.0, order)) for _ in range(m)]).astype(np.float64)
    tops = rng.uniform(0.2, 1.0, (m, order + 1 if direct else order))
    return Plants(tops, bottoms, rng.uniform(0.0, 0.9, m) if late else np.zeros(m))


def plainly(modes: list[Mode], scenario: Scenario, first_index: int = 0) -> Traces:
    controllers = [mode.controller for mode in modes]
    held = [
        discretize_plants(mode.plants, scenario.sample_time_s, scenario.actuator.delay_samples)
        for mode in modes
        if isinstance(mode.plants, Plants)
    ]
    return simulate_reference(controllers, held, scenario, first_index)


def assert_same_traces(one: Traces, two: Traces) -> None:
    for name in ("output", "rate", "measured", "error", "demanded", "applied", "mode", "rate_after"):
        np.testing.assert_allclose(getattr(one, name), getattr(two, name), rtol=ROUNDING, atol=ROUNDING, err_msg=name)


def assert_identical(one: Measures, two: Measures) -> None:
    for name in NAMES:
        np.testing.assert_array_equal(getattr(one, name), getattr(two, name), err_msg=name)


# ---- the compiled kernel and the reference ----

LOADED = np.where(np.arange(STEPS) > 40, 0.3, 0.0)
CASES = {
    "bare": Scenario(TS, Signals(levels())),
    "quantised": Scenario(TS, Signals(levels(), LOADED), Sensor(quantum=0.25)),
    "noisy": Scenario(TS, Signals(levels(), LOADED), Sensor(0.01, 0.2, 5), start=Start(3.0)),
    "late and slow": Scenario(TS, Signals(levels(), LOADED), Sensor(), Actuator(0.4, 1.3), Start(3.0, bumpless=True)),
    "everything": Scenario(
        TS, Signals(levels(), LOADED), Sensor(0.05, 0.1, 2**63 + 11), Actuator(1.0, 2.0), Start(2.0)
    ),
}


@pytest.mark.thinned(3)
@pytest.mark.parametrize("order", [1, pytest.param(2, marks=pytest.mark.long), 3])
@pytest.mark.parametrize("case", CASES)
def test_the_kernel_computes_what_the_plain_simulation_does(case: str, order: int) -> None:
    for direct in (False, True):
        modes = [Mode(made(FoPi(0.3, 0.1, 0.7), (-4.0, 30.0)), random_plants(order, 5, order, direct))]
        plain = plainly(modes, CASES[case], 7)
        assert_same_traces(simulate(modes, CASES[case], first_index=7), plain)
    assert_same_measures(modes, CASES[case])


@pytest.mark.thinned(4)
@pytest.mark.parametrize("inactive", InactiveController)
@pytest.mark.parametrize("case", thinned(CASES))
def test_a_hybrid_loop_switches_in_the_kernel_as_in_the_plain_simulation(
    case: str, inactive: InactiveController
) -> None:
    modes = [Mode(THROTTLE, throttle_plants(10)), Mode(BRAKE, brake_plants(10))]
    for first in (1, 2):
        start = dataclasses.replace(CASES[case].start, before=InitialInput.FREE)
        hybrid = Hybrid(0.3, inactive, first, 3, 1.5)
        scenario = dataclasses.replace(CASES[case], hybrid=hybrid, start=start)
        traces = simulate(modes, scenario)
        assert_same_traces(traces, plainly(modes, scenario))
        assert set(np.unique(traces.mode)) == {1, 2}
    assert_same_measures(modes, scenario)


@pytest.mark.thinned(6)
@pytest.mark.parametrize("inactive", InactiveController)
@pytest.mark.parametrize("case", ["noisy", "late and slow"])
def test_a_mode_stays_for_its_minimum_dwell_and_may_be_left_just_then(case: str, inactive: InactiveController) -> None:
    modes, shortest = [Mode(THROTTLE, throttle_plants(10)), Mode(BRAKE, brake_plants(10))], []
    for dwell in (0, 2, 7):
        # narrow enough for the noise to cross it at almost every sample
        hybrid = Hybrid(0.05, inactive, 1, 3, 1.5, dwell)
        scenario = dataclasses.replace(CASES[case], hybrid=hybrid)
        traces = simulate(modes, scenario)
        assert_same_traces(traces, plainly(modes, scenario))
        gaps = [np.diff(np.flatnonzero(np.diff(row))) for row in traces.mode]
        shortest.append(int(np.concatenate(gaps).min()))
    assert shortest[1:] == [2, 7]
    assert shortest[0] == 1 or case != "noisy"
    assert_same_measures(modes, scenario)


@pytest.mark.parametrize("dwell", [0, 1])
def test_a_dwell_of_a_sample_changes_nothing(dwell: int) -> None:
    modes = [Mode(THROTTLE, throttle_plants(18)), Mode(BRAKE, brake_plants(18))]
    plain = dataclasses.replace(CASES["noisy"], hybrid=Hybrid(0.05))
    dwelling = dataclasses.replace(CASES["noisy"], hybrid=Hybrid(0.05, min_dwell_samples=dwell))
    assert_identical(measure(modes, plain, Horizon(0.5)), measure(modes, dwelling, Horizon(0.5)))


def test_the_first_mode_may_be_left_at_once_and_the_next_one_not() -> None:
    modes = [Mode(THROTTLE, throttle_plants(3)), Mode(BRAKE, brake_plants(3))]
    scenario = Scenario(
        TS,
        Signals(np.array([10.0] * 2 + [40.0] * 28)),
        start=Start(30.0, InitialInput.FREE),
        hybrid=Hybrid(0.5, min_dwell_samples=10),
    )
    # above the line at 0, below the other one from sample 2 on
    np.testing.assert_array_equal(simulate(modes, scenario).mode, np.tile([2] * 10 + [1] * 20, (3, 1)))


def assert_same_measures(modes: list[Mode], scenario: Scenario) -> None:
    controllers = [mode.controller for mode in modes]
    steps = tuple(
        Step(first, TS * first, before, value, band, of_load)
        for first, before, value, band, of_load in (
            (10, 0.0, 18.0, 2.0, False), (41, 0.0, 18.0, 2.0, True), (50, 18.0, 6.0, 3.0, False),
            (70, 0.0, 6.0, 0.5, True), (100, 6.0, 10.0, 4.0, False), (101, 6.0, 10.0, 4.0, True),
        )
    )  # fmt: skip
    for horizon in (Horizon(0.5), Horizon(0.2, 100), Horizon(2.0, 5, steps)):
        found = measure(modes, scenario, horizon)
        expected = measures_of(plainly(modes, scenario), controllers, scenario, horizon)
        for name in NAMES:
            one, two = getattr(found, name), getattr(expected, name)
            np.testing.assert_allclose(one, two, rtol=1e-11, atol=1e-11, err_msg=name)


def test_the_controller_is_the_runtime_bit_for_bit() -> None:
    scenario = dataclasses.replace(CASES["everything"], actuator=Actuator())
    traces = simulate([Mode(THROTTLE, throttle_plants(3))], scenario)
    for measured, demanded in zip(traces.measured, traces.demanded, strict=True):
        steps = zip(levels(), measured, strict=True)
        operations = [Operation(Op.STEP, float(r), float(y)) for r, y in steps]
        np.testing.assert_array_equal(replay(THROTTLE, operations), demanded)


@pytest.mark.parametrize("inactive", InactiveController)
def test_both_controllers_of_a_hybrid_loop_are_the_runtime_bit_for_bit(inactive: InactiveController) -> None:
    scenario = dataclasses.replace(CASES["noisy"], hybrid=Hybrid(0.2, inactive), actuator=Actuator(1.5))
    traces = simulate([Mode(THROTTLE, throttle_plants(4)), Mode(BRAKE, brake_plants(4))], scenario)
    assert sum(jumps_as_the_runtime_has_it(traces, i, inactive) for i in range(4)) > 4


def jumps_as_the_runtime_has_it(traces: Traces, i: int, inactive: InactiveController) -> int:
    """The jumps of plant i, once both of its controllers are the runtime's."""
    pair, switched = (THROTTLE, BRAKE), 0
    with np.errstate(all="ignore"):
        memory, last = [init(THROTTLE), init(BRAKE)], 0
        for k in range(STEPS):
            r, y, mode = levels()[k], traces.measured[i, k], traces.mode[i, k] - 1
            if mode != last and inactive is InactiveController.RESET:
                memory[mode] = init(pair[mode])
            switched, last = switched + (mode != last), mode
            memory[mode] = step(pair[mode], memory[mode], r, y)
            assert memory[mode].output == traces.demanded[i, k]
            if inactive is InactiveController.TRACK:
                memory[1 - mode] = track(pair[1 - mode], memory[1 - mode], r, y, traces.applied[i, k])
    return switched


def test_a_bumpless_start_is_the_reset_of_the_runtime() -> None:
    plants = throttle_plants(1)
    scenario = Scenario(TS, Signals(np.full(20, 9.0)), start=Start(9.0, bumpless=True))
    traces = simulate([Mode(THROTTLE, plants)], scenario)
    state = reset(THROTTLE, float(discretize_plants(plants, TS).initial_state(scenario.start)[1][0]))
    for measured, demanded in zip(traces.measured[0], traces.demanded[0], strict=True):
        state = step(THROTTLE, state, 9.0, float(measured))
        assert state.output == demanded
    np.testing.assert_allclose(traces.output, 9.0, rtol=1e-13)


# ---- independent solutions ----


@pytest.mark.parametrize("order", [1, 2, 3])
def test_a_linear_loop_is_what_scipy_makes_of_its_state_space(order: int) -> None:
    plants = random_plants(order, 1, 10 + order, direct=False, late=False)
    sections = Sections(TS, 0.2, (1.0, 0.7), (0.02, 0.05))
    continuous = scipy.signal.tf2ss(plants.numerator[0], plants.denominator[0])
    discrete: Any = scipy.signal.cont2discrete(continuous, TS)
    a, b, c = discrete[:3]
    # u = direct e + sum x_k, e = r - c x:  the loop's own matrices
    p, r = np.diag(sections.poles), np.array(sections.residues)[:, None]
    whole = np.block([[a - 0.2 * b @ c, b @ np.ones((1, 2))], [-r @ c, p]])
    reference = np.random.default_rng(3).normal(size=STEPS)
    system = (whole, np.vstack([0.2 * b, r]), np.hstack([c, np.zeros((1, 2))]), np.zeros((1, 1)), TS)
    expected = scipy.signal.dlsim(system, reference)[1][:, 0]
    modes = [Mode(Runtime.of(sections, Precision.FLOAT64, WIDE), plants)]
    found = simulate(modes, Scenario(TS, Signals(reference))).output[0]
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=ROUNDING)


@pytest.mark.parametrize("delay", [0.0, 0.4, 2.7])
def test_a_delayed_response_is_the_lag_s_closed_form(delay: float) -> None:
    # a controller of 1 with limits 1: the applied control is a step of 1 as long as the error is large
    controller = Runtime.of(Sections(TS, 1.0, (), ()), Precision.FLOAT64, (0.0, 1.0))
    plants = Plants(np.array([[2.0]]), np.array([[3.0, 1.0]]), np.array([0.27]))
    load = np.full(STEPS, 0.5)
    scenario = Scenario(TS, Signals(np.full(STEPS, 1e3), load), actuator=Actuator(delay_samples=delay))
    traces = simulate([Mode(controller, plants)], scenario)

    def answer(t: np.ndarray) -> np.ndarray:
        return np.where(t > 0.0, 2.0 * (1.0 - np.exp(-np.maximum(t, 0.0) / 3.0)), 0.0)

    expected = answer(traces.time_s - 0.27 - TS * delay) + 0.5 * answer(traces.time_s - 0.27)
    np.testing.assert_allclose(traces.output[0], expected, rtol=0.0, atol=1e-13)


def test_the_rate_is_the_derivative_just_before_the_sample() -> None:
    # without a change of the control within the last sample a backward difference in closed form
    controller = Runtime.of(Sections(TS, 1.0, (), ()), Precision.FLOAT64, (0.0, 1.0))
    for order in (1, 2, 3):
        plants = random_plants(order, 4, order, late=False)
        traces = simulate([Mode(controller, plants)], Scenario(TS, Signals(np.full(30, 1e3))))
        for i in range(4):
            system = scipy.signal.lti(plants.numerator[i], plants.denominator[i])
            impulse = scipy.signal.impulse(system, T=traces.time_s)[1]
            # SciPy's own rounding of the exponentials
            np.testing.assert_allclose(traces.rate[i, 1:], impulse[1:], rtol=0.0, atol=1e-9)


def test_the_rate_after_a_sample_is_the_derivative_that_begins_there() -> None:
    # an impulse response's derivative at 0+: of a second-order plant b0/a0 times the step of the input
    for order in (1, 2, 3):
        plants = random_plants(order, 4, order, late=False)
        modes = [Mode(made(FoPi(0.3, 0.1, 0.7), (-4.0, 30.0)), plants)]
        traces = simulate(modes, Scenario(TS, Signals(levels(), LOADED)))
        for i in range(4):
            # SciPy's stubs do not know what tf2ss gives
            matrices: Any = scipy.signal.tf2ss(plants.numerator[i], plants.denominator[i])
            a, b, c, d = (np.asarray(matrix) for matrix in matrices)
            held = np.r_[0.0, traces.applied[i] + LOADED]
            state = np.zeros(order)
            sampled: Any = scipy.signal.cont2discrete((a, b, c, d), TS)
            e, f = sampled[:2]
            for k in range(STEPS):
                for found, v in ((traces.rate[i, k], held[k]), (traces.rate_after[i, k], held[k + 1])):
                    expected = float((c @ (a @ state + np.ravel(b) * v))[0])
                    # rounding of another realisation, of rates up to 20
                    assert found == pytest.approx(expected, abs=1e-9)
                state = e @ state + np.ravel(f) * held[k + 1]


@pytest.mark.parametrize("delay", [0.0, 0.1, 0.7, 1.4])
def test_the_largest_rate_of_a_lag_is_where_its_control_arrives(delay: float) -> None:
    # a lag at rest, then a constant control u0 from the first sample on: y' = u0/tau when it arrives, and less later
    controller = Runtime.of(Sections(TS, 1.0, (), ()), Precision.FLOAT64, (0.0, 1.5))
    plants = Plants(np.ones((2, 1)), np.array([[0.2, 1.0], [0.4, 1.0]]), np.zeros(2))
    scenario = Scenario(TS, Signals(np.full(30, 1e3)), actuator=Actuator(delay_samples=delay))
    found = measure([Mode(controller, plants)], scenario, Horizon(0.1))
    np.testing.assert_allclose(found.peak_rate, 1.5 / np.array([0.2, 0.4]), rtol=1e-12)


@pytest.mark.thinned(3)
@pytest.mark.parametrize(("delay", "late"), [(0.4, 0.0), (1.3, 0.07), (0.0, 0.07)])
def test_the_rate_jumps_where_an_input_arrives_between_samples(delay: float, late: float) -> None:
    # plants of relative degree 1 and orders 2 and 3; control and load each arrive with a delay of their own
    for order in (2, 3):
        plants = random_plants(order, 3, order, late=False)
        plants = Plants(plants.numerator, plants.denominator, np.full(3, late))
        scenario = Scenario(TS, Signals(levels(), LOADED), actuator=Actuator(delay_samples=delay))
        modes = [Mode(made(FoPi(0.3, 0.1, 0.7), (-4.0, 30.0)), plants)]
        traces = simulate(modes, scenario)
        assert_same_traces(traces, plainly(modes, scenario))
        for i in range(3):
            found = rates_after_arrivals(plants, i, traces.applied[i], late, late + delay * TS)
            # both by matrix exponentials, of rates up to 20
            np.testing.assert_allclose(traces.rate_after[i], found, atol=1e-9)


def rates_after_arrivals(plants: Plants, i: int, applied: np.ndarray, late: float, delay: float) -> np.ndarray:
    """dy/dt just after control and load arrive in each sample, the larger one, by SciPy's exponentials."""
    matrices: Any = scipy.signal.tf2ss(plants.numerator[i], plants.denominator[i])
    a, b, c = (np.asarray(matrix) for matrix in matrices[:3])

    def value(signal: np.ndarray, time: float) -> float:
        k = int(np.floor(time / TS + 1e-9))
        return float(signal[k]) if k >= 0 else 0.0

    state, rates = np.zeros(len(a)), []
    for k in range(STEPS):
        arrivals = sorted({(delay / TS % 1.0) * TS, (late / TS % 1.0) * TS})
        time, after = 0.0, []
        for instant in (*arrivals, TS):
            middle = (k * TS + 0.5 * (time + instant)) if instant > time else k * TS + instant
            u = value(applied, middle - delay) + value(LOADED, middle - late)
            block = scipy.linalg.expm(np.block([[a, b], [np.zeros((1, len(a) + 1))]]) * (instant - time))
            state = block[:-1, :-1] @ state + block[:-1, -1] * u
            if instant < TS:
                held = k * TS + instant + 1e-7
                u = value(applied, held - delay) + value(LOADED, held - late)
                after.append(float((c @ (a @ state + b[:, 0] * u))[0]))
            time = instant
        rates.append(max(after, key=abs))
    return np.array(rates)


def test_a_sine_s_steady_state_is_the_frequency_response_of_the_sampled_loop() -> None:
    sections = discretized(FoPi(0.4, 0.3, 0.6), DigitalSpec(TS, "oustaloup", 5, band_rad_s=(0.05, 100.0))).sections
    plants = Plants(np.array([[2.0]]), np.array([[1.0, 1.2]]), np.array([0.33]))
    loops = SampledLoops.implemented(FoPi(0.4, 0.3, 0.6), Implementation(sections, 0.6), plants)
    cycle = 40
    omega = 2.0 * np.pi / (cycle * TS)
    steps = 200 * cycle
    reference = np.sin(omega * TS * np.arange(steps))
    controller = Runtime.of(sections, Precision.FLOAT64, WIDE)
    traces = simulate(
        [Mode(controller, plants)], Scenario(TS, Signals(reference), actuator=Actuator(delay_samples=0.6))
    )
    ratio = np.fft.fft(traces.output[0, -cycle:])[1] / np.fft.fft(reference[-cycle:])[1]
    gain = loops.response(np.zeros(1, dtype=int), np.array([omega]))[0]
    # the slowest section decays with 0.05 rad/s for 1600 s
    assert abs(ratio - gain / (1.0 + gain)) < 1e-10


def pi_loop(sample_time_s: float, horizon_s: float, limits: tuple[float, float]) -> tuple[np.ndarray, np.ndarray]:
    steps = round(horizon_s / sample_time_s) + 1
    # kp + ki Ts/(z - 1): a PI on samples
    controller = Runtime.of(Sections(sample_time_s, 0.8, (1.0,), (0.5 * sample_time_s,)), Precision.FLOAT64, limits)
    scenario = Scenario(sample_time_s, Signals(np.ones(steps)))
    plants = Plants(np.array([[1.0]]), np.array([[2.0, 1.0]]), np.zeros(1))
    traces = simulate([Mode(controller, plants)], scenario)
    return traces.time_s, traces.output[0]


def test_the_loop_tends_to_the_exact_continuous_one_with_the_first_power_of_the_sample_time() -> None:
    errors = []
    for sample_time_s in (0.02, 0.01, 0.005):
        times, output = pi_loop(sample_time_s, 6.0, WIDE)
        at = np.isclose(times % 1.0, 0.0, atol=1e-9) | np.isclose(times % 1.0, 1.0, atol=1e-9)
        at[0] = False
        exact = exact_response(FoPi(0.8, 0.5, 1.0), Plant((1.0,), (2.0, 1.0)), Signal.OUTPUT_AFTER_REFERENCE, times[at])
        errors.append(np.abs(output[at] - exact).max())
    # order 1: the hold's half sample of delay
    assert np.log2(errors[0] / errors[1]) == pytest.approx(1.0, abs=0.05)
    assert np.log2(errors[1] / errors[2]) == pytest.approx(1.0, abs=0.05)


def test_a_saturated_loop_tends_to_the_exact_continuous_one() -> None:
    # a limit below the first demand; `fractional.time_stepping` has no anti-windup, hence proportional control
    def outputs(sample_time_s: float) -> np.ndarray:
        controller = Runtime.of(Sections(sample_time_s, 3.0, (), ()), Precision.FLOAT64, (-0.5, 1.2))
        steps = round(4.0 / sample_time_s) + 1
        plants = Plants(np.array([[1.0]]), np.array([[2.0, 1.0]]), np.zeros(1))
        return simulate([Mode(controller, plants)], Scenario(sample_time_s, Signals(np.ones(steps)))).output[0]

    exact = simulate_fractional(FoPi(3.0, 0.0, 1.0), Plant((1.0,), (2.0, 1.0)), 1.0, 0.001, 4000, limits=(-0.5, 1.2))
    errors = [np.abs(outputs(ts)[:: round(0.04 / ts)] - exact.output[::40]).max() for ts in (0.02, 0.01)]
    assert errors[1] < 0.6 * errors[0] < 0.01


def test_segments_of_first_order_agree_with_the_series_of_higher_orders() -> None:
    # the same plant with a pole and a zero that cancel, in a state space of order 2
    for pole in (0.0, 0.7, -0.4):
        a, _, _ = companion(np.array([[1.0]]), np.array([[1.0, pole]]), TS)
        once = constant_input_step(a, np.array([0.3]))
        block = np.zeros((1, 2, 2))
        block[0, 0, 0], block[0, 1, 1] = a[0, 0, 0], -1.0
        twice = constant_input_step(block, np.array([0.3]))
        np.testing.assert_allclose(once[0][0, 0, 0], twice[0][0, 0, 0], rtol=1e-15)
        np.testing.assert_allclose(once[1][0, 0], twice[1][0, 0], rtol=1e-15)


# ---- chunks, threads, plant indices ----


def test_results_depend_on_neither_chunks_nor_threads_nor_the_place_in_a_block() -> None:
    m = 75
    first, second = throttle_plants(m), brake_plants(m)
    modes = [Mode(THROTTLE, first), Mode(BRAKE, second)]
    scenario = dataclasses.replace(CASES["everything"], hybrid=Hybrid(0.3, InactiveController.TRACK), start=Start(2.0))
    horizon = Horizon(0.5, 50)
    whole = measure(modes, scenario, horizon, threads=1)
    for chunk, threads in ((1000, 4), (32, 3), (17, 2), (1, 1)):
        assert_identical(measure(modes, scenario, horizon, chunk=chunk, threads=threads), whole)
    called = []

    def supply(begin: int, end: int) -> Plants:
        called.append((begin, end))
        return first.take(np.arange(begin, end))

    mixed = [Mode(THROTTLE, supply), Mode(BRAKE, second)]
    assert_identical(measure(mixed, scenario, horizon, m, chunk=30), whole)
    assert called == [(0, 30), (30, 60), (60, 75)]
    few = simulate(mixed, dataclasses.replace(scenario), m)
    before, after = np.abs(few.rate[:, 50:]).max(axis=1), np.abs(few.rate_after[:, 50:-1]).max(axis=1)
    np.testing.assert_array_equal(np.maximum(before, after), whole.peak_rate)
    assert [len(part.finite) for part in measure_chunks(modes, scenario, horizon, chunk=50)] == [50, 25]


def test_equal_plants_with_different_delays_do_not_disturb_each_other() -> None:
    plants = Plants(np.ones((40, 1)), np.tile([2.0, 1.0], (40, 1)), np.linspace(0.0, 3.0, 40))
    modes = [Mode(made(FoPi(0.3, 0.1, 0.7), WIDE), plants)]
    scenario = Scenario(TS, Signals(np.ones(STEPS), LOADED), actuator=Actuator(delay_samples=0.5))
    together = simulate(modes, scenario)
    for i in (0, 15, 16, 39):
        alone = simulate([Mode(modes[0].controller, plants.take(np.array([i])))], scenario)
        np.testing.assert_array_equal(alone.output[0], together.output[i])


# ---- measures ----


def constant(value: float, limits: tuple[float, float] = WIDE) -> Runtime:
    return Runtime.of(Sections(TS, value, (), ()), Precision.FLOAT64, limits)


def test_a_plant_starts_at_rest_or_free() -> None:
    plants = throttle_plants(2)
    still = Scenario(TS, Signals(np.full(50, 8.0)), start=Start(8.0))
    controller = constant(0.0)
    at_rest = simulate([Mode(controller, plants)], dataclasses.replace(still, actuator=Actuator(delay_samples=1e3)))
    np.testing.assert_allclose(at_rest.output, 8.0, rtol=1e-13)
    np.testing.assert_allclose(at_rest.rate, 0.0, atol=1e-13)
    free = simulate([Mode(controller, plants)], dataclasses.replace(still, start=Start(8.0, InitialInput.FREE)))
    decay = 8.0 * np.exp(-np.outer(plants.denominator[:, 1], free.time_s))
    np.testing.assert_allclose(free.output, decay, rtol=1e-12)
    np.testing.assert_allclose(free.rate, -plants.denominator[:, 1:] * decay, rtol=1e-12)
    for order in (2, 3):
        higher = random_plants(order, 3, order, direct=True)
        traces = simulate([Mode(controller, higher)], dataclasses.replace(still, actuator=Actuator(delay_samples=1e3)))
        np.testing.assert_allclose(traces.output, 8.0, rtol=1e-11)


def test_an_integrator_is_held_anywhere_by_no_input() -> None:
    # 1/s, (s + 2)/(s^2 + s) and 3/(s^3 + s^2), each at 8 with the input 0; beside a lag, which needs 8/2
    late = Actuator(delay_samples=99)
    still = Scenario(TS, Signals(np.full(50, 8.0)), actuator=late, start=Start(8.0))
    for top, bottom in (([1.0], [1.0, 0.0]), ([1.0, 2.0], [1.0, 1.0, 0.0]), ([3.0], [1.0, 1.0, 0.0, 0.0])):
        lag = np.pad(np.array([4.0]), (len(top) - 1, 0)), np.poly(np.r_[-2.0, -np.ones(len(bottom) - 2)])
        plants = Plants(np.array([top, lag[0]]), np.array([bottom, lag[1]]), np.zeros(2))
        traces = simulate(
            [Mode(constant(0.0), plants)], dataclasses.replace(still, actuator=Actuator(delay_samples=99))
        )
        np.testing.assert_allclose(traces.output, 8.0, rtol=1e-12)
        np.testing.assert_allclose(traces.rate, 0.0, atol=1e-12)


def test_the_actuator_moves_no_faster_than_its_rate() -> None:
    traces = simulate([Mode(THROTTLE, throttle_plants(4))], Scenario(TS, Signals(levels()), actuator=Actuator(0.25)))
    change = np.diff(traces.applied, axis=1, prepend=0.0)
    assert np.abs(change).max() == pytest.approx(0.25 * TS, rel=1e-12)
    assert np.abs(traces.applied - traces.demanded).max() > 0.5


def test_overshoot_and_settling_are_those_of_a_known_response() -> None:
    # free decay from 8 to the final reference 0: in the step's direction (down) y stays short of 0
    plants = Plants(np.ones((1, 1)), np.array([[1.0, 0.5]]), np.zeros(1))
    modes = [Mode(constant(0.0), plants)]
    scenario = Scenario(TS, Signals(np.zeros(STEPS)), start=Start(8.0, InitialInput.FREE))
    found = measure(modes, scenario, Horizon(0.8))
    assert found.overshoot[0] == pytest.approx(-8.0 * np.exp(-0.5 * TS * (STEPS - 1)), rel=1e-12)
    # 8 e^{-t/2} < 0.8 from 4.605 s on
    assert found.settling_s[0] == pytest.approx(4.8, rel=1e-12)
    assert found.iae[0] == pytest.approx(TS * 8.0 * (1.0 - np.exp(-0.1 * STEPS)) / (1.0 - np.exp(-0.1)), rel=1e-12)
    assert found.peak_rate[0] == pytest.approx(4.0, rel=1e-12)
    assert measure(modes, scenario, Horizon(1e-9)).settling_s[0] == np.inf


def test_chattering_is_counted_and_flagged_not_looped_on() -> None:
    # noise of ten times the hysteresis around the reference
    modes = [Mode(THROTTLE, throttle_plants(20)), Mode(BRAKE, brake_plants(20))]
    quiet = Scenario(TS, Signals(np.full(STEPS, 5.0)), hybrid=Hybrid(0.5, InactiveController.TRACK))
    noisy = dataclasses.replace(quiet, sensor=Sensor(noise_std=5.0, seed=1))
    found = measure(modes, noisy, Horizon(0.5))
    assert found.chattering.all()
    assert found.switches.min() > 20
    assert found.longest_run.min() >= 3
    assert not measure(modes, quiet, Horizon(0.5)).chattering.any()


def test_a_jump_cuts_the_actuator_to_the_new_mode_s_limits() -> None:
    modes = [Mode(THROTTLE, throttle_plants(6)), Mode(BRAKE, brake_plants(6))]
    traces = simulate(modes, Scenario(TS, Signals(levels()), actuator=Actuator(0.5), hybrid=Hybrid(0.3)))
    assert traces.applied[traces.mode == 1].min() >= 0.0
    assert traces.applied[traces.mode == 2].max() <= 0.0


def test_an_unstable_loop_ends_in_a_flag() -> None:
    bottoms = np.array([[1.0, -50.0], [1.0, 0.5], [1.0, -1e3]])
    plants = Plants(np.ones((3, 1)), bottoms, np.zeros(3))
    scenario = Scenario(TS, Signals(np.ones(200)))
    found = measure([Mode(THROTTLE, plants)], scenario, Horizon(0.1))
    assert found.finite.tolist() == [False, True, False]
    assert np.isnan(found.iae).tolist() == [True, False, True]
    assert found.settling_s[0] == np.inf
    # the controller holds its output, which stays finite
    assert np.isfinite(simulate([Mode(THROTTLE, plants)], scenario).demanded).all()


def unstable_one(plants: Plants, place: int) -> Plants:
    """One plant grows by e^12 a sample and overflows within 60."""
    bottom = plants.denominator.copy()
    bottom[place] = 1.0, -12.0 / TS
    return Plants(plants.numerator, bottom, plants.dead_time_s)


@pytest.mark.parametrize("inactive", InactiveController)
def test_a_plant_that_overflows_holds_its_controllers_and_does_not_disturb_its_neighbours(
    inactive: InactiveController,
) -> None:
    tame = throttle_plants(40), brake_plants(40)
    wild = [unstable_one(plants, 7) for plants in tame]
    scenario = dataclasses.replace(CASES["noisy"], hybrid=Hybrid(0.3, inactive), actuator=Actuator(1.5))
    alone, together = (
        measure([Mode(THROTTLE, one), Mode(BRAKE, two)], scenario, Horizon(0.5)) for one, two in (tame, wild)
    )
    for name in NAMES:
        one, two = (np.delete(getattr(measures, name), 7) for measures in (alone, together))
        np.testing.assert_array_equal(one, two, err_msg=name)
    assert np.flatnonzero(~together.finite).tolist() == [7]
    traces = simulate([Mode(THROTTLE, wild[0]), Mode(BRAKE, wild[1])], scenario)
    assert not np.isfinite(traces.output[7]).all()
    assert jumps_as_the_runtime_has_it(traces, 7, inactive) > 0
    assert jumps_as_the_runtime_has_it(traces, 8, inactive) > 0


def test_a_controller_that_overflows_holds_as_the_runtime_does() -> None:
    sections = Sections(TS, 1.0, (1.0, 0.5), (1e160, -1e160))
    controller = Runtime.of(sections, Precision.FLOAT64, WIDE)
    plants = Plants(np.full((2, 1), 1e160), np.array([[1.0, 0.1], [1.0, -3.0]]), np.zeros(2))
    scenario = Scenario(TS, Signals(np.full(60, 1e150)))
    traces = simulate([Mode(controller, plants)], scenario)
    for measured, demanded in zip(traces.measured, traces.demanded, strict=True):
        operations = [Operation(Op.STEP, 1e150, float(y)) for y in measured]
        np.testing.assert_array_equal(replay(controller, operations), demanded)


def test_members_of_a_family_are_simulated_as_they_are() -> None:
    family = PlantFamily(
        "lag",
        {
            "static_gain": Uncertain.exactly(1.0),
            "time_constant_s": Uncertain.between(1.6, 3.1),
            "dead_time_s": Uncertain.exactly(0.1),
        },
    )
    points = np.linspace(1.6, 3.1, 5)[:, None]
    held = discretize_plants(Plants.members(family, points), TS)
    assert isinstance(held, DiscretePlants)
    np.testing.assert_allclose(held.control.whole[0][:, 0, 0], np.exp(-TS / points[:, 0]), rtol=1e-15)


# ---- invalid inputs ----

ONE = throttle_plants(1)


def test_no_plants_give_empty_measures_and_one_sample_gives_one() -> None:
    none = [Mode(THROTTLE, ONE.take(np.zeros(0, dtype=int)))]
    scenario = Scenario(TS, Signals(np.ones(1)))
    assert measure(none, scenario, Horizon(0.1)).finite.shape == (0,)
    assert simulate(none, scenario).output.shape == (0, 1)
    found = measure([Mode(THROTTLE, ONE)], scenario, Horizon(0.1))
    assert (found.final_error[0], found.settling_s[0], found.iae[0]) == (1.0, np.inf, TS)


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: Signals(np.zeros(0)), "one finite number a sample"),
        (lambda: Signals(np.array([1.0, np.nan])), "one finite number a sample"),
        (lambda: Signals(np.ones((2, 2))), "one finite number a sample"),
        (lambda: Signals(np.ones(3), np.ones(2)), "the load has 2 samples"),
        (lambda: Sensor(quantum=-1.0), "quantum"),
        (lambda: Sensor(seed=-1), "seed"),
        (lambda: Actuator(0.0), "rate_per_s"),
        (lambda: Actuator(delay_samples=np.nan), "delay_samples"),
        (lambda: Start(np.inf), "initial output"),
        (lambda: Hybrid(-0.1), "half_width"),
        (lambda: Hybrid(0.1, first=3), "first mode"),
        (lambda: Hybrid(0.1, most_switches=0), "most_switches"),
        (lambda: Hybrid(0.1, min_dwell_samples=-1), "min_dwell_samples"),
        (lambda: Horizon(np.nan), "band"),
        (lambda: Scenario(0.0, Signals(np.ones(2))), "sample_time_s"),
        (lambda: Mode(Runtime.of(Sections(TS, 1.0, (), ()), Precision.FLOAT32), ONE), "float64"),
    ],
)
def test_inputs_that_make_no_sense_are_named(make: object, words: str) -> None:
    assert callable(make)
    with pytest.raises(DomainError, match=words):
        make()


def scenario_of(**changes: object) -> Scenario:
    return dataclasses.replace(Scenario(TS, Signals(np.ones(5))), **changes)


@pytest.mark.parametrize(
    ("modes", "scenario", "words"),
    [
        ([], scenario_of(), "0 modes"),
        ([Mode(THROTTLE, ONE)], scenario_of(hybrid=Hybrid(0.1)), "1 mode:"),
        ([Mode(THROTTLE, ONE), Mode(BRAKE, brake_plants(2))], scenario_of(hybrid=Hybrid(0.1)), "plants"),
        ([Mode(THROTTLE, lambda begin, end: ONE)], scenario_of(), "count"),
        ([Mode(THROTTLE, random_plants(2, 1, 0))], scenario_of(start=Start(1.0, InitialInput.FREE)), "order 1"),
        (
            [Mode(THROTTLE, Plants(np.array([[1.0, 0.0]]), np.array([[1.0, 2.0, 1.0]]), np.zeros(1)))],
            scenario_of(start=Start(1.0)),
            "no input holds",
        ),
        ([Mode(THROTTLE, Plants(np.ones((1, 1)), np.array([[0.0, 1.0]]), np.zeros(1)))], scenario_of(), "leading"),
        ([Mode(THROTTLE, Plants(np.full((1, 1), np.nan), np.ones((1, 2)), np.zeros(1)))], scenario_of(), "not finite"),
        (
            [Mode(THROTTLE, Plants(np.ones((1, 1)), np.ones((1, 2)), np.full(1, 1e6)))],
            scenario_of(),
            "samples late|long",
        ),
        (
            [Mode(THROTTLE, Plants(np.ones((1, 1)), np.ones((1, 2)), -np.ones(1))), Mode(BRAKE, brake_plants(1))],
            scenario_of(hybrid=Hybrid(0.1)),
            "a dead time that is negative",
        ),
        (
            [Mode(THROTTLE, Plants(np.ones((1, 1)), np.ones((1, 2)), np.full(1, 1e5))), Mode(BRAKE, brake_plants(1))],
            scenario_of(hybrid=Hybrid(0.1)),
            "more than 10,000 samples long; take a longer",
        ),
        (
            [Mode(THROTTLE, random_plants(2, 1, 0, direct=True, late=False)), Mode(BRAKE, brake_plants(1))],
            scenario_of(hybrid=Hybrid(0.1)),
            "without direct path",
        ),
    ],
)
def test_loops_that_do_not_belong_together_are_named(modes: list[Mode], scenario: Scenario, words: str) -> None:
    with pytest.raises(DomainError, match=words):
        simulate(modes, scenario)


def test_a_horizon_beyond_the_samples_and_empty_chunks_are_named() -> None:
    modes = [Mode(THROTTLE, ONE)]
    with pytest.raises(DomainError, match="horizon"):
        measure(modes, scenario_of(), Horizon(0.1, 5))
    with pytest.raises(DomainError, match="chunk"):
        measure(modes, scenario_of(), Horizon(0.1), chunk=0)
    with pytest.raises(DomainError, match="of indices"):
        measure([Mode(THROTTLE, lambda begin, end: ONE)], scenario_of(), Horizon(0.1), 3)


# ---- imports and the compiled cache ----


def test_the_package_is_imported_without_numba() -> None:
    code = "import sys, fopi_tune, fopi_tune.cli, fopi_tune.simulation.sampled.simulate; print('numba' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "False"


def test_what_was_compiled_is_kept_where_numba_is_told_to(tmp_path: Path) -> None:
    # importing creates the cache's folder; compiling would take many seconds
    code = "from fopi_tune.simulation.sampled.kernel import run_blocks; print(run_blocks._cache.cache_path)"
    copy = tmp_path / "read_only"
    shutil.copytree(ROOT / "fopi_tune", copy / "fopi_tune", ignore=shutil.ignore_patterns("__pycache__"))
    folder = copy / "fopi_tune" / "simulation" / "sampled"
    folder.chmod(0o555)
    environment = {**os.environ, "PYTHONPATH": str(copy), "NUMBA_CACHE_DIR": str(tmp_path / "kept")}
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, env=environment)
    folder.chmod(0o755)
    assert done.stdout.startswith(str(tmp_path / "kept"))
