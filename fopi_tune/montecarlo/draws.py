"""Plants drawn from a family:  SamplingPlan, PlantFamily, indices -> points of the box, shape (count, p).

Draw i depends on the seed and on i alone: results do not depend on chunks, threads or workers, to the last bit.  A
point u of the unit cube (`sampling`) is mapped by the inverse distribution functions (`core.distributions`), or, with a
table of samples, to the row floor(u rows); a Latin hypercube of as many draws as rows takes every row once.  A list of
samples is used in its order.  A draw may lie outside the family's box, where nothing is proved
(`core.parameter_table.outside_box`), or be no plant at all (`core.parameter_table.impossible`).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from fopi_tune.core.bode_form import Array
from fopi_tune.core.distributions.bounded import Uniform
from fopi_tune.core.distributions.correlation import Correlation, correlated
from fopi_tune.core.distributions.distribution import Distribution
from fopi_tune.core.families.plant_list import PlantList
from fopi_tune.core.parameter_table import ParameterTable, not_uncertain, outside_box
from fopi_tune.core.plant import PlantFamily
from fopi_tune.core.terms.numbers import whole_number
from fopi_tune.core.text_tables.words import agreeing, counted
from fopi_tune.errors import DomainError
from fopi_tune.montecarlo.sampling import SamplingDesign, unit_cube_points


@dataclass(frozen=True)
class SampleList:
    """A table's rows in their order: draw i is row i, for every seed and design."""

    table: ParameterTable


@dataclass(frozen=True)
class SamplingPlan:
    """Which points are drawn: seed, design, number and distribution.

    Args:
        seed: in [0, 2^64).
        design: random, Latin hypercube or Sobol.
        total: number of draws of the whole design; None where the design does not need it.
        source: distributions by parameter name (`Uniform` for those left out), a table of samples to pick from, or a
            list of samples used in its order.
        correlations: between parameters that are drawn from distributions.

    Raises:
        DomainError: the seed or the total is no whole number or out of range, or a Latin hypercube has no total.
    """

    seed: int
    design: SamplingDesign = SamplingDesign.RANDOM
    total: int | None = None
    source: Mapping[str, Distribution] | ParameterTable | SampleList = field(default_factory=dict)
    correlations: tuple[Correlation, ...] = ()

    def __post_init__(self) -> None:
        object.__setattr__(self, "seed", whole_number("seed", self.seed))
        if self.total is not None:
            object.__setattr__(self, "total", whole_number("total", self.total))
        unit_cube_points(self.design, self.seed, 0, 0, 0, self.total)


def sample_points(plan: SamplingPlan, family: PlantFamily, first: int, count: int) -> Array:
    """Draws first .. first + count - 1.

    Args:
        plan: seed, design and distributions.
        family: its box and nominal values.
        first: index of the first draw, from 0.
        count: number of draws; the memory needed is proportional to it.

    Returns:
        Shape (count, p), columns as `family.uncertain_names`; of a list of plants places in it, shape (count, width).

    Raises:
        DomainError: the range of indices is not the design's, or the source does not fit the family.
    """
    if isinstance(family, PlantList):
        return _places(plan, family, whole_number("first", first), whole_number("count", count))
    names = family.uncertain_names
    first, count = whole_number("first", first), whole_number("count", count)
    if isinstance(plan.source, SampleList):
        return _rows(plan.source.table, family, first, count)
    if isinstance(plan.source, ParameterTable):
        columns = plan.source.columns(family)
        u = unit_cube_points(plan.design, plan.seed, 1, first, count, plan.total)[:, 0]
        # u < 1, but u m may round up to m
        rows = np.minimum((u * len(plan.source.rows)).astype(np.int64), len(plan.source.rows) - 1)
        return plan.source.rows[rows][:, columns]
    if unknown := sorted(set(plan.source) - set(names)):
        raise DomainError(not_uncertain(unknown[0], family))
    points = unit_cube_points(plan.design, plan.seed, len(names), first, count, plan.total)
    if plan.correlations:
        points = correlated(points, names, plan.correlations)
    for column, name in enumerate(names):
        u = np.ascontiguousarray(points[:, column])
        points[:, column] = plan.source.get(name, Uniform()).values(u, family.parameters[name])
    return points


def stays_inside(plan: SamplingPlan, family: PlantFamily) -> bool:
    """Whether no draw can lie outside the family's box."""
    if isinstance(family, PlantList):
        return True  # every number is uniform over its range
    if isinstance(plan.source, ParameterTable | SampleList):
        table = plan.source if isinstance(plan.source, ParameterTable) else plan.source.table
        return not outside_box(table.rows[:, table.columns(family)], family).any()
    for name in family.uncertain_names:
        number = family.parameters[name]
        low, high = plan.source.get(name, Uniform()).limits(number)
        if low < number.min or high > number.max:
            return False
    return True


def _places(plan: SamplingPlan, family: PlantList, first: int, count: int) -> Array:
    """Draws from a list of plants, shape (count, width): of a member, as often as its weight says, all plants alike.

    The first number of the cube selects the member, the others its uncertain numbers, uniform over their ranges.  A
    list of one has no choice: its draws are those of its only family.
    """
    if not isinstance(plan.source, Mapping) or plan.source or plan.correlations:
        raise DomainError("plants of a list are drawn uniformly over their ranges; leave distributions and files out")
    if len(family.members) == 1:
        return family.place(0, sample_points(plan, family.first, first, count))
    u = unit_cube_points(plan.design, plan.seed, family.width, first, count, plan.total)
    ends = np.cumsum([member.weight for member in family.members])
    chosen = np.minimum(np.searchsorted(ends / ends[-1], u[:, 0], side="right"), len(ends) - 1)
    found = np.zeros((count, family.width))
    for index, member in enumerate(family.members):
        rows = np.flatnonzero(chosen == index)
        own = [
            Uniform().values(np.ascontiguousarray(u[rows, 1 + column]), member.family.parameters[name])
            for column, name in enumerate(member.family.uncertain_names)
        ]
        found[rows] = family.place(index, np.array(own).reshape(len(own), len(rows)).T)
    return found


def _rows(table: ParameterTable, family: PlantFamily, first: int, count: int) -> Array:
    if first + count > len(table.rows):
        raise DomainError(
            f"draws {first} to {first + count - 1} were asked for; there {agreeing(len(table.rows), 'is', 'are')} "
            f"{counted(len(table.rows), 'sample')}, from 0 on"
        )
    return np.ascontiguousarray(table.rows[first : first + count, table.columns(family)])
