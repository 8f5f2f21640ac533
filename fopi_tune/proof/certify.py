"""Prove or refute every requirement of a spec for given gains, over all plants and all frequencies.

The verification in floating point finds the worst value of each quantity and where it occurs.  That value is confirmed
in ball arithmetic (the witness).  A level just beyond it is proved for the whole family (the bound).  The distance
between the two is the gap.  Floating point only selects what to prove; every proof is in ball arithmetic.
"""

from __future__ import annotations

import logging
import math
from dataclasses import dataclass, replace

from flint import arb, ctx

from fopi_tune.core.bode_form import Array
from fopi_tune.core.families.plant_list import PlantList
from fopi_tune.core.parallel_form import Implementation
from fopi_tune.proof.balls.box import point_box
from fopi_tune.proof.balls.loop import PRECISION
from fopi_tune.proof.certificate import (
    Certificate,
    MemberCertificate,
    Record,
    RequirementProof,
    SideProof,
    StabilityProof,
    Verdict,
    gap_scale,
    relaxed_limit,
)
from fopi_tune.proof.claims.bound import Line, response_of
from fopi_tune.proof.claims.claim import Claim
from fopi_tune.proof.claims.poles import count_unstable_poles
from fopi_tune.proof.lists.combine import of_certificates
from fopi_tune.proof.obligations import (
    Case,
    is_unstable,
    level_claims,
    no_crossover_claims,
    stability_claims,
    violation_claims,
)
from fopi_tune.proof.output_limits import prove_with_limits
from fopi_tune.proof.scenario_proofs import ScenarioProof, prove_scenarios
from fopi_tune.proof.searches import BUDGET, LAST_BUDGET, REQUIREMENT_WORK, STABILITY_WORK, Searches
from fopi_tune.proof.verification.results import Extreme, Outcome, Place, RequirementResult, Verification
from fopi_tune.proof.verification.verify import verify
from fopi_tune.quantities import QUANTITIES
from fopi_tune.quantities.base import NEPER_PER_DB
from fopi_tune.quantities.responses import FrequencyFunction
from fopi_tune.spec.lists.members import member_specs
from fopi_tune.spec.model import DesignSpec, Relation, Requirement, Scope

_log = logging.getLogger(__name__)
#: relative distances from the worst value to the level to be proved, tried in turn
_GAPS = (5e-7, 5e-5, 5e-4, 1e-2)
#: the same for `equals`, which is about one plant: its bounds are the enclosure of the value
_ENCLOSURES = (4e-12, 1e-10, 1e-8)
#: a worst value relatively closer to the limit than this: proving the limit itself would take too many boxes
_LEAST_ROOM = 1e-8
#: natural units; this much beyond the limit is shown at least, half of what a recheck sees of an undecided side
_LEAST_BEYOND = 5e-4
#: relative distance of the witness from the value in floating point
_WITNESS = 1e-10
_MOST_ROUNDS = 6
#: shares of the work that is left: for the tightest level, one between, and the last, which leaves some to the end
_FIRST_SHARE, _NEXT_SHARE, _LAST_SHARE = 0.6, 0.2, 0.7
#: neper above the peak of |S|; for stability any finite bound suffices
_STABILITY_MARGINS = (0.7, 2.0, 6.0)
#: share of the work that is left for each: half of it remains for the last
_STABILITY_SHARES = (0.25, 1 / 3, 1.0)


