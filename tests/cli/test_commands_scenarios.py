"""A spec with a requirement on a scenario through the command line: exit codes, JSON, texts, reports from files."""

from __future__ import annotations

import json
import os
import re
import shutil
from pathlib import Path
from typing import Any

import pytest
from cases.scenario_designs import brake
from typer.testing import CliRunner, Result

from fopi_tune.cli import app

pytestmark = pytest.mark.usefixtures("plain_figures")

#: a limit that does not bind beside one that does
TEXT = brake("stop", "step").replace("objective:", "  - {rise_time_s: {at_most: 40}, scenario: step}\nobjective:")
WANTED = (0.0315, 0.0355, 0.975)
GAINS = ("--kp", "0.0315", "--ki", "0.0355", "--alpha", "0.975")


def fopi(*arguments: str) -> Result:
    return CliRunner().invoke(app, list(arguments))


def words(result: Result) -> str:
    return " ".join(result.stdout.replace("\u00a0", " ").split())


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Result]:
    """The results of one run, and what it printed."""
    folder, before = tmp_path_factory.mktemp("run"), Path.cwd()
    (folder / "stop.yaml").write_text(TEXT, encoding="utf-8")
    os.chdir(folder)
    try:
        return folder, fopi("run", "stop.yaml")
    finally:
        os.chdir(before)


@pytest.fixture
def folder(finished: tuple[Path, Result], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A copy of them, and there."""
    copied = tmp_path / "copy"
    shutil.copytree(finished[0], copied)
    monkeypatch.chdir(copied)
    return copied


def document(name: str) -> dict[str, Any]:
    found = json.loads(Path(f"results/stop/{name}.json").read_text(encoding="utf-8"))
    assert isinstance(found, dict)
    return found


def test_a_run_says_what_is_proved_and_what_is_checked(finished: tuple[Path, Result]) -> None:
    result = finished[1]
    assert result.exit_code == 0, result.output
    said = words(result)
    proved = (
        "Requirements of the loop on samples are proved for every plant and frequency; 1 of 2 on scenarios is checked"
    )
    assert said.startswith(f"stop: solved. {proved} by simulation.")
    # of the digital controller no more is proved
    assert f"stop, digital: met. {proved}" in said
    # the rate is at its limit twice, to rounding
    assert re.search("proved acceleration_m_s2 <= 2 2 1.000 38.2 family, scenario step; worst at 0.[68] s with", said)
    assert "10000 of 10000 drawn plants meet it (99.94 .. 100 %)" in said
    assert "objective minimize iae in scenario step, the worst plant's: 119.36" in said


def test_a_design_is_what_was_asked_for(folder: Path) -> None:
    found = document("design")
    assert found["status"] == "solved"
    assert tuple(found["gains"][key] for key in ("kp", "ki", "alpha")) == pytest.approx(WANTED, rel=2e-3)
    assert found["objective"] == pytest.approx(119.357, rel=1e-3)
    acceleration, rise = found["scenario_requirements"]
    assert [each["verdict"] for each in (acceleration, rise)] == ["proved", "checked"]
    assert (acceleration["name"], acceleration["met"]) == ("acceleration_m_s2", True)
    assert acceleration["achieved"] == pytest.approx(2.0, abs=1e-5)
    assert acceleration["worst"]["plant"] == {"time_constant_s": pytest.approx(1.6)}
    assert acceleration["drawn"]["met"] == acceleration["drawn"]["total"] == 10_000
    assert acceleration["multiplier"] == pytest.approx(38.22, rel=0.01)
    assert (rise["multiplier"], rise["worst"]["time_s"]) == (0.0, None)
    page = Path("results/stop/report.html").read_text(encoding="utf-8")
    assert "acceleration ≤ 2" in page
    assert "10000 of 10000 drawn plants meet it" in page
    assert "one requirement on scenarios: checked by simulation" in " ".join(page.split())


def test_a_report_is_made_again_from_files(folder: Path) -> None:
    page = Path("results/stop/report.html")
    before = page.read_text(encoding="utf-8")
    page.unlink()
    assert fopi("report", "results/stop").exit_code == 0
    assert page.read_text(encoding="utf-8") == before


@pytest.mark.parametrize(
    ("path", "value"),
    [
        (("scenario_requirements", 0, "limit"), 2.5),
        (("scenario_requirements", 0, "achieved"), 2.5),
        (("scenario_requirements", 0, "met"), False),
        (("scenario_requirements", 0, "scenario"), "ramp"),
        (("scenario_requirements", 0, "drawn"), {"met": 9, "total": 5}),
        (("scenario_requirements",), []),
        (("gains", "kp"), 0.05),
    ],
    ids=str,
)
def test_a_tampered_design_is_refused(folder: Path, path: tuple[Any, ...], value: Any) -> None:
    found = document("design")
    entry = found
    for key in path[:-1]:
        entry = entry[key]
    entry[path[-1]] = value
    Path("results/stop/design.json").write_text(json.dumps(found), encoding="utf-8")
    result = fopi("report", "results/stop")
    assert result.exit_code == 2, result.output
    assert "design.json" in result.stderr


def test_given_gains_are_proved_and_checked(folder: Path) -> None:
    result = fopi("prove", "stop.yaml", *GAINS)
    assert result.exit_code == 0, result.output
    assert "stop: met. Requirements of the loop on samples are proved" in words(result)
    entries = document("check")["scenario_requirements"]
    assert [each["verdict"] for each in entries] == ["proved", "checked"]
    assert [each["multiplier"] for each in entries] == [None, None]
    fast = fopi("prove", "stop.yaml", "--kp", "0.07", "--ki", "0.05", "--alpha", "0.975")
    assert fast.exit_code == 1
    assert "violated acceleration_m_s2 <= 2" in words(fast)


def test_plants_are_drawn_and_one_is_simulated(folder: Path) -> None:
    result = fopi("validate", "stop.yaml", "--samples", "100")
    assert result.exit_code == 0, result.output
    assert "met acceleration_m_s2 <= 2 100 %" in words(result)
    fast = fopi("validate", "stop.yaml", "--samples", "100", "--kp", "0.07", "--ki", "0.05", "--alpha", "0.975")
    assert fast.exit_code == 1
    simulated = fopi("simulate", "stop.yaml")
    assert simulated.exit_code == 0, simulated.output
    assert "acceleration_m_s2 1.7031 m/s^2 met: <= 2" in words(simulated)
    assert fopi("simulate", "stop.yaml", "--kp", "0.09", "--ki", "0.05", "--alpha", "0.975").exit_code == 1


def test_what_cannot_be_met_is_1_and_says_what_clashes(folder: Path) -> None:
    text = TEXT.replace("initial_output: 30", "initial_output: 30, before: free").replace("name: stop", "name: free")
    Path("free.yaml").write_text(text, encoding="utf-8")
    result = fopi("tune", "free.yaml")
    assert result.exit_code == 1, result.output
    assert "before: free alone changes the output by 5.208 at the start, whatever the gains are" in words(result)
    found = json.loads(Path("results/free/design.json").read_text(encoding="utf-8"))
    assert found["status"] == "infeasible"
    assert [each["verdict"] for each in found["scenario_requirements"]].count("violated") >= 1
    assert {each["requirement"] for each in found["clash"]} >= {2}


def test_the_convex_search_is_refused(folder: Path) -> None:
    result = fopi("tune", "stop.yaml", "--solver", "convex")
    assert result.exit_code == 2
    assert "leave --solver convex out" in " ".join(result.stderr.split())
