"""Compiled crossings against the search in NumPy, which has another bound of the curvature and so other cells."""

from __future__ import annotations

import numpy as np
import pytest
from cases.random_loops import random_loop, random_sampled

from fopi_tune.core.compiled.roots import loop_roots
from fopi_tune.core.controller import FoPi
from fopi_tune.core.loops import Loops, Plants
from fopi_tune.core.parallel_form import Implementation
from fopi_tune.core.roots import find_roots
from fopi_tune.core.sampled_loops import SampledLoops

LOW, HIGH = np.array([-12.0]), np.array([9.0])
ONE = np.zeros(1, dtype=np.int64)


def loops(seed: int) -> Loops:
    rng = np.random.default_rng(seed)
    if seed % 2:
        plant, sections, delay = random_sampled(rng, proper=True)
        return SampledLoops.implemented(FoPi(1.0, 1.0, 1.0), Implementation(sections, delay), Plants.of(plant))
    loop = random_loop(rng, float(rng.uniform(0.3, 1.7)), 0.01 * (seed % 4))
    return Loops.of(loop.controller, Plants.of(loop.plant))


@pytest.mark.thinned(7)
@pytest.mark.parametrize("seed", range(60))
@pytest.mark.parametrize("is_phase", [False, True])
def test_the_roots_are_those_of_the_search_in_numpy(seed: int, is_phase: bool) -> None:
    loop = loops(seed)

    def function(rows, u):
        value, slope = loop.log_response_and_slope(rows, u)
        return (value.imag + np.pi, slope.imag) if is_phase else (value.real, slope.real)

    bound = loop.log.curvature_bound if is_phase else loop.log.gain_curvature_bound
    wanted = find_roots(function, bound, ONE, LOW, HIGH, 2.0 * np.pi if is_phase else None)[1]
    complete, found = loop_roots(is_phase, loop.log.terms, loop.direct, np.zeros(1), ONE, LOW, HIGH)
    assert complete
    # both end by Newton's method at the accuracy of rounding
    assert np.sort(found[:, 1]) == pytest.approx(wanted, abs=1e-9)


def test_more_roots_than_can_be_listed_are_told() -> None:
    loop = Loops.of(FoPi(1.0, 1.0, 1.0), Plants(np.array([[1.0]]), np.array([[1.0, 1.0]]), np.array([1e7])))
    complete, _ = loop_roots(True, loop.log.terms, loop.direct, np.zeros(1), ONE, LOW, HIGH)
    assert not complete
