"""The spec language as tables, made from the JSON Schema when the pages are built.

`<!-- language: spec -->` in a page stands for the sections of `fopi schema`, `system` and `study` likewise.
"""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Iterable, Iterator
from typing import Any

from sphinx.application import Sphinx

Schema = dict[str, Any]
_PLACE = re.compile(r"^<!-- language: (spec|system|study) -->$", re.MULTILINE)


def language(which: str) -> Schema:
    """The JSON Schema that `fopi schema`, `--system` or `--study` prints."""
    from fopi_tune.spec.language import json_schema
    from fopi_tune.spec.systems import system_json_schema
    from fopi_tune.study.load import study_json_schema

    makers: dict[str, Callable[[], Schema]] = {
        "spec": json_schema,
        "system": system_json_schema,
        "study": study_json_schema,
    }
    return makers[which]()


def markdown(schema: Schema, told: Iterable[str] = ()) -> str:
    """A table of the file's keys, then a section for each key that has keys of its own and is not told elsewhere."""
    parts = [_table(_rows(schema))]
    for name, value in schema["properties"].items():
        inside = [] if name in told else _section(value)
        if inside:
            parts += [f"### `{name}`", f"{_sentence(value)[:1].upper()}{_sentence(value)[1:]}.", *inside]
    return "\n\n".join(parts) + "\n"


def _section(schema: Schema) -> list[str]:
    """What there is to say of a value beyond one line."""
    if schema.get("type") == "array":
        return _section(schema["items"])
    if "oneOf" in schema:
        return _choice(schema["oneOf"])
    if schema.get("properties"):
        parts = [_table(_rows(schema))]
        for name, value in schema["properties"].items():
            inside = _section(value)
            if inside:
                parts += [f"**`{name}`**: {_sentence(value)}.", *inside]
        return parts
    pattern = next(iter(schema.get("patternProperties", {}).values()), None) or _extra(schema)
    return [] if pattern is None else _named(pattern)


def _extra(schema: Schema) -> Schema | None:
    found = schema.get("additionalProperties")
    return found if isinstance(found, dict) else None


def _named(value: Schema) -> list[str]:
    """A mapping whose keys are names of the user's: what each value is."""
    parts = [f"Each value: {_takes(value)}."] if value.get("anyOf") or value.get("oneOf") else []
    for alternative in value.get("anyOf", []):
        if "oneOf" in alternative:
            parts += _choice(alternative["oneOf"])
    return parts


def _choice(records: list[Schema]) -> list[str]:
    """Mappings of which one is taken: told apart by a word, or by which of their keys is there."""
    tag = _tag(records)
    if tag is not None:
        return [part for record in records for part in (_title(tag, record), _table(_rows(record)))]
    firsts = [next(iter(record["properties"])) for record in records]
    lines = [("Word", "Takes", "Meaning")]
    shared: dict[str, Schema] = {}
    for word, record in zip(firsts, records, strict=True):
        value = record["properties"][word]
        takes = f"a relation: {_relation_unit(value)}" if _is_relation(value) else _takes(value)
        lines.append((f"`{word}`", takes, _sentence(record) if _is_relation(value) else _sentence(value)))
        shared |= {key: each for key, each in record["properties"].items() if key != word}
    parts = ["Exactly one of these words:", _table(iter(lines))]
    parts += _relations(records, firsts)
    if shared:
        parts += ["Beside it, where it makes sense:", _table(_rows({"properties": shared, "required": []}))]
    for word, record in zip(firsts, records, strict=True):
        inside = record["properties"][word]
        if inside.get("properties") or (inside.get("oneOf") and _tag(inside["oneOf"])):
            parts += [f"**`{word}`**: {_sentence(inside)}.", *_section(inside)]
    return parts


def _title(tag: str, record: Schema) -> str:
    """The word; a plant's models are there once more with named parameters."""
    named = " with `parameters`" if "parameters" in record.get("required", []) else ""
    return f"**`{tag}: {record['properties'][tag]['const']}`**{named}"


def _is_relation(value: Schema) -> bool:
    return "relates to" in value.get("description", "")


def _relation_unit(value: Schema) -> str:
    """What the limit is given in, from the first relation's number."""
    return _sentence(next(iter(value["oneOf"][0]["properties"].values())))


