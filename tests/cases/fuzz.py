"""Files that were damaged:  the bytes of a good file and a seeded chance -> the bytes of a bad one."""

from __future__ import annotations

import copy
import json
import random
import re
from collections.abc import Callable, Iterator
from typing import Any

from fopi_tune.proof.documents import digest

_NUMBERS = (
    "0 -0.0 -1 1 7 1e-320 5e-324 1e-9 1e9 1e300 -1e308 1.79769313486231e308 1e999 -1e999 NaN -Infinity .nan .inf "
    "nan inf 9007199254740993 18446744073709551616 0x10 0o7 1_000 +1 .5 1. 1e 1e-3"
)
_WORDS = (
    "true null ~ no '' \"\" [] {} [[]] {a:1} : - , # & *a !b %YAML << | > \\ \x00 \x1b[31m \u202e \ud7ff \ufeff \u0663 "
    "x schema gains at_most min max nominal lag pole"
)
#: what stands where a number or a word stood
TOKENS = (*_NUMBERS.split(" "), *_WORDS.split(" "))
TOKENS_OF_MANY_DIGITS = ("9" * 400, "9" * 5000, "-1" + "0" * 308)
_JSON_NUMBERS = "0 -1 1 0.5 2 7.25 1e-320 1e-9 1e9 1e30 1e300 -1e308 1e999 NaN -Infinity 9007199254740993"
_JSON_WORDS = '"" "x" "\\u0000" "\\ud800" "\\u001b[31m" "met" "proved" [] {} [[]] [1] true null {"a":1}'
#: the same in place of an entry of JSON, as text
VALUES = (
    *_JSON_NUMBERS.split(" "),
    *_JSON_WORDS.split(" "),
    *("9" * 400, "9" * 5000, "[" * 50 + "]" * 50, '"' + "x" * 5000 + '"'),
)
_TOKEN = re.compile(rb"[A-Za-z0-9_.+-]+")


def damaged(data: bytes, chance: random.Random) -> bytes:
    """A file with one to three mistakes in its bytes, lines or words."""
    for _ in range(chance.choice((1, 1, 2, 3))):
        data = chance.choice(_DAMAGES)(data, chance)
    return data


def damaged_json(data: bytes, chance: random.Random) -> bytes:
    """A JSON file with an entry dropped, renamed, moved or of another type; in some, only its bytes are damaged."""
    if chance.random() < 0.2:
        return damaged(data, chance)
    document = json.loads(data)
    text: list[tuple[str, str]] = []
    for _ in range(chance.choice((1, 1, 1, 2, 3))):
        _change_entry(document, chance, text)
    made = json.dumps(document, indent=2)
    for mark, value in text:
        made = made.replace(f'"{mark}"', value)
    return (_sealed(made) if chance.random() < 0.6 else made).encode()


def _sealed(text: str) -> str:
    """A certificate with the digest of its content, as whoever changes it on purpose would write it."""
    try:
        document = json.loads(text)
        stated = document["digest"]
        return text.replace(f'"{stated}"', f'"{digest(document)}"')
    except (ValueError, LookupError, TypeError, RecursionError):
        return text  # no certificate, or one that has no digest


def _flip(data: bytes, chance: random.Random) -> bytes:
    at = chance.randrange(len(data) + 1)
    return data[:at] + bytes([chance.randrange(256)]) + data[at + chance.choice((0, 1)) :]


def _insert(data: bytes, chance: random.Random) -> bytes:
    at = chance.randrange(len(data) + 1)
    return data[:at] + chance.choice(_PIECES) + data[at:]


def _cut(data: bytes, chance: random.Random) -> bytes:
    at = chance.randrange(len(data) + 1)
    return data[:at] + (data[at + chance.randrange(1, 200) :] if chance.random() < 0.7 else b"")


