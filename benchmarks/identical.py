"""Whether two checkouts give the same bytes:  every result of the shipped specs, systems and studies, schemas and help.

    python benchmarks/identical.py OLD/.venv/bin/fopi NEW/.venv/bin/fopi

Run it before and after a change that must not change behaviour.  Both run in a folder of their own with the first
checkout's specs.  Left out are times, and the ledgers of studies, whose keys hold a hash of the sources.
Takes about ten minutes.  Prints every difference; the exit code is 1 where there is one.
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path

_SECONDS = ((re.compile(rb'"seconds": [0-9.e-]+'), b'"seconds": _'),)
#: of what is said on stderr
_TIMES = (
    (re.compile(rb"[0-9.]+ (s|min|cells/s)\b"), rb"_ \1"),
    # bars and lines that depend on how long a step takes
    (re.compile(rb"[0-9]+ of [0-9]+ cells[^\n]*\n"), b""),
    (re.compile(rb"[^\n]*: still [^\n]*\n"), b""),
)
_COMMANDS = ("tune", "run", "report", "prove", "discretize", "validate", "simulate", "study", "schema", "init")


def commands(specs: list[str], systems: list[str]) -> Iterator[tuple[str, ...]]:
    """Arguments of `fopi`, in the order in which they can run."""
    for name in specs:
        file = f"specs/{name}.yaml"
        yield "tune", file, "--json", "--out", f"out/tune/{name}"
        yield "run", file, "--out", f"out/run/{name}"
        yield "discretize", file, "--out", f"out/discretize/{name}"
    yield "tune", "specs/brake_delay.yaml", "--prices", "--json", "--out", "out/prices"
    yield "tune", "specs/brake.yaml", "--tradeoff", "3", "--points", "5", "--json", "--out", "out/tradeoff"
    yield "tune", "specs/throttle.yaml", "--certify-optimum", "--json", "--out", "out/optimum"
    yield "tune", "specs/pi_baseline.yaml", "--solver", "convex", "--json", "--out", "out/convex"
    yield "validate", "specs/brake.yaml", "--samples", "2000", "--json", "--out", "out/validate"
    yield "report", "--compare", "out/run/brake", "out/run/pi_baseline", "--out", "out/compare"
    for name in systems:
        yield "simulate", f"systems/{name}.yaml", "--json", "--out", f"out/simulate/{name}"
        yield "validate", f"systems/{name}.yaml", "--samples", "300", "--json", "--out", f"out/validate_{name}"
    yield "simulate", "systems/switching.yaml", "--exact", "--json", "--out", "out/exact"
    yield "init", "out/started.yaml"
    yield "run", "out/started.yaml", "--out", "out/started"
    yield "simulate", "out/started.yaml", "--json", "--out", "out/started_simulation"
    yield "prove", "specs/brake.yaml", "--kp", "0.4", "--ki", "0.3", "--alpha", "0.8", "--json", "--out", "out/prove"
    yield "prove", "--recheck", "out/tune/brake/certificate.json", "specs/brake.yaml"
    yield "prove", "--recheck", "out/optimum/optimum.json", "specs/throttle.yaml"
    yield "tune", "specs/missing.yaml"
    for name in ("paper", "filters"):
        yield "study", f"studies/{name}.yaml", "--out", f"out/study/{name}"
    yield from (("schema",), ("schema", "--system"), ("schema", "--study"), ("--help",))
    yield from ((command, "--help") for command in _COMMANDS)


def made_by(fopi: Path, project: Path, folder: Path) -> dict[str, bytes]:
    """Path -> content of all that the commands print and write."""
    for name in ("specs", "systems", "studies"):
        shutil.copytree(project / name, folder / name)
    specs, systems = (sorted(p.stem for p in (project / name).glob("*.yaml")) for name in ("specs", "systems"))
    found = {}
    environment = {**os.environ, "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    for words in commands(specs, systems):
        done = subprocess.run([fopi, *words], cwd=folder, env=environment, capture_output=True, check=False)
        said = without(_SECONDS, done.stdout) + without(_TIMES, done.stderr)
        found["fopi " + " ".join(words)] = said + b"%d" % done.returncode
        print(fopi, *words, done.returncode, flush=True)
    for path in sorted((folder / "out").rglob("*")):
        if path.is_file() and not path.name.startswith("ledger."):
            found[path.relative_to(folder).as_posix()] = without(_SECONDS, path.read_bytes())
    return found


def without(patterns: Sequence[tuple[re.Pattern[bytes], bytes]], content: bytes) -> bytes:
    """Text without what the machine's speed decides."""
    for pattern, instead in patterns:
        content = pattern.sub(instead, content)
    return content


def main() -> int:
    """Compare two installations; 1 where they differ, 2 without two of them."""
    if len(sys.argv) != 3:
        print(__doc__)
        return 2
    old, new = (Path(word).absolute() for word in sys.argv[1:3])
    with tempfile.TemporaryDirectory() as first, tempfile.TemporaryDirectory() as second:
        project = old.parents[2]
        before, after = made_by(old, project, Path(first)), made_by(new, project, Path(second))
    different = sorted(name for name in {*before, *after} if before.get(name) != after.get(name))
    for name in different:
        print("differs:", name)
    print(f"{len({*before, *after})} results compared, {len(different)} differ")
    return bool(different)


if __name__ == "__main__":
    sys.exit(main())
