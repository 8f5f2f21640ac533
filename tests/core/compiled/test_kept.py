"""What Numba keeps on disk:  used again, and not after any module has changed that it is compiled from."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from cases.project import ROOT

from fopi_tune.core.compiled.kept import sources

_CALLS = """
import sys
sys.path.insert(0, sys.argv[1])
from outer import twice
print(twice(3.0), sum(twice.stats.cache_hits.values()), sum(twice.stats.cache_misses.values()))
"""
_OUTER = """
from pathlib import Path
from fopi_tune.core.compiled.kept import kept, sources
from inner import one

def twice(x):
    return one(x) + one(x)

twice = kept(twice, sources(Path(__file__).parent.glob("*.py")), error_model="numpy")
"""
_INNER = """
from numba import njit

@njit
def one(x):
    return x + {number}
"""


def _called(folder: Path) -> str:
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "NUMBA_CACHE_DIR": str(folder / "kept")}
    done = subprocess.run(
        [sys.executable, "-c", _CALLS, str(folder)], capture_output=True, text=True, env=environment, check=True
    )
    return done.stdout.strip()


def test_what_was_compiled_is_used_again_until_a_module_that_it_calls_changes(tmp_path: Path) -> None:
    (tmp_path / "outer.py").write_text(_OUTER)
    (tmp_path / "inner.py").write_text(_INNER.format(number="1.0"))
    assert _called(tmp_path) == "8.0 0 1"
    assert _called(tmp_path) == "8.0 1 0"
    (tmp_path / "inner.py").write_text(_INNER.format(number="1.25"))
    assert _called(tmp_path) == "8.5 0 1"


@pytest.mark.skipif(os.geteuid() == 0, reason="root writes everywhere")
def test_without_a_place_to_keep_it_a_function_is_compiled_all_the_same(tmp_path: Path) -> None:
    (tmp_path / "outer.py").write_text(_OUTER)
    (tmp_path / "inner.py").write_text(_INNER.format(number="1.0"))
    (tmp_path / "kept").touch(0o444)
    assert _called(tmp_path).startswith("8.0 0 ")
    shutil.rmtree(tmp_path, ignore_errors=True)


def test_sources_are_names_sizes_and_times_in_order(tmp_path: Path) -> None:
    for name in "b.py", "a.py":
        (tmp_path / name).write_text(name)
    assert [(name, size) for name, size, _ in sources(tmp_path.glob("*.py"))] == [("a.py", 4), ("b.py", 4)]