def certify(
    spec: DesignSpec, found: Verification, versions: dict[str, str], implementation: Implementation | None = None
) -> Certificate:
    """Turn a verification into a certificate.

    Args:
        spec: the requirements and the plant family.
        found: the verification of the gains.
        versions: installed distribution -> version, for the certificate.
        implementation: the digital controller that the verification was about; None in continuous time.

    Returns:
        The certificate; of a list of plants with that of each member.
    """
    if isinstance(spec.plant, PlantList):
        # a verification of what a result says has not that of each member
        verified = found if found.members else verify(spec, found.gains, found.tolerance, implementation)
        return of_certificates(
            [
                MemberCertificate(member.name, certify(own, each, versions, implementation))
                for member, own, each in zip(spec.plant.members, member_specs(spec), verified.members, strict=True)
            ]
        )
    case = Case(found.gains, spec.plant, 0.0, None, implementation)
    crossings = tuple(case.loop.u_of(math.log(omega)) for omega in found.nominal.gain_crossovers_rad_s)
    case = replace(case, origin=_origin(case, crossings), nominal_crossings=crossings)
    with ctx.workprec(PRECISION):
        searches = Searches(case)
        stability = _stability(case, found, searches)
        _log.debug("%s: stability %s", spec.name, stability.verdict.value)
        proofs = tuple(
            _requirement(case, result, found.tolerance, searches, _has_margins(case, stability, result.requirement))
            for result in found.requirements
        )
        for proof in proofs:
            boxes = sum(side.boxes for side in proof.sides)
            _log.debug("%s: %s %s, %d boxes", spec.name, proof.requirement.quantity, proof.verdict.value, boxes)
    scenarios: tuple[ScenarioProof, ...] = ()
    if implementation is not None and spec.scenario_requirements:
        scenarios = prove_scenarios(spec, implementation, found.tolerance)
    limited = prove_with_limits(spec, implementation)
    made = Certificate(
        spec.name, spec.text_sha256, case, found.tolerance, stability, proofs, versions, scenarios, limited
    )
    _log.info("%s: proof: %s, %d boxes", spec.name, made.verdict.value, made.boxes)
    return made


def _origin(case: Case, crossings: tuple[float, ...]) -> float:
    """u = ln omega of the nominal crossover; without one, the middle of the nominal loop's corner frequencies."""
    if crossings and math.isfinite(crossings[-1]):
        return crossings[-1]
    low, high = (end[0] for end in case.loop.loops_at(case.family.nominal_point[None, :]).log.corners())
    return float(0.5 * (low + high)) if math.isfinite(low + high) else 0.0


def _stability(case: Case, found: Verification, searches: Searches) -> StabilityProof:
    searches.begin(STABILITY_WORK)
    if not found.stability.stable:
        worst = found.stability.worst.point
        if is_unstable(case, worst):
            return StabilityProof(Verdict.REFUTED, None, worst, count_unstable_poles(case.loop, worst, case.origin), ())
    poles = count_unstable_poles(case.loop, case.nominal, case.origin)
    if poles:
        return StabilityProof(Verdict.REFUTED, None, case.nominal, poles, ())
    if poles == 0:
        for margin, share in zip(_STABILITY_MARGINS, _STABILITY_SHARES, strict=True):
            level = found.stability.peak_sensitivity_db * NEPER_PER_DB + margin
            records = searches.shown(stability_claims(case, level), share=share)
            if records is not None:
                return StabilityProof(Verdict.PROVED, level, case.nominal, 0, records)
    return StabilityProof(Verdict.UNDECIDED, None, case.nominal, poles, (), searches.were_cut)


def _has_margins(case: Case, stability: StabilityProof, requirement: Requirement) -> bool:
    """Whether every loop in the requirement's scope is shown to be stable, where it asks for a margin."""
    if not QUANTITIES[requirement.quantity].is_margin or stability.verdict is Verdict.PROVED:
        return True
    return requirement.scope is Scope.NOMINAL and count_unstable_poles(case.loop, case.nominal, case.origin) == 0


def _requirement(
    case: Case, result: RequirementResult, tolerance: float, searches: Searches, has_margins: bool
) -> RequirementProof:
    requirement = result.requirement
    if result.outcome is Outcome.BEYOND_NYQUIST:
        ends = [upper for upper in (False, True) if math.isfinite(requirement.upper if upper else requirement.lower)]
        unknown = (SideProof(upper, Verdict.UNDECIDED, None, None, result.worst, (), ()) for upper in ends)
        return RequirementProof(requirement, tuple(unknown))
    work = REQUIREMENT_WORK // max(len(result.extremes), 1)
    sides = tuple(_Side(case, requirement, extreme, tolerance, searches, work).proof() for extreme in result.extremes)
    if not has_margins:
        # what is shown of the loop's distance to -1 is no bound of the margin of a loop that may be unstable
        undecided = (Verdict.REFUTED if side.verdict is Verdict.REFUTED else Verdict.UNDECIDED for side in sides)
        sides = tuple(replace(s, verdict=v, level=None, records=()) for s, v in zip(sides, undecided, strict=True))
    return RequirementProof(requirement, sides)


