"""Certificates of a PID with its numbers changed or left out, and the digest made to fit:  refused."""

from __future__ import annotations

import copy
import functools
import json
from collections.abc import Callable
from typing import Any

import pytest

import fopi_tune as ft
from fopi_tune.core.controller import Pid
from fopi_tune.proof import certify, verify
from fopi_tune.proof.certificate import Verdict
from fopi_tune.proof.documents import digest, from_document, to_document
from fopi_tune.spec import parse_spec
from fopi_tune.spec.model import DesignSpec

Document = dict[str, Any]
TEXT = """\
schema: 1
name: pid
plant: {model: lag, static_gain: 1, time_constant_s: {min: 0.8, max: 1.5}, dead_time_s: 0.5}
controller: {structure: STRUCTURE}
requirements:
  - {sensitivity_db: {at_most: 8}}
  - {control_sensitivity_db: {at_most: 20}}
  - {phase_margin_deg: {at_least: 45}}
  - {crossover_rad_s: {between: [0.7, 2]}}
"""
FILTER = "pid, derivative_filter_time_constant_s: 0.05"
SPEC = parse_spec(TEXT.replace("STRUCTURE", FILTER))
PID = Pid(1.2, 1.0, 0.3, 0.05)


@functools.cache
def case(sampled: bool) -> tuple[DesignSpec, Document]:
    spec, implementation = SPEC, None
    if sampled:
        from fopi_tune.digital.implementation import implementation_of

        spec = parse_spec(TEXT.replace("STRUCTURE", FILTER) + "digital: {sample_time_s: 0.05, design: sampled}\n")
        implementation = implementation_of(spec, PID)
    certificate = certify(spec, verify(spec, PID, implementation=implementation), {}, implementation)
    return spec, json.loads(json.dumps(to_document(certificate), allow_nan=False))


def problems(change: Callable[[Document], object], spec: DesignSpec | None, sampled: bool = False) -> str:
    """What is wrong with a changed certificate; empty when it is accepted."""
    document = copy.deepcopy(case(sampled)[1])
    change(document)
    document["digest"] = digest(document)
    try:
        return "; ".join(ft.recheck(document, spec).problems)
    except ft.CertificateError as error:
        return str(error)


def gains(**numbers: float | None) -> Callable[[Document], None]:
    """Numbers times a factor; None leaves one out."""

    def change(document: Document) -> None:
        for name, factor in numbers.items():
            if factor is None:
                del document["gains"][name]
            else:
                document["gains"][name] *= factor

    return change


FILTER_NAME = "derivative_filter_time_constant_s"
CHANGED = {
    "kd a little larger": gains(kd=1.001),
    "kd a little smaller": gains(kd=0.999),
    "no kd": gains(kd=0.0),
    "kd of the other sign": gains(kd=-1.0),
    "a slower filter": gains(**{FILTER_NAME: 1.001}),
    "a faster filter": gains(**{FILTER_NAME: 0.999}),
    "neither kd nor filter": gains(kd=None, **{FILTER_NAME: None}),
    "kp a little larger": gains(kp=1.001),
    "ki a little smaller": gains(ki=0.999),
}


@pytest.mark.parametrize("sampled", [False, True])
def test_what_is_written_is_proved_and_sound(sampled: bool) -> None:
    spec, document = case(sampled)
    assert problems(lambda document: None, spec, sampled) == ""
    assert document["verdict"] == "proved"
    assert document["gains"] == {"kp": 1.2, "ki": 1.0, "alpha": 1.0, "kd": 0.3, FILTER_NAME: 0.05}
    assert from_document(document).case.gains == PID


@pytest.mark.parametrize("name", CHANGED)
def test_changed_gains_are_refused_without_the_spec_too(name: str) -> None:
    assert problems(CHANGED[name], None)


@pytest.mark.thinned(2)
@pytest.mark.parametrize("name", CHANGED)
def test_changed_gains_of_a_controller_on_samples_are_refused(name: str) -> None:
    """The proof is about the sections; that they are the gains' own is known where there is a spec."""
    spec, _ = case(True)
    document = copy.deepcopy(case(True)[1])
    CHANGED[name](document)
    document["digest"] = digest(document)
    assert not ft.recheck(document, spec).is_sound


