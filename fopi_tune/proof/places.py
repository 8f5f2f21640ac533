"""Whether the plant and the frequency stated of a requirement's side are what they are said to be.

With a witness they are tested in ball arithmetic.  A response is evaluated at the frequency itself, which must lie in
the band.  Of a gain crossover |ln|L|| and of a phase crossover |arg(-L)| vanish up to rounding, and the value there
reaches the witness.  Without a witness, and of a margin that does not end, they are the place at which the search
in floating point found the worst value; that search is repeated.
"""

from __future__ import annotations

import math

import numpy as np
from flint import arb

from fopi_tune.errors import DomainError
from fopi_tune.proof.balls.box import point_box
from fopi_tune.proof.certificate import SideProof, Verdict, gap_scale
from fopi_tune.proof.claims.claim import Claim
from fopi_tune.proof.claims.crossing_quantities import CrossingQuantity
from fopi_tune.proof.claims.existence import HIGH_END, LOW_END, SomeCrossover, SomePhaseCrossover
from fopi_tune.proof.obligations import CROSSING_QUANTITIES, Case, violation_claims
from fopi_tune.proof.verification.crossing_changes import SamplePair
from fopi_tune.proof.verification.requirements import check_requirement
from fopi_tune.proof.verification.results import Place
from fopi_tune.proof.verification.sample import Sample
from fopi_tune.proof.verification.stability import check_stability
from fopi_tune.quantities import QUANTITIES
from fopi_tune.quantities.base import EvaluatedAt
from fopi_tune.spec.model import Requirement

#: neper and rad; a crossing is found in floating point, and its frequency is rounded
CROSSING_ROUNDING = 1e-8
#: relative, of a frequency at the end of a band
_ROUNDING = 1e-12
#: natural units; a witness is at most 1e-3 short of the value at its place (`fopi_tune.proof.certify`)
_SHORT = 2e-3
#: natural units (of frequencies and points: relative); two searches in floating point agree to this, on any machine
_SAME = 1e-6


def place_problem(case: Case, requirement: Requirement, side: SideProof, tolerance: float) -> str | None:
    """Why a side's place is not what it is said to be; None when it is.

    Args:
        case: gains and family.
        requirement: of the side.
        side: with a place of the family.
        tolerance: of the certificate.
    """
    try:
        return _place_problem(case, requirement, side, tolerance)
    except DomainError as error:  # crossings that cannot be listed
        return f"the place stated cannot be tested: {error}"


def _place_problem(case: Case, requirement: Requirement, side: SideProof, tolerance: float) -> str | None:
    omega = side.worst.omega_rad_s
    if side.verdict is Verdict.REFUTED and side.witness is None:  # no frequency is a crossover
        return None if omega is None else "a frequency is stated of a plant that has no such value"
    if side.witness is None or _is_endless(case, requirement, side):
        return None if _is_where_the_search_ends(case, requirement, side, tolerance) else _NOT_THE_WORST
    if omega is None:
        return "no frequency is stated of the witness"
    if case.implementation is not None and omega > case.implementation.nyquist_rad_s * (1.0 + _ROUNDING):
        return f"omega = {omega:.10g} rad/s is above Nyquist's frequency"
    if QUANTITIES[requirement.quantity].takes_band:
        return None if _is_in_band(requirement, omega) else f"omega = {omega:.10g} rad/s is outside of the band"
    return None if _is_at_its_crossing(case, requirement, side, omega) else _NO_CROSSING.format(omega)


_NO_CROSSING = "omega = {:.10g} rad/s is not the crossing at which the plant stated reaches the witness"
_NOT_THE_WORST = "the plant and the frequency stated are not those of the worst value in floating point"


def _is_endless(case: Case, requirement: Requirement, side: SideProof) -> bool:
    """Whether an upper limit of a margin meets a plant whose margin is infinite, so that no crossing has it."""
    if not QUANTITIES[requirement.quantity].is_margin or not side.upper:
        return False
    return math.isinf(_measured(case, requirement, side)[0])


def _measured(case: Case, requirement: Requirement, side: SideProof) -> tuple[float, float]:
    """The worst value of the plant stated, public unit, and its frequency, in floating point; nan without one."""
    loops = case.loop.loops_at(np.array([side.worst.point], dtype=float))
    quantity = QUANTITIES[requirement.quantity]
    found = quantity.measure(loops, side.upper, requirement.from_rad_s, requirement.to_rad_s, requirement.tilt)
    return float(found.value[0]), float(found.omega_rad_s[0])


