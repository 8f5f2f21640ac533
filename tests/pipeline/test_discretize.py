"""A PID with a setpoint weight, and a fopid, through the stages of a digital controller: nothing is left out."""

from __future__ import annotations

import json
import re

import numpy as np
import pytest

from fopi_tune.core.controller import FoPi, FoPid, Pid
from fopi_tune.core.plant import Plant
from fopi_tune.digital.implementation import implementation_of
from fopi_tune.errors import DomainError
from fopi_tune.pipeline.discretize import discretize
from fopi_tune.pipeline.prove import prove
from fopi_tune.pipeline.simulate import simulate
from fopi_tune.pipeline.validate import validate
from fopi_tune.proof.output_limits import limits_mismatches, prove_with_limits
from fopi_tune.report.documents import documents_of
from fopi_tune.report.figures.members import members_of
from fopi_tune.report.figures.plots import digital_picture
from fopi_tune.simulation.fractional.linear import Signal, exact_response
from fopi_tune.simulation.fractional.poles import principal_poles
from fopi_tune.spec import parse_spec
from fopi_tune.spec.model import DesignSpec

GAINS = Pid(2.0, 0.8, 1.5, 0.1)
FOPID = FoPid(2.0, 0.8, 0.9, 1.5, 0.8, 0.1)
SPEC = """\
schema: 1
name: pid
plant: {{model: lag, static_gain: {{min: 0.9, max: 1.1}}, time_constant_s: 2}}
controller: {{structure: pid, derivative_filter_time_constant_s: 0.1, setpoint_weight: {weight}}}
digital: {{sample_time_s: 0.05, design: sampled, output_limits: [{low}, 50]}}
requirements: [{{sensitivity_db: {{at_most: 6}}}}]
scenarios: [{{name: step, duration_s: 10, reference: [{{at_s: 0, value: 1}}]}}]
limits: [{{peak_control: {{at_most: 1.5}}}}]
validation: {{samples: 20}}
"""


def spec_of(weight: float = 0.5, low: float = -50.0) -> DesignSpec:
    return parse_spec(SPEC.format(weight=weight, low=low))


def fopid_spec(weight: float = 0.5) -> DesignSpec:
    text = SPEC.format(weight=weight, low=-50.0)
    return parse_spec(text.replace("structure: pid", "structure: fopid").replace(", design: sampled", ""))


def test_a_fopid_is_simulated_and_judged_with_drawn_plants() -> None:
    rates = []
    for weight in (1.0, 0.5):
        found = simulate(fopid_spec(weight), FOPID)
        integral = implementation_of(fopid_spec(), FOPID).sections.parts
        assert integral is not None
        first = found.driven[0].traces.demanded[0, 0]
        # kp b and the integral's direct part; the derivative's of 2 kd/(2 Tf + Ts) = 12 would be seen
        assert first == pytest.approx(2.0 * weight + integral.integral, rel=1e-12)
        rates.append(validate(fopid_spec(weight), FOPID).evidence.limits[0].fraction.estimate)
    assert rates == [0.0, 1.0]


def test_a_fopids_loop_on_samples_is_proved_drawn_and_written() -> None:
    spec = fopid_spec(1.0)
    made = discretize(spec, FOPID)
    assert made.status == "met"
    assert made.certificate is not None
    assert made.certificate.verdict.value == "proved"
    said = json.loads(json.dumps(made.to_dict()))
    assert len(said["controller"]["derivative"]["sections"]) == 8
    documents = documents_of(spec, json.loads(json.dumps(prove(spec, FOPID).to_dict())), said)
    members = members_of(documents)
    assert members is not None
    assert digital_picture(documents) is not None
    # the requirements are about the continuous loop, whose figures are of the gains themselves
    np.testing.assert_allclose(members.controller, FOPID(1j * members.omega), rtol=1e-12)
    omega = np.geomspace(0.01, 50.0, 20)
    found = made.to_control().controller(np.exp(1j * omega * 0.05))
    np.testing.assert_allclose(np.ravel(found), made.controller.sections.response(omega), rtol=1e-9)


