"""`fopi discretize --export`: which files are written, and what is said where that is not possible."""

from __future__ import annotations

import io
import platform
import shutil
import sys
import zipfile
from pathlib import Path

import pytest
from cases.project import ROOT
from typer.testing import CliRunner, Result

from fopi_tune.cli import app, discretize

pytestmark = pytest.mark.usefixtures("plain_figures")
SPEC = """\
schema: 1
name: Target-1
plant: {model: lag, static_gain: 1.0, time_constant_s: 2.0}
controller: {kp: {min: 0}, ki: {min: 0}, alpha: {min: 0.3, max: 1.5}}
requirements:
  - {phase_margin_deg: {at_least: 30}}
objective: {minimize: phase_margin_spread_deg}
digital: {sample_time_s: 0.2, output_limits: [-1.0, 1.0]}
"""


def fopi(folder: Path, *formats: str, quiet: bool = True) -> Result:
    file = folder / "target.yaml"
    file.write_text(SPEC, encoding="utf-8")
    gains = ["--kp", "0.5", "--ki", "0.3", "--alpha", "0.8", "--no-proof", *(["--quiet"] if quiet else [])]
    exports = [word for name in formats for word in ("--export", name)]
    return CliRunner().invoke(app, ["discretize", str(file), *gains, *exports, "--out", str(folder / "out")])


def names_in(archive: Path) -> list[str]:
    return zipfile.ZipFile(io.BytesIO(archive.read_bytes())).namelist()


SOURCES = [
    *("modelDescription.xml", "sources/buildDescription.xml", "sources/fmi3.c"),
    *("sources/fopi_target_1_f64.c", "sources/fopi_target_1_f64.h"),
]


@pytest.mark.skipif(
    (sys.platform, platform.machine()) != ("linux", "x86_64") or not any(map(shutil.which, ("cc", "gcc", "clang"))),
    reason="no C compiler on x86-64 Linux",
)
def test_an_fmu_has_sources_and_a_binary(tmp_path: Path) -> None:
    done = fopi(tmp_path, "fmu", "fmu")
    assert (done.exit_code, done.stderr) == (0, "")
    assert names_in(tmp_path / "out" / "targets" / "Target-1.fmu") == [
        "binaries/x86_64-linux/fopi_target_1.so",
        *SOURCES,
    ]


def test_without_a_compiler_or_with_one_that_fails_an_fmu_has_sources_alone_and_says_so(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(discretize.sys, "platform", "linux")
    monkeypatch.setattr(discretize.platform, "machine", lambda: "x86_64")
    for found, why in ((None, "no C compiler is found"), (sys.executable, "failed (CalledProcessError)")):
        monkeypatch.setattr(discretize.shutil, "which", lambda name, path=found: path)
        done = fopi(tmp_path, "fmu", quiet=False)
        assert done.exit_code == 0
        assert "Target-1.fmu has sources and no binary: " in done.stderr
        assert why in done.stderr
        assert names_in(tmp_path / "out" / "targets" / "Target-1.fmu") == SOURCES


def test_structured_text_is_a_file_for_each_precision(tmp_path: Path) -> None:
    done = fopi(tmp_path, "st")
    assert (done.exit_code, done.stderr) == (0, "")
    written = sorted(path.name for path in (tmp_path / "out" / "targets").iterdir())
    assert written == ["fopi_target_1_f32.st", "fopi_target_1_f64.st"]


def test_formats_of_an_earlier_result_are_told_and_left(tmp_path: Path) -> None:
    (tmp_path / "out" / "targets").mkdir(parents=True)
    (tmp_path / "out" / "targets" / "old.fmu").write_text("")
    done = fopi(tmp_path)
    assert done.exit_code == 0
    assert f"targets/old.fmu in {tmp_path / 'out'} is of an earlier result" in done.stderr


def test_unknown_formats_and_systems_are_refused(tmp_path: Path) -> None:
    done = fopi(tmp_path, "fmu", "exe")
    assert (done.exit_code, done.stdout) == (2, "")
    assert done.stderr.startswith("--export exe: there are fmu")
    system = str(ROOT / "systems" / "car.yaml")
    done = CliRunner().invoke(app, ["discretize", system, "--export", "fmu", "--out", str(tmp_path), "--quiet"])
    assert done.exit_code == 2
    assert "--export is of one controller" in done.stderr
