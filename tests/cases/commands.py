"""Commands in this process, as a person types them."""

from __future__ import annotations

from typer.testing import CliRunner, Result

from fopi_tune.cli import app


def fopi(*arguments: str) -> Result:
    """What `fopi` prints and ends with."""
    return CliRunner().invoke(app, list(arguments))
