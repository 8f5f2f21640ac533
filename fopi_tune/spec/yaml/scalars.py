"""Text to numbers, strictly: only decimal notation is a number; for any other a message says what to write."""

from __future__ import annotations

import math
import re
import unicodedata
from collections.abc import Callable
from decimal import Decimal

from fopi_tune.spec.yaml.problems import quoted

MAX_LENGTH = 100
#: numbers beyond these are no quantity of an engineer's, and their powers and products no floating-point numbers
SMALLEST, LARGEST = 1e-100, 1e100
_NUMBER = re.compile(r"[+-]?(?:[0-9]+(?:\.[0-9]*)?|\.[0-9]+)(?:[eE][+-]?[0-9]+)?")
_LEADING_ZERO = re.compile(r"[+-]?0[0-9]")
_BOOLEANS = frozenset({"true", "false", "yes", "no", "on", "off", "y", "n"})
_NOT_FINITE = frozenset({"nan", "inf", "infinity"})
_NULLS = frozenset({"", "~", "null", "Null", "NULL"})
_BASES = re.compile(r"[+-]?0[xXoObB][0-9a-fA-F_]+")
_SEPARATED = re.compile(r"[+-]?[0-9]{1,3}(?:,[0-9]{3})+")
_WITH_UNIT = re.compile(rf"({_NUMBER.pattern})\s*[A-Za-z%°µμΩ][A-Za-z0-9%°µμΩ/^*²]*")
_FORMULA = re.compile(r"(?=.*[*/^()+]|.*[0-9]\s*-)(?:[0-9.eE\s*/^()+-]|pi|π|sqrt|log10|log|exp)+")
_DASHES = str.maketrans(dict.fromkeys("−–—‐‑‒﹣－", "-"))
# what a plain word is in YAML 1.2.2's core schema (§10.3.2) other than text
_NOT_TEXT = re.compile(
    r"~|null|Null|NULL|true|True|TRUE|false|False|FALSE|[-+]?[0-9]+|0o[0-7]+|0x[0-9a-fA-F]+"
    r"|[-+]?(?:\.[0-9]+|[0-9]+(?:\.[0-9]*)?)(?:[eE][-+]?[0-9]+)?|[-+]?\.(?:inf|Inf|INF)|\.(?:nan|NaN|NAN)|"
)


#: the words of a number that is not whole, before what to write
NOT_WHOLE = "is not a whole number"


class NotANumberError(ValueError):
    """The text is not a number; the message says why and what to write."""


def is_empty(text: str) -> bool:
    """Whether plain text is YAML's null."""
    return text in _NULLS


def is_text(text: str) -> bool:
    """Whether plain text is a string to every YAML 1.2 reader, rather than a number, boolean or null."""
    return _NOT_TEXT.fullmatch(text) is None


def parse_number(text: str) -> float:
    """A finite decimal number.

    Raises:
        NotANumberError: not a decimal number, or too large, small or long for one that is computed with.
    """
    if len(text) > MAX_LENGTH:
        raise NotANumberError(f"{quoted(text)} is {len(text)} characters long; write at most {MAX_LENGTH} characters")
    if _NUMBER.fullmatch(text) is None:
        raise NotANumberError(_explanation(text))
    if _LEADING_ZERO.match(text):
        raise NotANumberError(f"{text} begins with 0 and could be octal; write it without the leading 0")
    value = float(text)
    if abs(value) > LARGEST:
        raise NotANumberError(f"{text} is too large to compute with; write at most {LARGEST:g}")
    if abs(value) < SMALLEST and (value != 0.0 or re.search("[1-9]", re.split("[eE]", text)[0])):
        raise NotANumberError(f"{text} is too small to compute with; write 0, or at least {SMALLEST:g}")
    return value


def parse_integer(text: str) -> int:
    """A whole number; 1e6 and 7.0 are whole.

    Raises:
        NotANumberError: not a number, or not whole.
    """
    parse_number(text)
    # exact: a float has not the digits of a large number
    exact = Decimal(text)
    below = math.floor(exact)
    if below != exact:
        raise NotANumberError(f"{text} {NOT_WHOLE}; write one, such as {below} or {below + 1}")
    return int(exact)


def is_number(text: str) -> bool:
    """Whether the text is a valid number; only such text may be suggested to the user."""
    return _NUMBER.fullmatch(text) is not None and _LEADING_ZERO.match(text) is None and math.isfinite(float(text))


def _explanation(text: str) -> str:
    return next(reason for explain in _EXPLANATIONS if (reason := explain(text)) is not None)


def _explain_word(text: str) -> str | None:
    if is_empty(text):
        return "the value is missing; write a number"
    if text.lower() in _BOOLEANS:
        return f"{quoted(text)} is yes or no where a number belongs; write a number"
    if text.lstrip("+-.").lower() in _NOT_FINITE:
        return f"{quoted(text)} is not a finite number; write a number, or leave the key out where it may be missing"
    return None


def _explain_comma(text: str) -> str | None:
    if _SEPARATED.fullmatch(text):
        decimal = text.replace(",", ".", 1)
        return f"{quoted(text)} has a comma; write {text.replace(',', '')}, or {decimal} if the comma is decimal"
    if is_number(text.replace(",", ".")):
        return f"{quoted(text)} has a decimal comma; write {text.replace(',', '.')}"
    return None


def _explain_not_ascii(text: str) -> str | None:
    strange = next((c for c in text if ord(c) > 127 and c not in "°µμΩ²"), None)
    if strange is None:
        return None
    plain = unicodedata.normalize("NFKC", text.translate(_DASHES))
    name = unicodedata.name(strange, "a special character").lower()
    advice = f"write {plain}" if is_number(plain) else "write plain digits, '-' and '.'"
    return f"{quoted(text)} contains {name} (U+{ord(strange):04X}); {advice}"


def _explain_base(text: str) -> str | None:
    if _BASES.fullmatch(text) is None:
        return None
    try:
        return f"{text} is not decimal; write {int(text, 0)}"
    except ValueError:
        return f"{text} is not decimal; write a decimal number"


def _explain_underscore(text: str) -> str | None:
    if is_number(text.replace("_", "")):
        return f"{text} has underscores; write {text.replace('_', '')}"
    return None


def _explain_sexagesimal(text: str) -> str | None:
    if re.fullmatch(r"[+-]?[0-9]+(?::[0-9]+)+(?:\.[0-9]*)?", text):
        return f"{quoted(text)} is written in base 60; write a decimal number"
    return None


def _explain_unit(text: str) -> str | None:
    if match := _WITH_UNIT.fullmatch(text):
        return f"{quoted(text)} has a unit; write {match.group(1)} alone, in the unit of the key's name"
    return None


def _explain_formula(text: str) -> str | None:
    if _FORMULA.fullmatch(text):
        return f"{quoted(text)} is a formula; write its value"
    return None


def _explain_other(text: str) -> str:
    return f"{quoted(text)} is not a number; write one such as 0.5 or 1e-3"


_EXPLANATIONS: tuple[Callable[[str], str | None], ...] = (
    _explain_word,
    _explain_comma,
    _explain_not_ascii,
    _explain_base,
    _explain_underscore,
    _explain_sexagesimal,
    _explain_unit,
    _explain_formula,
    _explain_other,
)
