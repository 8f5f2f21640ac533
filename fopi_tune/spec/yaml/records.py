"""Shapes of mappings: keys with a shape each, and the choice between such mappings by one of their keys."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Collection, Mapping
from dataclasses import MISSING, dataclass, field, fields, replace
from typing import Any

from fopi_tune.spec.yaml.hints import closest, one_of, unknown_key_hint
from fopi_tune.spec.yaml.nodes import MappingNode, Node, Place, ScalarNode, kind_of
from fopi_tune.spec.yaml.scalars import is_empty
from fopi_tune.spec.yaml.shapes import Choice, JsonSchema, Shape

Values = dict[str, Any]


@dataclass(frozen=True)
class Key:
    """One key of a record, its shape and its default.

    Args:
        shape: of its value.
        required: whether it must be there.
        default: its value when it is left out, as it would be written in a file; None without a fixed one.
    """

    shape: Shape
    required: bool = True
    default: Any = None

    def json_schema(self) -> JsonSchema:
        """The value's schema, and the default."""
        return self.shape.json_schema() | ({} if self.default is None else {"default": self.default})


@dataclass(frozen=True)
class Record(Shape):
    """A mapping with known keys.

    Args:
        meaning: one sentence for people.
        keys: each key's shape, in the order they are listed to the user.
        build: makes the result from the values that are present and their place; may report problems and return None.
        example: what a user could write; shown when there is no mapping.
        elsewhere: keys that are allowed in other records, each with the reason why it is not allowed here.
        rules: JSON Schema keywords for what `build` checks beyond the single keys.
    """

    meaning: str
    keys: Mapping[str, Key]
    build: Callable[[Values, Place], Any]
    example: str
    elsewhere: Mapping[str, str] = field(default_factory=dict)
    rules: JsonSchema = field(default_factory=dict)

    def read(self, place: Place) -> Any:
        values = self.read_partial(place)
        if values is None or None in values.values():
            return None
        return self.build(values, place)

    def read_partial(self, place: Place) -> Values | None:
        """The values, None for each that is required or written but could not be read; None if there is no mapping."""
        if not expect_mapping(place, self.example):
            return None
        meant = refuse_unknown_keys(place, self.keys, self.elsewhere)
        values: Values = {}
        for name, key in self.keys.items():
            if place.has(name):
                values[name] = key.shape.read(place.child(name))
            elif key.required:
                values[name] = None
                if name not in meant:
                    place.child(name).refuse("the key is missing; add it")
        return values

    def json_schema(self) -> JsonSchema:
        return {
            "type": "object",
            "description": self.meaning,
            "properties": {name: key.json_schema() for name, key in self.keys.items()},
            "required": [name for name, key in self.keys.items() if key.required],
            "additionalProperties": False,
        } | self.rules


@dataclass(frozen=True)
class TaggedUnion(Shape):
    """A choice between records by the word at one key."""

    meaning: str
    key: str
    records: Mapping[str, Record]
    example: str

    def read(self, place: Place) -> Any:
        if not expect_mapping(place, self.example):
            return None
        if not place.has(self.key):
            meant = refuse_unknown_keys(place, _keys_of(self.records))
            if self.key not in meant:
                place.child(self.key).refuse(f"the key is missing; add it with {one_of(self.records)}")
            return None
        tag = place.child(self.key)
        word = Choice(self.meaning, self.records).read(tag)
        if word is not None:
            return self.records[word].read(place)
        # read the rest as the record that was probably meant, so that its mistakes are reported too
        meant = closest(tag.node.text, self.records) if isinstance(tag.node, ScalarNode) else None
        if meant is not None:
            self.records[meant].read_partial(place)
        return None

    def json_schema(self) -> JsonSchema:
        return {"description": self.meaning, "oneOf": [record.json_schema() for record in self.records.values()]}


