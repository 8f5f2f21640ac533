"""Rational functions of the parameters:  numerator over a product of divisors, none of which is 0 in the box.

Divisors stay factors, so that common ones are found again and those of a whole plant can be cleared.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from fractions import Fraction

from fopi_tune.core.parametric.polynomials import ParameterPolynomial
from fopi_tune.errors import DomainError


@dataclass(frozen=True)
class Rational:
    """numerator / product of divisor^power.

    Args:
        numerator: a polynomial.
        divisors: polynomials that depend on a parameter, with their powers; of one term only single parameters.
    """

    numerator: ParameterPolynomial
    divisors: Mapping[ParameterPolynomial, int] = field(default_factory=dict)

    @classmethod
    def constant(cls, axes: int, value: Fraction | float) -> Rational:
        """A number."""
        return cls(ParameterPolynomial.constant(axes, value))

    @property
    def axes(self) -> int:
        """The number of parameters."""
        return self.numerator.axes

    def __add__(self, other: Rational) -> Rational:
        shared = Counter(self.divisors) | Counter(other.divisors)
        return Rational(self.over(shared) + other.over(shared), shared).reduced()

    def __neg__(self) -> Rational:
        return Rational(-self.numerator, self.divisors)

    def __sub__(self, other: Rational) -> Rational:
        return self + -other

    def __mul__(self, other: Rational) -> Rational:
        divisors = Counter(self.divisors) + Counter(other.divisors)
        return Rational(self.numerator * other.numerator, divisors).reduced()

    def over(self, shared: Mapping[ParameterPolynomial, int]) -> ParameterPolynomial:
        """The numerator over other divisors, among which are its own."""
        return self.numerator * product(Counter(shared) - Counter(self.divisors), self.axes)

    def inverse(self) -> Rational:
        """1 over it; the numerator is nowhere 0."""
        factor, divisors = _factors(self.numerator)
        top = product(self.divisors, self.axes) * ParameterPolynomial.constant(self.axes, 1 / factor)
        return Rational(top, divisors).reduced()

    def power(self, exponent: int) -> Rational:
        """A whole power, at least 0."""
        divisors = {each: count * exponent for each, count in self.divisors.items() if exponent}
        return Rational(self.numerator.power(exponent), divisors)

    def reduced(self) -> Rational:
        """Without parameters that divide the numerator too."""
        if not self.divisors:
            return self
        divisors, lowered = Counter(self.divisors), dict(self.numerator.terms)
        for each, count in self.divisors.items():
            if each.axis is None:
                continue
            axis = each.axis
            common = min([count, *(powers[axis] for powers in lowered)])
            lowered = {(*p[:axis], p[axis] - common, *p[axis + 1 :]): value for p, value in lowered.items()}
            divisors[each] -= common
        return Rational(ParameterPolynomial.of(self.axes, lowered), +divisors)


def _factors(polynomial: ParameterPolynomial) -> tuple[Fraction, Counter[ParameterPolynomial]]:
    """A number and divisors whose product it is: parameters that divide every term, and what is left."""
    if not polynomial.terms:
        raise DomainError("divides by 0")
    axes, every = polynomial.axes, [powers for powers, _ in polynomial.terms]
    common = [min(powers[axis] for powers in every) for axis in range(axes)]
    found = Counter({ParameterPolynomial.parameter(axes, axis): count for axis, count in enumerate(common) if count})
    # with the first coefficient 1 equal divisors are found whatever number they are multiplied by
    first = polynomial.terms[0][1]
    if len(every) > 1:
        rest = {tuple(a - b for a, b in zip(powers, common, strict=True)): v / first for powers, v in polynomial.terms}
        found[ParameterPolynomial.of(axes, rest)] += 1
    return first, found


def product(divisors: Mapping[ParameterPolynomial, int], axes: int) -> ParameterPolynomial:
    """The product of powers."""
    found = ParameterPolynomial.constant(axes, 1)
    for each, count in divisors.items():
        found = found * each.power(count)
    return found


def convolved(factors: Sequence[Sequence[Rational]]) -> list[Rational]:
    """The coefficients of a product of polynomials in s, each in descending powers."""
    found = list(factors[0])
    for factor in factors[1:]:
        longer = [Rational.constant(found[0].axes, 0)] * (len(found) + len(factor) - 1)
        for i, a in enumerate(found):
            for j, b in enumerate(factor):
                longer[i + j] = longer[i + j] + a * b
        found = longer
    return found


def cleared(
    numerator: Sequence[Rational], denominator: Sequence[Rational]
) -> tuple[list[ParameterPolynomial], list[ParameterPolynomial]]:
    """Polynomials of the same plant:  (N/q)/(D/r) = (N r)/(D q), without what q and r have in common."""
    axes, shared = denominator[0].axes, []
    for side in (numerator, denominator):
        found: Counter[ParameterPolynomial] = Counter()
        for each in side:
            found |= Counter(each.divisors)
        shared.append(found)
    own = [[each.over(shared[k]) for each in side] for k, side in enumerate((numerator, denominator))]
    more = [product(shared[1] - shared[0], axes), product(shared[0] - shared[1], axes)]
    top, bottom = ([each * more[k] for each in own[k]] for k in range(2))
    return top, bottom
