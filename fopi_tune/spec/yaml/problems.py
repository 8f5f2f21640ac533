"""Collects the problems of a file, each with line and column, so that all mistakes are reported at once."""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from typing import NoReturn

from fopi_tune.errors import Problem, SpecError

_PLAIN_WORD = re.compile(r"[A-Za-z0-9_.+<>-]{1,40}")
_EXCERPT_LENGTH = 40


@dataclass(frozen=True, order=True)
class Mark:
    """A position in the text; `line` and `column` count from 1."""

    line: int
    column: int


@dataclass
class ProblemCollector:
    """The problems found so far in one file."""

    file: str
    problems: list[Problem] = field(default_factory=list)

    def add(self, mark: Mark, path: str, message: str) -> None:
        """Add one problem and go on."""
        self.problems.append(Problem(self.file, mark.line, mark.column, path, message))

    def stop(self, mark: Mark, path: str, message: str) -> NoReturn:
        """Add one problem after which nothing more can be read."""
        self.add(mark, path, message)
        raise self.error()

    def error(self) -> SpecError:
        """All problems found so far, sorted by position."""
        return SpecError(tuple(sorted(self.problems, key=lambda p: (p.line, p.column))))


def quoted(text: str) -> str:
    """The user's own words on one short line: control characters escaped, the middle of long text left out."""
    if len(text) > _EXCERPT_LENGTH:
        return f"{text[:24]!r}…{text[-8:]!r}"
    return repr(text)


def key_path(path: str, key: str) -> str:
    """The path of a key inside `path`; a key that is not a plain word is quoted."""
    word = key if _PLAIN_WORD.fullmatch(key) else quoted(key)
    return f"{path}.{word}" if path else word


def item_path(path: str, index: int) -> str:
    """The path of a list's entry; `index` counts from 0."""
    return f"{path}[{index}]"
