"""The best cell of a study:  a column to minimise or maximise, conditions on columns -> a cell, or why there is none.

    best: {minimize: iae, where: [{column: stable, at_least: 200}]}

Only cells that end well count, unless a condition is about the column `outcome`.  Of equal cells the first is the best.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import PurePosixPath
from typing import Any

from fopi_tune.core.text_tables.words import agreeing, counted
from fopi_tune.spec.model import Sense
from fopi_tune.spec.yaml.nodes import Place
from fopi_tune.spec.yaml.records import Key, OneKeyOf, Record, Values
from fopi_tune.spec.yaml.shapes import ListOf, Number, Shape, Text
from fopi_tune.study.model import SUCCESS_STATUSES, BestRule, Cell, Comparison, Condition, Kind, Value
from fopi_tune.study.words import AnyScalar, PlacedRule, PlacedWord, WithPlace

#: the column of the mark
BEST = "best"
#: files of the best cell: its results in full, and its spec
BEST_JSON, BEST_YAML = "best.json", "best.yaml"
#: keys of a spec whose values are names of files
_FILE_KEYS = ("file", "files", "samples_file")
_OUTCOME = "outcome"
_EXAMPLE = "{minimize: iae, where: [{column: stable, at_least: 200}]}"


@dataclass(frozen=True)
class Best:
    """The best cell.

    Args:
        rule: by which it is.
        index: of the cell; None where no cell meets the conditions.
        value: of the rule's column.
        message: how many cells meet the conditions, or why none does.
    """

    rule: BestRule
    index: int | None
    value: float | None
    message: str


def find_best(rule: BestRule, records: Sequence[Mapping[str, Value]]) -> Best:
    """The best cell of a table's rows, each with its column `cell`, which counts from 1."""
    conditions = rule.conditions
    ended = list(records)
    if not any(each.column == _OUTCOME for each in conditions):
        ended = [each for each in records if each.get(_OUTCOME) in SUCCESS_STATUSES]
        if not ended:
            return Best(rule, None, None, f"none of {counted(len(records), 'cell')} ends well")
    met = [each for each in ended if all(c.is_met(each.get(c.column)) for c in conditions)]
    if not met:
        return Best(rule, None, None, _why_none(conditions, ended))
    found: list[tuple[float, int]] = []
    for each in met:
        value, cell = each.get(rule.column), each.get("cell")
        if isinstance(value, int | float) and not isinstance(value, bool) and isinstance(cell, int):
            found.append((value, cell - 1))
    if not found:
        which = "no cell that meets the conditions" if conditions else "no cell"
        return Best(rule, None, None, f"{which} has a number in the column {rule.column}")
    side = 1.0 if rule.sense is Sense.MINIMIZE else -1.0
    value, index = min(found, key=lambda each: (side * each[0], each[1]))
    of = (
        f"of {counted(len(found), 'cell')} that {agreeing(len(found), 'meets', 'meet')} the conditions"
        if conditions
        else f"of {counted(len(found), 'cell')}"
    )
    return Best(rule, index, float(value), of)


def _why_none(conditions: Sequence[Condition], records: Sequence[Mapping[str, Value]]) -> str:
    """The conditions that no cell meets, or how many meet each."""
    counts = [(each, sum(each.is_met(record.get(each.column)) for record in records)) for each in conditions]
    never = [f"{each}{_nearest(each, records)}" for each, count in counts if not count]
    if never:
        return f"none of {counted(len(records), 'cell')} has {' or '.join(never)}"
    told = ", ".join(f"{each} ({count} {agreeing(count, 'does', 'do')})" for each, count in counts)
    return f"none of {counted(len(records), 'cell')} meets all of {told}"


def _nearest(condition: Condition, records: Sequence[Mapping[str, Value]]) -> str:
    values = [record.get(condition.column) for record in records]
    numbers = [float(v) for v in values if isinstance(v, int | float) and not isinstance(v, bool)]
    if not numbers or condition.comparison is Comparison.EQUALS:
        return ""
    lowest = condition.comparison is Comparison.AT_MOST
    return f" (the {'least' if lowest else 'most'} is {min(numbers) if lowest else max(numbers):.5g})"


