"""Requirements as expressions: what they are in a spec, and words for all that the language knows."""

from __future__ import annotations

import pytest

import fopi_tune as ft
from fopi_tune.quantities import QUANTITIES
from fopi_tune.spec.measures import MEASURES
from fopi_tune.spec.python.requirements import RequirementWord


def test_expressions_are_entries_of_a_spec() -> None:
    expressions = [
        (ft.crossover_rad_s == 0.3).on_nominal(),
        ft.phase_margin_deg >= 80,
        ft.sensitivity_db(to_rad_s=0.02) <= -20,
        ft.sensitivity_db <= [[0.01, -40], [0.1, -20]],
        ft.crossover_rad_s.between(0.2, 0.3),
        ft.overshoot(scenario="town") <= 0.1,
    ]
    assert [each.as_mapping() for each in expressions] == [
        {"crossover_rad_s": {"equals": 0.3}, "on": "nominal"},
        {"phase_margin_deg": {"at_least": 80}},
        {"sensitivity_db": {"at_most": -20}, "to_rad_s": 0.02},
        {"sensitivity_db": {"at_most": {"by_frequency": [[0.01, -40], [0.1, -20]]}}},
        {"crossover_rad_s": {"between": [0.2, 0.3]}},
        {"overshoot": {"at_most": 0.1}, "scenario": "town"},
    ]


def test_every_word_of_the_language_is_there() -> None:
    for name in (*QUANTITIES, *MEASURES):
        word = getattr(ft, name)
        assert isinstance(word, RequirementWord)
        assert word.name == repr(word) == name
    assert repr(ft.sensitivity_db(to_rad_s=1.0)) == "sensitivity_db(to_rad_s=1.0)"
    assert len({ft.iae, ft.ise, ft.iae}) == 2


def test_two_limits_in_one_comparison_are_refused() -> None:
    with pytest.raises(ft.DomainError, match=r"crossover_rad_s\.between\(low, high\)"):
        assert 0.2 <= ft.crossover_rad_s <= 0.3


def test_a_limit_that_may_not_be_reached_is_refused() -> None:
    with pytest.raises(ft.DomainError, match="write phase_margin_deg >= 60"):
        ft.phase_margin_deg > 60  # noqa: B015  # pyright: ignore[reportUnusedExpression]
    with pytest.raises(ft.DomainError, match="write sensitivity_db <= 6"):
        ft.sensitivity_db < 6  # noqa: B015  # pyright: ignore[reportUnusedExpression]
