"""The nominal margins of a result: what a report may rely on."""

from __future__ import annotations

import json
import re
from typing import Any

import pytest
from cases.reports import BRAKE, brake_documents, run_of

from fopi_tune.errors import DomainError
from fopi_tune.report.documents import documents_of, documents_of_run
from fopi_tune.spec import parse_spec


def design_with(nominal: dict[str, Any]) -> dict[str, Any]:
    design = json.loads(json.dumps(brake_documents().design))
    design["nominal"] = {key: value for key, value in {**design["nominal"], **nominal}.items() if value != "left out"}
    return design


def test_the_margins_of_an_unstable_loop_are_null() -> None:
    nothing = {"stable": False, "phase_margin_deg": None, "gain_margin_db": None, "delay_margin_s": None}
    assert documents_of(parse_spec(BRAKE), design_with(nothing)).design["nominal"]["stable"] is False


@pytest.mark.parametrize(
    ("nominal", "words"),
    [
        # a result from before margins were distances of stable loops says nothing of stability
        ({"stable": "left out"}, "nominal.stable is missing"),
        ({"stable": 1.0}, "nominal.stable is neither true nor false"),
        ({"phase_margin_deg": "wide"}, "nominal.phase_margin_deg is no finite number"),
        ({"delay_margin_s": "left out"}, "nominal.delay_margin_s is missing"),
        ({"angles_from_minus_one_deg": "left out"}, "nominal.angles_from_minus_one_deg is missing"),
        ({"angles_from_minus_one_deg": []}, "nominal.angles_from_minus_one_deg is not one for each crossover"),
        ({"gain_crossovers_rad_s": [None]}, "gain_crossovers_rad_s"),
    ],
)
def test_nominal_margins_that_are_not_as_this_tool_writes_them_are_refused(nominal: dict[str, Any], words: str) -> None:
    with pytest.raises(DomainError, match=re.escape(words)):
        documents_of(parse_spec(BRAKE), design_with(nominal))


NO_INTEGRAL = """schema: 1
name: no_integral
plant: {model: pole, gain: 0.3, pole_rad_s: 0}
controller: {kp: {min: 0, max: 5}, ki: 0, alpha: 1}
requirements:
  - {crossover_rad_s: {equals: 0.3}}
digital: {sample_time_s: 0.2, design: sampled}
"""


def test_the_digital_controller_of_a_design_without_integral_action_has_no_poles() -> None:
    documents = documents_of_run(run_of(NO_INTEGRAL))
    assert documents.digital is not None
    assert documents.digital["controller"]["sections"] == []
    # which that of another design may not lack
    digital = json.loads(json.dumps(brake_documents().digital))
    digital["controller"]["sections"] = []
    with pytest.raises(DomainError, match="no poles of a controller"):
        documents_of(parse_spec(BRAKE), brake_documents().design, digital)
