"""One side of fractional plants, sum c_j s^e_j:  its values on the imaginary axis, its roots there, where it bends."""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import numpy as np

from fopi_tune.core.bode_form import Array, Complex
from fopi_tune.core.fractional_plants.orders import MOST_TERMS
from fopi_tune.errors import DomainError

#: relative to the sum of the terms' sizes; a side this small on the axis is 0 there
ON_AXIS = 1e-9
#: places of a search for resonances, and the part of the terms' sizes below which there is one
_SCAN, _RESONANT = 400, 0.5
#: sides whose sums are kept
_KEPT = 20_000


def sums_of(orders: tuple[float, ...], coefficients: Array) -> tuple[Array, Array, Array]:
    """Of each row c_0 and e_0, shape (m,), and the table of G, shape (m, 6, n), in (1) of `plants.py`."""
    if not len(coefficients):
        return np.zeros(0), np.zeros(0), np.zeros((0, 6, max(len(orders), 2)))
    every = [_sum_of(orders, tuple(row)) for row in coefficients.tolist()]
    return np.array([e[0] for e in every]), np.array([e[1] for e in every]), np.array([e[2] for e in every])


@lru_cache(_KEPT)
def _sum_of(orders: tuple[float, ...], coefficients: tuple[float, ...]) -> tuple[float, float, Array]:
    """c_0, e_0 and the table of G in (1) of `plants.py`."""
    from fopi_tune.core.compiled.power_sums import table_of

    if not any(coefficients):
        raise DomainError("the numerator is 0: there is no plant to control")
    return table_of(orders, coefficients, max(len(orders), 2))


def side_values(orders: tuple[float, ...], coefficients: Array, omega: Array) -> Complex:
    """A side at j omega; coefficients (n, terms), omega (n,)."""
    found = np.zeros(len(omega), dtype=complex)
    for k, order in enumerate(orders):
        found += coefficients[:, k] * omega**order * _turn(order)
    return found


def _turn(order: float) -> complex:
    """j^order."""
    whole = {0: 1.0, 1: 1j, 2: -1.0, 3: -1j}
    return complex(whole[int(order) % 4]) if order == int(order) else complex(np.exp(0.5j * np.pi * order))


def _sizes(orders: tuple[float, ...], coefficients: Array, omega: Array) -> Array:
    """The sum of the terms' absolute values."""
    return np.asarray(sum(np.abs(coefficients[:, k]) * omega**order for k, order in enumerate(orders)))


def axis_roots(orders: tuple[float, ...], coefficients: Array) -> Complex:
    """Roots of sides on the imaginary axis, shape (m, 1 + MOST_TERMS): 0, and j omega with omega > 0."""
    from fopi_tune.core.compiled.power_sums import sign_changes

    found = np.full((len(coefficients), 1 + MOST_TERMS), np.inf + 0j)
    for row, own in enumerate(coefficients.tolist()):
        _, first, table = _sum_of(orders, tuple(own))
        if first > 0.0:
            found[row, 0] = 0.0
        terms = [term for term in zip(*table[:4].tolist(), strict=True) if term[1] > -np.inf]
        real, imaginary = ([(q, b, parts[k]) for q, b, *parts in terms if parts[k]] for k in (0, 1))
        omega = np.exp(np.array(sign_changes(imaginary or real)))
        values, sizes = (
            f(orders, np.repeat(coefficients[row : row + 1], len(omega), axis=0), omega) for f in (side_values, _sizes)
        )
        there = omega[np.abs(values) <= ON_AXIS * sizes][:MOST_TERMS]
        found[row, 1 : 1 + len(there)] = 1j * there
    return found


def bends(orders: tuple[float, ...], coefficients: Array) -> Complex:
    """-omega where two neighbouring terms of a side are equal."""
    found: list[Any] = []
    with np.errstate(divide="ignore", over="ignore", invalid="ignore"):
        for k in range(len(orders) - 1):
            ratio = np.abs(coefficients[:, k + 1] / coefficients[:, k])
            found.append(ratio ** (1.0 / (orders[k] - orders[k + 1])))
    roots = np.concatenate(found) if found else np.zeros(0)
    return -roots[np.isfinite(roots) & (roots > 1e-100) & (roots < 1e100)].astype(complex)


def resonances(orders: tuple[float, ...], coefficients: Array) -> Complex:
    """Where a side is much smaller than its terms:  omega (-r + j sqrt(1 - r^2)), r its part of them."""
    places = np.abs(bends(orders, coefficients))
    if not len(places):
        return np.zeros(0, dtype=complex)
    omega = np.geomspace(0.1 * places.min(), 10.0 * places.max(), _SCAN)
    m, n = len(coefficients), len(omega)
    rows, every = np.repeat(coefficients, n, axis=0), np.tile(omega, m)
    part = (np.abs(side_values(orders, rows, every)) / _sizes(orders, rows, every)).reshape(m, n)
    inner = part[:, 1:-1]
    lowest = (inner < _RESONANT) & (inner <= part[:, :-2]) & (inner < part[:, 2:])
    row, column = np.nonzero(lowest)
    r = inner[row, column]
    return np.asarray(omega[1 + column] * (-r + 1j * np.sqrt(1.0 - r * r)))
