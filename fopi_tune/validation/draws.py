"""Plants drawn from a family:  Draw, PlantFamily, indices -> points of the box, shape (count, p).

Draw i depends on the seed and i alone: chunks, threads and workers change no bit.  A place in the unit cube
(`designs`) becomes values by the inverse distribution functions (`distributions`), or by a table of samples, whose row
floor(u rows) it picks; a Latin hypercube of as many draws as rows takes every row once.
Draws may lie outside the family's box, where nothing was proven (`outside_box`), and be no plant at all (`impossible`).
"""

from __future__ import annotations

import csv
import io
import math
import operator
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from fopi_tune.core.plant import PLANT_MODELS, PlantFamily, Uncertain
from fopi_tune.errors import DomainError
from fopi_tune.validation.designs import Design, cube
from fopi_tune.validation.distributions import Distribution, Uniform

Array = NDArray[np.float64]
Marks = NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class Table:
    """Samples of plants.

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
            raise DomainError(f"a table of {len(self.names)} names needs rows of as many numbers; got {rows.shape}")
        if not np.isfinite(rows).all():
            raise DomainError(
                f"row {int(np.argmin(np.isfinite(rows).all(axis=1))) + 1} has a number that is not finite"
            )
        for name in self.names:
            if not name or self.names.count(name) > 1:
                raise DomainError(f"column {name!r} " + ("comes twice" if name else "has no name"))
        rows.flags.writeable = False
        object.__setattr__(self, "rows", rows)


@dataclass(frozen=True)
class Draw:
    """What to draw.

    Args:
        seed: in [0, 2^64).
        design: how the draws lie.
        total: number of draws of the whole design; None where the design does not need to know.
        source: a distribution by parameter name (`Uniform` for those left out), or a table of samples.

    Raises:
        DomainError: the seed or the total is no whole number or out of range, or a Latin hypercube has no total.
    """

    seed: int
    design: Design = Design.RANDOM
    total: int | None = None
    source: Mapping[str, Distribution] | Table = field(default_factory=dict)

    def __post_init__(self) -> None:
        object.__setattr__(self, "seed", _whole("seed", self.seed))
        if self.total is not None:
            object.__setattr__(self, "total", _whole("total", self.total))
        cube(self.design, self.seed, 0, 0, 0, self.total)


def points(draw: Draw, family: PlantFamily, first: int, count: int) -> Array:
    """Draws first .. first + count - 1.

    Args:
        draw: what to draw.
        family: its box and nominal values.
        first: index of the first draw, from 0.
        count: how many; the memory needed is proportional.

    Returns:
        Shape (count, p), columns as `family.uncertain_names`.

    Raises:
        DomainError: the range of indices is not the design's, or the source does not fit the family.
    """
    names = family.uncertain_names
    first, count = _whole("first", first), _whole("count", count)
    if isinstance(draw.source, Table):
        columns = _columns(draw.source, family)
        u = cube(draw.design, draw.seed, 1, first, count, draw.total)[:, 0]
        # u < 1, but u m may round up to m
        rows = np.minimum((u * len(draw.source.rows)).astype(np.int64), len(draw.source.rows) - 1)
        return draw.source.rows[rows][:, columns]
    if unknown := sorted(set(draw.source) - set(names)):
        raise DomainError(_unknown(unknown[0], family))
    places = cube(draw.design, draw.seed, len(names), first, count, draw.total)
    for column, name in enumerate(names):
        u = np.ascontiguousarray(places[:, column])
        places[:, column] = draw.source.get(name, Uniform()).values(u, family.parameters[name])
    return places


def stays_inside(draw: Draw, family: PlantFamily) -> bool:
    """Whether no draw can lie outside the family's box."""
    if isinstance(draw.source, Table):
        return not outside_box(draw.source.rows[:, _columns(draw.source, family)], family).any()
    for name in family.uncertain_names:
        number = family.parameters[name]
        low, high = draw.source.get(name, Uniform()).limits(number)
        if low < number.min or high > number.max:
            return False
    return True


def outside_box(places: Array, family: PlantFamily) -> Marks:
    """Which draws lie outside the family's box, shape (m,): no certificate speaks of them."""
    return np.any((places < family.low) | (places > family.high), axis=1)


def impossible(places: Array, family: PlantFamily) -> Marks:
    """Which draws are no plants of the model (a time constant of 0, a gain of 0, a negative delay), shape (m,)."""
    check = PLANT_MODELS[family.model].check
    refused = np.zeros(len(places), dtype=bool)
    for column, name in enumerate(family.uncertain_names):
        values = places[:, column]
        if not len(values) or check(name, _hull(values.min(), values.max())) is None:
            continue
        order = np.argsort(values, kind="stable")
        ranked = values[order]
        # the model judges ranges: what it refuses is cut in two until single values are left
        pending = [(0, len(ranked))]
        while pending:
            start, stop = pending.pop()
            low, high = ranked[start], ranked[stop - 1]
            if check(name, _hull(low, high)) is None:
                continue
            if low == high:
                refused[order[start:stop]] = True
            else:
                middle = (start + stop) // 2
                pending += [(start, middle), (middle, stop)]
    return refused


def _hull(low: float, high: float) -> Uncertain:
    return Uncertain(float(low), float(low), float(high))


def parse_table(text: str) -> Table:
    """A table from the text of a CSV file: a line of parameter names, then a line of numbers per plant.

    Raises:
        DomainError: empty, not CSV, a line with too few or too many fields, or a field that is no finite number; the
            message names the line.
    """
    reader = csv.reader(io.StringIO(text.removeprefix("\ufeff"), newline=""), strict=True)
    rows: list[list[float]] = []
    names: tuple[str, ...] = ()
    try:
        for line in reader:
            if not names:
                names = tuple(name.strip() for name in line)
                continue
            if len(line) != len(names):
                raise DomainError(f"line {reader.line_num} has {len(line)} fields; its header has {len(names)}")
            rows.append([_number(entry, name, reader.line_num) for entry, name in zip(line, names, strict=True)])
    except csv.Error as error:
        raise DomainError(f"line {reader.line_num} is not CSV: {error}") from error
    if not rows:
        raise DomainError("the table is empty; it needs a line of parameter names and at least one line of numbers")
    return Table(names, np.array(rows))


def _number(entry: str, name: str, line: int) -> float:
    try:
        value = float(entry)
    except ValueError:
        value = math.nan
    if "_" in entry or not entry.isascii() or not math.isfinite(value):
        raise DomainError(f"line {line}, column {name!r}: {entry!r} is not a finite number")
    return value


def _columns(table: Table, family: PlantFamily) -> list[int]:
    """Where the family's uncertain numbers stand in the table."""
    wanted = family.uncertain_names
    if missing := [name for name in wanted if name not in table.names]:
        raise DomainError(f"the table has no column {missing[0]!r}; it needs {', '.join(wanted)}")
    if unknown := [name for name in table.names if name not in wanted]:
        raise DomainError(_unknown(unknown[0], family))
    return [table.names.index(name) for name in wanted]


def _unknown(name: str, family: PlantFamily) -> str:
    if name in family.parameters:
        return f"{name!r} is exact in this family; give it a range or leave it out"
    return f"{name!r} is no number of this family; its uncertain numbers are {', '.join(family.uncertain_names)}"


def _whole(name: str, value: int) -> int:
    try:
        whole = operator.index(value)
    except TypeError:
        raise DomainError(f"{name} = {value!r} is no whole number") from None
    if whole < 0:
        raise DomainError(f"{name} = {value!r} must be at least 0")
    return whole
