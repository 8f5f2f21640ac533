"""The branch-and-bound tree:  a root box is bisected repeatedly; each leaf has the reason why it is discarded.

Boxes are always split half-way along one axis, so the leaves cover the root by construction.  The serialised tree is a
list of tokens in preorder: `1` splits along axis 1, `#7` is a leaf with reason 7, and `#7*0.5#9*2` one with reasons 7
and 9 together, with their weights.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

from fopi_tune.optimum.pruning.combinations import MOST_REASONS, Combination
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
    reason: Reason | Combination | None = None

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
            tokens.append(_token(node.reason, reasons))
    return Cover(root.box, tuple(tokens))


def _token(reason: Reason | Combination, reasons: Reasons) -> str:
    if isinstance(reason, Reason):
        return f"#{reasons.index(reason)}"
    pairs = zip(reason.reasons, reason.weights, strict=True)
    return "".join(f"#{reasons.index(each)}*{weight!r}" for each, weight in pairs)


def _numbers(token: str) -> tuple[list[int], list[float] | None] | None:
    """The numbers of a leaf's reasons, and the weights of several; None of what is no leaf."""
    parts = token[1:].split("#") if token[:1] == "#" else []
    pairs = [part.split("*") for part in parts]
    if not pairs or not all(pair[0].isdecimal() and len(pair[0]) < 9 for pair in pairs):
        return None
    numbers = [int(pair[0]) for pair in pairs]
    if len(pairs) == 1 and len(pairs[0]) == 1:
        return numbers, None
    if len(pairs) > MOST_REASONS or not all(len(pair) == 2 for pair in pairs):
        return None
    try:
        weights = [float(pair[1]) for pair in pairs]
    except ValueError:
        return None
    return (numbers, weights) if all(0.0 < weight < math.inf for weight in weights) else None


def uses_every_reason(covers: Sequence[Cover], reasons: Sequence[Reason]) -> bool:
    """Whether the reasons are those of the leaves, each once and in the order of its first use."""
    leaves = (_numbers(token) for cover in covers for token in cover.tokens)
    used = dict.fromkeys(number for leaf in leaves if leaf is not None for number in leaf[0])
    return list(used) == list(range(len(reasons))) and len(set(reasons)) == len(reasons)


def walk(cover: Cover, reasons: Sequence[Reason]) -> Iterator[tuple[Box, Reason | Combination]]:
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
        leaf = _numbers(token)
        if leaf is not None and all(number < len(reasons) for number in leaf[0]):
            named = tuple(reasons[number] for number in leaf[0])
            yield box, named[0] if leaf[1] is None else Combination(named, tuple(leaf[1]))
            continue
        axis = int(token) if token.isdecimal() and len(token) < 3 else len(box)
        pieces = split(box, axis) if axis < len(box) else None
        if pieces is None:
            raise ValueError(f"token {position - 1}, {token[:20]!r}, is neither a cut nor a reason")
        pending += [pieces[1], pieces[0]]
    if position != len(cover.tokens):
        raise ValueError("the tree goes on after the box is covered")
