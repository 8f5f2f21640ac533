"""Strict reading of the JSON of certificates and results:  types are checked, and every error names the entry.

`first_difference` compares a document with the one that is derived again from what was read.
"""

from __future__ import annotations

import math
import os
from enum import StrEnum
from typing import Any, TypeVar

from fopi_tune.core.controller import DERIVATIVE_NAMES, ORDER_NAME, WEIGHT_NAME, FoPi, controller_of
from fopi_tune.core.terms.measurement_filter import FILTER_NAMES
from fopi_tune.errors import CertificateError

#: relative; by how much a number may differ from the one derived again, which another machine rounds otherwise
_ROUNDING = 1e-12
#: beyond this a double would not hold it
_LARGEST_INTEGER = 2**1000
#: of a matrix
_MOST_ROWS = 250
Word = TypeVar("Word", bound=StrEnum)


class JsonObject:
    """One object of the document.

    Args:
        value: the parsed JSON.
        place: its path in the document, for error messages.
    """

    def __init__(self, value: object, place: str) -> None:
        if isinstance(value, str | os.PathLike) and not place:
            raise CertificateError(
                f"{value!r:.100} is text or a path, no object; give what json.load reads of the file"
            )
        if not isinstance(value, dict):
            raise CertificateError(f"{place or 'the file'} is no object; this is not a file of this tool")
        self.value: dict[str, Any] = value
        self.place = place

    def get(self, key: str) -> Any:
        """The raw value."""
        if key not in self.value:
            raise CertificateError(f"{self.at(key)} is missing")
        return self.value[key]

    def at(self, key: str) -> str:
        """The path of an entry in the document."""
        return f"{self.place}.{key}" if self.place else key

    def number(self, key: str) -> float:
        """A finite number."""
        found = self.get(key)
        huge = isinstance(found, int) and abs(found) > _LARGEST_INTEGER
        if isinstance(found, bool) or not isinstance(found, int | float) or huge or not math.isfinite(found):
            raise CertificateError(f"{self.at(key)} is no finite number")
        return float(found)

    def controller(self) -> FoPi:
        """The controller whose numbers the entries are: kp, ki, alpha, those of a derivative and of filters.

        Raises:
            CertificateError: an entry is missing, or is no finite number.
            DomainError: there is no such controller.
        """
        order = (ORDER_NAME,) if ORDER_NAME in self.value else ()
        derivative = DERIVATIVE_NAMES if order or any(name in self.value for name in DERIVATIVE_NAMES) else ()
        filtered = FILTER_NAMES if any(name in self.value for name in FILTER_NAMES) else ()
        weight = (WEIGHT_NAME,) if WEIGHT_NAME in self.value else ()
        names = ("kp", "ki", "alpha", *derivative, *order, *filtered, *weight)
        return controller_of({name: self.number(name) for name in names})

    def number_or_none(self, key: str) -> float | None:
        """A finite number or null."""
        return None if self.get(key) is None else self.number(key)

    def count_or_none(self, key: str) -> int | None:
        """A whole number or null."""
        found = self.number_or_none(key)
        if found is not None and found != int(found):
            raise CertificateError(f"{self.at(key)} is no whole number")
        return None if found is None else int(found)

    def text(self, key: str) -> str:
        """A string."""
        found = self.get(key)
        if not isinstance(found, str):
            raise CertificateError(f"{self.at(key)} is no text")
        if not found.isprintable():  # control sequences must not reach a terminal
            raise CertificateError(f"{self.at(key)} holds characters that cannot be printed")
        return found

    def word(self, key: str, words: type[Word]) -> Word:
        """One of the words of an enum."""
        found, known = self.text(key), [word.value for word in words]
        if found not in known:
            raise CertificateError(f"{self.at(key)}: {found[:40]!r} is none of {', '.join(known)}")
        return words(found)

    def flag(self, key: str) -> bool:
        """true or false."""
        found = self.get(key)
        if not isinstance(found, bool):
            raise CertificateError(f"{self.at(key)} is neither true nor false")
        return found

    def texts(self, key: str) -> dict[str, str]:
        """An object that holds texts."""
        found = self.child(key)
        for name in found.value:
            if not name.isprintable():
                raise CertificateError(f"{found.place} has a key with characters that cannot be printed")
        return {name: found.text(name) for name in found.value}

    def text_list(self, key: str) -> tuple[str, ...]:
        """A list of texts."""
        return tuple(JsonObject({key: item}, f"{self.place}[{k}]").text(key) for k, item in enumerate(self._list(key)))

    def child(self, key: str) -> JsonObject:
        """An object."""
        return JsonObject(self.get(key), self.at(key))

    def children(self, key: str) -> list[JsonObject]:
        """A list of objects."""
        return [JsonObject(item, f"{self.at(key)}[{k}]") for k, item in enumerate(self._list(key))]

    def numbers(self, key: str) -> tuple[float, ...]:
        """A list of finite numbers."""
        items = self._list(key)
        return tuple(JsonObject({key: item}, f"{self.place}[{k}]").number(key) for k, item in enumerate(items))

    def lower_triangle(self, key: str) -> tuple[tuple[float, ...], ...]:
        """The lower triangle of a matrix: rows of 1, 2, ... finite numbers."""
        rows = self.get(key)
        if not isinstance(rows, list) or not 1 <= len(rows) <= _MOST_ROWS:
            raise CertificateError(f"{self.at(key)} is no lower triangle")
        found = tuple(JsonObject({"row": row}, f"{self.at(key)}[{k}]").numbers("row") for k, row in enumerate(rows))
        if any(len(row) != k + 1 for k, row in enumerate(found)):
            raise CertificateError(f"{self.at(key)} is no lower triangle")
        return found

    def _list(self, key: str) -> list[Any]:
        found = self.get(key)
        if not isinstance(found, list):
            raise CertificateError(f"{self.at(key)} is no list")
        return found


def first_difference(stated: object, derived: object, place: str) -> str | None:
    """Path of the first difference of two documents beyond rounding; None when they agree."""
    if isinstance(stated, dict) and isinstance(derived, dict):
        if wrong := sorted(stated.keys() ^ derived.keys()):
            return f"{place}[{wrong[0][:40]!r}]"
        each = (first_difference(stated[key], derived[key], f"{place}.{key}") for key in derived)
        return next((found for found in each if found is not None), None)
    if isinstance(stated, list) and isinstance(derived, list):
        if len(stated) != len(derived):
            return place
        pairs = zip(stated, derived, strict=True)
        return next((d for k, (a, b) in enumerate(pairs) if (d := first_difference(a, b, f"{place}[{k}]"))), None)
    if isinstance(stated, bool) or isinstance(derived, bool):
        return None if stated is derived else place
    if isinstance(stated, int | float) and isinstance(derived, int | float):
        return None if math.isclose(stated, derived, rel_tol=_ROUNDING, abs_tol=1e-300) else place
    return None if stated == derived else place


def read_most_change(entry: JsonObject) -> float:
    """The most that a controller's output changes from sample to sample; infinite without an entry.

    Raises:
        CertificateError: it is not greater than 0.
    """
    if "most_change" not in entry.value:
        return math.inf
    found = entry.number("most_change")
    if not found > 0.0:
        raise CertificateError(f"{entry.at('most_change')} must be greater than 0")
    return found
