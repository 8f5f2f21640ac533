"""Where a result comes from:  what it takes to make it again."""

from __future__ import annotations

import platform
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version

from fopi_tune import __version__

#: other distributions whose version can change a number
_DISTRIBUTIONS = ("casadi", "numpy")
#: the same of gains found by convex problems
_CONVEX_DISTRIBUTIONS = ("clarabel", "cvxpy", "numpy")


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
    """

    spec_sha256: str
    versions: dict[str, str]
    python: str
    platform: str
    solver: str | None
    seed: int | None = None


def stamp(spec_sha256: str, solver: str | None) -> Stamp:
    """The stamp of a result made here and now; it holds no time, so that equal inputs give equal files."""
    versions = {"fopi-tune": __version__}
    for name in _CONVEX_DISTRIBUTIONS if solver == "convex" else _DISTRIBUTIONS:
        try:
            versions[name] = version(name)
        except PackageNotFoundError:
            versions[name] = "not installed"
    return Stamp(spec_sha256, versions, platform.python_version(), f"{platform.system()} {platform.machine()}", solver)


def certificate_versions() -> dict[str, str]:
    """What a certificate's balls were computed with."""
    found = {"fopi-tune": __version__, "python": platform.python_version()}
    try:
        found["python-flint"] = version("python-flint")
    except PackageNotFoundError:
        found["python-flint"] = "not installed"
    return found
