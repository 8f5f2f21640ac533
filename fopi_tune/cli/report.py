"""`fopi report`:  the reports of specs made again from what `fopi run` left."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from fopi_tune.cli.files import REPORT, SPEC
from fopi_tune.cli.making import report_again
from fopi_tune.cli.output import Exit, print_out, report_failure, say
from fopi_tune.cli.process import Handling, load_each, write_each
from fopi_tune.errors import DomainError

if TYPE_CHECKING:
    from fopi_tune.spec.model import DesignSpec


def remake(files: Sequence[str], handling: Handling) -> Exit:
    """Make the report of every spec again, print where it is, and end with the worst of the exit codes.

    Args:
        files: specs, or folders of results with the specs they are of.
        handling: where results are, and what to say.
    """

    folders: dict[str, Path] = {}

    def load(file: str) -> DesignSpec:
        from fopi_tune.spec import load_spec

        if not os.path.isdir(file):
            return load_spec(file)
        spec = load_spec(Path(file, SPEC))
        folders[spec.name] = Path(file)
        return spec

    specs, code = load_each(files, load, handling)
    for spec in specs:
        handling.note(f"{spec.name}: reporting ...")
        folder = folders.get(spec.name) if handling.out is None else None
        code = max(code, _one(spec, folder or handling.folder(spec), handling))
    return code


def _one(spec: DesignSpec, folder: Path, handling: Handling) -> Exit:
    try:
        made = report_again(spec, folder)
    except DomainError as error:
        say(f"{spec.name}: {error}")
        return Exit.BAD_INPUT
    except Exception as error:
        return report_failure(spec.name, error, handling.debug)
    code = write_each(folder, list(made.items()), spec.name, handling)
    return code if code is not Exit.MET else print_out(folder / REPORT)
