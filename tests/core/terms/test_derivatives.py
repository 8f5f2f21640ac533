"""Loops of a derivative of any order:  responses, margins, peaks and stability against NumPy and polynomials."""

from __future__ import annotations

import math

import numpy as np
import pytest
from cases.random_fopids import fopid_for, mirrored, orders
from cases.random_loops import random_plant
from cases.random_pids import plants_of
from cases.thinned import thinned
from oracles.dense_margins import UncertainError
from oracles.fopid_loops import FopidLoop, OfAnyOrder, controller, poles_by_sector

from fopi_tune.core.controller import FoPi, FoPid, Pid, controller_of, derivative_of, numbers_of
from fopi_tune.core.loops import Loops, Plants
from fopi_tune.core.margins import margins
from fopi_tune.core.peaks import Response, extremes
from fopi_tune.core.plant import Plant
from fopi_tune.core.stability import is_stable, steady_state_errors, unstable_closed_loop_poles
from fopi_tune.core.terms.controller_spec import ControllerSpec, GainRange
from fopi_tune.errors import DomainError

RESPONSES = {
    "sensitivity_db": Response.SENSITIVITY,
    "complementary_sensitivity_db": Response.COMPLEMENTARY_SENSITIVITY,
    "control_sensitivity_db": Response.CONTROL_SENSITIVITY,
    "loop_gain_db": Response.LOOP_GAIN,
}


def random_pair(rng: np.random.Generator) -> tuple[Plant, FoPid]:
    plants = plants_of(rng)
    found = fopid_for(rng, plants)
    if rng.random() < 0.15:
        plants, found = mirrored(plants, found)
    return plants.member(plants.nominal_point), found


def random_orders(rng: np.random.Generator, plant: Plant) -> FoPid:
    """Any signs; kd is there."""
    kp, ki, kd = (
        float(rng.choice([1.0, -1.0, 0.0], p=[0.7, 0.15, 0.15]) * 10.0 ** rng.uniform(-1.5, 1.0)) for _ in "pid"
    )
    return FoPid(kp, ki, orders(rng)[0], kd or 0.3, orders(rng)[1], float(10.0 ** rng.uniform(-2.5, 0.5)))


def test_it_is_a_function_of_s() -> None:
    s = np.array([[0.3 + 0.1j, 2j], [-0.5 + 1j, 7.0 + 0j]])
    wanted = 1.5 + 0.7 * s**-0.6 + 0.2 * s**0.4 / (0.1 * s + 1.0)
    np.testing.assert_allclose(FoPid(1.5, 0.7, 0.6, 0.2, 0.4, 0.1)(s), wanted, rtol=1e-15)
    np.testing.assert_array_equal(FoPid(1.5, 0.7, 1.0, 0.2, 1.0, 0.1)(s), Pid(1.5, 0.7, 0.2, 0.1)(s))


def test_numbers_by_name_give_the_controller_back() -> None:
    found = FoPid(1.0, 2.0, 0.4, 0.3, 0.7, 0.05)
    assert controller_of(numbers_of(found)) == found
    # of both orders 1 it is not taken for a PID, whose results have no mu
    assert controller_of(numbers_of(FoPid(1.0, 2.0, 1.0, 0.3, 1.0, 0.05))) == FoPid(1.0, 2.0, 1.0, 0.3, 1.0, 0.05)
    assert "mu" not in numbers_of(Pid(1.0, 2.0, 0.3, 0.05))


@pytest.mark.parametrize(
    ("numbers", "told"),
    [
        ((1.0, 1.0, 0.5, 1.0, 1.01, 0.1), "improper: behind the filter of first order its gain grows without end"),
        ((1.0, 1.0, 0.5, 1.0, 0.0, 0.1), "greater than 0"),
        ((1.0, 1.0, 0.5, 1.0, float("nan"), 0.1), "mu"),
        ((1.0, 1.0, 0.5, float("inf"), 0.5, 0.1), "kd"),
        ((1.0, 1.0, 0.5, 1.0, 0.5, 0.0), "derivative_filter_time_constant_s"),
        ((1.0, 1.0, 2.0, 1.0, 0.5, 0.1), "alpha"),
    ],
)
def test_numbers_outside_of_their_ranges_are_refused(numbers: tuple[float, ...], told: str) -> None:
    with pytest.raises(DomainError, match=told):
        FoPid(*numbers)


