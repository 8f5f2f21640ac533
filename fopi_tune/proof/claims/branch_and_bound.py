"""Branch and bound for a claim, its record, and the check of a record.

A record is the search tree in preorder: `s2` splits a box in the middle of axis 2, `p1+2-` replaces it by its face at
the upper end of axis 1 and the lower end of axis 2, every other token is a leaf on which the claim holds.  Boxes are
always split by the same rule, so the leaves cover the domain by construction; where a direct path jumps, a box stands
for its piece of the family (`fopi_tune.proof.balls.whole_samples`).
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from fopi_tune.proof.balls.box import Box, Interval, centre_of, split, with_interval
from fopi_tune.proof.claims.claim import Claim

_PIN = re.compile(r"(\d+)([+-])")
_FACE = re.compile(r"p(?:\d+[+-])+")


@dataclass(frozen=True)
class SearchResult:
    """Result of a search.

    Args:
        record: tokens of the tree; empty unless the claim was proved.
        boxes: number of examined boxes.
        work: counted effort of these boxes, see `BoxVerdict`.
        counterexample: a point at which the claim is false.
        open_boxes: undecided boxes of a search that ran out of budget or could not split further.
    """

    record: tuple[str, ...]
    boxes: int
    work: int
    counterexample: tuple[float, ...] | None = None
    open_boxes: tuple[Box, ...] = ()

    @property
    def shown(self) -> bool:
        """Whether the claim holds on its whole domain."""
        return bool(self.record)


def search(
    claim: Claim, budget: int, most_work: int | None = None, plant_work: Callable[[], int] = lambda: 0
) -> SearchResult:
    """Prove a claim on its whole domain, or find a counterexample.

    Args:
        claim: to be proved.
        budget: most boxes to examine.
        most_work: the search ends with the box that reaches it; None for no limit but the budget.
        plant_work: work of all plants computed so far, which is added to that of the boxes.
    """
    record: list[str] = []
    pending = [claim.domain]
    boxes, work, before = 0, 0, plant_work()
    while pending:
        if boxes >= budget or (most_work is not None and work >= most_work):
            return SearchResult((), boxes, work, open_boxes=tuple(pending))
        box = pending.pop()
        boxes += 1
        found = claim.examine(box)
        work, before = work + found.work + plant_work() - before, plant_work()
        if found.leaf is not None:
            record.append(found.leaf)
            continue
        if found.counterexample:
            return SearchResult((), boxes, work, counterexample=centre_of(box))
        if found.monotone_ends:
            record.append("p" + "".join(f"{axis}{'+' if upper else '-'}" for axis, upper in found.monotone_ends))
            pending.append(_face(box, found.monotone_ends))
            continue
        pieces = split(box, found.axis, claim.origin, claim.cuts) if found.axis >= 0 else None
        if pieces is None or (found.axis == 0 and _end_of_tail(box[0]) > claim.farthest_u):
            return SearchResult((), boxes, work, open_boxes=(box, *pending))
        record.append(f"s{found.axis}")
        pending += [pieces[1], pieces[0]]
    return SearchResult(tuple(record), boxes, work)


def check_record(claim: Claim, record: tuple[str, ...]) -> str | None:
    """Walk through a record and test every leaf and face again.

    Returns:
        The first error, or None.
    """
    pending = [claim.domain]
    position = 0
    while pending:
        if position >= len(record):
            return "the record ends before the domain is covered"
        box = pending.pop()
        token = record[position]
        kind = token[:1]
        if kind == "s":
            axis = _axis(token[1:], box)
            pieces = split(box, axis, claim.origin, claim.cuts) if axis >= 0 else None
            if pieces is None:
                return f"token {position}, {token[:20]!r}, cuts no axis that has a middle"
            pending += [pieces[1], pieces[0]]
            position += 1
        elif kind == "p":
            monotone_ends = [(_axis(digits, box), sign == "+") for digits, sign in _PIN.findall(token)]
            if not _FACE.fullmatch(token) or not set(monotone_ends) <= set(claim.examine(box).monotone_ends):
                return f"token {position}, {token[:20]!r}, takes a face that need not be the worst"
            pending.append(_face(box, monotone_ends))
            position += 1
        else:
            if not claim.holds(box, token):
                return f"leaf {position} does not hold on its box"
            position += 1
    return None if position == len(record) else "the record goes on after the domain is covered"


def _face(box: Box, monotone_ends: Sequence[tuple[int, bool]]) -> Box:
    for axis, upper in monotone_ends:
        end = box[axis][1] if upper else box[axis][0]
        box = with_interval(box, axis, (end, end))
    return box


def _end_of_tail(u: Interval) -> float:
    """How far out a tail begins; 0 for any other interval."""
    if math.isinf(u[0]) is math.isinf(u[1]):
        return 0.0
    return -u[1] if math.isinf(u[0]) else u[0]


def _axis(digits: str, box: Box) -> int:
    """An axis of the box; -1 when it is none."""
    axis = int(digits) if digits.isdecimal() and len(digits) < 4 else len(box)
    return axis if axis < len(box) else -1
