"""How many threads simulate and scan plants:  one a core, or as many as the variable FOPI_THREADS says."""

from __future__ import annotations

import os

#: set to 1 where many processes share a machine, as the workers of a study do
VARIABLE = "FOPI_THREADS"


def threads() -> int:
    """At least 1; a variable that is no positive number is not heard."""
    wanted = os.environ.get(VARIABLE, "")
    if wanted.isdecimal() and int(wanted) > 0:
        return int(wanted)
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
