"""What a proof of a scenario must not say: an undershoot below 0, a witness within the limit, a bound beyond it."""

from __future__ import annotations

from dataclasses import replace

import pytest

import fopi_tune as ft
from fopi_tune.digital.implementation import implementation_of
from fopi_tune.proof.scenario_proofs import cases_of
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
