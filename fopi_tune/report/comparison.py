"""Designs side by side:  the requirements and values of each, and which design is better in what.

Values are ranked only where they are the same quantity, over the same plants, of the same loop; all others are shown
without a ranking.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from fopi_tune.core.text_tables.words import counted
from fopi_tune.report.documents import Document, ReportedRequirement, ResultDocuments
from fopi_tune.report.requirement_rows import RequirementRow, requirement_rows
from fopi_tune.report.text.formatting import number, requirement_phrase, samples_phrase, scope_phrase
from fopi_tune.results.documents import loop_name
from fopi_tune.spec.model import Relation, Requirement, Sense

#: designs on a page: more lines than these cannot be told apart
MOST = 6
#: relative; values that differ by less are called alike
ALIKE = 1e-4
_LETTERS = "ABCDEF"
_SIDES = {Relation.AT_LEAST: ", least", Relation.AT_MOST: ", largest"}


@dataclass(frozen=True)
class ComparedDesign:
    """One of the designs.

    Args:
        letter: its short name.
        name: of its spec; with where it was read from, if two specs have that name.
        documents: what is known of it.
    """

    letter: str
    name: str
    documents: ResultDocuments

    @property
    def label(self) -> str:
        """Short name and name."""
        return f"{self.letter} {self.name}"

    @property
    def is_stable(self) -> bool:
        """Whether the check found the whole family stable."""
        return bool((self.documents.design["stability"] or {}).get("stable"))

    @property
    def loop(self) -> str:
        """Which loop the requirements are about."""
        digital = self.documents.spec.sampled_design
        if digital is None:
            return "in continuous time"
        return f"on samples, every {number(digital.sample_time_s)} s, {samples_phrase(digital.delay_samples)} of delay"


@dataclass(frozen=True)
class Cell:
    """The entry of one design in a row.

    Args:
        words: the value in words.
        note: below the value: its own limit, or its verdict.
        sign: symbol of the verdict; empty where there is none.
        is_best: whether it is better than all it is compared with.
    """

    words: str
    note: str = ""
    sign: str = ""
    is_best: bool = False


@dataclass(frozen=True)
class ComparisonRow:
    """One quantity over all designs.

    Args:
        what: the quantity, with its limit where all have the same.
        scope: for which plants and frequencies.
        cells: one for each design; None where its spec has no such requirement.
    """

    what: str
    scope: str
    cells: tuple[Cell | None, ...]


@dataclass(frozen=True)
class Comparison:
    """Designs side by side.

    Args:
        entries: the designs, in the order they were named.
        groups: indices of designs of the same plants and the same loop, in the same order.
        lines: requirements, then objectives and the largest |S|.
        sentences: which design is better in what, and what is not compared.
    """

    entries: tuple[ComparedDesign, ...]
    groups: tuple[tuple[int, ...], ...]
    lines: tuple[ComparisonRow, ...]
    sentences: tuple[str, ...]


@dataclass(frozen=True)
class _Reading:
    """One number of one design.

    Args:
        value: may be infinite.
        merit: larger is better; None where values cannot be ranked.
        cell: how it is shown.
        target: the limit of an equality; None for other relations.
    """

    value: float
    merit: float | None
    cell: Cell
    target: float | None = None


def compare_designs(named: Sequence[tuple[str, ResultDocuments]]) -> Comparison:
    """Put designs side by side.

    Args:
        named: where each was read from, and its documents; at most `MOST`.
    """
    names = [documents.spec.name for _, documents in named]
    entries = tuple(
        ComparedDesign(_LETTERS[k], name if names.count(name) == 1 else f"{name} ({plain(source)})", documents)
        for k, (name, (source, documents)) in enumerate(zip(names, named, strict=True))
    )
    groups = _groups(entries)
    lines, words = [], [_requirements_sentence(entry) for entry in entries]
    for line, readings in (*_requirement_lines(entries), *_objective_lines(entries)):
        best, told = _ranked(line, readings, entries, groups)
        cells = tuple(
            cell if cell is None or k not in best else Cell(cell.words, cell.note, cell.sign, True)
            for k, cell in enumerate(line.cells)
        )
        lines.append(ComparisonRow(line.what, line.scope, cells))
        words += told
    return Comparison(entries, groups, tuple(lines), (*words, *_exclusions(entries, groups)))


def plain(text: str, most: int = 60) -> str:
    """A file's name for a page: characters that cannot be printed as escapes, and a long name without its middle."""
    shown = "".join(c if c.isprintable() else repr(c)[1:-1] for c in text)
    half = (most - 3) // 2
    return shown if len(shown) <= most else f"{shown[:half]}...{shown[-half:]}"


