"""Undershoot and rise time by their closed forms, and collected by the compiled simulation bit for bit."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import pytest

from fopi_tune.core.controller import FoPi
from fopi_tune.core.loops import Plants
from fopi_tune.digital.discretize import sections_of
from fopi_tune.digital.realise import Precision
from fopi_tune.digital.runtime import Runtime
from fopi_tune.simulation.measures import StepMeasures, measures_of, step_measures
from fopi_tune.simulation.sampled.simulate import measure, simulate
from fopi_tune.simulation.scenario import Actuator, Horizon, Measures, Mode, Scenario, Sensor, Signals, Start, Step
from fopi_tune.spec.model import DigitalSpec

TS, STEPS = 0.1, 200
INTEGRATOR = Plants(np.array([[1.0]]), np.array([[1.0, 0.0]]), np.zeros(1))


def runtime_of(gains: FoPi) -> Runtime:
    return Runtime.of(sections_of(gains, DigitalSpec(TS)), Precision.FLOAT64, None)


def found_for(
    gains: FoPi, plants: Plants, scenario: Scenario, steps: Sequence[Step] = (), first: int = 0
) -> tuple[Measures, StepMeasures]:
    """The measures, the same from the compiled simulation and from whole traces, and those of each step."""
    modes, horizon = [Mode(runtime_of(gains), plants)], Horizon(0.1, first, tuple(steps))
    traces = simulate(modes, scenario)
    plain, compiled = measures_of(traces, [modes[0].controller], scenario, horizon), measure(modes, scenario, horizon)
    for name in ("undershoot", "rise_s", "overshoot", "settling_s", "peak_jerk"):
        np.testing.assert_array_equal(getattr(compiled, name), getattr(plain, name), err_msg=name)
    return plain, step_measures(traces, scenario, horizon)


def crossing(level: float, ratio: float) -> float:
    """When 1 - ratio^k first reaches a level, on the line between two samples, in samples."""
    k = math.ceil(math.log(1.0 - level) / math.log(ratio) - 1e-12)
    before, after = 1.0 - ratio ** (k - 1), 1.0 - ratio**k
    return k - 1 + (level - before) / (after - before)


@pytest.mark.parametrize("size", [1.0, -3.0])
def test_the_rise_of_an_integrator_under_a_gain(size: float) -> None:
    # y <- y + kp Ts (r - y):  y_k = r (1 - (1 - kp Ts)^k), from y_0 = 2
    for kp in (0.5, 1.3, 4.0, 9.0, 10.0):
        scenario = Scenario(TS, Signals(np.full(STEPS, 2.0 + size)), start=Start(2.0))
        found, _ = found_for(FoPi(kp, 0.0, 1.0), INTEGRATOR, scenario)
        ratio = 1.0 - kp * TS
        expected = TS * (crossing(0.9, ratio) - crossing(0.1, ratio)) if ratio > 1e-9 else 0.8 * TS
        assert found.rise_s[0] == pytest.approx(expected, rel=1e-9)
        assert found.undershoot[0] == 0.0
        # between samples the output is a straight line nearly, and its rise in continuous time ln(9)/kp
        if kp < 1.0:
            assert found.rise_s[0] == pytest.approx(TS * math.log(9.0) / -math.log(ratio), rel=2e-3)


def test_the_rise_is_continuous_in_the_gains() -> None:
    scenario, gains = Scenario(TS, Signals(np.ones(STEPS))), np.linspace(0.8, 1.6, 401)
    rises = np.array([found_for(FoPi(kp, 0.0, 1.0), INTEGRATOR, scenario)[0].rise_s[0] for kp in gains])
    # ln(9)/kp falls by 2.75 to 0.86 s per unit of kp, in steps of 0.002
    assert np.diff(rises).max() < 0.0
    assert np.diff(rises).min() > -5.0 * 0.002


def test_an_output_that_goes_the_wrong_way_first() -> None:
    # (1 - T s)/(1 + T s) = -1 + 2/(1 + T s) with u = kp (r - y):  y_1 = (1 - 2 e^{-Ts/T}) kp r
    T, kp = 1.0, 0.1
    plants = Plants(np.array([[-T, 1.0]]), np.array([[T, 1.0]]), np.zeros(1))
    for size in (5.0, -5.0):
        found, _ = found_for(FoPi(kp, 0.0, 1.0), plants, Scenario(TS, Signals(np.full(STEPS, size))))
        assert found.undershoot[0] == pytest.approx((2.0 * math.exp(-TS / T) - 1.0) * kp * 5.0, rel=1e-12)
        # a gain of 0.1 ends far below nine tenths
        assert found.rise_s[0] == math.inf


def steps_of(*rows: tuple[int, float, float, bool]) -> list[Step]:
    return [Step(first, TS * first, before, value, 0.1, of_load) for first, before, value, of_load in rows]


def test_each_step_is_judged_up_to_the_next_one_of_the_reference() -> None:
    reference = np.repeat([4.0, 1.0, 1.5], [80, 40, 80])
    steps = steps_of((0, 0.0, 4.0, False), (80, 4.0, 1.0, False), (120, 1.0, 1.5, False))
    found, each = found_for(FoPi(1.0, 0.0, 1.0), INTEGRATOR, Scenario(TS, Signals(reference)), steps)
    rise = TS * (crossing(0.9, 0.9) - crossing(0.1, 0.9))
    # the second step begins a little short of its value before, the third one a little beyond it
    assert each.rise_s[:2, 0] == pytest.approx(rise, abs=1e-3)
    assert each.undershoot[:, 0] == pytest.approx([0.0, 0.0, 0.0], abs=1e-12)
    assert found.rise_s[0] == each.rise_s[:, 0].max()
    # 1.5 s are too short for nine tenths of the second one
    early = np.repeat([4.0, 1.0, 1.5], [80, 15, 105])
    steps = steps_of((0, 0.0, 4.0, False), (80, 4.0, 1.0, False), (95, 1.0, 1.5, False))
    found, each = found_for(FoPi(1.0, 0.0, 1.0), INTEGRATOR, Scenario(TS, Signals(early)), steps)
    assert np.isinf(each.rise_s[:, 0]).tolist() == [False, True, False]
    assert found.rise_s[0] == math.inf


def test_a_step_back_before_the_output_has_come_is_an_undershoot_of_the_way_that_it_lacks() -> None:
    reference = np.repeat([4.0, 1.0], [5, 195])
    steps = steps_of((0, 0.0, 4.0, False), (5, 4.0, 1.0, False))
    _, each = found_for(FoPi(1.0, 0.0, 1.0), INTEGRATOR, Scenario(TS, Signals(reference)), steps)
    # y is below 4 already where the step down from it begins: nothing goes back, and a tenth is passed at once
    assert each.undershoot[:, 0].tolist() == [0.0, 0.0]
    y = 4.0 * (1.0 - 0.9 ** np.arange(6))
    assert y[5] < 1.3 + 1.4
    assert each.rise_s[1, 0] == pytest.approx(TS * (math.log(0.3 / (y[5] - 1.0)) / math.log(0.9)), abs=0.02)


def test_a_load_goes_on_with_the_step_of_the_reference() -> None:
    # y rests at r + w/kp: pushed by -6 from 4 to -2, below the 0 of before
    load = np.repeat([0.0, -6.0], [60, 140])
    steps = steps_of((0, 0.0, 4.0, False), (60, 0.0, 4.0, True))
    scenario = Scenario(TS, Signals(np.full(STEPS, 4.0), load))
    found, each = found_for(FoPi(1.0, 0.0, 1.0), INTEGRATOR, scenario, steps)
    assert each.undershoot[:, 0] == pytest.approx([0.0, 2.0], abs=1e-4)
    assert found.undershoot[0] == each.undershoot[1, 0]
    assert np.isnan(each.rise_s[1, 0])
    rise = TS * (crossing(0.9, 0.9) - crossing(0.1, 0.9))
    assert found.rise_s[0] == pytest.approx(rise, rel=1e-9)
    # helped by a load before nine tenths: the rise of the reference's step goes on, and ends sooner
    load = np.repeat([0.0, 3.0], [10, 190])
    steps = steps_of((0, 0.0, 4.0, False), (10, 0.0, 4.0, True))
    found, each = found_for(FoPi(1.0, 0.0, 1.0), INTEGRATOR, Scenario(TS, Signals(np.full(STEPS, 4.0), load)), steps)
    y = 4.0 * (1.0 - 0.9**10)
    k = math.ceil(math.log((7.0 - 3.6) / (7.0 - y)) / math.log(0.9))
    last, now = (7.0 - (7.0 - y) * 0.9**n for n in (k - 1, k))
    assert found.rise_s[0] == pytest.approx(TS * (9.0 + k + (3.6 - last) / (now - last) - crossing(0.1, 0.9)), rel=1e-9)


def test_without_a_step_there_is_neither() -> None:
    load = np.repeat([0.0, -6.0], [60, 140])
    scenario = Scenario(TS, Signals(np.full(STEPS, 2.0), load), start=Start(2.0))
    found, _ = found_for(FoPi(1.0, 0.0, 1.0), INTEGRATOR, scenario)
    assert (found.undershoot[0], found.rise_s[0]) == (0.0, 0.0)
    assert found.overshoot[0] > 5.0


def test_a_step_under_way_counts_from_where_judging_begins() -> None:
    scenario = Scenario(TS, Signals(np.full(STEPS, 4.0)))
    # at sample 30 the output is beyond nine tenths already
    found, _ = found_for(FoPi(1.0, 0.0, 1.0), INTEGRATOR, scenario, steps_of((30, 0.0, 4.0, False)), 30)
    assert found.rise_s[0] == 0.0
    # and at sample 10 beyond a tenth
    found, _ = found_for(FoPi(1.0, 0.0, 1.0), INTEGRATOR, scenario, steps_of((10, 0.0, 4.0, False)), 10)
    assert found.rise_s[0] == pytest.approx(TS * (crossing(0.9, 0.9) - 10.0), rel=1e-9)


@pytest.mark.parametrize("order", [1, 2, 3])
def test_both_are_collected_bit_for_bit(order: int) -> None:
    rng = np.random.default_rng(order)
    bottoms = np.array([np.poly(-rng.uniform(0.3, 3.0, order)) for _ in range(70)]).astype(np.float64)
    # zeros on both sides, and some that never get there
    plants = Plants(rng.uniform(-0.5, 1.5, (70, order)) * bottoms[:, -1:], bottoms, rng.uniform(0.0, 0.3, 70))
    reference = np.repeat([4.0, -1.0, 1.5, 1.5], STEPS // 4)
    load = np.where(np.arange(STEPS) > 70, 0.8, 0.0)
    backwards = never = 0
    rows = ((0, 0.0, 4.0, False), (50, 4.0, -1.0, False), (71, 4.0, -1.0, True), (100, -1.0, 1.5, False))
    for sensor in (Sensor(), Sensor(0.02, 0.05, 3)):
        scenario = Scenario(TS, Signals(reference, load), sensor, Actuator(20.0, 0.4))
        for steps, first in ((rows, 0), (rows[1:], 20), ((), 7)):
            found, each = found_for(FoPi(0.8, 0.5, 0.9), plants, scenario, steps_of(*steps), first)
            np.testing.assert_array_equal(found.undershoot, each.undershoot.max(axis=0))
            backwards, never = backwards + (found.undershoot > 0.0).sum(), never + np.isinf(found.rise_s).sum()
    assert min(backwards, never) > 20


def test_an_output_that_does_not_stay_finite_never_rises() -> None:
    scenario = Scenario(TS, Signals(np.ones(2000)))
    with np.errstate(all="ignore"):
        found, _ = found_for(FoPi(300.0, 0.0, 1.0), INTEGRATOR, scenario)
    assert not found.finite[0]
    assert math.isnan(found.undershoot[0])
    assert found.rise_s[0] == math.inf


def test_the_jerk_is_the_largest_second_difference_of_the_samples_that_count() -> None:
    # y_k = r (1 - q^k):  y_k - 2 y_(k-1) + y_(k-2) = -r q^(k-2) (1 - q)^2
    ratio = 1.0 - 4.0 * TS
    scenario = Scenario(TS, Signals(np.full(STEPS, 3.0)))
    for first in (0, 7):
        found, _ = found_for(FoPi(4.0, 0.0, 1.0), INTEGRATOR, scenario, first=first)
        assert found.peak_jerk[0] == pytest.approx(3.0 * ratio**first * (1.0 - ratio) ** 2 / TS**2, rel=1e-12)
    for first in (STEPS - 2, STEPS - 1):
        assert found_for(FoPi(4.0, 0.0, 1.0), INTEGRATOR, scenario, first=first)[0].peak_jerk[0] == 0.0
