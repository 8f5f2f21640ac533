"""Counted budgets:  every search of a certificate ends within them, with a named outcome, and says so."""

from __future__ import annotations

import sys
from collections.abc import Callable

import pytest

import fopi_tune as ft
from fopi_tune.core.controller import FoPi
from fopi_tune.proof import certify, recheck, verify
from fopi_tune.proof.claims.branch_and_bound import SearchResult, search
from fopi_tune.proof.claims.claim import Claim
from fopi_tune.proof.documents import to_document
from fopi_tune.proof.obligations import Case, level_claims
from fopi_tune.proof.searches import REQUIREMENT_WORK, STABILITY_WORK, Searches
from fopi_tune.proof.verification.verify import reassess
from fopi_tune.report.text.certificates import proof_lines
from fopi_tune.spec import parse_spec
from fopi_tune.spec.model import DesignSpec

#: two resonances and a dead time: three gain crossovers, only the highest of which has the small phase margin
RESONANT = """
  model: transfer_function
  numerator: [57.94, 319.5]
  denominator: [1.0, {min: 0.8, max: 1.0, nominal: 0.9}, 67.12, 21.38, {min: 370.0, max: 420.0, nominal: 390.0}]
  dead_time_s: 0.03684"""
RESONANT_GAINS = FoPi(0.1267, 0.4437, 1.311)
#: by bisection of |L| = 1: 31.6518 deg at (0.8, 420) is the largest of the family, 14.2425 deg at (1, 370) the least
RESONANT_LIMIT = "phase_margin_deg: {at_most: 31.652}"
#: three uncertain numbers, so that hundreds to thousands of boxes are needed
LAG = """
  model: lag
  static_gain: {nominal: 1.0, min: 0.8, max: 1.25}
  time_constant_s: {nominal: 2.25, min: 1.6, max: 3.1}
  dead_time_s: {nominal: 0.3, min: 0.2, max: 0.4}"""
LAG_GAINS = FoPi(1.5, 0.8, 0.9)
LIMITS = {
    "sensitivity_db": 20.0,
    "complementary_sensitivity_db": 20.0,
    "control_sensitivity_db": 20.0,
    "phase_margin_deg": 60.0,
    "gain_margin_db": 10.0,
    "delay_margin_s": 1.0,
    "crossover_rad_s": 1.0,
}
#: a budget for a few of the thousands of boxes
SMALL = 300


def spec_of(requirement: str, plant: str, digital: str = "") -> DesignSpec:
    controller = "{kp: {min: 0, max: 10}, ki: {min: 0, max: 10}, alpha: {min: 0.3, max: 1.5}}"
    return parse_spec(
        f"schema: 1\nname: t\nplant: {plant}\ncontroller: {controller}\nrequirements:\n  - {requirement}\n{digital}"
    )


@pytest.fixture
def searched(monkeypatch: pytest.MonkeyPatch) -> list[SearchResult]:
    """Every result of a search for a certificate, in turn."""
    results: list[SearchResult] = []

    def watched(claim: Claim, budget: int, most_work: int, plant_work: Callable[[], int]) -> SearchResult:
        results.append(search(claim, budget, most_work, plant_work))
        return results[-1]

    monkeypatch.setattr(sys.modules["fopi_tune.proof.searches"], "search", watched)
    return results


@pytest.mark.long
def test_a_phase_margin_that_only_one_of_three_crossovers_has_is_proved_in_some_hundred_boxes(
    searched: list[SearchResult],
) -> None:
    """Splitting for the wrong crossover, which can never meet the level, took more than 15 minutes here."""
    spec = spec_of(RESONANT_LIMIT, RESONANT)
    certificate = certify(spec, verify(spec, RESONANT_GAINS), {})
    assert certificate.requirements[0].verdict is ft.Verdict.PROVED
    assert recheck(to_document(certificate), spec).problems == ()
    of_stability = sum(record.boxes for record in certificate.stability.records)
    assert sum(result.boxes for result in searched) - of_stability < 1_000
    assert sum(result.work for result in searched) < REQUIREMENT_WORK + STABILITY_WORK


