"""Certificates of a derivative of any order with numbers changed or left out, and the digest made to fit: refused."""

from __future__ import annotations

import copy
import functools
import json
from collections.abc import Callable
from typing import Any

import pytest

import fopi_tune as ft
from fopi_tune.core.controller import FoPid, Pid
from fopi_tune.proof import certify, verify
from fopi_tune.proof.documents import digest, from_document, to_document
from fopi_tune.spec import parse_spec
from fopi_tune.spec.model import DesignSpec

Document = dict[str, Any]
TEXT = """\
schema: 1
name: fopid
plant: {model: lag, static_gain: 1, time_constant_s: {min: 0.8, max: 1.5}, dead_time_s: 0.5}
controller: {structure: STRUCTURE}
requirements:
  - {sensitivity_db: {at_most: 8}}
  - {control_sensitivity_db: {at_most: 20}}
  - {phase_margin_deg: {at_least: 40}}
  - {crossover_rad_s: {between: [0.5, 2]}}
"""
SPEC = parse_spec(TEXT.replace("STRUCTURE", "fopid, derivative_filter_time_constant_s: 0.05"))
FOPID = FoPid(0.9, 0.9, 0.9, 0.4, 0.7, 0.05)
FILTER_NAME = "derivative_filter_time_constant_s"


@functools.cache
def case() -> Document:
    certificate = certify(SPEC, verify(SPEC, FOPID), {})
    return json.loads(json.dumps(to_document(certificate), allow_nan=False))


def problems(change: Callable[[Document], object], spec: DesignSpec | None) -> str:
    """What is wrong with a changed certificate; empty when it is accepted."""
    document = copy.deepcopy(case())
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


CHANGED = {
    "mu a little larger": gains(mu=1.001),
    "mu a little smaller": gains(mu=0.999),
    "mu left out": gains(mu=None),
    "mu 1": gains(mu=1.0 / 0.7),
    "improper": gains(mu=2.0),
    "no derivative at all": gains(mu=None, kd=None, **{FILTER_NAME: None}),
    "mu without kd": gains(kd=None),
    "mu without a filter": gains(**{FILTER_NAME: None}),
    "alpha a little larger": gains(alpha=1.001),
    "kd a little smaller": gains(kd=0.999),
    "no kd": gains(kd=0.0),
    "a faster filter": gains(**{FILTER_NAME: 0.999}),
}


def test_what_is_written_is_proved_and_sound() -> None:
    assert problems(lambda document: None, SPEC) == ""
    assert case()["verdict"] == "proved"
    assert case()["gains"] == {"kp": 0.9, "ki": 0.9, "alpha": 0.9, "kd": 0.4, "mu": 0.7, FILTER_NAME: 0.05}
    assert from_document(case()).case.gains == FOPID


@pytest.mark.parametrize("name", CHANGED)
def test_changed_gains_are_refused_without_the_spec_too(name: str) -> None:
    assert problems(CHANGED[name], None)


def test_a_certificate_of_a_fopid_is_none_of_a_spec_of_another_structure() -> None:
    for structure in ("fopi", "pid, derivative_filter_time_constant_s: 0.05"):
        other = parse_spec(TEXT.replace("STRUCTURE", structure))
        assert "structure" in problems(lambda document: None, other)
        with pytest.raises(ft.DomainError, match="another structure"):
            ft.prove(other, FOPID)
    with pytest.raises(ft.DomainError, match="another structure"):
        ft.prove(SPEC, ft.FoPi(0.9, 0.9, 0.9))
    assert "structure" in problems(gains(**{FILTER_NAME: 1.0 + 1e-12}), SPEC)


def test_a_pid_is_a_fopid() -> None:
    assert ft.prove(SPEC, Pid(1.2, 1.0, 0.3, 0.05)).certificate.verdict.value == "proved"
