"""What a design does with the answers of a search."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

import fopi_tune as ft
from fopi_tune.core.controller import FoPi
from fopi_tune.design import design, synthesis
from fopi_tune.design.global_search.problem import Problem
from fopi_tune.results.candidate import Candidate

SPEC = """\
schema: 1
name: again
plant: {model: lag, static_gain: 1, time_constant_s: {min: 1.6, max: 3.1}}
controller: {kp: {min: 0, max: 5}, ki: {min: 0, max: 5}, alpha: {min: 0.5, max: 1.5}}
requirements: [{sensitivity_db: {at_most: 2}}, {control_sensitivity_db: {at_most: 6}}]
objective: {maximize: ki}
"""


def test_a_search_that_fails_beside_gains_that_meet_everything_is_repeated_around_their_crossover(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    spec, seen = ft.parse_spec(SPEC), []
    whole, met = synthesis.search, FoPi(0.5, 0.3, 1.0)

    def first_fails(problem: Problem, known: FoPi | None, bracket: bool) -> Candidate:
        seen.append((problem.scale.omega_rad_s, known))
        found = whole(problem, known, bracket)
        return replace(found, status=ft.Status.FAILED, gains=met) if len(seen) == 1 else found

    expected = design(spec)
    monkeypatch.setattr(synthesis, "search", first_fails)
    found = design(spec)
    assert found.status is ft.Status.SOLVED
    assert found.gains is not None
    assert expected.gains is not None
    assert found.gains.ki == pytest.approx(expected.gains.ki, rel=1e-6)
    (_, nothing), (omega_rad_s, known) = seen
    assert (nothing, known) == (None, met)
    # |L| = 1 of (0.5 s + 0.3)/(s (2.35 s + 1)):  (2.35 w^2)^2 + w^2 = 0.25 w^2 + 0.09
    lag_s = 0.5 * (1.6 + 3.1)
    squared = (-0.75 + math.sqrt(0.75**2 + 4.0 * 0.09 * lag_s**2)) / (2.0 * lag_s**2)
    assert omega_rad_s == pytest.approx(math.sqrt(squared), rel=1e-6)
