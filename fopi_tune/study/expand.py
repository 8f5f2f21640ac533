"""StudyFile and the trees of its specs -> cells, each checked as a spec before anything runs."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import replace

from fopi_tune.errors import Problem, SpecError
from fopi_tune.spec.model import SystemSpec, ValidationSpec
from fopi_tune.spec.yaml.hints import unknown_word_message
from fopi_tune.study.cells.axes import CHECK
from fopi_tune.study.cells.bases import BaseSpec
from fopi_tune.study.cells.checks import CellChecker, CellProblems
from fopi_tune.study.cells.draws import drawn_overrides
from fopi_tune.study.language import StudyFile
from fopi_tune.study.model import Cell, Column, Kind, Stage, Starts, Study
from fopi_tune.study.overrides import Override, plain_value
from fopi_tune.study.table import known_columns
from fopi_tune.study.words import ALL, PlacedWord

#: columns that are collected by default
_DEFAULT_COLUMNS = {
    Stage.TUNE: ("tune.gains.kp", "tune.gains.ki", "tune.gains.alpha", "tune.objective"),
    Stage.PROVE: ("prove.status",),
    Stage.DISCRETIZE: ("discretize.status", "discretize.nominal.phase_margin_deg"),
    Stage.SIMULATE: ("simulate.status",),
    Stage.VALIDATE: ("validate.status", "validate.stable.met", "validate.stable.total"),
}


def count_cells(study: StudyFile, claims: Collection[str] = (), figures: Collection[str] = ()) -> int:
    """The number of cells, without making them."""
    grid = math.prod(len(axis.nodes) for axis in study.grid)
    zipped = len(study.zipped[0].nodes) if study.zipped else 1
    entries = len(_chosen_names(study.claims, claims)) + len(_chosen_names(study.figures, figures))
    drawn = 1 if study.sample is None else study.sample.count
    return len(study.specs) * len(study.cells) * grid * zipped * drawn + entries


def expand(
    study: StudyFile,
    bases: Sequence[BaseSpec],
    registry: str = "",
    claims: Collection[str] = (),
    figures: Collection[str] = (),
) -> Study:
    """Make and check every cell.

    Args:
        study: the file.
        bases: the specs it names, in order.
        registry: module that has the claims and figures.
        claims: names of all claims.
        figures: names of all figures.

    Raises:
        SpecError: overrides that do not fit, or make a spec that cannot be used; every such cell is named.
    """
    problems = CellProblems(study.file)
    cells: list[Cell] = []
    _refuse_systems_from_a_base(study, bases)
    for base in bases:
        start = base.start_text() if study.starts is Starts.BASE else ""
        for overrides in _combinations(study):
            cells.append(_make_cell(study, base, start, overrides, len(cells), problems))
    for kind, wanted, known in ((Kind.CLAIM, study.claims, claims), (Kind.FIGURE, study.figures, figures)):
        _refuse_unknown(study, kind, wanted, known)
        cells += [Cell(len(cells) + i, kind, name, {}, registry) for i, name in enumerate(_chosen_names(wanted, known))]
    if problems.found:
        raise problems.error()
    made = Study(study.name, tuple(cells), _collected(study, bases), study.description)
    columns = known_columns(made)
    best = None if study.best is None else study.best.checked(study.file, columns)
    report = made.report if study.report is None else study.report.checked(study.file, columns)
    return replace(made, best=best, report=report)


def _refuse_systems_from_a_base(study: StudyFile, bases: Sequence[BaseSpec]) -> None:
    if study.starts is not Starts.BASE:
        return
    message = "is a system, whose design does not start from another one's gains; leave starts: base out"
    systems = [w for w, base in zip(study.specs, bases, strict=True) if base.kind is Kind.SYSTEM]
    if systems:
        raise SpecError(tuple(Problem(study.file, e.mark.line, e.mark.column, e.path, message) for e in systems))


def _combinations(study: StudyFile) -> Iterator[tuple[Override, ...]]:
    """The product of explicit cells, zipped values, drawn ones and the grid, whose last path changes fastest."""
    steps = range(len(study.zipped[0].nodes)) if study.zipped else range(1)
    grid = [range(len(axis.nodes)) for axis in study.grid]
    points = drawn_overrides(study.drawn, study.sample)
    for axes, step, point, places in itertools.product(study.cells, steps, points, itertools.product(*grid)):
        explicit = (axis.override(0) for axis in axes)
        in_step = (axis.override(step) for axis in study.zipped)
        crossed = (axis.override(place) for axis, place in zip(study.grid, places, strict=True))
        yield (*explicit, *in_step, *point, *crossed)


def _make_cell(
    study: StudyFile, base: BaseSpec, start: str, overrides: tuple[Override, ...], index: int, problems: CellProblems
) -> Cell:
    shown = {each.path: plain_value(each.node) for each in overrides}
    cell = Cell(index, base.kind, base.name, shown, "", base=start, stages=study.stages)
    design = [each for each in overrides if not each.path.startswith(CHECK)]
    check = [Override(e.path[len(CHECK) :], e.mark, e.node) for e in overrides if e.path.startswith(CHECK)]
    checker = CellChecker(base, problems, cell)
    # in this order, so that an override applies to the result of the ones before it
    made = checker.with_overrides(base.tree, design)
    if made.spec is None:
        return cell
    checked = checker.with_overrides(made.tree, check, made.tree, design) if check else made
    # numbers in place of expressions, in the order of the file
    values = {each.path: plain_value(each.node) for each in made.overrides}
    values |= {f"{CHECK}{each.path}": plain_value(each.node) for each in (checked.overrides if check else ())}
    cell = replace(cell, overrides={path: values[path] for path in shown})
    if checked.spec is None or not checker.can_run(study.stages, overrides, made.spec, checked.spec):
        return cell
    text = base.text(made.tree, made.spec)
    divided = base.kind is Kind.SPEC and Stage.VALIDATE in study.stages
    return replace(
        cell,
        text=text,
        check=base.text(checked.tree, checked.spec) if check else "",
        files=base.files_of(made.spec, checked.spec),
        draws=(checked.spec.validation or ValidationSpec()).samples if divided else 0,
    )


def _chosen_names(wanted: Sequence[PlacedWord], known: Collection[str]) -> list[str]:
    if [each.word for each in wanted] == [ALL]:
        return list(known)
    return [each.word for each in wanted]


def _refuse_unknown(study: StudyFile, kind: Kind, wanted: Sequence[PlacedWord], known: Collection[str]) -> None:
    unknown = [each for each in wanted if each.word not in known and [w.word for w in wanted] != [ALL]]
    told: Callable[[str], str] = lambda word: (  # noqa: E731
        unknown_word_message(word, known) if known else f"this version of fopi-tune has no {kind}s"
    )
    if unknown:
        problems = (Problem(study.file, e.mark.line, e.mark.column, e.path, told(e.word)) for e in unknown)
        raise SpecError(tuple(problems))


def _collected(study: StudyFile, bases: Sequence[BaseSpec]) -> tuple[Column, ...]:
    """The columns of the file, or those that are collected where it has none."""
    if study.collect or not study.specs:
        return study.collect
    defaults = [_DEFAULT_COLUMNS] if any(base.kind is Kind.SPEC for base in bases) else []
    defaults += [_system_columns(base) for base in bases if base.kind is Kind.SYSTEM]
    paths = list(dict.fromkeys(path for stage in study.stages for each in defaults for path in each[stage]))
    # kp instead of tune.gains.kp, where the last word is unique
    short = {path: path.rpartition(".")[2] for path in paths}
    twice = [name for name in short.values() if list(short.values()).count(name) > 1]
    return tuple(Column(path if short[path] in twice else short[path], path) for path in paths)


def _system_columns(base: BaseSpec) -> dict[Stage, tuple[str, ...]]:
    """The columns of a system, with the gains of the modes that are tuned."""
    system, _ = base.read_tree(base.tree)
    gains: list[str] = []
    if isinstance(system, SystemSpec):
        boxes = {mode.name: mode.spec.controller for mode in system.modes}
        gains = [f"tune.gains.{mode}.{name}" for mode in system.tuned for name in boxes[mode].ranges]
    found = {stage: (f"{stage}.status",) for stage in Stage}
    return {**found, Stage.TUNE: (*gains, "tune.objective")}