def _lines(data: bytes, chance: random.Random) -> bytes:
    lines = data.splitlines(keepends=True) or [b""]
    one, other = chance.randrange(len(lines)), chance.randrange(len(lines))
    deed = chance.randrange(4)
    if deed == 0:
        del lines[one]
    elif deed == 1:
        lines.insert(other, lines[one])
    elif deed == 2:
        lines[one], lines[other] = lines[other], lines[one]
    else:
        lines[one] = chance.choice((b"\t", b"  ", b"- ", b"a: ")) + lines[one]
    return b"".join(lines)


def _token(data: bytes, chance: random.Random) -> bytes:
    """Another word or number in place of one."""
    found = list(_TOKEN.finditer(data))
    if not found:
        return data
    at = chance.choice(found)
    other = chance.choice(found).group() if chance.random() < 0.3 else _new_token(chance)
    return data[: at.start()] + other + data[at.end() :]


def _number(data: bytes, chance: random.Random) -> bytes:
    """A number multiplied, or another in its place."""
    found = [each for each in _TOKEN.finditer(data) if re.fullmatch(rb"[+-]?[0-9.]+(?:e[+-]?[0-9]+)?", each.group())]
    if not found:
        return _token(data, chance)
    at = chance.choice(found)
    power = chance.choice((b"e300", b"e-300", b"e30", b"e-30", b"e3", b"e-3", b"e999"))
    other = at.group() + power if chance.random() < 0.5 else _new_token(chance)
    return data[: at.start()] + other + data[at.end() :]


def _new_token(chance: random.Random) -> bytes:
    word = chance.choice(TOKENS_OF_MANY_DIGITS) if chance.random() < 0.05 else chance.choice(TOKENS)
    return word.encode("utf-8")


_PIECES = (
    b"\0",
    b"\xff\xfe",
    b"\xef\xbb\xbf",
    b"\r",
    b"\n\n",
    b"\t",
    b"---\n",
    b"...\n",
    b"\x1b]0;a\x07",
    b'"',
    b"'",
    b"[" * 40,
)
_PIECES += (
    b"{" * 2000,
    b"[" * 20_000,
    b"\xed\xa0\x80",
    b": ",
    b"- " * 30,
    b"9" * 400,
    b"a" * 100_000,
    b"? ",
    b"\xc2\x85",
)
_DAMAGES: tuple[Callable[[bytes, random.Random], bytes], ...] = (
    _flip,
    _insert,
    _cut,
    _lines,
    _token,
    _token,
    _number,
    _number,
)


def _change_entry(document: Any, chance: random.Random, text: list[tuple[str, str]]) -> None:
    """One change somewhere in a tree; values that Python's writer does not write are marks, listed in `text`."""
    places = list(_places(document))
    if not places:
        return
    parent, key = chance.choice(places)
    deed = chance.randrange(6)
    if deed == 0:
        del parent[key]
    elif deed == 1 and isinstance(parent, dict):
        parent[chance.choice((key + "_", key.upper(), "", "schema", "\x1b", "a" * 3000))] = parent.pop(key)
    elif deed == 2:
        other, other_key = chance.choice(places)
        parent[key] = copy.deepcopy(other.get(other_key) if isinstance(other, dict) else other[other_key])
    elif deed == 3 and isinstance(parent, list):
        parent.extend(copy.deepcopy(parent[: chance.choice((1, 2, 50))]))
    elif deed == 4 and isinstance(parent[key], int | float) and not isinstance(parent[key], bool):
        parent[key] *= chance.choice((-1.0, 1e-30, 1e-3, 1.0 + 1e-6, 1.5, 1e3, 1e30, 1e200))
    else:
        mark = f"mark{len(text)}_{chance.randrange(10**9)}"
        text.append((mark, chance.choice(VALUES)))
        parent[key] = mark


def _places(value: Any) -> Iterator[tuple[Any, Any]]:
    """Every entry below a value, as what holds it and its key."""
    for key, inner in value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ():
        yield value, key
        yield from _places(inner)
