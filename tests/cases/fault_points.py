"""Commands that are killed, stopped or fail at their k-th operation on files:  `fault_points.c`, and a forking process.

A process loads the file layer's fault points, computes once, and forks for every command; the child has then only its
files to write.  What is asked for and how it ended goes through pipes, a line of JSON each.
"""

from __future__ import annotations

import contextlib
import ctypes
import errno
import io
import json
import os
import shutil
import signal
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from enum import Enum
from pathlib import Path
from typing import Any

HERE = Path(__file__).parent
COMPILER = next((name for name in ("cc", "gcc", "clang") if shutil.which(name)), None)
#: both: the dynamic linker's way to load something first, and a file's name from its descriptor
AVAILABLE = sys.platform == "linux" and COMPILER is not None


class How(Enum):
    """What happens at the k-th operation; the values are the file layer's."""

    COUNT = 0
    #: killed before it
    KILL_BEFORE = 1
    #: killed after it, or after half of what was to be written
    KILL_AMID = 2
    #: stopped before it, until another command has ended
    STOP = 3
    #: from there on there is no room
    FULL_DISK = 4
    #: all of them, as in a folder that is mounted read-only
    READ_ONLY = 5
    #: this one alone, with an error of the disk
    FAIL_ONCE = 6


@dataclass(frozen=True)
class Ended:
    """How a command ended: its exit code or the signal's negative number, its operations, and what it printed."""

    status: int
    operations: tuple[str, ...]
    out: str
    err: str


class Commands:
    """Runs commands of `fopi`, each in a fork of one process."""

    def __init__(self, process: subprocess.Popen[str]) -> None:
        self._process = process

    def run(self, *arguments: object) -> Ended:
        """Run a command undisturbed, in the process itself: what it computes is kept for all that follow."""
        return self._ask(arguments, None, 0, How.COUNT)[0]

    def disturb(self, *arguments: object, folder: Path, at: int = 0, how: How = How.COUNT) -> Ended:
        """Run a command in a child, with a fault at the at-th operation in a folder."""
        return self._ask(arguments, folder, at, how)[0]

    def run_two(self, one: Sequence[object], other: Sequence[object], folder: Path, at: int) -> tuple[Ended, Ended]:
        """Run a command, stop it before its at-th operation, run the other, and let the first go on."""
        first, second = self._ask(one, folder, at, How.STOP, other)
        return first, second

    def _ask(
        self, arguments: Sequence[object], folder: Path | None, at: int, how: How, other: Sequence[object] = ()
    ) -> list[Ended]:
        asked = {
            "arguments": [str(word) for word in arguments],
            "folder": None if folder is None else str(folder.absolute()),
            "at": at,
            "how": how.value,
            "meanwhile": [str(word) for word in other],
        }
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        assert folder is None or not os.path.islink(folder)
        print(json.dumps(asked), file=self._process.stdin, flush=True)
        answers = json.loads(self._process.stdout.readline())
        return [Ended(e["status"], tuple(e["operations"]), e["out"], e["err"]) for e in answers]


@contextlib.contextmanager
def commands(folder: Path) -> Iterator[Commands]:
    """Start the process; `folder` is for what is compiled, and where commands run."""
    assert COMPILER is not None
    library = folder / "fault_points.so"
    source = HERE / "fault_points.c"
    subprocess.run([COMPILER, "-shared", "-fPIC", "-O1", "-o", str(library), str(source), "-ldl"], check=True)
    import fopi_tune

    path = os.pathsep.join((str(HERE.parent), str(Path(fopi_tune.__file__ or "").parents[1])))
    environment = {**os.environ, "PYTHONPATH": path, "LD_PRELOAD": str(library), "OMP_NUM_THREADS": "1"}
    with subprocess.Popen(
        [sys.executable, str(HERE / "fault_points.py")],
        env=environment,
        cwd=folder,
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    ) as process:
        # which closes its input, and waits: it ends where there is nothing more to read
        yield Commands(process)


# -- the process -------------------------------------------------------------------------------------------------------


