"""The shape of `validation:`:  how many plants are drawn, how each uncertain number is distributed, or which file lists
the plants.

The section is read in two steps.  The shape reads it without the plant; `resolve_validation` then checks it against the
plant and reads the file of samples.
"""

from __future__ import annotations

import csv
import hashlib
import io
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from fopi_tune.core.distributions import (
    Beta,
    Distribution,
    FoldedNoise,
    Normal,
    NormalNoise,
    TruncatedNormal,
    Uniform,
    UniformNoise,
)
from fopi_tune.core.parameter_table import (
    ParameterTable,
    SamplesFile,
    impossible,
    not_uncertain,
    parse_table,
    why_impossible,
)
from fopi_tune.core.plant import PlantFamily, Uncertain
from fopi_tune.errors import DomainError
from fopi_tune.spec.model import ValidationSpec
from fopi_tune.spec.parametric.expressions import NAME_PATTERN
from fopi_tune.spec.parametric.models import PAIR_PATTERN
from fopi_tune.spec.yaml import nodes
from fopi_tune.spec.yaml.hints import closest, one_of
from fopi_tune.spec.yaml.nodes import Place
from fopi_tune.spec.yaml.problems import key_path, quoted
from fopi_tune.spec.yaml.records import Key, OneKeyOf, Record, TaggedUnion, Values, expect_mapping, with_defaults_of
from fopi_tune.spec.yaml.scalars import is_empty
from fopi_tune.spec.yaml.shapes import Choice, Constant, JsonSchema, Number, Pair, Shape, Text

MAX_SAMPLES_BYTES, MAX_ROWS = 16 * 1024 * 1024, 1_000_000
#: more cells of a Latin hypercube are not resolved by floats
MAX_LATIN_HYPERCUBE = 2**26
_SAMPLING_DESIGNS = ("random", "latin_hypercube", "sobol")
_EXAMPLE = "{truncated_normal: {mean: 2.0, std: 0.5}}"
_NOISE_EXAMPLE = "{shape: half_normal, mean: 0.85}"

#: path as written in a spec -> the file's bytes; of a file that is too large, one byte more than is allowed
FileReader = Callable[[str], bytes]


class UnreadableError(Exception):
    """A file that a spec names cannot be read; the message says why and what to do."""


@dataclass(frozen=True)
class PlacedValidation:
    """What is written under `validation:`, and where."""

    values: Values
    place: Place


def validation_shape(members: tuple[str, ...] = ()) -> Record:
    """Reads to a `PlacedValidation`.

    Args:
        members: names of the families of a joint box, which stand before their numbers' names.
    """
    keys = {
        "samples": Key(
            Number(
                "plants to draw; of a samples_file its first rows, all when left out",
                at_least=1,
                at_most=10**8,
                whole=True,
            ),
            required=False,
        ),
        "seed": Key(Number("seed of the draw", at_least=0, at_most=2**63 - 1, whole=True), required=False),
        "design": Key(Choice("how the plants are spread", _SAMPLING_DESIGNS), required=False),
        "confidence": Key(Number("of the intervals", above=0.5, below=1), required=False),
        "distributions": Key(_DistributionMapping(members), required=False),
        "samples_file": Key(
            Text("CSV file of plants, one a row, beside the spec", r"\S.*", "write the path of a CSV file"),
            required=False,
        ),
    }
    beside = [{"required": [key]} for key in ("distributions", "design")]
    rules = {"not": {"required": ["samples_file"], "anyOf": beside}}
    keys = with_defaults_of(ValidationSpec, keys)
    return Record("the Monte-Carlo stage", keys, PlacedValidation, "{samples: 10000, seed: 1}", rules=rules)


def resolve_validation(placed: PlacedValidation, family: PlantFamily | None, read: FileReader) -> ValidationSpec | None:
    """The section, checked against the plant and with its file read; None after reporting problems.

    Args:
        placed: the section as it is written.
        family: the plants; None where the spec has no readable ones, and nothing is checked against them.
        read: reads the file of samples.
    """
    values, place = dict(placed.values), placed.place
    name = values.pop("samples_file", None)
    if name is not None:
        return _from_samples_file(name, values, place, family, read)
    before = len(place.collector.problems)
    if family is not None:
        _check_distributions(values.get("distributions", {}), place.child("distributions"), family)
    if values.get("design") == "latin_hypercube" and values.get("samples", 0) > MAX_LATIN_HYPERCUBE:
        message = f"a Latin hypercube has at most {MAX_LATIN_HYPERCUBE} cells; write fewer samples or another design"
        place.child("samples").refuse(message)
    return ValidationSpec(**values) if len(place.collector.problems) == before else None


