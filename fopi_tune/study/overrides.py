"""Overrides of a spec's tree of nodes:  values put in at paths, and the canonical text that is sent to workers.

The text is JSON, which every YAML 1.2 reader accepts: keys sorted, numbers in their shortest form, no description.
Equal specs have equal texts, whatever their files look like.
"""

from __future__ import annotations

import hashlib
import json
import re
from dataclasses import dataclass, replace
from typing import Any

from fopi_tune.core.text_tables.words import counted
from fopi_tune.errors import SpecError
from fopi_tune.spec.language import read_spec
from fopi_tune.spec.load import contents_reader
from fopi_tune.spec.model import DesignSpec
from fopi_tune.spec.validation import FileReader
from fopi_tune.spec.yaml.nodes import MappingNode, Node, Place, RejectedNode, ScalarNode, SequenceNode, kind_of
from fopi_tune.spec.yaml.problems import Mark, ProblemCollector
from fopi_tune.spec.yaml.scalars import is_number

_STEP_PATTERN = re.compile(r"([A-Za-z_][A-Za-z0-9_]*)((?:\[[0-9]{1,4}\])*)")
#: a whole path, for the schema
PATH_PATTERN = r"[A-Za-z_][A-Za-z0-9_]*(?:\[[0-9]{1,4}\])*(?:\.[A-Za-z_][A-Za-z0-9_]*(?:\[[0-9]{1,4}\])*)*"
#: most steps of a path; specs are less than half as deep
_MAX_STEPS = 32
#: words that are no text where they stand without quotes
_TRUTHS = {"true": True, "false": False}
_WHOLE = re.compile(r"[+-]?[0-9]+")
_NO_MARK = Mark(1, 1)

#: names of files, as a spec writes them, and their contents
Files = tuple[tuple[str, bytes], ...]
#: the steps of a path: keys and indices
Path = tuple[str | int, ...]


class NoSuchPathError(ValueError):
    """A path through a node that is not a mapping or list; the message says where."""


@dataclass(frozen=True)
class Override:
    """A value for a path.

    Args:
        path: as it is written.
        mark: of the path, in the study file.
        node: the value.
    """

    path: str
    mark: Mark
    node: Node


def parse_path(text: str) -> Path | None:
    """`requirements[2].limit` as keys and indices; None if it is no path."""
    if text.count(".") + text.count("[") >= _MAX_STEPS:
        return None
    steps: list[str | int] = []
    for part in text.split("."):
        match = _STEP_PATTERN.fullmatch(part)
        if match is None:
            return None
        steps.append(match.group(1))
        steps += [int(index) for index in re.findall(r"[0-9]+", match.group(2))]
    return tuple(steps)


def format_path(path: Path) -> str:
    """A path as text; the inverse of `parse_path`."""
    text = ""
    for step in path:
        text += f"[{step}]" if isinstance(step, int) else f".{step}" if text else step
    return text


def apply_override(tree: Node, override: Override) -> Node:
    """The tree with a value put in.  A missing key is added; it is checked with the spec.

    Raises:
        NoSuchPathError: the path leads through a number or a word, or beyond the end of a list.
    """
    path = parse_path(override.path)
    assert path is not None, override.path
    return _apply_at(tree, path, 0, override)


def _apply_at(tree: Node, path: Path, depth: int, override: Override) -> Node:
    if depth == len(path):
        return override.node
    step, where = path[depth], format_path(path[:depth])
    if isinstance(step, int):
        if not isinstance(tree, SequenceNode):
            raise NoSuchPathError(f"{where} is {kind_of(tree)} in the spec, not a list; there is no entry [{step}]")
        if step >= len(tree.nodes):
            raise NoSuchPathError(
                f"{where} has {counted(len(tree.nodes), 'entry', 'entries')} in the spec; they count from [0]"
            )
        nodes = list(tree.nodes)
        nodes[step] = _apply_at(nodes[step], path, depth + 1, override)
        return replace(tree, nodes=tuple(nodes))
    if not isinstance(tree, MappingNode):
        raise NoSuchPathError(f"{where} is {kind_of(tree)} in the spec, not a mapping; override {where} as a whole")
    mark, inner = tree.entries.get(step, (override.mark, MappingNode(override.mark, {})))
    if isinstance(path[depth + 1] if depth + 1 < len(path) else "", int) and step not in tree.entries:
        raise NoSuchPathError(f"{format_path(path[: depth + 1])} is not in the spec; give the whole list")
    return replace(tree, entries={**tree.entries, step: (mark, _apply_at(inner, path, depth + 1, override))})


def plain_value(node: Node) -> Any:
    """A node as a JSON value; scalars that the spec language reads as numbers, true or false become these."""
    if isinstance(node, MappingNode):
        return {key: plain_value(value) for key, (_, value) in node.entries.items()}
    if isinstance(node, SequenceNode):
        return [plain_value(value) for value in node.nodes]
    assert not isinstance(node, RejectedNode)
    if node.plain and node.text in _TRUTHS:
        return _TRUTHS[node.text]
    if not node.plain or not is_number(node.text):
        return node.text
    return int(node.text) if _WHOLE.fullmatch(node.text) else float(node.text) + 0.0


def canonical_text(tree: Node) -> str:
    """The canonical text of a spec's tree."""
    value = plain_value(tree)
    value.pop("description", None)
    return json.dumps(value, sort_keys=True, separators=(",", ":"), ensure_ascii=False)


def node_from_json(value: Any) -> Node:
    """A JSON value as a node."""
    if isinstance(value, dict):
        return MappingNode(_NO_MARK, {key: (_NO_MARK, node_from_json(inner)) for key, inner in value.items()})
    if isinstance(value, list):
        return SequenceNode(_NO_MARK, tuple(node_from_json(inner) for inner in value))
    if isinstance(value, str):
        return ScalarNode(_NO_MARK, value, plain=False)
    if isinstance(value, bool):
        return ScalarNode(_NO_MARK, "true" if value else "false", plain=True)
    return ScalarNode(_NO_MARK, repr(value), plain=True)


def spec_from_text(text: str, name: str = "<cell>", files: Files = ()) -> DesignSpec:
    """The spec of a canonical text: the same as `parse_spec`, but faster, without the YAML reader.

    Args:
        text: the spec.
        name: what messages call it.
        files: names and contents of the files that it names.

    Raises:
        SpecError: not a usable spec.
    """
    collector = ProblemCollector(name)
    read = contents_reader(dict(files))
    spec = spec_from_tree(node_from_json(json.loads(text)), collector, read, hashlib.sha256(text.encode()).hexdigest())
    if spec is None:
        raise SpecError(tuple(collector.problems))
    return spec


def spec_from_tree(
    tree: Node, collector: ProblemCollector, read: FileReader, sha256: str = "", path: str = ""
) -> DesignSpec | None:
    """The spec of a tree, or None after reporting its problems.

    Args:
        tree: of the spec.
        collector: of its problems.
        read: reads the files that it names.
        sha256: of its text.
        path: of the spec in a larger document, before the paths of its problems.
    """
    return read_spec(Place(tree, path, collector), sha256, read)
