"""All roots:  of polynomials by eigenvalues, of smooth functions on intervals by bisection.

A cell [a, b] with centre c and half-width h, and a bound B of a function's |f''| on it, holds

    no root          if |f(c)| > |f'(c)| h + B h^2/2 ,
    at most one      if |f'(c)| > B h   (f is monotone there) ,

and is halved otherwise.  Cells of many functions are processed together.  Where neither test succeeds down to the
smallest width, f touches zero or crosses it with a slope of almost 0; the point is returned once.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from fopi_tune.core.bode_form import Array, Complex, Rows
from fopi_tune.errors import DomainError

#: (rows, u) -> (value, slope)
Function = Callable[[Rows, Array], tuple[Array, Array]]
#: (rows, low, high) -> bound of the second derivative's absolute value
Curvature = Callable[[Rows, Array, Array], Array]

FIRST_CELLS = 12
SMALLEST_WIDTH = 1e-9
MOST_CELLS = 400_000
TOUCH = 1e-12
#: allowance for rounding in the test for a root, relative and absolute
WIDER, ROUNDING = 1.0 + 1e-9, 1e-15
#: a Newton step this small may be rounding alone
LAST_STEP = 1e-12
#: f is taken as constant at its level where it stays this close to it over a cell at least this wide
FLAT, FLAT_WIDTH = 1e-14, 1e-6


def find_roots(
    function: Function, curvature: Curvature, rows: Rows, low: Array, high: Array, period: float | None = None
) -> tuple[Rows, Array]:
    """Every root of f in [low, high], for many functions at once.

    Args:
        function: value and slope, vectorised.
        curvature: bound of |f''| on intervals, vectorised.
        rows: shape (m,), indices of the functions, passed to `function` and `curvature`.
        low, high: shape (m,), the intervals.
        period: when given, f = k * period for any whole k counts as a root.

    Returns:
        (rows (n,), roots (n,)), sorted by row, then by root; relative accuracy of rounding.

    Raises:
        DomainError: the functions have too many roots to list (a huge dead time against the loop's own time).
    """
    bracket_rows, left, right, level, touching_rows, touching = _isolate(function, curvature, rows, low, high, period)
    roots = _polish(function, bracket_rows, left, right, level)
    all_rows = np.concatenate([bracket_rows, touching_rows])
    all_roots = np.concatenate([roots, touching])
    order = np.lexsort((all_roots, all_rows))
    return all_rows[order], all_roots[order]


def _isolate(
    function: Function, curvature: Curvature, rows: Rows, low: Array, high: Array, period: float | None
) -> tuple[Rows, Array, Array, Array, Rows, Array]:
    """Split until every cell has no root, is monotone, or is too small; monotone cells become brackets."""
    share = np.arange(FIRST_CELLS + 1) / FIRST_CELLS
    edges = low[:, None] + (high - low)[:, None] * share
    edges[:, -1] = high
    r, a, b = np.repeat(rows, FIRST_CELLS), edges[:, :-1].ravel(), edges[:, 1:].ravel()
    brackets: list[tuple[Rows, Array, Array]] = []
    touching: list[tuple[Rows, Array]] = []
    work = 0
    while len(r):
        work += len(r)
        if work > MOST_CELLS:
            raise DomainError(_too_often(function(r, 0.5 * (a + b))[0], period))
        c, h = 0.5 * (a + b), 0.5 * (b - a)
        value, slope = function(r, c)
        bound = curvature(r, a, b)
        reach = np.abs(slope) * h + 0.5 * bound * h**2
        distance = np.abs(value) if period is None else np.abs(value - period * np.round(value / period))
        # A root on the edge between two cells must survive in both, whatever rounding does to the equality.
        # A function that lies on its level over a wide cell does not cross it there.
        maybe = (distance <= reach * WIDER + ROUNDING) & ((distance + reach > FLAT) | (h < FLAT_WIDTH))
        monotone = maybe & (np.abs(slope) > bound * h)
        brackets.append((r[monotone], a[monotone], b[monotone]))
        rest = maybe & ~monotone
        tiny = rest & (h < SMALLEST_WIDTH)
        if tiny.any():
            touch = tiny & (distance < TOUCH)
            touching.append((r[touch], c[touch]))
            brackets.append((r[tiny & ~touch], a[tiny & ~touch], b[tiny & ~touch]))
        split = rest & ~tiny
        r = np.concatenate([r[split], r[split]])
        a, b = np.concatenate([a[split], c[split]]), np.concatenate([c[split], b[split]])
    nothing = (np.zeros(0, dtype=np.intp), np.zeros(0), np.zeros(0))
    r, a, b = (np.concatenate(part) for part in zip(nothing, *brackets, strict=True))
    touching_rows, touched = merged(touching)
    return *_brackets_of_levels(function, r, a, b, period), touching_rows, touched


def _too_often(values: Array, period: float | None) -> str:
    """Why the roots cannot be listed, from the values in the middle of the cells that are left."""
    distance = np.abs(values if period is None else values - period * np.round(values / period))
    if np.mean(distance < TOUCH) > 0.5:
        line = "|L| = 1" if period is None else "arg L = -180 deg"
        return (
            f"{line} over a whole range of frequencies, up to rounding, so that there are no single crossings: the "
            "controller and the plant's zeros cancel the plant's poles; take other gains, or a plant without equal "
            "poles and zeros"
        )
    return (
        "the loop crosses its critical lines too often to list every crossing; "
        "the dead time is too long against the plant's other time constants"
    )


def _brackets_of_levels(
    function: Function, r: Rows, a: Array, b: Array, period: float | None
) -> tuple[Rows, Array, Array, Array]:
    """Brackets with a change of sign, one for each level that a monotone cell passes."""
    fa, fb = function(r, a)[0], function(r, b)[0]
    if period is None:
        change = (fa >= 0) != (fb >= 0)
        return r[change], a[change], b[change], np.zeros(int(change.sum()))
    # Half-open at the upper value on both sides, so that neighbours count a root on their common edge once.
    below = np.ceil(np.minimum(fa, fb) / period)
    above = np.ceil(np.maximum(fa, fb) / period)
    count = np.maximum(above - below, 0).astype(np.intp)
    if count.sum() > MOST_CELLS:
        raise DomainError("the phase passes -180 deg too often to list; the dead time is far too long for this loop")
    index = np.repeat(np.arange(len(r)), count)
    step = np.arange(len(index)) - np.repeat(np.cumsum(count) - count, count)
    return r[index], a[index], b[index], np.asarray((below[index] + step) * period, dtype=float)


def _polish(function: Function, rows: Rows, a: Array, b: Array, level: Array) -> Array:
    """Newton's method safeguarded by bisection, to the accuracy of rounding."""
    if not len(rows):
        return a
    rising = function(rows, a)[0] < function(rows, b)[0]
    u, before = 0.5 * (a + b), np.full(len(a), np.inf)
    for _ in range(100):
        value, slope = function(rows, u)
        value = value - level
        right_of_root = (value >= 0) == rising
        b, a = np.where(right_of_root, u, b), np.where(right_of_root, a, u)
        with np.errstate(divide="ignore", invalid="ignore"):
            step = np.where(value == 0, 0.0, -value / slope)
        size = np.abs(step)
        # At the root rounding decides the step's sign: a step that no longer shrinks is the last one.
        resolution = 4e-16 * np.maximum(1.0, np.abs(u))
        done = (np.minimum(size, b - a) <= resolution) | ((size <= LAST_STEP) & (size > 0.25 * before))
        # The root may be an end of the bracket itself.
        inside = (u + step > a - resolution) & (u + step < b + resolution)
        u = np.where(done, u, np.where(inside, u + step, 0.5 * (a + b)))
        if done.all():
            break
        before = np.where(inside, size, np.inf)
    return u


def merged(touching: list[tuple[Rows, Array]]) -> tuple[Rows, Array]:
    """Touching points, those of neighbouring cells merged."""
    if not touching:
        return np.zeros(0, dtype=np.intp), np.zeros(0)
    r = np.concatenate([t[0] for t in touching])
    u = np.concatenate([t[1] for t in touching])
    order = np.lexsort((u, r))
    r, u = r[order], u[order]
    keep = np.ones(len(r), dtype=bool)
    keep[1:] = (r[1:] != r[:-1]) | (u[1:] - u[:-1] > 10 * SMALLEST_WIDTH)
    return r[keep], u[keep]


def _pairs(first: Rows, last: Rows) -> set[tuple[int, int]]:
    """The different pairs of two columns; most families have one."""
    if len(first) and np.all(first == first[0]) and np.all(last == last[0]):
        return {(int(first[0]), int(last[0]))}
    return set(zip(first.tolist(), last.tolist(), strict=True))


def polynomial_roots(coefficients: Array) -> Complex:
    """Roots of m polynomials.

    Args:
        coefficients: shape (m, n + 1), descending powers.

    Returns:
        Shape (m, n); exact zeros for roots at the origin, inf in place of roots that leading zero coefficients remove.

    Raises:
        DomainError: a quotient of coefficients is beyond the range of floating-point numbers.
    """
    rows, width = coefficients.shape
    roots = np.full((rows, width - 1), np.inf + 0j, dtype=complex)
    nonzero = coefficients != 0.0
    first = np.argmax(nonzero, axis=1)
    last = width - 1 - np.argmax(nonzero[:, ::-1], axis=1)
    for start, stop in _pairs(first, last):
        group = np.flatnonzero((first == start) & (last == stop))
        degree = stop - start
        roots[group, degree : degree + width - 1 - stop] = 0.0
        if degree:
            companion = np.zeros((len(group), degree, degree))
            companion[:, 1:, :-1] = np.eye(degree - 1)
            with np.errstate(over="ignore"):
                companion[:, 0, :] = -coefficients[group, start + 1 : stop + 1] / coefficients[group, start, None]
            if not np.isfinite(companion).all():
                raise DomainError(
                    "coefficients of a plant's polynomial differ by more than a floating-point number can hold; "
                    "take numbers of the plant that are neither that small nor that large"
                )
            # the eigenvalue of a single number is that number
            roots[group, :degree] = companion[:, 0] if degree == 1 else np.linalg.eigvals(companion)
    return roots


def polynomial_at(coefficients: Array, s: Complex) -> Complex:
    """Polynomials of shape (n, d + 1), descending powers, at one point s each, shape (n,)."""
    value = np.zeros_like(s)
    for k in range(coefficients.shape[1]):
        value = value * s + coefficients[:, k]
    return value


def times(coefficients: Array, factor: tuple[float, ...]) -> Array:
    """Polynomials of shape (m, n + 1) times one with d + 1 coefficients, shape (m, n + d + 1); descending powers."""
    if factor == (1.0,):
        return coefficients
    product = np.zeros((len(coefficients), coefficients.shape[1] + len(factor) - 1))
    for k, number in enumerate(factor):
        product[:, k : k + coefficients.shape[1]] += number * coefficients
    return product


def leading_coefficients(coefficients: Array) -> Array:
    """The first nonzero coefficient of each row, shape (m,)."""
    first = np.argmax(coefficients != 0.0, axis=1)
    return coefficients[np.arange(len(coefficients)), first]
