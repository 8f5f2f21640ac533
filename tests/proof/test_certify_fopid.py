"""Never a wrong proof of a derivative of any order:  limits 1e-5 around the worst case, against a dense evaluation.

Plants of order 1 to 4 with none up to two uncertain numbers, late or not; gains of either sign, without a term, or with
a derivative that dominates.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from cases.limits_told_apart import SLOW_S, outcomes
from cases.random_fopids import fopid_for, mirrored
from cases.random_pids import plants_of, uncertain
from oracles.fopid_loops import FopidFamily

#: of the random numbers
SALT = 31


def _family(rng: np.random.Generator) -> FopidFamily:
    plants = uncertain(rng, plants_of(rng))
    found = fopid_for(rng, plants)
    return FopidFamily(*(mirrored(plants, found) if rng.random() < 0.15 else (plants, found)))


@pytest.mark.parametrize(("seeds", "least"), [(range(10), 6), pytest.param(range(10, 30), 13, marks=pytest.mark.long)])
def test_limits_around_the_worst_case_of_a_fopid_are_told_apart(seeds: range, least: int) -> None:
    counted, undecided, _ = outcomes(seeds, _family, SALT)
    assert undecided == []
    assert counted["told apart"] >= least, counted


@pytest.mark.long
@pytest.mark.parametrize("block", range(3))
def test_limits_around_the_worst_cases_of_nearly_two_hundred_fopids_are_told_apart(
    block: int, record_property: Callable[[str, object], None]
) -> None:
    counted, undecided, times = outcomes(range(1000 + 60 * block, 1060 + 60 * block), _family, SALT)
    record_property("outcomes", dict(counted))
    print(dict(counted), "undecided:", undecided, "slow:", [round(t, 1) for t in times if t > SLOW_S], max(times))
    assert len(undecided) <= 1, undecided
    assert counted["told apart"] >= 40
