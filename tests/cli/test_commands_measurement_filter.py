"""A measurement filter at the command line: from design to report, in a study, and what refuses it by name."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from cases.project import ROOT
from typer.testing import CliRunner, Result

from fopi_tune.cli import app

pytestmark = pytest.mark.usefixtures("plain_figures")

USED = "measurement_filter: {order: 2, time_constant_s: 0.1}"
SPEC = f"""\
schema: 1
name: filtered
plant: {{model: lag, static_gain: 1, time_constant_s: {{min: 1.0, max: 1.5}}, dead_time_s: 0.2}}
controller: {{structure: pi, kp: {{min: 0}}, ki: {{min: 0}}, {USED}}}
requirements: [{{sensitivity_db: {{at_most: 4.5}}}}, {{control_sensitivity_db: {{at_most: 12}}}}]
objective: {{maximize: ki}}
digital: {{sample_time_s: 0.05, design: sampled, output_limits: [-3, 3]}}
scenarios: [{{name: step, duration_s: 5, reference: [{{at_s: 0, value: 1}}]}}]
limits: [{{overshoot: {{at_most: 0.6}}}}]
validation: {{samples: 64}}
"""
CONTINUOUS = "\n".join(
    line for line in SPEC.splitlines() if line.split(":")[0] not in ("digital", "scenarios", "limits")
)
GAINS = ("--kp", "1.2", "--ki", "1.5")


def run(*arguments: str) -> Result:
    return CliRunner().invoke(app, list(arguments))


@pytest.fixture
def spec(tmp_path: Path) -> str:
    (tmp_path / "s.yaml").write_text(SPEC, encoding="utf-8")
    return str(tmp_path / "s.yaml")


@pytest.mark.long
def test_a_run_tells_the_filter_in_words_files_and_report(spec: str, tmp_path: Path) -> None:
    out = tmp_path / "out"
    done = run("run", spec, "--out", str(out))
    assert done.exit_code == 0, done.output
    assert "F(s) = 1/(1 + sT + s^2 T^2/2) with T = 0.1 s" in done.output
    assert "C(z)/F(z) = direct" in done.output
    assert "of the measurement filter alone" in done.output
    assert "a measurement filter and a setpoint weight are not modelled" in " ".join(done.output.split())
    assert run("simulate", spec, "--out", str(out)).exit_code == 0
    for name in ("design.json", "certificate.json", "digital.json", "simulation.json"):
        gains = json.loads((out / name).read_text(encoding="utf-8"))["gains"]
        assert (gains["measurement_filter_order"], gains["measurement_filter_time_constant_s"]) == (2, 0.1), name
    digital = json.loads((out / "digital.json").read_text(encoding="utf-8"))
    assert digital["measurement_filter"]["rule"] == "tustin"
    page = (out / "report.html").read_text(encoding="utf-8")
    assert "F(s) = 1/(1 + sT + s^2 T^2/2) with T = 0.1 s on the measurement" in page
    header = (out / "c" / "fopi_filtered_f64.h").read_text(encoding="ascii")
    assert "behind 1/(1 + sT + s^2 T^2/2), T = 0.1 s" in header


def test_a_certificate_at_the_command_line_is_of_its_filter(spec: str, tmp_path: Path) -> None:
    out = tmp_path / "out"
    done = run("prove", spec, *GAINS, "--out", str(out))
    assert done.exit_code == 0, done.output
    assert "F(s) = 1/(1 + sT + s^2 T^2/2) with T = 0.1 s" in done.output
    again = run("prove", spec, "--recheck", str(out / "certificate.json"))
    assert again.exit_code == 0, again.output
    Path(spec).write_text(SPEC.replace("time_constant_s: 0.1}", "time_constant_s: 0.11}"), encoding="utf-8")
    other = run("prove", spec, "--recheck", str(out / "certificate.json"))
    assert other.exit_code == 1, other.output
    assert "measurement_filter is not that of the spec" in " ".join(other.output.split())


def test_two_designs_with_other_filters_are_compared(tmp_path: Path) -> None:
    folders = []
    for order in (1, 2):
        path = tmp_path / f"{order}.yaml"
        path.write_text(CONTINUOUS.replace("order: 2", f"order: {order}"), encoding="utf-8")
        folders.append(str(tmp_path / f"out{order}"))
        assert run("tune", str(path), "--out", folders[-1], "--no-proof").exit_code == 0
    done = run("report", *folders, "--compare", "--out", str(tmp_path / "both"))
    assert done.exit_code == 0, done.output
    page = next((tmp_path / "both").glob("*.html")).read_text(encoding="utf-8")
    assert "order 1, 0.1 s" in page
    assert "order 2, 0.1 s" in page


def test_a_study_compares_time_constants(spec: str, tmp_path: Path) -> None:
    Path(spec).write_text(CONTINUOUS, encoding="utf-8")
    study = tmp_path / "study.yaml"
    study.write_text(
        "schema: 1\nname: times\nspecs: [s.yaml]\n"
        "grid: {controller.measurement_filter.time_constant_s: [0.02, 0.1, 0.4]}\n"
        "stages: [tune]\ncollect: {ki: tune.gains.ki, used: tune.gains.measurement_filter_time_constant_s}\n",
        encoding="utf-8",
    )
    done = run("study", str(study), "--out", str(tmp_path / "out"), "--workers", "0")
    assert done.exit_code == 0, done.output
    table = next((tmp_path / "out").glob("**/*.csv")).read_text(encoding="utf-8").splitlines()
    used, ki = (table[0].split(",").index(name) for name in ("used", "ki"))
    rows = [line.split(",") for line in table[1:]]
    assert [float(row[used]) for row in rows] == [0.02, 0.1, 0.4]
    # a slower filter costs integral gain
    assert float(rows[0][ki]) > float(rows[1][ki]) > float(rows[2][ki])


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("simulate", "SPEC", "--exact", *GAINS), "the exact simulation in continuous time is not available with a"),
        (("tune", "SPEC", "--solver", "convex"), "the convex path knows no measurement_filter; use the solver ipopt"),
    ],
)
def test_what_does_not_know_a_filter_refuses_it_by_name(
    spec: str, tmp_path: Path, arguments: tuple[str, ...], words: str
) -> None:
    done = run(*(spec if each == "SPEC" else each for each in arguments), "--out", str(tmp_path / "out"))
    assert done.exit_code in (2, 3), done.output
    assert words in " ".join(done.output.split())


def test_gains_behind_a_filter_are_designed_for_a_scenario(spec: str) -> None:
    text = SPEC.replace("requirements: [", "requirements: [{overshoot: {at_most: 0.5}, scenario: step}, ")
    Path(spec).write_text(text, encoding="utf-8")
    done = run("tune", spec)
    assert done.exit_code == 0, done.output
    said = " ".join(done.output.split())
    assert "checked overshoot <= 0.5" in said
    assert "a measurement_filter is not modelled in this proof" in said


def test_a_mode_of_a_system_refuses_a_filter(tmp_path: Path) -> None:
    brake = (ROOT / "specs" / "brake.yaml").read_text(encoding="utf-8")
    key = next(line for line in brake.splitlines() if line.startswith("controller:"))
    filtered = brake.replace(key, f"{key}\n  {USED}")
    (tmp_path / "brake.yaml").write_text(filtered, encoding="utf-8")
    throttle = (ROOT / "specs" / "throttle.yaml").read_text(encoding="utf-8")
    (tmp_path / "throttle.yaml").write_text(throttle, encoding="utf-8")
    car = (ROOT / "systems" / "car.yaml").read_text(encoding="utf-8").replace("../specs/", "")
    (tmp_path / "car.yaml").write_text(car, encoding="utf-8")
    done = run("simulate", str(tmp_path / "car.yaml"))
    assert done.exit_code == 2
    assert "a mode's controller has no measurement_filter in this version" in " ".join(done.output.split())
