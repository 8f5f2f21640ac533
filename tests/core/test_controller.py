"""Controllers as functions of s, and loops of a PID against loops whose plant holds it."""

from __future__ import annotations

import math

import numpy as np
import pytest
from cases.random_loops import random_plant

from fopi_tune.core.controller import FoPi, FoPid, Pid, controller_of, numbers_of
from fopi_tune.core.loops import Loops, Plants
from fopi_tune.core.margins import margins
from fopi_tune.core.peaks import Response, extremes
from fopi_tune.core.plant import Plant
from fopi_tune.core.stability import is_stable, unstable_closed_loop_poles
from fopi_tune.core.terms.measurement_filter import MeasurementFilter
from fopi_tune.errors import DomainError

#: relative; both evaluate the same rational function, one by its roots
SAME = 1e-9


def with_pid(plant: Plant, pid: Pid) -> Plant:
    """C P as one plant."""
    filter_s = pid.derivative_filter_time_constant_s
    top = np.polymul([pid.kp * filter_s + pid.kd, pid.kp + pid.ki * filter_s, pid.ki], plant.numerator)
    bottom = np.polymul([filter_s, 1.0, 0.0], plant.denominator)
    return Plant(tuple(np.trim_zeros(top, "f")), tuple(bottom), plant.dead_time_s)


def random_pid(rng: np.random.Generator) -> Pid:
    kp, ki, kd = rng.choice([-1.0, 1.0], p=[0.2, 0.8]) * np.exp(rng.normal(size=3))
    kp, kd = kp * rng.choice([1.0, 0.0, -0.3], p=[0.8, 0.1, 0.1]), kd * rng.choice([1.0, -0.2], p=[0.9, 0.1])
    return Pid(float(kp), float(ki), float(kd), float(np.exp(rng.normal() - 2.0)))


def test_controllers_are_functions_of_s() -> None:
    s = np.array([[0.3 + 0.1j, 2j], [-0.5 + 1j, 7.0 + 0j]])
    np.testing.assert_allclose(FoPi(1.5, 0.7, 0.6)(s), 1.5 + 0.7 * s**-0.6, rtol=1e-15)
    np.testing.assert_allclose(Pid(1.5, 0.7, 0.2, 0.1)(s), 1.5 + 0.7 / s + 0.2 * s / (0.1 * s + 1.0), rtol=1e-15)


def test_a_proportional_controller_is_finite_at_the_origin() -> None:
    assert FoPi(1.5, 0.0, 0.6)(0.0) == 1.5


@pytest.mark.parametrize(
    "controller",
    [
        FoPi(1.5, 0.7, 0.6),
        FoPi(1.5, -0.7, 1.9),
        FoPi(-2.0, 0.0, 0.6),
        Pid(1.5, 0.7, 0.2, 0.1),
        FoPid(1.5, -0.7, 0.6, 0.2, 0.5, 0.1),
        FoPi(1.5, 0.7, 0.6, measurement_filter=MeasurementFilter(2, 0.3)),
        Pid(1.5, 0.7, 0.2, 0.1, measurement_filter=MeasurementFilter(1, 0.3)),
    ],
)
def test_limits_at_the_ends_are_what_values_near_them_tend_to(controller: FoPi) -> None:
    at_zero, at_infinity = controller(np.array([0.0, math.inf]))
    near, far = controller(np.array([1e-300, 1e300]))
    if controller.ki == 0.0:
        assert at_zero == pytest.approx(near)
    else:
        assert at_zero.real == math.copysign(math.inf, near.real)
        assert abs(near) > 1e100
    assert at_infinity == pytest.approx(far, abs=1e-100)
    assert controller(0.0) == at_zero
    # a number between them is none of the ends, whatever stands beside it
    assert controller(np.array([0.0, 0.3j, math.nan]))[1] == pytest.approx(controller(0.3j), rel=1e-14)
    assert np.isnan(controller(math.nan))
    for what in ("fast", "1", b"1", None, [None, 1.0], ["0.3", 1.0], np.array(["1"])):
        with pytest.raises(DomainError, match="is no complex number; give one"):
            controller(what)  # pyright: ignore[reportArgumentType]


def test_a_controller_is_infinite_at_its_pole() -> None:
    assert np.isposinf(Pid(1.5, 0.7, 0.2, 0.125)(-8.0).real)


def test_numbers_by_name_give_the_controller_back() -> None:
    for controller in (FoPi(1.0, 2.0, 0.4), Pid(1.0, 2.0, 0.4, 0.05)):
        assert controller_of(numbers_of(controller)) == controller


