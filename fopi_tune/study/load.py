"""A study file and its spec files -> Study; the language of studies as JSON Schema."""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from typing import Any

from fopi_tune.errors import DomainError, Problem, SpecError
from fopi_tune.spec import load_document
from fopi_tune.spec.language import SCHEMA_VERSION
from fopi_tune.spec.load import folder_reader
from fopi_tune.spec.yaml.nodes import Place
from fopi_tune.study.cells.bases import BaseSpec
from fopi_tune.study.cells.systems import DocumentLoader, ModeSpecError
from fopi_tune.study.expand import count_cells, expand
from fopi_tune.study.language import StudyFile, read_study, study_shape
from fopi_tune.study.model import Study
from fopi_tune.study.registry import REGISTRY, entry_names


class TooManyCellsError(DomainError):
    """More cells than the study's limit; nothing was made."""


def load_study(
    source: str | os.PathLike[str],
    force: bool = False,
    registry: str = REGISTRY,
    told: Callable[[int], None] | None = None,
) -> Study:
    """The study in a file, with all its cells made and checked.

    Args:
        source: path of a YAML file.
        force: make more cells than the study's limit.
        registry: module that has CLAIMS and FIGURES.
        told: called with the number of cells before they are made.

    Raises:
        SpecError: the file or one of its specs cannot be used, or an override makes a spec that cannot.
        TooManyCellsError: there are more cells than `limit_cells`.
    """
    place, _ = load_document(source)
    study = read_study(place)
    if study is None:
        raise place.collector.error()
    claims = entry_names(registry, "CLAIMS") if study.claims else ()
    figures = entry_names(registry, "FIGURES") if study.figures else ()
    count = count_cells(study, claims, figures)
    if told is not None:
        told(count)
    if count > study.limit_cells and not force:
        raise TooManyCellsError(
            f"{os.fsdecode(source)}: {count} cells are more than {study.limit_cells}; run them with --force, raise "
            "limit_cells, or give fewer values"
        )
    return expand(study, _bases(study), registry, claims, figures)


def _bases(study: StudyFile) -> list[BaseSpec]:
    folder = os.path.dirname(study.file)
    found: list[BaseSpec] = []
    problems: list[Problem] = []
    for placed in study.specs:
        path = os.path.join(folder, placed.word)
        try:
            place, _ = load_document(path)
        except SpecError as error:
            # the position in the study file, with the problem in the spec file
            where = Problem(study.file, placed.mark.line, placed.mark.column, placed.path, "the spec cannot be used:")
            problems += [replace(where, message=f"{where.message} {problem}") for problem in error.problems]
            continue
        problems += place.collector.problems
        try:
            # cells that name the same file read it once
            found.append(BaseSpec.of(path, place.node, cache(folder_reader(path)), _documents_beside(path)))
        except ModeSpecError as error:
            problems.append(Problem(path, error.mark.line, error.mark.column, error.path, error.message))
    if problems:
        raise SpecError(tuple(problems))
    return found


def _documents_beside(path: str) -> DocumentLoader:
    """Reads documents by their paths from a file's folder, each once."""

    @cache
    def load(name: str) -> Place:
        place, _ = load_document(os.path.join(os.path.dirname(path), name))
        if place.collector.problems:
            raise place.collector.error()
        return place

    return load


def study_json_schema() -> dict[str, Any]:
    """The language as JSON Schema, draft 2020-12, generated from the shapes that read a study.

    Overridden specs are not covered by the schema; only the tool checks them.
    """
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": f"fopi-tune study, schema {SCHEMA_VERSION}",
    } | study_shape().json_schema()