def test_the_largest_derivative_is_that_of_the_axis() -> None:
    for mu in (0.2, 0.5, 0.9, 1.0):
        found = FoPid(0.0, 0.0, 1.0, -2.0, mu, 0.1)
        dense = np.abs(found(1j * np.geomspace(1e-3, 1e9, 100_001))).max()
        # the peak is flat; of mu = 1 the limit is approached
        assert derivative_of(found).largest == pytest.approx(dense, rel=1e-6)
    assert derivative_of(FoPi(1.0, 1.0, 0.5)).kd == 0.0


def test_structures_of_boxes() -> None:
    free = GainRange(0.0, 1.0)
    pid, fopi = ControllerSpec(free, free, GainRange(1.0, 1.0), free, 0.1), ControllerSpec(free, free, free)
    fopid = ControllerSpec(free, free, free, free, 0.1, mu=GainRange(0.5, 1.0))
    assert [box.structure for box in (fopid, pid, fopi)] == ["fopid", "pid", "fopi"]
    assert fopid.names == "kp, ki, alpha, kd and mu"
    found, own = FoPid(1.0, 1.0, 0.5, 1.0, 0.5, 0.1), Pid(1.0, 1.0, 1.0, 0.1)
    assert [box.has_structure_of(found) for box in (fopid, pid, fopi)] == [True, False, False]
    assert [box.has_structure_of(own) for box in (fopid, pid, fopi)] == [True, True, False]
    assert not fopid.has_structure_of(FoPi(1.0, 1.0, 0.5))
    assert not fopid.has_structure_of(FoPid(1.0, 1.0, 0.5, 1.0, 0.5, 0.2))


@pytest.mark.thinned(4)
@pytest.mark.parametrize("seed", range(40))
def test_the_logarithm_of_the_loop_is_that_of_its_formula(seed: int) -> None:
    rng = np.random.default_rng([seed, 81])
    plant = random_plant(rng, int(rng.integers(1, 5)), float(rng.choice([0.0, 0.3])), proper=False)
    found = random_orders(rng, plant)
    loops, rows, omega = Loops.of(found, Plants.of(plant)), np.zeros(400, dtype=np.intp), np.geomspace(1e-4, 1e4, 400)
    loop = OfAnyOrder.of(found, plant)
    np.testing.assert_allclose(loops.controller_response(rows, omega), controller(found, omega), rtol=1e-12)
    np.testing.assert_allclose(loops.response(rows, omega), loop.gain(omega), rtol=1e-9)
    u = np.log(omega)
    value, slope = loops.log_response_and_slope(rows, u)
    np.testing.assert_allclose(np.exp(value), loop.gain(omega), rtol=1e-8)
    step = 1e-5
    above, below = (np.log(loop.gain(np.exp(u + d))) for d in (step, -step))
    dense = (above - below) / (2.0 * step)
    # where the difference turns past the negative axis it is off by turns
    same = np.abs(dense.imag) < 1e4
    # a resonance bends on a width of its damping, 0.003
    np.testing.assert_allclose(slope[same], dense[same], rtol=1e-3, atol=1e-3)
    # the Bode form, from which the branch comes, has the same values but for the roots of polynomials
    np.testing.assert_allclose(loops.log.value(rows, u), value, rtol=1e-6, atol=1e-6)


