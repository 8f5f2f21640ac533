"""Requirements in words where their margin is infinite or missing, on the page and in the terminal."""

from __future__ import annotations

import math

import pytest

from fopi_tune.proof.verification.requirements import assess_requirement
from fopi_tune.proof.verification.results import Extreme, Outcome, Place
from fopi_tune.report.documents import ReportedRequirement
from fopi_tune.report.requirement_rows import RequirementRow, requirement_rows
from fopi_tune.report.text.design import requirement_lines
from fopi_tune.report.text.formatting import verdict_word
from fopi_tune.results.requirement_reports import RequirementReport
from fopi_tune.spec.model import Relation, Requirement

PLANT = Place(None, {"static_gain": 0.5}, (0.5,))


def report(quantity: str, relation: Relation, limit: float, achieved: float | None) -> RequirementReport:
    asked = Requirement(quantity, relation, (limit,))
    extreme = Extreme(relation is Relation.AT_MOST, achieved, PLANT)
    return RequirementReport(asked, assess_requirement(asked, (extreme,), 1e-6), None)


def row(found: RequirementReport) -> RequirementRow:
    return requirement_rows([ReportedRequirement(found.requirement, found.to_dict())])[0]


def terminal(found: RequirementReport) -> str:
    return " ".join(" ".join(line for line, _ in requirement_lines([found], None)).split()).replace("\u00a0", " ")


@pytest.mark.parametrize(
    ("quantity", "relation", "achieved", "outcome", "met", "words", "worst"),
    [
        ("phase_margin_deg", Relation.AT_LEAST, None, "unstable", False, "no margin: unstable", "with static_gain"),
        ("gain_margin_db", Relation.AT_LEAST, None, "unstable", False, "no margin: unstable", "with static_gain"),
        ("crossover_rad_s", Relation.AT_LEAST, None, "no_crossover", False, "no crossover", "with static_gain"),
        ("phase_margin_deg", Relation.AT_LEAST, math.inf, "infinite", True, "infinite", "no gain crossover sets it"),
        ("delay_margin_s", Relation.AT_LEAST, math.inf, "infinite", True, "infinite", "no gain crossover sets it"),
        ("gain_margin_db", Relation.AT_LEAST, math.inf, "infinite", True, "infinite", "no phase crossover sets it"),
        (
            "phase_margin_deg",
            Relation.AT_MOST,
            math.inf,
            "infinite",
            False,
            "infinite",
            "no gain crossover sets it with static_gain",
        ),
        ("phase_margin_deg", Relation.AT_LEAST, 80.0, "met", True, "80", "with static_gain"),
    ],
)
def test_outcomes_of_margins_are_told(
    quantity: str, relation: Relation, achieved: float | None, outcome: str, met: bool, words: str, worst: str
) -> None:
    found = report(quantity, relation, 60.0 if relation is Relation.AT_LEAST else 90.0, achieved)
    assert found.result is not None
    assert (found.result.outcome, found.result.is_met) == (Outcome(outcome), met)
    shown = row(found)
    assert (shown.verdict, shown.achieved) == ("met" if met else "violated", words)
    assert shown.worst.startswith(worst)
    # beyond any limit there is no score
    assert shown.score == ("–" if not met else "0.000" if achieved == math.inf else shown.score)
    text = terminal(found)
    assert words.partition(":")[0] in text
    assert worst in text or outcome == "no_crossover"
    assert ("no margin: unstable with static_gain = 0.5" in text) == (outcome == "unstable")


def test_an_equality_of_an_infinite_margin_is_missed() -> None:
    asked = Requirement("phase_margin_deg", Relation.EQUALS, (90.0,))
    extremes = tuple(Extreme(largest, math.inf, PLANT) for largest in (False, True))
    found = assess_requirement(asked, extremes, 1e-6)
    assert (found.outcome, found.is_met) == (Outcome.INFINITE, False)


@pytest.mark.parametrize(
    ("met", "proof", "word"),
    [
        (True, "proved", "proved"),
        (True, None, "met"),
        (True, "undecided", "undecided"),
        (True, "refuted", "violated"),
        (False, "undecided", "violated"),
        (False, "refuted", "violated"),
        (False, None, "violated"),
        (None, None, "open"),
    ],
)
def test_the_page_and_the_terminal_have_one_word_for_a_verdict(met: bool | None, proof: str | None, word: str) -> None:
    found = report("phase_margin_deg", Relation.AT_LEAST, 60.0, None if met is None else 70.0 if met else 50.0)
    assert verdict_word(met, proof) == word
    if proof is None and met is not None:
        assert terminal(found).split("score ")[1].startswith(word)
        assert row(found).verdict == word


def test_an_equality_scores_alike_on_the_page_and_in_the_terminal() -> None:
    found = report("phase_margin_deg", Relation.EQUALS, 60.0, 60.05)
    assert row(found).score == "0.500"
    assert "violated phase_margin_deg = 60 60.05 0.500" in terminal(found)
    assert "it is met only within the tolerance" in terminal(found)
    assert row(found).verdict == "violated"
