"""Polynomials in parameters: exact arithmetic, evaluated by + and * alone."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fopi_tune.core.parametric.polynomials import ParameterPolynomial
from fopi_tune.errors import DomainError

X, Y = (ParameterPolynomial.parameter(2, axis) for axis in (0, 1))


def number(value: float) -> ParameterPolynomial:
    return ParameterPolynomial.constant(2, value)


NUMBERS = st.integers(-9, 9).map(float)
POLYNOMIALS = st.lists(st.tuples(NUMBERS, st.integers(0, 3), st.integers(0, 3)), max_size=4).map(
    lambda terms: sum((number(c) * X.power(i) * Y.power(j) for c, i, j in terms), number(0.0))
)


@given(POLYNOMIALS, POLYNOMIALS, NUMBERS, NUMBERS)
@settings(max_examples=100)
def test_sums_and_products_have_the_values_of_their_parts(
    p: ParameterPolynomial, q: ParameterPolynomial, x: float, y: float
) -> None:
    at = (Fraction(x), Fraction(y))
    values = [each.at(at, Fraction) for each in (p, q, p + q, p - q, p * q, p.power(3))]
    assert values[2:] == [values[0] + values[1], values[0] - values[1], values[0] * values[1], values[0] ** 3]


def test_terms_that_cancel_leave_nothing() -> None:
    assert ((X + Y) * (X - Y) - X * X + Y * Y).is_zero
    assert (X - X).value == 0


def test_a_derivative_is_that_of_each_term() -> None:
    assert (X.power(3) * Y + X + number(2.0)).derivative(0) == number(3.0) * X.power(2) * Y + number(1.0)


def test_a_number_and_a_parameter_are_known_as_such() -> None:
    assert number(0.1).value == Fraction(0.1)
    assert (X.axis, Y.axis) == (0, 1)
    assert (X + Y).value is (X + Y).axis is (number(2.0) * X).axis is (X * Y).axis is None


def test_arrays_are_evaluated_member_by_member() -> None:
    found = (number(0.5) * X * X - Y).at([np.array([1.0, 2.0]), np.array([3.0, 4.0])])
    assert found.tolist() == [-2.5, -2.0]


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: X.power(33), "power above 32"),
        (lambda: (X + Y + number(1.0)).power(28), "more than 400 terms"),
        (lambda: number(1e200) * number(1e200), "too large or too small"),
        (lambda: number(1e-200) * number(1e-200), "too large or too small"),
    ],
)
def test_what_floating_point_cannot_compute_with_is_refused(make: object, message: str) -> None:
    assert callable(make)
    with pytest.raises(DomainError, match=message):
        make()
