"""Proofs survive their JSON; what is no proof of the case is refused with its place."""

from __future__ import annotations

import copy
import json
from dataclasses import replace
from functools import cache
from typing import Any

import pytest
from cases.time_domain_cases import at_most, brake_ramp, three_numbers

from fopi_tune.errors import CertificateError
from fopi_tune.proof.time_domain import TimeDomainProof, prove_limit
from fopi_tune.proof.time_domain.documents import from_document, to_document
from fopi_tune.proof.verdict import Verdict

CASE = brake_ramp()


@cache
def proof_of_the_case() -> TimeDomainProof:
    return prove_limit(CASE)


@pytest.mark.parametrize("limit", [2.0, 1.99])
def test_proofs_and_refutations_survive(limit: float) -> None:
    case = at_most(CASE, limit)
    proof = prove_limit(case)
    # how it was found is left out: a recheck could not test it
    told = replace(proof, method="", examined=0)
    assert from_document(case, json.loads(json.dumps(to_document(case, proof)))) == told


def test_what_is_undecided_survives() -> None:
    case = at_most(three_numbers(), 0.1001)
    for proof in (
        prove_limit(case, budget=3),
        prove_limit(replace(case, scenario=replace(case.scenario, quantum=0.1))),
    ):
        assert proof.message
        told = TimeDomainProof(Verdict.UNDECIDED, "", proof.tolerance)
        assert from_document(case, json.loads(json.dumps(to_document(case, proof)))) == told


CHANGES: list[tuple[dict[str, Any], str]] = [
    ({"limit": 2.1}, "not about this limit"),
    ({"scenario": "step"}, "not about this limit"),
    ({"tolerance": 0.5}, "tolerance"),
    ({"verdict": "perhaps"}, "verdict"),
    ({"bound": "2"}, "bound"),
    ({"bound": float("nan")}, "bound"),
    ({"plant": {"gain": 1.0}}, "other numbers"),
    ({"plant": [1.0]}, "no object"),
    ({"boxes": {}}, "boxes"),
    ({"boxes": [[1.6]]}, "boxes[0]"),
    ({"boxes": [[1.6, "3.1"]]}, "boxes[0]"),
    ({"boxes": [[3.1, 1.6]]}, "boxes[0]"),
    ({"boxes": [[1.6, 3.1, 0.0, 1.0]]}, "boxes[0]"),
    ({"time_s": 3.2}, "do not belong to its verdict"),
    ({"verdict": "undecided"}, "do not belong to its verdict"),
    ({"verdict": "refuted"}, "do not belong to its verdict"),
]


@pytest.mark.parametrize("number", range(len(CHANGES)))
def test_what_is_no_proof_of_the_case_is_refused(number: int) -> None:
    change, named = CHANGES[number]
    document = to_document(CASE, proof_of_the_case()) | change
    with pytest.raises(CertificateError, match=named.replace("[", r"\[")):
        from_document(CASE, document, "time_domain[0]")


def test_every_entry_is_needed() -> None:
    document = to_document(CASE, proof_of_the_case())
    for key in document:
        less = copy.deepcopy(document)
        del less[key]
        with pytest.raises(CertificateError, match="is missing"):
            from_document(CASE, less)
