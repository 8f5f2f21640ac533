"""What contradicts a proof: values beyond its bounds, and margins that do not end or do not exist."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any, cast

import pytest

from fopi_tune.montecarlo.contradiction import contradictions
from fopi_tune.montecarlo.joint import JointYield
from fopi_tune.montecarlo.montecarlo import Evidence
from fopi_tune.montecarlo.outcomes import OutcomeStatistics, WorstPlant
from fopi_tune.montecarlo.statistics import fraction
from fopi_tune.proof.certificate import Certificate, Record, RequirementProof, SideProof, Verdict
from fopi_tune.proof.verification.results import Place
from fopi_tune.spec.model import Limit, Relation, Requirement, ValidationSpec

PROVED, REFUTED, UNDECIDED = Verdict.PROVED, Verdict.REFUTED, Verdict.UNDECIDED
JOINT = JointYield(fraction(1, 2), 1, (7,))


def proof_of(requirement: Requirement, verdict: Verdict, level: float | None) -> RequirementProof:
    upper = requirement.relation is Relation.AT_MOST
    records = () if level is None else (Record((".",)),)
    return RequirementProof(requirement, (SideProof(upper, verdict, level, None, Place(None, {}, ()), records, ()),))


def told(
    requirement: Requirement, value: float, proof: RequirementProof, stability: Verdict = PROVED
) -> tuple[str, ...]:
    worst = WorstPlant(7, value, {}, True)
    upper = requirement.relation is Relation.AT_MOST
    outcome = OutcomeStatistics(requirement, None, None, upper, fraction(1, 2), (), (worst,), 1, worst)
    evidence = Evidence(ValidationSpec(), fraction(2, 2), (outcome,), (), JOINT, (), 0)
    certificate: Any = SimpleNamespace(
        stability=SimpleNamespace(verdict=stability), requirements=(proof,), scenarios=()
    )
    return contradictions(evidence, cast(Certificate, certificate))


LEAST = Requirement("phase_margin_deg", Relation.AT_LEAST, (60.0,))
MOST = Requirement("phase_margin_deg", Relation.AT_MOST, (90.0,))
CROSSOVER = Requirement("crossover_rad_s", Relation.AT_LEAST, (0.1,))


@pytest.mark.parametrize(
    ("requirement", "value", "level", "contradicts"),
    [
        (LEAST, 59.9, math.radians(60.0), True),
        (LEAST, 60.0, math.radians(60.0), False),
        # more than any bound, but on its good side
        (LEAST, math.inf, math.radians(60.0), False),
        # no margin at all: an unstable loop
        (LEAST, -math.inf, math.radians(60.0), True),
        (MOST, math.inf, math.radians(90.0), True),
        (MOST, 89.0, math.radians(90.0), False),
        (CROSSOVER, -math.inf, math.log(0.1), True),
        (CROSSOVER, 0.2, math.log(0.1), False),
    ],
)
def test_a_draw_on_the_wrong_side_of_what_is_proved_contradicts_it(
    requirement: Requirement, value: float, level: float, contradicts: bool
) -> None:
    found = told(requirement, value, proof_of(requirement, PROVED, level))
    assert bool(found) == contradicts
    assert all(requirement.quantity in sentence and "plant 7" in sentence for sentence in found)


@pytest.mark.parametrize(("verdict", "stability"), [(UNDECIDED, PROVED), (REFUTED, PROVED), (PROVED, UNDECIDED)])
def test_a_missing_margin_contradicts_nothing_that_is_not_proved(verdict: Verdict, stability: Verdict) -> None:
    # a level that was shown is of the margins that there are
    proof = proof_of(LEAST, verdict, math.radians(60.0))
    assert told(LEAST, -math.inf, proof, stability) == ()
    assert len(told(LEAST, 50.0, proof, stability)) == 1


def test_without_a_certificate_nothing_is_contradicted() -> None:
    evidence = Evidence(ValidationSpec(), fraction(1, 2), (), (), JOINT, (), 0, unstable_inside=1)
    assert contradictions(evidence, None) == ()


@pytest.mark.parametrize(
    ("value", "noisy", "scenario", "contradicts"),
    [(2.1, False, "stop", True), (2.0, False, "stop", False), (2.1, True, "stop", False), (2.1, False, "go", False)],
)
def test_a_draw_beyond_what_is_proved_of_a_scenario_contradicts_it(
    value: float, noisy: bool, scenario: str, contradicts: bool
) -> None:
    limit = Limit("acceleration_m_s2", Relation.AT_MOST, 2.0)
    worst = WorstPlant(7, value, {}, True)
    outcome = OutcomeStatistics(None, limit, "stop", True, fraction(1, 2), (), (worst,), 1, worst)
    names = ("stop",) if noisy else ()
    evidence = Evidence(ValidationSpec(), fraction(2, 2), (), (outcome,), JOINT, (), 0, noisy_scenarios=names)
    shown = SimpleNamespace(
        case=SimpleNamespace(limit=limit, scenario=SimpleNamespace(name=scenario)),
        proof=SimpleNamespace(verdict=PROVED, bound=2.000001),
    )
    certificate: Any = SimpleNamespace(
        stability=SimpleNamespace(verdict=PROVED), requirements=(), scenarios=(shown,)
    )  # fmt: skip
    assert bool(contradictions(evidence, cast(Certificate, certificate))) == contradicts
