"""A spec that was changed in Python and written: what is read again says the same, whatever was changed."""

from __future__ import annotations

import dataclasses
import json
import pickle
from pathlib import Path
from typing import Any

import pytest
from cases.measured import TWO, csv, text_of
from cases.project import ROOT
from cases.scenario_designs import brake

import fopi_tune as ft
from fopi_tune.spec.digests import content_digest
from fopi_tune.spec.model import DesignSpec

EXAMPLES = sorted([*(ROOT / "specs").glob("*.yaml"), *(ROOT / "systems").glob("manoeuvre*.yaml")])
EVERYTHING = """schema: 1
name: everything
description: every section, with what is seldom written
plant: {model: transfer_function, numerator: [1, {min: 1, max: 2}], denominator: [1, {min: 2, nominal: 3, max: 4}, 1],
  dead_time_s: 0.1}
controller: {structure: fopid, kp: {min: 0}, ki: {min: 0, max: 5}, alpha: 1, kd: {max: 3}, mu: {min: 0.5, max: 0.9},
  derivative_filter_time_constant_s: 0.1, measurement_filter: {order: 2, time_constant_s: 0.05}, setpoint_weight: 0.5}
requirements:
  - {crossover_rad_s: {between: [0.1, 3]}, on: nominal}
  - {sensitivity_db: {at_most: {by_frequency: [[0.01, -30], [0.1, -10], [2, 3]]}}}
  - {control_sensitivity_db: {at_most: 30}, from_rad_s: 10}
  - {loop_gain_db: {at_least: 10}, at_rad_s: 0.01}
objective: {minimize: iae_disturbance, horizon_s: 3}
digital: {sample_time_s: 0.05, design: sampled, output_limits: [-3, 3], output_rate_per_s: 9,
  delay_samples: 0.5, measurement_unit: K}
validation: {samples: 100, seed: 3, design: sobol, confidence: 0.95,
  distributions: {"numerator[1]": {beta: {a: 2, b: 3}}, "denominator[1]": {triangular: {min: 2, mode: 3, max: 4}}}}
scenarios:
  - {name: a, duration_s: 10, reference: [{at_s: 0, value: 1, ramp_s: 2}], load: [{at_s: 5, value: -1}],
     judged_from_s: 1}
  - {name: b, duration_s: 5, initial_output: 1, before: free, bumpless: yes, noise_std: 0.1, quantum: 0.01,
     rate_per_s: 3, settling_band: 0.1, reference: [{at_s: 0, value: 0}]}
limits: [{undershoot: {at_most: 3}}, {iae: {at_most: 30}, scenario: b}]
"""


def forgotten(spec: DesignSpec) -> DesignSpec:
    """The same spec, as one that was never read."""
    return dataclasses.replace(spec, as_read=None, source=b"")


def same(spec: DesignSpec) -> DesignSpec:
    """What is read of the text of a spec, which says the same."""
    again = ft.load_spec(spec.to_yaml())
    assert content_digest(again) == content_digest(spec)
    assert again.limits == spec.limits or [dataclasses.replace(each, line=0) for each in again.limits] == [
        dataclasses.replace(each, line=0) for each in spec.limits
    ]
    return again


@pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: path.stem)
def test_every_example_is_written_from_its_values_alone(path: Path) -> None:
    spec = ft.load_spec(path)
    again = same(forgotten(spec))
    assert (again.description, again.digital, again.validation) == (spec.description, spec.digital, spec.validation)


@pytest.mark.parametrize("text", [EVERYTHING, brake("stop", "step")], ids=["everything", "designed for scenarios"])
def test_every_section_is_written_from_its_values_alone(text: str) -> None:
    spec = ft.load_spec(text)
    again = same(forgotten(spec))
    for name in ("plant", "controller", "digital", "validation", "scenarios", "objective", "description"):
        assert getattr(again, name) == getattr(spec, name), name


@pytest.mark.parametrize(
    "change",
    [
        {"name": "other"},
        {"objective": None},
        {"digital": None, "scenarios": (), "limits": ()},
        {"limits": ()},
    ],
)
def test_what_was_not_changed_stays_as_it_was_written(change: dict[str, Any]) -> None:
    spec = ft.load_spec(EVERYTHING)
    changed = dataclasses.replace(spec, **change)
    again = same(changed)
    assert all(getattr(again, name) == value for name, value in change.items())
    # the range without a nominal value is not filled in
    assert "{min: 1, max: 2}" in changed.to_yaml()
    assert ft.load_spec(changed).sha256 != spec.sha256
    assert not changed.is_as_read
    assert pickle.loads(pickle.dumps(changed)).to_yaml() == changed.to_yaml()


def test_what_has_no_words_is_refused_by_its_section(tmp_path: Path) -> None:
    (tmp_path / "frf.csv").write_bytes(csv(TWO, 0.01, 100.0, 81))
    plant = "{model: frequency_response, file: frf.csv, unstable_poles: 0}"
    asked = "[{phase_margin_deg: {at_least: 50}}]"
    (tmp_path / "s.yaml").write_text(text_of(plant, asked, "{maximize: ki}", "{structure: pi}", ""), encoding="utf-8")
    spec = ft.load_spec(tmp_path / "s.yaml")
    with pytest.raises(ft.DomainError, match=r"the plant, of model .* was changed in Python"):
        forgotten(spec).to_yaml()
    # a section beside it is written, and the file is still named
    changed = dataclasses.replace(spec, description="anew")
    assert "frf.csv" in changed.to_yaml()
    assert json.dumps("anew").strip('"') in changed.to_yaml()
