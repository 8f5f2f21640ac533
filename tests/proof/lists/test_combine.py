"""Certificates of lists: each member's own, the worst of them for all, and no tampering with members."""

from __future__ import annotations

import copy
import json
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from typing import Any

import pytest
from cases.plant_lists import MISMATCH, MISMATCH_GAINS, MIXED_GAINS, mismatch, mixed

from fopi_tune.core.controller import FoPi
from fopi_tune.errors import CertificateError
from fopi_tune.pipeline.prove import prove, recheck
from fopi_tune.proof import Verdict
from fopi_tune.proof.documents import digest
from fopi_tune.spec import parse_spec
from fopi_tune.spec.lists.members import member_specs
from fopi_tune.spec.model import DesignSpec

Document = dict[str, Any]


@cache
def _document() -> str:
    return json.dumps(prove(mismatch(), MISMATCH_GAINS).certificate_document())


def document() -> Document:
    """The certificate of the mismatch list, as it is read from a file."""
    return json.loads(_document())


def with_digest(changed: Document) -> Document:
    """As somebody who changes a file would leave it."""
    for plant in changed["plants"]:
        plant["certificate"]["digest"] = digest(plant["certificate"])
    changed["digest"] = digest(changed)
    return changed


def test_a_requirement_is_proved_for_all_members_with_the_loosest_bound_and_the_worst_witness() -> None:
    spec = mixed()
    found = prove(spec, MIXED_GAINS).certificate
    members = [prove(each, MIXED_GAINS).certificate for each in member_specs(spec)]
    assert found.verdict is Verdict.PROVED
    for index, proof in enumerate(found.requirements):
        side, every = proof.sides[0], [each.requirements[index].sides[0] for each in members]
        pick = max if side.upper else min
        assert side.level == pick(each.level for each in every if each.level is not None)
        assert side.witness == pick(each.witness for each in every if each.witness is not None)
        decides = [each.witness for each in every].index(side.witness)
        assert side.worst.member == ("lag", "exact", "linked")[decides]
        assert side.worst.point == (float(decides), *every[decides].worst.point)
    assert found.boxes == sum(each.boxes for each in members)


def test_a_certificate_of_a_list_is_sound_with_and_without_its_spec() -> None:
    assert recheck(document()).problems == ()
    found = recheck(document(), mismatch())
    assert (found.problems, found.certificate.verdict) == ((), Verdict.PROVED)
    assert found.certificate.requirements[0].sides[0].worst.member == "slow"
    assert found.boxes > 0


def test_one_refuted_member_refutes_the_list_and_is_named() -> None:
    # stable for all; |S| of the slow plant alone is beyond 4 dB
    spec = parse_spec(MISMATCH.replace("at_most: 6", "at_most: 4"))
    found = prove(spec, MISMATCH_GAINS)
    assert found.status == "violated"
    side = found.certificate.requirements[0].sides[0]
    assert (side.verdict, side.worst.member, side.level) == (Verdict.REFUTED, "slow", None)
    verdicts = [each.certificate.verdict for each in found.certificate.members]
    assert verdicts == [Verdict.REFUTED, Verdict.PROVED, Verdict.PROVED]
    assert recheck(json.loads(json.dumps(found.certificate_document())), spec).problems == ()


def test_an_unstable_member_is_named() -> None:
    found = prove(mixed(), FoPi(6.0, 1.0, 1.0)).certificate
    assert (found.stability.verdict, found.stability.member) == (Verdict.REFUTED, "exact")
    assert found.requirements[1].verdict is Verdict.REFUTED


def renamed(changed: Document) -> None:
    changed["plants"][1]["name"] = "plant 4"


def swapped(changed: Document) -> None:
    plants = changed["plants"]
    plants[1]["certificate"], plants[2]["certificate"] = plants[2]["certificate"], plants[1]["certificate"]


def left_out(changed: Document) -> None:
    del changed["plants"][2]


def of_another_member(changed: Document) -> None:
    changed["requirements"][0]["sides"][0]["member"] = "plant 3"


