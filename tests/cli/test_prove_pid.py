"""`fopi prove SPEC --kp --ki --kd` of a spec with `structure: pid`, and the recheck of its certificate."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner, Result

from fopi_tune.cli import app

SPEC = """\
schema: 1
name: lag
plant: {model: lag, static_gain: 1, time_constant_s: {min: 0.8, max: 1.5}, dead_time_s: 0.5}
controller: {structure: pid, derivative_filter_time_constant_s: 0.05}
requirements:
  - {sensitivity_db: {at_most: 8}}
  - {control_sensitivity_db: {at_most: 20}}
"""


def fopi(*arguments: str) -> Result:
    return CliRunner().invoke(app, list(arguments))


@pytest.fixture
def spec(tmp_path: Path) -> Path:
    path = tmp_path / "lag.yaml"
    path.write_text(SPEC, encoding="utf-8")
    return path


def prove(spec: Path, *more: str) -> Result:
    return fopi("prove", str(spec), "--out", str(spec.parent / "out"), "--quiet", *more)


def test_given_gains_are_proved_and_their_certificate_is_sound(spec: Path) -> None:
    proved = prove(spec, "--kp", "1.2", "--ki", "1", "--kd", "0.3")
    assert (proved.exit_code, proved.stderr) == (0, "")
    assert "C(s) = kp + ki/s + kd s/(Tf s + 1)" in proved.stdout
    assert "kd = 0.3" in proved.stdout
    assert all(len(line) <= 80 for line in proved.stdout.splitlines())
    certificate = spec.parent / "out" / "certificate.json"
    document = json.loads(certificate.read_text(encoding="utf-8"))
    assert document["gains"]["kd"] == 0.3
    assert fopi("prove", "--recheck", str(certificate), str(spec)).exit_code == 0
    told = json.loads(fopi("prove", "--recheck", str(certificate), "--json").stdout)
    assert told["gains"]["derivative_filter_time_constant_s"] == 0.05
    document["gains"]["kd"] = 0.31
    certificate.write_text(json.dumps(document), encoding="utf-8")
    assert fopi("prove", "--recheck", str(certificate), str(spec)).exit_code == 1


def test_a_derivative_that_costs_too_much_is_refuted(spec: Path) -> None:
    refuted = prove(spec, "--kp", "1.2", "--ki", "1", "--kd", "1.5")
    assert refuted.exit_code == 1
    document = json.loads((spec.parent / "out" / "certificate.json").read_text(encoding="utf-8"))
    assert document["requirements"][1]["verdict"] == "refuted"


def test_a_gain_that_is_left_out_is_asked_for(spec: Path) -> None:
    refused = prove(spec, "--kp", "1.2", "--ki", "1")
    assert refused.exit_code == 2
    assert "--kd is left out" in " ".join(refused.stderr.split())


def test_a_derivative_is_refused_where_the_spec_has_none(spec: Path) -> None:
    spec.write_text(SPEC.replace("{structure: pid, derivative_filter_time_constant_s: 0.05}", "{}"), encoding="utf-8")
    refused = prove(spec, "--kp", "1.2", "--ki", "1", "--alpha", "1", "--kd", "0.3")
    assert refused.exit_code == 2
    assert "structure: pid" in " ".join(refused.stderr.split())
