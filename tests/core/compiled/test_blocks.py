"""Places that are computed together against one after the other: the same bits."""

from __future__ import annotations

import numpy as np
import pytest
from cases.random_loops import random_loop, random_sampled

from fopi_tune.core.compiled.blocks import FEWEST, GAIN, OF_GAIN, OF_PHASE, PHASE, bode_block, loop_block, slope_block
from fopi_tune.core.compiled.loops import bode_at, entry, loop_at, slope_at
from fopi_tune.core.controller import FoPi, FoPid
from fopi_tune.core.loops import Loops, Plants
from fopi_tune.core.parallel_form import Implementation
from fopi_tune.core.sampled_loops import SampledLoops

#: ends of the cells: inside what is multiplied, and beyond it where exponentials are taken
RANGES = ((-25.0, 25.0), (250.0, 350.0), (-320.0, -280.0))


def loops(seed: int) -> Loops:
    """One loop: continuous with and without a dead time, on samples, with a derivative of any order."""
    rng = np.random.default_rng(seed)
    if seed % 4 == 2:
        plant, sections, delay = random_sampled(rng, proper=True)
        return SampledLoops.implemented(FoPi(1.0, 1.0, 1.0), Implementation(sections, delay), Plants.of(plant))
    loop = random_loop(rng, float(rng.uniform(0.3, 1.7)), 0.3 * (seed % 4 == 1))
    gains = FoPid(1.0, 0.5, 0.8, 0.3, 0.6, 0.1) if seed % 4 == 3 else loop.controller
    return Loops.of(gains, Plants.of(loop.plant))


@entry
def computed(terms, direct, low, high, is_phase):
    """Of each cell what `bode_at` and `loop_at` give, from blocks and one by one, and slopes in both ways."""
    n = len(low)
    together, alone = np.empty((11, n)), np.empty((11, n))
    s, t = bode_block(terms, 0, low, high, n), loop_block(terms, direct, 0, low, high, n, is_phase)
    u, slopes = 0.5 * (low + high), np.empty((n, 2))
    slope_block(terms, 0, u, slopes)
    for i in range(n):
        h = 0.5 * (high[i] - low[i])
        one, other = bode_at(terms, 0, u[i], h), loop_at(terms, direct, 0, u[i], h)
        for k in range(7):
            together[k, i], alone[k, i] = s[k, i], one[k]
        value, bound = (PHASE, OF_PHASE) if is_phase else (GAIN, OF_GAIN)
        together[7, i], alone[7, i] = t[value, i], other[value]
        together[8, i], alone[8, i] = t[bound, i], other[bound]
        along, across = slope_at(terms, 0, u[i])
        together[9, i], together[10, i] = slopes[i, 0], slopes[i, 1]
        alone[9, i], alone[10, i] = along, across
    return together, alone


@pytest.mark.thinned(5)
@pytest.mark.parametrize("seed", range(40))
def test_a_block_has_the_same_bits_as_its_places_alone(seed: int) -> None:
    loop = loops(seed)
    for low, high in RANGES:
        for count in (1, FEWEST, 33, 64):
            ends = np.linspace(low, high, count + 1)
            for is_phase in (False, True):
                together, alone = computed(
                    loop.log.terms, loop.direct, ends[:-1].copy(), ends[1:].copy(), is_phase
                )  # fmt: skip
                assert together.tobytes() == alone.tobytes()
