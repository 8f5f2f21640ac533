"""Newton's method on differences."""

from __future__ import annotations

import numpy as np
import pytest

from fopi_tune.design.polish import minimised


@pytest.mark.parametrize("d", [1, 2, 3, 4])
def test_the_minimum_of_a_narrow_valley_is_found(d: int) -> None:
    rng = np.random.default_rng(d)
    # a valley 100 times as long as it is wide, in a direction of its own
    axes = np.linalg.qr(rng.normal(size=(d, d)))[0]
    matrix = axes @ np.diag(np.geomspace(0.01, 100.0, d)) @ axes.T
    centre = rng.uniform(-0.3, 0.3, d)

    def value(z: np.ndarray) -> np.ndarray:
        away = z - centre
        return np.einsum("ni,ij,nj->n", away, matrix, away) + 0.1 * np.sin(z[:, 0] - centre[0]) ** 4

    assert minimised(value, d) == pytest.approx(centre, abs=1e-6)


def test_nothing_is_moved_where_there_is_no_minimum() -> None:
    assert minimised(lambda z: -np.sum(z**2, axis=1), 2) == pytest.approx([0.0, 0.0], abs=0.0)
    assert minimised(lambda z: z[:, 0] + 0.0 * z[:, 1], 2) == pytest.approx([0.0, 0.0], abs=0.0)
