"""Which columns of a table are time, input and output, and the unit of the times."""

from __future__ import annotations

import itertools
import re
from dataclasses import dataclass

from fopi_tune.core.text_tables.table import TIMES_HINT, Table, is_missing, number, quoted, time_of_day_s
from fopi_tune.core.text_tables.words import counted
from fopi_tune.errors import DomainError
from fopi_tune.identification.times import TimeUnit, unit_by_size, unit_called

#: the header that needs no explanation
COLUMNS = ("time_s", "input", "output")
_TIME = frozenset(
    (
        *("t", "time", "times", "timestamp", "tstamp", "elapsed", "date", "datetime", "clock"),
        *("seconds", "second", "secs", "sec", "ms", "millis", "micros"),
        *("zeit", "uhrzeit", "tiempo", "temps", "tempo", "tijd", "tid"),
    )
)
_INPUT = frozenset(("input", "u"))
#: PV, the process variable of a controller; names of its output differ, and that is the plant's input
_OUTPUT = frozenset(("output", "y", "pv"))
#: "Time (ticks)": a unit that is not known
_IN_BRACKETS = re.compile(r"[(\[]\s*([^()\[\]]+?)\s*[)\]]$")


@dataclass(frozen=True)
class ReadOptions:
    """What a user says of a recording's file.

    Args:
        time: name of the column of times, or its number from 1; seen from the header when None.
        input: the same of the plant's input.
        output: the same of its output.
        sample_time: time from each line to the next, in the unit `time_unit`, where the file has no times.
        time_unit: of the times, of `sample_time`, `start` and `end`; seen from the header when None, else s.
        start: the fit is about the outputs from this time on, in the unit `time_unit`.
        end: and until this time, in the unit `time_unit`.
    """

    time: str | None = None
    input: str | None = None
    output: str | None = None
    sample_time: float | None = None
    time_unit: TimeUnit | None = None
    start: float | None = None
    end: float | None = None


@dataclass(frozen=True)
class Columns:
    """The columns, counted from 0, and the unit of the times.

    Args:
        time: of the times, or None with a given sample time.
        input: of the plant's input.
        output: of its output.
        unit: of the times.
        guess: what was chosen, where the file's header did not say it; or empty.
        unit_note: where the unit was seen from, or empty.
    """

    time: int | None
    input: int
    output: int
    unit: TimeUnit
    guess: str
    unit_note: str

    @property
    def note(self) -> str:
        """Both in one sentence, or empty."""
        return "; ".join(each for each in (self.guess, self.unit_note) if each)


def choose_columns(table: Table, options: ReadOptions) -> Columns:
    """The columns of time, input and output.

    What the options name is taken.  Then names of time, input and output are known; two columns that are left are
    input and output in this order, and a file without names has the columns time, input, output.

    Raises:
        DomainError: there is no such column, or the file does not tell which; the message lists what it has.
    """
    if options.time is not None and options.sample_time is not None:
        raise DomainError("both a column of times and a sample time are given; leave one of them out")
    given = {
        role: None if word is None else _column_called(table, word, role)
        for role, word in (("time", options.time), ("input", options.input), ("output", options.output))
    }
    taken = [column for column in given.values() if column is not None]
    if len(set(taken)) < len(taken):
        raise DomainError(f"one column is named for two of time, input and output; {_listed(table)}")
    time, was_sure = _time_column(table, given, options.sample_time is not None)
    unnamed_time = time if options.sample_time is None else None
    left = [k for k in range(table.width) if k != time and k not in taken]
    chosen = {role: given[role] for role in ("input", "output")}
    for role, words in (("input", _INPUT), ("output", _OUTPUT)):
        known = [k for k in left if _first_word(table, k) in words]
        if chosen[role] is None and len(known) == 1:
            chosen[role] = known[0]
            left.remove(known[0])
    missing = [role for role in ("input", "output") if chosen[role] is None]
    if missing:
        was_sure = False
        if len(left) > len(missing):
            left = [k for k in left if _is_number_column(table, k)]
        if len(left) != len(missing):
            flags = " and ".join(f"--{role}" for role in missing)
            raise DomainError(f"{_listed(table)}: say which with {flags}, by name or number")
        chosen.update(zip(missing, left, strict=True))
    assert chosen["input"] is not None
    assert chosen["output"] is not None
    unit, unit_note = _unit(table, unnamed_time, options.time_unit)
    guess = "" if was_sure or None not in given.values() else _chosen_words(table, unnamed_time, chosen)
    return Columns(unnamed_time, chosen["input"], chosen["output"], unit, guess, unit_note)


