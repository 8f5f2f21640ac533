"""Signs of polynomials over boxes, against dense samples of these boxes."""

from __future__ import annotations

import itertools
import random

import numpy as np
import pytest

from fopi_tune.core.parametric.polynomials import ParameterPolynomial
from fopi_tune.core.parametric.ranges import (
    UndecidedError,
    box_of,
    common_zero_inside,
    is_computable,
    negative_inside,
    range_over,
    zero_inside,
)

X, Y = (ParameterPolynomial.parameter(2, axis) for axis in (0, 1))
ONE = ParameterPolynomial.constant(2, 1.0)
BOX = box_of([1.0, -1.0], [2.0, 3.0])


def random_term(rng: random.Random) -> ParameterPolynomial:
    number = ParameterPolynomial.constant(2, rng.uniform(-3, 3))
    return number * X.power(rng.randint(0, 3)) * Y.power(rng.randint(0, 2))


def random_polynomial(rng: random.Random) -> ParameterPolynomial:
    found = ParameterPolynomial.constant(2, rng.uniform(-12, 12))
    for _ in range(rng.randint(1, 4)):
        found = found + random_term(rng)
    return found


def sampled(polynomial: ParameterPolynomial) -> np.ndarray:
    axes = [np.linspace(*side, 21) for side in BOX]
    return np.array([polynomial.at(point) for point in itertools.product(*axes)])


@pytest.mark.parametrize("seed", range(200))
def test_no_value_lies_outside_the_range_and_no_sign_is_wrong(seed: int) -> None:
    polynomial = random_polynomial(random.Random(seed))
    values, (low, high) = sampled(polynomial), range_over(polynomial, BOX)
    assert low <= values.min()
    assert values.max() <= high
    try:
        zero, negative = zero_inside(polynomial, BOX), negative_inside(polynomial, BOX)
    except UndecidedError:
        return
    if zero is None:
        assert values.min() * values.max() > 0.0
    else:
        middle = polynomial.at([1.5, 1.0])
        assert polynomial.at(zero) * middle <= 1e-9
    assert (negative is None) == (values.min() >= 0.0) or abs(values.min()) < 0.2


def test_values_that_only_touch_zero_are_told_exactly() -> None:
    box = box_of([1.0, 0.0], [2.0, 1.0])
    assert negative_inside(X - Y, box) is None
    assert zero_inside(X - Y, box) == (1.0, 1.0)
    square = (X - ONE) * (X - ONE)
    zero = zero_inside(square, BOX)
    assert zero is not None
    assert square.at(zero) == 0.0


def test_a_sum_of_squares_needs_a_split_and_is_decided() -> None:
    # the terms alone reach from -6 to 13
    polynomial = X * X - ParameterPolynomial.constant(2, 2.0) * X * Y + Y * Y + ParameterPolynomial.constant(2, 0.3)
    assert zero_inside(polynomial, BOX) is None


def test_a_zero_in_the_middle_is_the_point_that_is_named() -> None:
    centred = ParameterPolynomial.parameter(1, 0)
    assert zero_inside(centred, box_of([-1.0], [1.0])) == (0.0,)


def test_a_zero_between_doubles_is_left_open() -> None:
    # X^2 = 2 without a change of sign
    polynomial = (X * X - ParameterPolynomial.constant(2, 2.0)).power(2)
    with pytest.raises(UndecidedError):
        zero_inside(polynomial, BOX)


def test_polynomials_without_a_common_zero() -> None:
    assert common_zero_inside([Y, X - ONE], BOX) is None or common_zero_inside([Y, X - ONE], BOX) == (1.0, 0.0)
    assert common_zero_inside([Y, Y - ONE], BOX) is None
    assert common_zero_inside([Y - Y], BOX) is not None


def test_what_is_beyond_floating_point_is_not_computed() -> None:
    box = box_of([1.0, 1.0], [1e100, 2.0])
    assert not is_computable(X.power(4), box)
    assert is_computable(X, box)
