"""Loops at rest on samples: no number stays subnormal, in the compiled kernel as in the plain simulation."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from fopi_tune.core.loops import Plants
from fopi_tune.core.parallel_form import Sections
from fopi_tune.digital.realise import Precision
from fopi_tune.digital.runtime import Runtime, init, step, track
from fopi_tune.simulation.sampled import layout, simulate
from fopi_tune.simulation.sampled.plants import discretize_plants
from fopi_tune.simulation.sampled.reference import simulate_reference
from fopi_tune.simulation.scenario import (
    Actuator,
    Hybrid,
    InactiveController,
    Mode,
    Scenario,
    Sensor,
    Signals,
    Traces,
)

TS = 0.2
#: long enough for these loops to go from 1 to below float64's smallest number
REST = 5000
#: one section of each kind: an integrator, one that decays, one that alternates
SECTIONS = Sections(TS, 0.1, (1.0, 0.6, -0.4), (0.15, 0.05, 0.03))
#: a step up and back, rest, and steps both ways
STEPS = np.concatenate([np.ones(20), np.zeros(REST), -np.ones(30), np.ones(30)])
SMALLEST = np.finfo(float).smallest_normal
BOTH = {"up": (0.0, 2.0), "down": (-2.0, 0.0), "wide": (-9.0, 9.0)}
LOOPS = {
    "plain": Scenario(TS, Signals(STEPS)),
    "quantised": Scenario(TS, Signals(STEPS + 0.5), Sensor(quantum=0.25)),
    "late and slow": Scenario(TS, Signals(STEPS), actuator=Actuator(2.0, 0.4)),
}


def controller(name: str) -> Runtime:
    return Runtime.of(SECTIONS, Precision.FLOAT64, BOTH[name])


def fast_plants(order: int) -> Plants:
    """Static gain 1, real poles at -2 to -15 rad/s; more than one block of the kernel's."""
    poles = np.linspace(2.0, 3.0, 40)[:, None] * np.linspace(1.0, 5.0, order)
    denominators = np.array([np.poly(-row) for row in poles]).astype(float)
    return Plants(denominators[:, -1:], denominators, np.zeros(len(poles)))


def subnormal(values: np.ndarray) -> np.ndarray:
    return (values != 0.0) & (np.abs(values) < SMALLEST)


def run(modes: list[Mode], scenario: Scenario, patch: pytest.MonkeyPatch) -> tuple[Traces, np.ndarray]:
    """The kernel's traces, and its scratch array after the last block: states of plants and controllers, and more."""
    kept, aligned = [], simulate._aligned

    def remembered(count: int) -> np.ndarray:
        kept.append(aligned(count))
        return kept[-1]

    with patch.context() as context:
        context.setattr(simulate, "_aligned", remembered)
        traces = simulate.simulate(modes, scenario)
    return traces, kept[-1]


def shortened(scenario: Scenario) -> Scenario:
    """Up to the end of the rest."""
    return dataclasses.replace(scenario, signals=Signals(scenario.signals.reference[:REST]))


def test_the_compiled_threshold_is_the_precisions() -> None:
    assert Precision.FLOAT64.flush_below == layout.FLUSH_BELOW


@pytest.mark.parametrize("order", [1, 2, 3])
@pytest.mark.parametrize("case", LOOPS)
def test_a_loop_at_rest_holds_no_subnormal_number(case: str, order: int, monkeypatch: pytest.MonkeyPatch) -> None:
    modes = [Mode(controller("wide"), fast_plants(order))]
    traces, numbers = run(modes, shortened(LOOPS[case]), monkeypatch)
    assert not np.any(subnormal(numbers))
    # a quantised loop rests at what the quantum lets it
    assert case == "quantised" or not np.any(traces.output[:, -1])


