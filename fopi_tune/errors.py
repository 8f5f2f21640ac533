"""The domain's exceptions.  Every message says what is wrong, where, and what to do.

Infeasible, unbounded and unstable are outcomes, not exceptions: see `fopi_tune.design`.
"""

from __future__ import annotations

from dataclasses import dataclass


class FopiError(Exception):
    """Base class of everything this package raises on purpose."""


class DomainError(FopiError, ValueError):
    """A number lies where the mathematics is not defined (omega <= 0, alpha outside (0, 2), an empty range)."""


class UnstableLoopError(DomainError):
    """A loop that is not stable, and turns too often for anything else of it to be searched; the message says so."""


@dataclass(frozen=True)
class Problem:
    """One mistake in a spec file.

    `line` and `column` count from 1, and are 0 in a spec that has no lines (`ft.spec`); `path` is the key's place in
    the document ("plant.time_constant_s.min").
    """

    file: str
    line: int
    column: int
    path: str
    message: str

    def __str__(self) -> str:
        where = f"{self.file}:{self.line}:{self.column}: " if self.line else f"{self.file}: "
        return where + (f"{self.path}: {self.message}" if self.path else self.message)


class SpecError(FopiError, ValueError):
    """A spec that cannot be used; carries every problem that was found, in the order of the file."""

    def __init__(self, problems: tuple[Problem, ...]) -> None:
        self.problems = problems
        super().__init__("\n".join(str(p) for p in problems))


class CertificateError(FopiError, ValueError):
    """A file that is no certificate, or not one that this version can read; the message names the entry."""