def _relations(records: list[Schema], words: list[str]) -> list[str]:
    """The relations to a limit, which all the words share."""
    first = records[0]["properties"][words[0]]
    if not _is_relation(first):
        return []
    lines = [("Relation", "Takes")]
    for relation in first["oneOf"]:
        word = next(iter(relation["properties"]))
        lines.append((f"`{word}`", _takes(relation["properties"][word])))
    return ["Its value is a mapping with exactly one relation:", _table(iter(lines))]


def _tag(records: list[Schema]) -> str | None:
    """The key by whose word the records are told apart, if there is one."""
    first = records[0]["properties"]
    return next((key for key in first if all("const" in r["properties"].get(key, {}) for r in records)), None)


def _rows(schema: Schema) -> Iterator[tuple[str, ...]]:
    yield "Key", "Takes", "When left out", "Meaning"
    for name, value in schema["properties"].items():
        left_out = "required" if name in schema.get("required", []) else _default(value)
        yield f"`{name}`", _takes(value), left_out, _sentence(value)


def _default(value: Schema) -> str:
    if "default" not in value:
        return ""
    found = value["default"]
    return f"`{found if isinstance(found, str) else json.dumps(found)}`"


def _sentence(value: Schema) -> str:
    """The meaning; of a choice between a number and a range of it, the number's."""
    found = value.get("description") or next(
        (each["description"] for each in value.get("anyOf", []) if "description" in each), ""
    )
    # |L| is no end of a table's cell, and a name's underscore no emphasis
    return re.sub(r"([*_<>|])", r"\\\1", found.removesuffix(", fixed"))


def _takes(value: Schema) -> str:
    """What may be written, in words."""
    if "const" in value:
        return f"`{value['const']}`"
    if "enum" in value:
        return ", ".join(f"`{word}`" for word in value["enum"])
    alternatives = value.get("anyOf") or value.get("oneOf")
    if alternatives and alternatives[-1].get("description", "").endswith("parentheses"):
        return "number, `{nominal?, min, max}` or expression"
    if alternatives:
        return (
            " or ".join(dict.fromkeys(_takes(each) for each in alternatives))
            if len(alternatives) < 3
            else "a mapping, see below"
        )
    kind = value.get("type")
    if kind in ("number", "integer"):
        return _number(value)
    if kind == "array":
        return _list(value)
    if kind == "object":
        names = [name if name in value["required"] else f"{name}?" for name in value.get("properties", {})]
        return f"`{{{', '.join(names)}}}`" if 0 < len(names) < 4 else "a mapping"
    return "text" if kind == "string" else "any value"


def _list(value: Schema) -> str:
    least, most = value.get("minItems"), value.get("maxItems")
    if least == most == 2:
        return f"`[low, high]`, each {_takes(value['items'])}"
    count = f" ({least or 0} to {most} entries)" if most is not None else ""
    return f"list{count} of {_takes(value['items'])}"


def _number(value: Schema) -> str:
    words = {"exclusiveMinimum": "> ", "minimum": "≥ ", "exclusiveMaximum": "< ", "maximum": "≤ "}
    found = {sign: value[key] for key, sign in words.items() if key in value}
    # the largest seed has more digits than a float
    ends = [f"{sign}{end}" if isinstance(end, int) else f"{sign}{end:g}" for sign, end in found.items()]
    return " ".join(["whole number" if value["type"] == "integer" else "number", ", ".join(ends)]).strip()


def _table(rows: Iterator[tuple[str, ...]]) -> str:
    head, *body = rows
    lines = [head, tuple("---" for _ in head), *body]
    return "\n".join("| " + " | ".join(cell.strip() for cell in line) + " |" for line in lines)


def _fill(app: Sphinx, page: str, text: list[str]) -> None:
    def tables(found: re.Match[str]) -> str:
        which = found[1]
        # a system's scenarios, limits and validation are a spec's
        return markdown(
            language(which), ("plants", "parameters") if which == "spec" else language("spec")["properties"]
        )

    text[0] = _PLACE.sub(tables, text[0])


def setup(app: Sphinx) -> dict[str, Any]:
    """Fills the places in pages before they are read."""
    app.connect("source-read", _fill)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