def best_shape() -> Shape:
    """The shape of the section `best`."""
    where = Key(ListOf("conditions that the cell has to meet", _condition_shape(), 1), required=False)
    records = {
        sense.value: Record(
            "which cell is the best",
            {sense.value: Key(WithPlace(Text(f"column whose number is {sense.value[:-1]}ed"))), "where": where},
            lambda values, place, sense=sense: _build(sense, values),
            _EXAMPLE,
        )
        for sense in Sense
    }
    return OneKeyOf("the cell that is marked, and kept in full", "direction", records, _EXAMPLE)


def _condition_shape() -> Record:
    number = {word: Key(Number(f"{word.replace('_', ' ')} this"), False) for word in ("at_most", "at_least")}
    keys = {"column": Key(WithPlace(Text("name of a column of the table"))), **number}
    keys["equals"] = Key(AnyScalar("exactly this number or word"), False)
    rules = {"anyOf": [{"required": [comparison.value]} for comparison in Comparison]}
    return Record("a condition on a column", keys, _conditions, "{column: stable, at_least: 200}", rules=rules)


def _conditions(values: Values, place: Place) -> tuple[PlacedWord, tuple[Condition, ...]] | None:
    word: PlacedWord = values["column"]
    found = tuple(Condition(word.word, each, values[each.value]) for each in Comparison if each.value in values)
    if not found:
        place.refuse("the condition has no limit; add at_most: or at_least: with a number, or equals:")
        return None
    return word, found


def _build(sense: Sense, values: Mapping[str, Any]) -> PlacedRule[BestRule]:
    word: PlacedWord = values[sense.value]
    where: list[tuple[PlacedWord, tuple[Condition, ...]]] = values.get("where") or []
    conditions = tuple(condition for _, each in where for condition in each)
    return PlacedRule(BestRule(sense, word.word, conditions), (word, *(column for column, _ in where)))


def best_files(name: str, best: Best, cell: Cell | None, document: str) -> dict[str, str | bytes]:
    """The files of the best cell: names to contents.

    Args:
        name: of the study.
        best: what was found.
        cell: the one of `best.index`; None where there is none.
        document: its result, as JSON.
    """
    rule = best.rule
    told: dict[str, Any] = {
        "schema": 1,
        "name": name,
        rule.sense.value: rule.column,
        "where": [{"column": c.column, c.comparison.value: c.limit} for c in rule.conditions],
        "cell": None if best.index is None else best.index + 1,
        "value": best.value,
        "message": best.message,
    }
    if cell is None:
        return {BEST_JSON: _json(told)}
    check = json.loads(cell.check) if cell.check else None
    told |= {"overrides": dict(cell.overrides), "spec": json.loads(cell.text), "check": check}
    return {BEST_JSON: _json(told | {"results": json.loads(document)}), **_specs_of(cell)}


def _specs_of(cell: Cell) -> dict[str, str | bytes]:
    """The cell's spec as files that can be run: of a system also those of its modes, and data that they name."""
    renamed = {file: f"{BEST}_{PurePosixPath(file.replace(chr(92), '/')).name}" for file, _ in cell.files}
    found: dict[str, str | bytes] = {renamed[file]: content for file, content in cell.files}
    spec = _with_files(json.loads(cell.text), renamed)
    if cell.kind is Kind.SYSTEM:
        for mode, said in spec["system"].items():
            if isinstance(said, dict) and isinstance(said.get("spec"), dict):
                found[f"{BEST}_{mode}.yaml"] = _yaml(said["spec"])
                said["spec"] = f"{BEST}_{mode}.yaml"
    return {BEST_YAML: _yaml(spec), **found}


def _with_files(value: Any, renamed: Mapping[str, str], key: str = "") -> Any:
    if isinstance(value, dict):
        return {name: _with_files(inner, renamed, name) for name, inner in value.items()}
    if isinstance(value, list):
        return [_with_files(inner, renamed, key) for inner in value]
    return renamed.get(value, value) if key in _FILE_KEYS and isinstance(value, str) else value


def _yaml(spec: Mapping[str, Any]) -> str:
    """A spec in YAML, a section or an entry of a list on each line."""
    lines: list[str] = []
    for key, value in spec.items():
        if isinstance(value, list) and value and isinstance(value[0], dict):
            lines += [f"{key}:", *(f"  - {_inline(each)}" for each in value)]
        else:
            lines.append(f"{key}: {_inline(value)}")
    return "\n".join([*lines, ""])


def _inline(value: Any) -> str:
    return json.dumps(value, ensure_ascii=False)


def _json(value: Any) -> str:
    return json.dumps(value, indent=2, ensure_ascii=False) + "\n"
