"""What people give as numbers in Python: NumPy's become plain, all else is refused by the name of its place."""

import json
from fractions import Fraction
from typing import Any

import numpy as np
import pytest

from fopi_tune.core.controller import FoPi, FoPid, Pid
from fopi_tune.core.plant import Plant, Uncertain
from fopi_tune.core.terms.measurement_filter import MeasurementFilter
from fopi_tune.core.terms.numbers import whole_number
from fopi_tune.errors import DomainError


def test_records_hold_plain_numbers_whatever_they_were_made_of() -> None:
    # without types, as a type checker refuses NumPy's numbers where a float is asked for
    half: Any = np.float32(0.5)
    two: Any = np.int64(2)
    order: Any = Fraction(1, 2)
    three: Any = np.array(3.0)
    gains = FoPid(
        half, two, order, three, np.float64(0.25), 0.125, measurement_filter=MeasurementFilter(1, half)
    )  # fmt: skip
    assert repr(gains) == (
        "FoPid(kp=0.5, ki=2.0, alpha=0.5, kd=3.0, mu=0.25, derivative_filter_time_constant_s=0.125, "
        "measurement_filter=MeasurementFilter(order=1, time_constant_s=0.5))"
    )
    plant = Plant(np.array([1]), [np.float32(0.5), 2], np.float64(0.25))  # pyright: ignore[reportArgumentType]
    assert plant == Plant((1.0,), (0.5, 2), 0.25)
    assert hash(plant) == hash(Plant((1.0,), (0.5, 2), 0.25))
    number = Uncertain(half + 1, two - 1, 2)
    assert json.dumps([number.nominal, number.min, number.max, plant.denominator]) == "[1.5, 1.0, 2, [0.5, 2]]"


@pytest.mark.parametrize("wrong", ["1", None, 1j, True, np.array([1.0]), np.array("a"), object()])
def test_what_is_no_number_is_refused_by_name(wrong: Any) -> None:
    for make, name in [
        (lambda: FoPi(wrong, 1, 1), "kp"),
        (lambda: FoPi(1, 1, wrong), "alpha"),
        (lambda: Pid(kp=1, ki=1, kd=wrong, derivative_filter_time_constant_s=1), "kd"),
        (lambda: MeasurementFilter(1, wrong), "time_constant_s"),
        (lambda: Uncertain(1, wrong, 2), "min"),
        (lambda: Plant((1,), (1, 1), wrong), "dead_time_s"),
    ]:
        with pytest.raises(DomainError, match=rf"^{name} = .* is not a (finite )?number"):
            make()


@pytest.mark.parametrize("wrong", [1.0, "12", None, np.ones((1, 2))])
def test_coefficients_that_are_no_list_are_refused(wrong: Any) -> None:
    with pytest.raises(DomainError, match=r"numerator = .* is not a list of numbers"):
        Plant(wrong, (1, 1))


def test_a_number_beyond_every_float_is_refused_without_its_digits() -> None:
    with pytest.raises(DomainError, match="kp is not a number that can be computed with"):
        FoPi(10**5000, 1, 1)


def test_a_coefficient_is_named_by_its_place() -> None:
    with pytest.raises(DomainError, match=r"denominator\[1\] = 'a' is not a number"):
        Plant((1,), (1, "a"))  # pyright: ignore[reportArgumentType]


def test_whole_numbers_become_plain_and_others_are_refused() -> None:
    assert type(whole_number("samples", np.int64(10))) is int
    for wrong in (10.5, "10", None):
        with pytest.raises(DomainError, match=r"samples = .* is no whole number"):
            whole_number("samples", wrong)
    with pytest.raises(DomainError, match="samples = 0 must be at least 1"):
        whole_number("samples", 0, 1)
