"""A study as frozen data:  cells, the stages to run on each, and the columns to collect."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum

from fopi_tune.spec.model import Sense

#: more cells than this need --force
LIMIT_CELLS = 10_000
#: characters of a value in a cell's label
_LONGEST_SHOWN = 200


Value = float | int | str | bool | None
#: outcomes with which a cell ends well, and goes on to its next stage
SUCCESS_STATUSES = ("solved", "met", "settles", "made")


class Stage(StrEnum):
    """What is run on a cell, in this order."""

    TUNE = "tune"
    PROVE = "prove"
    DISCRETIZE = "discretize"
    SIMULATE = "simulate"
    VALIDATE = "validate"


class Starts(StrEnum):
    """Where the search for a cell's gains begins."""

    #: the scan of the whole box, as `fopi tune`
    ALL = "all"
    #: the gains of the spec without overrides, and a scan of the whole box on fewer rays
    BASE = "base"


class Kind(StrEnum):
    """What a cell is."""

    SPEC = "spec"
    SYSTEM = "system"
    CLAIM = "claim"
    FIGURE = "figure"


@dataclass(frozen=True)
class Column:
    """One column of collected values.

    Args:
        name: of the column.
        path: where it is in a cell's result ("tune.gains.kp").
    """

    name: str
    path: str


@dataclass(frozen=True)
class Cell:
    """One unit of computation; all that a worker needs is text.

    Args:
        index: its place in the study, from 0.
        kind: a spec, a system, or an entry of a registry.
        name: of the base spec or system, or of the entry.
        overrides: path to value, as in the study file; they distinguish the cell.
        text: the spec as canonical JSON (which is YAML), a system with its modes' specs; of an entry, its registry.
        check: the spec that the gains are proved, discretised and validated against; empty: `text` itself.
        base: the spec whose gains are polished beside a coarser scan; empty: none.
        stages: what is run, in order.
        files: names and contents of the files that the specs name.
        draws: plants that the stage `validate` draws and that may be divided among workers; 0 of a system.
    """

    index: int
    kind: Kind
    name: str
    overrides: Mapping[str, object]
    text: str
    check: str = ""
    base: str = ""
    stages: tuple[Stage, ...] = ()
    files: tuple[tuple[str, bytes], ...] = ()
    draws: int = 0

    def key(self, versions: Mapping[str, str]) -> str:
        """SHA-256 of everything that a cell's result depends on."""
        # an entry of a registry is named; a spec's name is in its text
        name = "" if self.is_designed else self.name
        files = [(file, hashlib.sha256(content).hexdigest()) for file, content in self.files]
        content = [self.kind, name, self.text, self.check, self.base, self.stages, files, dict(versions)]
        return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()

    @property
    def is_designed(self) -> bool:
        """Whether it is a spec or a system, with stages, and no entry of a registry."""
        return self.kind in (Kind.SPEC, Kind.SYSTEM)

    @property
    def label(self) -> str:
        """The cell in words, for people."""
        told = (f"{path} = {_shortened(json.dumps(value))}" for path, value in self.overrides.items())
        return ", ".join([self.name, *told])


def _shortened(text: str) -> str:
    return text if len(text) <= _LONGEST_SHOWN else f"{text[: _LONGEST_SHOWN - 3]}..."


class Comparison(StrEnum):
    """What a column's value has to be."""

    AT_MOST = "at_most"
    AT_LEAST = "at_least"
    EQUALS = "equals"


@dataclass(frozen=True)
class Condition:
    """A condition on a column; a cell without a value does not meet it."""

    column: str
    comparison: Comparison
    limit: float | str

    def is_met(self, value: Value) -> bool:
        """Whether a value of the column meets it."""
        if self.comparison is Comparison.EQUALS:
            text = str(value).lower() if isinstance(value, bool) else value
            return value is not None and text == self.limit
        if isinstance(value, str | bool) or value is None or isinstance(self.limit, str):
            return False
        return value <= self.limit if self.comparison is Comparison.AT_MOST else value >= self.limit

    def __str__(self) -> str:
        limit = f"{self.limit:g}" if isinstance(self.limit, float) else self.limit
        return f"{self.column} {self.comparison.replace('_', ' ')} {limit}"


@dataclass(frozen=True)
class BestRule:
    """Which cell is the best.

    Args:
        sense: minimise or maximise ...
        column: ... this one's number.
        conditions: that it has to meet.
    """

    sense: Sense
    column: str
    conditions: tuple[Condition, ...] = ()


@dataclass(frozen=True)
class HeatMap:
    """A figure: the numbers of a column as colours over two others."""

    column: str
    x: str
    y: str


@dataclass(frozen=True)
class ReportRule:
    """Figures of the study's page; None where they are chosen.

    Args:
        heat_maps: of which columns.
        parallel_coordinates: columns, an axis each.
    """

    heat_maps: tuple[HeatMap, ...] | None = None
    parallel_coordinates: tuple[str, ...] | None = None


@dataclass(frozen=True)
class Study:
    """A study with all its cells.

    Args:
        name: of the study and of its results' folder.
        cells: in the order of the file.
        collect: columns of the table, beside the cells' names and overrides.
        description: for people.
        best: which cell is marked and kept in full; None for none.
        report: figures of its page.
    """

    name: str
    cells: tuple[Cell, ...]
    collect: tuple[Column, ...]
    description: str = ""
    best: BestRule | None = None
    report: ReportRule = ReportRule()
