"""Exported C, built and run over its test vectors by the compilers of this machine."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import pytest

FLAGS = ["-std=c99", "-Wall", "-Wextra", "-Wpedantic", "-Wconversion", "-Wdouble-promotion", "-Wshadow", "-Werror"]
FLAGS += ["-ffp-contract=off"]
SANITIZE = ["-g", "-fsanitize=address,undefined", "-fno-sanitize-recover=all"]
with_each_compiler = pytest.mark.parametrize(
    "compiler",
    [
        pytest.param(c, marks=pytest.mark.skipif(not shutil.which(c), reason=f"{c} is not found"))
        for c in ("gcc", "clang")
    ],
)


def replayed(files: dict[str, str], folder: Path, compiler: str, *flags: str) -> subprocess.CompletedProcess[str]:
    """The exported program after a run over its `test_vectors.csv`; it must build."""
    folder.mkdir()
    for name, text in files.items():
        (folder / name).write_text(text, encoding="ascii")
    sources = [name for name in sorted(files) if name.endswith(".c")]
    built = subprocess.run(
        [compiler, *FLAGS, *flags, "-o", "replay", *sources], cwd=folder, capture_output=True, text=True, check=False
    )
    assert built.returncode == 0, built.stderr
    program = [folder / "replay", "test_vectors.csv"]
    return subprocess.run(program, cwd=folder, capture_output=True, text=True, check=False)
