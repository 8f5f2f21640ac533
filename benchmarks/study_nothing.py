"""A registry of claims that compute nothing, for what a cell costs beside its own work."""

from __future__ import annotations

from collections.abc import Callable, Mapping

COUNT = 4000


def _nothing() -> tuple[()]:
    return ()


CLAIMS: Mapping[str, Callable[[], tuple[()]]] = {f"nothing_{i}": _nothing for i in range(COUNT)}
