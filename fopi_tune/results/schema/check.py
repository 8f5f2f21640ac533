"""A document against its schema:  what is stored is looked at before it is used, and the first mistake is told.

Knows the words of JSON Schema that `records` writes, and no others.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from fopi_tune.core.text_tables.words import counted
from fopi_tune.spec.yaml.problems import item_path, key_path, quoted

_TYPES: Mapping[str, tuple[type, ...]] = {
    "string": (str,),
    "boolean": (bool,),
    "integer": (int,),
    "number": (int, float),
    "null": (type(None),),
    "array": (list,),
    "object": (dict,),
}


def first_problem(document: Any, schema: Mapping[str, Any]) -> str | None:
    """The first way in which a document is not what its schema says, with its place; None where there is none.

    Args:
        document: parsed JSON.
        schema: of `records.json_schema`.
    """
    return next(_problems(document, schema, "", schema["$defs"]), None)


def _problems(value: Any, schema: Mapping[str, Any], place: str, known: Mapping[str, Any]) -> Iterator[str]:
    at = place or "the document"
    if "$ref" in schema:
        yield from _problems(value, known[schema["$ref"].rpartition("/")[2]], place, known)
    elif "anyOf" in schema:
        found = [list(_problems(value, each, place, known)) for each in schema["anyOf"]]
        if all(found):
            # of the choice that fits longest
            yield max((each[0] for each in found), key=len)
    elif "const" in schema or "enum" in schema:
        wanted = schema.get("enum", [schema.get("const")])
        if not any(value == each and isinstance(value, bool) == isinstance(each, bool) for each in wanted):
            yield f"{at} must be {' or '.join(repr(each) for each in wanted)}"
    elif not _has_type(value, schema.get("type", list(_TYPES))):
        wanted = schema["type"]
        yield f"{at} must be of type {wanted if isinstance(wanted, str) else ' or '.join(wanted)}"
    elif isinstance(value, dict):
        yield from _problems_inside(value, schema, place, known)
    elif isinstance(value, list) and "items" in schema:
        if not schema.get("minItems", 0) <= len(value) <= schema.get("maxItems", len(value)):
            yield f"{at} must have {counted(schema['minItems'], 'entry', 'entries')}"
        for index, each in enumerate(value):
            yield from _problems(each, schema["items"], item_path(place, index), known)


def _problems_inside(
    value: Mapping[str, Any], schema: Mapping[str, Any], place: str, known: Mapping[str, Any]
) -> Iterator[str]:
    at, properties = place or "the document", schema.get("properties", {})
    yield from (f"{at} has no entry {quoted(key)}" for key in schema.get("required", ()) if key not in value)
    for key, each in value.items():
        own = properties.get(key, schema.get("additionalProperties", {}))
        if own is False:
            yield f"{at} has an entry {quoted(key)} that is not known"
        else:
            yield from _problems(each, own, key_path(place, key), known)


def _has_type(value: Any, wanted: str | list[str]) -> bool:
    names = [wanted] if isinstance(wanted, str) else wanted
    # true is no number, though Python counts it as one
    return any(isinstance(value, _TYPES[name]) and (name == "boolean" or not isinstance(value, bool)) for name in names)
