"""Printing and writing:  the one place of the library that does either."""

from __future__ import annotations

import contextlib
import json
import os
import secrets
import sys
import threading
import traceback
from collections.abc import Callable, Iterator
from enum import IntEnum
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

if TYPE_CHECKING:
    from rich.text import Text


#: seconds
_FIRST_WORD_S = 5.0
#: characters
_LARGEST_RESULT = 200_000_000


class Exit(IntEnum):
    """The process's exit code; of several specs the worst counts."""

    MET = 0
    NOT_MET = 1
    BAD_INPUT = 2
    TOOL_FAILED = 3


def print_out(words: object, write: Callable[..., None] = print) -> Exit:
    """Print on stdout; a reader that has gone, as in `fopi ... | head`, is no mistake."""
    try:
        write(words)
        if sys.stdout is not None:
            sys.stdout.flush()
    except OSError as error:
        # What is left in the buffer has nowhere to go: without this the interpreter would complain when it ends.
        with contextlib.suppress(OSError, ValueError):
            os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
        if not isinstance(error, BrokenPipeError):
            say(f"cannot write to stdout ({reason_of(error)})")
            return Exit.BAD_INPUT
    return Exit.MET


def print_styled(text: Text) -> Exit:
    """Print on stdout, in colour where somebody is looking who wants it."""
    plain = os.environ.get("NO_COLOR") or os.environ.get("TERM") == "dumb"
    if plain or sys.stdout is None or not sys.stdout.isatty():
        return print_out(text.plain)
    from rich.console import Console

    return print_out(text, Console(highlight=False, soft_wrap=True).print)


def say(words: str) -> None:
    """One line on stderr; control characters, as in a file's name, are shown, not obeyed."""
    line = "".join(c if c.isprintable() else repr(c)[1:-1] for c in words)
    with contextlib.suppress(OSError):
        print(line, file=sys.stderr, flush=True)


def bad_input(words: str) -> typer.Exit:
    """Says what is wrong with the command line, and ends with the code of bad input when raised."""
    say(words)
    return typer.Exit(Exit.BAD_INPUT)


def report_failure(what: str, error: Exception, debug: bool) -> Exit:
    """A bug of the tool: one line, and the traceback on demand."""
    if debug:
        print("".join(traceback.format_exception(error)), file=sys.stderr)
    hint = "please report it together with the spec" + ("" if debug else " and what --debug adds")
    say(f"{what}: internal error, {type(error).__name__}: {error}; this is a mistake of fopi-tune: {hint}")
    return Exit.TOOL_FAILED


@contextlib.contextmanager
def progress_bar(what: str, quiet: bool) -> Iterator[Callable[[int, int], None] | None]:
    """A bar on stderr with rate and time left, where somebody is looking; None elsewhere."""
    if quiet or sys.stderr is None or not sys.stderr.isatty():
        yield None
        return
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    columns = (
        TextColumn(what),
        BarColumn(),
        MofNCompleteColumn(),
        TextColumn("{task.speed:.0f}/s"),
        TimeRemainingColumn(),
    )
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task(what, total=None)

        def told(done: int, of: int) -> None:
            bar.update(task, completed=done, total=of)

        yield told


@contextlib.contextmanager
def still_running_notes(words: str, quiet: bool) -> Iterator[Callable[[], None]]:
    """A line on stderr now and then, ever more seldom, while something takes long; what is given ends it before."""
    done = threading.Event()

    def tell() -> None:
        wait = after = _FIRST_WORD_S
        while not done.wait(wait):
            say(f"{words} after {after:g} s ...")
            wait, after = after, 2 * after

    teller = threading.Thread(target=tell, daemon=True)
    if quiet:
        done.set()
    teller.start()
    try:
        yield done.set
    finally:
        done.set()
        teller.join()


def to_json(document: object) -> str:
    """Strict JSON: NaN and infinity are errors of the tool, not output."""
    return json.dumps(document, indent=2, allow_nan=False)


def reason_of(error: OSError) -> str:
    """What the operating system said."""
    return error.strerror or str(error)


def read_text(path: Path) -> str:
    """A file of results.

    Raises:
        OSError: it cannot be read.
        ValueError: it is no text, or larger than any result.
    """
    with open(path, encoding="utf-8") as file:
        text = file.read(_LARGEST_RESULT + 1)
    if len(text) > _LARGEST_RESULT:
        raise ValueError(f"{path} is larger than any result of this tool")
    return text


def read_json(path: str | Path) -> Any:
    """A JSON file; NaN, infinity and duplicate keys are errors.

    Raises:
        OSError: it cannot be read.
        ValueError: it is no such JSON.
        RecursionError: it is nested too deeply.
    """

    def refuse(constant: str) -> None:
        raise ValueError(f"{constant} is no JSON")

    def once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
        if len({key for key, _ in pairs}) < len(pairs):
            raise ValueError("an entry appears twice")
        return dict(pairs)

    return json.loads(read_text(Path(path)), parse_constant=refuse, object_pairs_hook=once)


def write_file(path: Path, content: str | bytes) -> None:
    """Write a file at once or not at all, making its folder.

    Whatever ends the process, the file is the old one or the new one.  Killed while it writes, it leaves a hidden file
    beside it that nobody reads.

    Args:
        path: the file.
        content: text, written as UTF-8 with its line ends as they are, or bytes.

    Raises:
        OSError: not writable; an existing file is unchanged.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    data = content.encode("utf-8") if isinstance(content, str) else content
    # not the process's number: in a container that is the same each time, and so would be what a killed run left
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
