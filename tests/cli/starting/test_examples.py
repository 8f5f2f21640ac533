"""The examples that ship: every one is found by its name, and comes with all that it names."""

from __future__ import annotations

from pathlib import Path

import pytest
from cases.commands import fopi
from cases.project import ROOT

from fopi_tune.cli.starting.examples import Example, examples, files_of_example
from fopi_tune.spec import load_any
from fopi_tune.spec.model import SystemSpec
from fopi_tune.study.load import load_study

pytestmark = pytest.mark.usefixtures("folder")
NAMES = sorted(examples())


def written(folder: Path) -> dict[str, bytes]:
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def test_every_file_of_the_folders_is_an_example_of_its_own() -> None:
    paths = {
        path.relative_to(ROOT).as_posix() for f in ("specs", "systems", "studies") for path in (ROOT / f).rglob("*.*")
    }
    assert {example.path for example in examples().values()} == paths
    assert all(example.description for example in examples().values())


@pytest.mark.parametrize("name", NAMES)
def test_an_example_can_be_read_where_it_was_written(name: str, folder: Path) -> None:
    result = fopi("init", "--example", name)
    assert (result.exit_code, result.stdout) == (0, "")
    example = examples()[name]
    assert result.stderr.splitlines()[-1] == f"next: {example.command}"
    for path, content in written(folder).items():
        assert content == (ROOT / path).read_bytes()
    if example.path.startswith("studies/"):
        assert load_study(example.path, force=True).name == name
        assert example.command == f"fopi study {example.path}"
    else:
        loaded = load_any(example.path)
        assert loaded.name == name
        assert example.command.split()[1] == ("simulate" if isinstance(loaded, SystemSpec) else "run")


def test_a_study_of_a_system_comes_with_the_specs_of_its_modes(folder: Path) -> None:
    assert fopi("init", "--example", "hysteresis").exit_code == 0
    assert set(written(folder)) == {
        "studies/hysteresis.yaml",
        "systems/car.yaml",
        "specs/brake.yaml",
        "specs/throttle.yaml",
    }


def test_the_files_that_a_spec_names_come_with_it(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """None that ships names data; one that does is made here."""
    from fopi_tune.cli.starting import examples as module

    (folder / "specs" / "data").mkdir(parents=True)
    (folder / "specs" / "data" / "draws.csv").write_text("gain\n1\n", encoding="utf-8")
    spec = "name: measured\nvalidation: {samples_file: data/draws.csv}\ndescription: not ../../outside.csv\n"
    (folder / "specs" / "measured.yaml").write_text(spec, encoding="utf-8")
    monkeypatch.setattr(module, "_root", lambda: folder)
    example = Example("measured", "specs/measured.yaml", "")
    assert list(files_of_example(example)) == ["specs/data/draws.csv", "specs/measured.yaml"]


def test_without_a_known_name_every_example_is_listed_in_a_line() -> None:
    listed = fopi("init", "--list")
    assert (listed.exit_code, listed.stderr) == (0, "")
    assert sorted(line.split()[0] for line in listed.stdout.splitlines()) == NAMES
    unknown = fopi("init", "--example", "brakes")
    assert (unknown.exit_code, unknown.stdout) == (2, "")
    *others, last = unknown.stderr.splitlines()
    assert last == "there is no example 'brakes'; did you mean brake?"
    assert others == listed.stdout.splitlines()
    assert fopi("init", "--example", "").stderr.splitlines()[-1].endswith("give one of the names above")


def test_a_file_that_differs_is_not_overwritten_without_force(folder: Path) -> None:
    assert fopi("init", "--example", "brake").exit_code == 0
    assert fopi("init", "--example", "brake").exit_code == 0, "equal files are in nobody's way"
    mine = folder / "specs" / "brake.yaml"
    mine.write_text("mine", encoding="utf-8")
    refused = fopi("init", "--example", "car")
    assert refused.exit_code == 2
    assert "specs/brake.yaml exists already" in refused.stderr
    assert set(written(folder)) == {"specs/brake.yaml"}
    assert mine.read_text(encoding="utf-8") == "mine"
    assert fopi("init", "--example", "car", "--force").exit_code == 0
    assert mine.read_bytes() == (ROOT / "specs" / "brake.yaml").read_bytes()


def test_a_file_in_the_place_of_a_folder_is_named(folder: Path) -> None:
    (folder / "specs").write_text("mine", encoding="utf-8")
    refused = fopi("init", "--example", "brake")
    assert refused.exit_code == 2
    assert refused.stderr == "cannot write specs/brake.yaml (specs is a file, not a folder); go to another folder\n"
    assert (folder / "specs").read_text(encoding="utf-8") == "mine"


@pytest.mark.parametrize("more", [["x"], ["--plant", "lag"], ["--from-tf", "1/s"], ["--out", "x.yaml"], ["--list"]])
def test_an_example_takes_no_other_options(more: list[str], folder: Path) -> None:
    result = fopi("init", "--example", "brake", *more)
    assert result.exit_code == 2
    assert "leave the others out" in result.stderr
    assert written(folder) == {}