@pytest.mark.parametrize("filter_s", [0.0, -1.0, float("nan"), float("inf")])
def test_a_derivative_without_a_filter_is_refused(filter_s: float) -> None:
    with pytest.raises(DomainError, match="derivative_filter_time_constant_s"):
        Pid(1.0, 1.0, 1.0, filter_s)


def test_a_derivative_beside_another_order_than_one_is_refused() -> None:
    with pytest.raises(DomainError, match="order 1"):
        controller_of({"kp": 1.0, "ki": 1.0, "alpha": 0.9, "kd": 1.0, "derivative_filter_time_constant_s": 0.1})


def test_loops_of_a_pid_are_those_of_a_plant_that_holds_it() -> None:
    rng = np.random.default_rng(7)
    stable = 0
    for _ in range(150):
        plant, pid = (
            random_plant(rng, int(rng.integers(1, 5)), float(rng.choice([0.0, 0.3])), proper=False),
            random_pid(rng),
        )
        ours = Loops.of(pid, Plants.of(plant))
        other = Loops.of(FoPi(1.0, 0.0, 1.0), Plants.of(with_pid(plant, pid)))
        rows, omega = np.zeros(40, dtype=np.intp), np.geomspace(1e-3, 1e3, 40)
        np.testing.assert_allclose(ours.response(rows, omega), other.response(rows, omega), rtol=1e-9)
        u = np.log(omega)
        np.testing.assert_allclose(ours.log_response(rows, u), other.log_response(rows, u), rtol=1e-8, atol=1e-8)
        np.testing.assert_array_equal(unstable_closed_loop_poles(ours), unstable_closed_loop_poles(other))
        for response in (Response.SENSITIVITY, Response.COMPLEMENTARY_SENSITIVITY, Response.LOOP_GAIN):
            a, b = extremes(ours, response, 0.01, 100.0), extremes(other, response, 0.01, 100.0)
            np.testing.assert_allclose(a.value, b.value, rtol=SAME, atol=SAME)
        one, two = margins(pid, plant), margins(FoPi(1.0, 0.0, 1.0), with_pid(plant, pid))
        assert one.stable == two.stable
        if one.stable:
            stable += 1
            assert one.phase_margin_deg == pytest.approx(two.phase_margin_deg, rel=1e-7)
            assert one.gain_margin_db == pytest.approx(two.gain_margin_db, rel=1e-7, abs=1e-7)
    assert stable > 20


def test_the_control_sensitivity_of_a_pid_tends_to_its_direct_gain() -> None:
    pid = Pid(2.0, 1.0, 0.4, 0.1)
    found = extremes(
        Loops.of(pid, Plants.of(Plant((1.0,), (1.0, 3.0, 3.0, 1.0)))), Response.CONTROL_SENSITIVITY, 10.0, np.inf
    )
    s = np.asarray(1j * np.geomspace(10.0, 1e5, 20_000), dtype=complex)
    c = pid(s)
    dense = np.log(np.abs(c / (1.0 + c / (s + 1.0) ** 3))).max()
    # the supremum is approached: kp + kd/Tf = 6
    assert found.value[0] == pytest.approx(max(dense, np.log(6.0)), abs=1e-6)


@pytest.mark.parametrize(
    ("pid", "plant", "stable"),
    [
        # the integrator is behind a zero of C: the loop's own pole is on the left, the hidden one stays at 0
        (Pid(0.0, 0.0, 1.0, 0.1), Plant((1.0,), (1.0, 0.0)), False),
        (Pid(0.5, 0.0, 1.0, 0.1), Plant((1.0,), (1.0, 0.0)), True),
        (Pid(0.0, 0.0, 1.0, 0.1), Plant((1.0,), (1.0, 2.0)), True),
        # kp + ki Tf = 0: the zeros of C are +-j 2, where the plant has undamped poles
        (Pid(-0.1, 1.0, 0.26, 0.1), Plant((1.0,), (1.0, 1.0, 4.0, 4.0)), False),
        (Pid(-0.1, 1.0, 0.26, 0.1), Plant((1.0,), (1.0, 2.0, 5.0, 4.0)), True),
    ],
)
def test_a_pole_on_the_axis_that_the_controller_hides_is_no_stable_loop(pid: Pid, plant: Plant, stable: bool) -> None:
    assert bool(is_stable(Loops.of(pid, Plants.of(plant)))[0]) is stable
