"""`fopi prove SPEC --kp --ki --alpha --kd --mu` of a spec with `structure: fopid`, and what refuses one by name."""

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
controller: {structure: fopid, derivative_filter_time_constant_s: 0.05}
requirements:
  - {sensitivity_db: {at_most: 8}}
  - {control_sensitivity_db: {at_most: 20}}
"""
GAINS = ("--kp", "0.9", "--ki", "0.9", "--alpha", "0.9", "--kd", "0.4")


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
    proved = prove(spec, *GAINS, "--mu", "0.7")
    assert (proved.exit_code, proved.stderr) == (0, "")
    assert "alpha = 0.9  kd = 0.4  mu = 0.7  Tf = 0.05 s" in proved.stdout
    assert all(len(line) <= 80 for line in proved.stdout.splitlines())
    certificate = spec.parent / "out" / "certificate.json"
    document = json.loads(certificate.read_text(encoding="utf-8"))
    assert document["gains"]["mu"] == 0.7
    assert fopi("prove", "--recheck", str(certificate), str(spec)).exit_code == 0
    assert json.loads(fopi("prove", "--recheck", str(certificate), "--json").stdout)["gains"]["mu"] == 0.7
    document["gains"]["mu"] = 0.71
    certificate.write_text(json.dumps(document), encoding="utf-8")
    assert fopi("prove", "--recheck", str(certificate), str(spec)).exit_code == 1


@pytest.mark.parametrize(
    ("more", "told"),
    [
        (GAINS, "--mu is left out, and the spec gives mu a range"),
        ((*GAINS, "--mu", "1.2"), "mu = 1.2 must be at most 1; with mu above 1 the controller is improper"),
        ((*GAINS, "--mu", "0"), "mu = 0.0 must be greater than 0"),
    ],
)
def test_an_order_that_is_not_there_or_cannot_be_is_told(spec: Path, more: tuple[str, ...], told: str) -> None:
    refused = prove(spec, *more)
    assert refused.exit_code == 2
    assert told in " ".join(refused.stderr.split())


def test_an_order_is_refused_where_the_spec_has_none(spec: Path) -> None:
    for structure in ("{structure: pid, derivative_filter_time_constant_s: 0.05}", "{}"):
        spec.write_text(
            SPEC.replace("{structure: fopid, derivative_filter_time_constant_s: 0.05}", structure), encoding="utf-8"
        )
        refused = prove(spec, "--kp", "1.2", "--ki", "1", "--kd", "0.3", "--mu", "0.5")
        assert refused.exit_code == 2
        assert "write structure: fopid in it" in " ".join(refused.stderr.split())


def test_what_does_not_know_the_order_refuses_by_name(spec: Path) -> None:
    refused = fopi("simulate", "--exact", str(spec), *GAINS, "--mu", "0.7", "--out", str(spec.parent / "out"))
    assert refused.exit_code == 2
    assert "is not available for structure: fopid in this version" in " ".join(refused.stderr.split())
