"""What cells are made from:  a spec or a system, as its file has it, and as it is with overrides."""

from __future__ import annotations

from dataclasses import dataclass, replace

from fopi_tune.core.measured.family import MeasuredFamily
from fopi_tune.errors import Problem
from fopi_tune.spec.model import DesignSpec, SystemSpec
from fopi_tune.spec.systems import SYSTEM
from fopi_tune.spec.validation import FileReader
from fopi_tune.spec.yaml.nodes import MappingNode, Node, Place, ScalarNode
from fopi_tune.spec.yaml.problems import ProblemCollector
from fopi_tune.study.cells.systems import (
    IN_MODE_SPEC,
    DocumentLoader,
    mode_files,
    refuse_written_specs,
    system_from_tree,
    system_text,
    with_mode_specs,
)
from fopi_tune.study.model import Kind
from fopi_tune.study.overrides import canonical_text, spec_from_tree

Spec = DesignSpec | SystemSpec


def _no_document(path: str) -> Place:
    raise AssertionError(f"a spec names no other one: {path}")


@dataclass(frozen=True)
class BaseSpec:
    """A spec or a system that cells are made from.

    Args:
        file: where it is.
        tree: its document; of a system, with its modes' specs in place of their paths.
        read: reads the files that it names.
        load: reads the documents of a system's specs, by the paths that a system file has.
        own: the document as its file has it.
    """

    file: str
    tree: Node
    read: FileReader
    load: DocumentLoader = _no_document
    own: Node | None = None

    @classmethod
    def of(cls, file: str, tree: Node, read: FileReader, load: DocumentLoader) -> BaseSpec:
        """The base of a file's document.

        Raises:
            ModeSpecError: a spec of a system cannot be read.
        """
        refuse_written_specs(tree)
        return cls(file, with_mode_specs(tree, load), read, load, tree)

    @property
    def kind(self) -> Kind:
        """A spec or a system."""
        return Kind.SYSTEM if isinstance(self.tree, MappingNode) and SYSTEM in self.tree.entries else Kind.SPEC

    @property
    def name(self) -> str:
        """Its name, or "?" without one."""
        found = (
            self.tree.entries["name"][1] if isinstance(self.tree, MappingNode) and "name" in self.tree.entries else 0
        )
        return found.text if isinstance(found, ScalarNode) else "?"

    def with_specs(self, tree: Node) -> Node:
        """A tree of a system with the specs that overrides name by their paths.

        Raises:
            ModeSpecError: a file cannot be read.
        """
        return with_mode_specs(tree, self.load) if self.kind is Kind.SYSTEM else tree

    def read_tree(self, tree: Node) -> tuple[Spec | None, list[Problem]]:
        """What a tree says, and what is wrong with it; problems of a mode's spec have paths from the system."""
        collector = ProblemCollector(self.file)
        reader = system_from_tree if self.kind is Kind.SYSTEM else spec_from_tree
        spec = reader(tree, collector, self.read)
        return spec, collector.problems

    def text(self, tree: Node, spec: Spec) -> str:
        """The canonical text of a tree that says `spec`."""
        return system_text(tree, spec) if isinstance(spec, SystemSpec) else canonical_text(tree)

    def in_its_file(self, problem: Problem) -> Problem:
        """A problem of the base itself, with the file in which its line is."""
        inside = IN_MODE_SPEC.fullmatch(problem.path)
        written = mode_files(self.own).get(inside.group(1)) if inside and inside.group(2) and self.own else None
        if inside is None or written is None:
            return problem
        return replace(problem, file=str(self.load(written).collector.file), path=inside.group(2))

    def start_text(self) -> str:
        """The text without `validation`, on which the gains do not depend; empty for a base that is no spec."""
        spec, _ = self.read_tree(self.tree)
        if spec is None or self.kind is not Kind.SPEC or not isinstance(self.tree, MappingNode):
            return ""
        entries = {key: entry for key, entry in self.tree.entries.items() if key != "validation"}
        return canonical_text(replace(self.tree, entries=entries))

    def files_of(self, *specs: Spec) -> tuple[tuple[str, bytes], ...]:
        """Names and contents of the files that specs name."""
        listed = (spec.validation.samples_file for spec in specs if spec.validation is not None)
        measured = (
            spec.plant.source_files
            for spec in specs
            if isinstance(spec, DesignSpec) and isinstance(spec.plant, MeasuredFamily)
        )
        names = sorted({each.name for each in listed if each is not None}.union(*measured))
        return tuple((name, self.read(name)) for name in names)
