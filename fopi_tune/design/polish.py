"""The minimum of a smooth function near a point:  Newton's method on central differences.

A pattern search comes close to the worst plant inside of a box, but slowly along the ridge on which plant and frequency
move together.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from fopi_tune.core.bode_form import Array

_STEP = 2e-3
_MOST_STEPS = 5
#: an offset is at most this long
_REACH = 0.5


def minimised(value: Callable[[Array], Array], dimensions: int) -> Array:
    """Where a function is smallest, as far as steps from 0 lead.

    Args:
        value: offsets of shape (n, d) -> values of shape (n,); offsets of 1 are large.
        dimensions: d.

    Returns:
        The offsets, shape (d,); 0 where nothing smaller was found.
    """
    stencil = _stencil(dimensions)
    best, smallest = np.zeros(dimensions), float(value(np.zeros((1, dimensions)))[0])
    for _ in range(_MOST_STEPS):
        gradient, curvature = _derivatives(value(best + _STEP * stencil), dimensions)
        if not np.isfinite(curvature).all() or np.linalg.eigvalsh(curvature).min() <= 0.0:
            break
        step = -np.linalg.solve(curvature, gradient)
        trial = best + step * min(1.0, _REACH / max(float(np.abs(step).max()), 1e-300))
        found = float(value(trial[None, :])[0])
        if not found < smallest:
            break
        best, smallest = trial, found
    return best


def _stencil(d: int) -> Array:
    """The centre, both ways along each axis, and the four corners of each pair of axes; shape (1 + 2 d^2, d)."""
    unit = np.eye(d)
    pairs = [(i, j) for i in range(d) for j in range(i)]
    corners = [a * unit[i] + b * unit[j] for i, j in pairs for a in (1.0, -1.0) for b in (1.0, -1.0)]
    return np.array([np.zeros(d), *unit, *-unit, *corners])


def _derivatives(values: Array, d: int) -> tuple[Array, Array]:
    """Gradient and second derivatives from the values on the stencil."""
    centre, up, down, corners = values[0], values[1 : d + 1], values[d + 1 : 2 * d + 1], values[2 * d + 1 :]
    curvature = np.diag(up - 2.0 * centre + down)
    pairs = [(i, j) for i in range(d) for j in range(i)]
    for (i, j), (both, first, second, neither) in zip(pairs, corners.reshape(-1, 4), strict=True):
        curvature[i, j] = curvature[j, i] = 0.25 * (both - first - second + neither)
    return (up - down) / (2.0 * _STEP), curvature / _STEP**2
