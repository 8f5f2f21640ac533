"""The limits omega -> 0 and inf in the solver's symbols, against responses at very low and very high frequencies."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

from fopi_tune.core.controller import FoPi
from fopi_tune.core.loops import Loops, Plants
from fopi_tune.core.peaks import Response
from fopi_tune.design.constraints import Scale
from fopi_tune.design.nlp.ends import WIDTH, end_of, limit_loop
from fopi_tune.design.probes import probes_of
from fopi_tune.quantities import QUANTITIES

SCALE = Scale(2.0, 0.7, np.array([1.0]))
NAMES = {
    Response.SENSITIVITY: "sensitivity_db",
    Response.COMPLEMENTARY_SENSITIVITY: "complementary_sensitivity_db",
    Response.CONTROL_SENSITIVITY: "control_sensitivity_db",
    Response.LOOP_GAIN: "loop_gain_db",
}
PLANTS = {
    "lag": ([2.0], [3.0, 1.0]),
    "integrator": ([2.0], [3.0, 1.0, 0.0]),
    "direct path": ([0.8, 2.0], [3.0, 1.0]),
    "direct path, negative": ([-0.8, 2.0], [3.0, 1.0]),
    "zero at 0": ([1.5, 0.0], [1.0, 1.0]),
    "with a leading zero coefficient": ([0.0, 2.0], [0.0, 3.0, 1.0]),
}


def limit(plants: Plants, gains: FoPi, end: float, response: Response, largest: bool) -> float:
    """ln of a response at an end of the axis, by the slot's formula."""
    found = end_of(plants, 0, SCALE, end, gains.ki != 0.0, response, largest)
    kp, parameters = ca.SX.sym("kp"), ca.SX.sym("end", WIDTH)
    at = limit_loop(SCALE)(kp, parameters, 1e-9, 1e-9)
    value = found.formula * QUANTITIES[NAMES[response]].natural(at) + found.constant
    return float(ca.Function("value", [kp, parameters], [value])(gains.kp * SCALE.gain, found.parameters))


def responses(top: list[float], bottom: list[float], gains: FoPi, s: np.ndarray, turn: np.ndarray | float) -> dict:
    """ln of every response; `turn` is the dead time's factor."""
    controller = gains.kp + gains.ki * s**-gains.alpha
    loop = controller * np.polyval(top, s) / np.polyval(bottom, s) * turn
    sizes = {
        Response.SENSITIVITY: 1.0 / (1.0 + loop),
        Response.COMPLEMENTARY_SENSITIVITY: loop / (1.0 + loop),
        Response.CONTROL_SENSITIVITY: controller / (1.0 + loop),
        Response.LOOP_GAIN: loop,
    }
    return {response: np.log(np.abs(value)) for response, value in sizes.items()}


@pytest.mark.parametrize("gains", [FoPi(0.9, 0.4, 0.8), FoPi(0.4, 0.0, 1.0), FoPi(-0.3, 0.0, 1.0), FoPi(0.9, 0.4, 1.6)])
@pytest.mark.parametrize("end", [0.0, np.inf])
@pytest.mark.parametrize("plant", [name for name in PLANTS if name != "zero at 0"])
def test_limits_are_what_responses_tend_to(plant: str, end: float, gains: FoPi) -> None:
    top, bottom = PLANTS[plant]
    s = np.array([1e-13j if end == 0.0 else 1e13j])
    expected = responses(top, bottom, gains, s, 1.0)
    for response, value in expected.items():
        found = limit(Plants(np.array([top]), np.array([bottom]), np.zeros(1)), gains, end, response, True)
        # 1e13 beyond the corners a term of s^-0.8 is 4e-11; what tends to 0 or infinity is beyond 9 neper by far
        if abs(value[0]) > 9.0:
            assert np.sign(found) == np.sign(value[0])
            assert abs(found) > 9.0
        else:
            assert found == pytest.approx(value[0], abs=1e-9)


