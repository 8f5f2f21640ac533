"""Recordings of a plant's input and output:  the text of a CSV file, or arrays -> Recording."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fopi_tune.core.bode_form import Array
from fopi_tune.core.text_tables.table import (
    LARGEST,
    TIMES_HINT,
    Table,
    counted,
    is_missing,
    number,
    quoted,
    read_table,
)
from fopi_tune.errors import DomainError
from fopi_tune.identification.columns import Columns, ReadOptions, choose_columns
from fopi_tune.identification.times import in_seconds, over_midnight

#: samples; four numbers or more are fitted, and their intervals need degrees of freedom
MIN_SAMPLES = 10
#: lines that a note names
_MOST_NAMED = 8
#: what a column of a switch says
_SWITCH = {"on": "1", "off": "0", "true": "1", "false": "0"}
#: share of lines with the time of the line before from which times are taken to be too coarse
_COARSE_TIMES = 0.2

Marks = NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class Recording:
    """A plant's input and output in time.  The input is held from each sample to the next.

    Args:
        name: what messages call it, a file's name.
        time_s: shape (n,), strictly increasing.
        input: shape (n,), the plant's input in its unit.
        output: shape (n,), the plant's output in its unit; NaN where it is missing.
        used: shape (n,), which outputs are fitted; all that are not missing when left out.
        lines: shape (n,), each sample's line in the file, or its place from 0 when left out.
        notes: what was seen while reading, a sentence each.
        guess: which columns were taken, where the file does not say it.

    Raises:
        DomainError: shapes that differ, times that do not increase, or an input that is not finite.
    """

    name: str
    time_s: Array
    input: Array
    output: Array
    used: Marks = field(default_factory=lambda: np.ones(0, dtype=bool))
    lines: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    notes: tuple[str, ...] = ()
    guess: str = ""

    def __post_init__(self) -> None:
        n = len(self.time_s)
        used = self.used if len(self.used) else np.ones(n, dtype=bool)
        if not (len(self.input) == len(self.output) == len(used) == n):
            raise DomainError(f"{self.name}: times, input and output have different lengths")
        if not (np.isfinite(self.time_s).all() and np.isfinite(self.input).all()):
            raise DomainError(f"{self.name}: times and input must be finite numbers")
        if np.any(np.diff(self.time_s) <= 0):
            raise DomainError(f"{self.name}: times must increase")
        object.__setattr__(self, "used", used & np.isfinite(self.output))
        object.__setattr__(self, "lines", self.lines if len(self.lines) else np.arange(n))

    @property
    def from_file(self) -> bool:
        """Whether `lines` are lines of a file, which are counted from 1."""
        return bool(self.lines[0] > 0)

    def where(self, rows: NDArray[np.int64]) -> str:
        """The lines (or samples) of some rows, shape (k,), in words."""
        unit = "line" if self.from_file else "sample"
        shown = ", ".join(str(line) for line in self.lines[rows[:_MOST_NAMED]].tolist())
        more = f" and {len(rows) - _MOST_NAMED} more" if len(rows) > _MOST_NAMED else ""
        return f"{unit if len(rows) == 1 else unit + 's'} {shown}{more}"


def parse_recording(text: str, name: str, options: ReadOptions | None = None) -> Recording:
    """A recording from the text of a CSV file.

    Columns are separated by commas, semicolons, tabs or blanks; there may be a header or none, comments (#, %, //),
    blank lines, further columns, and a last line that is cut short.  Lines of equal times become one sample: the mean
    of their outputs, and the input of the last.  A line whose output is missing is left out of the fit.

    Args:
        text: the file's contents.
        name: what messages call it.
        options: columns, sample time, unit of the times and window; seen from the file where they are None.

    Raises:
        DomainError: no such file, times that descend, or too few samples; the message names the file, and the line.
    """
    try:
        options = options or ReadOptions()
        table = read_table(text)
        return _parse(table, choose_columns(table, options), options, name)
    except DomainError as error:
        raise DomainError(f"{name}: {error}") from None


def recording_from_arrays(
    time_s: Any, input: Any, output: Any, start_s: float | None = None, end_s: float | None = None, name: str = "data"
) -> Recording:
    """A recording from arrays, lists or columns of a data frame, of one length.

    Args:
        time_s: shape (n,), s, not descending; equal times become one sample.
        input: shape (n,), the plant's input in its unit; held from each sample to the next.
        output: shape (n,), the plant's output in its unit; NaN where it is missing.
        start_s: the fit is about the outputs from this time on, s.
        end_s: and until this time, s.
        name: what messages call it.

    Raises:
        DomainError: other shapes, times that descend, an input that is not finite, or too few samples.
    """
    try:
        arrays = [np.array(values, dtype=float) for values in (time_s, input, output)]
    except (TypeError, ValueError) as error:
        raise DomainError(f"{name}: times, input and output must be numbers ({error})") from None
    if any(values.ndim != 1 for values in arrays) or len({len(values) for values in arrays}) != 1:
        shapes = ", ".join(str(values.shape) for values in arrays)
        raise DomainError(f"{name}: times, input and output must be one-dimensional and of one length; got {shapes}")
    time, moved, found = arrays
    found[~(np.abs(found) < LARGEST)] = np.nan
    for values, what in ((time, "time_s"), (moved, "input")):
        wrong = np.flatnonzero(~(np.abs(values) < LARGEST))
        if wrong.size:
            raise DomainError(f"{name}: sample {wrong[0]}, {what}: {values[wrong[0]]} is not a finite number")
    try:
        return _finished(Recording(name, *_merged(time, moved, found, np.arange(len(time)), False)), start_s, end_s)
    except DomainError as error:
        raise DomainError(f"{name}: {str(error).removeprefix(name + ': ')}") from None


def _parse(table: Table, columns: Columns, options: ReadOptions, name: str) -> Recording:
    lines = np.array([line for line, _ in table.lines], dtype=np.int64)
    wanted = [columns.input, columns.output] + ([] if columns.time is None else [columns.time])
    texts = table.fields(wanted)
    moved = _numbers(table, _switched(texts[0]), _title(table, columns.input, "input"), lines)
    output = _numbers(table, texts[1], _title(table, columns.output, "output"), lines, may_be_missing=True)
    clock = ""
    if columns.time is not None:
        time = _numbers(table, texts[2], _title(table, columns.time, "time"), lines)
        if any(":" in text for text in texts[2][:3]):
            time, clock = over_midnight(time, lines)
        else:
            time = in_seconds(time, columns.unit)
    else:
        assert options.sample_time is not None
        if not options.sample_time > 0:
            raise DomainError(f"a sample time of {options.sample_time!r} is not greater than 0")
        time = in_seconds(np.arange(len(lines), dtype=float) * options.sample_time, columns.unit)
    time, moved, output, used, lines, merged = _merged(time, moved, output, lines, True)
    missing = np.flatnonzero(np.isnan(output))
    recording = Recording(name, time, moved, output, used, lines, guess=columns.guess)
    notes = [each for each in (columns.note, clock) if each]
    if table.cut is not None:
        notes.append(f"line {table.cut[0]}, the last, is cut short ({quoted(table.cut[1].strip())}): left out")
    notes += merged
    if missing.size:
        notes.append(f"{recording.where(missing)}: no output, left out")
    start, end = (None if each is None else each * columns.unit.in_s for each in (options.start, options.end))
    return _finished(dataclasses.replace(recording, notes=tuple(notes)), start, end)


def _switched(texts: list[str]) -> list[str]:
    """Texts of an input; that of a switch, `on` and `off` or `true` and `false`, becomes 1 and 0."""
    return [_SWITCH.get(text.lower(), text) for text in texts]


def _title(table: Table, column: int, role: str) -> str:
    name = table.names[column].lower() if table.names else ""
    return f"column {table.name_of(column)}" + ("" if name == role else f" ({role})")


def _numbers(
    table: Table, texts: list[str], title: str, lines: NDArray[np.int64], may_be_missing: bool = False
) -> Array:
    values = np.empty(len(texts))
    for row, text in enumerate(texts):
        value = number(text, table.separator)
        if value is None:
            if not (may_be_missing and is_missing(text)):
                hint = f"; {TIMES_HINT}" if ":" in text else ""
                if not may_be_missing and is_missing(text):
                    hint = "; write the value that it had then"
                raise DomainError(f"line {lines[row]}, {title}: {quoted(text)} is not a finite number{hint}")
            value = np.nan
        values[row] = value
    return values


def _merged(
    time: Array, moved: Array, output: Array, lines: NDArray[np.int64], from_file: bool
) -> tuple[Array, Array, Array, Marks, NDArray[np.int64], tuple[str, ...]]:
    """Samples of equal times as one, and the note about them."""
    unit = "line" if from_file else "sample"
    steps = np.diff(time)
    falls = np.flatnonzero(steps < 0)
    if falls.size:
        row = int(falls[0]) + 1
        raise DomainError(
            f"{unit} {lines[row]}: time {time[row]:g} s is before {time[row - 1]:g} s of {unit} {lines[row - 1]}"
            + (f", and {counted(len(falls) - 1, 'more time')}" if len(falls) > 1 else "")
            + "; sort by time, or keep one run of several"
        )
    equal = np.flatnonzero(steps == 0) + 1
    everything = np.ones(len(time), dtype=bool)
    if not equal.size:
        return time, moved, output, everything, lines, ()
    if equal.size == len(time) - 1:
        raise DomainError(f"every {unit} has the time {time[0]:g} s; name the column of times, or give a sample time")
    firsts = np.flatnonzero(np.concatenate([[True], steps > 0]))
    lasts = np.concatenate([firsts[1:], [len(time)]]) - 1
    known = np.isfinite(output)
    count = np.add.reduceat(known.astype(float), firsts)
    total = np.add.reduceat(np.where(known, output, 0.0), firsts)
    mean = np.where(count > 0, total / np.maximum(count, 1.0), np.nan)
    named = Recording("", np.arange(float(len(time))), moved, output, everything, lines).where(equal)
    note = f"{named}: the time of the {unit} before, merged with it"
    if equal.size > _COARSE_TIMES * len(time):
        mean_s = (time[-1] - time[0]) / (len(time) - 1)
        note += f"; the times are too coarse for their lines, {mean_s:.3g} s apart: give "
        note += "--sample-time" if from_file else "times with more digits"
    return time[firsts], moved[lasts], mean, everything[firsts], lines[firsts], (note,)


def _finished(recording: Recording, start_s: float | None, end_s: float | None) -> Recording:
    """The recording with only the outputs in a window used, and enough of them."""
    inside = recording.used.copy()
    time = recording.time_s
    if start_s is not None:
        inside &= time >= start_s - 1e-12 * abs(start_s)
    if end_s is not None:
        inside &= time <= end_s + 1e-12 * abs(end_s)
    found = int(np.count_nonzero(inside))
    if found < MIN_SAMPLES:
        where = ""
        if start_s is not None or end_s is not None:
            where = f" in the window; the record is from {time[0]:g} s to {time[-1]:g} s" if len(time) else ""
        raise DomainError(f"has {counted(found, 'sample')}{where}; a fit with intervals needs at least {MIN_SAMPLES}")
    # what comes after the window says nothing about it
    last = int(np.flatnonzero(inside)[-1]) + 1
    return dataclasses.replace(
        recording,
        time_s=time[:last],
        input=recording.input[:last],
        output=recording.output[:last],
        used=inside[:last],
        lines=recording.lines[:last],
    )
