"""`--log-level` and `-v`:  what the stages log, on stderr; results and stdout are the same with and without."""

from __future__ import annotations

import logging
import sys
from enum import Enum
from typing import Annotated

import typer

#: the library's logger, whose children are its modules
LIBRARY = "fopi_tune"
_FORMAT = "%(levelname)s %(name)s: %(message)s"


class LogLevel(Enum):
    """The words of `--log-level`."""

    DEBUG = "debug"
    INFO = "info"
    WARNING = "warning"
    ERROR = "error"


LogLevelOption = Annotated[
    LogLevel | None,
    typer.Option("--log-level", case_sensitive=False, help="Log what the stages do to stderr; before the command."),
]
VerboseOption = Annotated[
    int, typer.Option("--verbose", "-v", count=True, help="The same as --log-level info; twice: debug.")
]


def show_log(context: typer.Context, level: LogLevel | None, verbose: int) -> None:
    """Show the library's log on stderr until the command has ended.

    Args:
        context: of the command line.
        level: as `--log-level` has it; None where it is not given, and `verbose` counts.
        verbose: how often `-v` is given.
    """
    if level is None:
        if not verbose:
            return
        level = LogLevel.INFO if verbose == 1 else LogLevel.DEBUG
    logger, handler = logging.getLogger(LIBRARY), logging.StreamHandler(sys.stderr)
    handler.setFormatter(logging.Formatter(_FORMAT))
    before = logger.level
    logger.addHandler(handler)
    logger.setLevel(level.name)

    def end() -> None:
        logger.removeHandler(handler)
        logger.setLevel(before)

    context.call_on_close(end)