@dataclass(frozen=True)
class _Side:
    """One limit of one requirement, and the worst value that the verification found for it."""

    case: Case
    requirement: Requirement
    extreme: Extreme
    tolerance: float
    searches: Searches
    work: int

    @property
    def upper(self) -> bool:
        return self.extreme.largest

    @property
    def limit(self) -> float:
        return self.requirement.upper if self.upper else self.requirement.lower

    @property
    def relaxed(self) -> float:
        return relaxed_limit(self.requirement, self.upper, self.tolerance)

    def beyond(self, natural: float, amount: float) -> float:
        """The value moved by this amount in the direction of violation: up for an upper limit, down for a lower one."""
        return natural + amount if self.upper else natural - amount

    def is_beyond(self, natural: float, other: float) -> bool:
        """Whether one value is worse than another: larger for an upper limit, smaller for a lower one."""
        return natural > other if self.upper else natural < other

    def proof(self) -> SideProof:
        """Refuted, proved or undecided; within the work of this side."""
        self.searches.begin(self.work)
        place = self.extreme.worst
        if self.extreme.achieved is None:
            return self._without_value(place)
        achieved = self.extreme.achieved
        if math.isinf(achieved):
            return self._infinite(achieved, place)
        worst = QUANTITIES[self.requirement.quantity].to_natural(achieved)
        if self.is_beyond(worst, self.relaxed):
            return self._refuted(worst, place)
        for _ in range(_MOST_ROUNDS):
            outcome = self._proved(worst, place)
            if isinstance(outcome, SideProof):
                return outcome
            # A plant is worse than the verification found: does one violate the limit itself?
            breaking = self._at(self._broken(self.relaxed))
            if breaking is not None:
                return self._refuted(*breaking)
            worse = self._at(outcome)
            if worse is None or not self.is_beyond(worse[0], worst):
                break
            worst, place = worse
            if self.is_beyond(worst, self.relaxed):
                return self._refuted(worst, place)
        return self._undecided(worst, place, None, ())

    def _broken(self, level: float) -> tuple[float, ...]:
        """A point (u, then the plant) that violates a level; empty when the search finds none."""
        for claim in level_claims(self.case, self.requirement, self.upper, level):
            found = self.searches.run(claim)
            if found.counterexample is not None:
                return found.counterexample if len(found.counterexample) > 1 else self._with_plant(claim)
        return ()

    def _result(
        self,
        verdict: Verdict,
        level: float | None,
        witness: float | None,
        place: Place,
        records: tuple[Record, ...],
        witness_records: tuple[Record, ...],
    ) -> SideProof:
        cut = verdict is Verdict.UNDECIDED and self.searches.were_cut
        return SideProof(self.upper, verdict, level, witness, place, records, witness_records, cut)

    def _without_value(self, place: Place) -> SideProof:
        if QUANTITIES[self.requirement.quantity].is_margin:
            verdict = Verdict.REFUTED if is_unstable(self.case, place.point) else Verdict.UNDECIDED
            return self._result(verdict, None, None, place, (), ())
        records = self.searches.shown(no_crossover_claims(self.case, place.point))
        verdict = Verdict.UNDECIDED if records is None else Verdict.REFUTED
        return self._result(verdict, None, None, place, (), records or ())

    def _infinite(self, achieved: float, place: Place) -> SideProof:
        """An infinite margin: only the limit itself is proved.  An infinite response violates every limit."""
        natural = QUANTITIES[self.requirement.quantity].to_natural(self.limit)
        if (achieved > 0) is not self.upper:
            records = self.searches.shown(level_claims(self.case, self.requirement, self.upper, natural), share=1.0)
            if records is not None:
                return self._result(Verdict.PROVED, natural, None, place, records, ())
            return self._result(Verdict.UNDECIDED, None, None, place, (), ())
        return self._refuted(self.beyond(self.relaxed, 1.0), place)

    def _witness(self, worst: float, place: Place) -> tuple[float, tuple[Record, ...]] | None:
        """A level just short of the worst value, and the proof that the worst plant violates it."""
        for amount in (_WITNESS, 1e-7):
            level = self.beyond(worst, -amount * gap_scale(self.requirement, worst))
            claims = violation_claims(self.case, self.requirement, self.upper, level, place.point, place.omega_rad_s)
            records = self.searches.shown(claims)
            if records is not None:
                return level, records
        return None

    def _refuted(self, worst: float, place: Place) -> SideProof:
        # at most half-way to the limit; of a peak that is a pole but for rounding, close to the limit
        room, scale = abs(worst - self.relaxed), gap_scale(self.requirement, worst)
        near = [min(amount * scale, 0.5 * room) for amount in (1e-10, 1e-7, 1e-3)]
        for amount in (*near, 0.5 * room, 0.9 * room, room - min(0.1 * room, _LEAST_BEYOND)):
            level = self.beyond(worst, -amount)
            claims = violation_claims(self.case, self.requirement, self.upper, level, place.point, place.omega_rad_s)
            records = self.searches.shown(claims)
            if records is not None:
                return self._result(Verdict.REFUTED, None, level, place, (), records)
        return self._result(Verdict.UNDECIDED, None, None, place, (), ())

    def _with_plant(self, claim: Claim) -> tuple[float, ...]:
        """A counterexample of the general claim, with its plant: a closed form has no plant axes; empty if none."""
        general = getattr(claim, "general", None)
        return () if general is None else self.searches.run(general).counterexample or ()

    def _proved(self, worst: float, place: Place) -> SideProof | tuple[float, ...]:
        """A proof, an undecided result, or a point (u, then the plant) beyond a level close to the worst value."""
        witness = self._witness(worst, place)
        reached, witness_records = witness if witness is not None else (None, ())
        levels = self._levels(worst)
        for level in levels:
            # full budget for the tightest and for the last level only
            last, first = level == levels[-1], level == levels[0]
            most = BUDGET if last or first else LAST_BUDGET
            share = _LAST_SHARE if last else _FIRST_SHARE if first else _NEXT_SHARE
            claims = level_claims(self.case, self.requirement, self.upper, level)
            records: list[Record] = []
            for claim in claims:
                found = self.searches.run(claim, most, share)
                if found.counterexample is not None:
                    return found.counterexample if len(found.counterexample) > 1 else self._with_plant(claim)
                if not found.shown:
                    break
                records.append(Record(found.record))
            if claims and len(records) == len(claims):
                return self._result(Verdict.PROVED, level, reached, place, tuple(records), witness_records)
        return self._undecided(worst, place, reached, witness_records)

    def _levels(self, worst: float) -> list[float]:
        """Levels to prove, the tightest first; none beyond the relaxed limit."""
        equal = self.requirement.relation is Relation.EQUALS
        gaps = (*_ENCLOSURES, *_GAPS) if equal else _GAPS
        levels = [self.beyond(worst, gap * gap_scale(self.requirement, worst)) for gap in gaps]
        strict = relaxed_limit(self.requirement, self.upper, 0.0)
        room = _LEAST_ROOM * gap_scale(self.requirement, worst)
        if not equal and self.is_beyond(strict, self.beyond(worst, room)):  # a level beyond the limit gains nothing
            levels = [strict if self.is_beyond(level, strict) else level for level in levels]
        inside = [level for level in levels if not self.is_beyond(level, self.relaxed)]
        return list(dict.fromkeys([*inside, self.relaxed]))

    def _undecided(
        self, worst: float, place: Place, reached: float | None, witness_records: tuple[Record, ...]
    ) -> SideProof:
        """Undecided, with the tightest of a few levels beyond the limit that can be proved: it bounds the gap."""
        for width in (0.01, 0.1, 1.0):
            level = self.beyond(self.relaxed, width * gap_scale(self.requirement, worst))
            records = self.searches.shown(level_claims(self.case, self.requirement, self.upper, level), LAST_BUDGET)
            if records is not None:
                return self._result(Verdict.UNDECIDED, level, reached, place, records, witness_records)
        return self._result(Verdict.UNDECIDED, None, reached, place, (), witness_records)

    def _at(self, where: tuple[float, ...]) -> tuple[float, Place] | None:
        """Value and place of a counterexample to a claim."""
        quantity = QUANTITIES[self.requirement.quantity]
        if not isinstance(quantity, FrequencyFunction) or len(where) != self.case.loop.axes:
            return None
        point = where[1:]
        value = abs(response_of(self.case.loop.at_centre(point_box((where[0], *point))), quantity.response)).log()
        frequency = self.case.loop.frequency(arb(where[0]).exp())
        if (line := Line.of(self.requirement)) is not None:
            value = value - line.at(frequency)
        omega = float(frequency.mid())
        place = Place(omega, self.case.family.describe(_array(point)), point)
        return float(arb(value).mid()), place


def _array(point: tuple[float, ...]) -> Array:
    import numpy as np

    return np.array(point, dtype=float)
