"""`fopi prove --recheck`:  a certificate of gains or of an optimum is read, checked again and printed."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from fopi_tune.cli.batch import OutputOptions
from fopi_tune.cli.output import Exit, print_out, print_styled, reason_of, report_failure, say
from fopi_tune.core.text_tables.words import counted
from fopi_tune.errors import CertificateError, DomainError, SpecError
from fopi_tune.results.saved.writing import to_json

if TYPE_CHECKING:
    from fopi_tune.optimum import OptimumRecheck
    from fopi_tune.proof import Recheck


def recheck_file(file: str, spec_file: str | None, options: OutputOptions) -> Exit:
    """Check a certificate and print the result; the exit code says whether everything in it is proved."""
    from fopi_tune.spec.files import MAX_CERTIFICATE_BYTES, read_json

    try:
        document = read_json(file, MAX_CERTIFICATE_BYTES)
    except OSError as error:
        say(f"{file or repr('')}: cannot be read ({reason_of(error)}); check the path")
        return Exit.BAD_INPUT
    except DomainError as error:
        say(f"{file}: {error}; give the certificate.json (or optimum.json) of a result")
        return Exit.BAD_INPUT
    try:
        if isinstance(document, dict) and document.get("kind") == "fopi_tune optimum":
            return recheck_optimum_file(document, spec_file, options)
        if isinstance(document, dict) and document.get("kind") == "fopi-tune system certificate":
            return recheck_system_file(document, spec_file, options)
        from fopi_tune.pipeline.prove import recheck

        found = recheck(document, spec_file)
    except SpecError as error:
        for problem in error.problems:
            say(str(problem))
        return Exit.BAD_INPUT
    except (CertificateError, DomainError) as error:
        say(f"{file}: {error}")
        return Exit.BAD_INPUT
    except Exception as error:
        return report_failure(file, error, options.debug)
    code = _exit_code(found.is_sound, found.certificate.verdict.value)
    if options.as_json:
        return max(code, print_out(to_json(_document(found))))
    from fopi_tune.report import recheck_text

    return max(code, print_styled(recheck_text(found)))


def _exit_code(is_sound: bool, verdict: str) -> Exit:
    """As of the proof, for a certificate that is sound."""
    if not is_sound:
        return Exit.NOT_MET
    return {"proved": Exit.MET, "settles": Exit.MET, "undecided": Exit.TOOL_FAILED}.get(verdict, Exit.NOT_MET)


def _document(found: Recheck) -> dict[str, Any]:
    from fopi_tune.core.controller import numbers_of

    certificate = found.certificate
    gains = certificate.case.gains
    return {
        "schema": 1,
        "status": "sound" if found.is_sound else "refused",
        "verdict": certificate.verdict.value if found.is_sound else None,
        "name": certificate.name,
        "spec_sha256": certificate.spec_sha256,
        "gains": numbers_of(gains),
        "tolerance": certificate.tolerance,
        "boxes": found.boxes,
        "problems": list(found.problems),
        "notes": list(found.notes),
    }


def recheck_optimum_file(document: Any, spec_file: str | None, options: OutputOptions) -> Exit:
    """Check the certificate of an optimum against its spec and print the result.

    Raises:
        CertificateError: the document is no such certificate.
        SpecError: the spec cannot be used.
    """
    from fopi_tune.pipeline.optimum import recheck_optimum

    if spec_file is None:
        say("a bound of an optimum is checked against its spec; name it: fopi prove --recheck FILE SPEC")
        return Exit.BAD_INPUT
    found = recheck_optimum(document, spec_file)
    stated = found.status.value in ("certified", "infeasible")
    code = Exit.MET if found.is_sound and stated else Exit.NOT_MET
    if options.as_json:
        return max(code, print_out(to_json(_optimum_document(found))))
    verdict = "sound" if found.is_sound else "refused"
    tested = counted(found.leaves, "box", "boxes")
    lines = [f"{verdict}: {found.status.value}, {tested} tested again in ball arithmetic"]
    return max(code, print_out("\n".join([*lines, *(f"  {said}" for said in (*found.problems, *found.notes))])))


def _optimum_document(found: OptimumRecheck) -> dict[str, Any]:
    return {
        "schema": 1,
        "status": "sound" if found.is_sound else "refused",
        "verdict": found.status.value if found.is_sound else None,
        "boxes": found.leaves,
        "problems": list(found.problems),
        "notes": list(found.notes),
    }


def recheck_system_file(document: Any, system_file: str | None, options: OutputOptions) -> Exit:
    """Check the certificate of a system and print the result.

    Raises:
        CertificateError: the document is no such certificate.
        SpecError: the system cannot be used.
        DomainError: the system's file lacks gains of a mode.
    """
    from fopi_tune.pipeline.prove_system import recheck_system

    certificate, found = recheck_system(document, system_file)
    verdict = certificate.verdict.value
    code = _exit_code(found.accepted, verdict)
    told = {
        "schema": 1,
        "status": "sound" if found.accepted else "refused",
        "verdict": verdict if found.accepted else None,
        "name": certificate.name,
        "problems": list(found.problems),
        "notes": list(found.notes),
    }
    if options.as_json:
        return max(code, print_out(to_json(told)))
    first = f"{certificate.name}: sound, {verdict}" if found.accepted else f"{certificate.name}: refused"
    said = certificate.statements if found.accepted else found.problems
    return max(code, print_out("\n".join([first, *(f"  {each}" for each in (*said, *found.notes))])))
