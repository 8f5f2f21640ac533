"""What linear rows leave of a box, beside SciPy's linear programs."""

from __future__ import annotations

import numpy as np
from scipy.optimize import linprog

from fopi_tune.design.bound.polygon import what_is_left


def test_the_projection_of_random_rows_is_that_of_linear_programs() -> None:
    draws = np.random.default_rng(11)
    empty = 0
    for _ in range(60):
        count = int(draws.integers(1, 9))
        rows, left = np.zeros((count, 5)), np.zeros(4)
        rows[:, :3] = draws.normal(size=(count, 3)) * draws.choice([0.0, 1.0, 1.0], (count, 3))
        rows[:, 3] = draws.normal(0.3, 0.6, count)
        ends = []
        for cost in ([0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]):
            found = linprog(cost, rows[:, :3], rows[:, 3], bounds=[(-1, 1)] * 3)
            ends.append(found.fun if found.status == 0 else None)
        if ends[0] is None:
            empty += 1
            assert not what_is_left(rows, count, left)
            continue
        assert what_is_left(rows, count, left)
        # linprog's own tolerance is 1e-7
        np.testing.assert_allclose(left, [ends[0], -ends[1], ends[2], -ends[3]], atol=1e-6)
    assert 5 < empty < 55