@pytest.mark.parametrize("name", ["kd", FILTER_NAME])
def test_one_of_the_derivatives_numbers_alone_is_no_certificate(name: str) -> None:
    assert "missing" in problems(gains(**{name: None}), None)


@pytest.mark.parametrize("filter_s", [0.0, -0.05])
def test_a_filter_that_does_not_exist_is_no_certificate(filter_s: float) -> None:
    assert "greater than" in problems(lambda document: document["gains"].update({FILTER_NAME: filter_s}), None)


def test_another_filter_than_the_specs_is_refused_however_close() -> None:
    assert "structure" in problems(gains(**{FILTER_NAME: 1.0 + 1e-12}), SPEC)


def test_a_certificate_of_a_pid_is_none_of_a_spec_of_another_structure() -> None:
    fopi = parse_spec(TEXT.replace("STRUCTURE", "fopi"))
    assert "structure" in problems(lambda document: None, fopi)
    with pytest.raises(ft.DomainError, match="another structure"):
        ft.prove(fopi, PID)
    with pytest.raises(ft.DomainError, match="another structure"):
        ft.prove(SPEC, ft.FoPi(1.2, 1.0, 1.0))


@pytest.mark.parametrize("entry", ["poles", "residues"])
def test_a_changed_section_of_the_derivative_is_refused(entry: str) -> None:
    def change(document: Document) -> None:
        document["implementation"][entry][-1] *= 1.001

    assert problems(change, None, sampled=True)


def test_gains_that_miss_a_limit_are_refuted_at_a_plant_that_is_named() -> None:
    certificate = ft.prove(SPEC, Pid(1.2, 1.0, 1.5, 0.05)).certificate
    verdicts = [proof.verdict for proof in certificate.requirements]
    assert verdicts[1] is Verdict.REFUTED
    assert ft.recheck(json.loads(json.dumps(to_document(certificate))), SPEC).problems == ()


def test_a_certificate_beside_limits_that_nothing_is_shown_of_is_sound() -> None:
    from fopi_tune.digital.implementation import implementation_of

    digital = "digital: {sample_time_s: 0.05, design: sampled, output_limits: [-2, 3]}\n"
    spec = parse_spec(TEXT.replace("STRUCTURE", FILTER) + digital)
    implementation = implementation_of(spec, PID)
    certificate = certify(spec, verify(spec, PID, implementation=implementation), {}, implementation)
    document = json.loads(json.dumps(to_document(certificate), allow_nan=False))
    assert "a derivative" in document["with_limits"]["statement"]
    assert ft.recheck(document, spec).problems == ()


SCENARIO = """\
digital: {sample_time_s: 0.05, design: sampled}
scenarios: [{name: step, duration_s: 5, reference: [{at_s: 0, value: 1}]}]
"""
OTHERS = {
    "pid": (FILTER, PID),
    "weight": ("pi, setpoint_weight: 0.5", ft.FoPi(0.6, 0.5, 1.0)),
    "filter": (
        "pi, measurement_filter: {order: 1, time_constant_s: 0.1}",
        ft.FoPi(0.6, 0.5, 1.0, measurement_filter=ft.MeasurementFilter(1, 0.1)),
    ),
}


@pytest.mark.parametrize("name", OTHERS)
def test_a_requirement_on_a_scenario_is_left_to_the_check_and_cannot_be_said_to_be_proved(name: str) -> None:
    from fopi_tune.digital.implementation import implementation_of

    structure, gains = OTHERS[name]
    text = TEXT.replace("STRUCTURE", structure).split("  - {control")[0]
    spec = parse_spec(text + "  - {overshoot: {at_most: 0.9}, scenario: step}\n" + SCENARIO)
    implementation = implementation_of(spec, gains)
    certificate = certify(spec, verify(spec, gains, implementation=implementation), {}, implementation)
    document = json.loads(json.dumps(to_document(certificate), allow_nan=False))
    (entry,) = document["scenarios"]
    assert (entry["acts_on_error"], entry["proof"]["verdict"]) == (False, "undecided")
    assert certificate.verdict is Verdict.PROVED
    assert ft.recheck(document, spec).problems == ()
    for key, value in (("acts_on_error", True), ("verdict", "proved")):
        changed = copy.deepcopy(document)
        (changed["scenarios"][0] if key in entry else changed["scenarios"][0]["proof"])[key] = value
        changed["digest"] = digest(changed)
        assert ft.recheck(changed, spec).problems != ()
