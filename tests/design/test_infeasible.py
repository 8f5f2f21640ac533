"""Why there are no gains: the clash, and limits with which there are some."""

from __future__ import annotations

from dataclasses import replace

import pytest
from cases.design_cases import CONTRADICTORY

import fopi_tune as ft
from fopi_tune.design import design
from fopi_tune.design.global_search.polish import Counts, Polished
from fopi_tune.design.global_search.problem import Problem
from fopi_tune.design.infeasible import MET, least_missed, nearest_of
from fopi_tune.results.status import Status


@pytest.mark.parametrize("digital", ["", "digital: {sample_time_s: 0.005, design: sampled}\n"])
def test_a_clash_is_explained_by_few_solves_and_its_relaxations_are_enough(digital: str) -> None:
    spec = ft.parse_spec(CONTRADICTORY + digital)
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
    problem, counts = Problem.of(ft.parse_spec(CONTRADICTORY)), Counts()
    nearest = nearest_of(problem, counts)
    assert nearest is not None
    assert nearest.cost > MET
    before = counts.solves
    alone = least_missed(problem, frozenset({1}), frozenset({0}), counts, MET)
    assert alone is not None
    assert alone.cost <= MET
    assert counts.solves == before


def test_gains_that_leave_every_loop_unstable_are_searched_for_once(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[Problem] = []

    def counted(problem: Problem, counts: Counts) -> Polished | None:
        asked.append(problem)
        return nearest_of(problem, counts)

    monkeypatch.setattr("fopi_tune.design.search.nearest_of", counted)
    # 25/(s - 1) behind 2 s: no gain holds a pole whose inverse is shorter than its dead time
    found = design(ft.parse_spec(CONTRADICTORY.replace("dead_time_s: 0.033", "dead_time_s: 2")))
    assert found.status is Status.INFEASIBLE
    assert "give every plant of the family a stable loop" in found.message
    assert len(asked) == 1
