"""Files of an HTML report:  a run, or results read from a folder -> file name to content."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from fopi_tune.cli.output import say
from fopi_tune.errors import CertificateError, DomainError
from fopi_tune.results.saved.names import (
    CERTIFICATE,
    CHECK,
    DESIGN,
    DIGITAL,
    DIGITAL_CERTIFICATE,
    EVIDENCE,
    SIMULATION,
    SYSTEM_CERTIFICATE,
    SYSTEM_PROOF,
)
from fopi_tune.results.saved.writing import obstacle

if TYPE_CHECKING:
    from fopi_tune.proof.switched import SystemCertificate
    from fopi_tune.report.documents import Document, ResultDocuments
    from fopi_tune.report.system_page import SystemRuns
    from fopi_tune.spec.model import DesignSpec, SystemSpec


#: kind of a result that states a system's gains -> its file, and the command that writes it
_SYSTEM_RESULTS = {
    "system_proof": (SYSTEM_PROOF, "prove"),
    "system_evidence": (EVIDENCE, "validate"),
    "system_simulation": (f"{SIMULATION}.json", "simulate"),
}


@dataclass(frozen=True)
class Made:
    """Pages made from files.

    Args:
        files: by file name.
        left_out: of each result that is there and is no part of them, why; sentences without a full stop.
    """

    files: dict[str, str | bytes]
    left_out: tuple[str, ...]


def report_of_run(result: object, folder: Path) -> dict[str, str | bytes]:
    """The report of a run and its figures, by file name; empty for other results.

    Args:
        result: of any command.
        folder: of the results; an earlier validation of the same gains in it becomes part of the report, unless it
            cannot be used, which is said.
    """
    from fopi_tune.results.design import Run

    if not isinstance(result, Run):
        return {}
    from fopi_tune.report.documents import documents_of_run
    from fopi_tune.report.html import report_files

    try:
        documents = documents_of_run(result, _read_document(folder / EVIDENCE))
    except DomainError as error:
        say(f"{result.spec.name}: {error}; the report leaves it out")
        documents = documents_of_run(result)
    return report_files(documents)


def comparison_of(named: Sequence[tuple[str, DesignSpec, Path, str]]) -> Made:
    """The page that compares designs.

    Args:
        named: of each design where it was named, its spec, the folder of its results and the file of its gains.

    Raises:
        DomainError: some result is not there, or of another spec; says which.
    """
    from fopi_tune.report.comparison_page import comparison_files

    found, left_out = [], list[str]()
    for source, spec, folder, file in named:
        try:
            found.append((source, _read_findings(spec, folder, file)))
        except DomainError as error:
            raise DomainError(f"{source}: {error}") from None
        left_out += (f"{source}: {why}" for why in _left_out(found[-1][1], folder))
    return Made(comparison_files(found), tuple(left_out))


def report_from_folder(spec: DesignSpec, folder: Path) -> Made:
    """The report of a run, made again from the results in a folder.

    Args:
        spec: of the results.
        folder: of the results.

    Raises:
        DomainError: there is no design of this spec, or a result is not as this tool writes it; says which and where.
    """
    from fopi_tune.report.html import report_files

    findings = _read_findings(spec, folder, DESIGN)
    return Made(report_files(findings), tuple(_left_out(findings, folder)))


def system_report_from_folder(folder: Path, system: SystemSpec | None) -> Made:
    """The page of a system: what a certificate in a folder proves, which is tested, and what its gains do.

    Args:
        folder: of the results.
        system: that the results must be of, and that is simulated; None leaves this open, and shows the certificate.

    Raises:
        DomainError: there is no result of this system, or its certificate does not hold; says which and where.
    """
    from fopi_tune.report.system_page import system_report_files

    certificate = _certificate_of_system(folder, system)
    runs, left_out = (None, ()) if system is None else _runs_of_system(folder, system)
    if certificate is None and runs is None:
        asked = "" if system is None else ", `fopi simulate` or `fopi validate`"
        raise DomainError(f"there is no {SYSTEM_CERTIFICATE} to read in {folder}; make one with `fopi prove`{asked}")
    unit = _stated_unit(folder) if system is None else system.measurement_unit
    return Made(system_report_files(certificate, unit, runs), left_out)


def _certificate_of_system(folder: Path, system: SystemSpec | None) -> SystemCertificate | None:
    """The certificate in a folder, tested; None where there is none."""
    from fopi_tune.pipeline.prove_system import recheck_system

    path = folder / SYSTEM_CERTIFICATE
    document = _read_document(path)
    if document is None:
        return None
    try:
        certificate, found = recheck_system(document)
    except CertificateError as error:
        raise DomainError(f"{path}: {error}; make it again with `fopi prove`") from None
    if system is not None and certificate.system_sha256 != system.sha256:
        raise DomainError(f"{path} is of another system, or of another text of this one; run `fopi prove` again")
    if not found.accepted:
        raise DomainError(f"{path} does not show what it says: {found.problems[0]}; run `fopi prove` again")
    return certificate


def _runs_of_system(folder: Path, system: SystemSpec) -> tuple[SystemRuns | None, tuple[str, ...]]:
    """What the gains of results in a folder do, and which of the results are left out and why.

    The gains are those of the first result that there is: what is proved, drawn, simulated.

    Raises:
        DomainError: a result of this system is not as this tool writes it; says which and where.
    """
    from fopi_tune.core.controller import controller_of
    from fopi_tune.report.system_page import system_runs
    from fopi_tune.results.schema.check import first_problem
    from fopi_tune.results.schema.kinds import result_schema

    found: dict[str, Document] = {}
    left_out: list[str] = []
    for kind, (file, command) in _SYSTEM_RESULTS.items():
        document = _read_document(folder / file)
        if document is None:
            continue
        stamp, again = document.get("stamp"), f"run `fopi {command}` again"
        if not isinstance(stamp, dict) or stamp.get("spec_sha256") != system.sha256:
            left_out.append(f"{folder / file} is of another system, or of another text of this one; {again}")
        elif (problem := first_problem(document, result_schema(kind))) is not None:
            raise DomainError(f"{folder / file} is not as this tool writes it: {problem}; {again}")
        elif found and document["gains"] != next(iter(found.values()))["gains"]:
            left_out.append(f"{folder / file} is of other gains than what is shown; {again}")
        else:
            found[kind] = document
    if not found:
        return None, tuple(left_out)
    gains = {name: controller_of(numbers) for name, numbers in next(iter(found.values()))["gains"].items()}
    return system_runs(system, gains, found.get("system_evidence")), tuple(left_out)


def _stated_unit(folder: Path) -> str:
    """The output's unit as the result beside a certificate has it; empty without."""
    unit = (_read_document(folder / SYSTEM_PROOF) or {}).get("measurement_unit")
    return unit if isinstance(unit, str) and unit.isprintable() else ""


