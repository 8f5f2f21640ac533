"""Worst cases over one box of plants or several:  a search for each, and what they find together.

`worst_case` moves plants within a box.  Of a list of plants it is asked of each member; a finding then has its place in
the list, the member's index before its uncertain numbers.  What is about the nominal plant alone belongs to the first.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fopi_tune.core.bode_form import Array
from fopi_tune.core.families.plant_list import PlantList, members_of
from fopi_tune.design.global_search.compiled import CROSSOVER_SPREAD, Family, Rows, Table, Work, work_for
from fopi_tune.design.global_search.problem import Problem
from fopi_tune.design.global_search.rays import fill_ray
from fopi_tune.design.global_search.tables import box_grid, table_of_member
from fopi_tune.design.global_search.worst_case import FIELDS, ROW, SLACK, highest_crossover, worst_cases

_MOST_FINDINGS = 96
#: natural units; of several members' findings of a row those that are less deep than its worst by more are left out
_LESS_DEEP = 0.25
_MOST_OF_A_ROW = 6
_OWN_REFERENCE = np.zeros(0)


@dataclass(frozen=True)
class BoxSearch:
    """The search for worst cases in one box.

    Args:
        member: its index in a list of plants; None without one.
        table: its plants, the nominal one first.
        plants: their coefficients over the box.
        low, high, spacing: of the box and its grid, shape (p,).
        asked: rows that are about these plants, of all.
        real_rows: how many of these are requirements'.
        width: numbers of a place.
        work: scratch arrays.
        out: room for findings.
    """

    member: int | None
    table: Table
    plants: Family
    low: Array
    high: Array
    spacing: Array
    asked: NDArray[np.intp]
    real_rows: int
    width: int
    work: Work
    out: Array

    def placed(self, count: int) -> Array:
        """The first findings, of all rows, at places in the list; shape (count, 6 + width)."""
        if self.member is None:
            return self.out[:count].copy()
        found = np.zeros((count, FIELDS + self.width))
        found[:, :FIELDS] = self.out[:count, :FIELDS]
        found[:, ROW] = self.asked[self.out[:count, ROW].astype(int)]
        found[:, FIELDS] = self.member
        found[:, FIELDS + 1 : FIELDS + 1 + len(self.low)] = self.out[:count, FIELDS:]
        return found


def searches_of(problem: Problem, table: Table, rows: Rows, real_rows: int) -> tuple[BoxSearch, ...]:
    """A search for each box of a problem's plants.

    Args:
        problem: the problem.
        table: its plants on the fine grid.
        rows: what is asked, requirements first.
        real_rows: the number of requirements' rows.
    """
    family, every = problem.spec.plant, np.arange(len(rows.kind))
    searches = []
    for k, member in enumerate(members_of(family)):
        listed = isinstance(family, PlantList)
        own = table_of_member(table, family, k) if isinstance(family, PlantList) else table
        asked = every if k == 0 else np.flatnonzero(~rows.nominal)
        part = problem.scaled.parts[k] if listed else problem.scaled
        points, spacing = box_grid(member.family) if listed else problem.fine_points
        searches.append(
            BoxSearch(
                k if listed else None, own, part.plants, member.family.low, member.family.high, spacing, asked,
                int(np.count_nonzero(asked < real_rows)), table.points.shape[1], work_for(own),
                np.empty((_MOST_FINDINGS, FIELDS + points.shape[1])),
            )
        )  # fmt: skip
    return tuple(searches)


def worst_of(
    searches: Sequence[BoxSearch], x: Array, table: Table, rows: Rows, code: int, log_horizon: float, within: float
) -> Array | None:
    """The worst cases at gains, shape (k, 6 + p); None where a plant is unstable or a quantity has no value.

    Args:
        searches: of every box.
        x: the numbers of the controller.
        table: of the first box, at these numbers' orders.
        rows: what is asked, with the limits of the moment.
        code: of the objective.
        log_horizon: ln(T omega_s).
        within: rows of requirements whose slack is larger are left out.
    """
    known, parts = _OWN_REFERENCE, []
    for search in searches:
        # spreads are measured from the nominal plant, which is the first of the first box
        own = table if search is searches[0] else search.table._replace(sampling=table.sampling)
        asked = rows if len(search.asked) == len(rows.kind) else Rows(*(column[search.asked] for column in rows))
        count = worst_cases(
            x, own, asked, search.plants, search.low, search.high, search.spacing, log_horizon, within,
            search.real_rows, known, search.work, search.out,
        )  # fmt: skip
        if count < 0:
            return None
        parts.append(search.placed(count))
        if code == CROSSOVER_SPREAD and len(searches) > 1 and not len(known):
            fill_ray(x[2], x[0], x[1], own, search.work)
            v, near, _ = highest_crossover(x, own, search.work)
            known = np.array([v, near])
    return parts[0] if len(parts) == 1 else _deepest(np.vstack(parts))


def _deepest(found: Array) -> Array:
    """Of each row the deepest findings of all members."""
    kept = []
    for row in np.unique(found[:, ROW]):
        own = found[found[:, ROW] == row]
        own = own[np.argsort(own[:, SLACK], kind="stable")]
        kept.append(own[own[:, SLACK] <= own[0, SLACK] + _LESS_DEEP][:_MOST_OF_A_ROW])
    return np.vstack(kept) if kept else found
