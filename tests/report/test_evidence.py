"""Evidence in words, where values of drawn plants are infinite or do not exist: null in its JSON."""

from __future__ import annotations

from typing import Any

import pytest

from fopi_tune.report.evidence import evidence_rows

SHARE = {"low": 0.0, "high": 1.0}


def evidence(name: str, side: str, met: int, median: float | None, worst: float | None) -> dict[str, Any]:
    judged = {
        "name": name,
        "relation": side,
        "side": side,
        "limits": [60.0],
        "fraction": {"met": met, "total": 10, **SHARE},
        "quantiles": [{"probability": 0.5, "value": median}],
        "worst": [{"value": worst, "index": 3, "plant": {"static_gain": 0.5}}],
    }
    return {"stable": {"met": 10, "total": 10, **SHARE}, "requirements": [judged], "limits": []}


@pytest.mark.parametrize(
    ("name", "side", "met", "median", "worst", "words"),
    [
        # all infinite; most infinite and one with none; most with none
        ("phase_margin_deg", "at_least", 10, None, None, ("infinite", "infinite with")),
        ("phase_margin_deg", "at_least", 9, None, None, ("infinite", "none with")),
        ("phase_margin_deg", "at_least", 3, None, None, ("none", "none with")),
        ("phase_margin_deg", "at_least", 9, 75.0, 30.0, ("75", "30 with")),
        ("phase_margin_deg", "at_most", 8, 70.0, None, ("70", "infinite or none with")),
        ("crossover_rad_s", "at_most", 8, 0.5, None, ("0.5", "none with")),
        ("settling_time_s", "at_most", 8, 12.0, None, ("12", "infinite with")),
    ],
)
def test_values_that_are_no_numbers_are_told(
    name: str, side: str, met: int, median: float | None, worst: float | None, words: tuple[str, str]
) -> None:
    row = evidence_rows(evidence(name, side, met, median, worst))[1]
    assert row.median == words[0]
    assert row.worst.startswith(words[1])


def test_the_joint_yield_stands_above_the_single_demands() -> None:
    told = evidence("overshoot", "at_most", 9, 0.1, 0.2)
    assert [row.what for row in evidence_rows(told)] == ["stable loop", "overshoot <= 60"]
    told["joint_yield"] = {"met": 8, "total": 10, "low": 0.4, "high": 0.97}
    told["joint_yield"]["scenarios"] = [{"name": "stop", "met": 9, "total": 10, **SHARE}]
    rows = evidence_rows(told)
    assert [row.what for row in rows] == ["all at once", "all at once, stop", "stable loop", "overshoot <= 60"]
    assert [(row.share, row.interval) for row in rows[:2]] == [("80 %", "40 .. 97 %"), ("90 %", "0 .. 100 %")]
