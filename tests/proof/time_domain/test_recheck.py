"""A recheck accepts what was proved, and nothing that was changed."""

from __future__ import annotations

from dataclasses import replace

import pytest
from cases.time_domain_cases import at_most, brake_ramp, saturated_throttle, three_numbers

from fopi_tune.proof.balls.box import Box
from fopi_tune.proof.certificate import Verdict
from fopi_tune.proof.time_domain import TimeDomainCase, TimeDomainProof, prove_limit, recheck_limit
from fopi_tune.proof.time_domain.recheck import uncovered

CASE = brake_ramp()


@pytest.fixture(scope="module")
def proved() -> TimeDomainProof:
    return prove_limit(CASE)


@pytest.fixture(scope="module")
def refuted() -> TimeDomainProof:
    return prove_limit(at_most(CASE, 1.99))


def test_proofs_and_refutations_hold(proved: TimeDomainProof, refuted: TimeDomainProof) -> None:
    assert recheck_limit(CASE, proved) == ()
    assert recheck_limit(at_most(CASE, 1.99), refuted) == ()
    assert recheck_limit(CASE, replace(proved, verdict=Verdict.UNDECIDED)) == ()


@pytest.mark.parametrize(
    "case",
    [at_most(saturated_throttle(), 0.21), pytest.param(at_most(three_numbers(), 0.11), marks=pytest.mark.long)],
    ids=["saturated", "three numbers"],
)
def test_other_proofs_hold(case: TimeDomainCase) -> None:
    assert recheck_limit(case, prove_limit(case)) == ()


def test_a_missing_box_is_found(proved: TimeDomainProof) -> None:
    for number, box in enumerate(proved.boxes):
        problems = recheck_limit(CASE, replace(proved, boxes=proved.boxes[:number] + proved.boxes[number + 1 :]))
        assert len(problems) == 1
        assert "no box holds the plant" in problems[0]
        plant = float(problems[0].partition("(")[2].partition(",")[0])
        assert box[0][0] <= plant <= box[0][1]


def test_boxes_that_prove_less_than_they_say_are_found(proved: TimeDomainProof) -> None:
    assert any("is not shown" in problem for problem in recheck_limit(at_most(CASE, 1.9999), proved))
    lower = replace(proved, bound=1.9)
    assert any("not 1.9" in problem for problem in recheck_limit(CASE, lower))
    whole = replace(proved, boxes=(((1.6, 3.1),),))
    assert recheck_limit(CASE, whole) == ("box 0 is not shown to meet the limit",)
    other = replace(proved, boxes=(((1.6, 3.1), (0.0, 1.0)),))
    assert "a box is none of 1 uncertain numbers" in recheck_limit(CASE, other)[-1]
    assert "no bound" in recheck_limit(CASE, replace(proved, bound=None))[0]
    assert "tolerance" in recheck_limit(CASE, replace(proved, tolerance=0.5))[0]


def test_a_witness_must_be_one(refuted: TimeDomainProof) -> None:
    case = at_most(CASE, 1.99)
    assert refuted.value is not None
    assert "none of the family" in recheck_limit(case, replace(refuted, theta=(3.2,)))[0]
    assert "does not surely miss" in recheck_limit(case, replace(refuted, theta=(2.2,)))[0]
    assert "no plant" in recheck_limit(case, replace(refuted, theta=None))[0]
    assert "not 2.1" in recheck_limit(case, replace(refuted, value=2.1))[0]
    # less than it reaches is no lie
    assert recheck_limit(case, replace(refuted, value=refuted.value - 1e-3)) == ()


def test_a_case_without_a_method_has_no_proof(proved: TimeDomainProof) -> None:
    assert "nothing can be proved" in recheck_limit(at_most(CASE, 2.0, "saturation_time_s"), proved)[0]


def test_covers_are_exact() -> None:
    def cut(*boxes: Box) -> tuple[float, ...] | None:
        return uncovered(((0.0, 1.0), (0.0, 1.0)), boxes)

    left, right = ((0.0, 0.5), (0.0, 1.0)), ((0.5, 1.0), (0.0, 1.0))
    assert cut(left, right) is None
    assert cut(left) == (0.75, 0.5)
    assert cut(left, ((0.5, 1.0), (0.0, 0.25)), ((0.5, 1.0), (0.25, 1.0))) is None
    assert cut(left, ((0.5000001, 1.0), (0.0, 1.0))) is not None
    # a pinwheel is no tree of cuts
    pinwheel = [
        ((0.0, 0.6), (0.0, 0.4)), ((0.6, 1.0), (0.0, 0.6)), ((0.4, 1.0), (0.6, 1.0)), ((0.0, 0.4), (0.4, 1.0)),
        ((0.4, 0.6), (0.4, 0.6)),
    ]  # fmt: skip
    assert cut(*pinwheel) is None
    found = cut(*pinwheel[:-1])
    assert found is not None
    assert all(0.4 <= value <= 0.6 for value in found)
    assert uncovered((), [()]) is None
    assert uncovered((), []) == ()
    assert uncovered(((1.0, 1.0),), [((0.0, 1.0),)]) is None
