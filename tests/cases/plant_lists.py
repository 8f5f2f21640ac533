"""Specs with lists of plants."""

from __future__ import annotations

import pytest

from fopi_tune.core.controller import FoPi
from fopi_tune.errors import SpecError
from fopi_tune.spec import parse_spec
from fopi_tune.spec.model import DesignSpec

#: a nominal plant and two it may be mistaken for, as in studies of Smith predictors
MISMATCH = """schema: 1
name: mismatch
plants:
  - {name: slow, model: transfer_function, numerator: [1.5], denominator: [1, 1], dead_time_s: 1.4}
  - {model: lag, static_gain: 1.0, time_constant_s: 1.5, dead_time_s: 1}
  - {model: lag, static_gain: 0.8, time_constant_s: 0.9, dead_time_s: 0.7, weight: 2}
controller: {structure: pi}
requirements:
  - sensitivity_db: {at_most: 6}
  - phase_margin_deg: {at_least: 45}
    on: nominal
objective: {minimize: iae_disturbance}
"""
#: meets it
MISMATCH_GAINS = FoPi(0.25, 0.25, 1.0)

#: models, orders and numbers of uncertain numbers that differ
MIXED = """schema: 1
name: mixed
plants:
  - {name: lag, model: lag, static_gain: {min: 0.9, max: 1.1}, time_constant_s: 2.0, dead_time_s: 0.5}
  - {name: exact, model: transfer_function, numerator: [2.0], denominator: [0.4, 1.6, 1], dead_time_s: 0.2}
  - name: linked
    parameters: {a: {min: 0.8, max: 1.0}, k: {min: 0.9, max: 1.2}}
    model: transfer_function
    numerator: [k * a]
    denominator: [[1, a], [0.1, 1]]
    dead_time_s: 0.4
requirements:
  - sensitivity_db: {at_most: 6}
  - phase_margin_deg: {at_least: 50}
  - crossover_rad_s: {at_least: 0.3}
objective: {minimize: iae_disturbance}
"""
#: of a PI that meets MIXED
MIXED_GAINS = FoPi(0.6, 0.35, 1.0)


def mismatch(text: str = MISMATCH) -> DesignSpec:
    """The spec of three plants."""
    return parse_spec(text)


def mixed(more: str = "") -> DesignSpec:
    """The spec of three models, with more sections."""
    return parse_spec(MIXED + more)


def problems(text: str) -> list[str]:
    """Everything that is wrong with a spec's text."""
    with pytest.raises(SpecError) as raised:
        parse_spec(text, "s.yaml")
    return [str(problem) for problem in raised.value.problems]