@pytest.mark.parametrize("seed", range(10))
def test_with_a_hundred_random_orders_poles_are_counted_as_by_matignons_sector(seed: int) -> None:
    rng, seen = np.random.default_rng([seed, 82]), []
    while len(seen) < 10:
        plant, q = random_plant(rng, int(rng.integers(1, 4)), proper=False), int(rng.integers(2, 6))
        found = random_orders(rng, plant)
        alpha, mu = int(rng.integers(1, 2 * q)), int(rng.integers(1, q + 1))
        found = FoPid(found.kp, found.ki, alpha / q, found.kd, mu / q, found.derivative_filter_time_constant_s)
        expected = poles_by_sector(found, plant, q)
        counted = float(unstable_closed_loop_poles(Loops.of(found, Plants.of(plant)))[0])
        if expected is None or math.isinf(counted):
            continue
        assert counted == expected, (found, plant)
        seen.append(expected)
    assert len(set(seen)) > 1


@pytest.mark.thinned(4)
@pytest.mark.parametrize("seed", range(30))
def test_with_a_dead_time_poles_are_counted_as_along_the_contour(seed: int) -> None:
    rng = np.random.default_rng([seed, 83])
    plant, found = random_pair(rng)
    late = Plant(plant.numerator, plant.denominator, 0.3)
    try:
        expected = OfAnyOrder.of(found, late).is_stable
    except UncertainError:
        return
    assert bool(is_stable(Loops.of(found, Plants.of(late)))[0]) is expected, (found, late)


@pytest.mark.thinned(3)
@pytest.mark.parametrize("seed", thinned(range(60), 3))
def test_margins_and_peaks_are_those_of_a_dense_evaluation(seed: int) -> None:
    rng = np.random.default_rng([seed, 84])
    plant, found = random_pair(rng)
    dense, loops = FopidLoop(plant, found), Loops.of(found, Plants.of(plant))
    try:
        stable = dense.is_stable
        assert bool(is_stable(loops)[0]) is stable
        if stable:
            ours = margins(found, plant)
            assert math.radians(ours.phase_margin_deg or 0.0) == pytest.approx(
                dense.read("phase_margin_deg", 0.0, math.inf, False), rel=1e-7
            )
            assert (ours.gain_margin_db or 0.0) * math.log(10.0) / 20.0 == pytest.approx(
                dense.read("gain_margin_db", 0.0, math.inf, False), rel=1e-6, abs=1e-6
            )
            assert ours.delay_margin_s == pytest.approx(dense.read("delay_margin_s", 0.0, math.inf, False), rel=1e-6)
            if ours.crossover_rad_s is not None:
                slope = dense.read("phase_slope_deg_per_decade", 0.0, math.inf, False)
                assert math.radians(ours.phase_slope_deg_per_decade or 0.0) == pytest.approx(slope, rel=1e-5, abs=1e-6)
        for quantity, response in RESPONSES.items():
            bands = [(0.01, 30.0)] if quantity == "loop_gain_db" else [(0.01, 30.0), (0.0, math.inf)]
            for low, high in bands:
                for largest in (True, False) if high < math.inf else (True,):
                    wanted = dense.extreme(quantity, low, high, largest)
                    got = float(extremes(loops, response, low, high, largest).value[0])
                    # a limit that is approached slowly is not yet on the grid: the supremum is never smaller
                    assert got >= wanted - 1e-7 if largest else got <= wanted + 1e-7
                    assert got == pytest.approx(wanted, abs=1e-6 if high < math.inf else 0.02)
    except UncertainError:
        return


def test_a_pid_by_its_orders_is_the_pid() -> None:
    rng = np.random.default_rng(85)
    for _ in range(40):
        plant, found = random_pair(rng)
        pid = Pid(found.kp, found.ki, found.kd, found.derivative_filter_time_constant_s)
        same = FoPid(found.kp, found.ki, 1.0, found.kd, 1.0, found.derivative_filter_time_constant_s)
        assert margins(same, plant) == margins(pid, plant)


def test_orders_next_to_one_are_next_to_the_pid() -> None:
    plant = Plant((1.0,), (1.0, 3.0, 3.0, 1.0), 0.2)
    pid, near = margins(Pid(1.0, 0.5, 0.8, 0.05), plant), margins(FoPid(1.0, 0.5, 1.0, 0.8, 1.0 - 1e-9, 0.05), plant)
    assert near.phase_margin_deg == pytest.approx(pid.phase_margin_deg, rel=1e-7)
    assert near.gain_margin_db == pytest.approx(pid.gain_margin_db, rel=1e-7)