@dataclass(frozen=True)
class OneKeyOf(Shape):
    """A choice between records by which key is there; exactly one of them must be.

    `records` maps that key to the record; `what` names such a key in words ("quantity"); `elsewhere` says of another
    key and its value where they belong, or None.
    """

    meaning: str
    what: str
    records: Mapping[str, Record]
    example: str
    elsewhere: Callable[[str, Node], str | None] = lambda key, value: None

    def read(self, place: Place) -> Any:
        if not expect_mapping(place, self.example):
            return None
        assert isinstance(place.node, MappingNode)
        present = [key for key in place.node.entries if key in self.records]
        if not present:
            known = _keys_of(self.records)
            reasons = {key: self.elsewhere(key, value) for key, (_, value) in place.node.entries.items()}
            elsewhere = {key: reason for key, reason in reasons.items() if reason is not None}
            # a key that is known beside another one is not reported with the unknown ones
            beside = [key for key in elsewhere if key in known]
            meant = refuse_unknown_keys(place, known, elsewhere)
            if len(beside) == len(elsewhere) and not meant & set(self.records):
                for key in beside:
                    place.child(key).refuse(elsewhere[key])
                if not beside:
                    place.refuse(f"a {self.what} is missing; write one of {', '.join(self.records)}")
            return None
        if len(present) > 1:
            line = place.node.entries[present[0]][0].line
            mark = place.node.entries[present[1]][0]
            place.collector.add(mark, place.child(present[1]).path, self._too_many(present[0], line))
            return None
        return self.records[present[0]].read(place)

    def json_schema(self) -> JsonSchema:
        return {"description": self.meaning, "oneOf": [record.json_schema() for record in self.records.values()]}

    def _too_many(self, first: str, line: int) -> str:
        return f"a second {self.what} beside {first} on line {line}; write one {self.what}, such as {self.example}"


def with_defaults_of(made: type, keys: Mapping[str, Key]) -> dict[str, Key]:
    """The keys, with the defaults of the dataclass that is made from their values; infinite defaults are left out."""
    found = {each.name: each.default for each in fields(made)}
    return {
        name: key if key.required else replace(key, default=_default_as_written(found.get(name, MISSING)))
        for name, key in keys.items()
    }


def _default_as_written(value: object) -> Any:
    """A default as it would be written in a file, or None where it cannot be."""
    if isinstance(value, tuple):
        return list(value) or None
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    return value if isinstance(value, int | str) and not isinstance(value, bool) and value != "" else None


def expect_mapping(place: Place, example: str) -> bool:
    """Whether the node is a mapping; reports if it is not."""
    node = place.node
    if isinstance(node, MappingNode):
        return True
    if isinstance(node, ScalarNode) and node.plain and is_empty(node.text):
        place.refuse(f"nothing is written here; remove the key or write a mapping such as {example}")
    elif isinstance(node, ScalarNode) and node.plain and re.search(r"\w:\S", node.text):
        place.refuse(f"{kind_of(node)} is not a mapping; a space is missing after the colon")
    else:
        place.refuse(f"{kind_of(node)} is written where a mapping belongs; write one such as {example}")
    return False


def refuse_foreign(place: Place, known: Collection[str], message: str) -> bool:
    """Whether a document has none of these keys, nor one that is meant by a misspelt one; reports that.

    It is then a file of something else, perhaps a secret: no other problem is left that would name a key of it.
    """
    entries = place.node.entries if isinstance(place.node, MappingNode) else None
    if entries is not None and (not entries or any(key in known or closest(key, known) for key in entries)):
        return False
    place.collector.problems.clear()
    place.refuse(message)
    return True


def refuse_unknown_keys(place: Place, known: Collection[str], elsewhere: Mapping[str, str] | None = None) -> set[str]:
    """Reports every key that is not known; returns the known keys that were probably meant by them."""
    assert isinstance(place.node, MappingNode)
    meant: set[str] = set()
    # a key that is present cannot be the one that was misspelt
    free = [name for name in known if not place.has(name)] or known
    for key, (mark, value) in place.node.entries.items():
        if key in known:
            continue
        path = place.child(key).path
        if elsewhere and key in elsewhere:
            place.collector.add(mark, path, elsewhere[key])
        elif key.isdigit() and isinstance(value, ScalarNode) and is_empty(value.text):
            message = "is this the rest of a number with a decimal comma? write it with a decimal point"
            place.collector.add(mark, path, message)
        else:
            hint = unknown_key_hint(key, free)
            meant |= {hint.meant} if hint.meant else set()
            place.collector.add(mark, path, hint.message)
    return meant


def _keys_of(records: Mapping[str, Record]) -> list[str]:
    return list(dict.fromkeys(key for record in records.values() for key in record.keys))
