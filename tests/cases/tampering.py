"""Changes of a JSON document, one place at a time:  every number, word, truth value, null, list and object in turn."""

from __future__ import annotations

import copy
import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

Document = dict[str, Any]
Path = tuple[str | int, ...]

#: relative changes of a number: far below what a person would see, and far above every rounding
SMALL, LARGE = 1e-9, 1e-3


@dataclass(frozen=True)
class Change:
    """One change of a document.

    Args:
        path: of the entry that is replaced; () is the document itself.
        kind: what is done, in a word or two.
        value: in the place of the old one.
    """

    path: Path
    kind: str
    value: Any

    @property
    def place(self) -> str:
        """The path without numbers of places in lists."""
        return ".".join("*" if isinstance(key, int) else key for key in self.path)

    def applied(self, document: Document) -> Document:
        """A copy of the document with the change."""
        if not self.path:
            return copy.deepcopy(self.value)
        copied = copy.deepcopy(document)
        parent = entry_of(copied, self.path[:-1])
        parent[self.path[-1]] = self.value
        return copied


def entry_of(document: Any, path: Path) -> Any:
    """The entry at a path."""
    for key in path:
        document = document[key]
    return document


def changes(document: Document, words: Sequence[Sequence[str]]) -> list[Change]:
    """Every change of a document, of each entry in several ways.

    Args:
        document: parsed JSON.
        words: sets of words; one of a set is replaced by each of the others.
    """
    every = (change for path, value in _entries(document, ()) for change in _changes_of(document, path, value, words))
    return [change for change in every if _is_other(change, entry_of(document, change.path))]


def _is_other(change: Change, old: Any) -> bool:
    """Whether the file is another; Python takes false and 0 for equal."""
    return change.value != old or type(change.value) is not type(old)


def some(changes: list[Change], count: int, seed: int) -> list[Change]:
    """A sample in which every (place, kind) has the same chance, however often a list repeats it."""
    groups: dict[tuple[str, str], list[Change]] = {}
    for change in changes:
        groups.setdefault((change.place, change.kind), []).append(change)
    rng = np.random.default_rng(seed)
    names = list(groups)
    chosen = rng.permutation(len(names))[:count]
    return [groups[names[k]][int(rng.integers(len(groups[names[k]])))] for k in chosen]


def _entries(value: Any, path: Path) -> Iterator[tuple[Path, Any]]:
    yield path, value
    if isinstance(value, dict):
        for key, item in value.items():
            yield from _entries(item, (*path, key))
    elif isinstance(value, list):
        for k, item in enumerate(value):
            yield from _entries(item, (*path, k))


def _changes_of(document: Document, path: Path, value: Any, words: Sequence[Sequence[str]]) -> Iterator[Change]:
    def to(kind: str, new: Any) -> Change:
        return Change(path, kind, new)

    if isinstance(value, dict):
        for key in value:
            yield to("key dropped", {k: v for k, v in value.items() if k != key})
        yield to("key added", {**value, "extra": 1.0})
    elif isinstance(value, list):
        yield from _list_changes(value, to)
    elif isinstance(value, bool):
        yield to("flipped", not value)
    elif isinstance(value, int | float):
        yield from _number_changes(document, path, value, to)
    elif value is None:
        for new in (0.5, 0, "", False, {}, []):
            yield to(f"filled with {new!r}", new)
    else:
        yield from _text_changes(value, words, to)


def _list_changes(value: list[Any], to: Callable[[str, Any], Change]) -> Iterator[Change]:
    for k in range(len(value)):
        yield to("item dropped", [*value[:k], *value[k + 1 :]])
        yield to("item doubled", [*value[: k + 1], *value[k:]])
        if k and value[k] != value[k - 1]:
            yield to("items swapped", [*value[: k - 1], value[k], value[k - 1], *value[k + 1 :]])
    yield to("item added", [*value, 0.5])


def _number_changes(document: Document, path: Path, value: float, to: Callable[[str, Any], Change]) -> Iterator[Change]:
    for share in (SMALL, -SMALL, LARGE, -LARGE):
        if value != 0.0:
            yield to(f"{share:+g}", value * (1.0 + share))
    yield to("sign", -value) if value != 0.0 else to("no longer 0", 1e-3)
    yield to("null", None)
    yield to("a text", "1")
    yield to("one more", value + 1)
    parent = entry_of(document, path[:-1])
    siblings = parent.items() if isinstance(parent, dict) else enumerate(parent)
    for key, other in siblings:
        number = isinstance(other, int | float) and not isinstance(other, bool)
        if key != path[-1] and number and other != value and math.isfinite(other):
            yield to("a sibling's", other)


def _text_changes(value: str, words: Sequence[Sequence[str]], to: Callable[[str, Any], Change]) -> Iterator[Change]:
    for known in words:
        if value in known:
            yield from (to("another word", word) for word in known if word != value)
    yield to("null", None)
    yield to("longer", value + "0")
    tokens = value.split(" ")
    if len(tokens) > 1:
        middle = len(tokens) // 2
        yield to("token dropped", " ".join([*tokens[:middle], *tokens[middle + 1 :]]))
        yield to("token doubled", " ".join([*tokens[:middle], *tokens[middle - 1 :]]))
        yield to("two spaces", value.replace(" ", "  ", 1))
        differ = [k for k in range(1, len(tokens)) if tokens[k] != tokens[k - 1]]
        if differ:
            k = differ[len(differ) // 2]
            yield to("tokens swapped", " ".join([*tokens[: k - 1], tokens[k], tokens[k - 1], *tokens[k + 1 :]]))
    else:
        yield to("empty", "")
