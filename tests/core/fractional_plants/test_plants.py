"""Batches of fractional plants against their formula, Matignon's roots and the argument on the whole contour."""

from __future__ import annotations

import math

import numpy as np
import pytest
from cases.random_fractional import family_of, published, random_controller, random_sides
from oracles import dense_margins
from oracles.dense_margins import UncertainError
from oracles.fractional_loops import Fractional, poles_by_sector, side_at

from fopi_tune.core.controller import FoPi, FoPid
from fopi_tune.core.crossings import gain_crossovers, phase_crossovers
from fopi_tune.core.fractional_plants.family import FractionalFamily
from fopi_tune.core.fractional_plants.plants import FractionalPlants
from fopi_tune.core.loops import Loops, Plants
from fopi_tune.core.margins import delay_margins, gain_margins, margins_of, phase_margins
from fopi_tune.core.peaks import Response, extremes
from fopi_tune.core.stability import is_stable, unstable_closed_loop_poles
from fopi_tune.errors import DomainError

U = np.linspace(-25.0, 25.0, 5001)
ROWS = np.zeros(len(U), dtype=np.intp)
NOMINAL = np.zeros((1, 0))


def plants_of(family: FractionalFamily) -> FractionalPlants:
    found = Plants.members(family, family.nominal_point[None, :])
    assert isinstance(found, FractionalPlants)
    return found


@pytest.mark.thinned(4)
@pytest.mark.parametrize("seed", range(40))
def test_the_bode_form_is_the_logarithm_of_the_response_on_one_branch(seed: int) -> None:
    rng = np.random.default_rng([seed, 5])
    sides = random_sides(rng)
    plants = plants_of(family_of(sides, 0.01 if seed % 2 else 0.0))
    s = 1j * np.exp(U)
    wanted = side_at(sides[0], s) / side_at(sides[1], s)
    np.testing.assert_allclose(plants.response(ROWS, np.exp(U)), wanted, rtol=1e-11)
    found = plants.log.undelayed().value(ROWS, U)
    np.testing.assert_allclose(np.exp(found), wanted, rtol=1e-10)
    steps = np.angle(wanted[1:] / wanted[:-1])
    clear = np.abs(steps) < 2.0
    np.testing.assert_allclose(np.diff(found.imag)[clear], steps[clear], atol=1e-9)
    slope = plants.log.undelayed().derivative(ROWS, U)
    near = np.abs(slope) < 20.0
    np.testing.assert_allclose(slope[near], np.gradient(found, U)[near], rtol=2e-2, atol=2e-2)


@pytest.mark.thinned(10)
@pytest.mark.parametrize("seed", range(300))
def test_stability_is_that_of_matignon_for_commensurate_loops(seed: int) -> None:
    rng = np.random.default_rng([seed, 17])
    q = int(rng.choice([2, 3, 4, 5, 10]))
    sides, gains = random_sides(rng, q), random_controller(rng, q)
    loop = Fractional.of(gains, *sides)
    plants = plants_of(family_of(sides))
    open_loop = Fractional.of(FoPi(1e-300, 0.0, 1.0), *sides)
    wanted = poles_by_sector(open_loop, q)
    if wanted is not None and min(e for _, e in sides[1]) == 0.0:
        assert plants.unstable_poles[0] == wanted
    poles = poles_by_sector(loop, q)
    if poles is None:
        pytest.skip("a root next to the edge")
    found = unstable_closed_loop_poles(Loops.of(gains, plants))[0]
    if not math.isinf(found):
        assert found == poles
    else:
        assert abs(1.0 + loop.direct) < 1e-9 or (gains.ki and min(e for _, e in sides[0]) > 0.0)