def _read_findings(spec: DesignSpec, folder: Path, file: str) -> ResultDocuments:
    """Read a folder of results of a spec; the gains are those of `file`."""
    from fopi_tune.report.documents import check_consistent, documents_of

    command = "fopi prove" if file == CHECK else "fopi run"
    found = _read_document(folder / file)
    if found is None:
        raise DomainError(f"there is no {file} to read in {folder}; make one with `{command}`, or name its folder")
    digital, evidence = _read_document(folder / DIGITAL), _read_document(folder / EVIDENCE)
    findings = documents_of(spec, found, digital, evidence, file=file, command=command)
    check_consistent(found, _read_document(folder / CERTIFICATE), (file, CERTIFICATE), command)
    if findings.digital is not None:
        names = (DIGITAL, DIGITAL_CERTIFICATE)
        check_consistent(findings.digital, _read_document(folder / DIGITAL_CERTIFICATE), names, command)
    return findings


def _left_out(findings: ResultDocuments, folder: Path) -> Iterator[str]:
    """The results in a folder that are no part of the findings, in words."""
    results = ((DIGITAL, findings.digital, "fopi discretize"), (EVIDENCE, findings.evidence, "fopi validate"))
    for file, used, command in results:
        if used is None and (folder / file).exists():
            why = "is of another spec or other gains, or damaged, and is left out"
            yield f"{folder / file} {why}; run `{command}` again"


def _read_document(path: Path) -> Document | None:
    """The JSON object in a file; None if there is no such file.

    Raises:
        DomainError: it cannot be read, or holds something else.
    """
    from fopi_tune.spec.files import read_json

    try:
        found = read_json(path)
    except FileNotFoundError:
        return None
    except OSError as error:
        raise DomainError(f"{path} cannot be read ({obstacle(path, error)}); check it, or move it away") from None
    except DomainError as error:
        raise DomainError(f"{path} {error}; make the result again, or move the file away") from None
    if not isinstance(found, dict):
        raise DomainError(f"{path} is no object of JSON, as results are; make the result again, or move the file away")
    return found
