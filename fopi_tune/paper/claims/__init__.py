"""The groups of claims by name, in the order of the paper."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from importlib import import_module

from fopi_tune.paper.table import Row


def _group(name: str) -> Callable[[], tuple[Row, ...]]:
    """The function of a group: it has its module's name, which is loaded when it is first called."""

    def rows() -> tuple[Row, ...]:
        return getattr(import_module(f"fopi_tune.paper.claims.{name}"), name)()

    return rows


CLAIMS: Mapping[str, Callable[[], tuple[Row, ...]]] = {
    name: _group(name)
    for name in (
        "throttle",
        "brake",
        "gain_margin",
        "filters",
        "hybrid",
        "settling",
        "manoeuvre",
        "experiments",
        "fopi_vs_pi",
    )
}
