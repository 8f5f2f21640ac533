"""Random loops, limits 1e-4 beside the worst value of simulations: no wrong proof, no wrong refutation."""

from __future__ import annotations

import math

import numpy as np
import pytest
from cases.time_domain_cases import at_most, random_case, sampled_worst, simulated

from fopi_tune.proof.certificate import Verdict
from fopi_tune.proof.time_domain import prove_limit, recheck_limit
from fopi_tune.proof.time_domain.case import TimeDomainCase

OFFSET = 1e-4
#: above the rounding of a simulation
SIMULATED = 1e-8


def unit_of(case: TimeDomainCase, worst: float) -> float:
    """What the offset is relative to: the value, an overshoot's step, or a share of a sample."""
    if case.limit.measure == "overshoot":
        return max(abs(step.value - step.before) for step in case.horizon.steps_of(case.run)) or abs(worst)
    return 0.4 * case.sample_time_s / OFFSET if case.limit.measure == "settling_time_s" else abs(worst)


def undecided_of(seed: int, budget: int) -> int:
    """Test both sides of the worst value; how many of the two were left undecided."""
    case = random_case(seed)
    worst = sampled_worst(case, np.random.default_rng(seed + 1_000_000))
    if not math.isfinite(worst):
        assert prove_limit(at_most(case, 1e6), budget=30).verdict is not Verdict.PROVED
        return 0
    undecided, unit = 0, unit_of(case, worst)
    for side in (1.0, -1.0):
        limited = at_most(case, worst + side * OFFSET * unit)
        proof = prove_limit(limited, budget=budget)
        slack = SIMULATED * max(1.0, abs(worst))
        if proof.verdict is Verdict.PROVED:
            assert side > 0.0, f"seed {seed}: {worst} is above a proved limit"
            assert proof.bound is not None
            assert proof.bound >= worst - slack
        elif proof.verdict is Verdict.REFUTED:
            assert proof.theta is not None
            assert proof.value is not None
            reached = float(simulated(limited, np.array([proof.theta]))[0])
            assert reached > limited.limit.limit - slack
            assert reached >= proof.value - slack
        else:
            assert proof.message
            undecided += 1
        assert recheck_limit(limited, proof) == ()
    return undecided


@pytest.mark.thinned(3)
@pytest.mark.parametrize("seed", [0, 1, 3, 4, 5, 7, 8, 9, 10, 12])
def test_no_wrong_proof_and_no_wrong_refutation(seed: int) -> None:
    assert undecided_of(seed, 300) == 0


@pytest.mark.long
@pytest.mark.parametrize("seed", range(100, 200))
def test_no_wrong_proof_of_a_hundred_designs(seed: int) -> None:
    assert undecided_of(seed, 200) <= 2
