"""Definiteness in balls agrees with eigenvalues, and says no where a ball leaves it open."""

from __future__ import annotations

import numpy as np
import pytest
from flint import arb, arb_mat, ctx

from fopi_tune.proof.switched.definite import (
    is_positive_definite,
    lower_triangle,
    midpoints,
    not_below,
    quadratic_norm,
    symmetric,
)


@pytest.mark.parametrize("seed", range(20))
def test_definiteness_is_that_of_the_eigenvalues(seed: int) -> None:
    rng = np.random.default_rng(seed)
    factor = rng.normal(size=(6, 6))
    matrix = factor @ factor.T - rng.uniform(0.0, 1.0) * np.eye(6)
    least = float(np.linalg.eigvalsh(matrix)[0])
    assert is_positive_definite(symmetric(lower_triangle(matrix))) is (least > 0.0)


def test_a_ball_that_holds_a_singular_matrix_proves_nothing() -> None:
    assert is_positive_definite(arb_mat([[arb(1, 0.5), 0], [0, 1]]))
    assert not is_positive_definite(arb_mat([[arb(1, 1), 0], [0, 1]]))
    assert not is_positive_definite(arb_mat([[1, 1], [1, 1]]))


def test_a_triangle_is_the_symmetric_part() -> None:
    matrix = np.array([[2.0, 1.0], [3.0, 5.0]])
    triangle = lower_triangle(matrix)
    assert triangle == ((2.0,), (2.0, 5.0))
    assert np.array_equal(midpoints(symmetric(triangle)), [[2.0, 2.0], [2.0, 5.0]])
    assert float(quadratic_norm(symmetric(triangle), arb_mat([[1], [1]]))) == pytest.approx(np.sqrt(11.0), rel=1e-15)


def test_a_bound_is_not_below_what_rounding_cuts_off() -> None:
    with ctx.workprec(128):
        assert not_below(arb(1)) == 1.0
        assert not_below(1 + arb(2) ** -60) == 1.0 + 2.0**-52
        assert not_below(-1 + arb(2) ** -60) == -1.0 + 2.0**-53
        assert not_below(arb(1, 2.0**-60)) > 1.0
