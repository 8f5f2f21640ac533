"""The text of a file of measurements -> its columns:  separator, decimal mark, comments and header are seen from it.

A line of numbers has the fields of most lines and at least two numbers among them.  Nothing of a file is quoted unless
most of its lines are lines of numbers, so that the contents of another file are not shown.
"""

from __future__ import annotations

import csv
import datetime
import re
from collections import Counter
from dataclasses import dataclass

from fopi_tune.core.text_tables.words import counted
from fopi_tune.errors import DomainError

#: of a file of measurements
MAX_BYTES = 32 * 1024 * 1024
#: tried in this order; the last stands for any number of blanks.  Only beside a comma, the comma is no decimal mark
_SEPARATORS = (";", "\t", ",", " ")
_COMMENTS = ("#", "%", "//")
#: lines that are looked at for the separator
_MOST_LINES_LOOKED_AT = 200
#: characters of a line or field that a message quotes
_MOST_QUOTED = 60
#: larger numbers are no measurements, and their squares no doubles
LARGEST = 1e100
#: of a field that is a number; patterns of what is longer may take for ever
_MOST_CHARACTERS = 100
_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eEdD][+-]?\d+)?$", re.ASCII)
#: h:mm:ss with fractions of a second
_CLOCK = re.compile(r"(\d{1,3}):(\d\d)(?::(\d\d(?:\.\d*)?))?$", re.ASCII)
#: dd.mm.yyyy and a time
_DAY_FIRST = re.compile(r"(\d{1,2})\.(\d{1,2})\.(\d{4})[ T]+(\S+)$", re.ASCII)
_MISSING = frozenset(("", "nan", "-nan", "na", "n/a", "#n/a", "null", "none", "-", "--"))
#: what to write for times that are not understood: of 03/01/2024, day and month are not known
TIMES_HINT = "write times as 2024-03-01 08:00:00, 08:00:00 or seconds"


@dataclass(frozen=True)
class Wanted:
    """What a file is to hold, for messages.

    Args:
        header: a line with the names of its columns.
        a_line: what each line is, as in "a sample".
        two_columns: why one column is not enough.
        quotes: whether messages quote lines of the file.
    """

    header: str
    a_line: str
    two_columns: str
    quotes: bool = True


RECORDING = Wanted("time_s,input,output", "a sample", "a plant is fitted to two columns, its input and its output")


@dataclass(frozen=True)
class Table:
    """Lines of numbers, not yet converted.

    Args:
        names: the columns' names; empty where no line of the file names each column.
        units: what a line below the names says of each column, or empty.
        lines: (number of the line in the file from 1, its text).
        separator: between fields.
        width: fields a line.
        header: (number, text) of the line with the names, for messages, or None.
        cut: (number, text) of a last line that is cut short, or None.
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    lines: tuple[tuple[int, str], ...]
    separator: str
    width: int
    header: tuple[int, str] | None
    cut: tuple[int, str] | None

    def name_of(self, column: int) -> str:
        """A column's name in quotes, or its number from 1; `column` counts from 0."""
        return repr(self.names[column][:_MOST_QUOTED]) if self.names else f"{column + 1}"

    def fields(self, columns: list[int]) -> list[list[str]]:
        """The texts of some columns, counted from 0: a list of fields for each column."""
        rows = [split(text, self.separator, self.width) for _, text in self.lines]
        return [[row[column] for row in rows] for column in columns]


