"""The sequence of stages:  spec -> design -> verification -> certificate -> Design -> Discretized."""

from __future__ import annotations

import os
from dataclasses import replace
from typing import TYPE_CHECKING

from fopi_tune.advice import confirmed
from fopi_tune.assemble import Attempt, assembled, refutations
from fopi_tune.candidate import Solver, Violation
from fopi_tune.core.controller import FoPi
from fopi_tune.core.sections import Implementation
from fopi_tune.errors import DomainError
from fopi_tune.outcome import Status
from fopi_tune.proof import Recheck, certify, verify
from fopi_tune.proof.certificate import LARGEST_TOLERANCE
from fopi_tune.result import Check, Design, Discretized, Run, loop_name, objective_name
from fopi_tune.spec import load_spec
from fopi_tune.spec.model import DesignSpec
from fopi_tune.stamp import certificate_versions, stamp

if TYPE_CHECKING:
    from fopi_tune.design import Neighbour
    from fopi_tune.prices import Tradeoff

#: how often a refuted design is made again
_MOST_REFUTATIONS = 5

#: why there are no prices and no sweeps of such a spec
NOT_ON_SAMPLES = (
    "`design: sampled` is tuned by a stand-in whose limits are not the spec's, so that it has no prices and no sweep; "
    "take `design: continuous` for them"
)

Source = str | os.PathLike[str] | DesignSpec


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


def price(design: Design) -> Design:
    """Check a design's multipliers by solving again with each limit moved a little, both ways.

    Args:
        design: a solved one, of the loop in continuous time.

    Returns:
        The design with a `price` in the reports of the requirements that cost something; unchanged unless it is solved.

    Raises:
        DomainError: the design is of the loop on samples, whose multipliers are a stand-in's.
    """
    if loop_name(design.spec) == "sampled":
        raise DomainError(NOT_ON_SAMPLES)
    gains = design.gains
    if design.status is not Status.SOLVED or gains is None:
        return design
    from fopi_tune.prices.price import price_of  # loads CasADi

    reports = tuple(
        replace(report, price=price_of(design.spec, gains, k, report.multiplier))
        for k, report in enumerate(design.requirements, start=1)
    )
    return replace(design, requirements=reports)


def tradeoff(
    source: Source,
    requirement: str | int,
    *,
    start: float | None = None,
    stop: float | None = None,
    points: int = 50,
) -> Tradeoff:
    """Sweep one requirement's limit: the best objective for every limit, up to where no gains meet the spec.

    Args:
        source: a spec file, or a spec.
        requirement: its number in the spec, from 1 on, or its quantity if it occurs once; of a `between` with ".lower"
            or ".upper" behind.
        start: lowest limit, in the limit's unit; by default the sweep reaches as far beyond the spec's own limit as the
            infeasible end lies before it.
        stop: highest limit, in the limit's unit.
        points: how many.

    Raises:
        SpecError: the file cannot be read, or has mistakes.
        DomainError: there is no such requirement, no design with the spec's own limit, no gain to choose, or
            `design: sampled`; or the range makes no sense.
    """
    spec = load_spec(source)
    if loop_name(spec) == "sampled":
        raise DomainError(NOT_ON_SAMPLES)
    from fopi_tune.prices import knob_of
    from fopi_tune.prices.sweep import Range, sweep  # loads CasADi

    knob = knob_of(spec, str(requirement))
    box = spec.controller
    if box.kp.is_fixed and box.ki.is_fixed and box.alpha.is_fixed:
        raise DomainError(
            "the spec fixes kp, ki and alpha: whatever a limit is, the gains stay; give one of them a range"
        )
    design = tune(spec, proof=False)
    if design.status is not Status.SOLVED or design.gains is None:
        said = f"{design.status.value}: {design.message}" if design.message else design.status.value
        raise DomainError(f"a sweep starts from the design with the spec's own limits, which is {said}")
    return sweep(spec, knob, design.gains, Range(start, stop, points), objective_name(spec))


