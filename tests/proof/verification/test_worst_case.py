"""The search for the worst plant of a family, against a dense scan."""

from __future__ import annotations

import math

import numpy as np
import pytest
from cases.project import ROOT

from fopi_tune.core.bode_form import Array
from fopi_tune.core.controller import FoPi
from fopi_tune.core.loops import Loops
from fopi_tune.proof import verify
from fopi_tune.proof.verification.sample import Sample
from fopi_tune.proof.verification.worst_case import find_worst_case
from fopi_tune.spec import load_spec

FIELD = ROOT / "tests" / "cases" / "field"


def test_the_worst_plant_just_inside_of_a_wide_range_is_found() -> None:
    """At a gain of 1.09 of 1 to 10: the corner at 1 is better than every other point of the sample."""
    spec = load_spec(FIELD / "wide_gain_range.yaml")
    kp, ki = 37.02698887179, 69.38097160089315
    omega = np.geomspace(0.3, 30.0, 4001)
    worst = -math.inf
    for gain in np.geomspace(1.0, 10.0, 400):
        loop = (kp + ki / (1j * omega)) * gain / (20.0 - omega**2 + 35j * omega)
        worst = max(worst, 20.0 * math.log10(np.abs(loop / (1.0 + loop)).max()))
    (found,) = verify(spec, FoPi(kp, ki, 1.0)).requirements
    # the grid of gains and frequencies is not finer than 2e-6 dB
    assert found.extremes[0].achieved == pytest.approx(worst, abs=4e-6)
    assert found.extremes[0].worst.point == pytest.approx((1.0923, 35.0, 20.0), abs=1e-3)


@pytest.mark.parametrize("falls", [False, True])
def test_a_search_that_ends_at_an_end_evaluates_all_its_plants_at_once(falls: bool) -> None:
    sample, asked = Sample.of(load_spec(ROOT / "specs" / "brake.yaml").plant, FoPi(0.4, 0.3, 0.8)), []

    def criterion(loops: Loops) -> tuple[Array, Array]:
        asked.append(len(loops))
        pole = loops.plants.denominator[:, 0]
        return (-pole if falls else pole), np.full(len(loops), np.nan)

    found = find_worst_case(sample, criterion)
    assert found.x.tolist() == [0.0 if falls else 1.0]
    assert len(asked) == 1


def test_the_same_places_have_the_same_loops() -> None:
    sample = Sample.of(load_spec(ROOT / "specs" / "brake.yaml").plant, FoPi(0.4, 0.3, 0.8))
    places = [np.array([[k / 40.0]]) for k in range(40)]
    assert sample.loops_at(places[0].copy()) is sample.loops_at(places[0].copy())
    assert len({id(sample.loops_at(x)) for x in places[:5]}) == 5
    for x in places:
        sample.loops_at(x)
    # they are not kept without end
    assert len(sample.known) < len(places)
