"""The proof of the optimum knows no scenarios: what it is refused for."""

from __future__ import annotations

import pytest

import fopi_tune as ft
from fopi_tune.pipeline.optimum import recheck_optimum

TEXT = """
schema: 1
name: stepped
plant: {model: lag, static_gain: 10, time_constant_s: {nominal: 2.25, min: 1.6, max: 3.1}}
controller: {structure: pi, kp: {min: 0, max: 5}, ki: {min: 0, max: 5}}
requirements: [{sensitivity_db: {at_most: 4}}, {peak_control: {at_most: 2}, scenario: step}]
objective: {maximize: ki}
digital: {sample_time_s: 0.2}
scenarios: [{name: step, duration_s: 20, reference: [{at_s: 0, value: 10}]}]
"""
BY_OBJECTIVE = TEXT.replace(", {peak_control: {at_most: 2}, scenario: step}", "").replace(
    "{maximize: ki}", "{minimize: iae, scenario: step}"
)


@pytest.mark.parametrize("text", [TEXT, BY_OBJECTIVE])
def test_the_proof_of_the_optimum_is_refused_for_requirements_and_objectives_of_scenarios(text: str) -> None:
    spec = ft.parse_spec(text)
    with pytest.raises(ft.DomainError, match="knows nothing of what scenarios measure"):
        ft.certify_optimum(spec, ft.FoPi(0.1, 0.1, 1.0))
    with pytest.raises(ft.DomainError, match="knows nothing of what scenarios measure"):
        recheck_optimum({}, spec)
