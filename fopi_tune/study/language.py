"""The shape of a study file:  specs, overrides, the stages to run, and the columns to collect."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from fopi_tune.core.text_tables.words import counted
from fopi_tune.spec.language import NAME_PATTERN, NAME_RULE, SCHEMA_VERSION
from fopi_tune.spec.yaml.hints import closest
from fopi_tune.spec.yaml.nodes import Place
from fopi_tune.spec.yaml.records import Key, Record, Values, refuse_foreign
from fopi_tune.spec.yaml.shapes import Choice, ListOf, Number, PlainOrMapping, Text, Version
from fopi_tune.study.best import best_shape
from fopi_tune.study.cells.axes import CHECK, AnyValue, Axis, AxisValues, PathMapping
from fopi_tune.study.cells.draws import DrawValues, Sample, checked_sample, sample_shape, seed_shape
from fopi_tune.study.model import LIMIT_CELLS, BestRule, Column, ReportRule, Stage, Starts
from fopi_tune.study.overrides import PATH_PATTERN
from fopi_tune.study.page_words import report_shape
from fopi_tune.study.words import AllOrList, ColumnMapping, PlacedRule, PlacedWord, WithPlace

_EXAMPLE = "{schema: 1, name: grid, specs: [brake.yaml], grid: {controller.alpha: [1, 0.8]}}"
#: columns of every table
_COLUMNS = ("cell", "spec", "entry", "outcome", "reason")
_LARGEST_LIMIT = 10_000_000
#: sections of axes that are crossed with each other and with the cells
_CROSSED = ("grid", "zip", "draw")
#: overrides of a check that name gains, or their ranges
_GAINS_OF_CHECK = re.compile(rf"{CHECK}(controller|system\.\w+\.(gains|spec\.controller))\b")


@dataclass(frozen=True)
class StudyFile:
    """A study file as it is written; `fopi_tune.study.expand` makes its cells."""

    file: str
    name: str
    description: str
    specs: tuple[PlacedWord, ...]
    cells: tuple[tuple[Axis, ...], ...]
    grid: tuple[Axis, ...]
    zipped: tuple[Axis, ...]
    stages: tuple[Stage, ...]
    starts: Starts
    collect: tuple[Column, ...]
    limit_cells: int
    claims: tuple[PlacedWord, ...]
    figures: tuple[PlacedWord, ...]
    best: PlacedRule[BestRule] | None = None
    drawn: tuple[Axis, ...] = ()
    sample: Sample | None = None
    report: PlacedRule[ReportRule] | None = None


#: the default of `stages`
_STAGES = [Stage.TUNE.value, Stage.PROVE.value]


def study_shape() -> Record:
    """The shape of a whole file; reads to the sections' values."""
    path = Text("path from the study's folder")
    result = Text("path into a cell's result, such as tune.gains.kp", PATH_PATTERN, "write one such as tune.gains.kp")
    values = PathMapping("paths into the spec, each with its values", AxisValues("values"))
    entry = WithPlace(Text("name of an entry"))
    columns = PlainOrMapping(ListOf("paths", result), ColumnMapping("names of columns, each with its path", result))
    limit = Number("more cells than this need --force", at_least=1, at_most=_LARGEST_LIMIT, whole=True)
    keys = {
        "schema": Key(Version("version of the language", SCHEMA_VERSION)),
        "name": Key(Text("name of the study and of its results' folder", NAME_PATTERN, NAME_RULE)),
        "description": Key(Text("one sentence for people"), required=False),
        "specs": Key(ListOf("the specs and systems that the cells are made of", WithPlace(path), 1), required=False),
        "cells": Key(
            ListOf("overrides, path to value, a cell each", PathMapping("a cell", AnyValue("value")), 1), False
        ),
        "grid": Key(values, required=False),
        "zip": Key(values, required=False),
        "draw": Key(PathMapping("paths that are drawn together", DrawValues("values, each as likely")), False),
        "sample": Key(sample_shape(), required=False),
        "seed": Key(seed_shape(), required=False),
        "stages": Key(ListOf("what is run on each cell", Choice("stage", [s.value for s in Stage]), 1), False, _STAGES),
        "starts": Key(
            Choice("where the search of a cell's gains begins", [s.value for s in Starts]), False, Starts.ALL.value
        ),
        "collect": Key(columns, required=False),
        "best": Key(best_shape(), required=False),
        "report": Key(report_shape(), required=False),
        "limit_cells": Key(limit, False, LIMIT_CELLS),
        "claims": Key(AllOrList(ListOf("claims to recompute", entry, 1)), required=False),
        "figures": Key(AllOrList(ListOf("figures to draw", entry, 1)), required=False),
    }
    about = [{"required": [key]} for key in ("specs", "claims", "figures")]
    return Record("many specs", keys, lambda values, place: values, _EXAMPLE, rules={"anyOf": about})


def read_study(place: Place) -> StudyFile | None:
    """The study that a document describes, or None after reporting its problems."""
    shape = study_shape()
    if refuse_foreign(place, shape.keys, f"the file is no study; write one such as {_EXAMPLE}"):
        return None
    values = shape.read_partial(place)
    if values is None:
        return None
    _check_between_sections(values, place)
    if place.collector.problems:
        return None
    return StudyFile(
        file=place.collector.file,
        name=values["name"],
        description=values.get("description", ""),
        specs=tuple(values.get("specs", ())),
        cells=tuple(values.get("cells", ((),))),
        grid=values.get("grid", ()),
        zipped=values.get("zip", ()),
        stages=_stages(values),
        starts=Starts(values.get("starts", Starts.ALL)),
        collect=_columns(values),
        limit_cells=values.get("limit_cells", LIMIT_CELLS),
        claims=tuple(values.get("claims", ())),
        figures=tuple(values.get("figures", ())),
        best=values.get("best"),
        drawn=values.get("draw", ()),
        sample=checked_sample(values, place),
        report=values.get("report"),
    )


