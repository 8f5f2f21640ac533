"""The shape of `plant:`, generated from the registry of plant models."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from typing import Any

from fopi_tune.core.fractional_plants.family import FRACTIONAL
from fopi_tune.core.measured.family import FREQUENCY_RESPONSE
from fopi_tune.core.plant import PLANT_MODELS, PlantFamily, PlantModel, Uncertain
from fopi_tune.errors import DomainError
from fopi_tune.spec.fractional_plants.record import fractional_record
from fopi_tune.spec.frequency_response.plants import frequency_response_record
from fopi_tune.spec.parametric.models import ZEROS_POLES, parametric_record, zeros_poles_record
from fopi_tune.spec.yaml.advice import Advised, range_advice
from fopi_tune.spec.yaml.nodes import Place, ScalarNode, SequenceNode
from fopi_tune.spec.yaml.records import Key, Record, TaggedUnion, Values
from fopi_tune.spec.yaml.shapes import Constant, Converted, JsonSchema, ListOf, Number, PlainOrMapping, Shape

#: identified models have fewer coefficients, and longer polynomials are badly conditioned
MAX_COEFFICIENTS = 32
_DEAD_TIME = "dead_time_s"
#: meaning and unit of the models' scalars
_MEANINGS = {
    "static_gain": "static gain, output per control unit",
    "time_constant_s": "time constant, s",
    "gain": "gain of the pole, output per control unit and s",
    "pole_rad_s": "the pole is at -pole_rad_s, rad/s; 0 integrates, negative is unstable",
    "dead_time_s": "dead time, s",
}
_EXAMPLE = "{model: lag, static_gain: 1.0, time_constant_s: 2.0}"


def plant_shape(listed: Callable[[Record], Record] = lambda record: record) -> Shape:
    """Reads to a `PlantFamily`, of files to a `PlacedResponses`, or what `listed` makes of each model's record."""
    meaning, number = "the plant; every number of it may be uncertain", uncertain_shape("a number")
    plain = {name: listed(_model_record(model)) for name, model in PLANT_MODELS.items()}
    coefficient = uncertain_shape("what multiplies the power of s")
    plain[FRACTIONAL] = listed(fractional_record(uncertain_shape(_MEANINGS[_DEAD_TIME]), coefficient))
    zeros_poles = listed(zeros_poles_record(number, _MEANINGS))
    named = {name: listed(parametric_record(model, number, _MEANINGS)) for name, model in PLANT_MODELS.items()}
    measured = listed(frequency_response_record())
    return _Plant(
        TaggedUnion(meaning, "model", {**plain, FREQUENCY_RESPONSE: measured, ZEROS_POLES: zeros_poles}, _EXAMPLE),
        TaggedUnion(meaning, "model", {**named, ZEROS_POLES: zeros_poles}, _EXAMPLE),
    )


@dataclass(frozen=True)
class _Plant(Shape):
    """A plant by its numbers, or with `parameters` by expressions in these."""

    plain: TaggedUnion
    named: TaggedUnion

    def read(self, place: Place) -> Any:
        if isinstance(place.node, SequenceNode):
            place.refuse(
                "a list is written where one plant belongs; write plants: in place of plant: for a list of plants"
            )
            return None
        tag = place.child("model").node if place.has("model") else None
        # which has no expressions, and says so
        is_plain = not place.has("parameters") or (isinstance(tag, ScalarNode) and tag.text == FRACTIONAL)
        return (self.plain if is_plain else self.named).read(place)

    def json_schema(self) -> JsonSchema:
        plain, named = self.plain.json_schema(), self.named.json_schema()
        # zeros_poles is in both
        return plain | {"oneOf": [*plain["oneOf"], *named["oneOf"][:-1]]}


def uncertain_shape(meaning: str) -> Shape:
    """x, {min, max} or {nominal, min, max}; reads to `Uncertain`."""
    keys = {
        "nominal": Key(Number("the member nominal requirements look at; the midpoint when left out"), required=False),
        "min": Key(Number("the smallest possible value")),
        "max": Key(Number("the largest possible value")),
    }
    record = Record(f"{meaning}, known to lie in [min, max]", keys, _build_range, "{nominal: 2.0, min: 1.0, max: 3.0}")
    shape = PlainOrMapping(Converted(Number(meaning), Uncertain.exactly), record)
    return Advised(shape, range_advice(nominal=True))


def _build_range(values: Values, place: Place) -> Uncertain | None:
    low, high = values["min"], values["max"]
    if low > high:
        place.child("min").refuse(f"min {low} is greater than max {high}; swap them")
        return None
    nominal = values.get("nominal")
    if nominal is not None and not low <= nominal <= high:
        place.child("nominal").refuse(f"nominal {nominal} lies outside [{low}, {high}]; move it inside")
        return None
    return Uncertain.between(low, high) if nominal is None else Uncertain(nominal, low, high)


def _model_record(model: PlantModel) -> Record:
    keys: dict[str, Key] = {"model": Key(Constant("how the plant is written down", model.name))}
    for name in model.lists:
        entry = uncertain_shape("a coefficient")
        keys[name] = Key(ListOf(f"coefficients of the {name}, descending powers of s", entry, 1, MAX_COEFFICIENTS))
    for name in model.scalars:
        shape = uncertain_shape(_MEANINGS.get(name, name.replace("_", " ")))
        keys[name] = Key(shape, False, 0.0) if name == _DEAD_TIME else Key(shape)
    return Record(f"the plant model {model.name}", keys, partial(_build_family, model), _EXAMPLE)


def _build_family(model: PlantModel, values: Values, place: Place) -> PlantFamily | None:
    placed = list(_parameters(model, values, place))
    before = len(place.collector.problems)
    for name, number, where in placed:
        if (wrong := model.check(name, number)) is not None:
            where.refuse(wrong)
    _check_lengths(values, place)
    if len(place.collector.problems) > before:
        return None
    family = PlantFamily(model.name, {name: number for name, number, _ in placed})
    try:
        family.member(family.nominal_point)
    except DomainError as error:
        place.refuse(str(error))
        return None
    return family


def _parameters(model: PlantModel, values: Values, place: Place) -> Iterator[tuple[str, Uncertain, Place]]:
    for name in model.lists:
        for index, number in enumerate(values[name]):
            yield f"{name}[{index}]", number, place.child(name).item(index)
    for name in model.scalars:
        yield name, values.get(name, Uncertain.exactly(0.0)), place.child(name)


def _check_lengths(values: Values, place: Place) -> None:
    # rules for every transfer function N/D that is written as coefficients
    numerator, denominator = values.get("numerator"), values.get("denominator")
    if numerator is None or denominator is None:
        return
    if len(numerator) > len(denominator):
        message = "is longer than the denominator; a plant must be proper: leave leading zeros out"
        place.child("numerator").refuse(message)
    if all(number.min <= 0.0 <= number.max for number in numerator):
        place.child("numerator").refuse("can be 0 altogether, and no plant is left; keep one entry away from 0")
