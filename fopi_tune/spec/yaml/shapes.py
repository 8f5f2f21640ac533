"""Shapes of values: each reads a node strictly and generates the matching JSON Schema, so that the two cannot diverge.

A shape's `read` returns None for what it could not read; it has then reported why.
"""

from __future__ import annotations

import re
from abc import ABC, abstractmethod
from collections.abc import Callable, Collection
from dataclasses import dataclass
from typing import Any

from fopi_tune.core.text_tables.words import counted
from fopi_tune.spec.yaml.hints import unknown_word_message
from fopi_tune.spec.yaml.nodes import MappingNode, Place, ScalarNode, SequenceNode, kind_of, scalar_of
from fopi_tune.spec.yaml.problems import quoted
from fopi_tune.spec.yaml.scalars import NotANumberError, is_empty, is_number, is_text, parse_integer, parse_number

JsonSchema = dict[str, Any]


class Shape(ABC):
    """What a value must look like."""

    @abstractmethod
    def read(self, place: Place) -> Any:
        """The value, or None after reporting why there is none."""

    @abstractmethod
    def json_schema(self) -> JsonSchema:
        """The same in JSON Schema (draft 2020-12)."""


@dataclass(frozen=True)
class Number(Shape):
    """A finite number between optional ends, `above` and `below` excluded, `at_least` and `at_most` included."""

    meaning: str
    above: float | None = None
    below: float | None = None
    at_least: float | None = None
    at_most: float | None = None
    whole: bool = False

    def read(self, place: Place) -> float | int | None:
        expected = "a whole number" if self.whole else "a number"
        scalar = scalar_of(place, expected)
        if scalar is None:
            return None
        try:
            if not scalar.plain:
                advice = f"write {scalar.text} without quotes" if is_number(scalar.text) else f"write {expected}"
                raise NotANumberError(f"{quoted(scalar.text)} in quotes is text where {expected} belongs; {advice}")
            value = parse_integer(scalar.text) if self.whole else parse_number(scalar.text)
        except NotANumberError as reason:
            place.refuse(str(reason))
            return None
        if self._in_range(value):
            return value
        place.refuse(f"{scalar.text} is out of range; it must be {self._range()}")
        return None

    def json_schema(self) -> JsonSchema:
        ends = {
            "exclusiveMinimum": self.above,
            "exclusiveMaximum": self.below,
            "minimum": self.at_least,
            "maximum": self.at_most,
        }
        schema: JsonSchema = {"type": "integer" if self.whole else "number", "description": self.meaning}
        return schema | {key: end for key, end in ends.items() if end is not None}

    def _in_range(self, value: float) -> bool:
        return (
            (self.above is None or value > self.above)
            and (self.below is None or value < self.below)
            and (self.at_least is None or value >= self.at_least)
            and (self.at_most is None or value <= self.at_most)
        )

    def _range(self) -> str:
        ends = {
            "greater than": self.above,
            "at least": self.at_least,
            "less than": self.below,
            "at most": self.at_most,
        }
        return " and ".join(f"{words} {end}" for words, end in ends.items() if end is not None)


@dataclass(frozen=True)
class Text(Shape):
    """A string that matches `pattern` whole; `rule` says the pattern in words."""

    meaning: str
    pattern: str = ""
    rule: str = ""

    def read(self, place: Place) -> str | None:
        scalar = scalar_of(place, "text")
        if scalar is None:
            return None
        if scalar.plain and is_empty(scalar.text):
            place.refuse("the value is missing; write text")
        elif scalar.plain and not is_text(scalar.text):
            place.refuse(f"{quoted(scalar.text)} is not text; put it in quotes")
        elif self.pattern and re.fullmatch(self.pattern, scalar.text) is None:
            place.refuse(f"{quoted(scalar.text)} cannot be used; {self.rule}")
        else:
            return scalar.text
        return None

    def json_schema(self) -> JsonSchema:
        schema: JsonSchema = {"type": "string", "description": self.meaning}
        return schema | ({"pattern": f"^(?:{self.pattern})$"} if self.pattern else {})


