"""Gains for fractional plants:  proved, and no gains of a fine neighbourhood or drawn at random are better."""

from __future__ import annotations

import numpy as np
import pytest

from fopi_tune.core.controller import FoPi
from fopi_tune.pipeline.tune import tune
from fopi_tune.proof import verify
from fopi_tune.proof.certificate import Verdict
from fopi_tune.proof.verification.results import Outcome
from fopi_tune.results.status import Status
from fopi_tune.spec import parse_spec
from fopi_tune.spec.model import DesignSpec

HEAT = """plant:
  model: fractional
  numerator: [{coefficient: {min: 60, max: 72, nominal: 66.16}, order: 0}]
  denominator: [{coefficient: 12.72, order: 0.5}, {coefficient: 1, order: 0}]
  dead_time_s: 1.93
"""
BEAM = """plant:
  model: fractional
  numerator: [{coefficient: 1, order: 0}, {coefficient: 0.2, order: 0.4}]
  denominator:
    - {coefficient: {min: 0.9, max: 1.1}, order: 0}
    - {coefficient: 0.8, order: 2.2}
    - {coefficient: {min: 0.4, max: 0.7}, order: 0.9}
  dead_time_s: 0.1
"""
DERIVATIVE = "derivative_filter_time_constant_s: 0.05"
FILTER = "measurement_filter: {order: 2, time_constant_s: 0.02}"
STRUCTURES = {
    "fopi": "{}",
    "pi": "{structure: pi}",
    "pid": f"{{structure: pid, {DERIVATIVE}}}",
    "fopid": f"{{structure: fopid, {DERIVATIVE}}}",
    "filtered": f"{{structure: fopid, {DERIVATIVE}, {FILTER}}}",
}
#: relative; the search's own goal
CLOSE = 1e-3


def spec_of(plant: str, controller: str, objective: str, most_db: float = 0.0) -> DesignSpec:
    return parse_spec(
        f"schema: 1\nname: a\n{plant}controller: {controller}\nrequirements:\n"
        f"  - {{phase_margin_deg: {{at_least: 50}}}}\n  - {{sensitivity_db: {{at_most: 4}}}}\n"
        f"  - {{control_sensitivity_db: {{at_most: {most_db}}}}}\n"
        f"objective: {objective}\n"
    )


@pytest.mark.parametrize(
    ("plant", "structure"),
    [
        pytest.param(plant, structure, marks=[pytest.mark.long] * (short != structure))
        for plant, short in (("heat", "fopi"), ("beam", ""))
        for structure in STRUCTURES
    ],
)
@pytest.mark.parametrize(
    "objective",
    ["{minimize: iae_disturbance}", pytest.param("{maximize: ki}", marks=pytest.mark.long)],
)
def test_gains_of_every_structure_are_found_and_proved(plant: str, structure: str, objective: str) -> None:
    written, most_db = (HEAT, 0.0) if plant == "heat" else (BEAM, 26.0)
    found = tune(spec_of(written, STRUCTURES[structure], objective, most_db))
    assert found.status is Status.SOLVED
    certificate = found.certificate
    assert certificate is not None
    assert certificate.stability.verdict is Verdict.PROVED
    assert [each.verdict for each in certificate.requirements] == [Verdict.PROVED] * 3


@pytest.mark.parametrize("count", [12, pytest.param(150, marks=pytest.mark.long)])
def test_no_gains_near_the_optimum_or_far_from_it_are_better(count: int) -> None:
    spec = spec_of(HEAT, "{}", "{minimize: iae_disturbance}")
    found = tune(spec, proof=False)
    assert found.gains is not None
    assert found.objective is not None
    rng, best, met = np.random.default_rng(7), found.objective, 0
    for k in range(count):
        reach = (0.003, 0.03, 0.3, 1.0)[k % 4]
        kp, ki, alpha = (float(x * np.exp(reach * rng.standard_normal())) for x in (
            found.gains.kp, found.gains.ki, found.gains.alpha,
        ))  # fmt: skip
        if not 0.1 <= alpha <= 1.9:
            continue
        other = verify(spec, FoPi(kp, ki, alpha))
        if any(each.outcome is not Outcome.MET for each in other.requirements) or other.objective is None:
            continue
        met += 1
        assert other.objective >= best * (1.0 - CLOSE)
    assert met


def test_a_plant_of_whole_orders_gets_the_gains_of_the_transfer_function() -> None:
    # 1.0263/(s (0.71 s + 1))
    rest = "  dead_time_s: 0.05\n"
    fractional = (
        "plant:\n  model: fractional\n  numerator: [{coefficient: {min: 0.95, max: 1.1}, order: 0}]\n"
        "  denominator: [{coefficient: 1, order: 1}, {coefficient: 0.71, order: 2}]\n"
    )
    polynomials = (
        "plant:\n  model: transfer_function\n  numerator: [{min: 0.95, max: 1.1}]\n  denominator: [0.71, 1, 0]\n"
    )
    one, other = (
        tune(spec_of(plant + rest, "{}", "{minimize: iae_disturbance}", 20.0)) for plant in (fractional, polynomials)
    )
    assert one.status is Status.SOLVED
    assert (one.gains, one.objective) == (other.gains, other.objective)
    assert one.certificate is not None
    assert other.certificate is not None
    assert [r.verdict for r in one.certificate.requirements] == [r.verdict for r in other.certificate.requirements]


def test_orders_that_are_nearly_whole_get_nearly_the_gains_of_the_transfer_function() -> None:
    plant = (
        "plant:\n  model: fractional\n  numerator: [{coefficient: {min: 0.95, max: 1.1}, order: 0}]\n"
        "  denominator: [{coefficient: 1, order: %s}, {coefficient: 0.71, order: 2}, {coefficient: 0.1, order: 0}]\n"
    )
    exact, near = (
        tune(spec_of(plant % order, "{structure: pi}", "{maximize: ki}", 20.0), proof=False).objective
        for order in ("1", "1.0000001")
    )
    assert exact is not None
    # the objective's slope by the order is of the size of the objective
    assert near == pytest.approx(exact, rel=1e-5)
