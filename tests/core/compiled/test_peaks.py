"""The compiled branch and bound against a dense grid."""

from __future__ import annotations

import numpy as np
import pytest
from cases.random_loops import random_loop

from fopi_tune.core.compiled.peaks import branch_and_bound
from fopi_tune.core.loops import Loops, Plants
from fopi_tune.core.peaks import Response, inverse_response, log_response_at, no_terms

U = np.linspace(-8.0, 8.0, 200_001)
LOW, HIGH = U[:1], U[-1:]


@pytest.mark.thinned(3)
@pytest.mark.parametrize("seed", range(20))
@pytest.mark.parametrize("response", list(Response))
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_the_extreme_is_no_worse_than_on_a_dense_grid_and_is_attained(
    seed: int, response: Response, sign: float
) -> None:
    rng = np.random.default_rng(seed)
    one = random_loop(rng, float(rng.uniform(0.3, 1.7)), 0.1 * (seed % 2))
    loop = Loops.of(one.controller, Plants.of(one.plant))
    rows = np.zeros(len(U), dtype=np.int64)
    grid = sign * log_response_at(loop, response, rows, np.exp(U))
    inverse = inverse_response(loop, response)
    first, *more = (term.terms for term in inverse.terms)
    second = more[0] if more else no_terms()
    none = np.array([-np.inf])
    best, where, cells = branch_and_bound(inverse.one, first, second, LOW, HIGH, sign, none, 10**6)
    # the tolerance of the search
    assert best[0] >= grid.max() - 1e-10
    assert sign * log_response_at(loop, response, rows[:1], np.exp(where))[0] == pytest.approx(best[0], abs=1e-9)
    assert 24 <= cells < 10**6


def test_the_search_ends_where_its_cells_are_spent() -> None:
    loop = Loops.of(random_loop(np.random.default_rng(1), 0.9).controller, Plants(
        np.array([[1.0]]), np.array([[1.0, 1.0]]), np.array([1e4])
    ))  # fmt: skip
    first, none = loop.log.terms, np.array([-np.inf])
    assert branch_and_bound(True, first, no_terms(), LOW, HIGH, 1.0, none, 500)[2] > 500