@dataclass(frozen=True)
class Choice(Shape):
    """One of a few words, or `instead`, which another shape reads."""

    meaning: str
    words: Collection[str]
    instead: str = ""

    def read(self, place: Place) -> str | None:
        scalar = scalar_of(place, "a word")
        if scalar is None:
            return None
        if scalar.text in self.words:
            return scalar.text
        place.refuse(unknown_word_message(scalar.text, self.words, self.instead))
        return None

    def json_schema(self) -> JsonSchema:
        return {"enum": list(self.words), "description": self.meaning}


@dataclass(frozen=True)
class Constant(Shape):
    """A fixed word; it was read already to select this shape."""

    meaning: str
    word: str

    def read(self, place: Place) -> str | None:
        return self.word

    def json_schema(self) -> JsonSchema:
        return {"const": self.word, "description": self.meaning}


@dataclass(frozen=True)
class Version(Shape):
    """The version of the language."""

    meaning: str
    version: int

    def read(self, place: Place) -> int | None:
        value = Number(self.meaning, whole=True).read(place)
        if value is None or value == self.version:
            return None if value is None else self.version
        if value > self.version:
            place.refuse(f"version {value} is newer than this tool, which reads {self.version}; update fopi-tune")
        else:
            place.refuse(f"there is no version {value}; write {self.version}")
        return None

    def json_schema(self) -> JsonSchema:
        return {"const": self.version, "description": self.meaning}


@dataclass(frozen=True)
class ListOf(Shape):
    """A list of `least` to `most` values of one shape."""

    meaning: str
    shape: Shape
    least: int = 0
    most: int | None = None

    def read(self, place: Place) -> list[Any] | None:
        values = self.read_partial(place)
        return None if values is None or None in values else values

    def read_partial(self, place: Place) -> list[Any] | None:
        """The list with None for each value that could not be read; None if it is no list of the right length."""
        if not isinstance(place.node, SequenceNode):
            advice = ", each after '- '" if isinstance(place.node, MappingNode) else ""
            if self.least <= 1 and isinstance(place.node, ScalarNode) and is_number(place.node.text):
                advice = f", such as [{place.node.text}]"
            message = f"{kind_of(place.node)} is written where a list belongs; write {self._expected_length()}{advice}"
            place.refuse(message)
            return None
        count = len(place.node.nodes)
        if count < self.least or (self.most is not None and count > self.most):
            place.refuse(f"the list has {counted(count, 'entry', 'entries')}; write {self._expected_length()}")
            return None
        return [self.shape.read(place.item(index)) for index in range(count)]

    def json_schema(self) -> JsonSchema:
        schema: JsonSchema = {"type": "array", "description": self.meaning, "items": self.shape.json_schema()}
        return schema | {"minItems": self.least} | ({} if self.most is None else {"maxItems": self.most})

    def _expected_length(self) -> str:
        if self.least == self.most:
            return f"a list of {counted(self.least, 'entry', 'entries')}"
        if self.least == 0:
            return "a list" if self.most is None else f"a list of at most {counted(self.most, 'entry', 'entries')}"
        if self.most is None:
            return f"a list of at least {self.least}"
        return f"a list of {self.least} to {self.most} entries"


@dataclass(frozen=True)
class Pair(Shape):
    """[low, high] with low < high."""

    meaning: str
    end: Number

    def read(self, place: Place) -> tuple[float, float] | None:
        values = ListOf(self.meaning, self.end, 2, 2).read(place)
        if values is None:
            return None
        low, high = values
        if low < high:
            return low, high
        place.refuse(f"{low} is not less than {high}; write [low, high]")
        return None

    def json_schema(self) -> JsonSchema:
        return ListOf(self.meaning, self.end, 2, 2).json_schema()


@dataclass(frozen=True)
class PlainOrMapping(Shape):
    """One shape for a mapping, another for any other node."""

    plain: Shape
    mapping: Shape

    def read(self, place: Place) -> Any:
        return (self.mapping if isinstance(place.node, MappingNode) else self.plain).read(place)

    def json_schema(self) -> JsonSchema:
        return {"anyOf": [self.plain.json_schema(), self.mapping.json_schema()]}


@dataclass(frozen=True)
class Converted(Shape):
    """A shape whose value is converted by a function."""

    shape: Shape
    convert: Callable[[Any], Any]

    def read(self, place: Place) -> Any:
        value = self.shape.read(place)
        return None if value is None else self.convert(value)

    def json_schema(self) -> JsonSchema:
        return self.shape.json_schema()
