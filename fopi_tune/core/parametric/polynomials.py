"""Polynomials in a family's parameters, with exact rational coefficients.

    p(x) = sum_i c_i x_1^e_i1 ... x_n^e_in

They are evaluated by + and * alone, so that floats, arrays, balls with derivatives and jets take part alike.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

from fopi_tune.errors import DomainError

#: exponents, one a parameter
Powers = tuple[int, ...]
#: a parameter's highest power, and the most terms of one polynomial: beyond these nothing is well conditioned
MOST_DEGREE, MOST_TERMS = 32, 400
#: bits of a coefficient's numerator and denominator, and the sizes that floating point computes with
_MOST_BITS = 8000
_SMALLEST, _LARGEST = Fraction(1e-250), Fraction(1e250)


@dataclass(frozen=True)
class ParameterPolynomial:
    """A polynomial in `axes` parameters.

    Args:
        axes: the number of parameters.
        terms: (powers, coefficient) in ascending powers, no coefficient 0; none of the zero polynomial.
    """

    axes: int
    terms: tuple[tuple[Powers, Fraction], ...]

    @classmethod
    def of(cls, axes: int, terms: Mapping[Powers, Fraction]) -> ParameterPolynomial:
        """From terms by their powers.

        Raises:
            DomainError: too many terms, or a number or a power that is too large.
        """
        kept = {powers: value for powers, value in terms.items() if value}
        if len(kept) > MOST_TERMS:
            raise DomainError(f"has more than {MOST_TERMS} terms when its parentheses are multiplied out")
        for powers, value in kept.items():
            if max(powers, default=0) > MOST_DEGREE:
                raise DomainError(f"has a power above {MOST_DEGREE} of a parameter")
            bits = max(value.numerator.bit_length(), value.denominator.bit_length())
            if bits > _MOST_BITS or not _SMALLEST < abs(value) < _LARGEST:
                raise DomainError("has a number that is too large or too small to compute with")
        return cls(axes, tuple(sorted(kept.items())))

    @classmethod
    def constant(cls, axes: int, value: Fraction | float) -> ParameterPolynomial:
        """A number, exactly as floating point has it."""
        return cls.of(axes, {(0,) * axes: Fraction(value)})

    @classmethod
    def parameter(cls, axes: int, axis: int) -> ParameterPolynomial:
        """One of the parameters itself."""
        return cls(axes, ((tuple(int(k == axis) for k in range(axes)), Fraction(1)),))

    @property
    def is_zero(self) -> bool:
        """Whether it is 0 everywhere."""
        return not self.terms

    @property
    def value(self) -> Fraction | None:
        """The number that it is; None where it depends on a parameter."""
        if not self.terms:
            return Fraction(0)
        powers, value = self.terms[0]
        return value if len(self.terms) == 1 and not any(powers) else None

    @property
    def axis(self) -> int | None:
        """The parameter that it is, by its index; None of any other polynomial."""
        if len(self.terms) != 1 or self.terms[0][1] != 1 or sum(self.terms[0][0]) != 1:
            return None
        return self.terms[0][0].index(1)

    def __add__(self, other: ParameterPolynomial) -> ParameterPolynomial:
        sums = dict(self.terms)
        for powers, value in other.terms:
            sums[powers] = sums.get(powers, Fraction(0)) + value
        return self.of(self.axes, sums)

    def __neg__(self) -> ParameterPolynomial:
        return ParameterPolynomial(self.axes, tuple((powers, -value) for powers, value in self.terms))

    def __sub__(self, other: ParameterPolynomial) -> ParameterPolynomial:
        return self + -other

    def __mul__(self, other: ParameterPolynomial) -> ParameterPolynomial:
        if len(self.terms) * len(other.terms) > MOST_TERMS**2 // 8:
            raise DomainError(f"has more than {MOST_TERMS} terms when its parentheses are multiplied out")
        sums: dict[Powers, Fraction] = {}
        for powers, value in self.terms:
            for others, more in other.terms:
                both = tuple(a + b for a, b in zip(powers, others, strict=True))
                sums[both] = sums.get(both, Fraction(0)) + value * more
        return self.of(self.axes, sums)

    def power(self, exponent: int) -> ParameterPolynomial:
        """A whole power, at least 0."""
        found = self.constant(self.axes, 1)
        for _ in range(exponent):
            found = found * self
        return found

    def derivative(self, axis: int) -> ParameterPolynomial:
        """The partial derivative by one parameter."""
        return self.of(
            self.axes,
            {
                (*powers[:axis], powers[axis] - 1, *powers[axis + 1 :]): value * powers[axis]
                for powers, value in self.terms
                if powers[axis]
            },
        )

    def at(self, values: Sequence[Any], number: Callable[[Fraction], Any] = float) -> Any:
        """The value for parameters that are numbers, arrays, balls or symbols; `number` makes a coefficient of them.

        Parameters are multiplied one by one: what takes part needs + and *, and no power.
        """
        total: Any = None
        for powers, coefficient in self.terms:
            term: Any = None
            for value, exponent in zip(values, powers, strict=True):
                for _ in range(exponent):
                    term = value if term is None else term * value
            if term is None:
                term = number(coefficient)
            elif coefficient != 1:
                term = term * number(coefficient)
            total = term if total is None else total + term
        return number(Fraction(0)) if total is None else total
