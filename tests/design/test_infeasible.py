"""Why there are no gains: the clash, and limits with which there are some."""

from __future__ import annotations

from dataclasses import replace

import pytest

import fopi_tune as ft
from fopi_tune.design import design
from fopi_tune.design.global_search.polish import Counts
from fopi_tune.design.global_search.problem import Problem
from fopi_tune.design.infeasible import MET, least_missed, nearest_of
from fopi_tune.results.status import Status

CLASH = (
    "schema: 1\nname: x\nplant: {model: pole, gain: 25, pole_rad_s: -1, dead_time_s: 0.033}\n"
    "controller: {kp: {min: 0, max: 6.7}, ki: {min: 0, max: 0.85}, alpha: {min: 0.44, max: 1.36}}\n"
    "requirements:\n  - {crossover_rad_s: {equals: 1.0}, on: nominal}\n  - {phase_margin_deg: {at_least: 44}}\n"
    "objective: {minimize: phase_margin_spread_deg}\n"
)


@pytest.mark.parametrize("digital", ["", "digital: {sample_time_s: 0.005, design: sampled}\n"])
def test_a_clash_is_explained_by_few_solves_and_its_relaxations_are_enough(digital: str) -> None:
    spec = ft.parse_spec(CLASH + digital)
    found = design(spec)
    assert found.status is Status.INFEASIBLE
    assert [each.requirement for each in found.clash] == [0, 1]
    # two for each basin of the search, a few for the nearest gains and each relaxation; it had taken 68 and 86
    assert found.solves <= 20
    for each in found.clash:
        assert each.new_limit is not None
        old = spec.requirements[each.requirement]
        # beyond what rounding decides
        limit = old.limits[0] + 1.01 * (each.new_limit - old.limits[0])
        requirements = [replace(r, limits=(limit,)) if r is old else r for r in spec.requirements]
        assert design(replace(spec, requirements=tuple(requirements))).status is Status.SOLVED


def test_a_question_that_has_its_answer_is_not_polished() -> None:
    problem, counts = Problem.of(ft.parse_spec(CLASH)), Counts()
    nearest = nearest_of(problem, counts)
    assert nearest is not None
    assert nearest.cost > MET
    before = counts.solves
    alone = least_missed(problem, frozenset({1}), frozenset({0}), counts, MET)
    assert alone is not None
    assert alone.cost <= MET
    assert counts.solves == before
