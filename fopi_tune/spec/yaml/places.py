"""Places in a document: a node, its path, and whom to tell what is wrong with it."""

from __future__ import annotations

from dataclasses import dataclass

from fopi_tune.spec.yaml.nodes import Items, Node, Refused, Scalar, Table
from fopi_tune.spec.yaml.report import Mark, Report, item_path, key_path, quoted
from fopi_tune.spec.yaml.scalars import is_empty


@dataclass(frozen=True)
class Place:
    """A node, where it is in the document, and whom to tell what is wrong with it."""

    node: Node
    path: str
    report: Report

    @property
    def mark(self) -> Mark:
        """Where the node begins."""
        return self.node.mark

    def refuse(self, message: str) -> None:
        """Report the node; a node that was reported while composing is not reported again."""
        if not isinstance(self.node, Refused):
            self.report.refuse(self.mark, self.path, message)

    def child(self, key: str) -> Place:
        """The value of a key; of a key that is not there, the mapping itself."""
        path = key_path(self.path, key)
        if isinstance(self.node, Table) and key in self.node.entries:
            return Place(self.node.entries[key][1], path, self.report)
        return Place(self.node, path, self.report)

    def item(self, index: int) -> Place:
        """An entry of a list."""
        assert isinstance(self.node, Items)
        return Place(self.node.nodes[index], item_path(self.path, index), self.report)

    def has(self, key: str) -> bool:
        """Whether the node is a mapping with this key."""
        return isinstance(self.node, Table) and key in self.node.entries


def kind_of(node: Node) -> str:
    """What the user wrote, in words."""
    if isinstance(node, Table):
        return "a mapping"
    if isinstance(node, Items):
        return "a list"
    if isinstance(node, Scalar) and node.plain and is_empty(node.text):
        return "nothing"
    return quoted(node.text) if isinstance(node, Scalar) else "an alias"


def scalar_of(place: Place, wanted: str) -> Scalar | None:
    """The node as a scalar, or None after reporting."""
    if isinstance(place.node, Scalar):
        return place.node
    place.refuse(f"{kind_of(place.node)} is written where {wanted} belongs; write {wanted}")
    return None
