"""Rows of documents: phrases of requirements, counts, measures, and text that is no markup."""

from __future__ import annotations

import fopi_tune as ft
from fopi_tune.results.views.tables import html_table, phrase_of, rows_of

GAINS = ft.FoPi(0.44651475946456753, 0.37032589727989074, 0.8319673847369714)


def test_requirements_are_written_as_formulas() -> None:
    assert phrase_of({"name": "a", "relation": "at_least", "limit": 3.0}) == "a >= 3"
    assert phrase_of({"name": "a", "relation": "between", "limit": [1.0, 2.5]}) == "a in [1, 2.5]"
    # of two limits each is counted by itself
    both = {"name": "a", "relation": "between", "limits": [1.0, 2.5]}
    assert phrase_of({**both, "side": "at_least"}) == "a >= 1"
    assert phrase_of({**both, "side": "at_most"}) == "a <= 2.5"


def test_text_of_a_table_is_no_markup() -> None:
    table = html_table([{"requirement": "<b>", "value": 1.23456789}, {"value": None, "other": True}])
    assert table.count("<td>") == 6
    assert "&lt;b&gt;" in table
    assert "<td>1.2346</td>" in table


def test_a_simulation_has_a_row_for_every_measure_with_its_limit() -> None:
    found = ft.simulate("specs/throttle.yaml", GAINS)
    rows = rows_of(found.to_dict())
    measures = found.driven[0].measures
    assert [row["measure"] for row in rows] == list(measures)
    assert [row["value"] for row in rows if row["measure"] == "iae"] == [measures["iae"]]


def test_evidence_has_the_joint_yield_first() -> None:
    rows = ft.validate("specs/brake.yaml", GAINS, samples=30).rows()
    assert [row["requirement"] for row in rows[:2]] == ["all at once", "stable loop"]
    assert rows[2]["median"] is not None
