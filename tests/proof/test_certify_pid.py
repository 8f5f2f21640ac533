"""Never a wrong proof of a PID:  limits 1e-5 beyond the worst case and short of it, against a dense evaluation.

Plants of order 1 to 4 with none up to two uncertain numbers, late or not; gains of either sign, without a term, or with
a derivative that dominates.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from cases.limits_told_apart import SLOW_S, outcomes
from cases.random_pids import mirrored, pid_for, plants_of, uncertain
from oracles.pid_loops import PidFamily

#: of the random numbers
SALT = 21


def _family(rng: np.random.Generator) -> PidFamily:
    plants = uncertain(rng, plants_of(rng))
    pid = pid_for(rng, plants)
    return PidFamily(*(mirrored(plants, pid) if rng.random() < 0.15 else (plants, pid)))


@pytest.mark.parametrize(("seeds", "least"), [(range(10), 6), pytest.param(range(10, 40), 24, marks=pytest.mark.long)])
def test_limits_around_the_worst_case_of_a_pid_are_told_apart(seeds: range, least: int) -> None:
    counted, undecided, _ = outcomes(seeds, _family, SALT)
    assert undecided == []
    assert counted["told apart"] >= least, counted


@pytest.mark.long
@pytest.mark.parametrize("block", range(3))
def test_limits_around_the_worst_cases_of_nearly_two_hundred_pids_are_told_apart(
    block: int, record_property: Callable[[str, object], None]
) -> None:
    counted, undecided, times = outcomes(range(1000 + 60 * block, 1060 + 60 * block), _family, SALT)
    record_property("outcomes", dict(counted))
    print(dict(counted), "undecided:", undecided, "slow:", [round(t, 1) for t in times if t > SLOW_S], max(times))
    assert len(undecided) <= 1, undecided
    assert counted["told apart"] >= 45
