"""`fopi` alone: the steps that it prints are commands that work, in their order."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from cases.commands import fopi

pytestmark = pytest.mark.usefixtures("plain_figures", "folder")


def printed_steps() -> list[list[str]]:
    """The arguments of the commands that `fopi` alone prints, a line each."""
    return [line.split() for line in re.findall(r"^  fopi (\S.*?)  ", fopi().stdout, re.MULTILINE)]


def test_without_arguments_the_first_steps_are_printed_and_nothing_is_written(folder: Path) -> None:
    result = fopi()
    assert (result.exit_code, result.stderr) == (0, "")
    assert [step[0] for step in printed_steps()] == ["init", "tune", "run"]
    assert list(folder.iterdir()) == []


def test_the_first_step_writes_the_file_that_the_others_name() -> None:
    init, *others = printed_steps()
    assert fopi(*init).exit_code == 0
    assert all(Path(step[1]).is_file() for step in others)


@pytest.mark.long
def test_the_first_steps_succeed_and_leave_the_page_that_they_name() -> None:
    page = re.search(r"a page to read: (\S+)", fopi().stdout)
    assert page is not None
    for step in printed_steps():
        result = fopi(*step)
        assert result.exit_code == 0, result.output
    assert Path(page.group(1)).is_file()