# -- distributions ----------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class _DistributionMapping(Shape):
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
        words = ("uniform", *shape.records)
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
        "truncated_normal": (
            _record("a normal distribution without what lies outside the range", "mean std", TruncatedNormal),
            _EXAMPLE,
        ),
        "beta": (_record("the beta distribution on the range", "a b", Beta), "{beta: {a: 2, b: 3}}"),
        "normal": (
            _record("a normal distribution, whatever the range says", "mean std clip", Normal),
            "{normal: {mean: 3.1, std: 0.3}}",
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
    "clip": (Pair("ends to which values beyond them are moved", Number("end")), False),
}


def _keys(names: str) -> dict[str, Key]:
    return {name: Key(_NUMBERS[name][0], required=_NUMBERS[name][1]) for name in names.split()}


def _record(meaning: str, names: str, make: Callable[..., Distribution]) -> Record:
    example = "{a: 2, b: 3}" if names == "a b" else "{mean: 2.0, std: 0.5}"
    return Record(meaning, _keys(names), lambda values, place: make(**values), example)


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


def _check_distributions(found: dict[str, Distribution], place: Place, family: PlantFamily) -> None:
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


# -- a file of samples ------------------------------------------------------------------------------------------------


def _from_samples_file(
    name: str, values: Values, place: Place, family: PlantFamily | None, read: FileReader
) -> ValidationSpec | None:
    for key in ("distributions", "design"):
        if key in values:
            place.child(key).refuse("the plants are those of samples_file; remove this or samples_file")
    where = place.child("samples_file")
    try:
        data = read(name)
        if family is None:
            return None  # the plant's mistakes are reported; without it there are no names to look for
        table = _read_table(data, family)
    except (UnreadableError, DomainError) as error:
        where.refuse(str(error) if isinstance(error, UnreadableError) else f"{quoted(name)}: {error}")
        return None
    rows = len(table.rows)
    if values.get("samples", rows) > rows:
        place.child("samples").refuse(f"{quoted(name)} has {rows} rows; write at most as many, or leave samples out")
        return None
    listed = SamplesFile(name, hashlib.sha256(data).hexdigest(), table)
    plain = {key: value for key, value in values.items() if key in ("seed", "confidence")}
    return ValidationSpec(samples=values.get("samples", rows), samples_file=listed, **plain)


def _own_columns(text: str, family: PlantFamily) -> str:
    """The file's columns that are numbers of the plant, separated by commas.

    Columns may also be separated by semicolons or tabs; numbers may then have decimal commas.  Other columns are left
    out; a file without any of the plant's is returned as it is, to be refused.
    """
    header = text.partition("\n")[0]
    separator = next((mark for mark in ("\t", ";") if mark in header), ",")
    if separator != ",":
        text = text.replace(",", ".").replace(separator, ",")
    reader = csv.reader(io.StringIO(text.removeprefix("\ufeff"), newline=""))
    names = [name.strip() for name in next(reader, [])]
    kept = [i for i, name in enumerate(names) if name in family.parameters]
    if not kept or len(kept) == len(names):
        return text
    found = io.StringIO()
    writer = csv.writer(found, lineterminator="\n")
    writer.writerow(names[i] for i in kept)
    for row in reader:
        if len(row) != len(names):
            raise DomainError(f"line {reader.line_num} has {len(row)} fields; its header has {len(names)}")
        writer.writerow(row[i] for i in kept)
    return found.getvalue()


def _read_table(data: bytes, family: PlantFamily) -> ParameterTable:
    if len(data) > MAX_SAMPLES_BYTES:
        raise DomainError(f"is larger than {MAX_SAMPLES_BYTES // 2**20} MiB; keep fewer rows or digits")
    if max(data.count(b"\n"), data.count(b"\r")) > MAX_ROWS + 1:
        raise DomainError(f"has more than {MAX_ROWS} rows; keep fewer")
    try:
        text = data.decode("utf-8")
    except UnicodeDecodeError as error:
        line = data.count(b"\n", 0, error.start) + 1
        raise DomainError(f"line {line} has a byte that is not UTF-8; save the file as CSV in UTF-8") from None
    if not family.uncertain_names:
        raise DomainError("the plant has no uncertain number that a file could list; remove samples_file")
    table = parse_table(_own_columns(text, family), family.uncertain_names)
    points = table.rows[:, table.columns(family)]
    refused = impossible(points, family)
    if refused.any():
        row = int(refused.argmax())
        raise DomainError(f"line {row + 2} is no plant: {why_impossible(points[row], family)}")
    return table
