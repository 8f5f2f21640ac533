"""What holds for all tests."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest
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
    halves = [
        subprocess.Popen([sys.executable, str(program), half], env=environment) for half in ("rays", "worst_cases")
    ]
    failed = [half.args for half in halves if half.wait()]
    if failed:
        raise pytest.UsageError(f"the search cannot be compiled: {failed}")


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Tests of the pages first, which take longest each: at the end no process waits for another one."""
    items.sort(key=lambda item: item.path.name != "test_docs.py")
