"""The text of a design, line by line."""

from __future__ import annotations

from dataclasses import replace

import pytest

from fopi_tune.optimum import Optimum, OptimumStatus
from fopi_tune.report.text.design import optimum_lines

UNKNOWN = Optimum(
    "t", "0" * 64, OptimumStatus.LIMIT_REACHED, None, None, None, None, 1e-3, None, None, 1, 0.0, None, (), "why"
)


@pytest.mark.parametrize(
    ("optimum", "told"),
    [
        (UNKNOWN, "nothing proved: why (1 box of gains, 0.0 s)"),
        (replace(UNKNOWN, boxes=2), "nothing proved: why (2 boxes of gains, 0.0 s)"),
        (replace(UNKNOWN, status=OptimumStatus.INFEASIBLE), "every requirement (1 box of gains, 0.0 s)"),
        (replace(UNKNOWN, bound=2.0, gap=0.01), "a gap of 1 % (1 box of gains, 0.0 s)"),
    ],
)
def test_what_is_proved_of_the_optimum_counts_its_boxes(optimum: Optimum, told: str) -> None:
    assert told in " ".join(" ".join(text for text, _ in optimum_lines(optimum)).split())
