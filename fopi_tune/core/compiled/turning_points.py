"""Turning points of ln|f| and of arg f over u, from a sorted grid (compiled)."""

from __future__ import annotations

import numpy as np

from fopi_tune.core.compiled.blocks import slope_block
from fopi_tune.core.compiled.loops import entry, inner, slope_at

_HALVINGS = 36
#: stop the search at a slope this small, or an interval in u this narrow
_TURNED, _NARROW = 1e-10, 1e-11


@inner
def _sign_change(part, terms, r, a, b, at_a, at_b):
    """The root of a slope between two ends, by the Illinois method; every third step is a bisection."""
    rising, x, kept_b, kept_a = at_a > 0.0, 0.5 * (a + b), False, False
    for step in range(3 * _HALVINGS):
        x = 0.5 * (a + b) if step % 3 == 2 else min(max(b - at_b * (b - a) / (at_b - at_a), a), b)
        at_x = slope_at(terms, r, x)[part]
        if abs(at_x) < _TURNED or b - a < _NARROW:
            break
        if (at_x > 0.0) == rising:
            # Illinois: halve the value at an end that is kept twice
            a, at_a, kept_a = x, at_x, False
            if kept_b:
                at_b *= 0.5
            kept_b = True
        else:
            b, at_b, kept_b = x, at_x, False
            if kept_a:
                at_a *= 0.5
            kept_a = True
    return x


@entry
def turning_points(terms, grid, flat):
    """Where d ln|f|/du or d arg f/du changes its sign.

    Args:
        terms: m functions in Bode form.
        grid: shape (m, n), sorted u.
        flat: slopes below this are rounding errors.

    Returns:
        Shape (k, 4): 0 for ln|f| or 1 for arg f, the function, u, and 1 for a maximum or 0 for a minimum; of each
        part in the order of functions and u.
    """
    found, count = np.empty((256, 4)), 0
    m, n = grid.shape
    slopes = np.empty((m, n, 2))
    for r in range(m):
        slope_block(terms, r, grid[r], slopes[r])
    for part in range(2):
        for r in range(m):
            last = -1
            for k in range(n):
                here = slopes[r, k, part]
                if abs(here) <= flat:
                    continue
                if last >= 0 and (here > 0.0) != (slopes[r, last, part] > 0.0):
                    if count == len(found):
                        longer = np.empty((2 * count, 4))
                        longer[:count] = found
                        found = longer
                    before = slopes[r, last, part]
                    u = _sign_change(part, terms, r, grid[r, last], grid[r, k], before, here)
                    found[count, 0], found[count, 1], found[count, 2] = part, r, u
                    found[count, 3] = 1.0 if before > 0.0 else 0.0
                    count += 1
                last = k
    return found[:count]
