"""Lists of plants at the command line: every command that takes them, and what refuses them by name."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from cases.plant_lists import MISMATCH
from typer.testing import CliRunner, Result

from fopi_tune.cli import app

pytestmark = pytest.mark.usefixtures("plain_figures")

SAMPLED = (
    MISMATCH
    + """\
digital: {sample_time_s: 0.1, design: sampled}
validation: {samples: 128}
scenarios: [{name: step, duration_s: 20, reference: [{at_s: 1, value: 1}]}]
limits: [{overshoot: {at_most: 0.6}}]
"""
)
GAINS = ("--kp", "0.25", "--ki", "0.25")


def run(*arguments: str) -> Result:
    return CliRunner().invoke(app, list(arguments))


def written(tmp_path: Path, text: str) -> str:
    (tmp_path / "s.yaml").write_text(text, encoding="utf-8")
    return str(tmp_path / "s.yaml")


def words(done: Result) -> str:
    return " ".join(done.output.split())


def test_a_proof_and_its_check_name_the_member(tmp_path: Path) -> None:
    spec, out = written(tmp_path, MISMATCH), tmp_path / "out"
    done = run("prove", spec, *GAINS, "--out", str(out))
    assert done.exit_code == 0, done.output
    assert "family; worst at 0.82809 rad/s for slow" in words(done)
    again = run("prove", "--recheck", str(out / "certificate.json"), spec)
    assert again.exit_code == 0, again.output
    assert "family, worst for slow; shown to be at most" in words(again)
    other = written(tmp_path, MISMATCH.replace("name: slow", "name: late"))
    refused = run("prove", "--recheck", str(out / "certificate.json"), other)
    assert refused.exit_code == 1
    assert "the plants are not those of the spec" in words(refused)


def test_an_unstable_member_is_named(tmp_path: Path) -> None:
    done = run("prove", written(tmp_path, MISMATCH), "--kp", "3", "--ki", "0.3", "--out", str(tmp_path / "out"))
    assert done.exit_code == 1
    assert "NOT STABLE: 2 closed-loop poles in the right half-plane for slow" in words(done)


@pytest.mark.long
def test_a_run_a_validation_and_a_report_of_a_list_on_samples(tmp_path: Path) -> None:
    spec, out = written(tmp_path, SAMPLED), str(tmp_path / "out")
    done = run("run", spec, "--out", out)
    assert done.exit_code == 0, done.output
    assert "for slow" in words(done)
    drawn = run("validate", spec, "--out", out)
    assert drawn.exit_code == 0, drawn.output
    assert "of slow, plant 2, plant 3, drawn 1 : 1 : 2" in words(drawn)
    evidence = json.loads((tmp_path / "out" / "evidence.json").read_text(encoding="utf-8"))
    assert evidence["drawn"]["plants"][2] == {"name": "plant 3", "weight": 2.0}
    assert evidence["requirements"][0]["worst"][0]["member"] == "slow"
    assert run("report", out).exit_code == 0
    page = (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
    assert "of slow, plant 2, plant 3, drawn 1 : 1 : 2" in page


def test_one_plant_of_a_list_is_simulated(tmp_path: Path) -> None:
    spec, out = written(tmp_path, SAMPLED), str(tmp_path / "out")
    first = run("simulate", spec, *GAINS, "--out", out)
    assert first.exit_code == 0, first.output
    assert "plant slow: known exactly" in words(first)
    third = run("simulate", spec, *GAINS, "--member", "plant 3", "--out", out)
    assert "plant plant 3: known exactly" in words(third)
    assert json.loads((tmp_path / "out" / "simulation.json").read_text(encoding="utf-8"))["member"] == "plant 3"
    unknown = run("simulate", spec, *GAINS, "--member", "truck", "--out", out)
    assert unknown.exit_code == 2
    assert "there is no plant 'truck' in the list; there is slow, plant 2, plant 3" in words(unknown)
    number = run("simulate", spec, *GAINS, "--plant", "dead_time_s=1", "--out", out)
    assert "'dead_time_s' is no uncertain number of the plant" in words(number)
    twice = run("simulate", spec, *GAINS, "--member", "slow", "--replay", "3", "--out", out)
    assert "--replay makes a plant again that was drawn; leave --member out" in words(twice)


@pytest.mark.parametrize(
    ("option", "said"),
    [
        (["--certify-optimum"], "the proof of the optimum is for one plant in this version, not for a list"),
        (["--solver", "convex"], "the convex search is for one plant in this version, not for a list"),
    ],
)
def test_what_knows_one_plant_alone_refuses_a_list_before_it_searches(
    option: list[str], said: str, tmp_path: Path
) -> None:
    done = run("tune", written(tmp_path, MISMATCH), *option, "--out", str(tmp_path / "out"))
    assert done.exit_code == 2
    assert said in words(done)


def test_a_mode_of_a_system_has_one_plant(tmp_path: Path) -> None:
    one = "{model: lag, static_gain: 1, time_constant_s: 2}"
    rest = "digital: {sample_time_s: 0.1}\nobjective: {maximize: ki}\n"
    (tmp_path / "a.yaml").write_text(f"schema: 1\nname: a\nplants: [{one}]\n{rest}", encoding="utf-8")
    (tmp_path / "b.yaml").write_text(f"schema: 1\nname: b\nplant: {one}\n{rest}", encoding="utf-8")
    system = (
        "schema: 1\nname: s\nsystem:\n  throttle: {spec: a.yaml, gains: {kp: 1, ki: 1, alpha: 1}}\n"
        "  brake: {spec: b.yaml, gains: {kp: 1, ki: 1, alpha: 1}}\n  hysteresis: 0.1\n"
        "scenarios: [{name: step, duration_s: 5, reference: [{at_s: 0, value: 1}]}]\n"
    )
    done = run("simulate", written(tmp_path, system), "--out", str(tmp_path / "out"))
    assert done.exit_code == 2
    assert "a mode's spec has one plant in this version; write plant: in place of plants:" in words(done)
