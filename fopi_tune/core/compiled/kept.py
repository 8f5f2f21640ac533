"""Functions that Numba compiles and keeps on disk.

Numba's own key of what it keeps holds the source of a function's module, not of the others that it calls functions of;
here the key holds all of them.

This module imports Numba: import it where it is needed.
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

from numba import njit
from numba.core.caching import FunctionCache


def sources(modules: Iterable[Path]) -> tuple[tuple[str, int, int], ...]:
    """Names, sizes and times of modules."""
    return tuple((path.name, path.stat().st_size, path.stat().st_mtime_ns) for path in sorted(modules))


def kept(function: Callable[..., Any], modules: tuple[tuple[str, int, int], ...], **options: Any) -> Any:
    """A function that is compiled when it is first called, and kept on disk where there is a place for it.

    Args:
        function: in the part of Python that Numba knows.
        modules: `sources` of all modules that it is compiled from.
        options: of Numba's `njit`.
    """

    class Cache(FunctionCache):
        def _index_key(self, sig: Any, codegen: Any) -> tuple[Any, ...]:
            return *super()._index_key(sig, codegen), modules

    dispatcher: Any = njit(**options)(function)
    # where neither beside the module nor in the user's cache can be written, every process compiles
    with contextlib.suppress(RuntimeError):
        dispatcher._cache = Cache(function)
    return dispatcher
