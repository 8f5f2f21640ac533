"""The models whose numbers may be expressions:  model -> the record of `plant:` with it.

    transfer_function, lag, pole    as without parameters; polynomials also as products of factors
    zeros_poles                     P(s) = gain prod (s - z) / prod (s - p) e^{-dead_time_s s}

with s^2 + 2 damping omega s + omega^2 in place of a factor of a pair of zeros or poles.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from typing import Any

from fopi_tune.core.parametric.family import ParametricFamily
from fopi_tune.core.plant import PlantModel
from fopi_tune.spec.parametric.coefficients import Written
from fopi_tune.spec.parametric.plants import family_of
from fopi_tune.spec.parametric.rational import Rational, convolved
from fopi_tune.spec.parametric.shapes import (
    MAX_COEFFICIENTS,
    Coefficient,
    Parameters,
    ParametricRecord,
    Polynomial,
)
from fopi_tune.spec.yaml.nodes import Place
from fopi_tune.spec.yaml.records import Key, Record, Values
from fopi_tune.spec.yaml.shapes import Constant, JsonSchema, ListOf, Shape

ZEROS_POLES = "zeros_poles"
_DAMPING, _NATURAL_FREQUENCY = "damping", "natural_frequency_rad_s"
#: the numbers of a pair of zeros or poles
PAIR_PATTERN = f"(?:{_DAMPING}|{_NATURAL_FREQUENCY})"
_EXAMPLE = (
    "{parameters: {k: {min: 1, max: 10}, a: {min: 1, max: 5}}, model: transfer_function, numerator: [k], "
    "denominator: [1, a]}"
)
_POSITIVE = {"lag": ("time_constant_s",)}


def parametric_record(model: PlantModel, number: Shape, meanings: Mapping[str, str]) -> Record:
    """A model's record with `parameters`.

    Args:
        model: without parameters.
        number: the shape of a number or a range.
        meanings: of the model's numbers.
    """
    keys: dict[str, Key] = {"model": _tag(model.name), "parameters": Key(Parameters(number))}
    for name in model.lists:
        coefficient = Coefficient("a coefficient", number)
        keys[name] = Key(Polynomial(f"the {name}", coefficient))
    for name in model.scalars:
        required = name != "dead_time_s"
        keys[name] = Key(Coefficient(meanings.get(name, name), number), required, None if required else 0.0)
    meaning = f"the plant model {model.name} with named parameters"
    return ParametricRecord(meaning, keys, partial(_build, model), _EXAMPLE)


def zeros_poles_record(number: Shape, meanings: Mapping[str, str]) -> Record:
    """The record of plants by zeros, poles and gain; `parameters` may be left out."""
    pair = Record(
        "a pair of zeros or poles",
        {
            _DAMPING: Key(Coefficient("its damping; negative in the right half-plane", number)),
            _NATURAL_FREQUENCY: Key(Coefficient("its natural frequency, rad/s", number)),
        },
        lambda values, place: values,
        "{damping: 0.1, natural_frequency_rad_s: 30}",
    )
    root = _Root(Coefficient("a real zero or pole, rad/s; -2 is stable", number), pair)
    keys = {
        "model": _tag(ZEROS_POLES),
        "parameters": Key(Parameters(number), required=False),
        "gain": Key(Coefficient("what multiplies the product of s - z over that of s - p", number)),
        "zeros": Key(ListOf("zeros", root, 0, MAX_COEFFICIENTS - 1), required=False),
        "poles": Key(ListOf("poles", root, 1, MAX_COEFFICIENTS - 1)),
        "dead_time_s": Key(Coefficient(meanings["dead_time_s"], number), required=False, default=0.0),
    }
    example = "{model: zeros_poles, gain: 2, zeros: [-3], poles: [-1, {damping: 0.2, natural_frequency_rad_s: 5}]}"
    return ParametricRecord("the plant by zeros, poles and gain", keys, _build_zeros_poles, example)


def _tag(word: str) -> Key:
    return Key(Constant("how the plant is written down", word))


def _build(model: PlantModel, values: Values, place: Place) -> ParametricFamily | None:
    def sides(read: Mapping[str, Rational]) -> tuple[list[Rational], list[Rational]]:
        if model.lists:
            numerator, denominator = (_polynomial(name, values[name], read) for name in model.lists)
            return numerator, denominator
        axes = next(iter(read.values())).axes
        zero = Rational.constant(axes, 0)
        made = model.assemble({name: read.get(name, zero) for name in model.scalars})
        top, bottom = ([_as_rational(each, axes) for each in side] for side in made[:2])
        return top, bottom

    return family_of(place, _without_tag(values), sides, _POSITIVE.get(model.name, ()))


def _build_zeros_poles(values: Values, place: Place) -> ParametricFamily | None:
    lists = {name: values.get(name) or [] for name in ("zeros", "poles")}
    pairs = [
        f"{name}[{k}].{_NATURAL_FREQUENCY}"
        for name, roots in lists.items()
        for k, root in enumerate(roots)
        if isinstance(root, Mapping)
    ]

    def sides(read: Mapping[str, Rational]) -> tuple[list[Rational], list[Rational]]:
        one = [Rational.constant(read["gain"].axes, 1)]
        top, bottom = (
            convolved([one, *(_factor(f"{name}[{k}]", read) for k in range(len(roots)))])
            for name, roots in lists.items()
        )
        return [read["gain"] * each for each in top], bottom

    return family_of(place, _without_tag(values), sides, pairs)


def _without_tag(values: Values) -> Values:
    return {name: value for name, value in values.items() if name != "model"}


def _as_rational(value: Any, axes: int) -> Rational:
    return value if isinstance(value, Rational) else Rational.constant(axes, value)


def _polynomial(name: str, side: Any, read: Mapping[str, Rational]) -> list[Rational]:
    """N or D from its coefficients or factors."""
    if isinstance(side[0], Written):
        return [read[f"{name}[{k}]"] for k in range(len(side))]
    return convolved([[read[f"{name}[{i}][{k}]"] for k in range(len(factor))] for i, factor in enumerate(side)])


def _factor(path: str, read: Mapping[str, Rational]) -> list[Rational]:
    """s - z of a real root z, s^2 + 2 zeta omega s + omega^2 of a pair."""
    if path in read:
        return [Rational.constant(read[path].axes, 1), -read[path]]
    damping, omega = read[f"{path}.{_DAMPING}"], read[f"{path}.{_NATURAL_FREQUENCY}"]
    two = Rational.constant(omega.axes, 2)
    return [Rational.constant(omega.axes, 1), two * damping * omega, omega * omega]


class _Root(Shape):
    """A real root, in rad/s, or a pair by its damping and natural frequency."""

    def __init__(self, coefficient: Coefficient, pair: Record) -> None:
        self.coefficient, self.pair = coefficient, pair

    def read(self, place: Place) -> Any:
        if any(place.has(key) for key in self.pair.keys):
            return self.pair.read_partial(place)  # with None for what is wrong; the plant's own check sees it
        return self.coefficient.read(place)

    def json_schema(self) -> JsonSchema:
        return {"anyOf": [*self.coefficient.json_schema()["anyOf"], self.pair.json_schema()]}