def test_simulations_weight_the_setpoint_and_never_differentiate_it() -> None:
    for weight in (0.0, 0.5, 1.0):
        found = simulate(spec_of(weight), GAINS)
        first = found.driven[0].traces.demanded[0, 0]
        # kp b and half a sample of the integral; kd/Tf = 15 would be seen
        assert first == pytest.approx(2.0 * weight + 0.8 * 0.025, rel=1e-12)


def test_drawn_plants_are_judged_with_the_weight() -> None:
    # |u| starts at 2.02 with b = 1; with b = 0.5 it ends at 1.11 at most, by an integral without overshoot
    rates = [validate(spec_of(weight), GAINS).evidence.limits[0].fraction.estimate for weight in (1.0, 0.5)]
    assert rates == [0.0, 1.0]


def test_the_document_states_the_weight_and_the_derivative_and_can_be_written() -> None:
    said = json.loads(json.dumps(discretize(spec_of(), GAINS, proof=False).to_dict()))
    assert said["setpoint_weight"] == 0.5
    assert said["controller"]["derivative"]["direct"] == pytest.approx(2.0 * 1.5 / 0.25)
    assert "setpoint_weight" not in discretize(spec_of(1.0), GAINS, proof=False).to_dict()


def test_figures_compare_with_the_whole_controller() -> None:
    spec = spec_of()
    made = discretize(spec, GAINS, proof=False)
    documents = documents_of(
        spec, json.loads(json.dumps(prove(spec, GAINS).to_dict())), json.loads(json.dumps(made.to_dict()))
    )
    picture, members = digital_picture(documents), members_of(documents)
    assert picture is not None
    assert members is not None
    worst = re.search(r"relative error: at most ([0-9.]+) %", picture.description)
    assert worst is not None
    # Tustin's rule at 0.3 of Nyquist's frequency; without kd the ideal controller would be off by a factor of 7
    assert float(worst[1]) < 10.0
    np.testing.assert_allclose(members.controller, made.controller.sections.response(members.omega), rtol=1e-12)


def test_objects_of_control_are_the_sum_of_all_sections() -> None:
    made = discretize(spec_of(), GAINS, proof=False)
    omega = np.geomspace(0.01, 50.0, 20)
    found = made.to_control().controller(np.exp(1j * omega * 0.05))
    np.testing.assert_allclose(np.ravel(found), made.controller.sections.response(omega), rtol=1e-10)


def test_that_a_pid_is_stable_with_its_limits_is_not_available_and_a_weight_changes_no_such_proof() -> None:
    spec = spec_of(0.5, -1.0)
    limited = prove_with_limits(spec, implementation_of(spec, GAINS))
    assert limited is not None
    assert limited.proof is None
    assert "a derivative" in limited.reason
    text = SPEC.format(weight="0.5", low="-1").replace("structure: pid, derivative_filter_time_constant_s: 0.1, ", "")
    weighted, plain = parse_spec(text), parse_spec(text.replace("setpoint_weight: 0.5", ""))
    gains = FoPi(1.0, 0.8, 1.0)
    one, two = (prove_with_limits(each, implementation_of(each, gains)) for each in (weighted, plain))
    assert one is not None
    assert two is not None
    assert one.proof is not None
    assert one.statement == two.statement
    # a proof of a controller without a derivative does not belong to a spec with one
    assert limits_mismatches(one, spec) == ["with_limits: nothing is shown for structure: pid"]


def test_what_knows_no_derivative_refuses_it_by_name() -> None:
    spec, lag = spec_of(1.0), Plant((1.0,), (2.0, 1.0))
    with pytest.raises(DomainError, match="structure: pid"):
        exact_response(GAINS, lag, Signal.OUTPUT_AFTER_REFERENCE, np.array([1.0]))
    with pytest.raises(DomainError, match="structure: pid"):
        principal_poles(GAINS, lag)
    with pytest.raises(DomainError, match="structure: pid"):
        simulate(spec, GAINS, exact=True)


def test_the_exact_simulation_refuses_a_weight_by_name() -> None:
    text = SPEC.format(weight="0.5", low="-1").replace("structure: pid, derivative_filter_time_constant_s: 0.1, ", "")
    with pytest.raises(DomainError, match=r"setpoint_weight 0\.5"):
        simulate(parse_spec(text), FoPi(1.0, 0.8, 1.0), exact=True)
