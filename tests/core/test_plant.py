"""Plants, uncertain numbers, families, and the controller: what they hold and what they refuse."""

from __future__ import annotations

import math

import numpy as np
import pytest

from fopi_tune.core.controller import FoPi
from fopi_tune.core.loops import Loops, Plants
from fopi_tune.core.plant import PLANT_MODELS, Plant, PlantFamily, Uncertain
from fopi_tune.errors import DomainError, FopiError

BRAKE = PlantFamily(
    "lag",
    {
        "static_gain": Uncertain.exactly(1.0),
        "time_constant_s": Uncertain(2.25, 1.6, 3.1),
        "dead_time_s": Uncertain.between(0.1, 0.5),
    },
)


def exact(model: str, **numbers: float) -> PlantFamily:
    return PlantFamily(model, {name: Uncertain.exactly(value) for name, value in numbers.items()})


@pytest.mark.parametrize("name", ["kp", "ki", "alpha"])
@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
def test_a_controller_refuses_gains_that_are_not_finite(name: str, value: float) -> None:
    gains = {"kp": 1.0, "ki": 1.0, "alpha": 0.5, name: value}
    with pytest.raises(DomainError, match=f"{name} = .* is not a finite number"):
        FoPi(gains["kp"], gains["ki"], gains["alpha"])


@pytest.mark.parametrize("alpha", [0.0, 2.0, -0.5, 2.5])
def test_a_controller_refuses_orders_outside_0_to_2(alpha: float) -> None:
    with pytest.raises(DomainError, match=r"outside \(0, 2\)"):
        FoPi(1.0, 1.0, alpha)


def test_domain_errors_are_the_packages_own_and_value_errors() -> None:
    assert issubclass(DomainError, FopiError)
    assert issubclass(DomainError, ValueError)


@pytest.mark.parametrize(
    ("numerator", "denominator", "dead_time", "message"),
    [
        ((1.0,), (1.0, math.nan), 0.0, "finite"),
        ((math.inf,), (1.0, 1.0), 0.0, "finite"),
        ((1.0,), (1.0, 1.0), math.inf, "finite"),
        ((0.0,), (1.0, 1.0), 0.0, "no plant to control"),
        ((), (1.0, 1.0), 0.0, "no plant to control"),
        ((1.0,), (0.0, 1.0), 0.0, "first coefficient is 0"),
        ((1.0,), (), 0.0, "first coefficient is 0"),
        ((1.0, 0.0, 0.0), (1.0, 1.0), 0.0, "proper"),
        ((1.0,), (1.0, 1.0), -0.1, "negative"),
    ],
)
def test_a_plant_refuses_what_is_no_plant(
    numerator: tuple[float, ...], denominator: tuple[float, ...], dead_time: float, message: str
) -> None:
    with pytest.raises(DomainError, match=message):
        Plant(numerator, denominator, dead_time)


def test_leading_zeros_of_a_numerator_do_not_make_a_plant_improper() -> None:
    plant = Plant((0.0, 0.0, 1.0), (1.0, 1.0))
    loops = Loops.of(FoPi(2.0, 0.1, 0.5), Plants.of(plant))
    shorter = Loops.of(FoPi(2.0, 0.1, 0.5), Plants.of(Plant((1.0,), (1.0, 1.0))))
    row, u = np.array([0]), np.array([0.3])
    assert loops.log_response(row, u)[0] == pytest.approx(shorter.log_response(row, u)[0], rel=1e-14)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((1.0, 2.0, 0.0), "greater than max"),
        ((5.0, 0.0, 2.0), "outside"),
        ((-1.0, 0.0, 2.0), "outside"),
        ((math.nan, 0.0, 1.0), "not a finite number"),
        ((0.5, 0.0, math.inf), "not a finite number"),
    ],
)
def test_an_uncertain_number_refuses_an_impossible_range(arguments: tuple[float, float, float], message: str) -> None:
    with pytest.raises(DomainError, match=message):
        Uncertain(*arguments)


def test_an_uncertain_number_between_two_has_its_midpoint_as_nominal_and_does_not_overflow() -> None:
    assert Uncertain.between(1.6, 3.1).nominal == pytest.approx(2.35)
    assert math.isfinite(Uncertain.between(1e308, 1.5e308).nominal)
    assert Uncertain.exactly(3.0).is_exact
    assert not Uncertain.between(1.0, 2.0).is_exact
    assert Uncertain.between(2.0, 2.0).is_exact


@pytest.mark.parametrize("value", [0.1, 1e-300, 7.3, -2.6])
def test_a_degenerate_range_keeps_its_value_exactly(value: float) -> None:
    assert Uncertain.between(value, value).nominal == value


