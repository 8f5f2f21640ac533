"""The section `plant: {model: frequency_response}`:  its shape, and the family that its files make."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from typing import Any

from fopi_tune.core.measured.family import FREQUENCY_RESPONSE, MeasuredFamily, MeasuredMember, members_within
from fopi_tune.core.plant import PlantFamily
from fopi_tune.errors import DomainError
from fopi_tune.spec.frequency_response.reader import read_response
from fopi_tune.spec.validation import FileReader, UnreadableError
from fopi_tune.spec.yaml.nodes import Place
from fopi_tune.spec.yaml.problems import quoted
from fopi_tune.spec.yaml.records import Key, Record, Values
from fopi_tune.spec.yaml.shapes import Constant, ListOf, Number, Text

#: files of a family: each of them is nine plants where it has standard deviations
MOST_FILES = 8
#: of the plant; more than a handful is a mistake
_MOST_POLES = 20
_EXAMPLE = "{model: frequency_response, file: frf.csv, unstable_poles: 0}"
_PATH, _PATH_RULE = r"[^\x00-\x1f]{1,1000}", "write the path of a CSV file as seen from the spec's folder"


@dataclass(frozen=True)
class PlacedResponses:
    """What is written under `plant:`, and where; the files are read when the whole section is."""

    values: Values
    place: Place


def frequency_response_record() -> Record:
    """Reads to a `PlacedResponses`."""
    file = Text("a CSV file with a frequency response, its path as seen from the spec's folder", _PATH, _PATH_RULE)
    keys: dict[str, Key] = {
        "model": Key(Constant("how the plant is written down", FREQUENCY_RESPONSE)),
        "file": Key(file, required=False),
        "files": Key(ListOf("CSV files, each a member, the nominal one first", file, 1, MOST_FILES), False),
        "unstable_poles": Key(
            Number(
                "poles of the plant in the open right half-plane; without it nothing is said of stability",
                at_least=0, at_most=_MOST_POLES, whole=True,
            ),
            required=False,
        ),
        "dead_time_s": Key(Number("further dead time, not in the data, s", at_least=0.0), False, 0.0),
    }  # fmt: skip
    rules = {"oneOf": [{"required": ["file"]}, {"required": ["files"]}]}
    return Record("the plant model frequency_response", keys, _placed, _EXAMPLE, rules=rules)


def _placed(values: Values, place: Place) -> PlacedResponses | None:
    if ("file" in values) == ("files" in values):
        both = "file and files are both written; keep one of them"
        message = both if "file" in values else "a file is missing; write file: frf.csv, or files: [a.csv, b.csv]"
        (place.child("files") if "file" in values else place).refuse(message)
        return None
    names = values.get("files") or []
    doubled = next((k for k, name in enumerate(names) if name in names[:k]), None)
    if doubled is not None:
        place.child("files").item(doubled).refuse("the file is listed twice; remove one of them")
        return None
    return PlacedResponses(values, place)


def resolve_responses(placed: Any, read: FileReader) -> Any:
    """The family of a placed section, its files read; None after reporting problems.  Another plant is itself.

    Args:
        placed: what `plant:` was read to.
        read: reads the files.
    """
    if not isinstance(placed, PlacedResponses):
        return placed
    values, place = placed.values, placed.place
    single = "file" in values
    names = [values["file"]] if single else values["files"]
    labels, before = _labels(names), len(place.collector.problems)
    members: list[MeasuredMember] = []
    for k, name in enumerate(names):
        where = place.child("file") if single else place.child("files").item(k)
        try:
            found = read_response(read(name), float(values.get("dead_time_s", 0.0)))
            label = "" if single and found.gain_deviation is None else labels[k]
            members += members_within(label, found.curve, found.gain_deviation, found.phase_deviation)
        except UnreadableError as error:
            where.refuse(str(error))
        except DomainError as error:
            where.refuse(f"{quoted(name)}: {error}")
    if len(place.collector.problems) > before:
        return None
    try:
        return MeasuredFamily.of(members, values.get("unstable_poles"), names)
    except DomainError as error:
        place.child("files").refuse(str(error))
        return None


def sha256_with_data(sha256: str, family: PlantFamily) -> str:
    """The SHA-256 of a spec's text; of a measured plant that of the text's and the data's together.

    Args:
        sha256: of the text, which names the files alone.
        family: the plant.
    """
    if not isinstance(family, MeasuredFamily):
        return sha256
    return hashlib.sha256("".join([sha256, *(member.sha256 for member in family.members)]).encode()).hexdigest()


def _labels(names: list[str]) -> list[str]:
    """The members' names in reports: those of the files, with their folders where two are called the same."""
    short = [name.replace("\\", "/").rsplit("/", 1)[-1] for name in names]
    return short if len(set(short)) == len(short) else names
