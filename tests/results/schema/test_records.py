"""Types to JSON Schema: what of a class and its docstring becomes which words."""

from dataclasses import dataclass
from enum import StrEnum
from typing import Annotated, Literal, NotRequired, TypedDict

from fopi_tune.results.schema.records import DRAFT, FINITE, entries_told, json_schema


class Colour(StrEnum):
    RED = "red"
    BLUE = "blue"


@dataclass(frozen=True)
class Point:
    """A point.

    Args:
        x, y: m.
    """

    x: float
    y: float


class Inner(TypedDict):
    """An entry.

    Args:
        kind: what it is; a text that
            goes on.
    """

    kind: Literal["a", "b"]
    tree: NotRequired["Inner"]


class Outer(TypedDict):
    colour: Colour | None
    inner: Inner
    ends: tuple[float, float]
    points: list[Annotated[Point, FINITE]]
    numbers: dict[str, int]
    limit: float | list[float]
    version: Literal[1]


class Told:
    """What tells of another class.

    Args:
        colour: of the paint.
    """


def test_a_class_becomes_a_schema_of_fixed_keys() -> None:
    found = json_schema(Outer, "outer", {Outer: (Told,)})
    assert (found["$schema"], found["title"], found["$ref"]) == (DRAFT, "outer", "#/$defs/Outer")
    assert found["$defs"]["Inner"] == {
        "type": "object",
        "properties": {
            "kind": {"enum": ["a", "b"], "description": "what it is; a text that goes on."},
            "tree": {"$ref": "#/$defs/Inner"},
        },
        "required": ["kind"],
        "additionalProperties": False,
    }
    outer = found["$defs"]["Outer"]["properties"]
    assert outer["colour"] == {"anyOf": [{"enum": ["red", "blue"]}, {"type": "null"}], "description": "of the paint."}
    assert outer["ends"] == {"type": "array", "items": {"type": "number"}, "minItems": 2, "maxItems": 2}
    assert outer["numbers"] == {"type": "object", "additionalProperties": {"type": "integer"}}
    assert outer["limit"]["anyOf"] == [{"type": "number"}, {"type": "array", "items": {"type": "number"}}]
    assert outer["version"] == {"const": 1}


def test_numbers_of_a_dataclass_are_null_where_they_are_not_finite() -> None:
    point = json_schema(Outer, "outer", {})["$defs"]["Point"]["properties"]
    assert point["x"] == point["y"] == {"type": ["number", "null"], "description": "m."}
    assert json_schema(Point, "point", {})["$defs"]["Point"]["properties"]["x"]["type"] == "number"


def test_entries_of_a_docstring_are_read_by_name() -> None:
    assert entries_told(Point) == {"x": "m.", "y": "m."}
    assert entries_told(Outer) == {}