@pytest.mark.parametrize("kp", [0.7, -0.7])
def test_a_zero_at_the_origin_leaves_the_proportional_gain(kp: float) -> None:
    top, bottom = PLANTS["zero at 0"]
    plants = Plants(np.array([top]), np.array([bottom]), np.zeros(1))
    gains = FoPi(kp, 0.0, 1.0)
    assert limit(plants, gains, 0.0, Response.SENSITIVITY, True) == pytest.approx(0.0)
    assert limit(plants, gains, 0.0, Response.CONTROL_SENSITIVITY, True) == pytest.approx(np.log(0.7))
    assert limit(plants, gains, 0.0, Response.LOOP_GAIN, True) < -15.0


@pytest.mark.parametrize("largest", [True, False])
@pytest.mark.parametrize("plant", ["direct path", "direct path, negative", "lag"])
def test_behind_a_dead_time_the_limits_are_the_ends_of_the_ripples(plant: str, largest: bool) -> None:
    top, bottom = PLANTS[plant]
    gains = FoPi(1.1, 0.5, 1.2)
    turns = np.exp(1j * np.linspace(0.0, 2.0 * np.pi, 720_001))
    expected = responses(top, bottom, gains, np.full(len(turns), 1e13j), turns)
    plants = Plants(np.array([top]), np.array([bottom]), np.array([0.3]))
    for response in (Response.SENSITIVITY, Response.COMPLEMENTARY_SENSITIVITY, Response.CONTROL_SENSITIVITY):
        value = expected[response].max() if largest else expected[response].min()
        found = limit(plants, gains, np.inf, response, largest)
        # on a scan of 1e-5 rad; what vanishes is beyond 9 neper
        assert found == pytest.approx(value, abs=1e-8) or max(found, value) < -9.0


def test_the_formula_is_finite_and_falls_where_the_loop_leaves_the_stable_range() -> None:
    # 1 - |l| < 0 behind a dead time: the solver has to be led back, not stopped
    top, bottom = PLANTS["direct path"]
    plants = Plants(np.array([top]), np.array([bottom]), np.array([0.3]))
    kp = np.array([3.0, 3.7, 3.75, 3.8, 5.0, 50.0])
    peaks = [limit(plants, FoPi(float(k), 0.5, 1.0), np.inf, Response.SENSITIVITY, True) for k in kp]
    assert np.isfinite(peaks).all()
    assert (np.diff(peaks) > 0.0).all()


def test_the_oracle_has_the_same_limits() -> None:
    from fopi_tune.design.constraints import constraints_of
    from fopi_tune.spec import parse_spec

    spec = parse_spec(
        "schema: 1\nname: x\n"
        "plant: {model: transfer_function, numerator: [{min: 0.5, max: 1}, 2], denominator: [3, 1], dead_time_s: 0.3}\n"
        "requirements: [{control_sensitivity_db: {at_most: 3}}, {loop_gain_db: {at_least: -9}, from_rad_s: 5}]\n"
    )
    constraints, gains = constraints_of(spec), FoPi(1.1, 0.5, 1.2)
    plants = Plants.members(spec.plant, np.array([[0.5], [0.8], [1.0]]))
    direct = 1.1 * np.array([0.5, 0.8, 1.0]) / 3.0
    expected: dict[tuple[int | None, float], np.ndarray] = {
        (0, 0.0): np.log(10.0) * 3.0 / 20.0 - np.log(0.5) + 0.0 * direct,
        (0, np.inf): np.log(10.0) * 3.0 / 20.0 - np.log(1.1 / (1.0 - direct)),
        (1, np.inf): np.log(direct) + np.log(10.0) * 9.0 / 20.0,
    }
    probes = [p for p in probes_of(constraints) if p.of_loops is not None and p.constraint in (0, 1)]
    assert {(p.constraint, p.at_omega_rad_s) for p in probes} == set(expected)
    for probe in probes:
        assert probe.of_loops is not None
        slack = probe.of_loops(Loops.of(gains, plants))
        assert slack == pytest.approx(expected[probe.constraint, probe.at_omega_rad_s], abs=1e-12)
