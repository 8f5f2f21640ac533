"""The sequence of stages:  spec -> design -> verification -> certificate -> Design -> Discretized."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from fopi_tune.core.controller import FoPi
from fopi_tune.pipeline.assemble import assembled, refutations
from fopi_tune.pipeline.relaxations import confirmed
from fopi_tune.proof import certify, verify
from fopi_tune.results.candidate import Attempt, Solver, Violation
from fopi_tune.results.design import Design
from fopi_tune.results.stamp import certificate_versions
from fopi_tune.results.status import Status
from fopi_tune.spec import load_spec
from fopi_tune.spec.load import Source
from fopi_tune.spec.model import DesignSpec

if TYPE_CHECKING:
    from fopi_tune.design import Neighbour

#: how often a refuted design is made again
_MOST_REFUTATIONS = 5


def tune(
    source: Source, proof: bool = True, solver: Solver = Solver.IPOPT, *, start: FoPi | Neighbour | None = None
) -> Design:
    """Find the gains that meet a spec over its whole family, and prove that they do.

    With `design: sampled` in the spec's section `digital` the requirements are about the loop on samples.

    Args:
        source: a spec file, or a spec.
        proof: False leaves the certificate out: `solved` then means verified in floating point, and the result says so.
        solver: which search finds the gains; `Solver.CONVEX` is the slower second opinion, which does not take
            `design: sampled`.
        start: gains that are nearly right, or a neighbour (`fopi_tune.design.neighbour`) that has them, from which
            alone the search begins unless that leads nowhere: faster, and blind to a better optimum elsewhere.  A
            design for samples and the convex search have their own starts.

    Returns:
        A design; `status` says how it ended.  Infeasible, unbounded and failed are answers, not exceptions.

    Raises:
        SpecError: the file cannot be read, or has mistakes; it lists them all.
        DomainError: a dead time so long that the loop's crossings cannot be listed, or a digital controller that the
            spec asks for and that cannot be made.
    """
    spec = load_spec(source)
    design = _designed(spec, proof, solver, start)

    def is_met(moved: DesignSpec) -> bool:
        # from the gains that come nearest, and from every start where that leads nowhere
        return _designed(moved, False, solver, design.gains).status is Status.SOLVED

    return replace(design, clash=confirmed(spec, design.clash, is_met))


def _designed(spec: DesignSpec, proof: bool, solver: Solver, start: FoPi | Neighbour | None) -> Design:
    """The design; how far clashing requirements would have to give is not confirmed yet."""
    if solver is Solver.IPOPT and spec.digital is not None and spec.digital.designs_sampled:
        from fopi_tune.design.sampled import sampled_attempt

        return assembled(spec, sampled_attempt(spec, proof), proof)
    violations: tuple[Violation, ...] = ()
    attempt = _attempt(spec, violations, proof, solver, start)
    for _ in range(_MOST_REFUTATIONS):
        new = refutations(attempt, violations)
        if not new:
            break
        violations += new
        attempt = _attempt(spec, violations, proof, solver, start)
    return assembled(spec, attempt, proof, solver)


def _attempt(
    spec: DesignSpec, violations: tuple[Violation, ...], proof: bool, solver: Solver, start: FoPi | Neighbour | None
) -> Attempt:
    if solver is Solver.CONVEX:
        from fopi_tune.convex import convex_design

        candidate = convex_design(spec, violations)
    else:
        from fopi_tune.design import design  # loads CasADi, which a check has no need of

        candidate = design(spec, violations, start)
    gains = candidate.gains
    if gains is None or (gains.kp == 0.0 and gains.ki == 0.0):
        return Attempt(candidate)
    found = verify(spec, gains)
    if not proof or candidate.status is not Status.SOLVED or not found.all_met:
        return Attempt(candidate, found)
    return Attempt(candidate, found, certify(spec, found, certificate_versions()))