def test_the_control_sensitivity_tends_to_kp() -> None:
    found = FoPid(2.0, 1.0, 1.0, 0.4, 0.6, 0.1)
    loops = Loops.of(found, Plants.of(Plant((1.0,), (1.0, 3.0, 3.0, 1.0))))
    ours = extremes(loops, Response.CONTROL_SENSITIVITY, 1e6, np.inf, largest=False)
    assert (ours.value[0], ours.omega_rad_s[0]) == (pytest.approx(math.log(2.0), abs=1e-12), math.inf)
    # above that limit the derivative's own peak decides
    peak = extremes(loops, Response.CONTROL_SENSITIVITY, 10.0, np.inf)
    s = np.asarray(1j * np.geomspace(10.0, 1e5, 20_000), dtype=complex)
    c = found(s)
    assert peak.value[0] == pytest.approx(np.log(np.abs(c / (1.0 + c / (s + 1.0) ** 3))).max(), abs=1e-6)


@pytest.mark.parametrize(
    ("found", "plant", "stable"),
    [
        # the plant's integrator is behind s^mu: its state stays where it is put
        (FoPid(0.0, 0.0, 1.0, 1.0, 0.5, 0.1), Plant((1.0,), (1.0, 0.0)), False),
        (FoPid(0.5, 0.0, 1.0, 1.0, 0.5, 0.1), Plant((1.0,), (1.0, 0.0)), True),
        (FoPid(0.0, 0.0, 1.0, 1.0, 0.5, 0.1), Plant((1.0,), (1.0, 2.0)), True),
        # the integral meets a zero of the plant
        (FoPid(0.5, 0.3, 0.7, 1.0, 0.5, 0.1), Plant((1.0, 0.0), (1.0, 2.0, 1.0)), False),
        # C(s) = 1 - sqrt(2) s^0.5 + ... : a zero of C at j 2, where the plant has an undamped pole
        (FoPid(-2.0, 0.0, 1.0, 2.0, 0.5, 1.0), Plant((1.0,), (1.0, 1.0, 4.0, 4.0)), True),
    ],
)
def test_a_pole_on_the_axis_that_the_controller_hides_is_no_stable_loop(
    found: FoPid, plant: Plant, stable: bool
) -> None:
    assert bool(is_stable(Loops.of(found, Plants.of(plant)))[0]) is stable


def test_a_zero_of_the_controller_at_an_undamped_pole_hides_it() -> None:
    # kp + kd s^mu/(Tf s + 1) = 0 at s = j 2
    mu, filter_s, omega = 0.5, 0.3, 2.0
    part = (1j * omega) ** mu / (filter_s * 1j * omega + 1.0)
    integral = (1j * omega) ** -0.8
    kp, ki = np.linalg.solve([[1.0, integral.real], [0.0, integral.imag]], [-part.real, -part.imag])
    found = FoPid(float(kp), float(ki), 0.8, 1.0, mu, filter_s)
    plant = Plant((1.0,), (1.0, 1.0, 4.0, 4.0))
    loops = Loops.of(found, Plants.of(plant))
    assert loops.hidden_on_axis[0]
    assert not is_stable(loops)[0]


def test_the_steady_state_error_is_that_of_its_lowest_term() -> None:
    plants = Plants.of(Plant((2.0,), (1.0, 1.0)))
    for found, error in (
        (FoPid(1.5, 0.0, 0.7, 1.0, 0.5, 0.1), 0.25),
        (FoPid(1.5, 0.1, 0.7, 1.0, 0.5, 0.1), 0.0),
        (FoPid(0.0, 0.0, 0.7, 1.0, 0.5, 0.1), 1.0),
    ):
        assert steady_state_errors(Loops.of(found, plants))[0] == pytest.approx(error, abs=1e-15)
