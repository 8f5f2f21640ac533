"""The branch-and-bound tree:  a root box is bisected repeatedly; each leaf has the reason why it is discarded.

Boxes are always split half-way along one axis, so the leaves cover the root by construction.  The serialised tree is a
list of tokens in preorder: `1` splits along axis 1, `#7` is a leaf with reason 7.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

from fopi_tune.optimum.pruning.exclusion import Reason
from fopi_tune.proof.balls.box import Box, split


@dataclass
class Node:
    """A box of the growing tree; with `axis` it was split, with `reason` it was discarded, with neither it is open.

    Args:
        box: its coordinates.
        axis: along which it was cut; -1 when it was not.
        pieces: of the cut.
        reason: why it was discarded.
    """

    box: Box
    axis: int = -1
    pieces: tuple[Node, ...] = ()
    reason: Reason | None = None

    def cut(self, axis: int) -> tuple[Node, Node] | None:
        """Both halves; None when no double lies between the ends."""
        parts = split(self.box, axis)
        if parts is None:
            return None
        self.axis, self.pieces, self.reason = axis, (Node(parts[0]), Node(parts[1])), None
        return self.pieces[0], self.pieces[1]

    def leaves(self) -> Iterator[Node]:
        """Every box that was not cut, in preorder."""
        pending: list[Node] = [self]
        while pending:
            node = pending.pop()
            if node.axis < 0:
                yield node
            else:
                pending.extend(reversed(node.pieces))


@dataclass(frozen=True)
class Cover:
    """A finished tree.

    Args:
        root: the box that is covered.
        tokens: in preorder.
    """

    root: Box
    tokens: tuple[str, ...]

    @property
    def leaves(self) -> int:
        """Boxes that were discarded."""
        return sum(token.startswith("#") for token in self.tokens)


@dataclass
class Reasons:
    """Reasons in the order of their first use."""

    indices: dict[Reason, int] = field(default_factory=dict)

    def index(self, reason: Reason) -> int:
        """Its number."""
        return self.indices.setdefault(reason, len(self.indices))


def to_cover(root: Node, reasons: Reasons) -> Cover:
    """Serialise a finished tree."""
    tokens: list[str] = []
    pending = [root]
    while pending:
        node = pending.pop()
        if node.axis >= 0:
            tokens.append(str(node.axis))
            pending += reversed(node.pieces)
        else:
            assert node.reason is not None, "an open box cannot be written down"
            tokens.append(f"#{reasons.index(node.reason)}")
    return Cover(root.box, tuple(tokens))


def uses_every_reason(covers: Sequence[Cover], reasons: Sequence[Reason]) -> bool:
    """Whether the reasons are those of the leaves, each once and in the order of its first use."""
    used = dict.fromkeys(token for cover in covers for token in cover.tokens if token.startswith("#"))
    return list(used) == [f"#{k}" for k in range(len(reasons))] and len(set(reasons)) == len(reasons)


def walk(cover: Cover, reasons: Sequence[Reason]) -> Iterator[tuple[Box, Reason]]:
    """Every leaf of a cover with its reason.

    Raises:
        ValueError: the tokens are no tree over the root.
    """
    pending = [cover.root]
    position = 0
    while pending:
        if position >= len(cover.tokens):
            raise ValueError("the tree ends before the box is covered")
        box, token = pending.pop(), cover.tokens[position]
        position += 1
        number = int(token[1:]) if token[:1] == "#" and token[1:].isdecimal() and len(token) < 10 else -1
        if 0 <= number < len(reasons):
            yield box, reasons[number]
            continue
        axis = int(token) if token.isdecimal() and len(token) < 3 else len(box)
        pieces = split(box, axis) if axis < len(box) else None
        if pieces is None:
            raise ValueError(f"token {position - 1}, {token[:20]!r}, is neither a cut nor a reason")
        pending += [pieces[1], pieces[0]]
    if position != len(cover.tokens):
        raise ValueError("the tree goes on after the box is covered")
