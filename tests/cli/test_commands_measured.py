"""Measured responses at the command line: every command that takes them, and what refuses them by name."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from cases.measured import TWO, csv, text_of
from typer.testing import CliRunner, Result

from fopi_tune.cli import app

pytestmark = pytest.mark.usefixtures("plain_figures")

PLANT = "{model: frequency_response, file: frf.csv, unstable_poles: 0}"
ASKED = "[{phase_margin_deg: {at_least: 50}}, {sensitivity_db: {at_most: 5}}]"
PI = "{structure: pi, kp: {min: 0, max: 20}, ki: {min: 0, max: 20}}"
GAINS = ("--kp", "1", "--ki", "1")


def run(*arguments: str) -> Result:
    return CliRunner().invoke(app, list(arguments))


def written(folder: Path, plant: str = PLANT, asked: str = ASKED, data: bytes | None = None, more: str = "") -> str:
    (folder / "frf.csv").write_bytes(csv(TWO, 0.01, 100.0, 81) if data is None else data)
    (folder / "s.yaml").write_text(text_of(plant, asked, "{maximize: ki}", PI, more), encoding="utf-8")
    return str(folder / "s.yaml")


def words(done: Result) -> str:
    return " ".join(done.output.split())


def test_gains_are_tuned_and_checked(tmp_path: Path) -> None:
    spec, out = written(tmp_path), tmp_path / "out"
    done = run("tune", spec, "--out", str(out))
    assert done.exit_code == 0, done.output
    assert "measured: solved. All requirements are met at the measured frequencies and between them: checked" in words(
        done
    )
    assert "checked phase_margin_deg >= 50" in words(done)
    assert "it was looked at only inside [0.01, 100] rad/s" in words(done)
    assert "assumed: below 0.01 rad/s the plant goes on as its lowest frequencies look" in words(done)
    assert "with every second one left out it would differ by up to" in words(done)
    assert not (out / "certificate.json").exists()
    document = json.loads((out / "design.json").read_text())
    assert document["proof"]["verdict"] == "checked"
    assert {each["proof"]["verdict"] for each in document["requirements"]} == {"checked"}
    assert run("tune", spec, "--require-proof", "--out", str(out), "--quiet").exit_code == 3


def test_changed_data_invalidate_a_design(tmp_path: Path) -> None:
    spec, out = written(tmp_path), tmp_path / "out"
    assert run("tune", spec, "--out", str(out)).exit_code == 0
    kept = run("prove", spec, "--out", str(out))
    assert kept.exit_code == 0
    assert "gains from" in kept.output
    written(tmp_path, data=csv(TWO, 0.01, 100.0, 82))
    again = run("prove", spec, "--out", str(out))
    assert "no design of this spec there; tuning first" in again.output


def test_a_proof_says_that_there_is_none(tmp_path: Path) -> None:
    spec, out = written(tmp_path), tmp_path / "out"
    done = run("prove", spec, *GAINS, "--out", str(out))
    assert done.exit_code == 0
    assert "measured: met. All requirements are met at the measured frequencies and between them: checked" in words(
        done
    )
    assert run("prove", spec, *GAINS, "--out", str(out), "--require-proof").exit_code == 3
    missed = run("prove", spec, "--kp", "5", "--ki", "5", "--out", str(out))
    assert missed.exit_code == 1
    assert "violated phase_margin_deg >= 50" in words(missed)
    document = json.loads((out / "check.json").read_text())
    assert document["requirements"][0]["proof"]["verdict"] == "violated"
    assert run("prove", "--recheck", str(out / "check.json")).exit_code == 2


def test_without_the_number_of_unstable_poles_it_is_undecided(tmp_path: Path) -> None:
    spec = written(tmp_path, "{model: frequency_response, file: frf.csv}")
    done = run("prove", spec, *GAINS, "--out", str(tmp_path / "out"))
    assert done.exit_code == 3
    assert "measured: undecided. The measurement leaves something open; see stability." in words(done)
    assert "undecided phase_margin_deg >= 50" in words(done)
    assert "checked sensitivity_db <= 5" in words(done)
    assert "stability undecided: the number of the plant's unstable poles is not given" in words(done)
    assert "no margins: stability is undecided" in words(done)
    missed = run("prove", spec, "--kp", "9", "--ki", "9", "--out", str(tmp_path / "out"))
    assert missed.exit_code == 1
    tuned = run("tune", spec, "--out", str(tmp_path / "out"))
    assert tuned.exit_code == 2
    assert "write unstable_poles: 0 under plant" in words(tuned)


def test_every_stage_runs_with_a_digital_controller(tmp_path: Path) -> None:
    spec, out = written(tmp_path, more="digital: {sample_time_s: 0.02}"), tmp_path / "out"
    done = run("run", spec, "--out", str(out))
    assert done.exit_code == 0, done.output
    assert "the requirements are those of the loop with the ideal controller in continuous time" in words(done)
    digital = json.loads((out / "digital.json").read_text())
    assert digital["loop"] == "continuous"
    assert digital["proof"]["verdict"] == "checked"
    assert any("a measured response does not tell" in note for note in digital["notes"])
    assert sorted(path.suffix for path in (out / "c").iterdir() if path.suffix in (".c", ".h")) != []
    page = (out / "report.html").read_text()
    assert "Checked at the measured frequencies and between them; there is no proof of measured data." in page
    assert "dots are the measured frequencies, the line is interpolated" in page
    assert sorted(path.stem for path in (out / "figures").glob("*.svg")) == [
        "bode", "digital", "nyquist", "sensitivities",
    ]  # fmt: skip
    assert run("report", spec, "--out", str(out)).exit_code == 0


def test_several_members_are_named(tmp_path: Path) -> None:
    spec = written(tmp_path, data=csv(TWO, 0.01, 100.0, 81, 0.01))
    done = run("prove", spec, "--kp", "0.8", "--ki", "0.8", "--out", str(tmp_path / "out"))
    assert done.exit_code == 0, done.output
    assert "rad/s for frf.csv 2 sigma" in words(done)
    assert "stands for 9 plants: itself, and 8 that are off by 2 standard deviations" in words(done)


@pytest.mark.parametrize(
    ("command", "told"),
    [
        (("simulate",), "a simulation: a measured frequency response is known at its frequencies alone"),
        (("simulate", "--exact"), "a simulation: a measured frequency response"),
        (("validate",), "drawing plants: a measured frequency response"),
        (("tune", "--certify-optimum"), "the proof of the optimum: a measured frequency response"),
        (("tune", "--solver", "convex"), "the convex search: a measured frequency response"),
        (("tune", "--bracket"), "there is no bound of gains for measured responses"),
    ],
)
def test_what_needs_a_transfer_function_is_refused(tmp_path: Path, command: tuple[str, ...], told: str) -> None:
    spec = written(tmp_path, more="digital: {sample_time_s: 0.02}")
    gains = () if command[0] == "tune" else GAINS
    done = run(command[0], spec, *command[1:], *gains, "--out", str(tmp_path / "out"))
    assert done.exit_code == 2, done.output
    assert told in words(done)


def test_prices_and_a_sweep_are_made_of_measured_responses(tmp_path: Path) -> None:
    spec, out = written(tmp_path), tmp_path / "out"
    priced = run("tune", spec, "--prices", "--out", str(out))
    assert priced.exit_code == 0, priced.output
    checked = json.loads((out / "design.json").read_text())["requirements"][0]["multiplier_checked"]
    assert checked["agrees"]
    swept = run("tune", spec, "--tradeoff", "phase_margin_deg", "--points", "3", "--out", str(out))
    assert swept.exit_code == 0, swept.output
    assert "3 of 3 limits of the sweep can be met" in words(swept)


def test_a_file_with_a_mistake_is_told_with_its_line(tmp_path: Path) -> None:
    done = run("tune", written(tmp_path, data=csv(TWO, 0.01, 100.0, 81).replace(b"0.01,", b"-0.01,", 1)))
    assert done.exit_code == 2
    assert "s.yaml:3:42: plant.file: 'frf.csv': line 2: its frequency is not greater than 0" in words(done)
