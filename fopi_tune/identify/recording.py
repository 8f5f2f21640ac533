"""A recorded step response:  the text of a CSV file -> Recording, with the single step of its input located."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fopi_tune.core.bode_form import Array
from fopi_tune.core.parameter_table import parse_table
from fopi_tune.errors import DomainError

COLUMNS = ("time_s", "input", "output")
#: of columns; with the last two, numbers may have decimal commas
_SEPARATORS = (",", ";", "\t")
#: of a recording's file
MAX_BYTES = 32 * 1024 * 1024
#: rows of the file; four numbers are fitted, and their intervals need degrees of freedom
MIN_SAMPLES = 10
#: allowed deviation of the input from its step, relative to the step; some inputs are measured
_INPUT_NOISE = 0.02


@dataclass(frozen=True, eq=False)
class Recording:
    """A step response.

    Args:
        name: what messages call it, a file's name.
        time_s: shape (n,), strictly increasing.
        output: shape (n,), the plant's output in its unit.
        first: the first row with the new input, >= 1; the step came between the row before and this one.
        step: height of the input's step, in its unit; not 0.
    """

    name: str
    time_s: Array
    output: Array
    first: int
    step: float

    @property
    def step_at_s(self) -> float:
        """Latest possible time of the step."""
        return float(self.time_s[self.first])

    @property
    def gap_s(self) -> float:
        """Time between the last sample with the old input and the first with the new one; the step came in it."""
        return float(self.time_s[self.first] - self.time_s[self.first - 1])


def parse_recording(text: str, name: str) -> Recording:
    """A recording from the text of a CSV file: the line `time_s,input,output` (in any order), then a line a sample.

    Columns may also be separated by semicolons or tabs; numbers may then have decimal commas.

    Args:
        text: the file's contents.
        name: what messages call it.

    Raises:
        DomainError: not such a file, times that do not increase, too few samples, or an input that is no single step;
            the message names the file, and the line where there is one.
    """
    try:
        return _parse(text, name)
    except DomainError as error:
        raise DomainError(f"{name}: {error}") from None


def _parse(text: str, name: str) -> Recording:
    if len(text) > MAX_BYTES:
        raise DomainError(f"is larger than {MAX_BYTES // 2**20} MiB; keep fewer samples or digits")
    first_line, _, lines = text.removeprefix("\ufeff").rstrip().partition("\n")
    names, separator = _header(first_line)
    if not lines:
        raise DomainError(f"has a header and no samples; write at least {MIN_SAMPLES} lines of numbers")
    if separator != ",":
        # in such files the comma is the decimal mark
        lines = lines.replace(",", ".").replace(separator, ",")
    table = parse_table(",".join(names) + "\n" + lines, COLUMNS)
    time_s, inputs, output = (table.rows[:, table.names.index(column)].copy() for column in COLUMNS)
    not_increasing = np.flatnonzero(np.diff(time_s) <= 0)
    if not_increasing.size:
        row = int(not_increasing[0]) + 1
        raise DomainError(f"line {row + 2}: time_s = {time_s[row]:g} is not after {time_s[row - 1]:g}; sort by time")
    if len(time_s) < MIN_SAMPLES:
        raise DomainError(f"has {pluralized(len(time_s), 'sample')}; a fit with intervals needs at least {MIN_SAMPLES}")
    first, step = _find_step(inputs)
    return Recording(name, time_s, output, first, step)


def _header(line: str) -> tuple[list[str], str]:
    """The columns' names, in small letters, and what separates them."""
    is_recording = False
    for separator in _SEPARATORS:
        names = [column.strip().strip('"').strip().lower() for column in line.split(separator)]
        if sorted(names) == sorted(COLUMNS):
            return names, separator
        is_recording |= not set(COLUMNS).isdisjoint(names)
    # another file's contents are not shown
    found = f"is {line.strip()[:60]!r}" if is_recording else "has none of the columns"
    raise DomainError(
        f"line 1 {found}; write the header {','.join(COLUMNS)}, a name for each column, separated by "
        "commas, semicolons or tabs"
    )


def pluralized(number: int, word: str) -> str:
    """`1 sample`, `2 samples`."""
    return f"{number} {word}" if number == 1 else f"{number} {word}s"


def _find_step(inputs: Array) -> tuple[int, float]:
    """The first row with the new input, and the height of the step."""
    reach = float(np.ptp(inputs))
    if reach == 0.0:
        raise DomainError(
            f"column 'input': there is no step, it is {inputs[0]:g} on every line; record from before the step on"
        )
    first = int(np.argmax(np.abs(np.diff(inputs)))) + 1
    before, after = float(np.median(inputs[:first])), float(np.median(inputs[first:]))
    level = np.where(np.arange(len(inputs)) < first, before, after)
    outliers = np.flatnonzero(np.abs(inputs - level) > _INPUT_NOISE * abs(after - before))
    if outliers.size:
        row = int(outliers[0])
        raise DomainError(
            f"line {row + 2}, column 'input': {inputs[row]:g} is not one step, which goes from {before:g} to {after:g} "
            f"on line {first + 2}; keep the lines around one step"
        )
    return first, after - before
