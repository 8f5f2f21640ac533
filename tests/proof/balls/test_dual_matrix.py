"""Matrices of balls with derivatives, against the same sums of numbers with derivatives."""

from __future__ import annotations

import numpy as np
import pytest
from flint import arb

from fopi_tune.proof.balls.dual_matrix import DualMatrix
from fopi_tune.proof.balls.plant import Dual


def _rows(rng: np.random.Generator, n: int, m: int, axes: list[int]) -> list[list[Dual]]:
    def number() -> Dual:
        gradient = {axis: arb(float(rng.normal())) for axis in axes if rng.random() < 0.7}
        return Dual(arb(float(rng.normal()), float(rng.uniform(0.0, 0.1))), gradient)

    return [[number() for _ in range(m)] for _ in range(n)]


def _is_equal(one: Dual, other: Dual) -> bool:
    """The same balls, in the value and in every derivative, to rounding: a product's middle has its radius' 30 bits."""
    axes = set(one.gradient) | set(other.gradient)
    pairs = [(one.value, other.value)]
    pairs += [(one.gradient.get(axis, arb(0)), other.gradient.get(axis, arb(0))) for axis in axes]
    return all(
        abs(float(a.mid()) - float(b.mid())) < 1e-8 and abs(float(a.rad()) - float(b.rad())) < 1e-7 for a, b in pairs
    )


@pytest.mark.parametrize("seed", range(4))
def test_products_and_sums_are_those_of_numbers(seed: int) -> None:
    rng = np.random.default_rng(seed)
    n, m, k = (int(x) for x in rng.integers(1, 5, 3))
    left, right, more = _rows(rng, n, m, [1, 2]), _rows(rng, m, k, [2, 5]), _rows(rng, n, k, [])
    factor = Dual(arb(0.5), {2: arb(-1.5)})
    found = DualMatrix.of(left) @ DualMatrix.of(right) - DualMatrix.of(more) * factor
    for i in range(n):
        for j in range(k):
            wanted = Dual.of(0)
            for h in range(m):
                wanted = wanted + left[i][h] * right[h][j]
            assert _is_equal(found.entry(i, j), wanted - more[i][j] * factor)


def test_the_trace_is_the_sum_of_the_diagonal() -> None:
    rows = _rows(np.random.default_rng(7), 3, 3, [1, 4])
    assert _is_equal((DualMatrix.of(rows) + DualMatrix.identity(3)).trace(), rows[0][0] + rows[1][1] + rows[2][2] + 3)
    assert DualMatrix.identity(3).size == 3
