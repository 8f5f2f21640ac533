"""Reports:  of a run, or of the results on the disk -> files by name."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

from fopi_tune.cli.files import DESIGN, DIGITAL, EVIDENCE
from fopi_tune.cli.output import read_text

if TYPE_CHECKING:
    from fopi_tune.report.findings import Document
    from fopi_tune.spec.model import DesignSpec


def report_of(result: object, folder: Path) -> dict[str, str | bytes]:
    """The report of a run and its figures by name; of what is no run, none.

    Args:
        result: of any command.
        folder: of the results; plants that were drawn for these very gains earlier are part of the report.
    """
    from fopi_tune.result import Run

    if not isinstance(result, Run):
        return {}
    from fopi_tune.report.findings import findings_of_run
    from fopi_tune.report.html import report_files

    return report_files(findings_of_run(result, _document(folder / EVIDENCE)))


def report_again(spec: DesignSpec, folder: Path) -> dict[str, str | bytes]:
    """The same from what a run left.

    Args:
        spec: of the results.
        folder: theirs.

    Raises:
        DomainError: there is no design of this spec.
    """
    from fopi_tune.errors import DomainError
    from fopi_tune.report.findings import findings_of
    from fopi_tune.report.html import report_files

    design = _document(folder / DESIGN)
    if design is None:
        raise DomainError(f"there is no {DESIGN} to read in {folder}; make one with `fopi run`, or name its folder")
    try:
        return report_files(findings_of(spec, design, _document(folder / DIGITAL), _document(folder / EVIDENCE)))
    except (LookupError, TypeError, ValueError, AttributeError) as error:
        if isinstance(error, DomainError):
            raise
        raise DomainError(f"the results in {folder} are not as this tool writes them; run `fopi run` again") from error


def _document(path: Path) -> Document | None:
    """A result's JSON; None where there is none, or what is there is none."""
    try:
        found: Any = json.loads(read_text(path))
    except (OSError, ValueError, RecursionError):
        return None
    return found if isinstance(found, dict) else None
