"""Words of tables and messages that cost nothing to load:  units of times, and counted things."""

from __future__ import annotations

from enum import Enum


class TimeUnit(Enum):
    """Units of times in a recording."""

    SECONDS = "s"
    MILLISECONDS = "ms"
    MICROSECONDS = "us"
    NANOSECONDS = "ns"
    MINUTES = "min"
    HOURS = "h"
    DAYS = "d"

    @property
    def in_s(self) -> float:
        """The unit, in s."""
        return {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9, "min": 60.0, "h": 3600.0, "d": 86_400.0}[self.value]


def counted(number: int, word: str, words: str = "") -> str:
    """`1 sample`, `2 samples`; `words` is the plural where an s does not make it."""
    return f"{number} {agreeing(number, word, words or word + 's')}"


def agreeing(number: float, singular: str, plural: str) -> str:
    """The form of a word that goes with a number, such as of `is` and `are`."""
    return singular if number == 1 else plural
