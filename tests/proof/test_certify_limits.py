"""Limits that are only approached:  towards the ends of the axis, behind a dead time, and where there are none."""

from __future__ import annotations

import cmath
import json
import math

import pytest
from cases.plants import spec_of, transfer_function

import fopi_tune as ft
from fopi_tune.core.plant import PlantFamily
from fopi_tune.proof import certify, recheck, verify
from fopi_tune.proof.certificate import Certificate, Verdict
from fopi_tune.proof.documents import to_document
from fopi_tune.quantities.base import NEPER_PER_DB
from fopi_tune.spec.model import Relation, Requirement

RESPONSES = ("sensitivity_db", "complementary_sensitivity_db", "control_sensitivity_db")
#: direct paths of 0.9 k and 0.5 k behind a dead time, |L| rising towards them, and one with |L| = k everywhere
RISING = {
    "a lead": ([1.0, 2.0], [1.0, 3.0], 0.9),
    "a slow lead": ([1.0, 0.01], [2.0, 0.03], 1.6),
    "a constant": ([1.0], [1.0], 0.95),
    "a negative gain": ([-1.0, -2.0], [1.0, 3.0], 0.9),
}


def certificate(plants: PlantFamily, gains: ft.FoPi, *requirements: Requirement) -> Certificate:
    spec = spec_of(plants, *requirements)
    found = certify(spec, verify(spec, gains), {})
    assert recheck(json.loads(json.dumps(to_document(found))), spec).problems == ()
    return found


def sizes(kp: float, direct: float, nearest_to_minus_one: bool) -> dict[str, float]:
    """|S|, |T| and |C S| in dB where a direct path's L is nearest to -1, or to +1."""
    loop = abs(kp * direct)
    apart = 1.0 - loop if nearest_to_minus_one else 1.0 + loop
    return dict(zip(RESPONSES, (20.0 * math.log10(x / apart) for x in (1.0, loop, abs(kp))), strict=True))


@pytest.mark.thinned(slow=["300.0-a negative", "300.0-a lead"])
@pytest.mark.parametrize("name", RISING)
@pytest.mark.parametrize("dead_time_s", [1e-3, pytest.param(1.0, marks=pytest.mark.long), 300.0])
def test_a_direct_path_behind_a_dead_time_is_refuted_at_the_limit_that_it_turns_around(
    name: str, dead_time_s: float
) -> None:
    numerator, denominator, kp = RISING[name]
    direct = numerator[0] / denominator[0]
    worst = sizes(kp, direct, True)
    plants = transfer_function(numerator, denominator, dead_time_s)
    found = certificate(
        plants,
        ft.FoPi(kp, 0.0, 1.0),
        *(Requirement(response, Relation.AT_MOST, (value - 0.1,)) for response, value in worst.items()),
    )
    assert found.stability.verdict is Verdict.PROVED
    for proof, value in zip(found.requirements, worst.values(), strict=True):
        (side,) = proof.sides
        assert side.verdict is Verdict.REFUTED, proof.requirement
        assert side.witness is not None
        assert value - 0.1 < side.witness / NEPER_PER_DB <= value + 1e-9


def test_the_least_values_of_a_direct_path_behind_a_dead_time_are_refuted_too() -> None:
    # |L| falls from 0.9 to 0.6, so that |T| is least at the end
    least = sizes(0.6, 1.0, False)["complementary_sensitivity_db"]
    plants = transfer_function([1.0, 3.0], [1.0, 2.0], 1.0)
    limit = Requirement("complementary_sensitivity_db", Relation.AT_LEAST, (least + 0.1,))
    assert certificate(plants, ft.FoPi(0.6, 0.0, 1.0), limit).requirements[0].verdict is Verdict.REFUTED


def test_the_closed_forms_are_those_of_a_dense_scan() -> None:
    values = [0.9 * (2.0 + 1j * w) / (3.0 + 1j * w) * cmath.exp(-1j * w) for w in (1e4 + 1e-3 * k for k in range(7000))]
    densest = max(abs(1.0 / (1.0 + value)) for value in values)
    assert abs(20.0 * math.log10(densest) - sizes(0.9, 1.0, True)["sensitivity_db"]) < 1e-3


def test_a_search_in_a_tail_without_a_limit_gives_up_after_some_hundred_cuts() -> None:
    # the plant's zero at 0 cancels the integral: S is 0/0 in every enclosure of the low tail
    plants = transfer_function([1.0, 0.0], [1.0, 3.0, 2.0])
    limits = [Requirement(response, Relation.AT_MOST, (10.0,)) for response in RESPONSES[:2]]
    found = certificate(plants, ft.FoPi(5.0, 1.0, 1.0), *limits)
    assert found.stability.verdict is Verdict.REFUTED
    assert [proof.verdict for proof in found.requirements] == [Verdict.UNDECIDED] * 2
    assert not any(side.budget_spent for proof in found.requirements for side in proof.sides)
