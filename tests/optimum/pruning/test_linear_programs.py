"""Weights of sums of linear bounds, against SciPy's linear programs."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import linprog

from fopi_tune.optimum.pruning.linear_programs import best_weights


@pytest.mark.parametrize("axes", [2, 3])
def test_the_value_is_that_of_the_dual_program_and_few_weights_reach_it(axes: int) -> None:
    pick, rows = np.random.default_rng(axes), 40
    slopes = pick.normal(size=(60, rows, axes))
    slopes /= np.abs(slopes).sum(axis=2, keepdims=True)
    middle = pick.uniform(-0.9, 0.4, size=(60, rows))
    middle[:, -5:], slopes[:, -5:] = -1e9, 0.0  # no rows
    values, weights = best_weights(middle, slopes)
    assert np.all(weights >= 0.0)
    assert np.allclose(weights.sum(axis=1), 1.0)
    assert (weights > 1e-12).sum(axis=1).max() <= axes + 1
    for value, c, g in zip(values, middle, slopes, strict=True):
        # the least t with c_r + g_r x <= t for all rows and some x of the box
        found = linprog(
            np.append(np.zeros(axes), 1.0),
            A_ub=np.column_stack([g, -np.ones(rows)]),
            b_ub=-c,
            bounds=[(-1.0, 1.0)] * axes + [(None, None)],
        )
        assert value == pytest.approx(found.fun, abs=1e-8)
