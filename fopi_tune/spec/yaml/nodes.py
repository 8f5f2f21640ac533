"""YAML text to a tree of nodes that know their place.

The text is read as ruamel.yaml's stream of YAML 1.2 events, and what a spec may not contain (anchors, aliases, tags,
merge keys, a second document, anything over the caps) is refused while streaming, before a tree exists that could be
large or deep.  Scalars stay text here: what they mean is decided by the shape that reads them.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from ruamel.yaml import YAML
from ruamel.yaml.error import MarkedYAMLError
from ruamel.yaml.events import (
    AliasEvent,
    DocumentStartEvent,
    MappingEndEvent,
    ScalarEvent,
    SequenceEndEvent,
    SequenceStartEvent,
    StreamEndEvent,
)

from fopi_tune.spec.yaml.report import Mark, Report, item_path, key_path

MAX_DEPTH = 20
MAX_NODES = 5_000
_MERGE_KEY = "<<"


@dataclass(frozen=True)
class Scalar:
    """A word or number as written; `plain` means without quotes."""

    mark: Mark
    text: str
    plain: bool


@dataclass(frozen=True)
class Items:
    """A list."""

    mark: Mark
    nodes: tuple[Node, ...]


@dataclass(frozen=True)
class Table:
    """A mapping; every key once, in the order of the file."""

    mark: Mark
    entries: dict[str, tuple[Mark, Node]]


@dataclass(frozen=True)
class Refused:
    """A node that was reported already; nothing more is said about it."""

    mark: Mark


Node = Scalar | Items | Table | Refused


def compose(text: str, report: Report) -> Node:
    """The one document in `text`; what may be skipped is reported and skipped.

    Raises:
        SpecError: not YAML, over a cap, empty, or more than one document.
    """
    return _Composer(text, report).document()


def _mark(mark: Any) -> Mark:
    return Mark(mark.line + 1, mark.column + 1)


class _Composer:
    def __init__(self, text: str, report: Report) -> None:
        self.report = report
        # no plug-ins: looking for them reads the disk
        self.events: Iterator[Any] = YAML(typ="safe", pure=True, plug_ins=[]).parse(text)
        self.here = Mark(1, 1)
        self.nodes = 0

    def advance(self) -> Any:
        try:
            event = next(self.events)
        except MarkedYAMLError as error:
            place = error.problem_mark or error.context_mark
            said = ", ".join(str(part) for part in (error.context, error.problem) if part)
            self.report.stop(_mark(place) if place else self.here, "", _syntax_message(said))
        # The reader is pure Python and has been seen to leak other exceptions on malformed text (ValueError for
        # an escape beyond Unicode); for us all of them mean the same: this text cannot be read.
        except Exception as error:
            self.report.stop(self.here, "", _syntax_message(str(error)))
        self.here = _mark(event.start_mark)
        return event

    def document(self) -> Node:
        self.advance()  # the stream's start
        start = self.advance()
        if isinstance(start, StreamEndEvent):
            self.report.stop(Mark(1, 1), "", "the file is empty; `fopi init` writes a spec to start from")
        if start.version not in (None, (1, 2)) or start.tags:
            self.report.refuse(self.here, "", "directives (lines that begin with %) are not allowed; remove them")
        node = self.node(self.advance(), "", 1)
        self.advance()  # the document's end
        if isinstance(self.advance(), DocumentStartEvent):
            self.report.stop(self.here, "", "a second document begins here; a spec is one: remove the line ---")
        return node

    def node(self, event: Any, path: str, depth: int) -> Node:
        mark = _mark(event.start_mark)
        self.check_caps(mark, path, depth)
        if isinstance(event, AliasEvent):
            self.report.refuse(mark, path, "aliases (*name) are not allowed; write the value out")
            return Refused(mark)
        if event.anchor is not None:
            self.report.refuse(mark, path, "anchors (&name) are not allowed; remove it and write each value out")
        if event.tag is not None:
            self.report.refuse(mark, path, "tags (!name) are not allowed; remove it")
        if isinstance(event, ScalarEvent):
            return Scalar(mark, event.value, plain=not event.style)
        if isinstance(event, SequenceStartEvent):
            return Items(mark, tuple(self.items(path, depth)))
        return Table(mark, self.entries(path, depth))

    def check_caps(self, mark: Mark, path: str, depth: int) -> None:
        self.nodes += 1
        if self.nodes > MAX_NODES:
            self.report.stop(mark, "", f"the spec has more than {MAX_NODES} values; split it or use fewer requirements")
        if depth > MAX_DEPTH:
            # the path would be as deep as the text
            outermost = path.split(".", maxsplit=1)[0].split("[", maxsplit=1)[0]
            self.report.stop(mark, outermost, f"nested deeper than {MAX_DEPTH} levels; a spec needs at most 6")

    def items(self, path: str, depth: int) -> Iterator[Node]:
        index = 0
        while not isinstance(event := self.advance(), SequenceEndEvent):
            yield self.node(event, item_path(path, index), depth + 1)
            index += 1

    def entries(self, path: str, depth: int) -> dict[str, tuple[Mark, Node]]:
        found: dict[str, tuple[Mark, Node]] = {}
        while not isinstance(event := self.advance(), MappingEndEvent):
            key = self.key(event, path, depth)
            # an unusable key's value is read all the same, for the mistakes that are in it
            inner = path if key is None else key_path(path, key.text)
            value = self.node(self.advance(), inner, depth + 1)
            if key is None:
                continue
            if isinstance(value, Scalar) and value.plain and not value.text:
                value = Scalar(key.mark, "", plain=True)  # nothing is written: the next line's place would mislead
            if key.text in found:
                first = found[key.text][0].line
                message = f"the key is on line {first} and again on line {key.mark.line}; keep one"
                self.report.refuse(key.mark, inner, message)
                continue
            found[key.text] = (key.mark, value)
        return found

    def key(self, event: Any, path: str, depth: int) -> Scalar | None:
        node = self.node(event, path, depth + 1)
        if isinstance(node, Refused):
            return None
        if not isinstance(node, Scalar):
            kind = "list" if isinstance(event, SequenceStartEvent) else "mapping"
            self.report.refuse(node.mark, path, f"a {kind} is used as a key; keys are words such as `plant`")
            return None
        if node.plain and node.text == _MERGE_KEY:
            self.report.refuse(node.mark, key_path(path, node.text), "merge keys are not allowed; write the keys out")
            return None
        if not node.text:
            self.report.refuse(node.mark, path, "a key is missing before the colon; write one or remove the line")
            return None
        return node


def _syntax_message(said: str) -> str:
    reason = " ".join(said.split())[:160]
    if "'\\t'" in reason:
        return f"not valid YAML ({reason}); indent with spaces, not with tabs"
    return f"not valid YAML ({reason}); check the indentation, colons, quotes and brackets here"