def read_table(text: str, wanted: Wanted = RECORDING) -> Table:
    """The lines of numbers of a file, and what its columns are called.

    Blank lines and lines that begin with #, % or // are left out.  Fields are separated by semicolons, tabs, commas or
    blanks; except between commas, numbers may have a decimal comma.

    Args:
        text: the file's contents.
        wanted: what it is to hold.

    Raises:
        DomainError: too large, or no lines of numbers, or one line among them that is none; the message names it.
    """
    if len(text) > MAX_BYTES:
        raise DomainError(f"is larger than {MAX_BYTES // 2**20} MiB; keep fewer lines or digits")
    numbered = list(enumerate(text.removeprefix("\ufeff").splitlines(), 1))
    comments = [(n, line.strip()) for n, line in numbered if line.lstrip().startswith(_COMMENTS)]
    lines = [(n, line) for n, line in numbered if line.strip() and not line.lstrip().startswith(_COMMENTS)]
    separator, width = _separator(lines)
    if lines and 2 * sum(number(line.strip(), ",") is not None for _, line in lines) > len(lines):
        raise DomainError(f"its lines have one number each; {wanted.two_columns}")
    first = next((k for k, (_, line) in enumerate(lines) if is_row(line, separator, width)), len(lines))
    rows, cut = _rows(lines[first:], separator, width, wanted)
    looked_at = rows[:: max(1, len(rows) // _MOST_LINES_LOOKED_AT)]
    numbers = sum(is_row(line, separator, width) for _, line in looked_at) / len(looked_at)
    if 2 * numbers * len(rows) < len(lines):
        raise DomainError(
            f"most of its lines are no lines of numbers; write the header {wanted.header}, then a line "
            f"{wanted.a_line}, columns separated by commas, semicolons, tabs or blanks"
        )
    names, units, header = _names(lines[:first], comments, rows[0][0], separator, width)
    return Table(names, units, tuple(rows), separator, width, header, cut)


def _separator(lines: list[tuple[int, str]]) -> tuple[str, int]:
    """The separator that makes most fields numbers, and the number of fields of most lines."""
    step = max(1, len(lines) // _MOST_LINES_LOOKED_AT)
    sample = [line for _, line in lines[::step]]
    best = (0.0, ",", 3)
    for separator in _SEPARATORS:
        split_lines = [split(line, separator) for line in sample]
        shares = [(len(fields), _share_of_numbers(fields, separator)) for fields in split_lines]
        width = Counter(size for size, share in shares if share > 0).most_common(1)
        if width:
            score = sum(share for size, share in shares if size == width[0][0])
            # semicolons and tabs come first: a decimal comma splits numbers into numbers
            if score > best[0] * (1 + 1e-9):
                best = (score, separator, width[0][0])
    return best[1], best[2]


def _share_of_numbers(fields: list[str], separator: str) -> float:
    count = sum(number(field, separator) is not None for field in fields)
    return count / len(fields) if count >= 2 else 0.0


def is_row(line: str, separator: str, width: int) -> bool:
    """Whether a line has as many fields as most and at least two numbers among them."""
    fields = split(line, separator, width)
    return len(fields) == width and _share_of_numbers(fields, separator) > 0


def split(line: str, separator: str, width: int | None = None) -> list[str]:
    """A line's fields without blanks and quotation marks; one separator more at its end than `width` fields need."""
    if separator == " ":
        return line.replace('"', " ").split()
    if '"' in line:
        fields = next(csv.reader([line], delimiter=separator, skipinitialspace=True), [])
    else:
        fields = line.split(separator)
    fields = [field.strip() for field in fields]
    return fields[:-1] if width is not None and len(fields) == width + 1 and not fields[-1] else fields


def number(field: str, separator: str) -> float | None:
    """A finite number (below 1e100) or a time of the day in seconds, or None."""
    if len(field) > _MOST_CHARACTERS:
        return None
    text = (field if separator == "," else field.replace(",", ".")).replace("\u2212", "-")
    if _NUMBER.match(text):
        value = float(text.replace("d", "e").replace("D", "e"))
        return value if abs(value) < LARGEST else None
    return time_of_day_s(text)


def time_of_day_s(text: str) -> float | None:
    """Seconds of h:mm, h:mm:ss, or an ISO date or dd.mm.yyyy with a time; or None."""
    if ":" not in text:
        return None
    clock = _CLOCK.match(text)
    if clock:
        return 3600.0 * int(clock[1]) + 60.0 * int(clock[2]) + float(clock[3] or 0)
    dotted = _DAY_FIRST.match(text)
    if dotted:
        hour, _, rest = dotted[4].partition(":")
        text = f"{dotted[3]}-{dotted[2]:0>2}-{dotted[1]:0>2} {hour:0>2}:{rest}"
    try:
        moment = datetime.datetime.fromisoformat(text.replace("/", "-"))
    except ValueError:
        return None
    return (moment.replace(tzinfo=moment.tzinfo or datetime.UTC)).timestamp()


def is_missing(field: str) -> bool:
    """Whether a field says that there is no value."""
    return field.lower() in _MISSING


def quoted(text: str) -> str:
    """A line or a field, short, for a message."""
    return repr(text) if len(text) <= _MOST_QUOTED else f"{text[:_MOST_QUOTED]!r}…"


# -- rows and names ----------------------------------------------------------------------------------------------------


def _rows(
    lines: list[tuple[int, str]], separator: str, width: int, wanted: Wanted
) -> tuple[list[tuple[int, str]], tuple[int, str] | None]:
    """The lines of numbers, and a last one that is cut short."""
    if not lines:
        raise DomainError(
            f"has no lines of numbers; write the header {wanted.header}, then a line {wanted.a_line}, columns "
            "separated by commas, semicolons, tabs or blanks"
        )
    wrong = [(n, line) for n, line in lines if len(split(line, separator, width)) != width]
    if not wrong:
        return lines, None
    n, line = wrong[0]
    if n == lines[-1][0] and len(lines) > 1 and len(split(line, separator, width)) < width:
        return lines[:-1], (n, line)
    if 2 * len(wrong) > len(lines):
        raise DomainError(
            f"its lines have different numbers of fields; write a line {wanted.a_line}, of as many fields each"
        )
    found = split(line, separator, width)
    what = f", {quoted(line.strip())}" if wanted.quotes else ""
    raise DomainError(f"line {n} has {counted(len(found), 'field')}{what}; the others have {width}")


def _names(
    before: list[tuple[int, str]], comments: list[tuple[int, str]], first_row: int, separator: str, width: int
) -> tuple[tuple[str, ...], tuple[str, ...], tuple[int, str] | None]:
    """The names of the columns, the units below them, and the line of the names."""
    block: list[tuple[tuple[int, str], list[str]]] = []
    for n, line in reversed(before):
        names = _fields_of_header(line, separator, width)
        if names is None:
            break
        block.insert(0, ((n, line), names))
    if block:
        # the names, and perhaps their units in the line below
        where, names = block[0]
        return tuple(names), tuple(block[1][1]) if len(block) > 1 else (), where
    for n, comment in reversed([each for each in comments if each[0] < first_row]):
        line = comment.lstrip("#%/ \t")
        names = _fields_of_header(line, separator, width)
        if names is not None:
            return tuple(names), (), (n, line)
    return (), (), None


def _fields_of_header(line: str, separator: str, width: int) -> list[str] | None:
    for each in (separator, *_SEPARATORS):
        names = split(line, each, width)
        if len(names) == width and any(names):
            return names
    return None
