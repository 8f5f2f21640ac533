"""`fopi prove SYSTEM` and the recheck of its certificate: exit codes, text, files and JSON."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest
from cases.project import ROOT
from typer.testing import CliRunner, Result

from fopi_tune.cli import app

pytestmark = pytest.mark.usefixtures("plain_figures")


def fopi(*arguments: str) -> Result:
    return CliRunner().invoke(app, list(arguments))


def car(folder: Path, memory: str) -> str:
    text = (ROOT / "systems" / "car.yaml").read_text(encoding="utf-8")
    path = folder / f"{memory}.yaml"
    changed = re.sub(r"inactive: \w+ ", f"inactive: {memory} ", text).replace("../specs", str(ROOT / "specs"))
    path.write_text(changed, encoding="utf-8")
    return str(path)


@pytest.mark.thinned(2)
@pytest.mark.parametrize(("memory", "verdict", "code"), [("reset", "settles", 0), ("held", "cycles", 1)])
def test_a_system_is_proved_and_rechecked(tmp_path: Path, memory: str, verdict: str, code: int) -> None:
    file, out = car(tmp_path, memory), tmp_path / "out"
    proved = fopi("prove", file, "--out", str(out), "--quiet")
    assert (proved.exit_code, proved.stderr) == (code, "")
    assert proved.stdout.startswith(f"car: {verdict}. ")
    assert all(len(line) <= 80 and line.isascii() for line in proved.stdout.splitlines())
    assert json.loads((out / "system_proof.json").read_text(encoding="utf-8"))["status"] == verdict
    certificate = str(out / "system_certificate.json")
    again = fopi("prove", "--recheck", certificate, file)
    assert again.exit_code == code
    assert again.stdout.startswith(f"car: sound, {verdict}")
    told = json.loads(fopi("prove", "--recheck", certificate, "--json").stdout)
    assert (told["status"], told["verdict"]) == ("sound", verdict)


def test_a_certificate_of_another_system_is_refused(tmp_path: Path) -> None:
    out = tmp_path / "out"
    fopi("prove", car(tmp_path, "reset"), "--out", str(out), "--quiet")
    certificate = out / "system_certificate.json"
    other = fopi("prove", "--recheck", str(certificate), car(tmp_path, "tracking"))
    assert other.exit_code == 1
    assert "refused" in other.stdout
    document = json.loads(certificate.read_text(encoding="utf-8"))
    certificate.write_text(json.dumps({**document, "hysteresis": 0.6}), encoding="utf-8")
    changed = fopi("prove", "--recheck", str(certificate))
    assert changed.exit_code == 2
    assert "does not agree with the other entries" in changed.stderr


def test_gains_of_a_spec_are_refused_for_a_system(tmp_path: Path) -> None:
    refused = fopi("prove", car(tmp_path, "reset"), "--kp", "1", "--quiet", "--out", str(tmp_path))
    assert refused.exit_code == 2
    assert "its modes' gains belong into its file" in refused.stderr


def test_the_report_of_a_system_is_made_from_its_certificate(tmp_path: Path) -> None:
    file, out = car(tmp_path, "held"), tmp_path / "out"
    missing = fopi("report", file, "--out", str(out), "--quiet")
    assert (missing.exit_code, missing.stdout) == (2, "")
    assert "there is no system_certificate.json to read" in missing.stderr
    fopi("prove", file, "--out", str(out), "--quiet")
    made = fopi("report", file, "--out", str(out), "--quiet")
    assert (made.exit_code, made.stdout.strip()) == (0, str(out / "system_report.html"))
    page = (out / "system_report.html").read_text(encoding="utf-8")
    assert "cycles. A periodic orbit is named" in page
    assert "The loops as they run" in page
    assert sorted({each.stem for each in (out / "figures").iterdir()}) == [
        "orbit", "region", "scenario_1", "scenario_2", "scenario_3",
    ]  # fmt: skip
    # from the folder alone, which has no system to simulate
    (out / "system_report.html").unlink()
    assert fopi("report", str(out), "--quiet").exit_code == 0
    alone = (out / "system_report.html").read_text(encoding="utf-8")
    assert "cycles. A periodic orbit is named" in alone
    assert "The loops as they run" not in alone
    other = fopi("report", car(tmp_path, "reset"), "--out", str(out), "--quiet")
    assert other.exit_code == 2
    assert "is of another system" in other.stderr
    certificate = out / "system_certificate.json"
    document = json.loads(certificate.read_text(encoding="utf-8"))
    certificate.write_text(json.dumps({**document, "hysteresis": 0.6}), encoding="utf-8")
    assert "make it again with `fopi prove`" in fopi("report", file, "--out", str(out), "--quiet").stderr


def test_the_report_of_a_system_has_what_was_simulated_and_drawn(tmp_path: Path) -> None:
    file, out = car(tmp_path, "held"), tmp_path / "out"
    assert fopi("simulate", file, "--out", str(out), "--quiet").exit_code in (0, 1)
    assert fopi("report", file, "--out", str(out), "--quiet").exit_code == 0
    page = (out / "system_report.html").read_text(encoding="utf-8")
    assert "Simulated, not proved" in page
    nominal = {
        each["name"]: each["measures"] for each in json.loads((out / "simulation.json").read_text())["scenarios"]
    }
    for measures in nominal.values():
        assert f'<td class="number">{measures["iae"]:.4g}</td>' in page
    assert "drawn at random" not in page
    fopi("validate", file, "--samples", "40", "--out", str(out), "--quiet")
    assert fopi("report", file, "--out", str(out), "--quiet").exit_code == 0
    page = (out / "system_report.html").read_text(encoding="utf-8")
    joint = json.loads((out / "evidence.json").read_text(encoding="utf-8"))["joint_yield"]
    assert "Simulated and drawn, not proved" in page
    assert f"{100.0 * joint['met'] / joint['total']:g} %" in page
    # gains of another text of the system are not shown
    assert fopi("report", car(tmp_path, "reset"), "--out", str(out), "--quiet").exit_code == 2
    file = car(tmp_path, "held")
    changed = json.loads((out / "simulation.json").read_text(encoding="utf-8"))
    changed["gains"]["brake"]["kp"] += 1.0
    (out / "simulation.json").write_text(json.dumps(changed), encoding="utf-8")
    told = fopi("report", file, "--out", str(out), "--quiet")
    assert told.exit_code == 0
    assert "simulation.json is of other gains than what is shown; run `fopi simulate` again" in told.stderr


@pytest.mark.parametrize("key", ["joint_yield", "scenarios", "gains", "drawn"])
def test_damaged_evidence_of_a_system_is_refused_with_what_to_do(tmp_path: Path, key: str) -> None:
    file, out = car(tmp_path, "held"), tmp_path / "out"
    fopi("validate", file, "--samples", "4", "--out", str(out), "--quiet")
    found = json.loads((out / "evidence.json").read_text(encoding="utf-8"))
    del found[key]
    (out / "evidence.json").write_text(json.dumps(found), encoding="utf-8")
    told = fopi("report", file, "--out", str(out), "--quiet")
    assert told.exit_code == 2
    assert "is not as this tool writes it" in told.stderr
    assert f"'{key}'" in told.stderr or key in told.stderr
    assert "run `fopi validate` again" in told.stderr


def test_a_spec_with_output_limits_says_whether_it_is_stable_with_them(tmp_path: Path) -> None:
    text = (ROOT / "specs" / "throttle.yaml").read_text(encoding="utf-8")
    path = tmp_path / "throttle.yaml"
    path.write_text(text.replace("delay_samples: 0}", "delay_samples: 0, output_limits: [0, 1]}"), encoding="utf-8")
    gains = ("--kp", "0.09", "--ki", "0.025", "--alpha", "0.8")
    without = fopi("prove", str(ROOT / "specs" / "throttle.yaml"), *gains, "--out", str(tmp_path / "a"), "--quiet")
    found = fopi("prove", str(path), *gains, "--out", str(tmp_path / "b"), "--quiet")
    assert found.exit_code == without.exit_code
    assert "limits    stable with its limits, 0 to 1: proved" in found.stdout
    assert "with its limits" not in without.stdout
    again = fopi("prove", "--recheck", str(tmp_path / "b" / "certificate.json"), str(path))
    assert "limits    stable with its limits, 0 to 1: proved" in again.stdout


def test_an_undecided_certificate_ends_as_its_proof_and_a_tolerance_is_refused(tmp_path: Path) -> None:
    file, out = car(tmp_path, "reset"), tmp_path / "out"
    text = Path(file).read_text(encoding="utf-8")
    Path(file).write_text(text.replace("hysteresis: 0.5 ", "hysteresis: 1000 "), encoding="utf-8")
    proved = fopi("prove", file, "--out", str(out), "--quiet")
    assert proved.exit_code == 3
    assert proved.stdout.startswith("car: undecided. ")
    again = fopi("prove", "--recheck", str(out / "system_certificate.json"), file)
    assert again.exit_code == 3
    assert again.stdout.startswith("car: sound, undecided")
    refused = fopi("prove", file, "--tolerance", "1e-3", "--quiet", "--out", str(out))
    assert refused.exit_code == 2
    assert "leave --tolerance out" in refused.stderr


def test_gains_that_the_file_does_not_have_cannot_be_compared(tmp_path: Path) -> None:
    file, out = car(tmp_path, "held"), tmp_path / "out"
    fopi("prove", file, "--out", str(out), "--quiet")
    text = Path(file).read_text(encoding="utf-8")
    Path(file).write_text(re.sub(r"gains: {kp: 0.09[^}]*}, ", "", text), encoding="utf-8")
    again = fopi("prove", "--recheck", str(out / "system_certificate.json"), file)
    assert again.exit_code == 2
    assert "no gains of throttle to compare with" in again.stderr
