"""Reports that several tests read:  the brake's, and one of a design that failed."""

from __future__ import annotations

from functools import cache
from typing import Any

from cases.project import CONTINUOUS

import fopi_tune as ft
from fopi_tune.report.documents import ResultDocuments, documents_of, documents_of_run
from fopi_tune.report.html import report_files
from fopi_tune.results.design import Run
from fopi_tune.spec import parse_spec

BRAKE = (CONTINUOUS / "brake.yaml").read_text(encoding="utf-8")


@cache
def run_of(text: str) -> Run:
    return ft.run(parse_spec(text), proof=False)


def brake_documents(evidence: Any = None) -> ResultDocuments:
    return documents_of_run(run_of(BRAKE), evidence)


@cache
def brake_files() -> dict[str, str | bytes]:
    return report_files(brake_documents())


def brake_page() -> str:
    page = brake_files()["report.html"]
    assert isinstance(page, str)
    return page


def without_gains(text: str = BRAKE, **said: Any) -> ResultDocuments:
    """A design that failed: a page without figures, which is made at once."""
    spec, design = parse_spec(text), brake_documents().design
    stamp = {**design["stamp"], "spec_sha256": spec.sha256}
    nothing = {"gains": None, "status": "failed", "objective": None, "stability": None, "nominal": None}
    return documents_of(spec, {**design, **nothing, "stamp": stamp, **said})
