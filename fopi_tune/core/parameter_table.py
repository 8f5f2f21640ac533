"""Tables of sampled plant parameters:  CSV text -> ParameterTable;  checks of sampled parameters against a family."""

from __future__ import annotations

import csv
import io
import math
from array import array
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from fopi_tune.core.bode_form import Array
from fopi_tune.core.families.plant_list import PlantList
from fopi_tune.core.plant import PlantFamily, Uncertain
from fopi_tune.core.text_tables.words import counted
from fopi_tune.errors import DomainError

Marks = NDArray[np.bool_]
#: characters of a name or a field that a message quotes
_MOST_QUOTED = 40


@dataclass(frozen=True, eq=False)
class ParameterTable:
    """Sampled parameters, a row a plant.

    Args:
        names: the columns' parameter names.
        rows: shape (m, len(names)), m >= 1, finite; a copy is kept.

    Raises:
        DomainError: no rows, the wrong shape, a value that is not finite, or a name that is empty or comes twice.
    """

    names: tuple[str, ...]
    rows: Array

    def __post_init__(self) -> None:
        rows = np.array(self.rows, dtype=float, order="F")
        if rows.ndim != 2 or rows.shape[1] != len(self.names) or rows.size == 0:
            raise DomainError(
                f"a table of {counted(len(self.names), 'name')} needs rows of as many numbers; got {rows.shape}"
            )
        if not np.isfinite(rows).all():
            raise DomainError(
                f"row {int(np.argmin(np.isfinite(rows).all(axis=1))) + 1} has a number that is not finite"
            )
        known: set[str] = set()
        for name in self.names:
            if not name or name in known:
                raise DomainError(f"column {_excerpt(name)} " + ("comes twice" if name else "has no name"))
            known.add(name)
        rows.flags.writeable = False
        object.__setattr__(self, "rows", rows)

    def columns(self, family: PlantFamily) -> list[int]:
        """Column indices of the family's uncertain numbers, in the family's order.

        Raises:
            DomainError: a column is missing, or is no uncertain number of the family.
        """
        wanted = family.uncertain_names
        if missing := [name for name in wanted if name not in self.names]:
            raise DomainError(_missing_column(missing[0], wanted))
        if unknown := [name for name in self.names if name not in wanted]:
            raise DomainError(not_uncertain(unknown[0], family))
        return [self.names.index(name) for name in wanted]


@dataclass(frozen=True)
class SamplesFile:
    """A file of plants that a spec names.

    Args:
        name: as the spec writes it.
        sha256: of its bytes.
        table: what it says; equal files have equal hashes.
    """

    name: str
    sha256: str
    table: ParameterTable = field(compare=False, repr=False)


def parse_table(text: str, known: Sequence[str], above: int = 0) -> ParameterTable:
    """A table from the text of a CSV file: a line of parameter names, then a line of numbers per plant.

    Args:
        text: the file's contents; nothing of it is quoted unless its first line has one of the known names, so that
            another file's contents are not shown.
        known: names of columns; at least one must be there.
        above: lines of the file above the text, by which the places in messages are told.

    Raises:
        DomainError: empty, not CSV, without any known column, a line with too few or too many fields, or a field that
            is no finite number; the message names the line.
    """
    reader = csv.reader(io.StringIO(text.removeprefix("\ufeff"), newline=""), strict=True)
    try:
        names = tuple(name.strip() for name in next(reader, ()))
        if any(names) and not set(names) & set(known):
            raise DomainError(_missing_column(known[0], known))
        # array of doubles: one Python object a number would be too large for long files
        values = array("d", (value for line in reader for value in _numbers(line, names, above + reader.line_num)))
    except csv.Error as error:
        raise DomainError(f"line {above + reader.line_num} is not CSV: {error}") from error
    if not values:
        raise DomainError("the table is empty; it needs a line of parameter names and at least one line of numbers")
    return ParameterTable(names, np.array(values).reshape(-1, len(names)))


def not_uncertain(name: str, family: PlantFamily) -> str:
    """The message for a name that is not one of a family's uncertain numbers."""
    if name in family.parameters:
        return f"{name!r} is exact in this family; give it a range or leave it out"
    known = ", ".join(family.uncertain_names) or "none: every number is exact"
    return f"{_excerpt(name)} is no number of this family; its uncertain numbers are {known}"


def outside_box(points: Array, family: PlantFamily) -> Marks:
    """Which points lie outside the family's box, shape (m,); a certificate does not cover them."""
    if isinstance(family, PlantList):
        return _by_member(points, family, outside_box)
    return np.any((points < family.low) | (points > family.high), axis=1)


def impossible(points: Array, family: PlantFamily) -> Marks:
    """Which points are no valid plants of the model (a zero time constant or gain, a negative delay), shape (m,)."""
    if isinstance(family, PlantList):
        return _by_member(points, family, impossible)
    refused = family.refused(points)
    for column, name in enumerate(family.uncertain_names):
        values = points[:, column]
        if not len(values) or family.problem(name, _hull(values.min(), values.max())) is None:
            continue
        order = np.argsort(values, kind="stable")
        ranked = values[order]
        # the model checks ranges: a range that it refuses is bisected until single values are left
        pending = [(0, len(ranked))]
        while pending:
            start, stop = pending.pop()
            low, high = ranked[start], ranked[stop - 1]
            if family.problem(name, _hull(low, high)) is None:
                continue
            if low == high:
                refused[order[start:stop]] = True
            else:
                middle = (start + stop) // 2
                pending += [(start, middle), (middle, stop)]
    return refused


def why_impossible(point: Array, family: PlantFamily) -> str | None:
    """Why one point, shape (p,), is no valid plant, or None."""
    if isinstance(family, PlantList):
        ((index, _, own),) = family.parts(point[None, :])
        return why_impossible(own[0], family.members[index].family)
    for name, value in zip(family.uncertain_names, point.tolist(), strict=True):
        if (wrong := family.problem(name, Uncertain.exactly(value))) is not None:
            return f"{name} = {value!r} {wrong}"
    return family.why_refused(point)


def _by_member(places: Array, family: PlantList, test: Callable[[Array, PlantFamily], Marks]) -> Marks:
    """A test of points of each member's box at places in a list, shape (m,)."""
    found = np.zeros(len(places), dtype=bool)
    for index, rows, own in family.parts(places):
        found[rows] = test(own, family.members[index].family)
    return found


def _hull(low: float, high: float) -> Uncertain:
    return Uncertain(float(low), float(low), float(high))


def _missing_column(name: str, wanted: Sequence[str]) -> str:
    return f"the table has no column {name!r}; it needs {', '.join(wanted)}"


def _excerpt(text: str) -> str:
    """What a table holds, on one short line."""
    return repr(text) if len(text) <= _MOST_QUOTED else f"{text[:_MOST_QUOTED]!r}…"


def _numbers(line: list[str], names: tuple[str, ...], number: int) -> Iterator[float]:
    if len(line) != len(names):
        raise DomainError(f"line {number} has {counted(len(line), 'field')}; its header has {len(names)}")
    for entry, name in zip(line, names, strict=True):
        yield _number(entry, name, number)


def _number(entry: str, name: str, line: int) -> float:
    try:
        value = float(entry)
    except ValueError:
        value = math.nan
    if "_" in entry or not entry.isascii() or not math.isfinite(value):
        raise DomainError(f"line {line}, column {_excerpt(name)}: {_excerpt(entry)} is not a finite number")
    return value
