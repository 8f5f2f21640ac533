"""Tuning:  spec -> candidate -> verification -> certificate -> Design.

1. A search finds gains, for the plants and frequencies that it knows of.
2. The verification checks them for the whole family, without the search's help, and the certificate proves them.
3. Where either refutes the gains, the plant and frequency become a cut and the search runs again.
4. A term of the controller that has vanished is fixed at 0, and the rest is tuned again.
5. Of an infeasible spec, each relaxation of a limit is confirmed by tuning the relaxed spec.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

from fopi_tune.core.controller import FoPi, refuse_no_gains
from fopi_tune.core.fractional_plants.family import refuse_fractional_family
from fopi_tune.core.terms.numbers import refuse_no_flag
from fopi_tune.digital.implementation import designed_implementation
from fopi_tune.errors import DomainError, UnstableLoopError
from fopi_tune.pipeline.assemble import assemble_design, new_violations
from fopi_tune.pipeline.degenerate import design_notes, without_vanished_terms
from fopi_tune.proof import certify, verify
from fopi_tune.quantities import QUANTITIES
from fopi_tune.results.candidate import Candidate, CheckedCandidate, Solver, Violation
from fopi_tune.results.design import Design
from fopi_tune.results.stamp import certificate_versions
from fopi_tune.results.status import Relaxation, Status
from fopi_tune.spec import load_spec
from fopi_tune.spec.default_objective import with_default_objective
from fopi_tune.spec.lists.members import refuse_list, refuse_measured
from fopi_tune.spec.load import Source
from fopi_tune.spec.model import DesignSpec, Relation, Requirement, Sense

if TYPE_CHECKING:
    from fopi_tune.design import Neighbour
    from fopi_tune.montecarlo.statistics import Fraction

_log = logging.getLogger(__name__)
#: how often a refuted design is made again
_MOST_REFUTATIONS = 8
#: relaxed limits are moved this much further than where the search ended, natural units: there rounding decides
_CLEARANCE = 1e-5
#: significant digits of the limits that are tried: those that a table prints, then fewer, further from what was found
_DIGITS = (5, 2)
#: relative; objectives that differ by less are the same
_SAME = 1e-6


def tune(
    source: Source,
    proof: bool = True,
    solver: Solver = Solver.IPOPT,
    *,
    start: FoPi | Neighbour | None = None,
    bracket: bool = True,
) -> Design:
    """Find the gains that meet a spec over its whole family, and prove that they do.

    With `design: sampled` in the spec's section `digital` the requirements are about the loop on samples.

    Args:
        source: a spec file, or a spec.
        proof: False leaves the certificate out: `solved` then means verified in floating point, and the result says so.
        solver: which search finds the gains; `Solver.CONVEX` is the slower second opinion.
        start: gains close to the solution, or a neighbour (`fopi_tune.design.neighbour`) that has them.  They are
            polished beside a scan of the whole box on fewer rays, which is faster.  The convex search ignores it.
        bracket: whether to bound in floating point how much better any other gains can be (`Design.gap`), and to search
            again where that leaves room. Only without a start, not with `structure: fopid`, whose orders the bound
            does not know, and on samples not with `prewarp: crossover` or `rule: matched`, whose filter changes with
            the gains' own crossover: `Design.gap` is then None.

    Returns:
        A design; `status` says how it ended.  Infeasible, unbounded and failed are answers, not exceptions.

    Raises:
        SpecError: the file cannot be read, or has mistakes; it lists them all.
        DomainError: a dead time so long that the loop's crossings cannot be listed, a digital controller that the
            spec asks for and that cannot be made, or the convex search of a spec with requirements on scenarios.
    """
    asked = load_spec(source)
    if isinstance(proof, FoPi):
        raise DomainError("gains to start from are given by their name: tune(spec, start=gains)")
    refuse_no_flag("proof", proof)
    refuse_no_flag("bracket", bracket)
    if solver not in list(Solver):
        raise DomainError(
            f"there is no solver {solver!r}; there is {' and '.join(repr(each.value) for each in Solver)}"
        )
    solver = Solver(solver)
    if not isinstance(start, FoPi | None):
        from fopi_tune.design import Neighbour  # loads CasADi

        if not isinstance(start, Neighbour):
            refuse_no_gains(start)
    if solver is Solver.CONVEX:
        refuse_list(asked, "the convex search")
        refuse_fractional_family(asked.plant, "the convex search", "it has polynomials in s alone")
        refuse_measured(asked, "the convex search")
    spec = with_default_objective(asked)
    design = _unconfirmed_design(spec, spec, proof, solver, start, bracket)
    design = _without_vanished_terms(spec, design, proof, solver)

    def is_met(relaxed: DesignSpec) -> bool:
        # from the gains that come nearest first, and from every start where these lead nowhere
        return _unconfirmed_design(relaxed, relaxed, False, solver, design.gains, False).status is Status.SOLVED

    return replace(design, clash=_confirm_relaxations(spec, design.clash, is_met), notes=design_notes(asked, design))


def _without_vanished_terms(spec: DesignSpec, design: Design, proof: bool, solver: Solver) -> Design:
    """The design with a vanished term fixed at 0 and the rest tuned again; itself where that is no solution.

    A proportional or derivative term that is only small goes where the objective is none the worse for it.
    """
    if design.status is not Status.SOLVED or design.gains is None or design.nominal is None:
        return design
    box = without_vanished_terms(spec.controller, design.gains, design.nominal.crossover_rad_s)
    if box is spec.controller:
        return design
    gone = next(name for name in ("kp", "ki", "kd") if getattr(box, name) != getattr(spec.controller, name))
    start = replace(design.gains, **{gone: 0.0})
    again = _unconfirmed_design(spec, replace(spec, controller=box), proof, solver, start, False)
    no_worse = _is_no_worse(spec, again, design)
    if again.status is not Status.SOLVED or (gone != "ki" and not no_worse):
        return design
    # what nothing in the whole box beats, nothing in a part of it does
    return replace(again, gap=design.gap if no_worse else None)


def _is_no_worse(spec: DesignSpec, one: Design, other: Design) -> bool:
    if one.objective is None or other.objective is None:
        return False
    sign = 1.0 if spec.objective is None or spec.objective.sense is Sense.MAXIMIZE else -1.0
    return sign * (one.objective - other.objective) >= -_SAME * abs(other.objective)


def _unconfirmed_design(
    spec: DesignSpec,
    searched: DesignSpec,
    proof: bool,
    solver: Solver,
    start: FoPi | Neighbour | None,
    bracket: bool,
) -> Design:
    """Search, check and search again with what the check refuted; relaxations are the search's estimates.

    `searched` is the spec with the box of gains that is searched.
    """
    violations: tuple[Violation, ...] = ()
    refuted: CheckedCandidate | None = None
    checked = _checked_candidate(spec, searched, violations, proof, solver, start, bracket)
    for _ in range(_MOST_REFUTATIONS if searched.controller.fixed is None else 0):
        new = new_violations(checked, violations)
        if not new:
            break
        violations, refuted = violations + new, checked
        checked = _checked_candidate(spec, searched, violations, proof, solver, start, bracket)
    return assemble_design(spec, checked, proof, solver, refuted)


def _checked_candidate(
    spec: DesignSpec,
    searched: DesignSpec,
    violations: tuple[Violation, ...],
    proof: bool,
    solver: Solver,
    start: FoPi | Neighbour | None,
    bracket: bool,
) -> CheckedCandidate:
    """One run of the search, with the violations found so far as cuts, then verification and certificate."""
    _log.info("%s: search by %s, %d cuts from refuted gains", spec.name, solver.value, len(violations))
    if spec.designs_scenarios:
        candidate = _scenario_candidate(searched, violations, solver, start)
    elif solver is Solver.CONVEX:
        from fopi_tune.convex import convex_design

        candidate = convex_design(searched, violations)
    else:
        from fopi_tune.design import design  # loads CasADi

        candidate = design(searched, violations, start, bracket and start is None)
    gains = candidate.gains
    _log.info("%s: search ended as %s after %d solves, %s", spec.name, candidate.status.value, candidate.solves, gains)
    if gains is None or gains.is_zero:
        return CheckedCandidate(candidate)
    implementation = designed_implementation(spec, gains)
    try:
        verification = verify(spec, gains, implementation=implementation)
    except UnstableLoopError as error:
        if searched.controller.fixed is None:
            raise
        why = f"the spec fixes {searched.controller.names}, and these gains leave an unstable loop: {error}"
        return CheckedCandidate(replace(candidate, status=Status.INFEASIBLE, gains=None, message=why))
    _log.info("%s: verification: %s", spec.name, "all met" if verification.all_met else "something is missed")
    if candidate.status is not Status.SOLVED or not verification.all_met:
        return CheckedCandidate(candidate, verification)
    drawn: tuple[Fraction, ...] = ()
    if spec.scenario_requirements and implementation is not None:
        from fopi_tune.montecarlo.montecarlo import scenario_fractions

        drawn = scenario_fractions(spec, implementation)
    proved = proof and not spec.is_measured
    certificate = certify(spec, verification, certificate_versions(), implementation) if proved else None
    return CheckedCandidate(candidate, verification, certificate, drawn)


def _scenario_candidate(
    searched: DesignSpec, violations: tuple[Violation, ...], solver: Solver, start: FoPi | Neighbour | None
) -> Candidate:
    """The candidate of a spec with requirements or an objective of scenarios."""
    from fopi_tune.design.time_domain import design_for_scenarios

    if solver is Solver.CONVEX:
        raise DomainError("measures of scenarios are no convex functions of the gains; leave `solver='convex'` out")
    known = start if isinstance(start, FoPi) or start is None else start.gains
    return design_for_scenarios(searched, violations, known)


def _confirm_relaxations(
    spec: DesignSpec, clash: Sequence[Relaxation], is_met: Callable[[DesignSpec], bool]
) -> tuple[Relaxation, ...]:
    """The clashing requirements, each with a relaxed limit only where the spec was found to be met with it.

    Args:
        spec: the infeasible spec.
        clash: relaxations that a search, or a check of fixed gains, estimates to be enough.
        is_met: whether gains were found that meet a spec, decided by the independent check.
    """
    return tuple(_confirmed_relaxation(spec, relaxation, is_met) for relaxation in clash)


def _confirmed_relaxation(spec: DesignSpec, relaxation: Relaxation, is_met: Callable[[DesignSpec], bool]) -> Relaxation:
    first = len(spec.requirements)
    if relaxation.requirement >= first:
        return _confirmed_measure(spec, relaxation, is_met)
    requirement = spec.requirements[relaxation.requirement]
    if relaxation.new_limit is not None:
        index = _limit_index(requirement, relaxation.new_limit)
        old = requirement.limits[index]
        for limit in _rounded_limits(requirement, old, relaxation.new_limit):
            limits = (*requirement.limits[:index], limit, *requirement.limits[index + 1 :])
            moved = requirement.moved(limits)
            others = spec.requirements
            every = (*others[: relaxation.requirement], moved, *others[relaxation.requirement + 1 :])
            if is_met(replace(spec, requirements=every)):
                return Relaxation(relaxation.requirement, abs(limit - old), limit)
    return Relaxation(relaxation.requirement, None, None)


def _confirmed_measure(spec: DesignSpec, relaxation: Relaxation, is_met: Callable[[DesignSpec], bool]) -> Relaxation:
    """The same of a requirement on a scenario."""
    place = relaxation.requirement - len(spec.requirements)
    every = spec.scenario_requirements
    old = every[place]
    if relaxation.new_limit is not None:
        direction = math.copysign(1.0, relaxation.new_limit - old.limit)
        further = relaxation.new_limit + direction * _CLEARANCE * abs(relaxation.new_limit)
        rounded = [_rounded(further, direction, digits) for digits in _DIGITS if further != 0.0]
        # settling times are whole samples
        for limit in dict.fromkeys([relaxation.new_limit] * (old.measure == "settling_time_s") + rounded):
            moved = replace(old, limit=limit)
            if is_met(replace(spec, scenario_requirements=(*every[:place], moved, *every[place + 1 :]))):
                return Relaxation(relaxation.requirement, abs(limit - old.limit), limit)
    return Relaxation(relaxation.requirement, None, None)


def _limit_index(requirement: Requirement, limit: float) -> int:
    """Which of the limits is relaxed: of a `between` the one on the side of the new limit."""
    return 0 if limit < requirement.limits[0] else len(requirement.limits) - 1


def _rounded_limits(requirement: Requirement, old: float, limit: float) -> Iterator[float]:
    """The relaxed limit, rounded away from the old one to few digits; of an `equals` first the exact value."""
    quantity = QUANTITIES[requirement.quantity]
    direction = math.copysign(1.0, limit - old)
    further = quantity.from_natural(quantity.to_natural(limit) + direction * _CLEARANCE)
    tried = [_rounded(further, direction, digits) for digits in _DIGITS if further != 0.0]
    if requirement.relation is Relation.EQUALS:
        tried = [limit, *tried[1:]]
    for each in dict.fromkeys(tried):
        if each != old and quantity.check_limit(each) is None:
            yield each


def _rounded(value: float, direction: float, digits: int) -> float:
    """Rounded to a number of significant digits, up (`direction` 1) or down (-1)."""
    step = 10.0 ** (math.floor(math.log10(abs(value))) - digits + 1)
    count = math.ceil(value / step) if direction > 0.0 else math.floor(value / step)
    # through text, to get the nearest double of the decimal number
    return float(f"{count * step:.{digits}g}")
