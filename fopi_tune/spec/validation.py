"""The shape of `validation:`:  how many plants are drawn, how each uncertain number is distributed, or which file lists
the plants.

The section is read in two steps.  The shape reads it without the plant; `resolve_validation` then checks it against the
plant and reads the file of samples.
"""

from __future__ import annotations

import csv
import hashlib
import io
import re
from collections.abc import Callable
from dataclasses import dataclass

from fopi_tune.core.parameter_table import (
    ParameterTable,
    SamplesFile,
    impossible,
    parse_table,
    why_impossible,
)
from fopi_tune.core.plant import PlantFamily
from fopi_tune.core.text_tables.words import counted
from fopi_tune.errors import DomainError
from fopi_tune.spec.model import ValidationSpec
from fopi_tune.spec.sampling.distributions import (
    DistributionMapping,
    check_correlations,
    check_distributions,
    correlations_shape,
)
from fopi_tune.spec.yaml.nodes import Place
from fopi_tune.spec.yaml.problems import quoted
from fopi_tune.spec.yaml.records import Key, Record, Values, with_defaults_of
from fopi_tune.spec.yaml.shapes import Choice, Number, Text

MAX_SAMPLES_BYTES, MAX_ROWS = 16 * 1024 * 1024, 1_000_000
#: more cells of a Latin hypercube are not resolved by floats
MAX_LATIN_HYPERCUBE = 2**26
#: what says how plants are drawn, and has no meaning for those of a file
_DRAWN = ("distributions", "correlations", "design")
#: how a line of comment begins, above a table's header
_COMMENTS = ("#", "%", "//")
_DECIMAL_COMMA = re.compile(r"\s*[+-]?[0-9]*,[0-9]+(?:[eE][+-]?[0-9]+)?\s*")
_SAMPLING_DESIGNS = ("random", "latin_hypercube", "sobol")

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
        "distributions": Key(DistributionMapping(members), required=False),
        "correlations": Key(correlations_shape(), required=False),
        "samples_file": Key(
            Text("CSV file of plants, one a row, beside the spec", r"\S.*", "write the path of a CSV file"),
            required=False,
        ),
    }
    beside = [{"required": [key]} for key in _DRAWN]
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
        check_distributions(values.get("distributions", {}), place.child("distributions"), family)
        check_correlations(values.get("correlations", []), place.child("correlations"), family)
    if values.get("design") == "latin_hypercube" and values.get("samples", 0) > MAX_LATIN_HYPERCUBE:
        message = f"a Latin hypercube has at most {MAX_LATIN_HYPERCUBE} cells; write fewer samples or another design"
        place.child("samples").refuse(message)
    values["correlations"] = tuple(values.get("correlations", ()))
    return ValidationSpec(**values) if len(place.collector.problems) == before else None


# -- a file of samples ------------------------------------------------------------------------------------------------


def _from_samples_file(
    name: str, values: Values, place: Place, family: PlantFamily | None, read: FileReader
) -> ValidationSpec | None:
    for key in _DRAWN:
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
        place.child("samples").refuse(
            f"{quoted(name)} has {counted(rows, 'row')}; write at most as many, or leave samples out"
        )
        return None
    listed = SamplesFile(name, hashlib.sha256(data).hexdigest(), table)
    plain = {key: value for key, value in values.items() if key in ("seed", "confidence")}
    return ValidationSpec(samples=values.get("samples", rows), samples_file=listed, **plain)


def _own_columns(text: str, family: PlantFamily) -> tuple[str, int]:
    """The file's columns that are numbers of the plant, separated by commas, and how many lines stand above the header.

    Above it there may be lines of comment.  Columns may also be separated by semicolons or tabs; numbers may then have
    decimal commas.  Other columns are left out; a file without any of the plant's is returned as it is, to be refused.
    """
    text, above = text.removeprefix("\ufeff"), 0
    while text.startswith(_COMMENTS):
        text, above = text.partition("\n")[2], above + 1
    header = text.partition("\n")[0]
    separator = next((mark for mark in ("\t", ";") if mark in header), ",")
    reader = csv.reader(io.StringIO(text, newline=""), delimiter=separator)
    found = io.StringIO()
    writer = csv.writer(found, lineterminator="\n")
    try:
        names = [name.strip() for name in next(reader, [])]
        kept = [i for i, name in enumerate(names) if name in family.parameters] or list(range(len(names)))
        if separator == "," and len(kept) == len(names):
            return text, above
        writer.writerow(names[i] for i in kept)
        for row in reader:
            if len(row) != len(names):
                where = f"line {above + reader.line_num}"
                raise DomainError(f"{where} has {counted(len(row), 'field')}; its header has {len(names)}")
            fields = (row[i] for i in kept)
            writer.writerow(fields if separator == "," else map(_with_point, fields))
    except csv.Error as error:
        raise DomainError(f"line {above + reader.line_num} is not CSV: {error}") from None
    return found.getvalue(), above


def _with_point(field: str) -> str:
    """A number with a decimal point in place of its comma; other text as it is."""
    return field.replace(",", ".") if _DECIMAL_COMMA.fullmatch(field) else field


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
    columns, above = _own_columns(text, family)
    table = parse_table(columns, family.uncertain_names, above)
    points = table.rows[:, table.columns(family)]
    refused = impossible(points, family)
    if refused.any():
        row = int(refused.argmax())
        raise DomainError(f"line {above + row + 2} is no plant: {why_impossible(points[row], family)}")
    return table
