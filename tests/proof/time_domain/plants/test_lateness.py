"""Families are cut at whole samples of delay, and boxes between them know how late their inputs are."""

from __future__ import annotations

import itertools

import pytest
from cases.plants import lag
from flint import arb, ctx

from fopi_tune.proof.time_domain.jets import assemble_jets
from fopi_tune.proof.time_domain.plants.lateness import WHOLE, Lateness, cut_at_whole_samples, lateness_of


def late(low: float, high: float, sample_time_s: float = 0.1, more: float = 0.0) -> Lateness | None:
    family = lag(1.0, 1.0, (low, high) if high > low else low)
    with ctx.workprec(128):
        balls = [arb(low).union(arb(high))] if high > low else []
        middle = [arb(0.5 * (low + high))] if high > low else []
        return lateness_of(
            assemble_jets(family, balls)[2], assemble_jets(family, middle)[2], (low, high), sample_time_s, more
        )


def test_cuts_cover_the_range_and_lie_at_whole_samples() -> None:
    family = lag(1.0, (1.0, 2.0), (0.2, 0.55))
    boxes = cut_at_whole_samples(family, 0.1, {0.0, 0.5})
    ends = [box[1] for box in boxes]
    assert (ends[0][0], ends[-1][1]) == (0.2, 0.55)
    assert all(one[1] == two[0] for one, two in itertools.pairwise(ends))
    cuts = [end for _, end in ends[:-1]]
    assert cuts == pytest.approx([0.25, 0.3, 0.35, 0.4, 0.45, 0.5], abs=1e-15)
    for low, high in ends:
        for more in (0.0, 0.5):
            assert late(low, high, 0.1, more) is not None
    assert cut_at_whole_samples(lag(1.0, (1.0, 2.0), 0.25), 0.1, {0.0}) == [((1.0, 2.0),)]


def test_delays_next_to_a_whole_number_are_whole() -> None:
    # 0.3/0.1 is less than 3 in doubles
    found = late(0.3, 0.3)
    assert found is not None
    assert found.is_whole
    assert found.whole == 3
    assert 1e-16 < found.beyond < WHOLE
    exact = late(0.0, 0.0, 0.1, 1.0)
    assert exact is not None
    assert (exact.whole, exact.beyond) == (1, 0.0)
    part = late(0.25, 0.25)
    assert part is not None
    assert (part.whole, part.beyond) == (2, 0.0)
    assert abs(part.centre.value - 0.5) < 1e-12


def test_a_box_across_a_whole_number_is_none() -> None:
    assert late(0.25, 0.35) is None
    found = late(0.2, 0.3)
    assert found is not None
    assert found.whole == 2
    assert found.part.value.contains(0)
    assert found.part.value.contains(1)
    assert found.part.value > -1e-6
    assert abs(found.part.slopes[0] - 10) < 1e-9
