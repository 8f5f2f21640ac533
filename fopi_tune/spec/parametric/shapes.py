"""What is written in a plant with named parameters:  shapes that read to `Written`, whatever is wrong with it."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from fopi_tune.core.plant import PlantFamily, Uncertain
from fopi_tune.spec.parametric.coefficients import Written
from fopi_tune.spec.parametric.expressions import MAX_LENGTH, NAME_PATTERN
from fopi_tune.spec.yaml.nodes import MappingNode, Place, ScalarNode, SequenceNode, kind_of
from fopi_tune.spec.yaml.problems import key_path
from fopi_tune.spec.yaml.records import Record, expect_mapping
from fopi_tune.spec.yaml.scalars import is_empty, is_number
from fopi_tune.spec.yaml.shapes import JsonSchema, ListOf, Shape

MAX_PARAMETERS, MAX_COEFFICIENTS = 32, 32
_EXAMPLE = "{k: {min: 1, max: 10}}"
#: stands for a parameter that could not be read: a number by which few expressions divide by 0
_UNREAD = Uncertain.exactly(2.718281828459045)
#: a polynomial of a plant: a list of coefficients, or of factors that are such lists
Side = Sequence[Written] | Sequence[Sequence[Written]]


@dataclass(frozen=True)
class Parameters(Shape):
    """Named numbers; reads to name -> `Uncertain`, without those that could not be read.

    Args:
        number: the shape of one.
    """

    number: Shape

    def read(self, place: Place) -> dict[str, Uncertain] | None:
        if not expect_mapping(place, _EXAMPLE):
            return None
        assert isinstance(place.node, MappingNode)
        entries = place.node.entries
        if not 1 <= len(entries) <= MAX_PARAMETERS:
            place.refuse(f"{len(entries)} parameters are written; write 1 to {MAX_PARAMETERS}, such as {_EXAMPLE}")
        found: dict[str, Uncertain] = {}
        for name, (mark, _) in entries.items():
            if re.fullmatch(NAME_PATTERN, name) is None:
                message = "is no name of a parameter; write a letter, then letters, digits and _, at most 40 in all"
                place.collector.add(mark, key_path(place.path, name), message)
            value = self.number.read(place.child(name))
            # a parameter that could not be read is known all the same
            found[name] = value if isinstance(value, Uncertain) else _UNREAD
        # drawn plants and digests do not depend on the order of a file's keys
        return dict(sorted(found.items()))

    def json_schema(self) -> JsonSchema:
        return {
            "type": "object",
            "description": "named numbers, used in any of the plant's expressions; the family is the box of their "
            "ranges",
            "properties": {},
            "patternProperties": {f"^{NAME_PATTERN}$": self.number.json_schema()},
            "additionalProperties": False,
            "minProperties": 1,
            "maxProperties": MAX_PARAMETERS,
        }


@dataclass(frozen=True)
class Coefficient(Shape):
    """A number, an expression or a range; reads to `Written`, whatever is wrong with it.

    Args:
        meaning: of it.
        number: the shape of a range.
    """

    meaning: str
    number: Shape

    def read(self, place: Place) -> Written:
        node = place.node
        if not isinstance(node, ScalarNode):
            value = self.number.read(place)
            return Written(place, number=value if isinstance(value, Uncertain) else None)
        if node.plain and is_empty(node.text):
            place.refuse("the value is missing; write a number or an expression")
        elif not node.plain and is_number(node.text):
            place.refuse(f"{node.text!r} in quotes is text where a number belongs; write {node.text} without quotes")
        else:
            return Written.expression(place)
        return Written(place)

    def json_schema(self) -> JsonSchema:
        expression = {
            "type": "string",
            "description": f"{self.meaning}, as an expression in the parameters: + - * / ** and parentheses",
            "minLength": 1,
            "maxLength": MAX_LENGTH,
        }
        number = self.number.json_schema()
        return {"anyOf": [*number["anyOf"], expression]}


@dataclass(frozen=True)
class Polynomial(Shape):
    """Coefficients, or factors that are lists of coefficients; reads to such a list."""

    meaning: str
    coefficient: Coefficient

    def read(self, place: Place) -> Side | None:
        nodes = place.node.nodes if isinstance(place.node, SequenceNode) else ()
        if not any(isinstance(node, SequenceNode) for node in nodes):
            return self._plain.read(place)
        if all(isinstance(node, SequenceNode) for node in nodes):
            return self._factors.read(place)
        for index, node in enumerate(nodes):
            item = place.item(index)
            if isinstance(node, SequenceNode):
                self._plain.read(item)
                continue
            item.refuse(f"{kind_of(node)} is written where a factor belongs; write [{_as_text(node)}]")
            self.coefficient.read(item)
        return None

    @property
    def _plain(self) -> ListOf:
        return ListOf(f"{self.meaning}, descending powers of s", self.coefficient, 1, MAX_COEFFICIENTS)

    @property
    def _factors(self) -> ListOf:
        return ListOf(f"factors of the product that is {self.meaning}", self._plain, 1, MAX_COEFFICIENTS)

    def json_schema(self) -> JsonSchema:
        return {"anyOf": [self._plain.json_schema(), self._factors.json_schema()]}


def _as_text(node: Any) -> str:
    return node.text if isinstance(node, ScalarNode) and len(node.text) <= 20 else "..."


@dataclass(frozen=True)
class ParametricRecord(Record):
    """A plant whose numbers are expressions; a record whose mistakes are all reported, whatever else is wrong."""

    def read(self, place: Place) -> PlantFamily | None:
        values = self.read_partial(place)
        return None if values is None else self.build(values, place)