def _column_called(table: Table, word: str, role: str) -> int:
    """The column of a name, of the only name that holds it, or of a number from 1."""
    wanted = word.strip().lower()
    names = [name.lower() for name in table.names]
    for found in (
        [k for k, name in enumerate(names) if name == wanted],
        [int(wanted) - 1] if wanted.isascii() and wanted.isdigit() and 1 <= int(wanted) <= table.width else [],
        [k for k, name in enumerate(names) if wanted and wanted in name],
    ):
        if len(found) == 1:
            return found[0]
        if len(found) > 1:
            raise DomainError(f"--{role} {quoted(word)} is in {len(found)} names; {_listed(table)}")
    raise DomainError(f"there is no column {quoted(word)}, which --{role} names; {_listed(table)}")


def _listed(table: Table) -> str:
    if not table.names:
        line, text = table.lines[0]
        return f"line {line} has {counted(table.width, 'column')} without names, {quoted(text.strip())}"
    assert table.header is not None
    names = ", ".join(f"{k} {table.name_of(k - 1)}" for k in range(1, min(table.width, 20) + 1))
    return f"line {table.header[0]} has {counted(table.width, 'column')}, {names}{', …' if table.width > 20 else ''}"


def _first_word(table: Table, column: int) -> str:
    found = re.match(r"[^\W\d_]+", table.names[column].lower()) if table.names else None
    return found.group() if found else ""


def _time_column(table: Table, given: dict[str, int | None], has_sample_time: bool) -> tuple[int | None, bool]:
    """The column of times, and whether its name says that it is one; with a sample time it is left out."""
    if given["time"] is not None:
        return given["time"], True
    free = [k for k in range(table.width) if k not in given.values()]
    named = [k for k in free if _first_word(table, k) in _TIME]
    if named:
        # "Time (sec)" before "Date", where both are there
        return min(named, key=lambda k: (_first_word(table, k) in ("date", "datetime"), k)), True
    clocks = [k for k in free if time_of_day_s(table.fields([k])[0][0]) is not None]
    if clocks:
        return clocks[0], False
    if has_sample_time:
        return None, True
    wanted = sum(given[role] is None for role in ("input", "output"))
    if len(free) > wanted and free[0] == 0 and _never_falls(table, 0):
        return 0, False
    flags = "--sample-time with the time between two lines" if table.width == 2 else "--time or --sample-time"
    first = [(k, table.fields([k])[0][0]) for k in free]
    dates = [f"{quoted(text)} of column {k + 1} is no time: {TIMES_HINT}, or " for k, text in first if ":" in text]
    raise DomainError(f"{_listed(table)}, and no times: {''.join(dates[:1])}give {flags}")


def _is_number_column(table: Table, column: int) -> bool:
    texts = table.fields([column])[0][:50]
    return all(number(text, table.separator) is not None or is_missing(text) for text in texts)


def _never_falls(table: Table, column: int) -> bool:
    values = [number(text, table.separator) for text in table.fields([column])[0][:1000]]
    known = [value for value in values if value is not None]
    return len(known) > 1 and known[0] < known[-1] and all(a <= b for a, b in itertools.pairwise(known))


def _unit(table: Table, time: int | None, given: TimeUnit | None) -> tuple[TimeUnit, str]:
    """The unit of the times, and a note where it is not s, or the name of a unit that is not known."""
    if given is not None:
        return given, ""
    if time is None:
        return TimeUnit.SECONDS, ""
    words = (*table.names[time : time + 1], *table.units[time : time + 1])
    for text in words:
        unit = unit_called(text)
        if unit is TimeUnit.SECONDS:
            return unit, ""
        if unit is not None:
            return unit, f"times are in {unit.value}, as {quoted(text)} says"
    first = table.fields([time])[0][0]
    if ":" in first:
        return TimeUnit.SECONDS, ""
    unit = unit_by_size(number(first, table.separator))
    if unit is not None:
        return unit, f"times are in {unit.value} since 1970, by their size"
    unknown = [text for text in words if _IN_BRACKETS.search(text)]
    note = f"the unit in {quoted(unknown[0])} is not known: s is taken, or give --time-unit" if unknown else ""
    return TimeUnit.SECONDS, note


def _chosen_words(table: Table, time: int | None, chosen: dict[str, int | None]) -> str:
    roles = {"time": time, **chosen}
    words = (
        f"{role} is column {k + 1}{' ' + table.name_of(k) if table.names else ''}"
        for role, k in roles.items()
        if k is not None
    )
    return ", ".join(words)
