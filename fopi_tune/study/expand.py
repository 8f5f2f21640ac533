"""StudyFile and the trees of its specs -> cells, each checked as a spec before anything runs."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass, field, replace

from fopi_tune.core.measured.family import MeasuredFamily
from fopi_tune.errors import Problem, SpecError
from fopi_tune.spec.model import DesignSpec, ValidationSpec
from fopi_tune.spec.validation import FileReader
from fopi_tune.spec.yaml.hints import UNKNOWN_KEY, closest, unknown_word_message
from fopi_tune.spec.yaml.nodes import MappingNode, Node, ScalarNode, SequenceNode
from fopi_tune.spec.yaml.problems import Mark, ProblemCollector
from fopi_tune.study.axes import CHECK
from fopi_tune.study.language import ALL, PlacedWord, StudyFile
from fopi_tune.study.model import Cell, Column, Kind, Stage, Starts, Study
from fopi_tune.study.overrides import (
    NoSuchPathError,
    Override,
    apply_override,
    canonical_text,
    parse_path,
    plain_value,
    spec_from_tree,
)

#: cells that a message names
_MAX_NAMED_CELLS = 12

#: columns that are collected by default
_DEFAULT_COLUMNS = {
    Stage.TUNE: ("tune.gains.kp", "tune.gains.ki", "tune.gains.alpha", "tune.objective"),
    Stage.PROVE: ("prove.status",),
    Stage.DISCRETIZE: ("discretize.status", "discretize.nominal.phase_margin_deg"),
    Stage.VALIDATE: ("validate.status", "validate.stable.met", "validate.stable.total"),
}


@dataclass(frozen=True)
class BaseSpec:
    """A spec that cells are made from: its file, its tree, and a reader of the files that it names."""

    file: str
    tree: Node
    read: FileReader


@dataclass
class _CellProblems:
    """The problems of all cells; the same problem of many cells is reported once, with their numbers."""

    study: StudyFile
    found: dict[tuple[str, Mark, str, str], list[Cell]] = field(default_factory=dict)

    def add(self, file: str, mark: Mark, path: str, message: str, cell: Cell) -> None:
        cells = self.found.setdefault((file, mark, path, message), [])
        if not cells or cells[-1].index != cell.index:
            cells.append(cell)

    def error(self) -> SpecError:
        problems = []
        for (file, mark, path, message), cells in self.found.items():
            told = f"{_cells_in_words(cells)}: {message}" if file == self.study.file else message
            problems.append(Problem(file, mark.line, mark.column, path, told))
        return SpecError(tuple(sorted(problems, key=lambda p: (p.file, p.line, p.column))))


def count_cells(study: StudyFile, claims: Collection[str] = (), figures: Collection[str] = ()) -> int:
    """The number of cells, without making them."""
    grid = math.prod(len(axis.nodes) for axis in study.grid)
    zipped = len(study.zipped[0].nodes) if study.zipped else 1
    entries = len(_chosen_names(study.claims, claims)) + len(_chosen_names(study.figures, figures))
    return len(study.specs) * len(study.cells) * grid * zipped + entries


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
    problems = _CellProblems(study)
    cells: list[Cell] = []
    for base in bases:
        start = _base_text(base) if study.starts is Starts.BASE else ""
        for overrides in _combinations(study):
            cells.append(_make_cell(study, base, start, overrides, len(cells), problems))
    for kind, wanted, known in ((Kind.CLAIM, study.claims, claims), (Kind.FIGURE, study.figures, figures)):
        _refuse_unknown(study, kind, wanted, known)
        cells += [Cell(len(cells) + i, kind, name, {}, registry) for i, name in enumerate(_chosen_names(wanted, known))]
    if problems.found:
        raise problems.error()
    return Study(study.name, tuple(cells), _collected(study), study.description)


def _combinations(study: StudyFile) -> Iterator[tuple[Override, ...]]:
    """The product of explicit cells, zipped values and the grid; the last path of the grid changes fastest."""
    steps = range(len(study.zipped[0].nodes)) if study.zipped else range(1)
    grid = [range(len(axis.nodes)) for axis in study.grid]
    for axes, step, places in itertools.product(study.cells, steps, itertools.product(*grid)):
        explicit = (axis.override(0) for axis in axes)
        in_step = (axis.override(step) for axis in study.zipped)
        crossed = (axis.override(place) for axis, place in zip(study.grid, places, strict=True))
        yield (*explicit, *in_step, *crossed)


def _make_cell(
    study: StudyFile, base: BaseSpec, start: str, overrides: tuple[Override, ...], index: int, problems: _CellProblems
) -> Cell:
    shown = {each.path: plain_value(each.node) for each in overrides}
    cell = Cell(index, Kind.SPEC, _name_of_spec(base.tree), shown, "", base=start, stages=study.stages)
    design = [each for each in overrides if not each.path.startswith(CHECK)]
    check = [Override(e.path[len(CHECK) :], e.mark, e.node) for e in overrides if e.path.startswith(CHECK)]
    checker = _CellChecker(base, problems, cell)
    # in this order, so that an override applies to the result of the ones before it
    tree, spec = checker.with_overrides(base.tree, design)
    checked, checked_spec = checker.with_overrides(tree, check, design) if check and spec is not None else (tree, spec)
    if spec is None or checked_spec is None or not checker.can_run(study.stages, overrides, spec, checked_spec):
        return cell
    text, check_text = canonical_text(tree), canonical_text(checked) if check else ""
    files = _files((spec, checked_spec), base.read)
    draws = (checked_spec.validation or ValidationSpec()).samples if Stage.VALIDATE in study.stages else 0
    return Cell(index, Kind.SPEC, cell.name, shown, text, check_text, start, study.stages, files, draws)


def _files(specs: Sequence[DesignSpec], read: FileReader) -> tuple[tuple[str, bytes], ...]:
    """Names and contents of the files that specs name."""
    listed = (spec.validation.samples_file for spec in specs if spec.validation is not None)
    measured = (spec.plant.source_files for spec in specs if isinstance(spec.plant, MeasuredFamily))
    names = sorted({each.name for each in listed if each is not None}.union(*measured))
    return tuple((name, read(name)) for name in names)


@dataclass(frozen=True)
class _CellChecker:
    """Checks one cell.  A problem is reported in the study file if an override causes it, else in the base's file."""

    base: BaseSpec
    problems: _CellProblems
    cell: Cell

    def with_overrides(
        self, tree: Node, overrides: Sequence[Override], before: Sequence[Override] = ()
    ) -> tuple[Node, DesignSpec | None]:
        """The tree with the overrides and its spec, or None after reporting problems."""
        for override in overrides:
            try:
                tree = apply_override(tree, override)
            except NoSuchPathError as error:
                self._report_override(override, str(error))
                return tree, None
        collector = ProblemCollector(self.base.file)
        spec = spec_from_tree(tree, collector, self.base.read)
        for problem in collector.problems:
            self._report(problem, [*overrides, *before])
        return tree, spec

    def can_run(
        self, stages: Sequence[Stage], overrides: Sequence[Override], spec: DesignSpec, checked: DesignSpec
    ) -> bool:
        """Whether the stages can be run on the spec; reports if not."""
        section = "controller"
        if Stage.TUNE not in stages and spec.controller.fixed is None:
            names = spec.controller.names
            message = f"there is no stage tune, and the spec does not fix {names}; add the stage or fix them"
        elif checked.digital is None and {Stage.DISCRETIZE, Stage.VALIDATE} & set(stages):
            section = "digital"
            message = "discretize and validate need a section digital; add digital: {sample_time_s: 0.2} to the spec"
        else:
            return True
        blamed = [e for e in overrides if _within(e.path, section)]
        if blamed:
            self._report_override(blamed[0], message)
        else:
            self.problems.add(self.base.file, Mark(1, 1), "", message, self.cell)
        return False

    def _report(self, problem: Problem, overrides: Sequence[Override]) -> None:
        inside = [e for e in overrides if _within(problem.path, e.path)]
        words = f"{problem.path}: {self._with_suggestion(problem)}" if problem.path else problem.message
        if inside:
            # the position is in the study file, inside the override's value
            self._report_override(inside[0], words, Mark(problem.line, problem.column))
        elif not overrides or self._also_without_overrides(problem):
            place = Mark(problem.line, problem.column)
            self.problems.add(self.base.file, place, problem.path, problem.message, self.cell)
        else:
            self._report_override(max(overrides, key=lambda e: _common_steps(e.path, problem.path)), words)

    def _with_suggestion(self, problem: Problem) -> str:
        """The message; for an unknown key, with the key of the base spec that it may misspell."""
        *outer, last = parse_path(problem.path) or ("",)
        if not problem.message.startswith(UNKNOWN_KEY) or "did you mean" in problem.message:
            return problem.message
        where: Node = self.base.tree
        for step in outer:
            if isinstance(where, MappingNode) and step in where.entries:
                where = where.entries[str(step)][1]
            elif isinstance(where, SequenceNode) and isinstance(step, int) and step < len(where.nodes):
                where = where.nodes[step]
            else:
                return problem.message
        meant = closest(str(last), where.entries) if isinstance(where, MappingNode) else None
        return f"{UNKNOWN_KEY}; did you mean {meant!r}?" if meant else problem.message

    def _also_without_overrides(self, problem: Problem) -> bool:
        collector = ProblemCollector(self.base.file)
        spec_from_tree(self.base.tree, collector, self.base.read)
        return problem in collector.problems

    def _report_override(self, override: Override, message: str, mark: Mark | None = None) -> None:
        self.problems.add(self.problems.study.file, mark or override.mark, override.path, message, self.cell)