def _requirements_sentence(entry: ComparedDesign) -> str:
    """How many requirements of its own spec a design meets, as a sentence."""
    design, digital = entry.documents.design, entry.documents.digital
    said, verdict = design["requirements"], design["proof"]["verdict"]
    missed = _missed(design)
    every = counted(len(said), "requirement")
    told = f"misses {missed} of the {every}" if missed else f"meets all {every}"
    word = {"proved": "proved", "refuted": "refuted", "undecided": "undecided"}.get(verdict, "not proved")
    words = f"{entry.label} {told} of its spec ({design['status']}, {word})"
    if digital is None or loop_name(entry.documents.spec) == "sampled":
        return f"{words}."
    missed = _missed(digital)
    return f"{words}; its loop on samples " + (f"misses {missed} of them." if missed else "meets them too.")


def _missed(document: Document) -> int:
    return sum(not each["met"] for each in document["requirements"])


def _groups(entries: Sequence[ComparedDesign]) -> tuple[tuple[int, ...], ...]:
    """Indices of designs with the same plants (model, ranges and nominal values) and the same loop."""
    keys = [(entry.documents.spec.plant, entry.loop) for entry in entries]
    firsts = [k for k, key in enumerate(keys) if keys.index(key) == k]
    return tuple(tuple(k for k, key in enumerate(keys) if key == keys[first]) for first in firsts)


def _requirement_lines(entries: Sequence[ComparedDesign]) -> list[tuple[ComparisonRow, tuple[_Reading | None, ...]]]:
    """A row for each quantity, relation, scope and band in any of the specs, in order of appearance."""
    said = [_by_key(entry.documents) for entry in entries]
    keys = list(dict.fromkeys(key for each in said for key in each))
    made = []
    for key in keys:
        found = [each.get(key) for each in said]
        asked = [pair[0].requirement for pair in found if pair is not None]
        same = all((r.limits, r.end_limit) == (asked[0].limits, asked[0].end_limit) for r in asked)
        what = requirement_phrase(asked[0]) if same else asked[0].quantity + _SIDES.get(asked[0].relation, "")
        readings = tuple(None if pair is None else _reading(*pair, own_limit=not same) for pair in found)
        cells = tuple(None if each is None else each.cell for each in readings)
        made.append((ComparisonRow(what, scope_phrase(asked[0]), cells), readings))
    return made


def _by_key(documents: ResultDocuments) -> dict[tuple[Any, ...], tuple[ReportedRequirement, RequirementRow]]:
    """Requirements by everything but their limits, and a counter that tells equal ones apart."""
    found: dict[tuple[Any, ...], tuple[ReportedRequirement, RequirementRow]] = {}
    for each, row in zip(documents.requirements, requirement_rows(documents.requirements), strict=True):
        r = each.requirement
        key = (r.quantity, r.relation, r.scope, r.from_rad_s, r.to_rad_s)
        number_of = sum(other[:-1] == key for other in found)
        found[(*key, number_of)] = (each, row)
    return found


def _reading(found: ReportedRequirement, row: RequirementRow, *, own_limit: bool) -> _Reading:
    said, r = found.reported, found.requirement
    value = said["achieved"] if said["outcome"] != "infinite" else math.inf
    limit = f"asked: {requirement_phrase(r).removeprefix(r.quantity).strip()}; " if own_limit else ""
    cell = Cell(row.achieved, f"{limit}{row.verdict}, score {row.score}", row.sign)
    target = r.limits[0] if r.relation is Relation.EQUALS else None
    if value is None:
        return _Reading(math.nan, None, cell, target)
    return _Reading(float(value), _merit(r, float(value)), cell, target)


def _merit(r: Requirement, value: float) -> float | None:
    if r.relation is Relation.BETWEEN:
        return None
    return {Relation.AT_LEAST: value, Relation.AT_MOST: -value}.get(r.relation, -abs(value - r.limits[0]))


