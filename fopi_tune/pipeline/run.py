"""All stages of one spec:  tune, then discretize -> Run."""

from __future__ import annotations

from dataclasses import replace

from fopi_tune.errors import DomainError
from fopi_tune.pipeline.discretize import discretized
from fopi_tune.pipeline.tune import tune
from fopi_tune.proof import Verification
from fopi_tune.proof.verification.verify import TOLERANCE
from fopi_tune.results.design import Design, Run
from fopi_tune.results.status import Status
from fopi_tune.spec import load_spec
from fopi_tune.spec.load import Source


def run(source: Source, proof: bool = True) -> Run:
    """Tune a spec and, if it is solved and has a section `digital`, make its digital controller.

    Args:
        source: a spec file, or a spec.
        proof: False leaves the certificates out.

    Returns:
        The run; where the digital controller cannot be made, the design and the reason.

    Raises:
        SpecError: the file cannot be read, or has mistakes.
        DomainError: as for `tune`.
    """
    spec = load_spec(source)
    design = tune(spec, proof)
    if spec.digital is None or design.status is not Status.SOLVED or design.gains is None:
        return Run(design, None)
    sampled = spec.digital.designs_sampled
    known = design.certificate if sampled else None
    try:
        # the design's spec: one without an objective may have a limit of |S| added to it
        found = _verification_of(design) if sampled else None
        digital = discretized(design.spec, design.gains, proof and known is None, found)
    except DomainError as error:
        return Run(design, None, str(error))
    # a design for samples was verified and proved for this same loop
    return Run(design, digital if known is None else replace(digital, certificate=known))


def _verification_of(design: Design) -> Verification | None:
    """What the verification of a solved design said; None where a part of it is missing."""
    results = tuple(report.result for report in design.requirements if report.result is not None)
    if design.gains is None or design.stability is None or design.nominal is None:
        return None
    if len(results) < len(design.requirements):
        return None
    # the member that decides the objective is not kept in a design, and a digital controller does not name it
    measures = tuple(report.result for report in design.measures if report.result is not None)
    if len(measures) < len(design.measures):
        return None
    return Verification(
        design.gains, design.stability, results, design.objective, None, design.nominal, TOLERANCE, measures
    )