def _stages(values: Values) -> tuple[Stage, ...]:
    wanted = values.get("stages", _STAGES)
    return tuple(stage for stage in Stage if stage in wanted)


def _columns(values: Values) -> tuple[Column, ...]:
    given = values.get("collect", [])
    pairs = given.items() if isinstance(given, Mapping) else ((path, path) for path in given)
    return tuple(Column(name, path) for name, path in pairs)


def _check_between_sections(values: Values, place: Place) -> None:
    if not any(place.has(key) for key in ("specs", "claims", "figures")):
        place.refuse("there is nothing to study; add specs: [FILE], with the paths of specs from this file's folder")
    for key in ("cells", "grid", "zip", "draw", "sample", "seed", "stages", "starts", "collect", "best", "report"):
        if place.has(key) and not place.has("specs") and any(place.has(k) for k in ("claims", "figures")):
            place.child(key).refuse("this is about specs, and there are none; add specs: [FILE] or remove it")
    checked_sample(values, place)
    _refuse_duplicate_paths(values, place)
    _refuse_overrides_without_effect(values, place)
    _refuse_duplicate_columns(values, place)
    zipped: list[Axis] = list(values.get("zip") or ())
    for first, axis in ((zipped[0], other) for other in zipped[1:]):
        if len(axis.nodes) != len(first.nodes):
            message = f"has {counted(len(axis.nodes), 'value')} and {first.path} {len(first.nodes)}; they go in step"
            place.child("zip").child(axis.path).refuse(message)
    stages = _stages(values) if values.get("stages", []) is not None else ()
    for name, path in _collected(values, place):
        first = path.word.split(".")[0]
        if stages and first not in (*stages, "outcome", "reason"):
            meant = closest(first, [str(stage) for stage in stages])
            hint = f"did you mean {meant!r}?" if meant else f"the stages of this study are {', '.join(stages)}"
            place.collector.add(path.mark, name, f"{path.word} begins with no stage that is run; {hint}")


def _refuse_duplicate_paths(values: Values, place: Place) -> None:
    """Reports paths that have values in two sections."""
    sections: list[tuple[Place, tuple[Axis, ...]]] = [
        (place.child(key), values.get(key) or ()) for key in _CROSSED
    ]  # fmt: skip
    if values.get("cells"):
        cells = place.child("cells")
        sections += [(cells.item(i), axes or ()) for i, axes in enumerate(values["cells"])]
    for i, (where, axes) in enumerate(sections):
        others = {axis.path: axis.mark.line for _, other in sections[: min(i, len(_CROSSED))] for axis in other}
        for axis in axes:
            if axis.path in others:
                message = f"the path has values on line {others[axis.path]} already; keep one of the two"
                where.collector.add(axis.mark, where.child(axis.path).path, message)


def _refuse_overrides_without_effect(values: Values, place: Place) -> None:
    """Reports overrides without effect, which the table would show: replaced by a later one, or gains of the check."""
    after = [(place.child(key), axis) for key in ("zip", "draw", "grid") for axis in values.get(key) or ()]
    given: list[tuple[Axis, ...]] = values.get("cells") or []
    cells = [[(place.child("cells").item(i), axis) for axis in axes or ()] for i, axes in enumerate(given)]
    for own, rest in [*((cell, after) for cell in cells), (after, [])]:
        ordered = [*own, *rest]
        for n, (where, axis) in enumerate(own):
            outer = next((o for _, o in ordered[n + 1 :] if axis.path.startswith((f"{o.path}.", f"{o.path}["))), None)
            if outer is not None:
                message = f"{outer.path}, which is put in later, replaces this; put it before, or into its value"
                where.collector.add(axis.mark, where.child(axis.path).path, message)
            if gains := _GAINS_OF_CHECK.match(axis.path):
                itself = gains.group(1)
                message = f"the gains that are checked are those of the design; give values to {itself} itself"
                where.collector.add(axis.mark, where.child(axis.path).path, message)


def _refuse_duplicate_columns(values: Values, place: Place) -> None:
    """Reports columns whose name is used already."""
    groups = [*(values.get(key) for key in _CROSSED), *(values.get("cells") or ())]
    marked = ("best",) if place.has("best") else ()
    used_names = {*_COLUMNS, *marked, *(axis.path for axes in groups for axis in axes or ())}
    given, where = values.get("collect"), place.child("collect")
    if given is None:
        return
    names = list(given)
    for index, name in enumerate(names):
        at = where.child(name) if isinstance(given, Mapping) else where.item(index)
        if name in used_names:
            at.refuse(f"every table of this study has a column {name} already; remove this, or give it another name")
        elif name in names[:index]:
            at.refuse("is collected already; remove one of the two")


def _collected(values: Values, place: Place) -> list[tuple[str, PlacedWord]]:
    given, where = values.get("collect"), place.child("collect")
    if given is None:
        return []
    if isinstance(given, Mapping):
        places: list[tuple[Place, Any]] = [(where.child(name), path) for name, path in given.items()]
    else:
        places = [(where.item(index), path) for index, path in enumerate(given)]
    return [(place.path, PlacedWord(path, place.mark, place.path)) for place, path in places]
