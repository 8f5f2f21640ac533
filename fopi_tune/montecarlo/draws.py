"""Plants drawn from a family:  Draw, PlantFamily, indices -> points of the box, shape (count, p).

Draw i depends on the seed and i alone: chunks, threads and workers change no bit.  A place in the unit cube
(`designs`) becomes values by the inverse distribution functions (`core.distributions`), or by a table of samples, whose
row floor(u rows) it picks; a Latin hypercube of as many draws as rows takes every row once.  A list of samples is taken
as it is.  Draws may lie outside the family's box, where nothing was proven (`outside_box`), and be no plant at all
(`impossible`).
"""

from __future__ import annotations

import operator
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from fopi_tune.core.distributions import Distribution, Uniform
from fopi_tune.core.logform import Array
from fopi_tune.core.plant import PlantFamily
from fopi_tune.core.samples import Table, not_uncertain, outside_box
from fopi_tune.errors import DomainError
from fopi_tune.montecarlo.sampling import SamplingDesign, unit_cube_points


@dataclass(frozen=True)
class SampleList:
    """A table's rows one after the other: draw i is row i, whatever seed and design."""

    table: Table


@dataclass(frozen=True)
class SamplingPlan:
    """What to draw.

    Args:
        seed: in [0, 2^64).
        design: how the draws lie.
        total: number of draws of the whole design; None where the design does not need to know.
        source: a distribution by parameter name (`Uniform` for those left out), a table of samples to pick from, or a
            list of them.

    Raises:
        DomainError: the seed or the total is no whole number or out of range, or a Latin hypercube has no total.
    """

    seed: int
    design: SamplingDesign = SamplingDesign.RANDOM
    total: int | None = None
    source: Mapping[str, Distribution] | Table | SampleList = field(default_factory=dict)

    def __post_init__(self) -> None:
        object.__setattr__(self, "seed", _whole("seed", self.seed))
        if self.total is not None:
            object.__setattr__(self, "total", _whole("total", self.total))
        unit_cube_points(self.design, self.seed, 0, 0, 0, self.total)


def sample_points(draw: SamplingPlan, family: PlantFamily, first: int, count: int) -> Array:
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
    if isinstance(draw.source, SampleList):
        return _rows(draw.source.table, family, first, count)
    if isinstance(draw.source, Table):
        columns = draw.source.columns(family)
        u = unit_cube_points(draw.design, draw.seed, 1, first, count, draw.total)[:, 0]
        # u < 1, but u m may round up to m
        rows = np.minimum((u * len(draw.source.rows)).astype(np.int64), len(draw.source.rows) - 1)
        return draw.source.rows[rows][:, columns]
    if unknown := sorted(set(draw.source) - set(names)):
        raise DomainError(not_uncertain(unknown[0], family))
    places = unit_cube_points(draw.design, draw.seed, len(names), first, count, draw.total)
    for column, name in enumerate(names):
        u = np.ascontiguousarray(places[:, column])
        places[:, column] = draw.source.get(name, Uniform()).values(u, family.parameters[name])
    return places


def stays_inside(draw: SamplingPlan, family: PlantFamily) -> bool:
    """Whether no draw can lie outside the family's box."""
    if isinstance(draw.source, Table | SampleList):
        table = draw.source if isinstance(draw.source, Table) else draw.source.table
        return not outside_box(table.rows[:, table.columns(family)], family).any()
    for name in family.uncertain_names:
        number = family.parameters[name]
        low, high = draw.source.get(name, Uniform()).limits(number)
        if low < number.min or high > number.max:
            return False
    return True


def _rows(table: Table, family: PlantFamily, first: int, count: int) -> Array:
    if first + count > len(table.rows):
        raise DomainError(
            f"draws {first} to {first + count - 1} were asked for; there are {len(table.rows)} samples, from 0 on"
        )
    return np.ascontiguousarray(table.rows[first : first + count, table.columns(family)])


def _whole(name: str, value: int) -> int:
    try:
        whole = operator.index(value)
    except TypeError:
        raise DomainError(f"{name} = {value!r} is no whole number") from None
    if whole < 0:
        raise DomainError(f"{name} = {value!r} must be at least 0")
    return whole
