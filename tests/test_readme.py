"""The README and CONTRIBUTING keep their word: spec, command, table, library example; folders and files."""

from __future__ import annotations

import contextlib
import dataclasses
import io
import os
import re
import subprocess
from pathlib import Path

import pytest
from cases.markdown_pages import INSTALL, ROOT, blocks_of, unknown_words
from test_architecture import LAYERS
from typer.testing import CliRunner

from fopi_tune.cli import app
from fopi_tune.spec import load_spec, parse_spec
from fopi_tune.spec.model import DesignSpec

README = (ROOT / "README.md").read_text(encoding="utf-8")
CONTRIBUTING = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
BLOCKS = blocks_of(README)
#: everything more is in docs/
MOST_LINES = 170


def block(language: str, index: int = 0) -> str:
    return [each.text for each in BLOCKS if each.language == language][index]


def test_there_is_no_block_that_no_test_here_is_about() -> None:
    # the spec, the main command and its table, the test command, the library; fences count twice
    assert [each.language for each in BLOCKS] == ["yaml", "sh", "text", "sh", "python"]
    assert len(re.findall(r"^```", README, re.MULTILINE)) == 2 * len(BLOCKS)


def test_the_readme_is_one_page() -> None:
    assert len(README.splitlines()) <= MOST_LINES


def test_commands_and_options_in_sentences_exist() -> None:
    assert unknown_words(README) == []


def without_lines(spec: DesignSpec) -> DesignSpec:
    requirements = tuple(dataclasses.replace(requirement, line=0) for requirement in spec.requirements)
    return dataclasses.replace(
        spec, requirements=requirements, text_sha256="", description="", digital=None, validation=None
    )


def test_the_spec_on_the_first_screen_is_the_brakes() -> None:
    assert without_lines(parse_spec(block("yaml"))) == without_lines(load_spec(ROOT / "specs" / "brake.yaml"))


def test_the_main_command_prints_the_table(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    install, _, command = block("sh").strip().rpartition(" && ")
    assert install == f"{INSTALL}."
    program, *arguments = command.split()
    assert program == ".venv/bin/fopi"
    # The command names a spec of the checkout; its results must not go there from a test.
    (tmp_path / "specs").mkdir()
    (tmp_path / "specs" / "brake.yaml").write_bytes((ROOT / "specs" / "brake.yaml").read_bytes())
    monkeypatch.chdir(tmp_path)
    result = CliRunner().invoke(app, arguments)
    assert result.exit_code == 0
    assert result.stdout == block("text")
    assert (tmp_path / "results" / "brake" / "design.json").exists()


def test_the_library_example_runs(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(ROOT)
    printed = io.StringIO()
    with contextlib.redirect_stdout(printed):
        exec(compile(block("python"), "README.md", "exec"), {})
    lines = printed.getvalue().splitlines()
    assert lines[0].startswith("solved FoPi(kp=0.4465")
    assert lines[1:3] == ["violated refuted", "True"]
    assert lines[3].startswith(("met 90.0", "met 89.9999"))
    assert len(lines) == 4


def test_the_test_command_is_one_line_and_ci_runs_it_as_printed() -> None:
    command = block("sh", 1)
    assert command.strip() == f"{INSTALL}'.[test]' && .venv/bin/pytest -q -n 2"
    script = ROOT / ".ci" / "run"
    extract = next(line for line in script.read_text(encoding="utf-8").splitlines() if line.startswith("test_command="))
    shown = subprocess.run(
        ["bash", "-c", f'{extract}; printf "%s" "$test_command"'], cwd=ROOT, capture_output=True, text=True, check=True
    )
    assert shown.stdout == command.strip()
    assert os.access(script, os.X_OK)


def test_every_linked_file_exists() -> None:
    links = re.findall(r"\]\((?!https?:)([^)#]+)\)", README)
    assert links
    assert all((ROOT / link).exists() for link in links)


# ---- CONTRIBUTING.md, which lists the package's folders and files ----


def test_the_plan_of_the_house_is_that_of_the_layers() -> None:
    (plan,) = (each.text for each in blocks_of(CONTRIBUTING) if each.language == "text")
    assert re.findall(r"^(\w+)(?:/|\.py) ", plan, re.MULTILINE) == list(LAYERS)


def test_every_path_in_contributing_exists() -> None:
    named = re.findall(r"`((?:\.?[\w*]+/)+(?:[\w*]+(?:\.\w+)?)?)`", CONTRIBUTING)
    assert len(named) > 40
    # what lies in no folder of the checkout is of the package
    assert [path for path in named if not ((ROOT / path).exists() or (ROOT / "fopi_tune" / path).exists())] == []
    plan = next(each.text for each in blocks_of(CONTRIBUTING) if each.language == "text")
    for line in plan.splitlines():
        folder, *inside = re.findall(r"(?<![\w/])(\w+)/(?= )", line) or [""]
        assert all((ROOT / "fopi_tune" / folder / each).is_dir() for each in inside), line