def prove(source: Source, gains: FoPi, tolerance: float = 1e-6) -> Check:
    """Check gains from anywhere against a spec, and prove or refute what it asks.

    Args:
        source: a spec file, or a spec; with `design: sampled` the loop is the one on samples.
        gains: the controller.
        tolerance: by how much a requirement may be missed, in neper or radian (a delay margin: relative).

    Raises:
        SpecError: the file cannot be read, or has mistakes.
        DomainError: kp = ki = 0, a tolerance outside (0, 0.01], a dead time so long that the loop's crossings cannot be
            listed, or a digital controller that the spec asks for and that cannot be made.
    """
    spec = load_spec(source)
    if not 0.0 < tolerance <= LARGEST_TOLERANCE:
        raise DomainError(
            f"tolerance = {tolerance!r} must be greater than 0 and at most {LARGEST_TOLERANCE:g}; 1e-6 is usual"
        )
    implementation: Implementation | None = None
    if spec.digital is not None and spec.digital.designs_sampled:
        from fopi_tune.implement import implementation_of

        implementation = implementation_of(spec, gains)
    found = verify(spec, gains, tolerance, implementation)
    certificate = certify(spec, found, certificate_versions(), implementation)
    return Check(spec, found, certificate, stamp(spec.sha256, None))


def discretize(source: Source, gains: FoPi, proof: bool = True) -> Discretized:
    """Make the digital controller that a spec's `digital:` section asks for, and check the loop on samples with it.

    Args:
        source: a spec file, or a spec.
        gains: the controller, usually from a design.
        proof: False leaves the certificate out.

    Raises:
        SpecError: the file cannot be read, or has mistakes.
        DomainError: the spec has no such section, it cannot be met (band, sample time, precision), or kp = ki = 0.
    """
    from fopi_tune.digital import discretize
    from fopi_tune.implement import crossover_of, digital_of

    spec = load_spec(source)
    digital = digital_of(spec)
    controller = discretize(gains, digital, crossover_of(spec, gains))
    implementation = Implementation(controller.sections, digital.delay_samples)
    found = verify(spec, gains, implementation=implementation)
    certificate = certify(spec, found, certificate_versions(), implementation) if proof else None
    return Discretized(spec, controller, found, certificate, stamp(spec.sha256, None))


def run(source: Source, proof: bool = True) -> Run:
    """Every stage there is: the design, and of a solved one whose spec has a section `digital` its digital controller.

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
        digital = discretize(spec, design.gains, proof and known is None)
    except DomainError as error:
        return Run(design, None, str(error))
    # a design for samples is proved of this very loop: what runs is made from the same gains
    return Run(design, digital if known is None else replace(digital, certificate=known))


def recheck(document: object, source: Source | None = None) -> Recheck:
    """Check a certificate without searching.

    Args:
        document: the certificate's JSON, as `json.load` gives it.
        source: when given, the certificate must be about this spec.

    Raises:
        CertificateError: it is no certificate.
        SpecError: the spec cannot be read, or has mistakes.
    """
    from fopi_tune.proof import recheck

    if source is None:
        return recheck(document, None)
    spec = load_spec(source)
    found = recheck(document, spec)
    case = found.certificate.case
    if case.implementation is None:
        return found
    # what the proof cannot know: that this filter is what the spec makes of these gains
    from fopi_tune.implement import is_implementation_of

    if is_implementation_of(spec, case.gains, case.implementation):
        return found
    problem = "the digital controller is not the one that the spec makes of the gains that are stated"
    return replace(found, problems=(*found.problems, problem))


def _designed(spec: DesignSpec, proof: bool, solver: Solver, start: FoPi | Neighbour | None) -> Design:
    """The design; how far clashing requirements would have to give is not confirmed yet."""
    if solver is Solver.IPOPT and spec.digital is not None and spec.digital.designs_sampled:
        from fopi_tune.implement import sampled_attempt

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


__all__ = [
    "Check",
    "Design",
    "Discretized",
    "Run",
    "Solver",
    "discretize",
    "price",
    "prove",
    "recheck",
    "run",
    "tradeoff",
    "tune",
]