def better(changed: Document) -> None:
    changed["requirements"][0]["proved_to"] -= 1e-3


def stable_for_another(changed: Document) -> None:
    changed["stability"]["member"] = "plant 2"


def another_plant(changed: Document) -> None:
    changed["plants"][1]["certificate"]["plant"]["parameters"][2].update(nominal=0.9, min=0.9, max=0.9)


def without_records(changed: Document) -> None:
    changed["plants"][2]["certificate"]["requirements"][0]["sides"][0]["records"] = []


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (renamed, "the plants are not those of the spec"),
        (swapped, "plants[1] (plant 2): the plants are not those of the spec"),
        (left_out, "the plants are not those of the spec"),
        (of_another_member, "requirements[0].sides[0].member does not follow"),
        (better, "requirements[0].proved_to does not follow"),
        (stable_for_another, "stability.member does not follow"),
        (another_plant, "plants[1] (plant 2): the plants are not those of the spec"),
        (without_records, "plants[2] (plant 3): "),
    ],
)
def test_tampering_with_members_is_refused(change: Callable[[Document], None], said: str) -> None:
    changed = document()
    change(changed)
    problems = recheck(with_digest(changed), mismatch()).problems
    assert any(said in problem for problem in problems), problems
    # a change without a new digest is told as such
    change(plain := document())
    assert any("digest" in problem for problem in recheck(plain, mismatch()).problems)


def other_gains(changed: Document) -> None:
    changed["plants"][1]["certificate"]["gains"]["kp"] = 0.26


def fewer_requirements(changed: Document) -> None:
    del changed["plants"][1]["certificate"]["requirements"][0]


def same_name(changed: Document) -> None:
    changed["plants"][1]["name"] = "slow"


def no_plants(changed: Document) -> None:
    changed["plants"] = []


def a_list_inside(changed: Document) -> None:
    changed["plants"][0]["certificate"] = copy.deepcopy(changed)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (other_gains, "is not of the spec, the gains and the tolerance of the first"),
        (fewer_requirements, "has other requirements than the first has for all plants"),
        (same_name, "the same name"),
        (no_plants, "no plant"),
        (a_list_inside, "about a list of plants itself"),
    ],
)
def test_certificates_that_are_not_of_one_list_are_none(change: Callable[[Document], None], said: str) -> None:
    changed = document()
    change(changed)
    with pytest.raises(CertificateError, match=said):
        recheck(changed)


def test_a_list_and_a_plant_do_not_pass_for_each_other() -> None:
    spec = mismatch()
    alone: DesignSpec = replace(member_specs(spec)[0], name=spec.name)
    assert recheck(document(), alone).problems == ("the plants are not those of the spec",)
    one = json.loads(json.dumps(prove(alone, MISMATCH_GAINS).certificate_document()))
    assert recheck(one, spec).problems == ("the plants are not those of the spec",)


def test_a_spec_without_an_objective_may_have_a_limit_added_for_all_members() -> None:
    from fopi_tune.spec.default_objective import with_default_objective

    spec = parse_spec(MISMATCH.replace("objective: {minimize: iae_disturbance}\n", "")
                      .replace("  - sensitivity_db: {at_most: 6}\n", ""))  # fmt: skip
    designed = with_default_objective(spec)
    assert len(designed.requirements) == 2
    made = json.loads(json.dumps(prove(designed, MISMATCH_GAINS).certificate_document()))
    assert recheck(made, spec).problems == ()


@pytest.mark.parametrize("beyond", [1e-5, -1e-5])
def test_limits_beside_the_worst_value_are_not_proved_wrongly(beyond: float) -> None:
    spec = mixed()
    worst = prove(spec, MIXED_GAINS).verification.requirements[0].achieved
    assert worst is not None
    limited = replace(spec, requirements=(replace(spec.requirements[0], limits=(worst + beyond,)),))
    found = prove(limited, MIXED_GAINS, tolerance=1e-9)
    assert found.certificate.verdict is (Verdict.PROVED if beyond > 0.0 else Verdict.REFUTED)
