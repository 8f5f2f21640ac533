"""A document against its schema: the same verdict as jsonschema's, and a sentence that says where."""

from __future__ import annotations

from typing import Any

import jsonschema
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fopi_tune.results.schema.check import first_problem
from fopi_tune.results.schema.kinds import result_schema

TRADEOFF = result_schema("tradeoff")
STAMP = {
    "spec_sha256": "ab", "versions": {"numpy": "2"}, "python": "3", "platform": "x", "solver": None, "seed": None,
    "digests": {},
}  # fmt: skip
POINT = {
    "limit": 1.0,
    "status": "met",
    "objective": 2,
    "gains": {"kp": 1, "ki": 2, "alpha": 1},
    "largest_score": None,
    "binds": True,
}
DOCUMENT: dict[str, Any] = {
    "schema": 1,
    "status": "solved",
    "name": "x",
    "requirement": {"number": 1, "end": None, "name": "q", "relation": "at_most", "on": "family"},
    "objective_quantity": "words",
    "own": POINT,
    "points": [POINT, POINT],
    "ends": [{"side": "above", "last_feasible": 1.0, "first_infeasible": None}],
    "stamp": STAMP,
}


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({}, None),
        ({"schema": True}, "schema must be 1"),
        ({"status": "met"}, "status must be 'solved' or 'failed'"),
        ({"name": 3}, "name must be of type string"),
        ({"more": 3}, "the document has an entry 'more' that is not known"),
        ({"points": [POINT, {**POINT, "binds": 1}]}, "points[1].binds must be of type boolean"),
        ({"own": {**POINT, "limit": None}}, "own.limit must be of type number"),
        ({"own": {k: v for k, v in POINT.items() if k != "gains"}}, "own has no entry 'gains'"),
        ({"stamp": {**STAMP, "versions": {"numpy": 2}}}, "stamp.versions.numpy must be of type string"),
    ],
)
def test_the_first_mistake_is_told_with_its_place(change: dict[str, Any], said: str | None) -> None:
    document = {**DOCUMENT, **change}
    assert first_problem(document, TRADEOFF) == said
    assert jsonschema.Draft202012Validator(TRADEOFF).is_valid(document) == (said is None)


SCALARS = st.one_of(
    st.none(), st.booleans(), st.integers(-3, 3), st.floats(-2, 2), st.sampled_from(["met", "x", "at_most"])
)
KEYS = sorted({*DOCUMENT, *POINT, *STAMP, "number", "end"})


@settings(max_examples=200, deadline=None)
@given(st.data())
def test_the_verdict_is_that_of_jsonschema(data: st.DataObject) -> None:
    document: Any = data.draw(
        st.fixed_dictionaries({}, optional=dict.fromkeys(DOCUMENT, SCALARS)).map(lambda change: DOCUMENT | change)
    )
    path = data.draw(st.sampled_from(["own", "requirement", "stamp"]))
    if isinstance(document[path], dict):
        document = {**document, path: {**document[path], data.draw(st.sampled_from(KEYS)): data.draw(SCALARS)}}
    assert (first_problem(document, TRADEOFF) is None) == jsonschema.Draft202012Validator(TRADEOFF).is_valid(document)