@pytest.mark.thinned(8)
@pytest.mark.parametrize("seed", range(80))
def test_margins_and_stability_are_those_of_a_dense_curve(seed: int) -> None:
    rng = np.random.default_rng([seed, 23])
    sides, gains = random_sides(rng), random_controller(rng)
    late = float(rng.choice([0.0, 10.0 ** rng.uniform(-2.0, 0.5)]))
    oracle, loops = Fractional.of(gains, *sides, late), Loops.of(gains, plants_of(family_of(sides, late)))
    try:
        wanted = oracle.is_stable
    except UncertainError:
        pytest.skip("too close to tell")
    assert bool(is_stable(loops)[0]) == wanted
    if not wanted:
        return
    crossovers = gain_crossovers(loops)
    values = {
        "phase_margin_deg": phase_margins(loops, crossovers),
        "delay_margin_s": delay_margins(loops, crossovers),
        "gain_margin_db": gain_margins(loops, phase_crossovers(loops)),
    }
    for quantity, found in values.items():
        # crossings of a dense curve are found to eight digits
        assert float(found.value[0]) == pytest.approx(dense_margins.value(oracle, quantity), rel=1e-6, abs=1e-8)
    for response, curve in (
        (Response.SENSITIVITY, lambda gain: 1.0 / (1.0 + gain)),
        (Response.COMPLEMENTARY_SENSITIVITY, lambda gain: gain / (1.0 + gain)),
    ):
        place = extremes(loops, response, 1e-6, 1e6)
        omega = oracle.grid[(oracle.grid > 1e-6) & (oracle.grid < 1e6)]
        largest, dense = float(place.value[0]), np.log(np.abs(curve(oracle.gain(omega))))
        assert largest >= float(dense.max()) - 1e-9
        # the value is that of the formula where it is said to be
        assert largest == pytest.approx(float(np.log(np.abs(curve(oracle.gain(place.omega_rad_s)))[0])), abs=1e-9)


def test_the_published_loop_has_its_published_crossover_and_margin() -> None:
    # without a derivative filter, which that of a microsecond is at 0.1 rad/s but for 1e-7
    gains = FoPid(-0.002934, 0.01030, 0.9, 0.05335, 0.5, 1e-6)
    found = margins_of(Loops.of(gains, plants_of(published())))
    assert found.stable
    assert found.crossover_rad_s == pytest.approx(0.09997, abs=5e-6)
    assert found.phase_margin_deg == pytest.approx(60.00, abs=5e-3)
    assert found.crossover_rad_s is not None
    s = 1j * found.crossover_rad_s
    unfiltered = gains.kp + gains.ki * s**-0.9 + gains.kd * s**0.5
    gain = unfiltered * 66.16 * np.exp(-1.93 * s) / (12.72 * s**0.5 + 1.0)
    assert abs(gain) == pytest.approx(1.0, abs=1e-6)
    assert 180.0 + math.degrees(np.angle(gain)) == pytest.approx(found.phase_margin_deg, abs=1e-4)


def test_nothing_takes_the_coefficients_for_those_of_polynomials() -> None:
    family = published()
    plants = plants_of(family)
    for ask in (
        lambda: plants.numerator,
        lambda: plants.denominator,
        lambda: plants.zeros,
        lambda: plants.poles,
        lambda: family.coefficients(NOMINAL),
        lambda: family.assemble({}),
        lambda: family.member(family.nominal_point).numerator,
        lambda: family.member(family.nominal_point).denominator,
    ):
        with pytest.raises(DomainError, match="fractional plant is not available"):
            ask()


def test_a_common_power_of_s_and_a_zero_at_the_origin_under_an_integral_are_no_stable_loops() -> None:
    hidden = plants_of(family_of((((1.0, 0.5),), ((1.0, 1.5), (1.0, 0.5)))))
    assert hidden.hidden_on_axis[0]
    cancelled = plants_of(family_of((((1.0, 0.5),), ((1.0, 1.5), (1.0, 0.0)))))
    assert not hidden.take(np.zeros(0, dtype=np.intp)).hidden_on_axis.any()
    assert unstable_closed_loop_poles(Loops.of(FoPi(1.0, 1.0, 0.7), cancelled))[0] == math.inf
    assert unstable_closed_loop_poles(Loops.of(FoPi(1.0, 0.0, 1.0), cancelled))[0] == 0.0


def test_a_direct_path_around_a_dead_time_has_infinitely_many_poles() -> None:
    # P(inf) = 0.5/0.16
    terms = (((0.5, 1.5), (3.0, 0.0)), ((0.16, 1.5), (0.4, 0.0)))
    plants = plants_of(family_of(terms, dead_time_s=1.0))
    assert unstable_closed_loop_poles(Loops.of(FoPi(2.0, 0.1, 1.0), plants))[0] == math.inf
    assert unstable_closed_loop_poles(Loops.of(FoPi(0.01, 0.001, 1.0), plants))[0] == 0.0


def test_poles_on_the_axis_are_found() -> None:
    # s^2 + 4 beside s^0.5: a root at 2j
    plants = plants_of(family_of((((1.0, 0.5), (1.0, 0.0)), ((1.0, 2.0), (4.0, 0.0)))))
    finite = plants.axis_poles[np.isfinite(plants.axis_poles)]
    np.testing.assert_allclose(finite, [2j], rtol=1e-9)
