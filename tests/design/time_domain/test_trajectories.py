"""Signals with derivatives by a controller's numbers: a closed form, differences of high order, ends of ranges."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import pytest

from fopi_tune.core.controller import FoPi
from fopi_tune.design.time_domain.loop_cuts import LoopCuts
from fopi_tune.design.time_domain.model import Modeller
from fopi_tune.design.time_domain.problem import ScenarioProblem
from fopi_tune.design.time_domain.trajectories import Trajectories
from fopi_tune.digital.implementation import implementation_of, runtime_of
from fopi_tune.simulation.sampled.simulate import simulate
from fopi_tune.simulation.scenario import Mode, Traces
from fopi_tune.spec import parse_spec

TEXT = """
schema: 1
name: trajectories
plant: {{model: lag, static_gain: 1.0, time_constant_s: {{min: 1.6, max: 3.1, nominal: 2.3}}, dead_time_s: 0.1}}
controller: {{{controller}}}
requirements: [{{iae: {{at_most: 9}}}}]
digital: {{sample_time_s: 0.2, poles: 5{digital}}}
scenarios: [{{name: one, duration_s: 12, reference: [{{at_s: 0, value: 3}}], load: [{{at_s: 6, value: 0.5}}]{more}}}]
"""
WIDE = "{min: -9, max: 9}"
ORDER = "{min: 0.3, max: 1.7}"
FOPI = f"kp: {WIDE}, ki: {WIDE}, alpha: {ORDER}"
PID = f"structure: pid, kp: {WIDE}, ki: {WIDE}, kd: {WIDE}, derivative_filter_time_constant_s: 0.3"
FOPID = PID.replace("pid", f"fopid, alpha: {ORDER}, mu: {{min: 0.3, max: 1}}")
#: words of controller, section digital and scenario, and numbers
CASES = {
    "fopi": (FOPI, "", "", [0.6, 0.3, 0.8]),
    "pi": (FOPI, "", "", [0.6, 0.3, 1.0]),
    "pid": (PID, "", "", [0.9, 0.5, 0.2]),
    "pid, negative": (PID, "", "", [-0.2, -0.1, -0.05]),
    "fopid": (FOPID, "", "", [0.9, 0.5, 0.2, 0.9, 0.7]),
    "weight": (f"{PID}, setpoint_weight: 0.4", "", "", [0.9, 0.5, 0.2]),
    "filter": (f"{FOPI}, measurement_filter: {{order: 2, time_constant_s: 0.4}}", "", "", [0.6, 0.3, 1.2]),
    "at the crossover": (PID, ", prewarp: crossover", "", [2.9, 0.9, 0.3]),
    "matched": (FOPI, ", rule: matched", "", [1.4, 0.5, 0.8]),
    "delayed": (FOPID, ", delay_samples: 0.4", "", [0.9, 0.5, 0.2, 1.2, 0.6]),
    "without an integral": (PID.replace(f"ki: {WIDE}", "ki: 0"), "", "", [0.9, 0.0, 0.2]),
}
#: central difference of order 8, and its step
OFFSETS = (-4, -3, -2, -1, 1, 2, 3, 4)
SHARES = (1 / 280, -4 / 105, 1 / 5, -4 / 5, 4 / 5, -1 / 5, 4 / 105, -1 / 280)
STEP = 1e-3
SIGNALS = ("output", "rate", "rate_after", "applied")


@lru_cache
def modeller(controller: str, digital: str = "", more: str = "") -> Modeller:
    problem = ScenarioProblem.of(parse_spec(TEXT.format(controller=controller, digital=digital, more=more)))
    return Modeller(problem, LoopCuts(problem.loop), np.array([[1.6], [2.3], [3.1]]))


def found_for(made: Modeller, x: list[float]) -> Trajectories:
    found = made.trajectories_of(made.problem.numbers.controller(np.array(x)))
    assert found is not None
    return found["one"]


def simulated(made: Modeller, x: np.ndarray) -> Traces:
    spec = made.problem.spec
    runtime = runtime_of(implementation_of(spec, made.problem.numbers.controller(x)).sections, spec)
    return simulate([Mode(runtime, made.plants)], made.problem.runs[0].run)


@pytest.mark.parametrize("name", CASES)
def test_values_are_those_of_the_simulation_and_derivatives_its_own(name: str) -> None:
    controller, digital, more, x = CASES[name]
    made = modeller(controller, digital, more)
    found, plain = found_for(made, x), simulated(made, np.array(x))
    low, high = made.problem.numbers.box
    for signal in SIGNALS:
        np.testing.assert_array_equal(getattr(found, signal)[..., 0], getattr(plain, signal))
    for j in range(len(x)):
        if low[j] == high[j]:
            assert not found.output[..., 1 + j].any()
            continue
        ends = [simulated(made, np.array(x) + STEP * offset * np.eye(len(x))[j]) for offset in OFFSETS]
        for signal in SIGNALS:
            expected = np.tensordot(SHARES, [getattr(end, signal) for end in ends], axes=1) / STEP
            close = np.abs(getattr(found, signal)[..., 1 + j] - expected) <= 2e-8 * np.abs(expected).max()
            # the larger of two rates has a kink where the other becomes it
            assert close.mean() > 0.98 if signal == "rate_after" else close.all()


def test_a_proportional_loop_has_a_closed_form() -> None:
    """y_k = K kp r (1 - p^k)/(1 + K kp), p = a - (1 - a) K kp: without dead time and load."""
    text = TEXT.replace(", dead_time_s: 0.1", "").replace("load: [{{at_s: 6, value: 0.5}}]", "load: []")
    spec = parse_spec(text.format(controller="kp: {min: 0, max: 9}, ki: 0, alpha: 1", digital="", more=""))
    problem = ScenarioProblem.of(spec)
    taus, kp, k = np.array([1.6, 2.3, 3.1]), 1.7, np.arange(60)
    found = found_for(Modeller(problem, LoopCuts(problem.loop), taus[:, None]), [kp, 0.0, 1.0]).output
    a = np.exp(-0.2 / taus)[:, None]
    p = a - (1.0 - a) * kp
    share = kp / (1.0 + kp)
    np.testing.assert_allclose(found[:, :60, 0], 3.0 * share * (1.0 - p**k), atol=1e-13)
    slope = (1.0 - p**k) / (1.0 + kp) ** 2 + share * (1.0 - a) * k * p ** np.maximum(k - 1, 0)
    np.testing.assert_allclose(found[:, :60, 1], 3.0 * slope, atol=1e-8)


def test_a_limited_control_does_not_move() -> None:
    made = modeller(PID, ", output_limits: [-0.5, 4.0]")
    found, plain = found_for(made, [2.0, 1.5, 0.4]), simulated(made, np.array([2.0, 1.5, 0.4]))
    limited = (plain.applied == 4.0) | (plain.applied == -0.5)
    assert limited.sum() > 9
    assert not found.applied[limited, 1:].any()
    assert found.applied[~limited, 1:].any(axis=0).all()


@pytest.mark.parametrize("end", [0.0, 2.0])
def test_next_to_the_end_of_a_range_the_difference_lies_inside(end: float) -> None:
    """With kp at either end of its range: the same derivative as within a wider one."""
    inside = found_for(modeller(FOPI), [end, 0.4, 0.9])
    at_end = found_for(modeller(FOPI.replace(WIDE, "{min: 0, max: 2}", 1)), [end, 0.4, 0.9])
    np.testing.assert_allclose(at_end.output, inside.output, atol=1e-8 * np.abs(inside.output).max())


def test_a_loop_that_grows_without_end_has_none() -> None:
    made = modeller(FOPI, "", "")
    assert made.trajectories_of(FoPi(8.9, 8.9, 1.6)) is not None
    grows = modeller(FOPI.replace(WIDE, "{min: 0, max: 1.0e+9}"))
    assert grows.trajectories_of(FoPi(1e7, 1e7, 1.0)) is None
