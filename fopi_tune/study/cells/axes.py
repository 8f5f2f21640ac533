"""Axes of a study:  a path into the spec with its values, as a list or as a range in steps.

    {from: a, to: b, steps: n, scale: linear}     a + i (b - a)/(n - 1),   i = 0 ... n - 1, as numpy.linspace
    {from: a, to: b, steps: n, scale: log}        a (b/a)^(i/(n - 1)),     as numpy.geomspace

Both ends are exact.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from fopi_tune.spec.yaml.nodes import MappingNode, Node, Place, RejectedNode, ScalarNode, SequenceNode, kind_of
from fopi_tune.spec.yaml.problems import Mark
from fopi_tune.spec.yaml.records import Key, Record, Values, expect_mapping
from fopi_tune.spec.yaml.shapes import Choice, JsonSchema, Number, Shape
from fopi_tune.study.overrides import PATH_PATTERN, Override, parse_path

#: paths that begin with this are overrides of the spec that the gains are checked against
CHECK = "check."
#: values that begin with this are computed from others
EXPRESSION_SIGN = "="
#: most values of one range; they are made before the cells are counted
_MOST_STEPS = 100_000
#: relative error of equal ratios, which `numpy.geomspace` takes powers of 10 for
_ROUNDED = 1e-13
_RANGE_EXAMPLE = "{from: 1, to: 10, steps: 4}"
_IF_WHOLE_DRAWN = "drawn from a range; write whole numbers as a list, of which each is as likely: [10, 20, 50]"
_IF_WHOLE_IN_STEPS = "a step of a range; write steps with which every number is whole, or a list: [10, 20, 50]"
_RANGE_KEYS = ("from", "to", "steps", "scale")


class Scale(StrEnum):
    """How the values of a range are spaced."""

    LINEAR = "linear"
    LOG = "log"


@dataclass(frozen=True)
class MadeNumber(ScalarNode):
    """A number that the study makes: drawn, in steps, or by an expression.

    Args:
        if_whole: what it is, and what to write where a whole number is needed and it is none.
    """

    if_whole: str = ""


@dataclass(frozen=True)
class Span:
    """A range from which values are drawn, between two ends of which neither is one of them."""

    low: float
    high: float
    scale: Scale

    def at(self, u: float) -> float:
        """The value at u in (0, 1)."""
        if self.scale is Scale.LOG:
            return float(self.low * (self.high / self.low) ** u)
        return float(self.low + u * (self.high - self.low))


@dataclass(frozen=True)
class Axis:
    """Values for one path, in a list or in a range from which they are drawn."""

    path: str
    mark: Mark
    nodes: tuple[Node, ...]
    span: Span | None = None

    def override(self, index: int) -> Override:
        """The override with one of the values."""
        return Override(self.path, self.mark, self.nodes[index])

    def drawn(self, u: float) -> Override:
        """The override at u in (0, 1)."""
        if self.span is None:
            return self.override(min(int(u * len(self.nodes)), len(self.nodes) - 1))
        return Override(self.path, self.mark, number_node(self.span.at(u), self.mark, _IF_WHOLE_DRAWN))


@dataclass(frozen=True)
class AnyValue(Shape):
    """Any value; it is checked as part of the spec that it is put into."""

    meaning: str

    def read(self, place: Place) -> Node | None:
        return None if isinstance(place.node, RejectedNode) else place.node

    def json_schema(self) -> JsonSchema:
        return {"description": self.meaning}


@dataclass(frozen=True)
class AxisValues(Shape):
    """A list of at least one of anything, a range in steps, or one expression; reads to its nodes."""

    meaning: str

    def read(self, place: Place) -> tuple[Node, ...] | None:
        if isinstance(place.node, MappingNode) and any(place.has(key) for key in _RANGE_KEYS):
            return _range_in_steps().read(place)
        if isinstance(place.node, ScalarNode) and place.node.text.startswith(EXPRESSION_SIGN):
            return (place.node,)
        if not isinstance(place.node, SequenceNode):
            written = kind_of(place.node)
            inside = "{...}" if isinstance(place.node, MappingNode) else written.strip("'")
            place.refuse(
                f"{written} is written where a list of values belongs; write [{inside}], or a range {_RANGE_EXAMPLE}"
            )
            return None
        if not place.node.nodes:
            place.refuse("the list is empty; write at least one value, or remove the key")
            return None
        return None if any(isinstance(node, RejectedNode) for node in place.node.nodes) else place.node.nodes

    def json_schema(self) -> JsonSchema:
        listed = {"type": "array", "description": self.meaning, "items": {}, "minItems": 1}
        expression = {"type": "string", "pattern": f"^{EXPRESSION_SIGN}", "description": "one value that is computed"}
        return {"anyOf": [listed, _range_in_steps().json_schema(), expression]}


@dataclass(frozen=True)
class PathMapping(Shape):
    """A mapping from paths into the spec to values of one shape; reads to axes."""

    meaning: str
    shape: Shape

    def read(self, place: Place) -> tuple[Axis, ...] | None:
        if not expect_mapping(place, "{plant.time_constant_s.max: [2.5, 3.1]}"):
            return None
        assert isinstance(place.node, MappingNode)
        axes: list[Axis] = []
        for key, (mark, _) in place.node.entries.items():
            if parse_path(key) is None or key == CHECK[:-1]:
                message = "is no path into a spec; write one such as plant.time_constant_s.max or requirements[2].on"
                place.collector.add(mark, place.child(key).path, message)
                continue
            found = self.shape.read(place.child(key))
            if isinstance(found, Span):
                axes.append(Axis(key, mark, (), found))
            elif found is not None:
                axes.append(Axis(key, mark, found if isinstance(found, tuple) else (found,)))
        return tuple(axes) if len(axes) == len(place.node.entries) else None

    def json_schema(self) -> JsonSchema:
        return {
            "type": "object",
            "description": self.meaning,
            "patternProperties": {f"^{PATH_PATTERN}$": self.shape.json_schema()},
            "additionalProperties": False,
        }


def end_keys() -> dict[str, Key]:
    """The keys of every range: its ends and its scale."""
    return {
        "from": Key(Number("first value")),
        "to": Key(Number("last value")),
        "scale": Key(Choice("how values are spaced", [s.value for s in Scale]), False, Scale.LINEAR.value),
    }


def ends_fit_scale(values: Values, place: Place) -> bool:
    """Whether a range has two ends that its scale can space; reports if not."""
    low, high = values["from"], values["to"]
    if low == high:
        place.child("to").refuse(f"from and to are both {low:g}; write [{low:g}], or ends that differ")
    elif values.get("scale") == Scale.LOG and low * high <= 0.0:
        message = "a log scale has no way through 0; write from and to with the same sign, neither 0, or scale: linear"
        place.child("scale").refuse(message)
    else:
        return True
    return False


def number_node(value: float, mark: Mark, if_whole: str, whole: bool = False) -> MadeNumber:
    """A number as it would be written in a file; a whole one without decimal point where `whole` says so."""
    text = repr(int(value)) if whole else repr(float(value))
    return MadeNumber(mark, text, plain=True, if_whole=if_whole)


def _range_in_steps() -> Record:
    steps = Number("how many values", at_least=1, at_most=_MOST_STEPS, whole=True)
    ends = end_keys()
    keys = {"from": ends["from"], "to": ends["to"], "steps": Key(steps), "scale": ends["scale"]}
    return Record("a range in steps", keys, _values_in_steps, _RANGE_EXAMPLE)


def _values_in_steps(values: Values, place: Place) -> tuple[Node, ...] | None:
    low, high, steps = values["from"], values["to"], values["steps"]
    if not ends_fit_scale(values, place):
        return None
    spaced = np.geomspace if values.get("scale") == Scale.LOG else np.linspace
    found = spaced(low, high, steps)
    # rounded in between: the ends are what is written
    found[-1], found[0] = high, low
    # 3, 5, 7 and not 3.0, 5.0, 7.0 where the ends are written so
    written = (place.child(key).node for key in ("from", "to"))
    whole = all(isinstance(node, ScalarNode) and node.text.lstrip("+-").isdigit() for node in written)
    # equal ratios, such as 1, 2, 4, 8, are rounded
    whole = whole and bool(np.all(np.abs(found - np.rint(found)) <= _ROUNDED * np.abs(found)))
    return tuple(
        number_node(np.rint(value) if whole else value, place.mark, _IF_WHOLE_IN_STEPS, whole) for value in found
    )
