"""What holds for all tests."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from cases.thinned import mark_what_is_thinned
from hypothesis import settings

# the same examples in every run: what fails once fails again
settings.register_profile("seeded", derandomize=True)
settings.load_profile("seeded")


def pytest_sessionstart(session: pytest.Session) -> None:
    """Compile the search before several processes of tests begin: each would compile it for itself."""
    if not session.config.getoption("numprocesses", None):
        return
    from cases.project import IMPORTED

    program = Path(__file__).parent / "cases" / "compile_search.py"
    environment = os.environ | {"PYTHONPATH": os.pathsep.join((str(Path(__file__).parent), str(IMPORTED)))}
    parts = {
        part: subprocess.Popen([sys.executable, str(program), part], env=environment)
        for part in ("rays", "worst_cases", "time")
    }
    failed = {part: code for part, process in parts.items() if (code := process.wait())}
    if failed:
        raise pytest.UsageError(f"the search cannot be compiled; parts and exit codes: {failed}")


@pytest.fixture(scope="module")
def plain_figures() -> Iterator[None]:
    """Reports without rendering, for all tests of a module that are about something else."""
    from cases.plain_figures import RENDERED_BY, drawn_alone

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(RENDERED_BY, drawn_alone)
        yield


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The current folder, which is empty."""
    monkeypatch.chdir(tmp_path)
    return tmp_path


def pytest_configure(config: pytest.Config) -> None:
    """The marker of `cases/thinned.py`."""
    config.addinivalue_line(
        "markers",
        "thinned(every, first, slow): of a test's cases one of `every` from `first` on is run each time, and none"
        " whose id has a text of `slow`; the others have the marker long",
    )


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Long cases are marked before `-m` chooses.

    Tests of the pages come first, which take longest each: at the end no process waits for another one.
    """
    mark_what_is_thinned(items)
    items.sort(key=lambda item: item.path.name != "test_docs.py")
