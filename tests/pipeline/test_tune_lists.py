"""Designs for lists of plants: against a scan of formulas, one member, and families that contain the list."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from cases.plant_lists import MISMATCH, mismatch, mixed
from cases.thinned import thinned

from fopi_tune.core.families.plant_list import PlantList, PlantMember, members_of
from fopi_tune.core.plant import Plant, PlantFamily, Uncertain
from fopi_tune.errors import DomainError
from fopi_tune.pipeline.optimum import certify_optimum
from fopi_tune.pipeline.prove import recheck
from fopi_tune.pipeline.tune import tune
from fopi_tune.proof import Verdict
from fopi_tune.results.candidate import Solver
from fopi_tune.results.status import Status
from fopi_tune.spec import parse_spec
from fopi_tune.spec.model import DesignSpec

OMEGA = np.geomspace(1e-3, 1e2, 3001)


def response(plant: Plant, s: np.ndarray) -> np.ndarray:
    """P(s)."""
    return np.polyval(plant.numerator, s) / np.polyval(plant.denominator, s) * np.exp(-s * plant.dead_time_s)


def scanned(spec: DesignSpec, kp: float, ki: float, horizon_s: float) -> tuple[float, float, float]:
    """Largest |S| in dB, smallest nominal margin in deg and largest discounted error of a PI, by formulas on a grid."""
    s, peak, margin, error = 1j * OMEGA, 0.0, math.inf, 0.0
    for k, member in enumerate(members_of(spec.plant)):
        plant = member.family.member(member.family.nominal_point)

        loop = (kp + ki / s) * response(plant, s)
        peak = max(peak, float(np.abs(1.0 / (1.0 + loop)).max()))
        if k == 0:
            crosses = np.flatnonzero((np.abs(loop[1:]) > 1.0) != (np.abs(loop[:-1]) > 1.0))
            angles = 180.0 - np.abs(np.degrees(np.angle(loop[crosses])))
            margin = float(angles.min(initial=math.inf))
        p = response(plant, np.array([1.0 / horizon_s]))[0]
        error = max(error, abs(horizon_s * p / (1.0 + (kp + ki * horizon_s) * p)))
    return 20.0 * math.log10(peak), margin, float(error)


def test_no_gains_of_a_scan_beat_the_design_of_a_mismatch_list() -> None:
    spec = mismatch()
    found = tune(spec)
    assert (found.status, found.certificate and found.certificate.verdict) == (Status.SOLVED, Verdict.PROVED)
    assert found.gains is not None
    assert found.objective is not None
    best = math.inf
    for kp in np.linspace(0.15, 0.55, 21):
        for ki in np.linspace(0.15, 0.55, 21):
            peak, margin, error = scanned(spec, float(kp), float(ki), 24.0)
            if peak <= 6.0 and margin >= 45.0:
                best = min(best, error)
    own = scanned(spec, found.gains.kp, found.gains.ki, 24.0)
    # the grid of frequencies sees a peak to 1e-4 dB
    assert own[0] <= 6.0 + 1e-9
    assert own[1] >= 45.0 - 0.1
    assert own[2] == pytest.approx(found.objective, rel=1e-9)
    # gains of the scan meet 6 dB by at most what its frequencies miss
    assert found.objective <= best * (1.0 + 1e-4)
    assert best <= found.objective * 1.05
    assert found.requirements[0].result is not None
    assert found.requirements[0].result.worst.member == "slow"


def test_a_list_of_one_has_the_design_of_that_plant() -> None:
    plant = "{model: lag, static_gain: {min: 1, max: 1.3}, time_constant_s: 2, dead_time_s: 0.5}"
    rest = "requirements: [{sensitivity_db: {at_most: 5}}]\nobjective: {minimize: iae_disturbance}\n"
    alone, listed = (
        tune(parse_spec(f"schema: 1\nname: a\n{text}\n{rest}")) for text in (f"plant: {plant}", f"plants: [{plant}]")
    )
    assert (alone.gains, alone.objective, alone.gap) == (listed.gains, listed.objective, listed.gap)
    assert [r.proof and r.proof.bounds for r in alone.requirements] == [
        r.proof and r.proof.bounds for r in listed.requirements
    ]
    assert [r.multiplier for r in alone.requirements] == [r.multiplier for r in listed.requirements]


def test_members_of_three_models_are_designed_and_proved_together() -> None:
    spec = mixed()
    found = tune(spec)
    assert found.status is Status.SOLVED
    assert found.certificate is not None
    assert [member.certificate.verdict for member in found.certificate.members] == [Verdict.PROVED] * 3
    assert recheck(found.certificate_document(), spec).problems == ()
    said = found.to_dict()["requirements"][0]["worst"]
    assert said["member"] in ("lag", "exact", "linked")


def lag(gain: Uncertain, time_constant: Uncertain) -> PlantFamily:
    return PlantFamily(
        "lag",
        {"static_gain": gain, "time_constant_s": time_constant, "dead_time_s": Uncertain.exactly(0.4)},
    )


def test_two_corner_boxes_cost_no_more_than_the_family_that_holds_both() -> None:
    whole = lag(Uncertain(1.0, 0.8, 1.4), Uncertain(2.0, 1.5, 3.0))
    parts = [
        lag(Uncertain(1.0, 0.8, 1.0), Uncertain(2.0, 1.5, 2.0)),
        lag(Uncertain(1.2, 1.2, 1.4), Uncertain(2.5, 2.4, 3.0)),
    ]
    text = "requirements: [{sensitivity_db: {at_most: 4}}]\nobjective: {minimize: iae_disturbance, horizon_s: 24}\n"
    spec = parse_spec(f"schema: 1\nname: a\nplant: {{model: lag, static_gain: 1, time_constant_s: 2}}\n{text}")
    listed = PlantList.of([PlantMember(f"{k}", each) for k, each in enumerate(parts)])
    every, corners = (tune(replace(spec, plant=plant), False, bracket=False).objective for plant in (whole, listed))
    assert every is not None
    assert corners is not None
    # relative; what the polish leaves
    assert corners <= every * (1.0 + 1e-6)
    # each corner box alone costs no more than both
    assert all(
        (tune(replace(spec, plant=each), False, bracket=False).objective or 0.0) <= corners * (1.0 + 1e-6)
        for each in parts
    )


@pytest.mark.parametrize("seed", thinned(range(6), 6))
def test_random_lists_meet_a_scan_of_their_formulas(seed: int) -> None:
    chance = np.random.default_rng(seed)
    plants = "".join(
        f"  - {{model: transfer_function, numerator: [{chance.uniform(0.6, 1.6):.3f}], denominator: "
        f"[{second:.3f}, {chance.uniform(0.5, 3.0):.3f}, 1], dead_time_s: {chance.uniform(0.0, 0.6):.3f}}}\n"
        for second in chance.uniform(0.1, 0.9, int(chance.integers(2, 5)))
    )
    limit = chance.uniform(3.5, 7.0)
    spec = parse_spec(
        f"schema: 1\nname: a\nplants:\n{plants}controller: {{structure: pi}}\n"
        f"requirements: [{{sensitivity_db: {{at_most: {limit:.3f}}}}}]\n"
        "objective: {minimize: iae_disturbance, horizon_s: 20}\n"
    )
    found = tune(spec)
    assert found.status is Status.SOLVED
    assert found.gains is not None
    peak, _, error = scanned(spec, found.gains.kp, found.gains.ki, 20.0)
    result = found.requirements[0].result
    assert result is not None
    assert peak <= min(spec.requirements[0].upper, result.achieved or 0.0) + 1e-5
    assert error == pytest.approx(found.objective, rel=1e-9)


def test_an_infeasible_list_says_how_far_its_limits_are_from_each_other() -> None:
    # the slow plant cannot be that fast with that robustness
    fast = MISMATCH.replace("  - phase_margin_deg: {at_least: 45}\n", "  - crossover_rad_s: {at_least: 1.2}\n")
    found = tune(parse_spec(fast))
    assert found.status is Status.INFEASIBLE
    assert {each.requirement for each in found.clash} == {0, 1}


def test_other_searches_refuse_a_list_by_name() -> None:
    with pytest.raises(DomainError, match="the convex search is for one plant in this version"):
        tune(mismatch(), solver=Solver.CONVEX)
    with pytest.raises(DomainError, match="the proof of the optimum is for one plant in this version"):
        certify_optimum(mismatch())
