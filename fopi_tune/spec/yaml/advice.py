"""What to write instead of what people often write: ranges as lists, relations as numbers, measures as requirements.

Each function looks at a node and returns a message, or None where it has nothing to say.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass

from fopi_tune.spec.yaml.nodes import MappingNode, Node, Place, ScalarNode, SequenceNode, kind_of
from fopi_tune.spec.yaml.scalars import is_number
from fopi_tune.spec.yaml.shapes import JsonSchema, Shape

_NUMBER = r"[+-]?(?:\d+(?:\.\d*)?|\.\d+)(?:[eE][+-]?\d+)?"
#: longer text is no range, and takes long to look at
_LONGEST = 60
#: 0..10, 0 to 10, 0 - 10, 0~10
_SPAN = re.compile(rf"[\[(]?\s*({_NUMBER})\s*(?:\.{{2,3}}|…|to|-|–|~|,)\s*({_NUMBER})\s*[\])]?")
#: 2 ± 0.1, 2 +- 5 %
_TOLERANCE = re.compile(rf"({_NUMBER})\s*(?:±|\+/?-)\s*({_NUMBER})\s*(%?)")
_PAIR_KEYS = ("between", "range", "interval", "bounds", "limits")
_RELATIONS = {">=": "at_least", "≥": "at_least", ">": "at_least", "<=": "at_most", "≤": "at_most", "<": "at_most"}


@dataclass(frozen=True)
class Advised(Shape):
    """A shape before which a place is looked at: what `advise` says is reported, and nothing is read."""

    shape: Shape
    advise: Callable[[Place], str | None]

    def read(self, place: Place) -> object:
        message = self.advise(place)
        if message is None:
            return self.shape.read(place)
        place.refuse(message)
        return None

    def json_schema(self) -> JsonSchema:
        return self.shape.json_schema()


def range_advice(nominal: bool) -> Callable[[Place], str | None]:
    """About numbers with a range, written as a list or in words; `nominal`: the range may have such a value."""

    def advise(place: Place) -> str | None:
        node = place.node
        numbers = _ends(node)
        if numbers is not None and len(numbers) in ((2, 3) if nominal else (2,)):
            low, *middle, high = sorted(numbers, key=float)
            ends = f"min: {low}, max: {high}"
            written = f"nominal: {middle[0]}, {ends}" if middle else ends
            return f"{kind_of(node)} is written where a number or a range belongs; write {{{written}}}"
        return None

    return advise


def relation_advice(relations: Collection[str]) -> Callable[[Place], str | None]:
    """About a relation to a limit, written as a list or with signs; `relations` are those there are."""

    def advise(place: Place) -> str | None:
        node, belongs = place.node, f"{kind_of(place.node)} is written where a relation belongs"
        numbers = _ends(node) if isinstance(node, SequenceNode) else None
        if numbers is not None and len(numbers) == 2:
            low, high = sorted(numbers, key=float)
            one, two = f"{{between: [{low}, {high}]}}", f"two: {{at_least: {low}}}, {{at_most: {high}}}"
            return f"{belongs}; write {one if 'between' in relations else two}"
        text = node.text[: _LONGEST + 1] if isinstance(node, ScalarNode) else ""
        match = re.fullmatch(rf"(>=|<=|≥|≤|>|<)\s*({_NUMBER})", text) if len(text) <= _LONGEST else None
        return None if match is None else f"{belongs}; write {{{_RELATIONS[match.group(1)]}: {match.group(2)}}}"

    return advise


def word_advice(words: Mapping[str, Collection[str]]) -> Callable[[Place], str | None]:
    """About a choice of a key and a word, written as the word alone or after the key without a colon."""

    def advise(place: Place) -> str | None:
        if not isinstance(place.node, ScalarNode):
            return None
        last = place.node.text.split()[-1] if place.node.text.split() else ""
        key = next((key for key, known in words.items() if last in known), None)
        return None if key is None else f"{kind_of(place.node)} is not a mapping; write {{{key}: {last}}}"

    return advise


def limit_as_written(node: Node, otherwise: str) -> str:
    """{at_most: 5} of such a mapping or of the number 5; `otherwise` of anything else."""
    if isinstance(node, MappingNode) and len(node.entries) == 1:
        key, (_, value) = next(iter(node.entries.items()))
        number = _number(value)
        if key in ("at_most", "at_least") and number is not None:
            return f"{{{key}: {number}}}"
    number = _number(node)
    return otherwise if number is None else f"{{at_most: {number}}}"


def _ends(node: Node) -> list[str] | None:
    """The numbers of a range that is a list, a span or a tolerance, or such a pair under one key."""
    if isinstance(node, SequenceNode):
        numbers = [_number(each) for each in node.nodes]
        return None if None in numbers else [number for number in numbers if number is not None]
    if isinstance(node, MappingNode) and len(node.entries) == 2 and all(map(is_number, node.entries)):
        return list(node.entries)  # {0, 10}
    if isinstance(node, MappingNode) and len(node.entries) == 1:
        key, (_, value) = next(iter(node.entries.items()))
        return _ends(value) if key in _PAIR_KEYS and isinstance(value, SequenceNode) else None
    if not isinstance(node, ScalarNode) or len(node.text) > _LONGEST or is_number(node.text):
        return None
    if match := _SPAN.fullmatch(node.text):
        low, high = match.groups()
        # 2,5 may be a decimal comma, and 3-2 a difference
        return [low, high] if float(low) < float(high) and "," not in node.text.strip("[]()") else None
    if match := _TOLERANCE.fullmatch(node.text):
        middle, width = float(match.group(1)), float(match.group(2))
        width = abs(middle) * width / 100.0 if match.group(3) else width
        return [f"{middle - width:.12g}", f"{middle + width:.12g}"]
    return None


def _number(node: Node) -> str | None:
    return node.text if isinstance(node, ScalarNode) and node.plain and is_number(node.text) else None
