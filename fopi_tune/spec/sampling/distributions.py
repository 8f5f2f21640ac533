"""The shape of `distributions:` and of `correlations:`:  how uncertain numbers are drawn.

They are read without the plant; `check_distributions` and `check_correlations` then check them against it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from fopi_tune.core.distributions.bounded import Beta, Triangular, TruncatedNormal, Uniform
from fopi_tune.core.distributions.correlation import Correlation, factor_of
from fopi_tune.core.distributions.distribution import Distribution
from fopi_tune.core.distributions.unbounded import FoldedNoise, LogNormal, Normal, NormalNoise, UniformNoise
from fopi_tune.core.parameter_table import not_uncertain
from fopi_tune.core.plant import PlantFamily, Uncertain
from fopi_tune.errors import DomainError
from fopi_tune.spec.parametric.expressions import NAME_PATTERN
from fopi_tune.spec.parametric.models import PAIR_PATTERN
from fopi_tune.spec.yaml import nodes
from fopi_tune.spec.yaml.hints import closest, one_of
from fopi_tune.spec.yaml.nodes import Place
from fopi_tune.spec.yaml.problems import key_path, quoted
from fopi_tune.spec.yaml.records import Key, OneKeyOf, Record, TaggedUnion, Values, expect_mapping
from fopi_tune.spec.yaml.scalars import is_empty
from fopi_tune.spec.yaml.shapes import Constant, JsonSchema, ListOf, Number, Pair, Shape, Text

_EXAMPLE = "{truncated_normal: {mean: 2.0, std: 0.5}}"
_NOISE_EXAMPLE = "{shape: half_normal, mean: 0.85}"
_ENDS = {"min": 1.6, "mode": 2.0, "max": 3.1}
_CORRELATION_EXAMPLE = "{numbers: [static_gain, time_constant_s], coefficient: 0.6}"


@dataclass(frozen=True)
class DistributionMapping(Shape):
    """A mapping from uncertain numbers to distributions; whether the plant has these numbers is checked later."""

    members: tuple[str, ...] = ()

    def read(self, place: Place) -> dict[str, Distribution] | None:
        if not expect_mapping(place, "{time_constant_s: " + _EXAMPLE + "}"):
            return None
        assert isinstance(place.node, nodes.MappingNode)
        found = {name: _DistributionShape().read(place.child(name)) for name in place.node.entries}
        read_partial = {name: distribution for name, distribution in found.items() if distribution is not None}
        return read_partial if len(read_partial) == len(found) else None

    def json_schema(self) -> JsonSchema:
        # a parameter's name, or the place of a number without one: denominator[0][1], poles[2].damping
        index = r"\[(?:0|[1-9][0-9]*)\]"
        before = rf"(?:(?:{'|'.join(self.members)})\.)?" if self.members else ""
        pattern = rf"^{before}(?:{NAME_PATTERN}(?:{index}){{0,2}}|(?:zeros|poles){index}\.{PAIR_PATTERN})$"
        return {
            "type": "object",
            "description": "how each uncertain number is distributed; uniform where left out",
            "properties": {},
            "patternProperties": {pattern: _DistributionShape().json_schema()},
            "additionalProperties": False,
        }


@dataclass(frozen=True)
class _DistributionShape(Shape):
    """The word uniform, or a word with its numbers."""

    def read(self, place: Place) -> Distribution | None:
        shape, node = _parametric_shape(), place.node
        if not isinstance(node, nodes.ScalarNode) or (node.plain and is_empty(node.text)):
            return shape.read(place)
        if node.text == "uniform":
            return Uniform()
        words = tuple(shape.records)
        meant = node.text if node.text in words else closest(node.text, words)
        if meant is None:
            place.refuse(f"{quoted(node.text)} is no distribution; write {one_of(words)}")
        elif meant == "uniform":
            place.refuse(f"{quoted(node.text)} is not known here; did you mean 'uniform'?")
        else:
            place.refuse(f"{meant} needs its numbers; write a mapping such as {shape.records[meant].example}")
        return None

    def json_schema(self) -> JsonSchema:
        word = {"const": "uniform", "description": "every value of the range alike"}
        return {"description": "the distribution of one number", "anyOf": [word, _parametric_shape().json_schema()]}


def _parametric_shape() -> OneKeyOf:
    inner: dict[str, tuple[Shape, str]] = {
        "uniform": (
            _ends("every value between two ends alike, whatever the range says", "min max", _uniform),
            "{uniform: {min: 2.0, max: 2.5}}",
        ),
        "triangular": (
            _ends("a density that rises to the mode and falls, whatever the range says", "min mode max", Triangular),
            "{triangular: {min: 1.6, mode: 2.0, max: 3.1}}",
        ),
        "truncated_normal": (
            _record("a normal distribution without what lies outside the range", "mean std", TruncatedNormal),
            _EXAMPLE,
        ),
        "beta": (_record("the beta distribution on the range", "a b", Beta), "{beta: {a: 2, b: 3}}"),
        "normal": (
            _record("a normal distribution, whatever the range says", "mean std clip", Normal),
            "{normal: {mean: 3.1, std: 0.3}}",
        ),
        "lognormal": (
            _lognormal(),
            "{lognormal: {mean: 2.25, std: 0.4}}",
        ),
        "nominal_plus_noise": (_noise_shape(), "{nominal_plus_noise: " + _NOISE_EXAMPLE + "}"),
    }
    records = {
        word: Record(f"the distribution {word}", {word: Key(shape)}, lambda v, place: next(iter(v.values())), example)
        for word, (shape, example) in inner.items()
    }
    return OneKeyOf("a distribution with its numbers", "distribution", records, _EXAMPLE)


def _noise_shape() -> TaggedUnion:
    records = {
        "normal": _noise("normal noise with this mean and standard deviation", "normal", "mean std", NormalNoise),
        "half_normal": _noise("one-sided: the size of normal noise about 0", "half_normal", "mean", FoldedNoise),
        "uniform": _noise("one-sided: uniform from 0 to twice its mean", "uniform", "mean", UniformNoise),
    }
    return TaggedUnion(
        "random noise on top of the nominal value; may leave the range", "shape", records, _NOISE_EXAMPLE
    )


_NUMBERS: dict[str, tuple[Shape, bool]] = {
    "mean": (Number("mean, in the number's unit"), True),
    "std": (Number("standard deviation, in the number's unit", above=0), True),
    "a": (Number("exponent at the range's lower end, plus 1", above=0), True),
    "b": (Number("exponent at the range's upper end, plus 1", above=0), True),
    "min": (Number("least value, in the number's unit"), True),
    "mode": (Number("the most likely value, in the number's unit"), True),
    "max": (Number("greatest value, in the number's unit"), True),
    "clip": (Pair("ends to which values beyond them are moved", Number("end")), False),
}


def _keys(names: str) -> dict[str, Key]:
    return {name: Key(_NUMBERS[name][0], required=_NUMBERS[name][1]) for name in names.split()}


def _record(meaning: str, names: str, make: Callable[..., Distribution]) -> Record:
    example = "{a: 2, b: 3}" if names == "a b" else "{mean: 2.0, std: 0.5}"
    return Record(meaning, _keys(names), lambda values, place: make(**values), example)


def _uniform(*, min: float, max: float) -> Uniform:
    return Uniform((min, max))


def _ends(meaning: str, names: str, make: Callable[..., Distribution]) -> Record:
    """Numbers that must be in the order of their names, ends apart."""

    def build(values: Values, place: Place) -> Distribution | None:
        if not values["min"] < values["max"]:
            place.child("max").refuse(f"{values['max']:g} is not greater than min, {values['min']:g}; write min < max")
        elif not values["min"] <= values.get("mode", values["min"]) <= values["max"]:
            place.child("mode").refuse(f"{values['mode']:g} does not lie between min and max")
        else:
            return make(**values)
        return None

    example = "{" + ", ".join(f"{name}: {value}" for name, value in _ENDS.items() if name in names.split()) + "}"
    return Record(meaning, _keys(names), build, example)


def _lognormal() -> Record:
    keys = _keys("mean std") | {"mean": Key(Number("mean of the number itself, in its unit", above=0))}
    return Record(
        "positive, its logarithm is normal, whatever the range says",
        keys,
        lambda values, place: LogNormal(**values),
        "{mean: 2.25, std: 0.4}",
    )


def _noise(meaning: str, word: str, names: str, make: Callable[..., Distribution]) -> Record:
    def build(values: Values, place: Place) -> Distribution | None:
        if "std" not in values and values["mean"] == 0.0:
            place.child("mean").refuse("one-sided noise of mean 0 is none; write its mean, or shape: normal with a std")
            return None
        return make(**{name: value for name, value in values.items() if name != "shape"})

    keys = {"shape": Key(Constant("the noise's shape", word)), **_keys(names)}
    rules: dict[str, Any] = {}
    if "std" not in keys:
        rules = {"not": {"properties": {"mean": {"const": 0}}, "required": ["mean"]}}
    return Record(meaning, keys, build, _NOISE_EXAMPLE, rules=rules)


def check_distributions(found: dict[str, Distribution], place: Place, family: PlantFamily) -> None:
    """Report distributions of numbers that the plant has not, or of which no draw is a plant.

    Args:
        found: by the number's name.
        place: of the mapping.
        family: the plants.
    """
    for name, distribution in found.items():
        if name not in family.uncertain_names:
            assert isinstance(place.node, nodes.MappingNode)
            meant = closest(name, family.uncertain_names)
            hint = f"; did you mean {meant!r}?" if meant is not None and name not in family.parameters else ""
            mark = place.node.entries[name][0]
            place.collector.add(mark, key_path(place.path, name), not_uncertain(name, family) + hint)
        elif problem := distribution.problem(family.parameters[name]) or _impossible_range(name, distribution, family):
            place.child(name).refuse(problem)


def _impossible_range(name: str, distribution: Distribution, family: PlantFamily) -> str | None:
    """Why no draw can be a plant; a model that refuses both ends of a range refuses every value between them."""
    low, high = distribution.reach(family.parameters[name])
    at_low, at_high = (family.problem(name, Uncertain.exactly(end)) for end in (low, high))
    if at_low is None or at_high is None:
        return None
    return f"draws no plant: every value from {low:.6g} to {high:.6g} {at_high}"


# -- correlations -----------------------------------------------------------------------------------------------------


def correlations_shape() -> Shape:
    """Reads to a list of `Correlation`; `check_correlations` checks them against the plant."""
    name = Text("an uncertain number's name", r"\S.*", "write the name of an uncertain number")
    keys = {
        "numbers": Key(ListOf("the two that vary together", name, 2, 2)),
        "coefficient": Key(Number("correlation of the two, as normal numbers", above=-1, below=1)),
    }
    return ListOf(
        "uncertain numbers that vary together", Record("one pair", keys, _correlation, _CORRELATION_EXAMPLE), 1
    )


def _correlation(values: Values, place: Place) -> Correlation | None:
    first, second = values["numbers"]
    if first == second:
        place.child("numbers").refuse(f"{first!r} is there twice; write two uncertain numbers")
        return None
    return Correlation((first, second), values["coefficient"])


def check_correlations(found: list[Correlation], place: Place, family: PlantFamily) -> None:
    """Report correlations of numbers that the plant has not, pairs that are there twice, and what cannot hold together.

    Args:
        found: in the order of the file.
        place: of the list.
        family: the plants.
    """
    for index, each in enumerate(found):
        for side, name in enumerate(each.numbers):
            if name not in family.uncertain_names:
                meant = closest(name, family.uncertain_names)
                hint = f"; did you mean {meant!r}?" if meant is not None and name not in family.parameters else ""
                place.item(index).child("numbers").item(side).refuse(not_uncertain(name, family) + hint)
                return
    try:
        factor_of(family.uncertain_names, found)
    except DomainError as error:
        place.refuse(str(error))
