"""Reports:  of a run, or of the results on the disk -> files by name."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from fopi_tune.cli.files import CERTIFICATE, CHECK, DESIGN, DIGITAL, DIGITAL_CERTIFICATE, EVIDENCE
from fopi_tune.cli.output import read_text
from fopi_tune.errors import DomainError

if TYPE_CHECKING:
    from fopi_tune.report.documents import Document, ResultDocuments
    from fopi_tune.spec.model import DesignSpec


def report_of(result: object, folder: Path) -> dict[str, str | bytes]:
    """The report of a run and its figures by name; of what is no run, none.

    Args:
        result: of any command.
        folder: of the results; plants that were drawn for these very gains earlier are part of the report.
    """
    from fopi_tune.results.design import Run

    if not isinstance(result, Run):
        return {}
    from fopi_tune.report.documents import documents_of_run
    from fopi_tune.report.html import report_files

    return report_files(documents_of_run(result, _document(folder / EVIDENCE)))


def comparison_of(named: Sequence[tuple[str, DesignSpec, Path, str]]) -> dict[str, str | bytes]:
    """Designs side by side.

    Args:
        named: of each design where it was named, its spec, the folder of its results and the file of its gains.

    Raises:
        DomainError: some result is not there, or of another spec; says which.
    """
    from fopi_tune.report.comparison_page import comparison_files

    found = []
    for source, spec, folder, file in named:
        try:
            found.append((source, _findings(spec, folder, file)))
        except DomainError as error:
            raise DomainError(f"{source}: {error}") from None
    try:
        return comparison_files(found)
    except (LookupError, TypeError, ValueError, AttributeError) as error:
        if isinstance(error, DomainError):
            raise
        raise DomainError("some of these results are not as this tool writes them; make them again") from error


def report_again(spec: DesignSpec, folder: Path) -> dict[str, str | bytes]:
    """The same from what a run left.

    Args:
        spec: of the results.
        folder: theirs.

    Raises:
        DomainError: there is no design of this spec.
    """
    from fopi_tune.report.html import report_files

    try:
        return report_files(_findings(spec, folder, DESIGN))
    except (LookupError, TypeError, ValueError, AttributeError) as error:
        if isinstance(error, DomainError):
            raise
        raise DomainError(f"the results in {folder} are not as this tool writes them; run `fopi run` again") from error


def _findings(spec: DesignSpec, folder: Path, file: str) -> ResultDocuments:
    """What a folder of results says of a spec, its gains from one of the files there."""
    from fopi_tune.report.documents import check_consistent, documents_of

    command = "fopi prove" if file == CHECK else "fopi run"
    found = _document(folder / file)
    if found is None:
        raise DomainError(f"there is no {file} to read in {folder}; make one with `{command}`, or name its folder")
    digital, evidence = _document(folder / DIGITAL), _document(folder / EVIDENCE)
    findings = documents_of(spec, found, digital, evidence, file=file, command=command)
    check_consistent(found, _document(folder / CERTIFICATE), (file, CERTIFICATE), command)
    if findings.digital is not None:
        names = (DIGITAL, DIGITAL_CERTIFICATE)
        check_consistent(findings.digital, _document(folder / DIGITAL_CERTIFICATE), names, command)
    return findings


def _document(path: Path) -> Document | None:
    """A result's JSON; None where there is none, or what is there is none."""
    try:
        found: Any = json.loads(read_text(path))
    except (OSError, ValueError, RecursionError):
        return None
    return found if isinstance(found, dict) else None
