"""The command line:  arguments, files and exit codes; nothing else in the library prints or writes to the disk.

Exit codes: 0 all requirements met, 1 not met, 2 bad input, 3 the tool failed.
"""

from fopi_tune.cli.commands import app, main

__all__ = ["app", "main"]
