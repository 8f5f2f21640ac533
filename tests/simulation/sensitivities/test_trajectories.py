"""Signals with derivatives by the gains: values against the simulation, derivatives against its differences."""

from __future__ import annotations

import dataclasses
from functools import lru_cache

import numpy as np
import pytest

from fopi_tune.core.controller import FoPi
from fopi_tune.core.loops import Plants
from fopi_tune.digital.derivatives import controller_derivatives
from fopi_tune.digital.discretize import sections_of
from fopi_tune.digital.implementation import digital_section_of, nominal_crossover, runtime_of
from fopi_tune.errors import DomainError
from fopi_tune.simulation.sampled.plants import discretize_plants
from fopi_tune.simulation.sampled.simulate import simulate
from fopi_tune.simulation.scenario import (
    Actuator,
    Hybrid,
    InitialInput,
    Mode,
    Scenario,
    Sensor,
    Signals,
    Start,
    Traces,
)
from fopi_tune.simulation.sensitivities import Trajectories, trajectories
from fopi_tune.spec import parse_spec
from fopi_tune.spec.model import DesignSpec

TS, STEPS = 0.2, 120
NAMES = ("output", "rate", "rate_after", "demanded", "applied")
#: of the largest value of a signal: rounding of sums taken in another order
VALUE = 5e-13
#: of the largest derivative: rounding of the simulation over the step of the difference, 1e-14/4e-5, and some growth
DERIVATIVE = 1e-7
#: central difference of order 8
OFFSETS = (-4, -3, -2, -1, 1, 2, 3, 4)
SHARES = (1 / 280, -4 / 105, 1 / 5, -4 / 5, 4 / 5, -1 / 5, 4 / 105, -1 / 280)
#: one-sided difference of order 4
AHEAD, AHEAD_SHARES = (0, 1, 2, 3, 4), (-25 / 12, 4.0, -3.0, 4 / 3, -1 / 4)
#: small, so that few branches change within a difference
STEP = 4e-5
#: share of the samples before a branch changes within a difference; it rarely does
MOSTLY = 0.7
TEXT = """
schema: 1
name: trajectories
plant: {{model: lag, static_gain: 1.0, time_constant_s: {{min: 1.6, max: 3.1, nominal: 2.3}}, dead_time_s: 0.1}}
controller: {{kp: {{min: -9, max: 9}}, ki: {{min: -9, max: 9}}, alpha: {alpha}}}
requirements: [{{phase_margin_deg: {{at_least: 60}}}}]
digital: {{sample_time_s: 0.2, {digital}}}
"""
FREE = "{min: 0.1, max: 1.9}"


@lru_cache
def spec_of(digital: str = "poles: 5", alpha: str = FREE) -> DesignSpec:
    return parse_spec(TEXT.format(digital=digital, alpha=alpha))


