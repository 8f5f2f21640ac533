"""Numbers, phrases and wrapped lines for text in a terminal."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from rich.text import Text

from fopi_tune.core.controller import FoPi, FoPid, Pid
from fopi_tune.core.terms.measurement_filter import MeasurementFilter
from fopi_tune.core.text_tables.words import agreeing
from fopi_tune.quantities import QUANTITIES
from fopi_tune.quantities.base import EvaluatedAt
from fopi_tune.results.equalities import shown_score
from fopi_tune.spec.model import Relation, Requirement, Scope

WIDTH = 80
#: width of the first column, which holds verdicts and labels
FIRST_COLUMN = 10
GOOD, BAD, QUIET = "bold green", "bold red", "dim"
#: a space at which lines are not broken
TIE = "\N{NO-BREAK SPACE}"
_SIGNS = {Relation.EQUALS: "=", Relation.AT_LEAST: ">=", Relation.AT_MOST: "<="}

#: names of gains, which are written as they are
_NAMES = ("kp", "ki", "kd", "mu", "alpha")
#: of a requirement or a loop whose margin does not exist
NO_MARGIN = "no margin: unstable"
#: a line and its style
Line = tuple[str, str]


def requirement_phrase(requirement: Requirement) -> str:
    """A requirement as a formula: "phase_margin_deg >= 80"; its scope and band are left out."""
    limits = [f"{limit:.10g}" for limit in requirement.limits]
    if requirement.relation is Relation.BETWEEN:
        return f"{requirement.quantity} in [{', '.join(limits)}]"
    end = "" if requirement.end_limit is None else f" … {requirement.end_limit:.10g}"
    return f"{requirement.quantity} {_SIGNS[requirement.relation]} {limits[0]}{end}"


def missed_digits(value: float, limits: Sequence[float]) -> int:
    """With how many digits, 5 to 9, a value that misses its limits is not shown as one of them."""
    return next((digits for digits in range(5, 9) if float(f"{value:.{digits}g}") not in limits), 9)


def verdict_word(met: bool | None, proof: str | None) -> str:
    """The verdict on a requirement, the same word in every table.

    Args:
        met: what the check in floating point found; None without gains.
        proof: the certificate's verdict, or that of measured responses; None without one.

    Returns:
        `proved`, `checked` (measured responses), `met` (without a certificate), `undecided`, `violated`, or `open`
        without gains.
    """
    if met is None:
        return "open"
    if not met or proof == "refuted":
        return "violated"
    return "met" if proof is None else proof


def score_phrase(requirement: Requirement, score: float | None, achieved: float | None) -> str:
    """A score with three digits, six where fewer would hide which side of 1 it is on; "-" where there is none.

    Of an equality it is the distance per 0.1 % or 0.1 degrees, however narrow the verdict's own tolerance is.
    """
    if score is None:
        return "-"
    if requirement.relation is Relation.EQUALS and achieved is not None:
        score = shown_score(requirement, achieved)
    elif 0.9995 <= score < 1.0005:
        return f"{score:.6f}" if score > 1.0 else "1.000"
    return f"{abs(score):.3f}" if score < 1000.0 else f"{score:.3g}"


def score_note(missed: Iterable[Requirement]) -> str:
    """What the scores of a table mean, where these requirements are missed."""
    if any(requirement.relation is Relation.EQUALS for requirement in missed):
        return (
            "A score of at most 1 is met; that of an equality is its distance per 0.1 % or 0.1 deg, and it is met "
            "only within the tolerance."
        )
    return "A score of at most 1 is met."


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


def endless_phrase(quantity: str) -> str:
    """Why a margin is infinite."""
    at_phase = QUANTITIES[quantity].where is EvaluatedAt.PHASE_CROSSOVERS
    return f"no {'phase' if at_phase else 'gain'} crossover sets it"


def members_phrase(members: Sequence[tuple[str, float]]) -> str:
    """The plants of a list with the weights by which they are drawn: "of car, truck, drawn 1 : 2"."""
    return f"of {', '.join(name for name, _ in members)}, drawn {' : '.join(f'{weight:g}' for _, weight in members)}"


def drawn_phrase(name: str, upper: bool, met: bool) -> str:
    """An infinite value of a drawn plant in words.

    Args:
        name: the requirement's quantity or the limit's measure.
        upper: whether large values are the worst; a value that does not exist is then counted as infinitely large.
        met: whether the plant meets the requirement or limit.
    """
    if not upper:
        return "infinite" if met else "none"
    quantity = QUANTITIES.get(name)
    if quantity is None or quantity.takes_band:
        return "infinite"
    return "infinite or none" if quantity.is_margin else "none"


def margins_phrase(nominal: Mapping[str, Any]) -> str:
    """A loop's margins, from a result's JSON: "crossover 0.3 rad/s, ..."; of an unstable loop what it crosses."""
    omega, angles = nominal["gain_crossovers_rad_s"], nominal["angles_from_minus_one_deg"]
    if not nominal["stable"]:
        at = [
            f"at {with_unit(w, 'rad/s')}, {with_unit(angle, 'deg')} from{TIE}-1"
            for w, angle in zip(omega, angles, strict=True)
        ]
        return f"{NO_MARGIN}; {'crosses |L| = 1 ' + ', and '.join(at) if at else '|L| never crosses 1'}"
    plural = "s" if len(omega) > 1 else ""
    parts = [f"crossover{plural} {', '.join(map(number, omega))}{TIE}rad/s" if omega else "no gain crossover"]
    for name, key, unit in (
        ("phase margin", "phase_margin_deg", "deg"),
        ("gain margin", "gain_margin_db", "dB"),
        ("gain reduction margin", "gain_reduction_margin_db", "dB"),
        ("delay margin", "delay_margin_s", "s"),
    ):
        if nominal[key] is not None:
            parts.append(f"{name} {with_unit(nominal[key], unit)}")
        elif key != "gain_reduction_margin_db":
            parts.append(f"{name} infinite")
    return ", ".join(parts)


def gains_line(gains: FoPi, width: int = 56) -> str:
    """The gains, padded to a width, and the controller's formula in one line; closer together where they are long, and
    without the formula where it has no room."""
    if isinstance(gains, FoPid):
        return _line_with_derivative(gains, width)
    if gains.ki == 0.0:
        return f"{f'kp = {number(gains.kp)}   ki = 0':<{width}}C(s) = kp"
    parts = [f"{name} = {number(getattr(gains, name))}" for name in ("kp", "ki", "alpha")]
    for gap in ("   ", "  "):
        if len(values := gap.join(parts)) + len(gap) <= width:
            return f"{values:<{width}}C(s) = kp + ki / s^alpha"
    return "   ".join(parts)


def _line_with_derivative(gains: FoPid, width: int) -> str:
    is_pid = isinstance(gains, Pid)
    names = ("kp", "ki", "kd") if is_pid else ("kp", "ki", "alpha", "kd", "mu")
    parts = [f"{name} = {number(getattr(gains, name))}" for name in names]
    parts.append(f"Tf = {number(gains.derivative_filter_time_constant_s)} s")
    # this formula is ten characters longer; that of other orders has no room
    room = width - 10 if is_pid else 0
    for gap in ("   ", "  "):
        if len(values := gap.join(parts)) + len(gap) <= room:
            return f"{values:<{room}}C(s) = kp + ki/s + kd s/(Tf s + 1)"
    return ("   " if is_pid else "  ").join(parts)


def gains_lines(gains: FoPi | Mapping[str, FoPi]) -> list[Line]:
    """The gains of one loop, or of each mode of a system."""
    if isinstance(gains, Mapping):
        labels = {name: _label(name) for name in gains}
        return [
            (f"{labels[name]}{gains_line(each, 46 + FIRST_COLUMN - len(labels[name]))}", "bold")
            for name, each in gains.items()
        ]
    weight = gains.setpoint_weight
    weighted = [] if weight is None else entry("setpoint", f"weight b = {number(weight)}: kp acts on b r - y")
    return [(gains_line(gains), "bold"), *weighted, *_filter_lines(gains.measurement_filter)]


def filter_formula(used: MeasurementFilter) -> str:
    """A measurement filter in words: "F = 1/(1 + sT), T = 0.1 s"."""
    square = " + s^2 T^2/2" if used.order == 2 else ""
    return f"F(s) = 1/(1 + sT{square}) with T = {number(used.time_constant_s)} s"


def _filter_lines(used: MeasurementFilter | None) -> list[Line]:
    return [] if used is None else entry("filter", f"{filter_formula(used)} on the measurement; C is F times that")


def entry(label: str, words: str, style: str = "") -> list[Line]:
    """A label in the first column and wrapped text beside it."""
    return wrapped(words, style, indent=" " * FIRST_COLUMN, first=_label(label))


def _label(text: str) -> str:
    """A label with its space behind it; a mode's name may be longer than the column."""
    return f"{text:<{FIRST_COLUMN - 1}} "


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


def samples_phrase(samples: float) -> str:
    """`1 sample`, `1.4 samples`."""
    return f"{number(samples)} {agreeing(samples, 'sample', 'samples')}"


def next_sentence(words: str) -> str:
    """The words with a full stop and, unless a name of the spec language begins them, a capital."""
    first = words.split(" ", 1)[0]
    is_name = "_" in first or first in _NAMES or not first.isalpha()
    return sentence(words if is_name else words[:1].upper() + words[1:])


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
