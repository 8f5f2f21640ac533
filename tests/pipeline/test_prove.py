"""Certificates and specs that changed since:  what the certificate depends on counts, nothing else."""

from __future__ import annotations

import json
from dataclasses import replace
from typing import Any

import pytest

import fopi_tune as ft
from fopi_tune.pipeline.prove import recheck
from fopi_tune.spec import load_spec, parse_spec
from fopi_tune.spec.model import Relation, Requirement

TEXT = """\
schema: 1
name: small
plant: {model: lag, static_gain: 1, time_constant_s: {min: 1, max: 2}, dead_time_s: 0.2}
controller: {kp: {min: 0, max: 9}, ki: {min: 0, max: 9}, alpha: 1}
requirements:
  - phase_margin_deg: {at_least: 50}
digital: {sample_time_s: 0.1}
"""
SCENARIOS = "scenarios: [{name: up, duration_s: 5, reference: [{at_s: 0, value: 1}]}]\n"
GAINS = ft.FoPi(1.0, 0.5, 1.0)


def certificate(text: str = TEXT) -> dict[str, Any]:
    return json.loads(json.dumps(ft.prove(parse_spec(text), GAINS).certificate_document()))


def test_a_scenario_or_a_comment_that_is_added_leaves_the_certificate() -> None:
    for text in (TEXT + SCENARIOS, "# a comment\n" + TEXT, TEXT.replace("max: 9", "max: 8")):
        assert recheck(certificate(), parse_spec(text)).is_sound


@pytest.mark.parametrize(
    ("old", "new"),
    [("at_least: 50", "at_least: 51"), ("max: 2}", "max: 2.1}"), ("dead_time_s: 0.2", "dead_time_s: 0.3")],
)
def test_a_plant_or_a_requirement_that_changed_does_not(old: str, new: str) -> None:
    assert not recheck(certificate(), parse_spec(TEXT.replace(old, new))).is_sound


def test_the_loop_on_samples_belongs_to_its_certificate() -> None:
    sampled = TEXT.replace("sample_time_s: 0.1", "sample_time_s: 0.1, design: sampled")
    found = certificate(sampled)
    assert recheck(found, parse_spec(sampled + SCENARIOS)).is_sound
    assert not recheck(found, parse_spec(sampled.replace("0.1, design", "0.11, design"))).is_sound


def test_a_spec_changed_in_python_has_a_hash_of_its_own() -> None:
    read = parse_spec(TEXT)
    changed = replace(read, requirements=(Requirement("phase_margin_deg", Relation.AT_LEAST, (40.0,)),))
    # at once, and not when it is first used
    assert changed.sha256 not in ("", read.sha256)
    assert replace(read).sha256 == replace(changed, requirements=read.requirements).sha256 == read.sha256
    checks = [ft.prove(spec, GAINS) for spec in (read, changed, replace(read))]
    first, second, third = (check.certificate.spec_sha256 for check in checks)
    assert first == third == read.sha256
    assert second == changed.sha256 != first
    assert checks[1].stamp.spec_sha256 == second
    assert load_spec(load_spec(changed)).sha256 == second
    # one that was made in Python
    bare = replace(read, text_sha256="", content_sha256="", source=b"")
    assert len(ft.prove(bare, GAINS).certificate.spec_sha256) == 64
