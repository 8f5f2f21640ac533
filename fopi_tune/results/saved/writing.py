"""Writing of files:  the only module that writes results, each of them at once or not at all."""

from __future__ import annotations

import contextlib
import errno
import json
import os
import secrets
from pathlib import Path

from fopi_tune.errors import DomainError


def to_json(document: object) -> str:
    """Strict JSON: NaN and infinity are errors of the tool, not output."""
    return json.dumps(document, indent=2, allow_nan=False)


def write_file(path: Path, content: str | bytes) -> None:
    """Write a file atomically, and create its folder.

    Whenever the process ends, the file is the old one or the new one.  A process killed while writing leaves a hidden
    temporary file beside it.

    Args:
        path: the file.
        content: text, written as UTF-8 with its line ends as they are, or bytes.

    Raises:
        OSError: not writable; an existing file is unchanged.
    """
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
    except FileExistsError:
        raise NotADirectoryError(errno.ENOTDIR, os.strerror(errno.ENOTDIR), str(path.parent)) from None
    data = content.encode("utf-8") if isinstance(content, str) else content
    # a random name: in a container the process id is the same in every run, and a killed run may have left its file
    temporary = path.with_name(f".{path.name}.{secrets.token_hex(8)}.tmp")
    try:
        with open(temporary, "xb") as file:
            file.write(data)
            file.flush()
            os.fsync(file.fileno())
        os.replace(temporary, path)
    except BaseException:
        with contextlib.suppress(OSError):
            temporary.unlink()
        raise


def obstacle(path: Path, error: OSError) -> str:
    """Why a file or folder cannot be written: what stands in its way, else the operating system's reason."""
    file = next((each for each in (*reversed(path.parents), path) if each.exists() and not each.is_dir()), None)
    if file is not None and isinstance(error, NotADirectoryError | FileExistsError):
        return f"{file} is a file, not a folder"
    return f"{path} is a folder" if isinstance(error, IsADirectoryError) else error.strerror or str(error)


def folder_of(given: object) -> Path:
    """The folder of results that somebody gives.

    Raises:
        DomainError: it is no path.
    """
    if not isinstance(given, str | os.PathLike) or "\0" in os.fsdecode(given):
        raise DomainError(f"{given!r} is no folder of results; give its path")
    return Path(os.fsdecode(given))
