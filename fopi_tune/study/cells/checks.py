"""The check of each cell:  overrides that do not fit, and specs that cannot be used or run, each with its place."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, field

from fopi_tune.errors import Problem, SpecError
from fopi_tune.spec.model import DesignSpec, SystemSpec
from fopi_tune.spec.yaml.hints import UNKNOWN_KEY, closest
from fopi_tune.spec.yaml.nodes import MappingNode, Node, ScalarNode, SequenceNode
from fopi_tune.spec.yaml.problems import Mark
from fopi_tune.spec.yaml.scalars import NOT_WHOLE
from fopi_tune.study.cells.axes import MadeNumber
from fopi_tune.study.cells.bases import BaseSpec, Spec
from fopi_tune.study.cells.expressions import node_at, with_values
from fopi_tune.study.cells.systems import IN_MODE_SPEC, UNREAD, ModeSpecError
from fopi_tune.study.model import Cell, Stage
from fopi_tune.study.overrides import NoSuchPathError, Override, apply_override, parse_path

#: cells that a message names
_MAX_NAMED_CELLS = 12
#: messages about one override; the cells of further ones are named together
_MAX_ALIKE = 12


@dataclass
class CellProblems:
    """The problems of all cells; the same problem of many cells is reported once, with their numbers."""

    file: str
    found: dict[tuple[str, Mark, str, str], list[Cell]] = field(default_factory=dict)

    def add(self, file: str, mark: Mark, path: str, message: str, cell: Cell) -> None:
        """Add a problem of one cell."""
        cells = self.found.setdefault((file, mark, path, message), [])
        if not cells or cells[-1].index != cell.index:
            cells.append(cell)

    def error(self) -> SpecError:
        """All problems, sorted by position."""
        problems: list[Problem] = []
        alike: dict[tuple[str, Mark, str], list[list[Cell]]] = {}
        for (file, mark, path, message), cells in self.found.items():
            others = alike.setdefault((file, mark, path), [])
            others.append(cells)
            if len(others) <= _MAX_ALIKE:
                told = f"{_cells_in_words(cells)}: {message}" if file == self.file else message
                problems.append(Problem(file, mark.line, mark.column, path, told))
        for (file, mark, path), groups in alike.items():
            rest = [cell for cells in groups[_MAX_ALIKE:] for cell in cells]
            if rest:
                told = f"{_cells_in_words(rest)}: refused with other values in the same way"
                problems.append(Problem(file, mark.line, mark.column, path, told))
        return SpecError(tuple(sorted(problems, key=lambda p: (p.file, p.line, p.column))))


@dataclass(frozen=True)
class CheckedCell:
    """A tree with overrides.

    Args:
        tree: with them.
        spec: what it says; None where problems were reported.
        overrides: with numbers in place of expressions.
    """

    tree: Node
    spec: Spec | None
    overrides: Sequence[Override]


@dataclass(frozen=True)
class CellChecker:
    """Checks one cell.  A problem is reported in the study file if an override causes it, else in the base's file."""

    base: BaseSpec
    problems: CellProblems
    cell: Cell

    def with_overrides(
        self, tree: Node, overrides: Sequence[Override], design: Node | None = None, before: Sequence[Override] = ()
    ) -> CheckedCell:
        """The tree with the overrides and what it says, or None after reporting problems.

        Args:
            tree: of the base, or of the design.
            overrides: put in one after the other; then expressions among them are computed.
            design: the tree of the design, for expressions of a check.
            before: overrides that `tree` has already.
        """
        for override in overrides:
            try:
                _refuse_unread(override)
                tree = self.base.with_specs(apply_override(tree, override))
            except NoSuchPathError as error:
                self.report_override(override, str(error))
                return CheckedCell(tree, None, overrides)
            except ModeSpecError as error:
                self.report_override(override, error.message)
                return CheckedCell(tree, None, overrides)
        tree, overrides, wrong = with_values(tree, overrides, design)
        for problem in wrong:
            blamed = next(each for each in overrides if _within(problem.path, each.path))
            self.report_override(blamed, problem.message, problem.mark)
        if wrong:
            return CheckedCell(tree, None, overrides)
        spec, found = self.base.read_tree(tree)
        for problem in found:
            self._report(problem, [*overrides, *before])
        return CheckedCell(tree, spec, overrides)

    def can_run(self, stages: Sequence[Stage], overrides: Sequence[Override], spec: Spec, checked: Spec) -> bool:
        """Whether the stages can be run on the spec or system; reports if not."""
        section, message = _unfit_for_stages(stages, spec, checked)
        if not message:
            return True
        blamed = [e for e in overrides if _within(e.path, section)]
        if blamed:
            self.report_override(blamed[0], message)
        else:
            self.problems.add(self.base.file, Mark(1, 1), "", message, self.cell)
        return False

    def _report(self, problem: Problem, overrides: Sequence[Override]) -> None:
        inside = [e for e in overrides if _within(problem.path, e.path)]
        words = f"{problem.path}: {self._with_suggestion(problem)}" if problem.path else problem.message
        if inside:
            # the position is in the study file, inside the override's value, unless this names a file
            whole = isinstance(inside[0].node, ScalarNode) and inside[0].path != problem.path
            words = _told_of_made(inside[0], problem) or words
            mark = inside[0].node.mark if whole else Mark(problem.line, problem.column)
            self.report_override(inside[0], words, mark)
        elif not overrides or problem in self.base.read_tree(self.base.tree)[1]:
            own = self.base.in_its_file(problem)
            self.problems.add(own.file, Mark(own.line, own.column), own.path, own.message, self.cell)
        else:
            self.report_override(max(overrides, key=lambda e: _common_steps(e.path, problem.path)), words)

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

    def report_override(self, override: Override, message: str, mark: Mark | None = None) -> None:
        """Report a problem that an override causes."""
        self.problems.add(self.problems.file, mark or override.mark, override.path, message, self.cell)