def signals(load: bool = False) -> Signals:
    k = np.arange(STEPS)
    reference = np.repeat([3.0, 1.0, 2.0], STEPS // 3) + np.clip(k - 90, 0, 10) * 0.1
    disturbance = np.asarray(np.where(k > 25, 0.3, 0.0) - 0.2 * (k > 70), dtype=float)
    return Signals(np.asarray(reference, dtype=float), disturbance if load else None)


def plants_of(order: int, direct: bool = False, dead_time: bool = False, seed: int = 5) -> Plants:
    """Three stable plants with different dead times, fractions of a sample among them."""
    rng = np.random.default_rng(seed)
    bottoms = np.array([np.poly(-rng.uniform(0.2, 2.0, order)) for _ in range(3)]).astype(np.float64)
    tops = rng.uniform(0.7, 1.3, (3, order + 1 if direct else order)) * bottoms[:, -1:]
    return Plants(tops, bottoms, np.array([0.0, 0.13, 0.4]) if dead_time else np.zeros(3))


def simulated(spec: DesignSpec, gains: FoPi, plants: Plants, scenario: Scenario) -> Traces:
    digital = digital_section_of(spec)
    crossover = nominal_crossover(spec, gains) if digital.depends_on_crossover else None
    return simulate([Mode(runtime_of(sections_of(gains, digital, crossover), spec), plants)], scenario)


def found_for(spec: DesignSpec, gains: FoPi, plants: Plants, scenario: Scenario) -> Trajectories:
    held = discretize_plants(plants, scenario.sample_time_s, scenario.actuator.delay_samples)
    return trajectories(controller_derivatives(spec, gains), held, scenario)


def branches(traces: Traces, spec: DesignSpec, plants: Plants, scenario: Scenario) -> list[np.ndarray]:
    """Where the output is at which limit, it or the actuator at which rate, and whose arrival `rate_after` is of."""
    low, high = digital_section_of(spec).output_limits or (-np.inf, np.inf)
    slow = np.sign(traces.applied - traces.demanded) + 3.0 * ways_of(traces, spec, scenario)
    return [traces.demanded == low, traces.demanded == high, slow, load_is_faster(traces, plants, scenario)]


def ways_of(traces: Traces, spec: DesignSpec, scenario: Scenario) -> np.ndarray:
    """1 and -1 where the output moves up and down by all that its rate allows."""
    rate, past = digital_section_of(spec).output_rate_per_s, scenario.start.output if scenario.start.bumpless else 0.0
    if rate is None:
        return np.zeros(traces.demanded.shape)
    # plants of static gain 1 rest at their output
    moves = np.diff(traces.demanded, axis=1, prepend=past)
    return np.sign(moves) * (np.abs(moves) > rate * TS * (1.0 - 1e-9))


def load_is_faster(traces: Traces, plants: Plants, scenario: Scenario) -> np.ndarray:
    """Where dy/dt just after the load arrives is larger than just after the control does."""
    found, load = np.zeros(traces.output.shape, dtype=bool), scenario.signals.load
    held = discretize_plants(plants, TS, scenario.actuator.delay_samples)
    if load is None or held.acts_at_samples.all():
        return found
    states, past = held.initial_state(scenario.start)
    (transition, *weights), (_, *load_weights) = held.control.whole, held.load.whole
    for i, x in enumerate(states):
        controls = np.concatenate([np.full(40, past[i]), traces.applied[i]])
        loads = np.concatenate([np.zeros(40), load])
        for k in range(STEPS):
            late, load_late = 40 + k - held.control.delay[i], 40 + k - held.load.delay[i]
            inputs = np.array([controls[late], controls[late - 1], loads[load_late], loads[load_late - 1]])
            by_control, by_load = held.arrivals[i] @ np.concatenate([x, inputs])
            found[i, k] = abs(by_load) > abs(by_control)
            x = transition[i] @ x + np.stack([w[i] for w in (*weights, *load_weights)], axis=1) @ inputs
    return found


def assert_right(
    spec: DesignSpec, gains: FoPi, plants: Plants, scenario: Scenario, columns: tuple[int, ...] = (0, 1, 2),
    offsets: tuple[int, ...] = OFFSETS, shares: tuple[float, ...] = SHARES,
) -> list[np.ndarray]:  # fmt: skip
    """Values are those of the simulation, derivatives its differences; returns `branches`."""
    found, plain = found_for(spec, gains, plants, scenario), simulated(spec, gains, plants, scenario)
    for name in NAMES:
        values, expected = getattr(found, name)[..., 0], getattr(plain, name)
        np.testing.assert_allclose(values, expected, rtol=0.0, atol=VALUE * np.abs(expected).max(), err_msg=name)
    here = branches(plain, spec, plants, scenario)
    for column in columns:
        word = ("kp", "ki", "alpha")[column]
        moved = [dataclasses.replace(gains, **{word: getattr(gains, word) + STEP * offset}) for offset in offsets]
        each = [simulated(spec, one, plants, scenario) for one in moved]
        # a difference across a change of branch is no derivative: samples that feel one are left out
        taken = [branches(traces, spec, plants, scenario) for traces in each]
        changes = np.any([[one != two for one, two in zip(some, here, strict=True)] for some in taken], axis=0)
        # the last branch has no effect on later samples
        same = ~(np.logical_or.accumulate(changes[:3].any(axis=0), axis=1) | changes[3])
        assert same.mean() > MOSTLY
        for name in NAMES:
            signals_there = np.array([getattr(traces, name) for traces in each])
            difference = np.tensordot(shares, signals_there, axes=1) / STEP
            scale = max(np.abs(difference[same]).max(), 1e-3)
            np.testing.assert_allclose(
                getattr(found, name)[same, 1 + column], difference[same], rtol=0.0, atol=DERIVATIVE * scale,
                err_msg=f"d {name}/d {word}",
            )  # fmt: skip
    return here


GAINS = [FoPi(0.6, 0.3, 0.8), FoPi(0.6, 0.3, 1.0), FoPi(0.5, 0.2, 0.5), FoPi(0.4, 0.2, 1.3), FoPi(0.0, 0.3, 1.1)]
SCENARIOS = {
    "bare": Scenario(TS, signals()),
    "loaded": Scenario(TS, signals(load=True)),
    "late": Scenario(TS, signals(load=True), actuator=Actuator(delay_samples=1.0)),
    "between samples": Scenario(TS, signals(load=True), actuator=Actuator(delay_samples=0.3)),
    "from rest": Scenario(TS, signals(), start=Start(2.0)),
    "bumpless": Scenario(TS, signals(), start=Start(2.0, bumpless=True)),
}


@pytest.mark.thinned(5)
@pytest.mark.parametrize("order", [1, pytest.param(2, marks=pytest.mark.long), 3])
@pytest.mark.parametrize("name", SCENARIOS)
def test_signals_and_derivatives_of_plants_of_every_order(name: str, order: int) -> None:
    for gains in GAINS[: 5 if order == 1 else 2]:
        assert_right(spec_of(), gains, plants_of(order), SCENARIOS[name])


@pytest.mark.thinned(slow=["between"])
@pytest.mark.parametrize("order", [pytest.param(1, marks=pytest.mark.long), 2])
@pytest.mark.parametrize("name", SCENARIOS)
def test_a_direct_path_and_dead_times_that_differ(name: str, order: int) -> None:
    assert_right(spec_of(), FoPi(0.4, 0.2, 0.9), plants_of(order, direct=True), SCENARIOS[name])
    assert_right(spec_of(), FoPi(0.4, 0.2, 1.0), plants_of(order, dead_time=True), SCENARIOS[name])
    assert_right(spec_of(), FoPi(0.4, 0.2, 1.2), plants_of(order, direct=True, dead_time=True), SCENARIOS[name])


def test_a_free_start_decays() -> None:
    start = Start(2.0, InitialInput.FREE)
    assert_right(spec_of(), FoPi(0.6, 0.3, 1.0), plants_of(1, dead_time=True), Scenario(TS, signals(), start=start))
    with pytest.raises(DomainError, match="needs plants of order 1"):
        found_for(spec_of(), FoPi(0.6, 0.3, 1.0), plants_of(2), Scenario(TS, signals(), start=start))


@pytest.mark.parametrize("order", [1, 3])
def test_a_limited_output_has_no_derivative_and_the_back_calculation_goes_on(order: int) -> None:
    spec, plants, limited = spec_of("poles: 5, output_limits: [1.1, 2.1]"), plants_of(order), np.zeros(2, dtype=int)
    for gains in (FoPi(0.9, 0.3, 0.8), FoPi(1.2, 0.2, 1.0), FoPi(0.9, 0.1, 1.35), FoPi(0.3, 0.4, 0.6)):
        for bumpless in (False, True):
            scenario = Scenario(TS, signals(load=True), start=Start(1.0, bumpless=bumpless))
            low, high, *_ = assert_right(spec, gains, plants, scenario)
            limited += low.sum(), high.sum()
            at_limit = found_for(spec, gains, plants, scenario).demanded[low | high]
            assert not at_limit[:, 1:].any()
    assert limited.min() > 20, limited


@pytest.mark.thinned(2)
@pytest.mark.parametrize("order", [1, 3])
def test_an_output_at_its_rate_has_the_derivative_of_its_last_value(order: int) -> None:
    spec, plants, moving = spec_of("poles: 5, output_limits: [-0.3, 2.6], output_rate_per_s: 0.6"), plants_of(order), 0
    for gains in (FoPi(0.9, 0.3, 0.8), FoPi(1.2, 0.2, 1.0), FoPi(0.3, 0.4, 0.6)):
        for actuator in (Actuator(), Actuator(0.5, 0.3)):
            scenario = Scenario(TS, signals(load=True), actuator=actuator, start=Start(1.0, bumpless=True))
            assert_right(spec, gains, plants, scenario)
            ways = ways_of(simulated(spec, gains, plants, scenario), spec, scenario)
            moving += int(np.sum(ways != 0.0))
            found = found_for(spec, gains, plants, scenario).demanded
            on_its_way = np.flatnonzero(ways[0, 1:]) + 1
            np.testing.assert_array_equal(found[0, on_its_way, 1:], found[0, on_its_way - 1, 1:])
    assert moving > 200


def test_an_actuator_at_its_rate_has_the_derivative_of_its_last_control() -> None:
    scenario = Scenario(TS, signals(load=True), actuator=Actuator(0.6, 0.3), start=Start(0.5))
    spec = spec_of("poles: 5, output_limits: [-0.3, 2.6]")
    for gains in (FoPi(0.6, 0.3, 0.8), FoPi(0.6, 0.3, 1.0)):
        slow = assert_right(spec, gains, plants_of(2, dead_time=True), scenario)[2][:, 1:] != 0.0
        assert slow.sum() > 10
        found = found_for(spec, gains, plants_of(2, dead_time=True), scenario).applied
        np.testing.assert_array_equal(found[:, 1:, 1:][slow], found[:, :-1, 1:][slow])


@pytest.mark.thinned(2)
@pytest.mark.parametrize(
    "digital",
    [
        pytest.param("poles: 7, band_rad_s: [1.0e-4, 100]", marks=pytest.mark.long),
        pytest.param("poles: 5, method: modified_oustaloup", marks=pytest.mark.long),
        "poles: 4, rule: matched",
        "poles: 5, method: modified_oustaloup, rule: matched",
        "poles: 5, prewarp: crossover",
    ],
)
def test_every_method_and_rule(digital: str) -> None:
    for gains in (FoPi(1.4, 0.5, 0.8), FoPi(1.4, 0.5, 1.0), FoPi(1.2, 0.3, 1.3)):
        assert_right(spec_of(digital), gains, plants_of(1, dead_time=True), SCENARIOS["loaded"])
        limited = spec_of(f"{digital}, output_limits: [-1.0, 2.8]")
        assert assert_right(limited, gains, plants_of(1), SCENARIOS["loaded"])[1].sum() > 3


def test_a_fit_with_a_fixed_alpha() -> None:
    spec = spec_of("poles: 4, method: fit", "0.8")
    assert_right(spec, FoPi(0.6, 0.3, 0.8), plants_of(2), SCENARIOS["loaded"], (0, 1))
    assert not found_for(spec, FoPi(0.6, 0.3, 0.8), plants_of(2), SCENARIOS["loaded"]).output[..., 3].any()


def test_without_integral_action() -> None:
    for gains in (FoPi(0.6, 0.0, 0.8), FoPi(0.6, 0.0, 1.0), FoPi(0.0, 0.0, 0.7)):
        assert_right(spec_of(), gains, plants_of(2, dead_time=True), SCENARIOS["loaded"])


def test_without_integral_action_and_limited_the_derivative_is_one_sided() -> None:
    # the gain of the anti-windup goes with |ki|: see `digital.derivatives`
    spec, gains = spec_of("poles: 5, output_limits: [0.0, 0.8]"), FoPi(0.6, 0.0, 0.8)
    branch = assert_right(spec, gains, plants_of(2), SCENARIOS["loaded"], (1,), AHEAD, AHEAD_SHARES)
    assert branch[1].sum() > 3


def test_an_integrator_as_plant_and_negative_gains() -> None:
    plants = Plants(np.array([[-0.2], [-0.3]]), np.array([[1.0, 0.0], [1.0, 0.0]]), np.array([0.0, 0.3]))
    assert_right(spec_of(), FoPi(-1.0, -0.2, 0.9), plants, SCENARIOS["from rest"])
    assert_right(spec_of(), FoPi(-1.0, -0.2, 1.0), plants, SCENARIOS["loaded"])


def test_a_static_plant() -> None:
    # without states: y is the direct path times the input of the last sample
    plants = Plants(np.array([[0.5]]), np.array([[1.0]]), np.array([0.0]))
    assert_right(spec_of(), FoPi(0.3, 0.4, 0.9), plants, SCENARIOS["loaded"])


def test_a_loop_that_diverges_overflows_as_the_simulation_does() -> None:
    scenario = Scenario(TS, Signals(np.ones(400)))
    plants, gains = plants_of(1), FoPi(900.0, 300.0, 0.9)
    with np.errstate(all="ignore"):
        found, plain = found_for(spec_of(), gains, plants, scenario), simulated(spec_of(), gains, plants, scenario)
    finite = np.abs(plain.output) < 1e300
    assert not finite.all()
    np.testing.assert_allclose(found.output[..., 0][finite], plain.output[finite], rtol=1e-10)
    np.testing.assert_array_equal(np.isfinite(found.demanded[..., 0]), np.isfinite(plain.demanded))


def test_what_has_no_derivative_is_refused() -> None:
    plain = SCENARIOS["bare"]
    for scenario, word in (
        (dataclasses.replace(plain, sensor=Sensor(quantum=0.1)), "quantum"),
        (dataclasses.replace(plain, sensor=Sensor(noise_std=0.1)), "noise_std"),
        (dataclasses.replace(plain, hybrid=Hybrid(0.1)), "one mode"),
    ):
        with pytest.raises(DomainError, match=word):
            found_for(spec_of(), FoPi(0.6, 0.3, 0.8), plants_of(1), scenario)
