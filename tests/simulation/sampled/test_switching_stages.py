"""Separate lines and coasting on samples: the compiled simulation against the plain one, and what a run must show."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from fopi_tune.core.controller import FoPi
from fopi_tune.core.loops import Plants
from fopi_tune.core.switching_lines import SwitchingLines, Threshold
from fopi_tune.errors import DomainError
from fopi_tune.simulation.measures import measures_of
from fopi_tune.simulation.sampled.mode_plants import discretize_modes, in_derivatives
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
from tests.simulation.sampled.test_simulate_rate import TS, assert_same, made, plainly

#: s at each setpoint
STEPS = 120
LEVELS = np.repeat([18.0, 6.0, 10.0], STEPS // 3)
RELATIVE = SwitchingLines(Threshold(1.5), Threshold(0.25))
MIXED = SwitchingLines(Threshold(17.0, True), Threshold(-0.5))
COASTING = SwitchingLines(Threshold(0.8), Threshold(-0.6), Threshold(0.0), Threshold(0.1))
COASTING_MIXED = SwitchingLines(Threshold(18.5, True), Threshold(-1.0), Threshold(18.2, True), Threshold(-0.5))
PLANTS = 10


def modes(rates: tuple[float | None, float | None] = (None, None)) -> list[Mode]:
    rng = np.random.default_rng(1)
    raising = Plants(
        rng.uniform(4.0, 5.0, (PLANTS, 1)), np.c_[np.ones(PLANTS), rng.uniform(0.1, 0.3, PLANTS)], np.zeros(PLANTS)
    )
    lowering = Plants(np.ones((PLANTS, 1)), np.c_[rng.uniform(1.6, 3.1, PLANTS), np.ones(PLANTS)], np.zeros(PLANTS))
    one = made(FoPi(0.09, 0.025, 0.8), (0.0, 1.0), rates[0])
    two = made(FoPi(0.07, 0.11, 0.45), (-1.0, 0.0), rates[1], 5)
    return [Mode(one, raising), Mode(two, lowering)]


def driven(lines: SwitchingLines | float, inactive: InactiveController, dwell: int = 0) -> Scenario:
    hybrid = Hybrid(lines, inactive, most_switches=3, window_s=2.0, min_dwell_samples=dwell)
    start = Start(12.0, InitialInput.FREE)
    return Scenario(
        TS, Signals(LEVELS, np.sin(0.1 * np.arange(STEPS))), Sensor(0.01, 0.05, 4), start=start, hybrid=hybrid
    )


@pytest.mark.parametrize("inactive", list(InactiveController))
@pytest.mark.parametrize("lines", [RELATIVE, MIXED, COASTING, COASTING_MIXED], ids=["r", "m", "coast", "coast-mixed"])
def test_the_compiled_run_takes_the_same_turns(lines: SwitchingLines, inactive: InactiveController) -> None:
    for dwell, rates in ((0, (None, None)), (4, (0.4, None)), (0, (0.5, 0.3))):
        both, scenario = modes(rates), driven(lines, inactive, dwell)
        found = simulate(both, scenario)
        assert_same(found, plainly(both, scenario))
        states = set(np.unique(found.mode))
        assert states == ({0, 1, 2} if lines.coasts else {1, 2})


@pytest.mark.parametrize("inactive", list(InactiveController))
def test_with_a_rate_of_the_actuator_and_a_delay_too(inactive: InactiveController) -> None:
    actuator = Actuator(0.7, 1.5)
    scenario = dataclasses.replace(driven(COASTING, inactive), actuator=actuator)
    both = modes((0.5, None))
    assert_same(simulate(both, scenario), plainly(both, scenario))


@pytest.mark.parametrize("inactive", list(InactiveController))
def test_a_hysteresis_is_two_relative_lines_with_the_same_bits(inactive: InactiveController) -> None:
    one = simulate(modes(), driven(0.3, inactive))
    two = simulate(modes(), driven(SwitchingLines(Threshold(0.3), Threshold(-0.3)), inactive))
    for name in ("output", "demanded", "applied", "mode"):
        assert np.array_equal(getattr(one, name), getattr(two, name)), name


@pytest.mark.parametrize("lines", [COASTING, MIXED])
def test_measures_are_those_of_the_traces(lines: SwitchingLines) -> None:
    scenario, both = driven(lines, InactiveController.HOLD), modes()
    horizon = Horizon(0.2, 5)
    found, expected = (
        measure(both, scenario, horizon),
        measures_of(simulate(both, scenario), [mode.controller for mode in both], scenario, horizon),
    )
    for field in dataclasses.fields(expected):
        np.testing.assert_allclose(
            getattr(found, field.name), getattr(expected, field.name), rtol=1e-9, err_msg=field.name
        )
    assert (expected.saturated_s > 0.0).any()


def test_both_outputs_rest_while_coasting() -> None:
    found = simulate(modes(), driven(COASTING, InactiveController.HOLD))
    resting = found.mode == 0
    assert resting.any()
    assert np.all(found.demanded[resting] == 0.0)
    assert np.all(found.applied[resting] == 0.0)


def test_a_held_memory_continues_after_coasting() -> None:
    # with memories that are reset a mode that is entered begins with its direct part alone
    held, reset = (
        simulate(modes(), driven(COASTING, each)) for each in (InactiveController.HOLD, InactiveController.RESET)
    )
    entered = (reset.mode[:, 1:] == 1) & (reset.mode[:, :-1] == 0)
    direct = modes()[0].controller.direct
    expected = np.clip(direct * reset.error[:, 1:][entered], 0.0, 1.0)
    np.testing.assert_allclose(reset.demanded[:, 1:][entered], expected, rtol=1e-12)
    entered = (held.mode[:, 1:] == 1) & (held.mode[:, :-1] == 0)
    differs = held.demanded[:, 1:][entered] - np.clip(direct * held.error[:, 1:][entered], 0.0, 1.0)
    assert np.abs(differs).max() > 1e-3


@pytest.mark.parametrize("inactive", list(InactiveController))
@pytest.mark.parametrize("lines", [RELATIVE, COASTING], ids=["r", "coast"])
def test_what_is_fed_forward_is_the_same_in_both_runs(lines: SwitchingLines, inactive: InactiveController) -> None:
    ramp = np.concatenate([np.linspace(12.0, 18.0, 40), np.full(40, 6.0), np.linspace(6.0, 10.0, 40)])
    for fed, rates in ((((0.02, 0.05), (0.05, 0.3)), (None, None)), (((0.03, 0.0), (0.0, 0.0)), (0.4, None))):
        scenario = driven(lines, inactive)
        hybrid = dataclasses.replace(scenario.hybrid or Hybrid(0.0), fed=fed)
        scenario = dataclasses.replace(scenario, hybrid=hybrid, signals=Signals(ramp))
        both = modes(rates)
        found = simulate(both, scenario)
        assert_same(found, plainly(both, scenario))
        without = simulate(both, dataclasses.replace(scenario, hybrid=dataclasses.replace(hybrid, fed=())))
        assert np.abs(found.output - without.output).max() > 0.1


def test_nothing_fed_forward_is_no_change_at_all() -> None:
    scenario = driven(RELATIVE, InactiveController.TRACK)
    hybrid = dataclasses.replace(scenario.hybrid or Hybrid(0.0), fed=((0.0, 0.0), (0.0, 0.0)))
    one, two = simulate(modes(), scenario), simulate(modes(), dataclasses.replace(scenario, hybrid=hybrid))
    assert np.array_equal(one.output, two.output)


@pytest.mark.parametrize("delay", [0.0, 0.4, 1.0, 2.3])
def test_a_standstill_is_the_same_in_both_runs(delay: float) -> None:
    levels = np.concatenate([np.linspace(6.0, 0.0, 40), np.zeros(40), np.linspace(0.0, 5.0, 40)])
    load = np.where(np.arange(STEPS) < 60, -0.35, 0.1)
    for hold in ((1.2, 0.3), (-np.inf, 0.2), (0.0, -np.inf)):
        hybrid = dataclasses.replace(driven(COASTING, InactiveController.RESET).hybrid or Hybrid(0.0), hold_below=hold)
        scenario = Scenario(
            TS, Signals(levels, load), actuator=Actuator(delay_samples=delay), start=Start(6.0, InitialInput.FREE),
            hybrid=hybrid,
        )  # fmt: skip
        both = modes()
        found = simulate(both, scenario)
        assert_same(found, plainly(both, scenario))
        np.testing.assert_allclose(found.rate, plainly(both, scenario).rate, atol=1e-9)
        np.testing.assert_allclose(found.rate_after, plainly(both, scenario).rate_after, atol=1e-9)
        if -np.inf not in hold:
            held = (found.output == 0.0) & (found.rate == 0.0)
            assert (held.sum(axis=1) > 3).any()
            assert found.output.min() == 0.0


def test_what_rests_begins_to_move_when_it_is_driven_enough() -> None:
    # y' = -0.5 y + 2 (u + w) of a control that rests: held up to a drive of 0.8
    plants = Plants(np.array([[2.0]]), np.array([[1.0, 0.5]]), np.zeros(1))
    load = np.repeat([0.0, 0.3, 0.5, 0.3, -0.2], 20)
    hybrid = Hybrid(SwitchingLines(Threshold(9.0), Threshold(-9.0), Threshold(-8.0), Threshold(8.0)),
                    hold_below=(0.8, 0.8))  # fmt: skip
    scenario = Scenario(TS, Signals(np.zeros(100), load), start=Start(0.0, InitialInput.FREE), hybrid=hybrid)
    both = [Mode(mode.controller, plants) for mode in modes()]
    y = simulate(both, scenario).output[0]
    assert np.all(y[:41] == 0.0)
    # 0.5 drives by 1; from there the lag's own steps, also with 0.3, which would not have set it in motion
    expected, decay = [0.0], np.exp(-0.5 * TS)
    for w in load[40:-1]:
        expected.append(max(decay * expected[-1] + (1.0 - decay) * 4.0 * w, 0.0))
    np.testing.assert_allclose(y[40:], expected, atol=1e-12)
    assert y[-1] == 0.0


def of_higher_order(bottoms: tuple[tuple[float, ...], tuple[float, ...]]) -> list[Mode]:
    """Both controllers with plants of these denominators, each with its largest coefficient uncertain."""
    rng, found = np.random.default_rng(8), []
    for mode, bottom, gain in zip(modes(), bottoms, (20.0, 8.0), strict=True):
        every = np.tile(bottom, (PLANTS, 1)) * np.r_[1.0, np.ones(len(bottom) - 1)]
        every[:, 0] *= rng.uniform(0.7, 1.3, PLANTS)
        found.append(Mode(mode.controller, Plants(np.full((PLANTS, 1), gain), every, np.zeros(PLANTS))))
    return found


ORDERS = {
    "2-1": ((2.0, 3.0, 1.0), (1.5, 1.0)),
    "1-2": ((4.0, 1.0), (0.8, 0.6, 1.0)),
    "2-3": ((2.0, 3.0, 1.0), (0.3, 1.0, 1.5, 1.0)),
    "3-integrating": ((0.3, 1.2, 1.0, 0.0), (1.5, 1.0)),
}


@pytest.mark.parametrize("delay", [0.0, 0.4, 1.0, 2.3])
@pytest.mark.parametrize("bottoms", ORDERS.values(), ids=ORDERS)
def test_plants_of_higher_order_take_the_same_turns(
    bottoms: tuple[tuple[float, ...], tuple[float, ...]], delay: float
) -> None:
    for lines in (RELATIVE, COASTING):
        scenario = dataclasses.replace(
            driven(lines, InactiveController.RESET), actuator=Actuator(delay_samples=delay), start=Start(2.0)
        )
        both = of_higher_order(bottoms)
        held = [discretize_plants(m.plants, TS, delay) for m in both if isinstance(m.plants, Plants)]
        plain = simulate_reference([mode.controller for mode in both], in_derivatives(held), scenario)
        found = simulate(both, scenario)
        assert_same(found, plain)
        np.testing.assert_allclose(found.rate, plain.rate, rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(found.rate_after, plain.rate_after, rtol=1e-9, atol=1e-9)
        assert {1, 2} <= set(np.unique(found.mode))


def test_two_modes_with_one_plant_of_higher_order_are_one_loop() -> None:
    # a mode that is never left, whatever is beside it, is the single loop's simulation
    lines = SwitchingLines(Threshold(1e6), Threshold(-1e6))
    both = of_higher_order(((0.3, 1.0, 1.5, 1.0), (1.5, 1.0)))
    for delay in (0.0, 0.4):
        alone = Scenario(TS, Signals(LEVELS), actuator=Actuator(delay_samples=delay), start=Start(3.0))
        found = simulate(both, dataclasses.replace(alone, hybrid=Hybrid(lines)))
        single = simulate(both[:1], alone)
        np.testing.assert_allclose(found.output, single.output, rtol=1e-11, atol=1e-11)
        np.testing.assert_allclose(found.rate, single.rate, rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(found.rate_after, single.rate_after, rtol=1e-9, atol=1e-9)


def test_a_plant_with_a_direct_path_takes_no_turns() -> None:
    plants = Plants(np.array([[1.0, 2.0]]), np.array([[1.0, 2.0]]), np.zeros(1))
    both = [Mode(mode.controller, plants) for mode in modes()]
    with pytest.raises(DomainError, match="without direct path"):
        simulate(both, driven(RELATIVE, InactiveController.HOLD))


def with_zeros_and_dead_times(dead: tuple[float, float] = (0.0, 0.0)) -> list[Mode]:
    """Modes of order 2 and 3 with a zero, each with its own dead time, s, uncertain by a fifth where there is one."""
    rng, found = np.random.default_rng(5), []
    tops, bottoms = ((4.0, 20.0), (-0.8, 2.0, 8.0)), ((2.0, 3.0, 1.0), (0.3, 1.0, 1.5, 1.0))
    for mode, top, bottom, late in zip(modes(), tops, bottoms, dead, strict=True):
        every = np.tile(np.array(bottom), (PLANTS, 1))
        every[:, 0] *= rng.uniform(0.7, 1.3, PLANTS)
        times = late * rng.uniform(0.8, 1.2, PLANTS)
        found.append(Mode(mode.controller, Plants(np.tile(np.array(top), (PLANTS, 1)), every, times)))
    return found


def with_dead_times_of_lags(dead: tuple[float, float]) -> list[Mode]:
    found, rng = [], np.random.default_rng(6)
    for mode, late in zip(modes(), dead, strict=True):
        assert isinstance(mode.plants, Plants)
        times = late * rng.uniform(0.8, 1.2, PLANTS)
        found.append(Mode(mode.controller, Plants(mode.plants.numerator, mode.plants.denominator, times)))
    return found


def assert_alike(both: list[Mode], scenario: Scenario) -> Traces:
    """The compiled run and the plain one, rates included; returns the first."""
    assert scenario.hybrid is not None
    delay = scenario.actuator.delay_samples
    one, two = scenario.hybrid.delay_samples or (delay, delay)
    plants = [mode.plants for mode in both if isinstance(mode.plants, Plants)]
    held, segments = discretize_modes(plants, TS, (one, two), scenario.signals.load is not None)
    plain = simulate_reference([mode.controller for mode in both], held, scenario, segments=segments)
    found = simulate(both, scenario)
    assert_same(found, plain)
    np.testing.assert_allclose(found.rate, plain.rate, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(found.rate_after, plain.rate_after, rtol=1e-9, atol=1e-9)
    return found


DEAD_TIMES = [(0.0, 0.0), (0.5, 0.0), (0.0, 0.31), (0.4, 0.4), (1.3, 0.07)]


@pytest.mark.parametrize("dead", DEAD_TIMES)
def test_zeros_and_dead_times_of_the_modes_own_are_the_same_in_both_runs(dead: tuple[float, float]) -> None:
    for lines, delay, own in ((RELATIVE, 0.0, ()), (COASTING, 0.4, ()), (0.4, 0.0, (2, 1))):
        scenario = dataclasses.replace(driven(lines, InactiveController.RESET), start=Start(2.0))
        scenario = dataclasses.replace(
            scenario, actuator=Actuator(delay_samples=delay),
            hybrid=dataclasses.replace(scenario.hybrid or Hybrid(0.0), delay_samples=own),
        )  # fmt: skip
        for both in (with_zeros_and_dead_times(dead), with_dead_times_of_lags(dead)):
            assert {1, 2} <= set(np.unique(assert_alike(both, scenario).mode))


def test_a_standstill_behind_a_dead_time_is_the_same_in_both_runs() -> None:
    levels = np.concatenate([np.linspace(6.0, 0.0, 40), np.zeros(40), np.linspace(0.0, 5.0, 40)])
    load = np.where(np.arange(STEPS) < 60, -0.35, 0.1)
    hybrid = driven(0.2, InactiveController.RESET).hybrid or Hybrid(0.0)
    for hold in ((1.2, 0.3), (1.2, -np.inf)):
        scenario = Scenario(
            TS, Signals(levels, load), start=Start(6.0, InitialInput.FREE),
            hybrid=dataclasses.replace(hybrid, hold_below=hold),
        )  # fmt: skip
        found = assert_alike(with_dead_times_of_lags((0.5, 0.13)), scenario)
        assert (found.output == 0.0).any()


def test_a_mode_with_zero_and_dead_time_that_is_never_left_is_the_single_loop() -> None:
    lines, both = SwitchingLines(Threshold(1e6), Threshold(-1e6)), with_zeros_and_dead_times((0.53, 0.2))
    for delay, load in ((0.0, None), (0.4, np.sin(0.1 * np.arange(STEPS)))):
        alone = Scenario(TS, Signals(LEVELS, load), actuator=Actuator(delay_samples=delay), start=Start(3.0))
        found = simulate(both, dataclasses.replace(alone, hybrid=Hybrid(lines)))
        single = simulate(both[:1], alone)
        np.testing.assert_allclose(found.output, single.output, rtol=1e-11, atol=1e-11)
        np.testing.assert_allclose(found.rate, single.rate, rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(found.rate_after, single.rate_after, rtol=1e-9, atol=1e-9)


def test_a_dead_time_of_whole_samples_is_a_computing_delay_where_there_is_no_load() -> None:
    for one, two in ((3, 1), (0, 2), (2, 2)):
        scenario = dataclasses.replace(driven(COASTING, InactiveController.HOLD), signals=Signals(LEVELS))
        exact = [
            Mode(mode.controller, Plants(mode.plants.numerator, mode.plants.denominator, np.full(PLANTS, late * TS)))
            for mode, late in zip(modes(), (one, two), strict=True)
            if isinstance(mode.plants, Plants)
        ]
        own = dataclasses.replace(scenario.hybrid or Hybrid(0.0), delay_samples=(one, two))
        late = simulate(exact, scenario)
        computed = simulate(modes(), dataclasses.replace(scenario, hybrid=own))
        assert np.array_equal(late.mode, computed.mode)
        np.testing.assert_allclose(late.output, computed.output, rtol=1e-11, atol=1e-11)


@pytest.mark.parametrize("delays", [(1, 3), (3, 0), (0, 2)])
@pytest.mark.parametrize("lines", [0.4, COASTING], ids=["hysteresis", "coast"])
def test_controls_that_are_late_by_times_of_their_own_arrive_alike(
    lines: SwitchingLines | float, delays: tuple[int, int]
) -> None:
    scenario = driven(lines, InactiveController.HOLD)
    hybrid = dataclasses.replace(scenario.hybrid or Hybrid(0.0), delay_samples=delays)
    scenario = dataclasses.replace(scenario, hybrid=hybrid)
    for both in (modes(), of_higher_order(ORDERS["2-1"])):
        held = [discretize_plants(m.plants, TS) for m in both if isinstance(m.plants, Plants)]
        start = dataclasses.replace(scenario, start=Start(0.0))
        plain = simulate_reference([mode.controller for mode in both], in_derivatives(held), start)
        assert_same(simulate(both, start), plain)
    assert {1, 2} <= set(np.unique(plain.mode))


@pytest.mark.parametrize("delay", [0, 2])
def test_equal_delays_of_their_own_are_the_actuators(delay: int) -> None:
    scenario = driven(0.4, InactiveController.TRACK)
    own = dataclasses.replace(scenario.hybrid or Hybrid(0.0), delay_samples=(delay, delay))
    one = simulate(modes(), dataclasses.replace(scenario, hybrid=own))
    two = simulate(modes(), dataclasses.replace(scenario, actuator=Actuator(delay_samples=float(delay))))
    np.testing.assert_allclose(one.output, two.output, rtol=1e-12, atol=1e-12)
    assert np.array_equal(one.mode, two.mode)
