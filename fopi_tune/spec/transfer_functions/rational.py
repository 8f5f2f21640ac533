"""Rational functions of s with exact coefficients, times e^{-delay s}:  numerator(s)/denominator(s) e^{-delay s}.

Coefficients are complex while poles and zeros are multiplied, so they are pairs of fractions.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from fractions import Fraction

from fopi_tune.errors import DomainError

#: of numerator and denominator; longer ones are badly conditioned and no model of a plant
MOST_DEGREE = 31
#: digits of a coefficient, in bits, and the largest exponent: what has more is no number that was measured
_MOST_BITS = 2500
MOST_EXPONENT = 32


@dataclass(frozen=True)
class Exact:
    """A complex number re + j im whose parts are fractions."""

    re: Fraction
    im: Fraction = Fraction(0)

    def __add__(self, other: Exact) -> Exact:
        return Exact(self.re + other.re, self.im + other.im)

    def __neg__(self) -> Exact:
        return Exact(-self.re, -self.im)

    def __mul__(self, other: Exact) -> Exact:
        if not self.im and not other.im:
            return Exact(self.re * other.re)
        return Exact(self.re * other.re - self.im * other.im, self.re * other.im + self.im * other.re)

    def inverse(self) -> Exact:
        """1 over it; it is not 0."""
        size = self.re * self.re + self.im * self.im
        return Exact(self.re / size, -self.im / size)

    def __bool__(self) -> bool:
        return bool(self.re or self.im)


ZERO, ONE = Exact(Fraction(0)), Exact(Fraction(1))
#: coefficients in descending powers of s, the first not 0; of the polynomial 0 there are none
Polynomial = tuple[Exact, ...]


def polynomial(coefficients: Sequence[Exact]) -> Polynomial:
    """Without leading zeros.

    Raises:
        DomainError: the degree or a coefficient is too large.
    """
    start = next((k for k, value in enumerate(coefficients) if value), len(coefficients))
    found = tuple(coefficients[start:])
    if len(found) > MOST_DEGREE + 1:
        raise DomainError(f"the degree is {len(found) - 1}; at most {MOST_DEGREE} can be computed with")
    for value in found:
        for part in (value.re, value.im):
            if max(part.numerator.bit_length(), part.denominator.bit_length()) > _MOST_BITS:
                raise DomainError("a coefficient has too many digits to compute with; write fewer factors or digits")
    return found


def added(a: Polynomial, b: Polynomial) -> Polynomial:
    """a + b."""
    size = max(len(a), len(b))
    left, right = ((ZERO,) * (size - len(each)) + each for each in (a, b))
    return polynomial([x + y for x, y in zip(left, right, strict=True)])


def multiplied(a: Polynomial, b: Polynomial) -> Polynomial:
    """a b."""
    if not a or not b:
        return ()
    if len(a) + len(b) > MOST_DEGREE + 2:
        raise DomainError(f"the degree is {len(a) + len(b) - 2}; at most {MOST_DEGREE} can be computed with")
    found = [ZERO] * (len(a) + len(b) - 1)
    for i, x in enumerate(a):
        for j, y in enumerate(b):
            found[i + j] = found[i + j] + x * y
    return polynomial(found)


@dataclass(frozen=True)
class RationalFunction:
    """numerator/denominator e^{-delay s}; a constant has the denominator 1.

    Args:
        numerator: a polynomial.
        denominator: a polynomial that is not 0.
        delay: s; below 0 of a divisor's dead time.
    """

    numerator: Polynomial
    denominator: Polynomial = field(default=(ONE,))
    delay: Fraction = Fraction(0)

    @classmethod
    def constant(cls, value: Exact) -> RationalFunction:
        """A number."""
        return cls(polynomial([value]))

    @property
    def value(self) -> Exact | None:
        """The number that it is, None of a function of s."""
        if len(self.numerator) > 1 or len(self.denominator) > 1 or self.delay:
            return None
        first = next(iter(self.numerator), ZERO)
        return first * next(iter(self.denominator)).inverse()

    @property
    def is_pure_delay(self) -> bool:
        """Whether it is e^{-delay s}."""
        return bool(self.delay) and self.numerator == self.denominator

    def __add__(self, other: RationalFunction) -> RationalFunction:
        if not self.numerator or not other.numerator:
            return self if self.numerator else other
        if self.delay != other.delay:
            raise DomainError(
                "a sum of terms with different dead times is no plant of this tool; approximate it by one"
            )
        if self.denominator == other.denominator:
            return RationalFunction(added(self.numerator, other.numerator), self.denominator, self.delay)
        left, right = (multiplied(a.numerator, b.denominator) for a, b in ((self, other), (other, self)))
        return RationalFunction(added(left, right), multiplied(self.denominator, other.denominator), self.delay)

    def __neg__(self) -> RationalFunction:
        return RationalFunction(tuple(-value for value in self.numerator), self.denominator, self.delay)

    def __mul__(self, other: RationalFunction) -> RationalFunction:
        top = multiplied(self.numerator, other.numerator)
        return RationalFunction(top, multiplied(self.denominator, other.denominator), self.delay + other.delay)

    def inverse(self) -> RationalFunction:
        """1 over it.

        Raises:
            DomainError: it is 0.
        """
        if not self.numerator:
            raise DomainError("divides by 0")
        if len(self.numerator) > 1:
            return RationalFunction(self.denominator, self.numerator, -self.delay)
        return RationalFunction(
            multiplied(self.denominator, (next(iter(self.numerator)).inverse(),)), (ONE,), -self.delay
        )

    def power(self, exponent: int) -> RationalFunction:
        """A whole power."""
        base = self if exponent >= 0 else self.inverse()
        found = RationalFunction.constant(ONE)
        for _ in range(abs(exponent)):
            found = found * base
        return found
