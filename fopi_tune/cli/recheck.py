"""Certificates and earlier results on the disk:  read, checked, printed."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

from fopi_tune.cli.batch import Handling
from fopi_tune.cli.output import Exit, print_out, print_styled, read_text, reason_of, report_failure, say, to_json
from fopi_tune.cli.tune import recheck_optimum_file
from fopi_tune.errors import CertificateError, SpecError

if TYPE_CHECKING:
    from fopi_tune.core.controller import FoPi
    from fopi_tune.proof import Recheck
    from fopi_tune.spec.model import DesignSpec


def recheck_file(file: str, spec_file: str | None, handling: Handling) -> Exit:
    """Check a certificate, print what was found, and say by the exit code whether everything in it is proved."""
    try:
        document = _json(file)
    except OSError as error:
        say(f"{file}: cannot be read ({reason_of(error)}); check the path")
        return Exit.BAD_INPUT
    except (ValueError, RecursionError):
        say(f"{file}: is no JSON, or names an entry twice; give the certificate.json (or optimum.json) of a result")
        return Exit.BAD_INPUT
    try:
        if isinstance(document, dict) and document.get("kind") == "fopi_tune optimum":
            return recheck_optimum_file(document, spec_file, handling)
        from fopi_tune.pipeline.prove import recheck

        found = recheck(document, spec_file)
    except SpecError as error:
        for problem in error.problems:
            say(str(problem))
        return Exit.BAD_INPUT
    except CertificateError as error:
        say(f"{file}: {error}")
        return Exit.BAD_INPUT
    except Exception as error:
        return report_failure(file, error, handling.debug)
    code = Exit.MET if found.is_sound and found.certificate.verdict.value == "proved" else Exit.NOT_MET
    if handling.as_json:
        return max(code, print_out(to_json(_document(found))))
    from fopi_tune.report import recheck_text

    return max(code, print_styled(recheck_text(found)))


def _document(found: Recheck) -> dict[str, Any]:
    certificate = found.certificate
    gains = certificate.case.gains
    return {
        "schema": 1,
        "status": "sound" if found.is_sound else "refused",
        "verdict": certificate.verdict.value if found.is_sound else None,
        "name": certificate.name,
        "spec_sha256": certificate.spec_sha256,
        "gains": {"kp": gains.kp, "ki": gains.ki, "alpha": gains.alpha},
        "tolerance": certificate.tolerance,
        "boxes": found.boxes,
        "problems": list(found.problems),
    }


def gains_of_earlier_design(spec: DesignSpec, handling: Handling) -> FoPi | None:
    """The gains that the spec fixes, or those of a solved design of exactly this spec in the folder of results."""
    from fopi_tune.core.controller import FoPi

    box = spec.controller
    if all(gain.is_fixed for gain in (box.kp, box.ki, box.alpha)):
        return FoPi(box.kp.min, box.ki.min, box.alpha.min)
    path = handling.folder(spec) / "design.json"
    try:
        document = _json(path)
        solved = document["status"] == "solved" and document["stamp"]["spec_sha256"] == spec.sha256
        gains = document["gains"] if solved else None
        found = FoPi(float(gains["kp"]), float(gains["ki"]), float(gains["alpha"])) if gains else None
    except (OSError, ValueError, KeyError, TypeError, RecursionError):
        return None  # there is none that could be used: the caller says so and tunes
    if found is not None:
        handling.note(f"{spec.name}: gains from {path}")
    return found


def _json(path: str | Path) -> Any:
    def refuse(constant: str) -> None:
        raise ValueError(f"{constant} is no JSON")

    def once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
        if len({key for key, _ in pairs}) < len(pairs):
            raise ValueError("an entry appears twice")
        return dict(pairs)

    return json.loads(read_text(Path(path)), parse_constant=refuse, object_pairs_hook=once)
