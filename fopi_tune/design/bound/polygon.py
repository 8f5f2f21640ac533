"""Whether linear rows leave anything of a box in three unknowns, and of which part (compiled).

Unknown are (x0, x1, x2) in [-1, 1]^3; a row is a0 x0 + a1 x1 + a2 x2 <= b.  x0 is eliminated (Fourier and Motzkin):
each pair of an upper bound b/a0 - ... and a lower one leaves a half-plane in (x1, x2), and the square is clipped by all
of them.  What is left is the exact projection of the rows' polytope.

Source: derived; the elimination is Fourier's, the clipping Sutherland and Hodgman's.
"""

from __future__ import annotations

import numpy as np

from fopi_tune.design.global_search.compiled import compiled

#: corners; each half-plane adds at most one
_MOST_CORNERS = 96
#: natural units: what rounding of a row may add up to
_ROUNDING = 1e-11
#: relative to a row's size: a coefficient that counts as 0
_FLAT = 1e-12


@compiled
def add_row(rows, count, a0, a1, a2, b):
    """Append a row that cuts the box: the new number of rows, -1 where nothing of the box is left.

    Where all places are taken it replaces the row that leaves most.
    """
    size = abs(a0) + abs(a1) + abs(a2)
    b += _ROUNDING
    if not b < size:
        return count
    if b < -size:
        return -1
    place = count
    if count == len(rows):
        place = 0
        for r in range(count):
            if rows[r, 4] > rows[place, 4]:
                place = r
        if rows[place, 4] <= b / size:
            return count
        count -= 1
    rows[place, 0], rows[place, 1], rows[place, 2], rows[place, 3], rows[place, 4] = a0, a1, a2, b, b / size
    return count + 1


@compiled
def add_limit(rows, count, way, value, a0, a1, a2, limit, rest):
    """Append way (value + a x) <= way limit + rest, as `add_row`; nothing after a row that left nothing."""
    if count < 0:
        return count
    return add_row(rows, count, way * a0, way * a1, way * a2, way * (limit - value) + rest)


@compiled
def _clip(corners, other, count, p, q, w):
    """Cut the polygon in `corners` by p x + q y <= w: the number of corners, 0 where nothing is left."""
    made, inside = 0, True
    for r in range(count):
        inside = inside and p * corners[r, 0] + q * corners[r, 1] <= w
    if inside:
        return count
    for r in range(count):
        s = r + 1 if r + 1 < count else 0
        here, there = p * corners[r, 0] + q * corners[r, 1] - w, p * corners[s, 0] + q * corners[s, 1] - w
        if here <= 0.0:
            other[made, 0], other[made, 1] = corners[r, 0], corners[r, 1]
            made += 1
        if (here < 0.0 < there) or (there < 0.0 < here):
            part = here / (here - there)
            other[made, 0] = corners[r, 0] + part * (corners[s, 0] - corners[r, 0])
            other[made, 1] = corners[r, 1] + part * (corners[s, 1] - corners[r, 1])
            made += 1
    for r in range(made):
        corners[r, 0], corners[r, 1] = other[r, 0], other[r, 1]
    return made


@compiled
def what_is_left(rows, count, left):
    """Whether the rows leave anything of the box; `left` becomes (lowest x1, highest x1, lowest x2, highest x2)."""
    corners, other = np.empty((_MOST_CORNERS, 2)), np.empty((_MOST_CORNERS, 2))
    corners[0, 0], corners[0, 1], corners[1, 0], corners[1, 1] = -1.0, -1.0, 1.0, -1.0
    corners[2, 0], corners[2, 1], corners[3, 0], corners[3, 1] = 1.0, 1.0, -1.0, 1.0
    number = 4
    for r in range(count):
        a0, a1, a2, b = rows[r, 0], rows[r, 1], rows[r, 2], rows[r, 3]
        if b + abs(a0) < abs(a1) + abs(a2):
            number = _clip(corners, other, number, a1, a2, b + abs(a0))
        if number == 0:
            return False
        if a0 <= _FLAT * (abs(a1) + abs(a2)):
            continue
        for s in range(count):
            if rows[s, 0] < -_FLAT * (abs(rows[s, 1]) + abs(rows[s, 2])):
                p, q = a1 / a0 - rows[s, 1] / rows[s, 0], a2 / a0 - rows[s, 2] / rows[s, 0]
                w = b / a0 - rows[s, 3] / rows[s, 0]
                if w < abs(p) + abs(q) and number < _MOST_CORNERS - 2:
                    number = _clip(corners, other, number, p, q, w)
    if number == 0:
        return False
    left[0] = left[2] = 1.0
    left[1] = left[3] = -1.0
    for r in range(number):
        left[0], left[1] = min(left[0], corners[r, 0]), max(left[1], corners[r, 0])
        left[2], left[3] = min(left[2], corners[r, 1]), max(left[3], corners[r, 1])
    return True
