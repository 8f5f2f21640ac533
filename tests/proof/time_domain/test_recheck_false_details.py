"""What a proof of a scenario must not say: an undershoot below 0, a witness within the limit, a bound beyond it."""

from __future__ import annotations

from dataclasses import replace

import pytest

import fopi_tune as ft
from fopi_tune.core.parallel_form import Implementation, Sections
from fopi_tune.digital.implementation import implementation_of
from fopi_tune.errors import CertificateError
from fopi_tune.proof.scenario_proofs import (
    ScenarioProof,
    cases_of,
    read_scenario_proofs,
    scenario_entries,
    scenario_problems,
)
from fopi_tune.proof.strict_json import JsonObject
from fopi_tune.proof.time_domain import TimeDomainCase, prove_limit, recheck_limit
from fopi_tune.proof.verdict import Verdict
from fopi_tune.spec import parse_spec
from fopi_tune.spec.model import Limit, Relation

#: the load has lifted the output above 1 when the step to 2 begins
_SPEC = """\
schema: 1
name: a
plant: {model: lag, static_gain: 1, time_constant_s: {min: 1.9, max: 2}}
digital: {sample_time_s: 0.2}
scenarios:
- {name: up, duration_s: 30, judged_from_s: 20, load: [{at_s: 19, value: 0.5}],
   reference: [{at_s: 0, value: 1}, {at_s: 20, value: 2}]}
requirements: [{undershoot: {at_least: 0}}, {overshoot: {at_most: 0.9}}, {overshoot: {at_most: 0.001}}]
"""


@pytest.fixture(scope="module")
def cases() -> list[TimeDomainCase]:
    spec = parse_spec(_SPEC)
    return [case for _, case in cases_of(spec, implementation_of(spec, ft.FoPi(1.0, 1.0, 1.0)))]


def test_an_output_that_never_goes_back_has_the_undershoot_0(cases: list[TimeDomainCase]) -> None:
    assert prove_limit(cases[0]).verdict is Verdict.PROVED
    case = replace(cases[0], limit=Limit("undershoot", Relation.AT_MOST, -0.01))
    below = prove_limit(case)
    assert (below.verdict, below.value) == (Verdict.REFUTED, 0.0)
    assert recheck_limit(case, below) == ()


def test_a_bound_beyond_the_limit_is_found(cases: list[TimeDomainCase]) -> None:
    proved = prove_limit(cases[1])
    assert recheck_limit(cases[1], proved) == ()
    assert "does not meet the limit" in recheck_limit(cases[1], replace(proved, bound=0.91))[0]


def test_a_witness_within_the_limit_is_found(cases: list[TimeDomainCase]) -> None:
    refuted = prove_limit(cases[2])
    assert refuted.verdict is Verdict.REFUTED
    assert recheck_limit(cases[2], refuted) == ()
    assert "does not miss the limit" in recheck_limit(cases[2], replace(refuted, value=0.0005))[0]


def test_a_tolerance_of_its_own_is_found(cases: list[TimeDomainCase]) -> None:
    wide = prove_limit(cases[1], tolerance=1e-3)
    assert recheck_limit(cases[1], wide) == ()
    assert scenario_problems([ScenarioProof(0, cases[1], wide)], 1e-6) == [
        "scenarios[0]: its tolerance 0.001 is not the certificate's"
    ]


def test_a_requirement_that_is_left_out_is_found(cases: list[TimeDomainCase]) -> None:
    proofs = [ScenarioProof(index, cases[1], prove_limit(cases[1])) for index in (0, 1)]
    assert scenario_problems(proofs, 1e-6) == []
    assert scenario_problems([replace(proofs[1], index=2), proofs[0]], 1e-6) == [
        "scenarios: requirement 2 stands where requirement 0 is expected",
        "scenarios: requirement 0 stands where requirement 3 is expected",
    ]
    assert "requirement 1 stands where requirement 0" in scenario_problems(proofs[1:], 1e-6)[0]


def test_a_scenario_judged_from_before_its_start_is_none(cases: list[TimeDomainCase]) -> None:
    case = cases[1]
    implementation = Implementation(case_sections(case), case.delay_samples)
    entries = scenario_entries([ScenarioProof(0, case, prove_limit(case))])
    read = read_scenario_proofs([JsonObject(entries[0], "scenarios[0]")], case.family, implementation)
    assert scenario_problems(read, 1e-6) == []
    for judged in (-0.1, 30.0):
        entries[0]["scenario"]["judged_from_s"] = judged
        with pytest.raises(CertificateError, match="judged_from_s"):
            read_scenario_proofs([JsonObject(entries[0], "scenarios[0]")], case.family, implementation)


def case_sections(case: TimeDomainCase) -> Sections:
    runtime = case.controller
    return Sections(case.sample_time_s, runtime.direct, runtime.poles, runtime.residues)


def test_the_search_ends_where_not_even_one_plant_can_be_enclosed(cases: list[TimeDomainCase]) -> None:
    slow = replace(cases[1], scenario=replace(cases[1].scenario, rate_per_s=0.1))
    found = prove_limit(slow)
    assert found.verdict is Verdict.UNDECIDED
    assert "single plant: the actuator's rate limit may be reached" in found.message
    assert found.examined <= 4
