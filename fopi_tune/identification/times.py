"""Times of a recording in seconds:  units by their names or by the size of the times, clocks that pass midnight."""

from __future__ import annotations

import re

import numpy as np
from numpy.typing import NDArray

from fopi_tune.core.bode_form import Array
from fopi_tune.core.text_tables.words import TimeUnit

_DAY_S = 86_400.0
_UNIT_AT_END = re.compile(r"(?:^|[_(\[/,\s])([a-zµμ]+)[)\]]?$")


_UNITS = {
    **dict.fromkeys(("s", "sec", "secs", "second", "seconds"), TimeUnit.SECONDS),
    **dict.fromkeys(("ms", "msec", "millis", "milliseconds", "millisecond"), TimeUnit.MILLISECONDS),
    **dict.fromkeys(("us", "µs", "μs", "micros", "microseconds"), TimeUnit.MICROSECONDS),
    **dict.fromkeys(("ns", "nsec", "nanos", "nanoseconds"), TimeUnit.NANOSECONDS),
    **dict.fromkeys(("min", "mins", "minute", "minutes"), TimeUnit.MINUTES),
    **dict.fromkeys(("h", "hr", "hrs", "hour", "hours"), TimeUnit.HOURS),
    **dict.fromkeys(("d", "day", "days"), TimeUnit.DAYS),
}
#: times since 1970 between 1990 and 2100, in s
_EPOCH_S = (6.3e8, 4.1e9)


def unit_called(text: str) -> TimeUnit | None:
    """The unit at the end of a column's name, as in `t_ms`, `Time (sec)` or `min`; or None."""
    found = _UNIT_AT_END.search(text.lower().rstrip(". "))
    return _UNITS.get(found.group(1)) if found else None


def unit_by_size(first: float | None) -> TimeUnit | None:
    """The unit below s in which a first time is one since 1970; None where it need not be one."""
    for unit in (TimeUnit.MILLISECONDS, TimeUnit.MICROSECONDS, TimeUnit.NANOSECONDS):
        if first is not None and _EPOCH_S[0] <= first * unit.in_s <= _EPOCH_S[1]:
            return unit
    return None


def in_seconds(time: Array, unit: TimeUnit) -> Array:
    """Times in s: division by 1000 rounds once where multiplication by 0.001 would twice."""
    return time / round(1 / unit.in_s) if unit.in_s < 1 else time * unit.in_s


def over_midnight(time_s: Array, lines: NDArray[np.int64]) -> tuple[Array, str]:
    """Clock times, shape (n,), in s, with a day more after each midnight, and a note that names the lines."""
    falls = np.diff(time_s) < -0.5 * _DAY_S
    if not falls.any() or time_s.min() < 0 or time_s.max() >= _DAY_S:
        return time_s, ""
    days = np.concatenate([[0.0], np.cumsum(falls)])
    where = ", ".join(str(line) for line in lines[1:][falls].tolist()[:3])
    return time_s + _DAY_S * days, f"the clock passes midnight at line {where}: a day is added"
