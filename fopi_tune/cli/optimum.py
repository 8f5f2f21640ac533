"""`fopi tune --certify-optimum`:  a design with the bound of its objective, and the file of it checked again."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

from fopi_tune.cli.output import Exit, print_out, progress_bar, say, to_json

if TYPE_CHECKING:
    from fopi_tune.cli.process import Handling
    from fopi_tune.optimum import OptimumRecheck
    from fopi_tune.result import Design


def with_optimum(design: Design, gap: float, time_limit_s: float, handling: Handling) -> Design:
    """The design with what is proved of the best gains; of an infeasible one, whether that is proved.

    Raises:
        DomainError: a gap or a limit that is not positive.
    """
    from fopi_tune.pipeline_optimum import certify_optimum

    status = design.status.value
    if status not in ("solved", "infeasible"):
        handling.note(f"{design.spec.name}: {status}, so there is no optimum to certify")
        return design
    handling.note(f"{design.spec.name}: certifying the optimum ...")
    with progress_bar("boxes", handling.quiet) as bar:
        told = None if bar is None else lambda done, left: bar(done, done + left)
        found = certify_optimum(
            design.spec,
            design.gains if status == "solved" else None,
            gap=gap,
            time_limit_s=time_limit_s,
            progress=told,
        )
    return replace(design, optimum=found)


def recheck_optimum_file(document: Any, spec_file: str | None, handling: Handling) -> Exit:
    """Check a file of an optimum, print what was found; like any certificate it raises what is wrong with it."""
    from fopi_tune.pipeline_optimum import recheck_optimum

    if spec_file is None:
        say("a bound of an optimum is checked against its spec; name it: fopi prove --recheck FILE SPEC")
        return Exit.BAD_INPUT
    found = recheck_optimum(document, spec_file)
    stated = found.status.value in ("certified", "infeasible")
    code = Exit.MET if found.is_sound and stated else Exit.NOT_MET
    if handling.as_json:
        return max(code, print_out(to_json(_document(found))))
    verdict = "sound" if found.is_sound else "refused"
    lines = [f"{verdict}: {found.status.value}, {found.leaves} boxes tested again in ball arithmetic"]
    return max(code, print_out("\n".join([*lines, *(f"  {problem}" for problem in found.problems)])))


def _document(found: OptimumRecheck) -> dict[str, Any]:
    return {
        "schema": 1,
        "status": "sound" if found.is_sound else "refused",
        "verdict": found.status.value if found.is_sound else None,
        "boxes": found.leaves,
        "problems": list(found.problems),
    }
