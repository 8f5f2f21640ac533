"""Cases of which some are tested each time, and the rest with `-m long`.

A whole test is thinned by a marker, so that the product of its parameters is:

    @pytest.mark.thinned(4)                     one of four cases each time
    @pytest.mark.thinned(4, first=1)            from the second case on
    @pytest.mark.thinned(slow=["late", "wide"]) all but those with such an id

A step that has no common divisor with the number of a parameter's values takes each of them once in a while: of three
by three cases every fourth one is the diagonal.
"""

from __future__ import annotations

from collections import Counter
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


def mark_what_is_thinned(items: Iterable[pytest.Item]) -> None:
    """Give the marker `long` to the cases of tests with the marker `thinned` that are not tested each time."""
    seen: Counter[str] = Counter()
    for item in items:
        marker = item.get_closest_marker("thinned")
        if marker is None or item.get_closest_marker("long") is not None:
            continue
        test, _, case = item.nodeid.partition("[")
        if any(text in case for text in marker.kwargs.get("slow", ())):
            item.add_marker(pytest.mark.long)
            continue
        every = marker.args[0] if marker.args else 1
        if (seen[test] - marker.kwargs.get("first", 0)) % every:
            item.add_marker(pytest.mark.long)
        seen[test] += 1
