"""Types to JSON Schema, draft 2020-12:  a `TypedDict` or a dataclass -> what its JSON may be.

Keys, types and which of them may be left out are those of the class; descriptions are those of its docstring's `Args`.
Objects with keys of their own have no others; a mapping, as of a plant's numbers by name, has any.
"""

from __future__ import annotations

import inspect
import re
import types
from collections.abc import Mapping, Sequence
from dataclasses import fields, is_dataclass
from enum import Enum
from typing import Annotated, Any, Literal, NotRequired, Union, get_args, get_origin, get_type_hints, is_typeddict

#: marks a dataclass some of whose numbers are not finite, and null in JSON
FINITE = "null where not finite"
DRAFT = "https://json-schema.org/draft/2020-12/schema"
_PLAIN: Mapping[Any, dict[str, Any]] = {
    str: {"type": "string"},
    bool: {"type": "boolean"},
    int: {"type": "integer"},
    float: {"type": "number"},
    type(None): {"type": "null"},
    object: {},
    Any: {},
}
_ENTRY = re.compile(r"^ {4}([A-Za-z_][\w, ]*): (.*)$")


def json_schema(document: type, title: str, told_by: Mapping[type, Sequence[type]]) -> dict[str, Any]:
    """The schema of a document.

    Args:
        document: its class.
        title: of the schema.
        told_by: class of a document -> classes whose docstrings tell what its own leaves out, such as its bases, which
            a `TypedDict` does not know.
    """
    schemas = _Schemas(told_by)
    found = schemas.of(document)
    return {"$schema": DRAFT, "title": title, **found, "$defs": dict(sorted(schemas.definitions.items()))}


def entries_told(owner: type) -> dict[str, str]:
    """The entries of `Args` in a class's docstring: name to text."""
    found: dict[str, str] = {}
    text = inspect.cleandoc(owner.__doc__ or "").partition("Args:\n")[2]
    names: list[str] = []
    for line in text.splitlines():
        entry = _ENTRY.match(line)
        if entry is not None:
            names = entry[1].split(", ")
            found |= dict.fromkeys(names, entry[2])
        elif line.startswith(" " * 8):
            found |= {name: f"{found[name]} {line.strip()}" for name in names}
        elif line:
            break
    return found


class _Schemas:
    """Schemas of types, those of classes as definitions.

    Args:
        told_by: as for `json_schema`.
    """

    def __init__(self, told_by: Mapping[type, Sequence[type]]) -> None:
        self.definitions: dict[str, dict[str, Any]] = {}
        self._told_by = told_by

    def of(self, kind: Any, finite: bool = True) -> dict[str, Any]:
        """The schema of an annotation; with `finite` false a number may be null."""
        origin, inner = get_origin(kind), list[Any](get_args(kind))
        if origin is Annotated:
            return self.of(inner[0], FINITE not in inner[1:])
        if origin is Literal:
            return {"enum": list(inner)} if len(inner) > 1 else {"const": inner[0]}
        if origin in (Union, types.UnionType):
            return _any_of([self.of(each, finite) for each in inner])
        if origin is tuple and ... not in inner:
            return {"type": "array", "items": self.of(inner[0]), "minItems": len(inner), "maxItems": len(inner)}
        if origin in (list, tuple):
            return {"type": "array", "items": self.of(inner[0])}
        if origin is not None and issubclass(origin, Mapping):
            return {"type": "object", "additionalProperties": self.of(inner[1])}
        if is_typeddict(kind) or is_dataclass(kind):
            return self._record(kind, finite)
        if inspect.isclass(kind) and issubclass(kind, Enum):
            return {"enum": [each.value for each in kind]}
        if kind is float and not finite:
            return {"type": ["number", "null"]}
        return dict(_PLAIN[kind])

    def _record(self, owner: Any, finite: bool) -> dict[str, Any]:
        name = owner.__name__
        if name not in self.definitions:
            self.definitions[name] = {}
            hints, told = get_type_hints(owner, include_extras=True), self._told(owner)
            optional = getattr(owner, "__optional_keys__", frozenset())
            keys = [each.name for each in fields(owner)] if is_dataclass(owner) else list(hints)
            properties = {key: self._property(_required(hints[key]), told.get(key, ""), finite) for key in keys}
            self.definitions[name] = {
                "type": "object",
                "properties": properties,
                "required": [key for key in keys if key not in optional],
                "additionalProperties": False,
            }
        return {"$ref": f"#/$defs/{name}"}

    def _told(self, owner: type) -> dict[str, str]:
        others = [self._told(each) for each in self._told_by.get(owner, ())]
        return {key: text for each in [*others, entries_told(owner)] for key, text in each.items()}

    def _property(self, kind: Any, told: str, finite: bool) -> dict[str, Any]:
        return {**self.of(kind, finite), **({"description": told} if told else {})}


def _required(hint: Any) -> Any:
    """A key's type without the word that it may be left out."""
    return get_args(hint)[0] if get_origin(hint) is NotRequired else hint


def _any_of(choices: list[dict[str, Any]]) -> dict[str, Any]:
    """One of several; plain types in one list."""
    if all(set(each) == {"type"} and isinstance(each["type"], str) for each in choices):
        return {"type": [each["type"] for each in choices]}
    return {"anyOf": choices}
