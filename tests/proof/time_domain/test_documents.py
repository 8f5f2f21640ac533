"""Proofs survive their JSON; what is no proof of the case is refused with its place."""

from __future__ import annotations

import copy
import json
from dataclasses import replace
from typing import Any

import pytest
from cases.time_domain_cases import at_most, brake_ramp, three_numbers

from fopi_tune.errors import CertificateError
from fopi_tune.proof.time_domain import prove_limit
from fopi_tune.proof.time_domain.documents import from_document, to_document

CASE = brake_ramp()


@pytest.mark.parametrize("limit", [2.0, 1.99])
def test_proofs_and_refutations_survive(limit: float) -> None:
    case = at_most(CASE, limit)
    proof = prove_limit(case)
    assert from_document(case, json.loads(json.dumps(to_document(case, proof)))) == proof


def test_what_is_undecided_survives() -> None:
    case = at_most(three_numbers(), 0.1001)
    for proof in (
        prove_limit(case, budget=3),
        prove_limit(replace(case, scenario=replace(case.scenario, quantum=0.1))),
    ):
        assert proof.message
        assert from_document(case, json.loads(json.dumps(to_document(case, proof)))) == proof


CHANGES: list[tuple[dict[str, Any], str]] = [
    ({"limit": 2.1}, "not about this limit"),
    ({"scenario": "step"}, "not about this limit"),
    ({"tolerance": 0.5}, "tolerance"),
    ({"examined": -1}, "examined"),
    ({"examined": 1.5}, "examined"),
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
    ({"message": "\x1b[2J"}, "message"),
]


@pytest.mark.parametrize("number", range(len(CHANGES)))
def test_what_is_no_proof_of_the_case_is_refused(number: int) -> None:
    change, named = CHANGES[number]
    document = to_document(CASE, prove_limit(CASE)) | change
    with pytest.raises(CertificateError, match=named.replace("[", r"\[")):
        from_document(CASE, document, "time_domain[0]")


def test_every_entry_is_needed() -> None:
    document = to_document(CASE, prove_limit(CASE))
    for key in document:
        less = copy.deepcopy(document)
        del less[key]
        with pytest.raises(CertificateError, match="is missing"):
            from_document(CASE, less)
