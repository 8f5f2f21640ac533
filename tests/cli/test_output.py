"""Result files survive the process that writes them: whatever ends it, a file is the old one or the new one."""

from __future__ import annotations

import ast
import os
import random
import re
import signal
import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path

import pytest
from cases.project import CONTINUOUS, IMPORTED
from typer.testing import CliRunner

from fopi_tune.cli import app
from fopi_tune.cli.output import report_failure, say
from fopi_tune.results.saved.writing import write_file

BRAKE = str(CONTINUOUS / "brake.yaml")
OPTIONS = ["--kp", "0.44651475946456753", "--ki", "0.37032589727989074", "--alpha", "0.8319673847369714"]
#: writes two large texts in turn, for ever; the first write is announced
WRITER = """
import sys
from pathlib import Path
from fopi_tune.cli.output import report_failure
from fopi_tune.results.saved.writing import write_file
texts = [letter * 3_000_000 for letter in "ab"]
for turn in range(10**9):
    write_file(Path(sys.argv[1]), texts[turn % 2])
    if turn == 1:
        print("writing", flush=True)
"""
pytestmark = pytest.mark.skipif(os.name != "posix", reason="signals as POSIX has them")


def start(*arguments: str) -> subprocess.Popen[str]:
    environment = os.environ | {"PYTHONPATH": str(IMPORTED), "PYTHONSAFEPATH": "1"}
    return subprocess.Popen(
        [sys.executable, *arguments],
        env=environment,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        # what a shell starts in the background ignores Ctrl-C, and its children with it
        preexec_fn=hear_ctrl_c,
    )


def hear_ctrl_c() -> None:
    signal.signal(signal.SIGINT, signal.SIG_DFL)


def ended(process: subprocess.Popen[str], by: signal.Signals) -> int:
    process.send_signal(by)
    try:
        process.communicate(timeout=60)
    finally:
        process.kill()
    return process.returncode


def kill_a_writer(path: Path, by: signal.Signals, delays_s: Sequence[float]) -> None:
    """The file is whole after each of these times of writing."""
    for delay_s in delays_s:
        writer = start("-c", WRITER, str(path))
        assert writer.stdout is not None
        assert writer.stdout.readline() == "writing\n"
        time.sleep(delay_s)
        assert writer.poll() is None
        assert ended(writer, by) != 0
        text = path.read_text(encoding="utf-8")
        assert len(text) == 3_000_000
        assert text in ("a" * 3_000_000, "b" * 3_000_000)


@pytest.mark.thinned(2)
@pytest.mark.parametrize("by", [signal.SIGKILL, signal.SIGINT, signal.SIGTERM])
def test_a_file_is_whole_whenever_its_writer_is_ended(by: signal.Signals, tmp_path: Path) -> None:
    path = tmp_path / "result.json"
    kill_a_writer(path, by, [random.Random(by).uniform(0.0, 0.05) for _ in range(4)])
    left = [name for name in os.listdir(tmp_path) if name != "result.json"]
    if by is signal.SIGINT:
        assert left == []  # Ctrl-C is told to the writer, which tidies up
    # what a killed writer leaves is hidden, and in nobody's way
    assert all(name.startswith(".result.json.") and name.endswith(".tmp") for name in left)
    write_file(path, "new")
    assert path.read_text(encoding="utf-8") == "new"


def test_what_a_killed_process_of_the_same_number_left_is_in_nobodys_way(tmp_path: Path) -> None:
    """In a container the process's number is the same each time."""
    left = tmp_path / f".result.json.{os.getpid()}.tmp"
    left.write_text("half of", encoding="utf-8")
    write_file(tmp_path / "result.json", "whole")
    assert (tmp_path / "result.json").read_text(encoding="utf-8") == "whole"
    assert left.read_text(encoding="utf-8") == "half of"  # it may be another's


