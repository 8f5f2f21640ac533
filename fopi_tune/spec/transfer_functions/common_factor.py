"""The greatest common divisor of two polynomials, exact.

    b_0^k a = q b + r,   gcd(a, b) = gcd(b, r)

in whole numbers without their common divisor.  Euclid's coefficients grow; whether there is a common factor at all is
asked first modulo a prime, where they do not.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from fractions import Fraction

#: a prime, 2^61 - 1: of two polynomials without a common factor it would have to divide the resultant
_PRIME = 2**61 - 1

Coefficients = tuple[Fraction, ...]


def common_factor(a: Sequence[Fraction], b: Sequence[Fraction]) -> Coefficients:
    """The monic common divisor of highest degree, descending powers; (1,) where there is none.

    Args:
        a: descending powers, the first not 0, as is `b`.
    """
    if _is_coprime_modulo(a, b):
        return (Fraction(1),)
    first, second = (_whole(side) for side in (a, b))
    while second:
        first, second = second, _remainder(first, second)
    return tuple(Fraction(value, first[0]) for value in first)


def divided(a: Coefficients, factor: Coefficients) -> Coefficients:
    """a / factor, a divisor of it."""
    rest, found = list(a), []
    for k in range(len(a) - len(factor) + 1):
        quotient = rest[k] / factor[0]
        found.append(quotient)
        for j, value in enumerate(factor):
            rest[k + j] -= quotient * value
    return tuple(found)


def _whole(a: Sequence[Fraction]) -> list[int]:
    scale = math.lcm(*(value.denominator for value in a))
    return _without_content([int(value * scale) for value in a])


def _without_content(a: list[int]) -> list[int]:
    """Without leading zeros and the coefficients' common divisor."""
    start = next((k for k, value in enumerate(a) if value), len(a))
    content = math.gcd(*a)
    return [value // content for value in a[start:]]


def _remainder(a: list[int], b: list[int]) -> list[int]:
    """What is left of a whole multiple of a."""
    rest = a
    for _ in range(len(a) - len(b) + 1):
        first, padded = rest[0], b + [0] * (len(rest) - len(b))
        rest = [b[0] * x - first * y for x, y in zip(rest, padded, strict=True)][1:]
    return _without_content(rest)


def _is_coprime_modulo(a: Sequence[Fraction], b: Sequence[Fraction]) -> bool:
    """Whether they are coprime modulo the prime, and so over the fractions; False says nothing."""
    sides = []
    for side in (a, b):
        if any(value.denominator % _PRIME == 0 for value in side) or side[0].numerator % _PRIME == 0:
            return False
        sides.append([value.numerator * pow(value.denominator, -1, _PRIME) % _PRIME for value in side])
    first, second = sides
    while second:
        inverse = pow(second[0], -1, _PRIME)
        while len(first) >= len(second):
            quotient = first[0] * inverse % _PRIME
            first = [(x - quotient * y) % _PRIME for x, y in zip(first, second + [0] * len(first), strict=False)][1:]
            while first and first[0] == 0:
                first = first[1:]
        first, second = second, first
    return len(first) == 1