def _within(path: str, outer: str) -> bool:
    """Whether a path equals another one or lies inside it."""
    return path == outer or path.startswith((f"{outer}.", f"{outer}["))


def _common_steps(one: str, other: str) -> int:
    """Number of leading steps that two paths share."""
    pairs = zip(parse_path(one) or (), parse_path(other) or (), strict=False)
    return len(list(itertools.takewhile(lambda pair: pair[0] == pair[1], pairs)))


def _cells_in_words(cells: Sequence[Cell]) -> str:
    if len(cells) == 1:
        return f"cell {cells[0].index + 1} ({cells[0].label})"
    named = ", ".join(str(cell.index + 1) for cell in cells[:_MAX_NAMED_CELLS])
    rest = len(cells) - _MAX_NAMED_CELLS
    return f"cells {named}" + (f" and {rest} more" if rest > 0 else "")


def _name_of_spec(tree: Node) -> str:
    """The spec's name, or "?" without one."""
    name = tree.entries["name"][1] if isinstance(tree, MappingNode) and "name" in tree.entries else None
    return name.text if isinstance(name, ScalarNode) else "?"


def _base_text(base: BaseSpec) -> str:
    """The base's text without `validation`, on which its gains do not depend; empty for an invalid base."""
    if spec_from_tree(base.tree, ProblemCollector(""), base.read) is None or not isinstance(base.tree, MappingNode):
        return ""
    entries = {key: entry for key, entry in base.tree.entries.items() if key != "validation"}
    return canonical_text(replace(base.tree, entries=entries))


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


def _collected(study: StudyFile) -> tuple[Column, ...]:
    if study.collect or not study.specs:
        return study.collect
    # kp instead of tune.gains.kp, where the last word is unique
    paths = [path for stage in study.stages for path in _DEFAULT_COLUMNS[stage]]
    short = {path: path.rpartition(".")[2] for path in paths}
    twice = [name for name in short.values() if list(short.values()).count(name) > 1]
    return tuple(Column(path if short[path] in twice else short[path], path) for path in paths)
