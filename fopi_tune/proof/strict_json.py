"""Strict reading of the JSON of certificates and results:  types are checked, and every error names the entry."""

from __future__ import annotations

import math
from enum import StrEnum
from typing import Any, TypeVar

from fopi_tune.errors import CertificateError

#: beyond this a double would not hold it
_LARGEST_INTEGER = 2**1000
Word = TypeVar("Word", bound=StrEnum)


class JsonObject:
    """One object of the document.

    Args:
        value: the parsed JSON.
        place: its path in the document, for error messages.
    """

    def __init__(self, value: object, place: str) -> None:
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

    def _list(self, key: str) -> list[Any]:
        found = self.get(key)
        if not isinstance(found, list):
            raise CertificateError(f"{self.at(key)} is no list")
        return found
