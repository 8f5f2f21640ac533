"""Cases of which every other one is tested each time, and the rest with `-m long`."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import pytest


def thinned(cases: Iterable[Any], every: int = 2) -> list[Any]:
    """The parameters of a test, one of `every` of them for each run.

    Args:
        cases: one value a case, or a tuple of values.
        every: how many cases there are for one that is tested each time.
    """
    return [
        pytest.param(*(case if isinstance(case, tuple) else (case,)), marks=[pytest.mark.long] * (index % every > 0))
        for index, case in enumerate(cases)
    ]
