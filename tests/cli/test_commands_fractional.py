"""The command line with a fractional plant: a proved design with its report, and refusals that say why."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner, Result

from fopi_tune.cli import app

HEAT = """schema: 1
name: heat
plant:
  model: fractional
  numerator: [{coefficient: {min: 60, max: 72, nominal: 66.16}, order: 0}]
  denominator: [{coefficient: 12.72, order: 0.5}, {coefficient: 1, order: 0}]
  dead_time_s: 1.93
controller: {structure: pi}
requirements:
  - {phase_margin_deg: {at_least: 60}}
  - {sensitivity_db: {at_most: 4}}
objective: {maximize: ki}
"""
LAG = "{model: lag, static_gain: 60, time_constant_s: 100, dead_time_s: 2}"
RUNNER = CliRunner()
GAINS = ("--kp", "0.05", "--ki", "0.02")
SLOWER = ("--kp", "0.05", "--ki", "0.01")


def run(*arguments: str) -> Result:
    return RUNNER.invoke(app, list(arguments))


def written(tmp_path: Path, text: str) -> str:
    (tmp_path / "heat.yaml").write_text(text, encoding="utf-8")
    return str(tmp_path / "heat.yaml")


def words(done: Result) -> str:
    """What was printed, as one line."""
    return " ".join((done.output + done.stderr).split())


@pytest.mark.usefixtures("plain_figures")
def test_gains_are_found_and_proved_and_the_certificate_is_rechecked(tmp_path: Path) -> None:
    done = run("tune", written(tmp_path, HEAT), "--out", str(tmp_path / "out"))
    assert done.exit_code == 0, words(done)
    assert "All requirements are proved for every plant and every frequency" in words(done)
    assert "numerator[0].coefficient" in words(done)
    design = json.loads((tmp_path / "out" / "design.json").read_text(encoding="utf-8"))
    assert design["status"] == "solved"
    assert "numerator[0].coefficient" in design["requirements"][0]["worst"]["plant"]
    checked = run("prove", "--recheck", str(tmp_path / "out" / "certificate.json"))
    assert checked.exit_code == 0, words(checked)


@pytest.mark.parametrize(
    ("command", "said"),
    [
        (("simulate", *GAINS), "a simulation of a fractional plant is not available in this version: its state"),
        (("tune", "--certify-optimum"), "the proof of the optimum of a fractional plant is not available"),
        (("tune", "--solver", "convex"), "the convex search of a fractional plant is not available"),
    ],
)
def test_what_does_not_know_fractional_plants_says_so(command: tuple[str, ...], said: str, tmp_path: Path) -> None:
    done = run(command[0], written(tmp_path, HEAT), *command[1:], "--out", str(tmp_path / "out"))
    assert done.exit_code == 2
    assert said in words(done)


def test_a_section_about_samples_is_refused_with_its_line(tmp_path: Path) -> None:
    text = HEAT + "digital: {sample_time_s: 0.1, design: sampled}\n"
    done = run("run", written(tmp_path, text), "--out", str(tmp_path / "out"))
    assert done.exit_code == 2
    assert ":13:39: digital.design: the loop on samples of a fractional plant is not available" in words(done)


def test_the_filter_is_made_and_the_loop_that_is_judged_is_the_continuous_one(tmp_path: Path) -> None:
    text = HEAT + "digital: {sample_time_s: 0.1}\n"
    path, out = written(tmp_path, text), str(tmp_path / "out")
    done = run("discretize", path, *SLOWER, "--out", out)
    assert done.exit_code == 0, done.output
    assert "The ideal loop in continuous time meets all requirements, proved" in words(done)
    assert "behind a hold a fractional plant remembers all of its past" in words(done)
    folder = next(tmp_path.rglob("digital.json")).parent
    said = json.loads((folder / "digital.json").read_text(encoding="utf-8"))
    assert said["loop"] == "continuous"
    assert said["proof"]["verdict"] == "proved"
    # the filter is that of the gains, whatever the plant is
    lag = text.replace(text[text.index("plant:") : text.index("controller:")], f"plant: {LAG}\n").replace("heat", "lag")
    (tmp_path / "lag.yaml").write_text(lag, encoding="utf-8")
    other = json.loads(
        run("discretize", str(tmp_path / "lag.yaml"), *SLOWER, "--json", "--out", str(tmp_path / "lag")).stdout
    )
    assert other["loop"] == "sampled"
    assert said["controller"] == other["controller"]
    # of gains that miss a limit, no design on samples is advised
    missed = run("discretize", path, *GAINS, "--out", str(tmp_path / "missed"))
    assert missed.exit_code == 1
    assert "does not meet the requirements that are marked" in words(missed)
    assert "design: sampled" not in words(missed)
    again = run("prove", "--recheck", str(folder / "digital_certificate.json"), path)
    assert again.exit_code == 0, again.output
    drawn = run("validate", path, *SLOWER, "--out", out)
    assert drawn.exit_code == 2
    assert "Monte Carlo of a fractional plant is not available in this version: behind a hold" in words(drawn)