def kill_a_validation(folder: Path, samples: int, kills: Sequence[tuple[signal.Signals, float]]) -> None:
    """Evidence that is there stays as it was, or is the new one, whenever `fopi validate` is ended."""
    arguments = ["validate", BRAKE, *OPTIONS, "--samples", str(samples), "--out"]
    evidence, old = folder / "r" / "evidence.json", '{"schema": 1, "status": "met"}\n'
    begun = time.perf_counter()
    new = CliRunner().invoke(app, [*arguments, str(folder / "new")])
    lasts_s = time.perf_counter() - begun
    assert new.exit_code in (0, 1)
    wanted = (folder / "new" / "evidence.json").read_text(encoding="utf-8")
    evidence.parent.mkdir()
    for by, share in kills:
        evidence.write_text(old, encoding="utf-8")
        process = start("-m", "fopi_tune", *arguments, str(folder / "r"))
        try:
            process.wait(share * lasts_s)
        except subprocess.TimeoutExpired:
            # the shell's number for Ctrl-C, or the signal itself while Python still starts
            assert ended(process, by) in {signal.SIGKILL: (-9,), signal.SIGINT: (130, -2)}[by]
        process.communicate()
        assert evidence.read_text(encoding="utf-8") in (old, wanted)


def test_validation_that_is_ended_leaves_the_old_evidence_or_the_new(tmp_path: Path) -> None:
    kill_a_validation(tmp_path, 300, [(signal.SIGINT, 0.5), (signal.SIGKILL, 0.7)])


@pytest.mark.long
def test_long_validations_ended_at_random_leave_the_old_evidence_or_the_new(tmp_path: Path) -> None:
    chance = random.Random(5)
    kills = [(chance.choice([signal.SIGINT, signal.SIGKILL]), chance.uniform(0.0, 1.05)) for _ in range(6)]
    kill_a_validation(tmp_path, 200_000, kills)


def test_a_library_that_is_not_installed_is_named_with_its_pip_line(capsys: pytest.CaptureFixture[str]) -> None:
    error = ModuleNotFoundError("No module named 'flint.types'", name="flint.types")
    assert report_failure("brake", error, False) == 3
    said = capsys.readouterr().err
    assert said == "brake: this needs the library flint, which is not installed; pip install 'python-flint'\n"
    assert report_failure("brake", ModuleNotFoundError("gone", name="fopi_tune.gone"), False) == 3
    assert "internal error" in capsys.readouterr().err


def raised_in(module: str, error: ImportError) -> ImportError:
    """The error as code of a module raises it while it is imported."""
    try:
        exec("raise error", {"__name__": module, "error": error})
    except ImportError as caught:
        return caught
    raise AssertionError("nothing was raised")


@pytest.mark.parametrize(
    ("module", "name"), [("matplotlib.figure", None), ("matplotlib", "matplotlib"), ("fopi_tune.report", "matplotlib")]
)
def test_a_library_that_cannot_be_imported_is_named_with_its_pip_line(
    module: str, name: str | None, capsys: pytest.CaptureFixture[str]
) -> None:
    assert report_failure("brake", raised_in(module, ImportError("no such symbol", name=name)), False) == 3
    said = capsys.readouterr().err
    assert said == (
        "brake: this needs the library matplotlib, which cannot be imported (no such symbol); "
        "pip install --force-reinstall 'matplotlib'\n"
    )


@pytest.mark.parametrize("name", [None, "fopi_tune.report"])
def test_an_import_that_fails_in_the_package_itself_is_its_mistake(
    name: str | None, capsys: pytest.CaptureFixture[str]
) -> None:
    assert report_failure("brake", raised_in("fopi_tune.report", ImportError("no such name", name=name)), False) == 3
    assert "internal error, ImportError: no such name" in capsys.readouterr().err


def test_arguments_of_the_library_become_options(capsys: pytest.CaptureFixture[str]) -> None:
    say("leave it or `exact=True` out, or `solver='convex'`; `points` = 0, between `start` and `stop` (`fopi prove`)")
    assert capsys.readouterr().err == (
        "leave it or --exact out, or --solver convex; --points = 0, between --from and --to (`fopi prove`)\n"
    )


def test_errors_of_the_library_name_no_option_of_the_command_line() -> None:
    """But those about files, ledgers and clusters, which only commands read."""
    package = IMPORTED / "fopi_tune"
    found: list[str] = []
    for path in sorted(package.rglob("*.py")):
        place = path.relative_to(package)
        if place.parts[0] in ("cli", "study") or place.as_posix() == "identification/columns.py":
            continue
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Raise):
                texts = (str(each.value) for each in ast.walk(node) if isinstance(each, ast.Constant))
                found += [f"{place}:{node.lineno}: {text}" for text in texts if re.search(r"--[a-z]", text)]
    assert found == []
