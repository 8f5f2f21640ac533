"""Numbers, phrases and wrapped lines for text in a terminal."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from rich.text import Text

from fopi_tune.spec.model import Relation, Requirement, Scope

if TYPE_CHECKING:
    from fopi_tune.core.controller import FoPi

WIDTH = 80
#: width of the first column, which holds verdicts and labels
FIRST_COLUMN = 10
GOOD, BAD, QUIET = "bold green", "bold red", "dim"
#: a space at which lines are not broken
TIE = "\N{NO-BREAK SPACE}"
_SIGNS = {Relation.EQUALS: "=", Relation.AT_LEAST: ">=", Relation.AT_MOST: "<="}

#: a line and its style
Line = tuple[str, str]


def requirement_phrase(requirement: Requirement) -> str:
    """A requirement as a formula: "phase_margin_deg >= 80"; its scope and band are left out."""
    limits = [f"{limit:.10g}" for limit in requirement.limits]
    if requirement.relation is Relation.BETWEEN:
        return f"{requirement.quantity} in [{', '.join(limits)}]"
    return f"{requirement.quantity} {_SIGNS[requirement.relation]} {limits[0]}"


def scope_phrase(requirement: Requirement) -> str:
    """For which plants and frequencies a requirement holds: "family, up to 0.02 rad/s"."""
    low, high = requirement.from_rad_s, requirement.to_rad_s
    plants = "nominal plant" if requirement.scope is Scope.NOMINAL else "family"
    if low == high:
        return f"{plants}, at {with_unit(low, 'rad/s')}"
    if low > 0.0 and math.isfinite(high):
        return f"{plants}, from {number(low)} to {with_unit(high, 'rad/s')}"
    if low > 0.0:
        return f"{plants}, from {with_unit(low, 'rad/s')} on"
    return f"{plants}, up to {with_unit(high, 'rad/s')}" if math.isfinite(high) else plants


def gains_line(gains: FoPi, width: int = 56) -> str:
    """The gains, padded to a width, and the controller's formula in one line."""
    if gains.ki == 0.0:
        return f"{f'kp = {number(gains.kp)}   ki = 0':<{width}}C(s) = kp"
    values = "   ".join(f"{name} = {number(getattr(gains, name))}" for name in ("kp", "ki", "alpha"))
    return f"{values:<{width}}C(s) = kp + ki / s^alpha"


def gains_lines(gains: FoPi | Mapping[str, FoPi]) -> list[Line]:
    """The gains of one loop, or of each mode of a system."""
    if isinstance(gains, Mapping):
        return [(f"{name:<{FIRST_COLUMN}}{gains_line(each, 46)}", "bold") for name, each in gains.items()]
    return [(gains_line(gains), "bold")]


def entry(label: str, words: str, style: str = "") -> list[Line]:
    """A label in the first column and wrapped text beside it."""
    return wrapped(words, style, indent=" " * FIRST_COLUMN, first=f"{label:<{FIRST_COLUMN}}")


def wrapped(sentence: str, style: str = "", indent: str = "", first: str = "") -> list[Line]:
    """A sentence wrapped into lines of at most 80 columns; none if it is empty."""
    wrapped = textwrap.wrap(
        sentence,
        WIDTH,
        initial_indent=first or indent,
        subsequent_indent=indent,
        break_long_words=False,
        break_on_hyphens=False,
    )
    return [(line, style) for line in wrapped]


def sentence(words: str) -> str:
    """The words with a full stop."""
    return words if words.endswith(".") else words + "."


def style_of(good: bool) -> str:
    """The style of good or bad news."""
    return GOOD if good else BAD


def number(value: float, digits: int = 5) -> str:
    """A number with five digits, or as many as given."""
    # + 0.0 turns -0.0 into 0.0
    return f"{value + 0.0:.{digits}g}"


def exact_limit(limit: float) -> str:
    """A limit with five digits if these are exact, else nine: users copy it into the spec."""
    return number(limit, 5 if float(number(limit)) == limit else 9)


def with_unit(value: float, unit: str) -> str:
    """A number and its unit, joined by a space at which lines are not broken."""
    return f"{number(value)}{TIE}{unit}"


def to_text(lines: Sequence[Line]) -> Text:
    """Lines as one text."""
    text = Text()
    for line, style in lines:
        text.append(line.replace(TIE, " ").rstrip() + "\n", style)
    text.rstrip()
    return text
