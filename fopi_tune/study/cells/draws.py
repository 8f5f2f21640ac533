"""Drawn cells:  points of the unit cube -> values of the paths under `draw`.

    linear   from + u (to - from)            log   from (to/from)^u            a list of k   its entry floor(u k)

with u in (0, 1) by the sequences of Monte Carlo (`montecarlo.sampling`): point i depends on the seed, the method, the
number of paths and i, so that a larger count goes on where a smaller one ended.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import Any

from fopi_tune.spec.yaml.nodes import MappingNode, Place
from fopi_tune.spec.yaml.records import Key, Record, Values
from fopi_tune.spec.yaml.shapes import Choice, JsonSchema, Number, PlainOrMapping, Shape
from fopi_tune.study.cells.axes import Axis, AxisValues, Scale, Span, end_keys, ends_fit_scale
from fopi_tune.study.overrides import Override

_MOST_CELLS = 10_000_000
_LARGEST_SEED = 2**64 - 1
_EXAMPLE = "{count: 200, seed: 1, method: sobol}"


class Method(StrEnum):
    """How points are chosen."""

    SOBOL = "sobol"
    RANDOM = "random"


@dataclass(frozen=True)
class Sample:
    """How many cells are drawn, and how.

    Args:
        count: of points.
        seed: the same one gives the same points; None where it is written beside.
        method: a scrambled Sobol sequence, which fills the box evenly, or independent points.
    """

    count: int
    seed: int | None = None
    method: Method = Method.SOBOL


@dataclass(frozen=True)
class DrawValues(Shape):
    """A range without steps, or a list of which each entry is as likely."""

    meaning: str

    def read(self, place: Place) -> Any:
        if isinstance(place.node, MappingNode):
            return _range().read(place)
        return AxisValues(self.meaning).read(place)

    def json_schema(self) -> JsonSchema:
        listed, _, expression = AxisValues(self.meaning).json_schema()["anyOf"]
        return {"anyOf": [listed, _range().json_schema(), expression]}


def _range() -> Record:
    steps = "is for grid and zip; in draw a range has no steps: sample says how many cells are drawn"
    return Record("a range", end_keys(), _span, "{from: 1, to: 10}", elsewhere={"steps": steps})


def _span(values: Values, place: Place) -> Span | None:
    if not ends_fit_scale(values, place):
        return None
    return Span(values["from"], values["to"], Scale(values.get("scale", Scale.LINEAR)))


def sample_shape() -> Shape:
    """The shape of `sample`: a number of cells, or a mapping."""
    keys = {
        "count": Key(_count()),
        "seed": Key(seed_shape(), required=False),
        "method": Key(Choice("how cells are drawn", [m.value for m in Method]), False, Method.SOBOL.value),
    }
    mapping = Record("cells that are drawn", keys, _sample, _EXAMPLE)
    return PlainOrMapping(_count(), mapping)


def _count() -> Number:
    return Number("how many cells are drawn", at_least=1, at_most=_MOST_CELLS, whole=True)


def seed_shape() -> Number:
    """The shape of a seed."""
    return Number("the same seed gives the same cells", at_least=0, at_most=_LARGEST_SEED, whole=True)


def _sample(values: Values, place: Place) -> Sample:
    return Sample(values["count"], values.get("seed"), Method(values.get("method", Method.SOBOL)))


def checked_sample(values: Values, place: Place) -> Sample | None:
    """The sample of a study's sections `draw`, `sample` and `seed`; None without one, or after reporting why.

    Args:
        values: of the study.
        place: of the study.
    """
    given: Sample | int | None = values.get("sample")
    if given is None:
        for key in () if place.has("sample") else ("draw", "seed"):
            if place.has(key):
                place.child(key).refuse("how many cells are to be drawn? add sample: 200")
        return None
    if not place.has("draw"):
        place.child("sample").refuse(
            "there is nothing to draw; add draw: {plant.time_constant_s.max: {from: 2, to: 5}}"
        )
    sample = given if isinstance(given, Sample) else Sample(int(given))
    if sample.seed is not None and place.has("seed"):
        place.child("seed").refuse("sample has a seed already; keep one of the two")
    seed = sample.seed if sample.seed is not None else values.get("seed")
    return Sample(sample.count, 1 if seed is None else seed, sample.method)


def drawn_overrides(axes: Sequence[Axis], sample: Sample | None) -> list[tuple[Override, ...]]:
    """The overrides of each point; one empty tuple where nothing is drawn."""
    if sample is None or not axes:
        return [()]
    from fopi_tune.montecarlo.sampling import SamplingDesign, unit_cube_points

    design = SamplingDesign(sample.method.value)
    points = unit_cube_points(design, sample.seed or 0, len(axes), 0, sample.count)
    return [tuple(axis.drawn(float(u)) for axis, u in zip(axes, point, strict=True)) for point in points]
