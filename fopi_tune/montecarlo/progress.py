"""Progress of what takes long, as lines of the log:  every few seconds how far it is, for notebooks and services.

The command line shows bars of its own on a terminal; who calls from Python sees these lines after
`logging.basicConfig(level="INFO")`, and may give a callback besides.
"""

from __future__ import annotations

import logging
import time
from collections.abc import Callable

#: called with how many are done, and of how many
Progress = Callable[[int, int], None]

_log = logging.getLogger(__name__)
#: seconds between two lines
_EVERY_S = 2.0


def logged_progress(what: str, then: Progress | None = None, clock: Callable[[], float] = time.monotonic) -> Progress:
    """A callback that writes lines to the log at level INFO, and calls another one each time.

    Args:
        what: of which there are so many: "brake: plants drawn".
        then: the caller's own; None for none.
        clock: seconds that only rise.
    """
    start = last = clock()

    def told(done: int, of: int) -> None:
        nonlocal last
        now = clock()
        if now - last >= _EVERY_S:
            last = now
            rate = done / (now - start)
            _log.info("%s: %d of %d, %.3g/s, %.0f s left", what, done, of, rate, (of - done) / rate if rate else 0.0)
        if then is not None:
            then(done, of)

    return told
