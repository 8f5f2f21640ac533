"""The shape of `plants:`, a list of plants, and what specs with one cannot ask for in this version."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from fopi_tune.core.families.plant_list import PlantList, PlantMember
from fopi_tune.core.plant import PlantFamily
from fopi_tune.spec.fractional_plants.record import fractional_tag, refuse_in_list
from fopi_tune.spec.frequency_response.plants import PlacedResponses
from fopi_tune.spec.plants import plant_shape
from fopi_tune.spec.yaml.nodes import MappingNode, Place
from fopi_tune.spec.yaml.records import Key, Record, Values
from fopi_tune.spec.yaml.shapes import JsonSchema, ListOf, Number, Shape, Text

#: a controller for more plants than these is a study
MOST_PLANTS = 8
_NAME = "[A-Za-z0-9](?:[A-Za-z0-9 ._-]{0,38}[A-Za-z0-9._-])?"
_NAME_RULE = "write 1 to 40 letters, digits, spaces, '.', '_' or '-', the first a letter or digit, no space at the end"


@dataclass(frozen=True)
class _Listed:
    """A member as it is written: its family, its name where it has one, its weight, and where it stands."""

    family: PlantFamily
    name: str | None
    weight: float
    place: Place


@dataclass(frozen=True)
class PlantsShape(Shape):
    """Reads to a `PlantList`."""

    entries: ListOf

    def read(self, place: Place) -> PlantList | None:
        found: list[_Listed | None] | None = self.entries.read_partial(place)
        if found is None:
            return None
        names = [f"plant {k + 1}" if each is None or each.name is None else each.name for k, each in enumerate(found)]
        before = len(place.collector.problems)
        for k, each in enumerate(found):
            if each is not None and names[k] in names[:k]:
                line = place.item(names.index(names[k])).mark.line
                where = each.place if each.name is None else each.place.child("name")
                where.refuse(f"{names[k]!r} is the name of the plant on line {line} too; give this one another")
        listed = [each for each in found if each is not None]
        if len(place.collector.problems) > before or len(listed) < len(found):
            return None
        return PlantList.of(
            [PlantMember(name, each.family, each.weight) for name, each in zip(names, listed, strict=True)]
        )

    def json_schema(self) -> JsonSchema:
        """Every number may be an expression in shared parameters, so that a plant needs none of its own."""
        schema = self.entries.json_schema()
        models = [each for each in schema["items"]["oneOf"] if "parameters" in each["properties"]]
        optional = [each | {"required": [key for key in each["required"] if key != "parameters"]} for each in models]
        return schema | {"items": schema["items"] | {"oneOf": optional}}


def plants_shape() -> PlantsShape:
    """Reads to a `PlantList`; every entry is what `plant:` takes, with an optional name and weight."""
    meaning = "a list of plants, each with its own model and ranges; requirements hold for all of them"
    return PlantsShape(ListOf(meaning, plant_shape(_listed), 1, MOST_PLANTS))


def _listed(record: Record) -> Record:
    if record.keys["model"].shape == fractional_tag():
        record = refuse_in_list(record)
    keys = {
        "name": Key(
            Text("what messages and reports call it; plant 1, plant 2, ... where left out", _NAME, _NAME_RULE), False
        ),
        "weight": Key(Number("how often Monte Carlo draws it, relative to the others", above=0), False, 1.0),
    }

    def build(values: Values, place: Place) -> _Listed | None:
        own = {name: value for name, value in values.items() if name not in keys}
        family = record.build(own, place)
        if isinstance(family, PlacedResponses):
            place.child("model").refuse(
                "measured responses stand alone in this version; write them as plant: {model: frequency_response, "
                "files: [a.csv, b.csv]}, each file a member"
            )
            return None
        written = [name for name in keys if place.has(name)]
        if family is None or any(values.get(name) is None for name in written):
            return None
        return _Listed(family, values.get("name"), float(values.get("weight", 1.0)), place)

    return replace(record, keys={**keys, **record.keys}, build=build)


def refuse_both_words(place: Place) -> bool:
    """Whether a spec has `plant:` and `plants:`; reports it."""
    if not (place.has("plant") and place.has("plants")):
        return False
    assert isinstance(place.node, MappingNode)
    line = place.node.entries["plant"][0].line
    mark = place.node.entries["plants"][0]
    message = f"plant is written on line {line}; write plant for one family or plants for a list of them, not both"
    place.collector.add(mark, place.child("plants").path, message)
    return True


def refuse_for_lists(values: Values, measured: Sequence[object], place: Place) -> None:
    """Report what a spec with a list of plants asks for and this version cannot do."""
    objective = values.get("objective")
    if measured or (objective is not None and objective.scenario is not None):
        place.child("plants").refuse(
            "gains are designed for requirements and objectives about scenarios with one plant in this version; write "
            "plant:, or write what scenarios have to meet under `limits:`, which is judged and not designed for"
        )
    validation = place.child("validation") if place.has("validation") else None
    for key, advice in (
        ("correlations", "the numbers of a list are drawn independently"),
        ("distributions", "each is drawn uniformly over its ranges, the plants as often as `weight:` says"),
        ("samples_file", "write samples: and seed:"),
    ):
        if validation is not None and validation.has(key):
            validation.child(key).refuse(f"is for one plant: in this version, not for a list; remove it: {advice}")
