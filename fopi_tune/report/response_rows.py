"""Measures of the loop as it runs, as rows of a table:  FamilyResponse -> words, the range over the plants driven."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from fopi_tune.core.bode_form import Array
from fopi_tune.pipeline.responses import FamilyResponse
from fopi_tune.report.figures.scenarios import DrivenLoops
from fopi_tune.report.text.formatting import TIE, number
from fopi_tune.report.words import name_and_unit
from fopi_tune.simulation.measures import measure_values
from fopi_tune.spec.measures import ACCELERATION, MEASURES, velocity_unit
from fopi_tune.spec.model import Limit, Relation

#: digits of a measure
_DIGITS = 4


@dataclass(frozen=True)
class MeasureRange:
    """A measure of one scenario over the plants that were driven, in words.

    Args:
        scenario: its name; empty where the row above has the same.
        what: the measure and its unit.
        nominal: of the nominal plant.
        least: over the plants.
        largest: over the plants.
        worst: the plant with the largest value.
        judged: the spec's limits of the measure, and how many of the plants keep each; empty without.
    """

    scenario: str
    what: str
    nominal: str
    least: str
    largest: str
    worst: str
    judged: str


def measure_ranges(loops: DrivenLoops) -> tuple[MeasureRange, ...]:
    """A row for each measure of each scenario, in the order of the scenarios."""
    return tuple(row for response in loops.responses for row in _rows(loops, response))


def driven_plants(loops: DrivenLoops) -> str:
    """How many plants were driven: "9", or "3 to 9" where scenarios differ."""
    counts = [len(response.points) for response in loops.responses]
    low, high = min(counts, default=0), max(counts, default=0)
    return f"{low}" if low == high else f"{low} to {high}"


def _rows(loops: DrivenLoops, response: FamilyResponse) -> Iterator[MeasureRange]:
    name = response.scenario.name
    for word, kind in MEASURES.items():
        # a loop has no modes; an acceleration is that of a velocity
        if (word == "switch_count" and not loops.second_mode) or (
            word == ACCELERATION and velocity_unit(loops.units[0]) is None
        ):
            continue
        values = measure_values(response.measures, word, loops.units[0])
        ranked = np.where(np.isnan(values), math.inf, np.abs(values))
        worst = loops.family.describe(response.points[int(np.argmax(ranked))]) if np.any(ranked != ranked[0]) else {}
        yield MeasureRange(
            name,
            ", ".join(part for part in (name_and_unit(word)[0], _unit(loops, kind.unit)) if part != "1"),
            _shown(values[0]),
            _shown(values.min()),
            _shown(values.max()),
            ", ".join(f"{key}{TIE}={TIE}{number(value, _DIGITS)}" for key, value in worst.items()),
            "; ".join(_judged(limit, values) for limit in loops.judged if _is_about(limit, word, response)),
        )
        name = ""


def _is_about(limit: Limit, word: str, response: FamilyResponse) -> bool:
    return limit.measure == word and limit.scenario in (None, response.scenario.name)


def _judged(limit: Limit, values: Array) -> str:
    """A limit and how many plants keep it; a value that is not known keeps none."""
    at_most = limit.relation is Relation.AT_MOST
    kept = int(np.count_nonzero(values <= limit.limit if at_most else values >= limit.limit))
    said = "kept" if kept == len(values) else f"kept by {kept} of {len(values)}"
    return f"{'≤' if at_most else '≥'}{TIE}{limit.limit:.10g}: {said}"


def _unit(loops: DrivenLoops, unit: str) -> str:
    """The unit in the spec's own words, where it has some."""
    for word, own in zip(("output unit", "control unit"), loops.units, strict=True):
        unit = unit.replace(word, own.strip() or word)
    return unit.replace("^2", "²").replace(" squared", "²").replace(" times ", " ")


def _shown(value: float) -> str:
    if math.isnan(value):
        return "unknown"
    return number(float(value), _DIGITS) if math.isfinite(value) else "never"