def _keep_what_is_computed() -> None:
    """Results and reports are computed once for equal input, and figures not rendered; all else runs as it is."""
    from cases.plain_figures import drawn_alone

    import fopi_tune.cli.batch
    import fopi_tune.pipeline.run
    import fopi_tune.pipeline.validate
    import fopi_tune.report.html
    import fopi_tune.report.page
    import fopi_tune.study.worker

    def keep(module: Any, name: str, key: Callable[..., object]) -> None:
        real, kept = getattr(module, name), {}

        def kept_or_computed(*given: Any, **named: Any) -> Any:
            about = key(*given, **named)
            if about not in kept:
                # the input is kept too, so that what its id says stays true
                kept[about] = real(*given, **named), given
            return kept[about][0]

        setattr(module, name, kept_or_computed)

    fopi_tune.report.page.every_form_of = drawn_alone
    keep(fopi_tune.pipeline.run, "run", lambda spec, proof: (spec.sha256, proof))
    keep(fopi_tune.pipeline.validate, "validate", lambda spec, gains, **named: (spec.sha256, gains, named["samples"]))
    keep(
        fopi_tune.report.html,
        "report_files",
        lambda found: (found.spec.sha256, json.dumps([found.design, found.digital, found.evidence])),
    )
    real_files = fopi_tune.cli.batch.files_of
    fopi_tune.cli.batch.files_of = lambda result: list(real_files(result))
    keep(fopi_tune.cli.batch, "files_of", id)
    keep(fopi_tune.study.worker, "run_cell", lambda key, cell, blocks=(): key)


def _command(arguments: Sequence[str]) -> int:
    from fopi_tune.cli import main

    sys.argv = ["fopi", *arguments]
    try:
        main()
    except SystemExit as end:
        return int(end.code or 0)
    return 0


def _forked(arguments: Sequence[str], prepare: Callable[[], object], printed: Path) -> int:
    """Start a command in a child, with its output into two files; its process id."""
    child = os.fork()
    if child:
        return child
    code = 70  # of an exception that the command line lets through
    try:
        for number, name in ((1, "out"), (2, "err")):
            os.dup2(os.open(printed / name, os.O_WRONLY | os.O_CREAT | os.O_TRUNC), number)
        prepare()
        code = _command(arguments)
        sys.stdout.flush()
    finally:
        os._exit(code)


def _answer(asked: dict[str, Any], library: ctypes.CDLL, printed: Path) -> list[dict[str, Any]]:
    if asked["folder"] is None:
        out, err = io.StringIO(), io.StringIO()
        with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
            code = _command(asked["arguments"])
        return [{"status": code, "operations": [], "out": out.getvalue(), "err": err.getvalue()}]
    arm = (os.fsencode(asked["folder"]), ctypes.c_long(asked["at"]), asked["how"], errno.EIO)

    def ended(status: int, folder: Path, operations: list[str]) -> dict[str, Any]:
        out, err = ((folder / name).read_text(encoding="utf-8", errors="replace") for name in ("out", "err"))
        code = os.waitstatus_to_exitcode(status)
        return {"status": code, "operations": operations, "out": out, "err": err}

    child = _forked(asked["arguments"], lambda: library.fault_points_arm(*arm), printed)
    answers: list[dict[str, Any]] = []
    if asked["meanwhile"]:
        _, status = os.waitpid(child, os.WUNTRACED)
        assert os.WIFSTOPPED(status), "the first command has ended before its fault point"
        inner = printed / "other"
        inner.mkdir(exist_ok=True)
        _, other = os.waitpid(_forked(asked["meanwhile"], lambda: None, inner), 0)
        answers.append(ended(other, inner, []))
        os.kill(child, signal.SIGCONT)
    _, status = os.waitpid(child, 0)
    operations = library.fault_points_listed().decode().splitlines()
    return [ended(status, printed, operations), *answers]


def serve() -> None:
    """Answer every line of standard input."""
    library = ctypes.CDLL(None)
    library.fault_points_listed.restype = ctypes.c_char_p
    # workers of a study are no part of this
    os.environ.pop("LD_PRELOAD")
    _keep_what_is_computed()
    with tempfile.TemporaryDirectory() as printed:
        for line in sys.stdin:
            answers = _answer(json.loads(line), library, Path(printed))
            sys.__stdout__.write(json.dumps(answers) + "\n")  # pyright: ignore[reportOptionalMemberAccess]
            sys.__stdout__.flush()  # pyright: ignore[reportOptionalMemberAccess]


if __name__ == "__main__":
    serve()
