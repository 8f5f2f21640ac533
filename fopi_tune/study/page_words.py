"""The section `report` of a study:  which figures its page has.

report:
  heat_maps: [{column: iae, x: system.hysteresis, y: system.fan.gains.kp}]
  parallel_coordinates: [system.hysteresis, system.fan.gains.kp, iae]
"""

from __future__ import annotations

from fopi_tune.spec.yaml.nodes import Place
from fopi_tune.spec.yaml.records import Key, Record, Values
from fopi_tune.spec.yaml.shapes import ListOf, Shape, Text
from fopi_tune.study.model import HeatMap, ReportRule
from fopi_tune.study.words import PlacedRule, PlacedWord, WithPlace

#: most figures of one kind, and columns of one figure
MOST_HEAT_MAPS, MOST_COLUMNS = 12, 12
_HEAT_MAP = "{column: iae, x: system.hysteresis, y: system.brake.gains.kp}"


def report_shape() -> Shape:
    """The shape of the section."""
    maps = ListOf("columns over two others", _heat_map_shape(), 1, MOST_HEAT_MAPS)
    parallel = ListOf("columns, an axis each", _column("name of a column"), 2, MOST_COLUMNS)
    keys = {"heat_maps": Key(maps, required=False), "parallel_coordinates": Key(parallel, required=False)}
    return Record("figures of the study's page; chosen where left out", keys, _report, f"{{heat_maps: [{_HEAT_MAP}]}}")


def _heat_map_shape() -> Record:
    keys = {
        "column": Key(_column("column whose numbers are colours")),
        "x": Key(_column("column along the horizontal axis")),
        "y": Key(_column("column along the vertical axis")),
    }
    return Record("a heat map", keys, _heat_map, _HEAT_MAP)


def _column(meaning: str) -> Shape:
    return WithPlace(Text(meaning))


def _heat_map(values: Values, place: Place) -> tuple[HeatMap, tuple[PlacedWord, ...]] | None:
    column, x, y = values["column"], values["x"], values["y"]
    if x.word == y.word:
        place.child("y").refuse(f"x and y are both {x.word}; write two columns")
        return None
    return HeatMap(column.word, x.word, y.word), (column, x, y)


def _report(values: Values, place: Place) -> PlacedRule[ReportRule]:
    maps: list[tuple[HeatMap, tuple[PlacedWord, ...]]] | None = values.get("heat_maps")
    axes: list[PlacedWord] | None = values.get("parallel_coordinates")
    words = [word for _, each in maps or [] for word in each] + (axes or [])
    rule = ReportRule(
        None if maps is None else tuple(each for each, _ in maps),
        None if axes is None else tuple(each.word for each in axes),
    )
    return PlacedRule(rule, tuple(words))
