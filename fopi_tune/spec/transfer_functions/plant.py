"""A plant that can be controlled, from a text:  proper, real, causal, and without hidden modes that are not stable."""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction

import numpy as np

from fopi_tune.errors import DomainError
from fopi_tune.spec.parametric.descent import ExpressionError
from fopi_tune.spec.transfer_functions.common_factor import common_factor, divided
from fopi_tune.spec.transfer_functions.parser import evaluate
from fopi_tune.spec.transfer_functions.rational import Polynomial, RationalFunction
from fopi_tune.spec.transfer_functions.text import statements
from fopi_tune.spec.yaml.scalars import LARGEST, SMALLEST


@dataclass(frozen=True)
class WrittenPlant:
    """numerator(s)/denominator(s) e^{-dead_time_s s}, the coefficients as they are written.

    Args:
        numerator: descending powers of s, as is `denominator`; the first is not 0.
        dead_time_s: at least 0.
        left_out: the common factor that was left out of both, in words; "" of none.
    """

    numerator: tuple[Fraction, ...]
    denominator: tuple[Fraction, ...]
    dead_time_s: Fraction
    left_out: str = ""


def from_text(text: str) -> WrittenPlant:
    """The plant that a text is.

    Args:
        text: what was written or printed, of one line or several.

    Raises:
        DomainError: none; the message has line and column.
    """
    try:
        return _plant(evaluate(statements(text)))
    except ExpressionError as wrong:
        before = text[: wrong.at]
        line, column = before.count("\n") + 1, len(before) - (before.rfind("\n") + 1) + 1
        raise DomainError(f"line {line}, column {column}: {wrong}") from None


def _plant(found: RationalFunction) -> WrittenPlant:
    top, bottom = _real(found.numerator), _real(found.denominator)
    if not top:
        raise DomainError("the transfer function is 0: there is no plant to control")
    if found.delay < 0:
        raise DomainError(
            f"e has the positive exponent {float(-found.delay):g} s: a plant cannot answer before it is asked; "
            "a dead time of L s is exp(-L*s)"
        )
    top, bottom, left_out = _reduced(top, bottom)
    if len(top) > len(bottom):
        raise DomainError(
            f"the numerator's degree {len(top) - 1} exceeds the denominator's {len(bottom) - 1}: no plant is improper; "
            "add the fast pole that limits its bandwidth, as in s/(0.001 s + 1)"
        )
    for value in (*top, *bottom, found.delay):
        if value and not SMALLEST <= abs(value) <= LARGEST:
            raise DomainError(
                f"a coefficient of the whole plant lies beyond {SMALLEST:g} … {LARGEST:g} in magnitude; use other units"
            )
    return WrittenPlant(top, bottom, found.delay, left_out)


def _real(found: Polynomial) -> tuple[Fraction, ...]:
    if any(value.im for value in found):
        raise DomainError(
            "the transfer function is not real; complex numbers are for conjugate zeros and poles of zpk(…)"
        )
    return tuple(value.re for value in found)


def _reduced(
    top: tuple[Fraction, ...], bottom: tuple[Fraction, ...]
) -> tuple[tuple[Fraction, ...], tuple[Fraction, ...], str]:
    """Without what both have in common, and that in words."""
    factor = common_factor(top, bottom)
    if len(factor) == 1:
        return top, bottom, ""
    words = _words(factor)
    if np.roots([float(value) for value in factor]).real.max() >= 0.0:
        raise DomainError(
            f"numerator and denominator have the common factor {words}: a mode that is not stable and that no "
            "controller reaches; leave it out of both if the plant does not have it"
        )
    return divided(top, factor), divided(bottom, factor), words


def _words(factor: tuple[Fraction, ...]) -> str:
    found = ""
    for power, value in zip(range(len(factor) - 1, -1, -1), factor, strict=True):
        if value:
            size = "" if abs(value) == 1 and power else f"{abs(float(value)):.6g}"
            variable = "" if power == 0 else "s" if power == 1 else f"s^{power}"
            sign = " - " if value < 0 else " + "
            found += (sign if found else "") + " ".join(part for part in (size, variable) if part)
    return found
