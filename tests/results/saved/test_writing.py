"""Files that cannot be written, and why."""

from __future__ import annotations

from pathlib import Path

import pytest

from fopi_tune.cli.batch import OutputOptions, write_files
from fopi_tune.cli.output import Exit
from fopi_tune.results.saved.writing import obstacle, write_file


@pytest.mark.parametrize(
    ("blocked", "name", "told"),
    [
        ("figures", "figures/bode.svg", "{}/figures is a file, not a folder"),
        ("c", "c/deep/controller.c", "{}/c is a file, not a folder"),
        ("design.json/", "design.json", "{}/design.json is a folder"),
    ],
)
def test_what_stands_in_the_way_of_a_file_is_named(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], blocked: str, name: str, told: str
) -> None:
    in_the_way = tmp_path / blocked
    if blocked.endswith("/"):
        in_the_way.mkdir()
    else:
        in_the_way.write_text("mine", encoding="utf-8")
    path = tmp_path / name
    with pytest.raises(OSError) as raised:  # noqa: PT011 - which subclass differs between systems
        write_file(path, "text")
    assert obstacle(path, raised.value) == told.format(tmp_path)
    options = OutputOptions(None, as_json=False, quiet=True, debug=False)
    assert write_files(tmp_path, [(name, "text")], "brake", options) == Exit.BAD_INPUT
    said = f"brake: cannot write {path} ({told.format(tmp_path)}); choose another folder with --out\n"
    assert capsys.readouterr().err == said
    assert [each.name for each in tmp_path.iterdir()] == [blocked.rstrip("/")], "no temporary file is left"


def test_other_reasons_are_those_of_the_system(tmp_path: Path) -> None:
    assert obstacle(tmp_path / "a.json", PermissionError(13, "Permission denied")) == "Permission denied"
    assert obstacle(tmp_path / "a.json", OSError(28, "No space left on device")) == "No space left on device"