def _objective_lines(entries: Sequence[ComparedDesign]) -> list[tuple[ComparisonRow, tuple[_Reading | None, ...]]]:
    """A row for each objective of any spec, and one for the largest |S|."""
    objectives = list(dict.fromkeys(str(entry.documents.design["objective_quantity"]) for entry in entries))
    makers: list[tuple[str, Callable[[ResultDocuments], float | None], float | None]] = [
        (f"objective: {words}", lambda f, words=words: _objective(f, words), _sign(entries, words))
        for words in objectives
    ]
    makers.append(("largest |S|, dB, all frequencies", _peak, -1.0))
    made = []
    for what, value_of, sign in makers:
        values = [value_of(entry.documents) for entry in entries]
        # objectives are ranked only where the requirements are met
        counts = [sign is not None and (value_of is _peak or not _missed(entry.documents.design)) for entry in entries]
        readings = tuple(
            None if v is None else _Reading(v, sign * v if sign is not None and ranked else None, Cell(number(v)))
            for v, ranked in zip(values, counts, strict=True)
        )
        made.append(
            (ComparisonRow(what, "family", tuple(None if each is None else each.cell for each in readings)), readings)
        )
    return made


def _objective(documents: ResultDocuments, words: str) -> float | None:
    design = documents.design
    return design["objective"] if design["objective_quantity"] == words else None


def _peak(documents: ResultDocuments) -> float | None:
    return (documents.design["stability"] or {}).get("peak_sensitivity_db")


def _sign(entries: Sequence[ComparedDesign], words: str) -> float | None:
    """+1 or -1 where more is better or worse; None for the slack, which is another quantity in each spec."""
    objective = next(e.documents.spec.objective for e in entries if e.documents.design["objective_quantity"] == words)
    if objective is None:
        return None
    return 1.0 if objective.sense is Sense.MAXIMIZE else -1.0


def _ranked(
    line: ComparisonRow,
    readings: Sequence[_Reading | None],
    entries: Sequence[ComparedDesign],
    groups: Sequence[Sequence[int]],
) -> tuple[set[int], list[str]]:
    """Which designs are best in a row, and a sentence for every group with at least two to compare."""
    best, words = set[int](), []
    where = f"{line.what} ({line.scope})"
    for group in groups:
        ranked = [(k, r, r.merit) for k in group if (r := readings[k]) is not None and r.merit is not None]
        ranked = sorted((each for each in ranked if entries[each[0]].is_stable), key=lambda each: -each[2])
        targets = {r.target for _, r, _ in ranked}
        if len(ranked) < 2 or len(targets) > 1:
            continue
        (first, top, _), others = ranked[0], ranked[1:]
        tied = sorted(entries[k].letter for k, r, _ in ranked if _alike(top, r))
        rest = ", ".join(f"{_formatted(r.value)} ({entries[k].letter})" for k, r, _ in others if not _alike(top, r))
        against = f"{_formatted(top.value)} against {rest}" if rest else _formatted(top.value)
        if len(tied) > 1:
            words.append(f"{' and '.join(tied)} are alike in {where}: {against}.")
            continue
        best.add(first)
        few = len(others) == 1
        comparative = ("better in" if few else "best in") if targets == {None} else "closer to" if few else "closest to"
        words.append(f"{entries[first].label} is {comparative} {where}: {against}.")
    return best, words


def _alike(a: _Reading, b: _Reading) -> bool:
    assert a.merit is not None
    assert b.merit is not None  # only values that can be ranked get here
    if a.merit == b.merit:
        return True
    size = max(abs(a.value), abs(b.value), abs(a.target or 0.0))
    return math.isfinite(size) and abs(a.merit - b.merit) <= ALIKE * size


def _formatted(value: float) -> str:
    return "infinite" if math.isinf(value) else number(value)


def _exclusions(entries: Sequence[ComparedDesign], groups: Sequence[Sequence[int]]) -> list[str]:
    words = [
        f"{entry.label} is {entry.documents.design['status']}: its gains are no solution, only where the search ended."
        for entry in entries
        if entry.documents.design["status"] in ("infeasible", "unbounded", "failed")
    ]
    words += [
        f"{entry.label} is not shown to be stable for every plant: its values are not compared."
        for entry in entries
        if not entry.is_stable
    ]
    words += [
        f"{entry.label} misses requirements: its objective is not compared."
        for entry in entries
        if entry.is_stable and _missed(entry.documents.design)
    ]
    if len(groups) > 1:
        told = "; ".join(" and ".join(entries[k].letter for k in group) for group in groups)
        words.append(f"Not about the same plants or the same loop, and not compared with each other: {told}.")
    return words
