"""Printing:  the only module of the library that does."""

from __future__ import annotations

import contextlib
import os
import re
import subprocess
import sys
import tempfile
import threading
import traceback
from collections.abc import Callable, Iterator, Mapping, Sequence
from enum import IntEnum
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from fopi_tune.results.saved.writing import write_file

if TYPE_CHECKING:
    from rich.text import Text


#: seconds until the first note
_FIRST_NOTE_S = 5.0
_COMPILES = " (compiling the search: one to two minutes, once after an installation)"


class Exit(IntEnum):
    """The process's exit code; of several specs the worst counts."""

    MET = 0
    NOT_MET = 1
    BAD_INPUT = 2
    TOOL_FAILED = 3


def print_out(message: object, write: Callable[..., None] = print) -> Exit:
    """Print on stdout; a closed pipe, as in `fopi ... | head`, is not an error."""
    try:
        write(message)
        if sys.stdout is not None:
            sys.stdout.flush()
    except OSError as error:
        # Discard what is left in the buffer: otherwise the interpreter reports the closed pipe when it ends.
        with contextlib.suppress(OSError, ValueError):
            os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
        if not isinstance(error, BrokenPipeError):
            say(f"cannot write to stdout ({reason_of(error)})")
            return Exit.BAD_INPUT
    return Exit.MET


def print_styled(text: Text) -> Exit:
    """Print on stdout; in colour on a terminal, unless NO_COLOR is set."""
    plain = os.environ.get("NO_COLOR") or os.environ.get("TERM") == "dumb"
    if plain or sys.stdout is None or not sys.stdout.isatty():
        return print_out(text.plain)
    from rich.console import Console

    return print_out(text, Console(highlight=False, soft_wrap=True).print)


def say(message: str) -> None:
    """Print one line on stderr, with options for arguments; control characters, as in a file's name, are escaped."""
    line = "".join(c if c.isprintable() else repr(c)[1:-1] for c in in_options(message))
    with contextlib.suppress(OSError):
        print(line, file=sys.stderr, flush=True)


#: argument of a function of the library, as its messages have it -> option of the command line
_OPTIONS = {
    "exact": "--exact", "solver": "--solver", "model": "--model", "points": "--points",
    "start": "--from", "stop": "--to", "start_s": "--from", "end_s": "--to",
}  # fmt: skip
_ARGUMENT = re.compile(rf"`({'|'.join(_OPTIONS)})(?:=(?:True|'(\w+)'))?`")


def in_options(message: str) -> str:
    """A message of the library for the command line:  `solver='convex'` in backquotes -> --solver convex."""
    return _ARGUMENT.sub(lambda found: f"{_OPTIONS[found[1]]} {found[2] or ''}".rstrip(), message)


def bad_input(message: str) -> typer.Exit:
    """Print what is wrong with the command line; returns the exit to raise, with the code of bad input."""
    say(message)
    return typer.Exit(Exit.BAD_INPUT)


#: module -> the distribution to install, where the names differ
_DISTRIBUTIONS = {"flint": "python-flint", "ruamel": "ruamel.yaml", "dask": "dask[distributed]"}


def report_failure(what: str, error: Exception, debug: bool) -> Exit:
    """Report a bug of the tool, or a library that is not installed: one line, and the traceback with --debug."""
    if debug:
        print("".join(traceback.format_exception(error)), file=sys.stderr)
    library = _library_of(error) if isinstance(error, ImportError) else ""
    if library:
        package = _DISTRIBUTIONS.get(library, library)
        fault, option = "is not installed", ""
        if not isinstance(error, ModuleNotFoundError):
            # it is there, and broken or of a version that lacks a name
            fault, option = f"cannot be imported ({error})", "--force-reinstall "
        say(f"{what}: this needs the library {library}, which {fault}; pip install {option}'{package}'")
        return Exit.TOOL_FAILED
    hint = "please report it together with the spec" + ("" if debug else " and what --debug adds")
    say(f"{what}: internal error, {type(error).__name__}: {error}; this is a mistake of fopi-tune: {hint}")
    return Exit.TOOL_FAILED


def _library_of(error: ImportError) -> str:
    """The library that is missing, or whose own import fails; empty where that is this package."""
    frames = (frame.f_globals.get("__name__", "") for frame, _ in traceback.walk_tb(error.__traceback__))
    within = [name.split(".")[0] for name in frames if "importlib" not in name]
    named = (error.name or "").split(".")[0]
    found = named if named or not within else within[-1]
    return "" if found == "fopi_tune" else found


@contextlib.contextmanager
def progress_bar(what: str, quiet: bool) -> Iterator[Callable[[int, int], None] | None]:
    """A progress bar on stderr with rate and time left, if stderr is a terminal; None otherwise."""
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
def _compilations() -> Iterator[list[Any]]:
    """What Numba compiles from now on, if it is loaded."""
    if "numba" not in sys.modules:
        yield []
        return
    from numba.core.event import install_recorder

    with install_recorder("numba:compile") as recorder:
        yield recorder.buffer


@contextlib.contextmanager
def still_running_notes(message: str, quiet: bool) -> Iterator[Callable[[], None]]:
    """Print notes on stderr, at growing intervals, while something takes long; the yielded function stops them."""
    done = threading.Event()

    def tell() -> None:
        wait, after = 0.5 * _FIRST_NOTE_S, _FIRST_NOTE_S
        if done.wait(wait):
            return
        with _compilations() as compiled:
            while not done.wait(wait):
                say(f"{message} after {after:g} s{_COMPILES if compiled else ''} ...")
                compiled.clear()
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


def reason_of(error: OSError) -> str:
    """The operating system's message."""
    return error.strerror or str(error)


def made_in_a_folder(command: Sequence[str], files: Mapping[str, bytes], made: str, longest_s: float) -> bytes:
    """What a program makes of files, in a folder of its own that is removed afterwards.

    Args:
        command: run in the folder, with nothing printed.
        files: what it reads, by names in the folder.
        made: name of what it writes.
        longest_s: after which it is stopped, s.

    Raises:
        OSError: the folder, the program or what it should have made is not there.
        SubprocessError: it failed, or took too long.
    """
    with tempfile.TemporaryDirectory() as folder:
        for name, content in files.items():
            write_file(Path(folder, name), content)
        subprocess.run(command, cwd=folder, capture_output=True, timeout=longest_s, check=True)
        with open(Path(folder, made), "rb") as file:
            return file.read()