@pytest.mark.parametrize("inactive", InactiveController)
@pytest.mark.parametrize("case", LOOPS)
def test_a_hybrid_loop_at_rest_holds_no_subnormal_number(
    case: str, inactive: InactiveController, monkeypatch: pytest.MonkeyPatch
) -> None:
    scenario = shortened(dataclasses.replace(LOOPS[case], hybrid=Hybrid(0.3, inactive)))
    for limits in (("up", "down"), ("wide", "wide")):
        modes = [Mode(controller(name), fast_plants(1)) for name in limits]
        traces, numbers = run(modes, scenario, monkeypatch)
        assert np.any(traces.mode == 2)
        assert not np.any(subnormal(numbers))


@pytest.mark.long
def test_the_plain_simulation_rests_as_the_kernel_does_and_would_not_without(monkeypatch: pytest.MonkeyPatch) -> None:
    scenario, plants = shortened(LOOPS["plain"]), fast_plants(2).take(np.array([0, 39]))
    held = [discretize_plants(plants, TS)]
    traces = simulate_reference([controller("wide")], held, scenario)
    compiled = simulate.simulate([Mode(controller("wide"), plants)], scenario)
    for one, two in zip(traces.output, compiled.output, strict=True):
        # rounding in another order can move the last sample that is not 0 by one, or what is left by its last places
        assert abs(int(np.flatnonzero(one)[-1]) - int(np.flatnonzero(two)[-1])) <= 1
        assert not np.any(subnormal(one) | subnormal(two))
    with monkeypatch.context() as patch:
        patch.setattr(Precision, "flush_below", 0.0)
        unflushed = simulate_reference([controller("wide")], held, scenario)
    assert np.any(subnormal(unflushed.output[:, -1]))
    # and above the threshold's size nothing is different
    large = np.abs(unflushed.output) > Precision.FLOAT64.absorbs_flushed
    np.testing.assert_array_equal(traces.output[large], unflushed.output[large])


@pytest.mark.thinned(2)
@pytest.mark.parametrize("case", LOOPS)
def test_through_rest_and_out_of_it_the_controller_is_the_runtime_bit_for_bit(case: str) -> None:
    plants = fast_plants(1).take(np.array([0, 20]))
    traces = simulate.simulate([Mode(controller("wide"), plants)], LOOPS[case])
    for measured, demanded in zip(traces.measured, traces.demanded, strict=True):
        own = controller("wide")
        state = init(own)
        for reference, y, u in zip(LOOPS[case].signals.reference, measured, demanded, strict=True):
            state = step(own, state, float(reference), float(y))
            assert state.output.tobytes() == u.tobytes()


@pytest.mark.thinned(4)
@pytest.mark.parametrize("inactive", InactiveController)
@pytest.mark.parametrize("case", LOOPS)
def test_through_rest_both_controllers_of_a_hybrid_loop_are_the_runtime_bit_for_bit(
    case: str, inactive: InactiveController
) -> None:
    pair, plants = (controller("up"), controller("down")), fast_plants(1).take(np.array([0, 20]))
    scenario = dataclasses.replace(LOOPS[case], hybrid=Hybrid(0.3, inactive))
    traces = simulate.simulate([Mode(pair[0], plants), Mode(pair[1], plants)], scenario)
    for i in range(2):
        memory, last = [init(one) for one in pair], 0
        for k, r in enumerate(scenario.signals.reference):
            y, mode = float(traces.measured[i, k]), int(traces.mode[i, k]) - 1
            if mode != last and inactive is InactiveController.RESET:
                memory[mode] = init(pair[mode])
            last = mode
            memory[mode] = step(pair[mode], memory[mode], float(r), y)
            assert memory[mode].output.tobytes() == traces.demanded[i, k].tobytes()
            if inactive is InactiveController.TRACK:
                other = 1 - mode
                memory[other] = track(pair[other], memory[other], float(r), y, float(traces.applied[i, k]))
        # it came out of its rest with both
        assert set(traces.mode[i, REST:]) == {1, 2}