def test_the_axes_of_a_family_are_its_uncertain_numbers_in_order() -> None:
    assert BRAKE.uncertain_names == ("time_constant_s", "dead_time_s")
    np.testing.assert_array_equal(BRAKE.low, [1.6, 0.1])
    np.testing.assert_array_equal(BRAKE.high, [3.1, 0.5])
    np.testing.assert_allclose(BRAKE.nominal_point, [2.25, 0.3])


def test_a_member_has_the_numbers_of_its_point_and_says_them() -> None:
    plant = BRAKE.member(np.array([2.0, 0.2]))
    assert plant == Plant((1.0,), (2.0, 1.0), 0.2)
    assert BRAKE.describe(np.array([2.0, 0.2])) == {"time_constant_s": 2.0, "dead_time_s": 0.2}


def test_coefficients_of_many_members_are_those_of_each() -> None:
    points = np.random.default_rng(1).uniform(BRAKE.low, BRAKE.high, (20, 2))
    numerators, denominators, delays = BRAKE.coefficients(points)
    assert numerators.shape == (20, 1)
    assert denominators.shape == (20, 2)
    for i, point in enumerate(points):
        assert BRAKE.member(point) == Plant(tuple(numerators[i]), tuple(denominators[i]), float(delays[i]))


def test_a_family_of_one_has_one_member_without_axes() -> None:
    family = exact("pole", gain=4.39, pole_rad_s=0.1746, dead_time_s=0.0)
    assert family.uncertain_names == ()
    assert family.nominal_point.shape == (0,)
    assert family.member(np.zeros(0)) == Plant((4.39,), (1.0, 0.1746))
    assert family.describe(np.zeros(0)) == {}
    assert len(Plants.members(family, np.zeros((3, 0)))) == 3


def test_a_transfer_function_takes_its_lists_in_descending_powers() -> None:
    family = PlantFamily(
        "transfer_function",
        {
            "numerator[0]": Uncertain.exactly(2.0),
            "numerator[1]": Uncertain.between(1.0, 3.0),
            "denominator[0]": Uncertain.exactly(1.0),
            "denominator[1]": Uncertain.between(0.1, 0.3),
            "denominator[2]": Uncertain.exactly(4.0),
            "dead_time_s": Uncertain.exactly(0.5),
        },
    )
    assert family.uncertain_names == ("numerator[1]", "denominator[1]")
    assert family.member(np.array([1.5, 0.2])) == Plant((2.0, 1.5), (1.0, 0.2, 4.0), 0.5)


@pytest.mark.parametrize(
    ("model", "name", "value", "message"),
    [
        ("lag", "dead_time_s", Uncertain.between(-0.1, 0.2), "at least 0"),
        ("lag", "time_constant_s", Uncertain.between(0.0, 1.0), "greater than 0"),
        ("lag", "static_gain", Uncertain.between(-1.0, 1.0), "contain 0"),
        ("pole", "gain", Uncertain.exactly(0.0), "contain 0"),
        ("transfer_function", "denominator[0]", Uncertain.between(0.0, 1.0), "contain 0"),
    ],
)
def test_a_model_names_what_is_wrong_with_a_number(model: str, name: str, value: Uncertain, message: str) -> None:
    found = PLANT_MODELS[model].check(name, value)
    assert found is not None
    assert message in found


@pytest.mark.parametrize(
    ("model", "name", "value"),
    [
        ("lag", "dead_time_s", Uncertain.between(0.0, 0.2)),
        ("lag", "static_gain", Uncertain.between(-2.0, -1.0)),
        ("pole", "pole_rad_s", Uncertain.between(-1.0, 1.0)),
        ("transfer_function", "numerator[0]", Uncertain.between(-1.0, 1.0)),
    ],
)
def test_a_model_accepts_a_number_that_makes_sense(model: str, name: str, value: Uncertain) -> None:
    assert PLANT_MODELS[model].check(name, value) is None


def test_the_three_models_are_their_formulas() -> None:
    lag = exact("lag", static_gain=3.0, time_constant_s=2.0, dead_time_s=0.1)
    pole = exact("pole", gain=3.0, pole_rad_s=0.5, dead_time_s=0.1)
    delay = np.exp(-0.07j)
    for family, expected in ((lag, 3.0 * delay / (1.4j + 1.0)), (pole, 3.0 * delay / (0.7j + 0.5))):
        loops = Loops.of(FoPi(1.0, 0.0, 1.0), Plants.of(family.member(np.zeros(0))))
        assert loops.response(np.array([0]), np.array([0.7]))[0] == pytest.approx(expected, rel=1e-14)
