"""`fopi discretize SYSTEM`: files, text and JSON; the code is that of the library, and it runs."""

from __future__ import annotations

import json
import shutil
import subprocess
from pathlib import Path

import pytest
from cases.project import ROOT
from typer.testing import CliRunner, Result

import fopi_tune as ft
from fopi_tune.cli import app

pytestmark = pytest.mark.usefixtures("plain_figures")


def fopi(*arguments: str) -> Result:
    return CliRunner().invoke(app, list(arguments))


def car(folder: Path, **changes: str) -> str:
    text = (ROOT / "systems" / "car.yaml").read_text(encoding="utf-8").replace("../specs", str(ROOT / "specs"))
    lines = "".join(f"\n  {key}: {value}" for key, value in changes.items())
    path = folder / "car.yaml"
    path.write_text(text.replace("  hysteresis: 0.5", f"  hysteresis: 0.5{lines}\n  #", 1), encoding="utf-8")
    return str(path)


def test_a_system_becomes_code_that_replays_its_vectors(tmp_path: Path) -> None:
    file, out = car(tmp_path, min_dwell_s="0.5"), tmp_path / "out"
    done = fopi("discretize", file, "--out", str(out), "--quiet")
    assert (done.exit_code, done.stderr) == (0, "")
    assert done.stdout.startswith("car, digital: made. ")
    assert "at least 3 samples, 0.6 s" in done.stdout
    assert "min_dwell_s: 0.5 s is rounded up to 3 samples, 0.6 s." in done.stdout
    assert all(len(line) <= 80 and line.isascii() for line in done.stdout.splitlines())
    document = json.loads((out / "system_digital.json").read_text(encoding="utf-8"))
    assert (document["status"], document["min_dwell_s"], document["min_dwell_samples"]) == ("made", 0.5, 3)
    assert set(document["modes"]) == {"throttle", "brake"}
    code = ft.discretize_system(file).code()
    assert {path.name: path.read_text(encoding="ascii") for path in (out / "c").iterdir()} == code
    assert "long stayed; /* samples since the mode was entered, at most 3 */" in code["fopi_car_f32.h"]
    if not shutil.which("make") or not shutil.which("gcc"):
        pytest.skip("no make, or no gcc")
    made = subprocess.run(
        ["make", "-s", "-C", str(out / "c"), "test", "CC=gcc", "CFLAGS=-O2 -Werror -Wall -Wextra"],
        capture_output=True,
        text=True,
        check=False,
    )
    assert made.returncode == 0, made.stderr
    assert "equal bit for bit, in double and in float" in made.stdout


def test_json_is_the_document_and_gains_of_one_controller_are_refused(tmp_path: Path) -> None:
    file = car(tmp_path)
    document = json.loads(fopi("discretize", file, "--out", str(tmp_path / "o"), "--quiet", "--json").stdout)
    assert document["gains"]["brake"] == {"kp": 0.07, "ki": 0.11, "alpha": 0.45}
    assert document["min_dwell_samples"] == 0
    refused = fopi("discretize", file, "--kp", "1", "--quiet", "--out", str(tmp_path / "o"))
    assert refused.exit_code == 2
    assert "its modes' gains belong into its file" in refused.stderr


def test_the_controllers_are_those_of_the_simulation(tmp_path: Path) -> None:
    from fopi_tune.digital.implementation import implementation_of

    found = ft.discretize_system(car(tmp_path))
    for mode, controller in zip(found.spec.modes, found.controllers, strict=True):
        assert controller.sections == implementation_of(mode.spec, found.gains[mode.name]).sections
    given = ft.FoPi(0.1, 0.02, 0.9)
    assert ft.discretize_system(found.spec, {"throttle": given}).gains["throttle"] == given
    with pytest.raises(ft.DomainError, match="no mode 'clutch'"):
        ft.discretize_system(found.spec, {"clutch": given})