def _is_in_band(requirement: Requirement, omega: float) -> bool:
    return requirement.from_rad_s * (1.0 - _ROUNDING) <= omega <= requirement.to_rad_s * (1.0 + _ROUNDING)


def _is_at_its_crossing(case: Case, requirement: Requirement, side: SideProof, omega: float) -> bool:
    """Whether the plant has a crossing at this frequency, with a value that reaches the witness and is close to it."""
    assert side.witness is not None
    scale = gap_scale(requirement, side.witness)
    below, above = (CROSSING_ROUNDING, _SHORT) if side.upper else (_SHORT, CROSSING_ROUNDING)
    low, high = side.witness - below * scale, side.witness + above * scale
    at_end = omega == 0.0 or case.loop.is_beyond(omega)
    box = point_box(side.worst.point)
    if QUANTITIES[requirement.quantity].where is EvaluatedAt.PHASE_CROSSOVERS and at_end:
        claim = SomePhaseCrossover(case.loop, high, ((0.0, 0.0), *box), case.origin)
        return claim.holds(claim.domain, LOW_END if omega == 0.0 else HIGH_END)
    if at_end:  # a delay margin of 0
        claims = violation_claims(case, requirement, side.upper, high, side.worst.point, omega) if omega > 0.0 else []
        stays_large = any(isinstance(claim, SomeCrossover) and claim.holds(claim.domain, HIGH_END) for claim in claims)
        return stays_large and low <= 0.0 <= high
    u = case.loop.u_of(math.log(omega))
    if math.isinf(u):  # a sample time that no double resolves
        return False
    at = case.loop.at_centre(((u, u), *box))
    if QUANTITIES[requirement.quantity].where is EvaluatedAt.PHASE_CROSSOVERS:
        distance, value = (-at.gain).arg(), -abs(at.gain).log()
    elif requirement.quantity in CROSSING_QUANTITIES:
        quantity, unit = CROSSING_QUANTITIES[requirement.quantity]
        distance = abs(at.gain).log()
        if quantity is CrossingQuantity.CROSSOVER:
            value = arb(omega).log()
        else:
            value = case.evaluator.value(quantity, at) * unit
    else:
        return False
    return bool(abs(distance) <= CROSSING_ROUNDING and value >= low and value <= high)


def _is_where_the_search_ends(case: Case, requirement: Requirement, side: SideProof, tolerance: float) -> bool:
    """Whether the search in floating point ends at this place, or at a value that is not worse than this place's."""
    samples = SamplePair(Sample.of(case.family, case.gains, case.implementation))
    result = check_requirement(requirement, samples, check_stability(samples.base), tolerance)
    extreme = next((found for found in result.extremes if found.largest == side.upper), None)
    place = side.worst
    if extreme is None:
        return _is_same_place(place, result.worst)
    if _is_same_place(place, extreme.worst):
        return True
    quantity = QUANTITIES[requirement.quantity]
    value, omega = _measured(case, requirement, side)
    worst = math.nan if extreme.achieved is None else extreme.achieved
    if not (math.isfinite(value) and math.isfinite(worst)):
        same = value == worst or (math.isnan(value) and math.isnan(worst))
        return same and _is_same_frequency(place.omega_rad_s, None if math.isnan(omega) else omega)
    natural = quantity.to_natural(worst)
    slack = _SAME * gap_scale(requirement, natural)
    level = natural - slack if side.upper else natural + slack
    if quantity.takes_band:
        return reaches(case, requirement, side, level)
    as_bad = quantity.to_natural(value) >= level if side.upper else quantity.to_natural(value) <= level
    return as_bad and _is_same_frequency(place.omega_rad_s, omega)


def reaches(case: Case, requirement: Requirement, side: SideProof, level: float) -> bool:
    """Whether a response of the plant stated, at the frequency stated and in the band, is shown to reach a level."""
    point, omega = side.worst.point, side.worst.omega_rad_s
    if omega is None or not _is_in_band(requirement, omega):
        return False
    claims: list[Claim] = violation_claims(case, requirement, side.upper, level, point, omega)
    return bool(claims) and all(claim.examine(claim.domain).leaf is not None for claim in claims)


def _is_same_place(place: Place, other: Place) -> bool:
    near = all(math.isclose(a, b, rel_tol=_SAME) for a, b in zip(place.point, other.point, strict=True))
    return near and _is_same_frequency(place.omega_rad_s, other.omega_rad_s)


def _is_same_frequency(omega: float | None, other: float | None) -> bool:
    if omega is None or other is None:
        return omega is other
    return math.isclose(omega, other, rel_tol=_SAME)
