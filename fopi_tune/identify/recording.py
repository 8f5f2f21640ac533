"""A recorded step response:  the text of a CSV file -> Recording, with the one step of its input found."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fopi_tune.core.logform import Array
from fopi_tune.core.samples import parse_table
from fopi_tune.errors import DomainError

COLUMNS = ("time_s", "input", "output")
#: of columns; beside the last two numbers may have decimal commas
_SEPARATORS = (",", ";", "\t")
MAX_CHARACTERS = 32 * 1024 * 1024
#: rows of the file; four numbers are fitted, and their spread needs some more
MIN_SAMPLES = 10
#: what the input may move besides its step, relative to the step: it is measured on some plants
_INPUT_NOISE = 0.02


@dataclass(frozen=True, eq=False)
class Recording:
    """A step response.

    Args:
        name: what messages call it, a file's name.
        time_s: shape (n,), strictly increasing.
        output: shape (n,), the plant's output in its unit.
        first: the row from which the input is the new one, >= 1; the step came between the time before and its.
        step: how far the input moved, in its unit; not 0.
    """

    name: str
    time_s: Array
    output: Array
    first: int
    step: float

    @property
    def step_at_s(self) -> float:
        """When the input had moved at the latest."""
        return float(self.time_s[self.first])

    @property
    def gap_s(self) -> float:
        """From the last sample of the old input to the first of the new one: the step came somewhere between."""
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
    if len(text) > MAX_CHARACTERS:
        raise DomainError(f"is larger than {MAX_CHARACTERS // 2**20} MiB; keep fewer samples or digits")
    first_line, _, lines = text.removeprefix("\ufeff").rstrip().partition("\n")
    names, separator = _header(first_line)
    if not lines:
        raise DomainError(f"has a header and no samples; write at least {MIN_SAMPLES} lines of numbers")
    if separator != ",":
        # such files leave the comma to the decimals
        lines = lines.replace(",", ".").replace(separator, ",")
    table = parse_table(",".join(names) + "\n" + lines)
    time_s, moved, output = (table.rows[:, table.names.index(column)].copy() for column in COLUMNS)
    late = np.flatnonzero(np.diff(time_s) <= 0)
    if late.size:
        row = int(late[0]) + 1
        raise DomainError(f"line {row + 2}: time_s = {time_s[row]:g} is not after {time_s[row - 1]:g}; sort by time")
    if len(time_s) < MIN_SAMPLES:
        raise DomainError(f"has {pluralized(len(time_s), 'sample')}; a fit with intervals needs at least {MIN_SAMPLES}")
    first, step = _find_step(moved)
    return Recording(name, time_s, output, first, step)


def _header(line: str) -> tuple[list[str], str]:
    """The columns' names, in small letters, and what separates them."""
    for separator in _SEPARATORS:
        names = [column.strip().strip('"').strip().lower() for column in line.split(separator)]
        if sorted(names) == sorted(COLUMNS):
            return names, separator
    raise DomainError(
        f"line 1 is {line.strip()[:60]!r}; write the header {','.join(COLUMNS)}, a name for each column, separated by "
        "commas, semicolons or tabs"
    )


def pluralized(number: int, word: str) -> str:
    """`1 sample`, `2 samples`."""
    return f"{number} {word}" if number == 1 else f"{number} {word}s"


def _find_step(moved: Array) -> tuple[int, float]:
    """The row of the new input, and how far it moved."""
    reach = float(np.ptp(moved))
    if reach == 0.0:
        raise DomainError(
            f"column 'input': there is no step, it is {moved[0]:g} on every line; record from before the step on"
        )
    first = int(np.argmax(np.abs(np.diff(moved)))) + 1
    before, after = float(np.median(moved[:first])), float(np.median(moved[first:]))
    level = np.where(np.arange(len(moved)) < first, before, after)
    off = np.flatnonzero(np.abs(moved - level) > _INPUT_NOISE * abs(after - before))
    if off.size:
        row = int(off[0])
        raise DomainError(
            f"line {row + 2}, column 'input': {moved[row]:g} is not one step, which goes from {before:g} to {after:g} "
            f"on line {first + 2}; keep the lines around one step"
        )
    return first, after - before
