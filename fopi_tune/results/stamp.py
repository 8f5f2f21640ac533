"""Provenance of results:  versions, platform and digests that reproduce them."""

from __future__ import annotations

import hashlib
import platform
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from importlib.resources import files
from importlib.resources.abc import Traversable

from fopi_tune import __version__

#: distributions whose version can change a number
_DISTRIBUTIONS = ("casadi", "numpy")
_NUMERIC = ("casadi", "numba", "numpy", "python-flint", "scipy")
#: endings of this package's files that can
_SOURCES = (".py", ".yaml", ".jinja")
#: the examples, which an installation has there and a clone has not; no number depends on them
_EXAMPLES = "/examples"
#: `Stamp.solver` of gains for scenarios
CONVEX_STEPS = "convex steps on simulations"
#: the same for gains found by convex problems, and for scenarios
_OTHERS = {"convex": ("clarabel", "cvxpy", "numpy"), CONVEX_STEPS: ("clarabel", "numba", "numpy", "scipy")}


@dataclass(frozen=True)
class Stamp:
    """Provenance of a result.

    Args:
        spec_sha256: of the spec file's bytes.
        versions: distribution name to version.
        python: version of the interpreter.
        platform: operating system and machine.
        solver: what found the gains; None when nothing was solved.
        seed: of random numbers; None when none were drawn.
        digests: of the spec's parts, by their names; empty where the result depends on all of it.
    """

    spec_sha256: str
    versions: dict[str, str]
    python: str
    platform: str
    solver: str | None
    seed: int | None = None
    digests: Mapping[str, str] = field(default_factory=dict)


def stamp(spec_sha256: str, solver: str | None, digests: Mapping[str, str] | None = None) -> Stamp:
    """The stamp of a result made here and now; it holds no time, so that equal inputs give equal files."""
    versions = {"fopi-tune": __version__}
    versions |= {name: _version_of(name) for name in _OTHERS.get(solver or "", _DISTRIBUTIONS)}
    machine = f"{platform.system()} {platform.machine()}"
    return Stamp(spec_sha256, versions, platform.python_version(), machine, solver, digests=dict(digests or {}))


def numeric_versions() -> dict[str, str]:
    """Versions of everything that can change a number of any stage; a study computes a cell again when they change.

    Two checkouts of one version may differ, hence `sources`: a hash of this package's code.
    """
    return {"fopi-tune": __version__, "sources": _sources(), **{name: _version_of(name) for name in _NUMERIC}}


def certificate_versions() -> dict[str, str]:
    """Versions of what a certificate's ball arithmetic ran with."""
    return {
        "fopi-tune": __version__,
        "python": platform.python_version(),
        "python-flint": _version_of("python-flint"),
    }


@cache
def _sources() -> str:
    """A hash of every module and template of this package, independent of line endings."""
    digest = hashlib.sha256()
    for path, content in _walk(files("fopi_tune"), ""):
        text = content.replace(b"\r\n", b"\n")
        digest.update(f"{path}\0{len(text)}\0".encode() + text)
    return digest.hexdigest()[:16]


def _walk(folder: Traversable, path: str) -> Iterator[tuple[str, bytes]]:
    for entry in sorted(folder.iterdir(), key=lambda e: e.name):
        name = f"{path}/{entry.name}"
        if name == _EXAMPLES:
            continue
        if entry.is_dir():
            yield from _walk(entry, name)
        elif entry.name.endswith(_SOURCES):
            yield name, entry.read_bytes()


@cache
def _version_of(name: str) -> str:
    try:
        return version(name)
    except PackageNotFoundError:
        return "not installed"
