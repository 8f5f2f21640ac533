"""`--log-level` and `-v`: lines of the stages on stderr; stdout and files are the same with and without."""

from __future__ import annotations

import logging
from pathlib import Path

import pytest
from cases.commands import fopi
from cases.project import ROOT
from typer.testing import Result

import fopi_tune

BRAKE = str(ROOT / "specs" / "brake.yaml")


def logged(result: Result) -> list[str]:
    return [line for line in result.stderr.splitlines() if line.startswith(("INFO ", "DEBUG "))]


def test_results_and_stdout_are_the_same_with_and_without(tmp_path: Path) -> None:
    plain = fopi("tune", BRAKE, "--out", str(tmp_path / "plain"))
    shown = fopi("-vv", "tune", BRAKE, "--out", str(tmp_path / "shown"))
    assert (plain.exit_code, plain.stdout) == (shown.exit_code, shown.stdout)
    assert logged(plain) == []
    files = {path.name: path.read_bytes() for path in (tmp_path / "plain").iterdir()}
    assert files == {path.name: path.read_bytes() for path in (tmp_path / "shown").iterdir()}
    assert any(line.startswith("DEBUG fopi_tune.design.search: scan:") for line in logged(shown))
    assert any("brake: proof: proved, " in line for line in logged(shown))


@pytest.mark.parametrize("words", [("-v",), ("--verbose",), ("--log-level", "info"), ("--log-level", "INFO")])
def test_at_level_info_no_details_are_shown_and_nothing_is_left_behind(words: tuple[str, ...], tmp_path: Path) -> None:
    logger = logging.getLogger("fopi_tune")
    before = (logger.level, list(logger.handlers))
    result = fopi(*words, "tune", BRAKE, "--quiet", "--no-proof", "--out", str(tmp_path))
    lines = logged(result)
    assert lines
    assert all(line.startswith("INFO fopi_tune.") for line in lines)
    assert (logger.level, logger.handlers) == before


def test_a_level_that_there_is_not_ends_with_2() -> None:
    assert fopi("--log-level", "loud", "tune", BRAKE).exit_code == 2


def test_the_library_is_silent_until_a_program_asks(capfd: pytest.CaptureFixture[str]) -> None:
    assert fopi_tune.__name__ == "fopi_tune"
    assert any(isinstance(each, logging.NullHandler) for each in logging.getLogger("fopi_tune").handlers)
    fopi_tune.tune(BRAKE, proof=False)
    assert capfd.readouterr() == ("", "")
