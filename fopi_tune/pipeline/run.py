"""All stages of one spec:  tune, then discretize -> Run."""

from __future__ import annotations

from dataclasses import replace

from fopi_tune.errors import DomainError
from fopi_tune.pipeline.discretize import discretize
from fopi_tune.pipeline.tune import tune
from fopi_tune.results.design import Run
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
    known = design.certificate if spec.digital.designs_sampled else None
    try:
        # the design's spec: one without an objective may have a limit of |S| added to it
        digital = discretize(design.spec, design.gains, proof and known is None)
    except DomainError as error:
        return Run(design, None, str(error))
    # a design for samples was proved for this same loop
    return Run(design, digital if known is None else replace(digital, certificate=known))
