"""Draws from lists of plants: shares by weight, numbers within the member's ranges, a list of one as that plant."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from cases.plant_lists import MIXED_GAINS, mixed

from fopi_tune.core.distributions.bounded import Uniform
from fopi_tune.core.families.plant_list import PlantList, PlantMember
from fopi_tune.core.parameter_table import outside_box
from fopi_tune.core.plant import PlantFamily, Uncertain
from fopi_tune.digital.implementation import implementation_of
from fopi_tune.errors import DomainError
from fopi_tune.montecarlo.draws import SamplingPlan, sample_points, stays_inside
from fopi_tune.montecarlo.montecarlo import monte_carlo
from fopi_tune.montecarlo.sampling import SamplingDesign
from fopi_tune.pipeline.simulate import simulate
from fopi_tune.spec.model import DesignSpec, ValidationSpec

SAMPLED = "digital: {sample_time_s: 0.1}\nvalidation: {samples: 600, seed: 3}\n"


def list_of(spec: DesignSpec) -> PlantList:
    assert isinstance(spec.plant, PlantList)
    return spec.plant


def weighted(*weights: float) -> PlantList:
    plants = list_of(mixed())
    return PlantList.of([replace(each, weight=w) for each, w in zip(plants.members, weights, strict=True)])


@pytest.mark.parametrize("design", list(SamplingDesign))
def test_members_are_drawn_as_often_as_their_weights_say(design: SamplingDesign) -> None:
    count = 4096
    found = sample_points(SamplingPlan(5, design, count), weighted(1.0, 2.0, 5.0), 0, count)
    shares = np.bincount(found[:, 0].astype(int), minlength=3) / count
    # five standard deviations of independent draws
    np.testing.assert_allclose(shares, [1 / 8, 2 / 8, 5 / 8], atol=5.0 * np.sqrt(0.25 / count))


def test_draws_lie_in_their_members_boxes_and_fill_them() -> None:
    plants = list_of(mixed())
    plan = SamplingPlan(5)
    found = sample_points(plan, plants, 0, 3000)
    assert stays_inside(plan, plants)
    assert not outside_box(found, plants).any()
    for k, own in ((0, [(0.9, 1.1)]), (1, []), (2, [(0.8, 1.0), (0.9, 1.2)])):
        points = found[found[:, 0] == k]
        for column, (low, high) in enumerate(own, 1):
            middle = 0.5 * (low + high)
            assert points[:, column].mean() == pytest.approx(middle, abs=0.03 * (high - low))
            assert np.ptp(points[:, column]) > 0.98 * (high - low)
        assert not points[:, 1 + len(own) :].any()


def test_a_draw_depends_on_its_index_alone() -> None:
    plants, plan = list_of(mixed()), SamplingPlan(5)
    whole = sample_points(plan, plants, 0, 100)
    np.testing.assert_array_equal(sample_points(plan, plants, 40, 7), whole[40:47])


def test_a_list_of_one_draws_what_its_plant_draws() -> None:
    family = list_of(mixed()).members[2].family
    alone = PlantList.of([PlantMember("linked", family, 3.0)])
    plan = SamplingPlan(5)
    np.testing.assert_array_equal(sample_points(plan, alone, 0, 50)[:, 1:], sample_points(plan, family, 0, 50))


def test_numbers_of_members_have_no_distributions_in_this_version() -> None:
    with pytest.raises(DomainError, match="leave distributions and files out"):
        sample_points(SamplingPlan(5, source={"static_gain": Uniform()}), list_of(mixed()), 0, 1)


def test_evidence_counts_the_plants_of_all_members_and_names_the_worst() -> None:
    spec = mixed(SAMPLED)
    implementation = implementation_of(spec, MIXED_GAINS)
    found = monte_carlo(spec, MIXED_GAINS, implementation)
    assert (found.stable.met, found.stable.total) == (600, 600)
    assert found.members == (("lag", 1.0), ("exact", 1.0), ("linked", 1.0))
    assert found.numbers == ("static_gain", "a", "k")
    # the same counts from each member's draws alone
    plants = list_of(spec)
    places = sample_points(SamplingPlan(3, total=600), plants, 0, 600)
    worst = found.requirements[0].worst[0]
    assert worst.member == plants.members[int(places[worst.index, 0])].name
    assert worst.plant == plants.describe(places[worst.index])
    assert worst.inside
    alone = replace(spec, plant=_exact(plants, places[worst.index]), validation=ValidationSpec(samples=1))
    again = monte_carlo(alone, MIXED_GAINS, implementation).requirements[0].worst[0]
    # the grids of frequencies differ
    assert again.value == pytest.approx(worst.value, abs=1e-6)


def _exact(plants: PlantList, place: np.ndarray) -> PlantFamily:
    """A transfer function that is the plant at a place."""
    plant = plants.member(place)
    numbers = {
        f"{side}[{k}]": Uncertain.exactly(value)
        for side in ("numerator", "denominator")
        for k, value in enumerate(getattr(plant, side))
    }
    return PlantFamily("transfer_function", {**numbers, "dead_time_s": Uncertain.exactly(plant.dead_time_s)})


def test_scenarios_are_simulated_with_plants_of_several_orders() -> None:
    spec = mixed(
        SAMPLED + "scenarios: [{name: step, duration_s: 20, reference: [{at_s: 1, value: 1}]}]\n"
        "limits: [{overshoot: {at_most: 0.6}}]\n"
    )
    implementation = implementation_of(spec, MIXED_GAINS)
    found = monte_carlo(spec, MIXED_GAINS, implementation).limits[0]
    assert found.fraction.total == 600
    # of each member alone, its own draws give the same values
    plants = list_of(spec)
    places = sample_points(SamplingPlan(3, total=600), plants, 0, 600)
    for each in found.worst[:2]:
        again = simulate(spec, MIXED_GAINS, replay=each.index)
        assert again.member == each.member == plants.members[int(places[each.index, 0])].name
        assert again.driven[0].measures["overshoot"] == pytest.approx(each.value, abs=1e-9)
