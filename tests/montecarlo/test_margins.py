"""Margins of many loops at once: those of the core, infinite ones and those of unstable loops among them."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from cases.plants import lag, spec_of, transfer_function
from oracles import sampled_loops as oracle

from fopi_tune.core.controller import FoPi
from fopi_tune.core.loops import Plants
from fopi_tune.core.parallel_form import Implementation, Sections
from fopi_tune.core.plant import PlantFamily
from fopi_tune.core.sampled_loops import SampledLoops
from fopi_tune.montecarlo.draws import SamplingPlan, sample_points
from fopi_tune.montecarlo.margins import MarginScan
from fopi_tune.montecarlo.montecarlo import Evidence, monte_carlo
from fopi_tune.quantities import QUANTITIES
from fopi_tune.spec.model import Relation, Requirement, ValidationSpec

MARGINS = ("phase_margin_deg", "delay_margin_s", "gain_margin_db")
GAINS = FoPi(1.0, 0.0, 1.0)
DRAWS = 400


def proportional(gain: float) -> Implementation:
    return Implementation(Sections(0.1, gain, (), ()))


def evidence(family: PlantFamily, gain: float, *requirements: Requirement) -> Evidence:
    spec = replace(spec_of(family, *requirements), validation=ValidationSpec(samples=DRAWS, seed=1))
    return monte_carlo(spec, GAINS, proportional(gain))


@pytest.mark.parametrize("quantity", [*MARGINS, "crossover_rad_s", "phase_slope_deg_per_decade"])
def test_values_at_crossings_are_those_of_the_core_also_where_there_is_none(quantity: str) -> None:
    # static gains below 1 never cross |L| = 1; large ones are unstable
    family = lag((1.0, 0.2, 60.0), 1.0, 0.05)
    points = np.geomspace(0.2, 60.0, 120)[:, None]
    loops = SampledLoops.implemented(GAINS, proportional(1.0), Plants.members(family, points))
    expected = QUANTITIES[quantity].measure(loops, False, 0.0, math.inf).value
    found = MarginScan(loops).measure(Requirement(quantity, Relation.AT_LEAST, (1.0,)), False)
    np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-9)
    sizes = [oracle.sizes(oracle.sample(family.member(p), 0.1), proportional(1.0).sections).max() for p in points]
    assert np.array_equal(np.isnan(found), np.array(sizes) >= 1.0) == (quantity in MARGINS)
    if quantity in ("phase_margin_deg", "delay_margin_s"):
        assert np.array_equal(np.isinf(found), points[:, 0] <= 1.0)
    assert 0 < np.isnan(found).sum() < len(found)


def test_an_infinite_margin_meets_at_least_and_misses_at_most() -> None:
    """A static gain below 1: no draw has a gain crossover."""
    asked = [
        Requirement("phase_margin_deg", Relation.AT_LEAST, (180.0,)),
        Requirement("phase_margin_deg", Relation.AT_MOST, (180.0,)),
        Requirement("delay_margin_s", Relation.BETWEEN, (0.1, 1e9)),
        Requirement("crossover_rad_s", Relation.AT_LEAST, (1e-9,)),
        Requirement("crossover_rad_s", Relation.AT_MOST, (1e9,)),
    ]
    found = evidence(lag((0.5, 0.2, 0.9), 1.0), 1.0, *asked)
    assert found.stable.met == DRAWS
    met = [(outcome.upper, outcome.fraction.met) for outcome in found.requirements]
    assert met == [(False, DRAWS), (True, 0), (False, DRAWS), (True, 0), (False, 0), (True, 0)]
    least, most = found.requirements[:2]
    assert {q.value for q in least.quantiles} == {q.value for q in most.quantiles} == {math.inf}
    assert least.histogram is None
    assert (most.missed_inside, most.worst[0].value) == (DRAWS, math.inf)
    # a crossover that does not exist is the worst on either side
    assert [outcome.worst[0].value for outcome in found.requirements[4:]] == [-math.inf, math.inf]


def test_draws_with_finite_infinite_and_no_margins_are_counted_apart() -> None:
    """k (1 - a)/(z - a), a lag behind its hold, crosses |L| = 1 for k > 1 and has its pole at a - k (1 - a)."""
    a = math.exp(-0.1)
    border = (1.0 + a) / (1.0 - a)
    family = lag((1.0, 0.1, 2.0 * border), 1.0)
    limits = (Relation.AT_LEAST, 60.0), (Relation.AT_MOST, 100.0)
    least_of, most_of = (Requirement("phase_margin_deg", relation, (limit,)) for relation, limit in limits)
    found = evidence(family, 1.0, least_of, most_of)
    points = sample_points(SamplingPlan(1), family, 0, DRAWS)
    gains = points[:, 0]
    stable, endless = gains < border, gains < 1.0
    assert found.stable.met == stable.sum()
    assert 0 < endless.sum() < stable.sum() < DRAWS
    loops = SampledLoops.implemented(GAINS, proportional(1.0), Plants.members(family, points))
    margin = QUANTITIES["phase_margin_deg"].measure(loops, False, 0.0, math.inf).value
    assert np.array_equal(np.isnan(margin), ~stable)
    assert np.array_equal(np.isinf(margin), endless)
    least, most = found.requirements
    # an unstable loop misses both, an infinite margin the second alone
    assert least.fraction.met == (margin >= 60.0).sum() == DRAWS - least.missed_inside
    assert most.fraction.met == (margin <= 100.0).sum() == DRAWS - most.missed_inside
    assert (least.worst[0].value, most.worst[0].value) == (-math.inf, math.inf)
    assert least.histogram is not None
    assert sum(least.histogram.counts) == np.isfinite(margin).sum()


def test_a_loop_that_ends_above_unit_gain_has_a_delay_margin_of_zero() -> None:
    """0.5 k/(z (z + 0.9)) is stable for k < 2, and 5 k at z = -1."""
    family = transfer_function([(1.0, 0.1, 1.5)], [1.0])
    asked = Requirement("delay_margin_s", Relation.AT_LEAST, (1e-9,))
    spec = replace(spec_of(family, asked), validation=ValidationSpec(samples=DRAWS, seed=1))
    found = monte_carlo(spec, GAINS, Implementation(Sections(0.1, 0.0, (-0.9,), (0.5,))))
    gains = sample_points(SamplingPlan(1), family, 0, DRAWS)[:, 0]
    assert found.stable.met == DRAWS
    assert found.requirements[0].fraction.met == (5.0 * gains < 1.0).sum() > 0
    assert found.requirements[0].worst[0].value == 0.0


@pytest.mark.parametrize("damping", [1e-2, 1e-3, 1e-5])
def test_a_resonance_narrower_than_the_grid_is_seen_in_every_draw(damping: float) -> None:
    """|L| passes 1 only next to omega_n: without points there a draw had no crossover, and an infinite margin met."""
    stiffness = np.linspace(0.5, 2.0, 41)
    family = transfer_function([damping], [1.0, 2.0 * damping, (1.0, 0.5, 2.0)], 0.3)
    loops = SampledLoops.implemented(GAINS, proportional(3.0), Plants.members(family, stiffness[:, None]))
    scan = MarginScan(loops)
    for quantity in (*MARGINS, "sensitivity_db", "loop_gain_db"):
        expected = QUANTITIES[quantity].measure(loops, True, 0.0, math.inf).value
        found = scan.measure(Requirement(quantity, Relation.AT_LEAST, (1.0,)), True)
        # Newton's last step in u, over the width of the resonance
        np.testing.assert_allclose(found, expected, rtol=1e-9 / damping, atol=1e-9 / damping, err_msg=quantity)
    assert len(scan.gain_crossings.row) == 2 * len(stiffness)


def test_a_band_takes_only_its_own_points() -> None:
    """Beside a narrow resonance outside of the band."""
    family = transfer_function([1e-3], [1.0, 2e-3, (1.0, 0.5, 2.0)])
    loops = SampledLoops.implemented(GAINS, proportional(3.0), Plants.members(family, np.array([[0.5], [1.0], [2.0]])))
    for band in ((0.0, 0.5), (1.1, 1.3), (0.9, 1.1), (3.0, math.inf)):
        asked = replace(Requirement("loop_gain_db", Relation.AT_MOST, (1.0,)), from_rad_s=band[0], to_rad_s=band[1])
        expected = QUANTITIES["loop_gain_db"].measure(loops, True, *band).value
        np.testing.assert_allclose(MarginScan(loops).measure(asked, True), expected, rtol=1e-6, atol=1e-6)
