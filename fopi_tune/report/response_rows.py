"""Measures of the loop as it runs, as rows of a table:  FamilyResponse -> words, the range over the plants driven."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from fopi_tune.pipeline.responses import FamilyResponse
from fopi_tune.report.text.formatting import TIE, number
from fopi_tune.report.words import in_words, name_and_unit
from fopi_tune.simulation.measures import measure_values
from fopi_tune.spec.measures import ACCELERATION, MEASURES, velocity_unit
from fopi_tune.spec.model import DesignSpec

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
    """

    scenario: str
    what: str
    nominal: str
    least: str
    largest: str
    worst: str


def measure_ranges(spec: DesignSpec, responses: Sequence[FamilyResponse]) -> tuple[MeasureRange, ...]:
    """A row for each measure of each scenario, in the order of the scenarios.

    Args:
        spec: the spec.
        responses: of its scenarios; the nominal plant is the first of each.
    """
    return tuple(row for response in responses for row in _rows(spec, response))


def _rows(spec: DesignSpec, response: FamilyResponse) -> Iterator[MeasureRange]:
    unit = "" if spec.digital is None else spec.digital.measurement_unit
    name = response.scenario.name
    for word, kind in MEASURES.items():
        if word == "switch_count" or (word == ACCELERATION and velocity_unit(unit) is None):
            continue
        values = measure_values(response.measures, word, unit)
        ranked = np.where(np.isnan(values), -math.inf, np.abs(values))
        worst = spec.plant.describe(response.points[int(np.argmax(ranked))]) if len(values) > 1 else {}
        yield MeasureRange(
            name,
            ", ".join(part for part in (name_and_unit(word)[0], _unit(spec, kind.unit)) if part != "1"),
            _shown(values[0]),
            _shown(values.min()),
            _shown(values.max()),
            in_words(", ".join(f"{key}{TIE}={TIE}{number(value, _DIGITS)}" for key, value in worst.items())),
        )
        name = ""


def _unit(spec: DesignSpec, unit: str) -> str:
    """The unit in the spec's own words, where it has some."""
    if spec.digital is None:
        return unit
    for word, own in (("output unit", spec.digital.measurement_unit), ("control unit", spec.digital.output_unit)):
        unit = unit.replace(word, own.strip() or word)
    return unit.replace("^2", "²").replace(" squared", "²").replace(" times ", " ")


def _shown(value: float) -> str:
    if math.isnan(value):
        return "unknown"
    return number(float(value), _DIGITS) if math.isfinite(value) else "never"
