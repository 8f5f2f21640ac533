"""Words of a study file with their places:  names of entries, columns and their paths, values to compare with."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from typing import Generic, TypeVar

from fopi_tune.errors import Problem, SpecError
from fopi_tune.spec.yaml.hints import unknown_word_message
from fopi_tune.spec.yaml.nodes import MappingNode, Place, ScalarNode, SequenceNode, scalar_of
from fopi_tune.spec.yaml.problems import Mark
from fopi_tune.spec.yaml.scalars import NotANumberError, is_empty, is_number, parse_number
from fopi_tune.spec.yaml.shapes import Choice, JsonSchema, ListOf, Shape

Rule = TypeVar("Rule")

#: all entries of a registry
ALL = "all"


@dataclass(frozen=True)
class PlacedWord:
    """A word of the study and where it is written."""

    word: str
    mark: Mark
    path: str


@dataclass(frozen=True)
class ColumnMapping(Shape):
    """A mapping from names of columns to paths into a cell's result."""

    meaning: str
    path: Shape

    def read(self, place: Place) -> dict[str, str] | None:
        assert isinstance(place.node, MappingNode)
        found = {key: self.path.read(place.child(key)) for key in place.node.entries}
        return None if None in found.values() else found

    def json_schema(self) -> JsonSchema:
        return {"type": "object", "description": self.meaning, "additionalProperties": self.path.json_schema()}


def refuse_unknown_columns(words: Sequence[PlacedWord], file: str, columns: Collection[str]) -> None:
    """Refuse names that are no columns of a study's table.

    Raises:
        SpecError: there is no such column.
    """
    problems = [
        Problem(
            file,
            each.mark.line,
            each.mark.column,
            each.path,
            f"{unknown_word_message(each.word, columns)}; collect: makes more columns",
        )
        for each in words
        if each.word not in columns
    ]
    if problems:
        raise SpecError(tuple(problems))


@dataclass(frozen=True)
class PlacedRule(Generic[Rule]):
    """A rule about columns, and where these are written."""

    rule: Rule
    words: tuple[PlacedWord, ...]

    def checked(self, file: str, columns: Collection[str]) -> Rule:
        """The rule, after comparing its columns with those of the table.

        Raises:
            SpecError: there is no such column.
        """
        refuse_unknown_columns(self.words, file, columns)
        return self.rule


@dataclass(frozen=True)
class WithPlace(Shape):
    """A word, read together with its place."""

    shape: Shape

    def read(self, place: Place) -> PlacedWord | None:
        word = self.shape.read(place)
        return None if word is None else PlacedWord(word, place.mark, place.path)

    def json_schema(self) -> JsonSchema:
        return self.shape.json_schema()


@dataclass(frozen=True)
class AllOrList(Shape):
    """The word `all`, or a list."""

    names: ListOf

    def read(self, place: Place) -> list[PlacedWord] | None:
        if isinstance(place.node, SequenceNode):
            return self.names.read(place)
        word = WithPlace(Choice(f"`{ALL}`, or a list of names", [ALL])).read(place)
        return None if word is None else [word]

    def json_schema(self) -> JsonSchema:
        return {"anyOf": [{"const": ALL}, self.names.json_schema()]}


@dataclass(frozen=True)
class AnyScalar(Shape):
    """A number or a word, to compare with."""

    meaning: str

    def read(self, place: Place) -> float | str | None:
        scalar: ScalarNode | None = scalar_of(place, "a number or a word")
        if scalar is None:
            return None
        if scalar.plain and is_empty(scalar.text):
            place.refuse("the value is missing; write a number or a word")
            return None
        try:
            return parse_number(scalar.text) if scalar.plain and is_number(scalar.text) else scalar.text
        except NotANumberError as reason:
            place.refuse(str(reason))
            return None

    def json_schema(self) -> JsonSchema:
        return {"type": ["number", "string", "boolean"], "description": self.meaning}
