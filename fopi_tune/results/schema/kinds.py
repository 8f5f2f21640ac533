"""The kinds of results:  a word of `fopi schema --result` -> the JSON Schema of what is written or printed."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from fopi_tune.results.design import Design
from fopi_tune.results.schema.certificates import CertificateDocument
from fopi_tune.results.schema.loops import (
    CheckDocument,
    ControllerParts,
    DesignDocument,
    DigitalDocument,
    OptimumParts,
    OptimumSummary,
    RunDocument,
    TradeoffDocument,
)
from fopi_tune.results.schema.optimum import OptimumDocument
from fopi_tune.results.schema.printed import (
    BestDocument,
    OptimumRecheckDocument,
    RecheckDocument,
    StudyCellsDocument,
    StudyDocument,
    StudyProgressEvent,
    StudyStatusDocument,
    SystemRecheckDocument,
)
from fopi_tune.results.schema.records import json_schema
from fopi_tune.results.schema.simulations import (
    EvidenceDocument,
    JointShare,
    JointYieldEntry,
    ScenarioYield,
    Share,
    ShareInFamily,
    SimulationDocument,
    SystemEvidenceDocument,
    SystemSimulationDocument,
)
from fopi_tune.results.schema.systems import (
    SystemCertificateDocument,
    SystemDesignDocument,
    SystemDigitalDocument,
    SystemProofDocument,
)
from fopi_tune.results.system_design import DesignedSystem


@dataclass(frozen=True)
class ResultKind:
    """A kind of JSON that the tool writes or prints.

    Args:
        document: what it holds.
        files: names of the files that hold it; none where it is printed only.
        printed_by: the command.
    """

    document: type
    files: tuple[str, ...]
    printed_by: str


#: by their words
RESULT_KINDS = {
    "design": ResultKind(DesignDocument, ("design.json",), "fopi tune --json"),
    "check": ResultKind(CheckDocument, ("check.json",), "fopi prove --json"),
    "digital": ResultKind(DigitalDocument, ("digital.json",), "fopi discretize --json"),
    "run": ResultKind(RunDocument, (), "fopi run --json"),
    "certificate": ResultKind(CertificateDocument, ("certificate.json", "digital_certificate.json"), ""),
    "optimum": ResultKind(OptimumDocument, ("optimum.json",), ""),
    "tradeoff": ResultKind(TradeoffDocument, ("tradeoff.json",), "fopi tune --tradeoff --json"),
    "evidence": ResultKind(EvidenceDocument, ("evidence.json",), "fopi validate --json"),
    "simulation": ResultKind(SimulationDocument, ("simulation.json", "exact.json"), "fopi simulate --json"),
    "system_design": ResultKind(SystemDesignDocument, ("system_design.json",), "fopi tune SYSTEM --json"),
    "system_digital": ResultKind(SystemDigitalDocument, ("system_digital.json",), "fopi discretize SYSTEM --json"),
    "system_proof": ResultKind(SystemProofDocument, ("system_proof.json",), "fopi prove SYSTEM --json"),
    "system_certificate": ResultKind(SystemCertificateDocument, ("system_certificate.json",), ""),
    "system_evidence": ResultKind(SystemEvidenceDocument, ("evidence.json",), "fopi validate SYSTEM --json"),
    "system_simulation": ResultKind(
        SystemSimulationDocument, ("simulation.json", "exact.json"), "fopi simulate SYSTEM --json"
    ),
    "recheck": ResultKind(RecheckDocument, (), "fopi prove --recheck certificate.json --json"),
    "optimum_recheck": ResultKind(OptimumRecheckDocument, (), "fopi prove --recheck optimum.json --json"),
    "system_recheck": ResultKind(SystemRecheckDocument, (), "fopi prove --recheck system_certificate.json --json"),
    "study": ResultKind(StudyDocument, (), "fopi study --json"),
    "study_cells": ResultKind(StudyCellsDocument, (), "fopi study --dry-run --json"),
    "study_status": ResultKind(StudyStatusDocument, (), "fopi study --status --json"),
    "study_progress": ResultKind(StudyProgressEvent, (), "fopi study --progress jsonl"),
    "study_best": ResultKind(BestDocument, ("best.json",), ""),
}
#: whose docstrings tell what those of documents leave out
_TOLD_BY: dict[type, tuple[type, ...]] = {
    DesignDocument: (Design,),
    RunDocument: (DesignDocument,),
    DigitalDocument: (CheckDocument, ControllerParts),
    OptimumSummary: (OptimumParts,),
    OptimumDocument: (OptimumParts,),
    ShareInFamily: (Share,),
    JointShare: (ShareInFamily,),
    ScenarioYield: (JointShare,),
    JointYieldEntry: (JointShare,),
    SystemDesignDocument: (DesignedSystem,),
}


def result_schema(kind: str) -> dict[str, Any]:
    """The JSON Schema of a kind of results, draft 2020-12.

    Args:
        kind: a key of `RESULT_KINDS`.
    """
    return json_schema(RESULT_KINDS[kind].document, f"fopi-tune result, {kind}", _TOLD_BY)
