"""Suggestions for unknown words: the known word that was misspelt, or the known name with the right unit."""

from __future__ import annotations

import difflib
import re
from collections.abc import Collection
from dataclasses import dataclass

from fopi_tune.spec.yaml.problems import quoted

#: names longer than this are not misspellings, and comparing them takes long
_LONGEST_NAME = 60
_SIMILARITY = 0.72
#: every message about an unknown key begins with this
UNKNOWN_KEY = "the key is not known here"

#: the units of the language: ending of a name, the unit in words
_UNITS = {"_rad_s": "rad/s", "_s": "s", "_deg": "degrees", "_db": "dB", "_deg_per_decade": "degrees per decade"}

#: endings that are not in the language: the right ending, and how to convert
_WRONG_UNITS: dict[str, tuple[str, str]] = {
    "_hz": ("_rad_s", "frequencies are in rad/s: multiply by 2π"),
    "_khz": ("_rad_s", "frequencies are in rad/s: multiply by 2000π"),
    "_rpm": ("_rad_s", "frequencies are in rad/s: multiply by π/30"),
    "_ms": ("_s", "times are in seconds: divide by 1000"),
    "_us": ("_s", "times are in seconds: divide by 1e6"),
    "_min": ("_s", "times are in seconds: multiply by 60"),
    "_h": ("_s", "times are in seconds: multiply by 3600"),
    "_sec": ("_s", "times are in seconds"),
    "_seconds": ("_s", "times are in seconds"),
    "_rad": ("_deg", "angles are in degrees: multiply by 180/π"),
    "_radians": ("_deg", "angles are in degrees: multiply by 180/π"),
    "_degrees": ("_deg", "angles are in degrees"),
    "_abs": ("_db", "gains are in dB: take 20 log10"),
    "_linear": ("_db", "gains are in dB: take 20 log10"),
}


#: other words for names of the language
_SYNONYMS: tuple[frozenset[str], ...] = tuple(
    frozenset(words.split())
    for words in (
        "min minimum low lower from at_least least ge gte >= lb",
        "max maximum high upper to at_most most le lte <= ub",
        "equals equal eq exactly = ==",
        "between range interval",
        "time_constant_s tau t lag",
        "static_gain gain k",
        "dead_time_s delay theta l transport_delay",
        "numerator num",
        "denominator den",
        "sample_time_s ts dt period sampling_period",
        "phase_margin_deg pm",
        "gain_margin_db gm",
        "sensitivity_db ms",
        "complementary_sensitivity_db mt",
        "crossover_rad_s wc wgc omega_c",
        "alpha lambda lam order",
        "kp k_p kc k_c k gain p proportional proportional_gain",
        "ki k_i i integral integral_gain",
    )
)


@dataclass(frozen=True)
class Hint:
    """A message about an unknown key, and the known key that was probably meant, if any."""

    message: str
    meant: str | None


def closest(word: str, known: Collection[str]) -> str | None:
    """The known word that `word` misspells, or None."""
    if len(word) > _LONGEST_NAME:
        return None
    by_lower = {name.lower(): name for name in known}
    matches = difflib.get_close_matches(word.lower().replace("-", "_"), by_lower, n=1, cutoff=_SIMILARITY)
    return by_lower[matches[0]] if matches else None


def unknown_word_message(word: str, known: Collection[str], instead: str = "") -> str:
    """The message for a value that is not one of `known`; `instead` says what else may stand in its place."""
    meant = closest(word, known)
    if meant is not None:
        return f"{quoted(word)} is not known here; did you mean {meant!r}?"
    return f"{quoted(word)} is not known here; write {one_of(known)}{f', or {instead}' if instead else ''}"


def unknown_key_hint(key: str, known: Collection[str]) -> Hint:
    """The message for a key that is not in `known`, with a suggestion."""
    if (hint := _unit_hint(key, known)) is not None:
        return hint
    if (synonym := _synonym(key, known)) is not None:
        unit = _unit(synonym)
        return Hint(f"{UNKNOWN_KEY}; write {synonym}{f' ({unit})' if unit else ''}", synonym)
    stem, _, end = key.rpartition("_")
    if stem in known and (side := _synonym(end, ("min", "max"))) is not None:
        return Hint(f"{UNKNOWN_KEY}; write {stem}: {{{side}: ...}}", stem)
    meant = closest(key, known)
    if meant is not None:
        return Hint(f"{UNKNOWN_KEY}; did you mean {meant!r}?", meant)
    return Hint(f"{UNKNOWN_KEY}; remove it or write {one_of(known)}", None)


def one_of(words: Collection[str]) -> str:
    """'a', 'a or b', 'a, b or c'."""
    *first, last = words
    return f"{', '.join(first)} or {last}" if first else last


def _unit_hint(key: str, known: Collection[str]) -> Hint | None:
    lower = key.lower()
    stems = {_without_unit(name): name for name in known if _unit(name) is not None}
    if lower in stems:
        meant = stems[lower]
        return Hint(f"the unit is part of the name; write {meant} ({_unit(meant)})", meant)
    ending = "_" + lower.rpartition("_")[2]
    if "_" not in lower or ending not in _WRONG_UNITS:
        return None
    right, conversion = _WRONG_UNITS[ending]
    stem = lower.removesuffix(ending)
    same_unit = [name for name in known if name.endswith(right) and _unit(name) == _UNITS[right]]
    if stem + right in same_unit:
        return Hint(f"{conversion} and write {stem + right}", stem + right)
    if stem in stems:
        meant = stems[stem]
        return Hint(f"the unit is wrong; write {meant} ({_unit(meant)})", meant)
    meant = closest(stem + right, same_unit)
    if meant is not None:
        return Hint(f"{conversion} and write {meant}", meant)
    # the ending is no unit: output_min
    return None


def _synonym(key: str, known: Collection[str]) -> str | None:
    """The one known name that means the same, or the name itself."""
    lower = key.lower()
    found = [name for name in known if lower == name or any({lower, name} <= words for words in _SYNONYMS)]
    return found[0] if len(found) == 1 else None


def _unit(name: str) -> str | None:
    endings = sorted((e for e in _UNITS if name.endswith(e)), key=len)
    return _UNITS[endings[-1]] if endings else None


def _without_unit(name: str) -> str:
    endings = sorted((re.escape(e) for e in _UNITS), key=len, reverse=True)
    return re.sub(f"(?:{'|'.join(endings)})$", "", name)
