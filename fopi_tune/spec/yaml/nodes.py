"""Nodes of a document, and places: a node together with its path and the collector of problems.

A scalar stays text here.  The shape that reads it decides what it means.
"""

from __future__ import annotations

from dataclasses import dataclass

from fopi_tune.spec.yaml.problems import Mark, ProblemCollector, item_path, key_path, quoted
from fopi_tune.spec.yaml.scalars import is_empty


@dataclass(frozen=True)
class ScalarNode:
    """A word or number as written; `plain` means without quotes, `is_verbatim` that each character has its column."""

    mark: Mark
    text: str
    plain: bool
    is_verbatim: bool = True


@dataclass(frozen=True)
class SequenceNode:
    """A list."""

    mark: Mark
    nodes: tuple[Node, ...]


@dataclass(frozen=True)
class MappingNode:
    """A mapping; every key once, in the order of the file."""

    mark: Mark
    entries: dict[str, tuple[Mark, Node]]


@dataclass(frozen=True)
class RejectedNode:
    """A node that is not allowed; its problem was reported already."""

    mark: Mark


Node = ScalarNode | SequenceNode | MappingNode | RejectedNode


@dataclass(frozen=True)
class Place:
    """A node, its path in the document, and the collector of its problems."""

    node: Node
    path: str
    collector: ProblemCollector

    @property
    def mark(self) -> Mark:
        """Where the node begins."""
        return self.node.mark

    def refuse(self, message: str) -> None:
        """Report a problem of this node; a rejected node has one already."""
        if not isinstance(self.node, RejectedNode):
            self.collector.add(self.mark, self.path, message)

    def child(self, key: str) -> Place:
        """The place of a key's value; of a missing key, the mapping with the key added to the path."""
        path = key_path(self.path, key)
        if isinstance(self.node, MappingNode) and key in self.node.entries:
            return Place(self.node.entries[key][1], path, self.collector)
        return Place(self.node, path, self.collector)

    def item(self, index: int) -> Place:
        """The place of a list's entry."""
        assert isinstance(self.node, SequenceNode)
        return Place(self.node.nodes[index], item_path(self.path, index), self.collector)

    def has(self, key: str) -> bool:
        """Whether the node is a mapping with this key."""
        return isinstance(self.node, MappingNode) and key in self.node.entries


def kind_of(node: Node) -> str:
    """What the user wrote there, in words for a message."""
    if isinstance(node, MappingNode):
        return "a mapping"
    if isinstance(node, SequenceNode):
        return "a list"
    if isinstance(node, ScalarNode) and node.plain and is_empty(node.text):
        return "nothing"
    return quoted(node.text) if isinstance(node, ScalarNode) else "an alias"


def scalar_of(place: Place, expected: str) -> ScalarNode | None:
    """The node as a scalar, or None after reporting."""
    if isinstance(place.node, ScalarNode):
        return place.node
    place.refuse(f"{kind_of(place.node)} is written where {expected} belongs; write {expected}")
    return None
