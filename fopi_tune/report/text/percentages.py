"""Shares in percent that never say more than was counted."""

from __future__ import annotations

from decimal import ROUND_CEILING, ROUND_DOWN, ROUND_FLOOR, ROUND_HALF_EVEN, Context, Decimal

from fopi_tune.core.text_tables.words import agreeing

_DIGITS, _MOST_DIGITS = 4, 20


def share_phrase(met: int, total: int) -> str:
    """The share that met: "99.99 %"; 100 % only of n of n, 0 % only of none."""
    return f"{_percent(Decimal(met) / Decimal(total), ROUND_HALF_EVEN)} %"


def interval_phrase(low: float, high: float) -> str:
    """An interval with its ends rounded outwards: "99.47 .. 100 %"; an end of 100 % only where nothing was missed."""
    return f"{_percent(Decimal(low), ROUND_FLOOR)} .. {_percent(Decimal(high), ROUND_CEILING)} %"


def _percent(share: Decimal, rounding: str) -> str:
    """100 times a share, with four digits, or as many as keep what lies below 1 below 100."""
    exact, digits = 100 * share, _DIGITS
    shown = Context(digits, rounding).create_decimal(exact)
    while shown >= 100 > exact and digits < _MOST_DIGITS:
        digits += 1
        shown = Context(digits, rounding).create_decimal(exact)
        if rounding == ROUND_HALF_EVEN:
            shown = Context(_DIGITS, ROUND_DOWN).create_decimal(exact)
    return f"{shown.normalize():f}"


def meeting_phrase(met: int, total: int, what: str, low: float, high: float) -> str:
    """How many of the `what` drawn, `plants` or `pairs`, meet a limit, with the interval of their share."""
    return f"{met} of {total} drawn {what} {agreeing(met, 'meets', 'meet')} it ({interval_phrase(low, high)})"
