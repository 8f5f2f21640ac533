"""Bytes or text to a tree of nodes, each with its line and column.

The text is read as ruamel.yaml's stream of YAML 1.2 events.  What a spec may not contain (anchors, aliases, tags, merge
keys, a second document, more nodes or levels than the caps) is rejected during streaming, before a large or deep tree
can be built.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
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

from fopi_tune.spec.yaml.nodes import MappingNode, Node, RejectedNode, ScalarNode, SequenceNode
from fopi_tune.spec.yaml.problems import Mark, ProblemCollector, item_path, key_path
from fopi_tune.spec.yaml.syntax import CHECK, syntax_problem

MAX_DEPTH = 20
MAX_NODES = 5_000
_MERGE_KEY = "<<"

MAX_BYTES = 128 * 1024
# what YAML 1.2.2's production [1] c-printable leaves out, and U+FEFF
_NOT_PRINTABLE = re.compile("[\x00-\x08\x0b\x0c\x0e-\x1f\x7f-\x84\x86-\x9f\ud800-\udfff\ufeff\ufffe\uffff]")
_BYTE_ORDER_MARKS = {b"\xef\xbb\xbf": "UTF-8", b"\xff\xfe": "UTF-16", b"\xfe\xff": "UTF-16"}


def to_bytes(text: str | bytes, collector: ProblemCollector) -> bytes:
    """The bytes of a spec, no more than `MAX_BYTES`.

    Raises:
        SpecError: too many, or `text` holds half of a surrogate pair.
    """
    if isinstance(text, str):
        try:
            text = text.encode("utf-8")
        except UnicodeEncodeError as error:
            message = f"contains the character U+{ord(text[error.start]):04X}, which is not text; remove it"
            collector.stop(_mark_after(text[: error.start]), "", message)
    if len(text) > MAX_BYTES:
        message = f"the file is larger than {MAX_BYTES // 1024} KiB; a spec is a few KiB: is this the right file?"
        collector.stop(Mark(1, 1), "", message)
    return text


def decode(data: bytes, collector: ProblemCollector) -> str:
    """UTF-8 without byte order mark to text.

    Raises:
        SpecError: another encoding, or a control character.
    """
    for byte_order_mark, encoding in _BYTE_ORDER_MARKS.items():
        if data.startswith(byte_order_mark):
            message = f"begins with a byte order mark ({encoding}); save the file as UTF-8 without byte order mark"
            collector.stop(Mark(1, 1), "", message)
    try:
        text = data.decode("utf-8")
    except UnicodeDecodeError as error:
        before = data[: error.start].decode("utf-8")
        message = f"byte 0x{data[error.start]:02x} is not UTF-8; save the file as UTF-8"
        collector.stop(_mark_after(before), "", message)
    if bad := _NOT_PRINTABLE.search(text):
        message = f"contains the control character U+{ord(bad.group()):04X}; remove it, or save the file as UTF-8"
        collector.stop(_mark_after(text[: bad.start()]), "", message)
    return text


def _mark_after(before: str) -> Mark:
    """The position right after `before`."""
    lines = re.split("\r\n|\r|\n", before)
    return Mark(len(lines), len(lines[-1]) + 1)


def compose(text: str, collector: ProblemCollector) -> Node:
    """The one document in `text`; nodes that are not allowed are reported and replaced by a `RejectedNode`.

    Raises:
        SpecError: not YAML, over a cap, empty, or more than one document.
    """
    return _Composer(text, collector).document()


def _mark_of(mark: Any) -> Mark:
    return Mark(mark.line + 1, mark.column + 1)


class _Composer:
    def __init__(self, text: str, collector: ProblemCollector) -> None:
        self.collector = collector
        # no plug-ins: the search for them reads the disk
        self.events: Iterator[Any] = YAML(typ="safe", pure=True, plug_ins=[]).parse(text)
        self.text = text
        self.here = Mark(1, 1)
        self.last: ScalarEvent | None = None
        self.nodes = 0

    def advance(self) -> Any:
        try:
            event = next(self.events)
        except MarkedYAMLError as error:
            mark, message = syntax_problem(error, self.text, self.last)
            self.collector.stop(mark, "", message)
        # The reader is pure Python and sometimes raises other exceptions on malformed text (ValueError for
        # an escape beyond Unicode).  All of them mean that the text cannot be read.
        except Exception as error:
            reason = " ".join(str(error).split())[:160]
            self.collector.stop(self.here, "", f"not valid YAML ({reason}); {CHECK}")
        self.here = _mark_of(event.start_mark)
        self.last = event if isinstance(event, ScalarEvent) else self.last
        return event

    def document(self) -> Node:
        self.advance()  # the stream's start
        start = self.advance()
        if isinstance(start, StreamEndEvent):
            self.collector.stop(Mark(1, 1), "", "the file is empty; `fopi init` writes a spec to start from")
        if start.version not in (None, (1, 2)) or start.tags:
            self.collector.add(self.here, "", "directives (lines that begin with %) are not allowed; remove them")
        node = self.node(self.advance(), "", 1)
        self.advance()  # the document's end
        if isinstance(self.advance(), DocumentStartEvent):
            self.collector.stop(self.here, "", "a second document begins here; a spec is one: remove the line ---")
        return node

    def node(self, event: Any, path: str, depth: int) -> Node:
        mark = _mark_of(event.start_mark)
        self.check_caps(mark, path, depth)
        if isinstance(event, AliasEvent):
            self.collector.add(mark, path, "aliases (*name) are not allowed; write the value out")
            return RejectedNode(mark)
        if event.anchor is not None:
            self.collector.add(mark, path, "anchors (&name) are not allowed; remove it and write each value out")
        if event.tag is not None:
            self.collector.add(mark, path, "tags (!name) are not allowed; remove it")
        if isinstance(event, ScalarEvent):
            # escapes, doubled quotes and further lines make the text shorter or longer than what is written
            written = event.end_mark.index - event.start_mark.index - (2 if event.style else 0)
            verbatim = event.end_mark.line == event.start_mark.line and written == len(event.value)
            return ScalarNode(mark, event.value, plain=not event.style, is_verbatim=verbatim)
        if isinstance(event, SequenceStartEvent):
            return SequenceNode(mark, tuple(self.items(path, depth)))
        return MappingNode(mark, self.entries(path, depth))

    def check_caps(self, mark: Mark, path: str, depth: int) -> None:
        self.nodes += 1
        if self.nodes > MAX_NODES:
            self.collector.stop(
                mark, "", f"the spec has more than {MAX_NODES} values; split it or use fewer requirements"
            )
        if depth > MAX_DEPTH:
            # the whole path would be as long as the text is deep
            outermost = path.split(".", maxsplit=1)[0].split("[", maxsplit=1)[0]
            self.collector.stop(mark, outermost, f"nested deeper than {MAX_DEPTH} levels; a spec needs at most 6")

    def items(self, path: str, depth: int) -> Iterator[Node]:
        index = 0
        while not isinstance(event := self.advance(), SequenceEndEvent):
            yield self.node(event, item_path(path, index), depth + 1)
            index += 1

    def entries(self, path: str, depth: int) -> dict[str, tuple[Mark, Node]]:
        found: dict[str, tuple[Mark, Node]] = {}
        while not isinstance(event := self.advance(), MappingEndEvent):
            key = self.key(event, path, depth)
            # the value of an unusable key is read too, so that its own mistakes are reported
            inner = path if key is None else key_path(path, key.text)
            value = self.node(self.advance(), inner, depth + 1)
            if key is None:
                continue
            if isinstance(value, ScalarNode) and value.plain and not value.text:
                value = ScalarNode(key.mark, "", plain=True)  # an empty value: its own mark may be on the next line
            if key.text in found:
                first = found[key.text][0].line
                message = f"the key is on line {first} and again on line {key.mark.line}; keep one"
                self.collector.add(key.mark, inner, message)
                continue
            found[key.text] = (key.mark, value)
        return found

    def key(self, event: Any, path: str, depth: int) -> ScalarNode | None:
        node = self.node(event, path, depth + 1)
        if isinstance(node, RejectedNode):
            return None
        if not isinstance(node, ScalarNode):
            kind = "list" if isinstance(event, SequenceStartEvent) else "mapping"
            self.collector.add(node.mark, path, f"a {kind} is used as a key; keys are words such as `plant`")
            return None
        if node.plain and node.text == _MERGE_KEY:
            self.collector.add(node.mark, key_path(path, node.text), "merge keys are not allowed; write the keys out")
            return None
        if not node.text:
            self.collector.add(node.mark, path, "a key is missing before the colon; write one or remove the line")
            return None
        return node