@pytest.mark.parametrize(("level", "most"), [(0.05, 1), (0.3, 400)])
def test_a_claim_that_is_false_at_the_centre_of_a_box_ends_there(level: float, most: int) -> None:
    """The family's phase margins lie from 0.249 to 0.552 rad: below that no plant meets the level, then some."""
    spec = spec_of(RESONANT_LIMIT, RESONANT)
    claim = level_claims(Case(RESONANT_GAINS, spec.plant, 0.0), spec.requirements[0], True, level)[-1]
    result = search(claim, 8_000)
    assert not result.shown
    assert result.open_boxes
    assert 0 < result.boxes <= most


#: |S| and |T| of this loop have no smallest value in dB: they tend to 0 at an end of the axis
ENDLESS = ("sensitivity_db", "complementary_sensitivity_db")
ASKED = [(q, r) for q in LIMITS for r in ("at_least", "at_most") if not (q in ENDLESS and r == "at_least")]


@pytest.mark.thinned(3)
@pytest.mark.parametrize(("quantity", "relation"), ASKED)
def test_every_requirement_ends_within_its_budget(
    quantity: str, relation: str, searched: list[SearchResult], monkeypatch: pytest.MonkeyPatch
) -> None:
    """All levels, rounds and claims together; only the box that reaches the budget may go beyond it."""
    found = verify(spec_of(f"{quantity}: {{{relation}: {LIMITS[quantity]}}}", LAG), LAG_GAINS)
    achieved = found.requirements[0].achieved
    assert achieved is not None
    limit = achieved + (1e-5 if relation == "at_most" else -1e-5) * max(abs(achieved), 1.0)
    spec = spec_of(f"{quantity}: {{{relation}: {limit!r}}}", LAG)
    monkeypatch.setattr(sys.modules["fopi_tune.proof.certify"], "STABILITY_WORK", 0)
    monkeypatch.setattr(sys.modules["fopi_tune.proof.certify"], "REQUIREMENT_WORK", SMALL)
    certificate = certify(spec, reassess(spec, found), {})
    largest = max(result.work / max(result.boxes, 1) for result in searched)
    assert 0 < sum(result.work for result in searched) <= SMALL + 2 * largest
    assert certificate.stability.verdict is ft.Verdict.UNDECIDED
    assert certificate.stability.budget_spent
    (proof,) = certificate.requirements
    assert proof.verdict in (ft.Verdict.UNDECIDED, ft.Verdict.PROVED)
    assert proof.budget_spent is (proof.verdict is ft.Verdict.UNDECIDED)
    assert recheck(to_document(certificate), spec).problems == ()


def test_what_ends_with_its_budget_is_undecided_and_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    spec = spec_of("sensitivity_db: {at_most: 20.0}", LAG)
    found = verify(spec, LAG_GAINS)
    assert found.requirements[0].is_met
    monkeypatch.setattr(sys.modules["fopi_tune.proof.certify"], "REQUIREMENT_WORK", 20)
    certificate = certify(spec, found, {})
    assert certificate.requirements[0].verdict is ft.Verdict.UNDECIDED
    words = " ".join(" ".join(text for text, _ in proof_lines(certificate)).split())
    assert "is undecided" in words
    assert "the counted budget of its searches was spent" in words


def test_a_budget_is_fewer_boxes_on_samples() -> None:
    """There each box takes the exponential of the plant."""
    from fopi_tune.digital.implementation import implementation_of

    spec = spec_of("sensitivity_db: {at_most: 3.0}", LAG, "digital: {sample_time_s: 0.1, delay_samples: 1}\n")
    boxes: list[int] = []
    for implementation in (None, implementation_of(spec, LAG_GAINS)):
        case = Case(LAG_GAINS, spec.plant, 0.0, None, implementation)
        searches = Searches(case)
        searches.begin(SMALL)
        found = searches.run(level_claims(case, spec.requirements[0], True, 0.35)[0])
        assert not found.shown
        assert searches.were_cut
        boxes.append(found.boxes)
    assert 0 < 1.5 * boxes[1] <= boxes[0]