def _told_of_made(override: Override, problem: Problem) -> str:
    """Of a number that the study makes and that is not whole, what makes it and what to write; empty for others."""
    inner = (parse_path(problem.path) or ())[len(parse_path(override.path) or ()) :]
    node = node_at(override.node, inner)
    if NOT_WHOLE not in problem.message or not isinstance(node, MadeNumber):
        return ""
    return f"{problem.path}: {node.text} {NOT_WHOLE}, which is needed here; it is {node.if_whole}"


def _refuse_unread(override: Override) -> None:
    inside = IN_MODE_SPEC.fullmatch(override.path)
    section = (inside.group(2) or "").split(".")[0] if inside else ""
    if section in UNREAD:
        raise NoSuchPathError(f"a system does not read the {section} of a mode's spec; give values to {section} itself")


def _unfit_for_stages(stages: Sequence[Stage], spec: Spec, checked: Spec) -> tuple[str, str]:
    """The section that is not fit for the stages, and why; an empty reason where all of them can be run."""
    if isinstance(spec, SystemSpec):
        if Stage.TUNE in stages and (not spec.tuned or spec.objective is None):
            untuned = [stage.value for stage in Stage if stage in stages and stage is not Stage.TUNE]
            others = ", ".join(untuned or [Stage.SIMULATE, Stage.VALIDATE, Stage.PROVE])
            return "tune", (
                "stage tune: the system does not say what to tune; add tune: and objective: to it, or write "
                f"stages: [{others}]"
            )
        return "", ""
    assert isinstance(checked, DesignSpec)
    if Stage.TUNE not in stages and spec.controller.fixed is None:
        names = spec.controller.names
        return "controller", f"there is no stage tune, and the spec does not fix {names}; add the stage or fix them"
    if checked.digital is None and {Stage.DISCRETIZE, Stage.VALIDATE} & set(stages):
        message = "discretize and validate need a section digital; add digital: {sample_time_s: 0.2} to the spec"
        return "digital", message
    if Stage.SIMULATE in stages and checked.is_measured:
        return "plant", "stage simulate: a measured response cannot be simulated; leave the stage out"
    return "", ""


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
