"""Files that people give:  a path -> bytes, text or JSON.  Everything that the tool reads of a user goes through here.

Only regular files are opened: opening a pipe waits for a writer, and opening a device can act on it.  No message
quotes what a file holds, because a path that was typed wrong may name a binary file or a secret.
"""

from __future__ import annotations

import errno
import json
import math
import os
import re
import stat
from typing import Any

from fopi_tune.errors import DomainError
from fopi_tune.spec.yaml.problems import item_path, key_path

#: bytes of the largest JSON file that is read as a result; the largest that the tool writes is some 100 KiB
MAX_RESULT_BYTES = 16 * 1024 * 1024
#: the same of a certificate, which lists every box of a proof
MAX_CERTIFICATE_BYTES = 200_000_000
#: levels of JSON: documents of this tool have 8, and what is nested deeper would exhaust the stack
MAX_JSON_DEPTH = 32
#: digits of a whole number in JSON; a double holds numbers of up to 309
_MOST_DIGITS = 309
_KINDS = (
    (stat.S_ISFIFO, "a pipe"),
    (stat.S_ISSOCK, "a socket"),
    (stat.S_ISCHR, "a device"),
    (stat.S_ISBLK, "a device"),
)
# half of a surrogate pair, written as an escape
_SURROGATE = re.compile(r"\\u[dD][89a-fA-F]")


class NotRegularError(OSError):
    """A path that names a pipe, a socket or a device."""


def read_bytes(path: str | os.PathLike[str], limit: int) -> bytes:
    """The first `limit` + 1 bytes of a regular file: one more than allowed shows that there is more.

    Raises:
        NotRegularError: a pipe, a socket or a device, which is not opened.
        OSError: there is no such file, it is a directory, or it cannot be read.
    """
    # looked at before it is opened, and again afterwards, when the path can no longer change its meaning
    try:
        _refuse_irregular(os.stat(path), path)
    except ValueError as error:  # a NUL in the path, or characters that no path can have
        raise OSError(errno.EINVAL, str(error)) from None
    # a pipe that took the file's place in between is opened at once, and refused
    flags = os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_NOCTTY", 0) | getattr(os, "O_BINARY", 0)
    with open(os.open(path, flags | getattr(os, "O_CLOEXEC", 0)), "rb") as file:
        _refuse_irregular(os.fstat(file.fileno()), path)
        return file.read(limit + 1)


def read_text(path: str | os.PathLike[str], limit: int) -> str:
    """A file's text; a carriage return, alone or before a line feed, is a line's end.

    Raises:
        OSError: it cannot be read.
        DomainError: it is not UTF-8, or larger than `limit` bytes.
    """
    data = read_bytes(path, limit)
    if len(data) > limit:
        raise DomainError(f"is larger than the {limit // 2**20} MiB that are read; is this the right file?")
    try:
        text = data.decode("utf-8")
    except UnicodeDecodeError as error:
        line = data.count(b"\n", 0, error.start) + 1
        raise DomainError(f"line {line} has a byte that is not UTF-8; save the file as text in UTF-8") from None
    return text.replace("\r\n", "\n").replace("\r", "\n")


def read_json(path: str | os.PathLike[str], limit: int = MAX_RESULT_BYTES) -> Any:
    """A JSON file whose numbers a double holds, whose entries are there once, and whose strings are text.

    Raises:
        OSError: it cannot be read.
        DomainError: it is no such JSON; says where.
    """
    return parse_json(read_text(path, limit))


def parse_json(text: str) -> Any:
    """JSON as `read_json` reads it.

    Raises:
        DomainError: it is no such JSON; says where.
    """
    try:
        found = json.loads(text, parse_constant=_refuse_constant, parse_int=_integer, object_pairs_hook=_object)
    except json.JSONDecodeError as error:
        raise DomainError(f"is no JSON: {error.msg} (line {error.lineno}, column {error.colno})") from None
    except RecursionError:
        raise DomainError(f"is nested deeper than {MAX_JSON_DEPTH} levels; no file of this tool is") from None
    _check(found, "", MAX_JSON_DEPTH, may_hold_surrogates=_SURROGATE.search(text) is not None)
    return found


def _refuse_irregular(status: os.stat_result, path: str | os.PathLike[str]) -> None:
    if stat.S_ISDIR(status.st_mode):
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), os.fspath(path))
    for is_kind, words in _KINDS:
        if is_kind(status.st_mode):
            raise NotRegularError(errno.EINVAL, f"it is {words}, and only regular files are read", os.fspath(path))


def _refuse_constant(constant: str) -> None:
    raise DomainError(f"is no JSON: it holds {constant}, which is no number there")


def _integer(digits: str) -> int:
    count = len(digits.removeprefix("-"))
    if count > _MOST_DIGITS:
        raise DomainError(f"holds a whole number of {count} digits, which no number of this tool has")
    return int(digits)


def _object(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    found = dict(pairs)
    if len(found) < len(pairs):
        raise DomainError("names an entry twice in one object; keep one of them")
    return found


def _check(value: Any, place: str, levels: int, may_hold_surrogates: bool) -> None:
    """Refuse what JSON's grammar allows and no document of this tool holds."""
    if isinstance(value, str):
        if may_hold_surrogates and not _is_text(value):
            raise DomainError(f"{place or 'the file'} holds half of a surrogate pair, which is not text")
    elif isinstance(value, dict | list):
        if levels == 0:
            raise DomainError(f"is nested deeper than {MAX_JSON_DEPTH} levels; no file of this tool is")
        if isinstance(value, dict):
            for key, inner in value.items():
                _check(key, f"a key of {place or 'the file'}", 0, may_hold_surrogates)
                _check(inner, key_path(place, key), levels - 1, may_hold_surrogates)
        else:
            for index, inner in enumerate(value):
                _check(inner, item_path(place, index), levels - 1, may_hold_surrogates)
    elif isinstance(value, int | float) and not _is_finite(value):
        raise DomainError(f"{place or 'the file'} is a number beyond what a double holds")


def _is_text(value: str) -> bool:
    return not any("\ud800" <= c <= "\udfff" for c in value)


def _is_finite(value: float) -> bool:
    try:
        return math.isfinite(float(value))
    except OverflowError:
        return False
