"""The exported C under MISRA's rules and the strictest warnings: what cppcheck and the compiler say of it."""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
from dataclasses import replace
from functools import cache
from pathlib import Path

import pytest
from cases.targets import ODD, STRUCTURES, exported

from fopi_tune.core.controller import FoPi, FoPid, Pid
from fopi_tune.core.switching_lines import SwitchingLines, Threshold
from fopi_tune.digital import Memory, Switching, export_c, export_system_c
from tests.digital.test_export_system_c import exported as system
from tests.digital.test_export_system_c import mode_export

CPPCHECK = shutil.which("cppcheck", path=str(Path(sys.executable).parent)) or shutil.which("cppcheck")
needs_cppcheck = pytest.mark.skipif(CPPCHECK is None, reason="no cppcheck: MISRA's rules are not checked")
needs_gcc = pytest.mark.skipif(not shutil.which("gcc"), reason="gcc is not found")
WARNINGS = ["-Wall", "-Wextra", "-Wconversion", "-Wfloat-conversion", "-Wdouble-promotion", "-Wcast-qual", "-Wshadow"]
#: of a line with a finding: file, rule or check
FINDING = re.compile(r"^(\w+\.[ch]):\d+:\d+: .*\[([\w.-]+)\]$", re.MULTILINE)
#: all advisory: static names are the same in both modes, functions are for other files, coefficients stand together
DEVIATIONS = {"misra-c2012-5.9", "misra-c2012-8.7", "misra-c2012-8.9"}
#: of the modes of a system not every function is used
UNUSED = {"unusedFunction", "staticFunction"}
BAND = SwitchingLines(Threshold(0.9), Threshold(-0.7), Threshold(0.1), Threshold(8.0, True))
#: gains of both modes: one without an integral, and with derivatives
PLAIN = FoPi(0.09, 0.025, 0.8), FoPi(0.07, 0.0, 1.0)
DERIVED = Pid(0.09, 0.03, 0.05, 0.4), FoPid(0.07, 0.05, 0.8, 0.04, 0.7, 0.3)
#: hysteresis or lines, memory, dwell, whether a setpoint is fed forward, whether rates are limited, gains
SYSTEMS = {
    "hysteresis": (0.5, Memory.RESET, 3, False, False, PLAIN),
    "band": (BAND, Memory.RESET, 0, False, True, PLAIN),
    "fed": (BAND, Memory.TRACKING, 2, True, True, PLAIN),
    "lines": (SwitchingLines(Threshold(12.3, True), Threshold(-0.7)), Memory.HELD, 0, True, False, PLAIN),
    "derived": (BAND, Memory.RESET, 3, True, True, DERIVED),
    "derived_held": (0.5, Memory.HELD, 0, False, False, DERIVED),
    "derived_tracking": (0.5, Memory.TRACKING, 0, True, False, DERIVED),
}
NAMES = [*STRUCTURES, *ODD, *SYSTEMS]
#: every part of a controller, limits alone, and both kinds of switching
EACH_TIME = ["all", "fopi", "fed", "band", "derived"]
every_export = pytest.mark.parametrize(
    "name", [pytest.param(name, marks=[pytest.mark.long] * (name not in EACH_TIME)) for name in NAMES]
)


@cache
def files_of(name: str) -> dict[str, str]:
    if name not in SYSTEMS:
        return export_c(exported(name))
    turns, memory, dwell, is_fed, has_rate, gains = SYSTEMS[name]
    fed = ((0.03, 0.2), (0.011, 0.0)) if is_fed else ()
    modes = [
        mode_export("throttle", gains[0], (0.0, 1.0)),
        mode_export("brake", gains[1], (-1.0, 0.0)),
    ]
    modes = [replace(mode, rate_per_s=0.5) for mode in modes] if has_rate else modes
    return export_system_c(system(Switching(turns, memory, dwell, fed=fed), modes=tuple(modes)))


def written(name: str, folder: Path) -> Path:
    for file, text in files_of(name).items():
        (folder / file).write_text(text, encoding="ascii")
    return folder


def findings(folder: Path, files: list[str], *options: str) -> set[str]:
    """The checks and rules that cppcheck finds something by."""
    assert CPPCHECK is not None
    said = ["--quiet", "--std=c99", "--suppress=missingIncludeSystem", *options]
    done = subprocess.run([CPPCHECK, *said, *files], cwd=folder, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    found = FINDING.findall(done.stderr)
    # a file that is not parsed, an addon that does not run
    assert not re.search(r"\[(internalError|syntaxError|internalAstError)\]|Failed to execute", done.stderr), (
        done.stderr
    )
    return {rule for _, rule in found}


def of_precision(name: str, suffix: str) -> list[str]:
    return [file for file in files_of(name) if file.endswith(f"_{suffix}.c")]


@needs_cppcheck
@every_export
def test_cppcheck_finds_no_deviation_that_the_page_does_not_name(name: str, tmp_path: Path) -> None:
    written(name, tmp_path)
    for suffix in ("f64", "f32"):
        found = findings(tmp_path, of_precision(name, suffix), "--enable=style", "--addon=misra")
        # rules are seen at all: the functions are used by no other file
        assert "misra-c2012-8.7" in found
        assert found <= DEVIATIONS


@needs_cppcheck
@every_export
def test_cppcheck_finds_nothing_in_the_code_with_its_replay(name: str, tmp_path: Path) -> None:
    written(name, tmp_path)
    sources = [file for file in files_of(name) if file.endswith(".c")]
    found = findings(tmp_path, sources, "--enable=all", "--inconclusive", "--check-level=exhaustive")
    if name in SYSTEMS:
        assert "unusedFunction" in found
        assert found <= UNUSED
    else:
        assert found == set()


@needs_cppcheck
def test_a_second_exit_and_a_condition_that_is_no_truth_are_found(tmp_path: Path) -> None:
    text = "int f(int a);\nint f(int a)\n{\n    if (a) {\n        return 1;\n    }\n    return 0;\n}\n"
    (tmp_path / "spoiled.c").write_text(text, encoding="ascii")
    found = findings(tmp_path, ["spoiled.c"], "--enable=style", "--addon=misra")
    assert {"misra-c2012-14.4", "misra-c2012-15.5"} <= found


@needs_gcc
@every_export
def test_the_strictest_warnings_say_nothing(name: str, tmp_path: Path) -> None:
    written(name, tmp_path)
    command = [
        "gcc",
        "-std=c99",
        "-pedantic",
        "-Werror",
        *WARNINGS,
        "-c",
        *(f for f in files_of(name) if f[-2:] == ".c"),
    ]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")
