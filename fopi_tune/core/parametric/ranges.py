"""What a polynomial's values over a box are surely like:  its sign, its least value, a zero.

Over a box the range of each term is known.  Along an axis where the derivative has one sign the ends of the axis are
enough; a box that decides nothing is split.  Sums are in floating point with a bound of their rounding, and exact where
that decides nothing.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import lru_cache
from typing import Any

from fopi_tune.core.parametric.polynomials import ParameterPolynomial

Box = tuple[tuple[float, float], ...]
Point = tuple[float, ...]
Range = tuple[Any, Any]
#: terms that are looked at before a question is left open
_MOST_WORK = 40_000
#: relative; above the rounding of a sum of `MOST_TERMS` products of up to `MOST_DEGREE` powers each of some parameters
_ROUNDING = 1e-11
_LARGEST = 1e150


class UndecidedError(Exception):
    """The search ended before every part of the box was decided."""


def box_of(low: Sequence[float], high: Sequence[float]) -> Box:
    """A box from its corners."""
    return tuple((float(a), float(b)) for a, b in zip(low, high, strict=True))


def range_over(polynomial: ParameterPolynomial, box: Box, exact: bool = False) -> Range:
    """Numbers between which all values over a box lie; the range itself where each derivative has one sign."""
    low, high = _natural(polynomial, box, exact)
    if low == high or len(polynomial.terms) < 2:
        return low, high
    least, most = _ends(polynomial, box, exact)
    return max(low, _natural(polynomial, least, exact)[0]), min(high, _natural(polynomial, most, exact)[1])


def _ends(polynomial: ParameterPolynomial, box: Box, exact: bool = False) -> tuple[Box, Box]:
    """The parts of the box that hold the least and the largest value."""
    least, most = list(box), list(box)
    for axis, (first, last) in enumerate(box):
        low, high = _natural(_derivative(polynomial, axis), box, exact)
        if first < last and (low >= 0 or high <= 0):
            ends = (first, last) if low >= 0 else (last, first)
            least[axis], most[axis] = (ends[0], ends[0]), (ends[1], ends[1])
    return tuple(least), tuple(most)


@lru_cache(maxsize=1024)
def _derivative(polynomial: ParameterPolynomial, axis: int) -> ParameterPolynomial:
    return polynomial.derivative(axis)


def _natural(polynomial: ParameterPolynomial, box: Box, exact: bool) -> Range:
    """The sum of the terms' ranges.

    Raises:
        UndecidedError: it is too large for floating point.
    """
    number: Any = Fraction if exact else float
    sides = [(number(a), number(b)) for a, b in box]
    low, high, size = number(0), number(0), number(0)
    for powers, coefficient in polynomial.terms:
        first = last = number(coefficient)
        for (a, b), exponent in zip(sides, powers, strict=True):
            if not exponent:
                continue
            try:
                p, q = a**exponent, b**exponent
            except OverflowError:
                raise UndecidedError from None
            if exponent % 2 == 0 and a < 0 < b:
                p, q = number(0), max(p, q)
            products = (first * p, first * q, last * p, last * q)
            first, last = min(products), max(products)
        low, high, size = low + first, high + last, size + max(abs(first), abs(last))
    beside = 0 if exact else _ROUNDING * size
    return low - beside, high + beside


def _value(polynomial: ParameterPolynomial, point: Point) -> Any:
    """The value at a point, exactly where floating point does not tell its sign."""
    low, high = _natural(polynomial, tuple((x, x) for x in point), exact=False)
    return low if low > 0 or high < 0 else polynomial.at([Fraction(x) for x in point], Fraction)


@dataclass(frozen=True)
class _Question:
    """Whether something holds over a box.

    Args:
        polynomials: that it is about.
        certified: whether it holds wherever the polynomials lie in these ranges.
        fails: whether it fails where the polynomials have these values.
    """

    polynomials: tuple[ParameterPolynomial, ...]
    certified: Callable[[Sequence[Range]], bool]
    fails: Callable[[Sequence[Any]], bool]

    def counterexample(self, box: Box) -> Point | None:
        """A point where it fails, or None: it holds over the whole box.

        Raises:
            UndecidedError: neither was found.
        """
        if self.certified([range_over(each, box, exact=True) for each in self.polynomials]):
            return None
        work, boxes = 0, deque([box])
        cost = 1 + sum(1 + len(each.terms) for each in self.polynomials) * (4 + 2 * len(box))
        while boxes:
            here = boxes.popleft()
            if self.certified([range_over(each, here) for each in self.polynomials]):
                continue
            for point in self._points(here, exact=here == box):
                if self.fails([_value(each, point) for each in self.polynomials]):
                    return point
            work += cost
            if work > _MOST_WORK:
                raise UndecidedError
            boxes += _halves(here, box)
        return None

    def _points(self, box: Box, exact: bool) -> set[Point]:
        """The middle, and where the polynomials are smallest and largest."""
        parts = [box, *(part for each in self.polynomials for part in _ends(each, box, exact))]
        return {tuple(a + 0.5 * (b - a) for a, b in part) for part in parts}


def _halves(box: Box, whole: Box) -> list[Box]:
    """Across the axis that is widest, as a part of the whole; none of a point."""
    parts = [(b - a) / (d - c) if d > c else 0.0 for (a, b), (c, d) in zip(box, whole, strict=True)]
    axis = parts.index(max(parts)) if parts else 0
    low, high = box[axis] if parts else (0.0, 0.0)
    middle = low + 0.5 * (high - low)
    if not low < middle < high:
        raise UndecidedError
    return [(*box[:axis], ends, *box[axis + 1 :]) for ends in ((low, middle), (middle, high))]


def is_computable(polynomial: ParameterPolynomial, box: Box) -> bool:
    """Whether its values over the box, and their products with those of another, are floating-point numbers."""
    try:
        low, high = _natural(polynomial, box, exact=False)
    except UndecidedError:
        return False
    return low > -_LARGEST and high < _LARGEST


def cancellation(polynomial: ParameterPolynomial, box: Box) -> float:
    """How many times the sizes of its terms together exceed the polynomial, at its largest among points of the box."""
    size = Fraction(0)
    for powers, coefficient in polynomial.terms:
        term = abs(coefficient)
        for (a, b), exponent in zip(box, powers, strict=True):
            term *= Fraction(max(abs(a), abs(b))) ** exponent
        size += term
    middle = tuple(a + 0.5 * (b - a) for a, b in box)
    ends = (tuple(a for a, _ in part) for part in _ends(polynomial, box))
    points = {middle, *ends, tuple(a for a, _ in box), tuple(b for _, b in box)}
    largest = max(abs(polynomial.at([Fraction(x) for x in point], Fraction)) for point in points)
    return float(size / largest) if largest else float("inf") if size else 1.0


def zero_inside(polynomial: ParameterPolynomial, box: Box) -> Point | None:
    """A point where it is 0, or of another sign than in the middle; None: it has one sign in the box and no zero.

    Raises:
        UndecidedError: a zero was neither found nor excluded.
    """
    middle = tuple(a + 0.5 * (b - a) for a, b in box)
    if not (value := _value(polynomial, middle)):
        return middle
    sign = 1 if value > 0 else -1
    return _Question(
        (polynomial,),
        lambda ranges: ranges[0][0] > 0 or ranges[0][1] < 0,
        lambda values: values[0] * sign <= 0,
    ).counterexample(box)


def negative_inside(polynomial: ParameterPolynomial, box: Box) -> Point | None:
    """A point of the box where the polynomial is negative; None: there is none.

    Raises:
        UndecidedError: neither was found.
    """
    return _Question(
        (polynomial,),
        lambda ranges: ranges[0][0] >= 0,
        lambda values: values[0] < 0,
    ).counterexample(box)


def common_zero_inside(polynomials: Sequence[ParameterPolynomial], box: Box) -> Point | None:
    """A point of the box where all polynomials are 0; None: at each point one of them is not.

    Raises:
        UndecidedError: neither was found.
    """
    return _Question(
        tuple(polynomials),
        lambda ranges: any(low > 0 or high < 0 for low, high in ranges),
        lambda values: not any(values),
    ).counterexample(box)
