"""The check of a list of plants: the worst of its members, against each alone and against a scan of a formula."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from cases.plant_lists import MISMATCH_GAINS, MIXED_GAINS, mismatch, mixed

from fopi_tune.core.controller import FoPi
from fopi_tune.core.families.plant_list import PlantList
from fopi_tune.digital.implementation import implementation_of
from fopi_tune.proof import verify
from fopi_tune.proof.verification.results import Outcome
from fopi_tune.proof.verification.verify import reassess
from fopi_tune.spec import parse_spec
from fopi_tune.spec.lists.members import member_specs
from fopi_tune.spec.model import DesignSpec, Objective, Sense


def sensitivities_db(spec: DesignSpec, gains: FoPi) -> dict[str, float]:
    """The largest |S| of each member with exact numbers, from its formula on a dense grid, dB."""
    s = 1j * np.geomspace(1e-3, 1e3, 40_001)
    found = {}
    assert isinstance(spec.plant, PlantList)
    for member in spec.plant.members:
        plant = member.family.member(member.family.nominal_point)
        response = np.polyval(plant.numerator, s) / np.polyval(plant.denominator, s) * np.exp(-s * plant.dead_time_s)
        loop = (gains.kp + gains.ki * s**-gains.alpha) * response
        found[member.name] = float(20.0 * np.log10(np.abs(1.0 / (1.0 + loop)).max()))
    return found


def test_the_worst_value_is_that_of_the_worst_member_and_names_it() -> None:
    spec = mismatch()
    found = verify(spec, MISMATCH_GAINS)
    scanned = sensitivities_db(spec, MISMATCH_GAINS)
    worst = max(scanned, key=scanned.__getitem__)
    result = found.requirements[0]
    # the grid's steps are 3e-4 in ln omega
    assert result.achieved == pytest.approx(scanned[worst], abs=1e-5)
    assert (result.worst.member, result.worst.point) == (worst, (0.0,))
    assert found.stability.worst.member == worst


def test_every_extreme_is_the_worst_of_the_members_alone() -> None:
    spec = mixed()
    found, members = verify(spec, MIXED_GAINS), [verify(each, MIXED_GAINS) for each in member_specs(spec)]
    for index, result in enumerate(found.requirements):
        every = [each.requirements[index].achieved for each in members]
        largest = result.extremes[0].largest
        assert result.achieved == (max if largest else min)(value for value in every if value is not None)
        name, point = result.worst.member, result.worst.point
        assert name == ("lag", "exact", "linked")[int(point[0])]
        assert result.worst.plant == members[int(point[0])].requirements[index].worst.plant
    assert found.objective == max(each.objective or 0.0 for each in members)
    assert found.objective_worst is not None
    assert found.objective_worst.member
    assert found.nominal == members[0].nominal


def test_what_is_about_the_nominal_plant_is_read_from_the_first_member() -> None:
    spec = mismatch()
    found = verify(spec, MISMATCH_GAINS).requirements[1]
    alone = verify(member_specs(spec)[0], MISMATCH_GAINS).requirements[1]
    assert (found.achieved, found.worst.member) == (alone.achieved, "slow")
    turned = replace(spec, plant=PlantList.of(spec.plant.members[::-1]))  # pyright: ignore[reportAttributeAccessIssue]
    assert verify(turned, MISMATCH_GAINS).requirements[1].achieved != pytest.approx(found.achieved, rel=1e-3)


def test_one_unstable_member_makes_the_list_unstable_and_takes_its_margins() -> None:
    spec = mixed()
    # stable for the lag, not for the plants with another pole
    gains = FoPi(6.0, 1.0, 1.0)
    members = [verify(each, gains).stability.stable for each in member_specs(spec)]
    assert members == [True, False, False]
    found = verify(spec, gains)
    assert not found.stability.stable
    assert found.stability.worst.member == "exact"
    assert found.requirements[1].outcome is Outcome.UNSTABLE
    assert not found.all_met


@pytest.mark.parametrize("quantity", ["phase_margin_spread_deg", "crossover_spread_db"])
def test_a_spread_is_measured_from_the_nominal_plant_of_the_first_member(quantity: str) -> None:
    spec = replace(mismatch(), objective=Objective(Sense.MINIMIZE, quantity))
    found = verify(spec, MISMATCH_GAINS)
    value = {}
    for each in member_specs(spec):
        alone = verify(replace(each, reference=None), MISMATCH_GAINS)
        value[each.plant.dead_time.nominal] = alone.nominal
    nominal, others = value[1.4], (value[1.0], value[0.7])
    if quantity == "phase_margin_spread_deg":
        apart = [abs(each.phase_margin_deg - nominal.phase_margin_deg) for each in others]
    else:
        omega = nominal.gain_crossovers_rad_s[-1]
        s, plants = 1j * omega, [each.plant.member(each.plant.nominal_point) for each in member_specs(spec)[1:]]
        c = MISMATCH_GAINS.kp + MISMATCH_GAINS.ki / s
        gains = [abs(c * np.polyval(p.numerator, s) / np.polyval(p.denominator, s)) for p in plants]
        apart = [abs(20.0 * np.log10(gain)) for gain in gains]
    assert found.objective == pytest.approx(max(apart), rel=1e-9)


def test_a_list_on_samples_is_the_worst_of_its_members_with_one_digital_controller() -> None:
    spec = mixed("digital: {sample_time_s: 0.1, design: sampled, prewarp: crossover}\n")
    implementation = implementation_of(spec, MIXED_GAINS)
    found = verify(spec, MIXED_GAINS, implementation=implementation)
    members = member_specs(spec)
    # the filter is exact at the crossover of the list's nominal plant, whichever member is looked at
    assert [implementation_of(each, MIXED_GAINS) for each in members] == [implementation] * 3
    every = [verify(each, MIXED_GAINS, implementation=implementation) for each in members]
    assert found.requirements[0].achieved == max(each.requirements[0].achieved or 0.0 for each in every)


def test_other_limits_are_assessed_without_measuring_again() -> None:
    spec = mixed()
    tighter = replace(spec, requirements=(replace(spec.requirements[0], limits=(1.0,)), *spec.requirements[1:]))
    found = verify(spec, MIXED_GAINS)
    again, anew = reassess(tighter, found), verify(tighter, MIXED_GAINS)
    assert again.requirements == anew.requirements
    assert not again.requirements[0].is_met


def test_a_list_of_one_is_that_plant() -> None:
    plant = "{model: lag, static_gain: {min: 1, max: 1.2}, time_constant_s: 2, dead_time_s: 0.4}"
    rest = "requirements: [{sensitivity_db: {at_most: 6}}, {phase_margin_deg: {at_least: 40}}]\n"
    alone, listed = (
        verify(parse_spec(f"schema: 1\nname: a\n{text}\n{rest}"), FoPi(0.8, 0.5, 0.9))
        for text in (f"plant: {plant}", f"plants: [{plant}]")
    )
    for one, other in zip(alone.requirements, listed.requirements, strict=True):
        assert (one.achieved, one.score, one.worst.plant) == (other.achieved, other.score, other.worst.plant)
    assert (alone.objective, alone.nominal) == (listed.objective, listed.nominal)
