"""The certificate:  what is proved of gains, and the branch-and-bound records with which it can be checked.

Nothing in a certificate is taken on trust.  `recheck` rebuilds every claim from the plant, the gains and the
requirements, tests every box of its record in ball arithmetic, and compares the verdict with the proved levels.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from fopi_tune.core.text_tables.words import counted
from fopi_tune.proof.obligations import Case
from fopi_tune.proof.output_limits import LimitedLoop
from fopi_tune.proof.scenario_proofs import ScenarioProof, decided
from fopi_tune.proof.verdict import LARGEST_TOLERANCE as LARGEST_TOLERANCE
from fopi_tune.proof.verdict import Verdict as Verdict
from fopi_tune.proof.verdict import overall as overall
from fopi_tune.proof.verification.results import Place
from fopi_tune.quantities import QUANTITIES
from fopi_tune.quantities.base import NEPER_PER_DB
from fopi_tune.spec.model import Relation, Requirement

#: added to the reason of an undecided statement whose searches did not come to an end
_BUDGET_SPENT = "the counted budget of its searches was spent"


@dataclass(frozen=True)
class Record:
    """The branch-and-bound tree that proves one claim.

    Args:
        tokens: the tree in preorder, one token per examined box; see `fopi_tune.proof.claims.branch_and_bound`.
    """

    tokens: tuple[str, ...]

    @property
    def boxes(self) -> int:
        """Number of examined boxes."""
        return len(self.tokens)


@dataclass(frozen=True)
class SideProof:
    """Proof of one limit of a requirement.

    Args:
        upper: whether the limit is an upper one.
        verdict: of this limit.
        level: the bound, natural unit; None when none was proved.  If proved, every plant stays on this side of it; if
            undecided, no plant is known to violate it.
        witness: natural unit; the plant `worst` reaches at least this value (at most, for a lower limit).  None when
            that was not proved.
        worst: the plant and frequency of the witness.
        records: of the claims that prove the level, in the order of `obligations.level_claims`.
        witness_records: of the claims that prove the witness, in the order of `obligations.violation_claims`.
        budget_spent: whether an undecided search ended because its counted budget was spent; unknown, False, of a
            certificate that was read.
    """

    upper: bool
    verdict: Verdict
    level: float | None
    witness: float | None
    worst: Place
    records: tuple[Record, ...]
    witness_records: tuple[Record, ...]
    budget_spent: bool = field(default=False, compare=False)

    @property
    def boxes(self) -> int:
        """Number of boxes examined to prove the level."""
        return sum(record.boxes for record in self.records)


@dataclass(frozen=True)
class RequirementProof:
    """Proof of one requirement: one side for each of its limits."""

    requirement: Requirement
    sides: tuple[SideProof, ...]

    @property
    def verdict(self) -> Verdict:
        """What became of it."""
        return overall(tuple(side.verdict for side in self.sides))

    @property
    def reason(self) -> str:
        """Why the requirement is not proved; empty when it is proved."""
        from_natural = QUANTITIES[self.requirement.quantity].from_natural
        parts = []
        for side in self.sides:
            if side.verdict is Verdict.REFUTED:
                reached = None if side.witness is None else f"a plant reaches {from_natural(side.witness):.10g}"
                parts.append(reached or self._missing)
            elif side.verdict is Verdict.UNDECIDED and side.level is not None and not self._is_empty(side):
                parts.append(f"shown only up to {from_natural(side.level):.6g}")
            elif side.verdict is Verdict.UNDECIDED:
                parts.append("neither a bound nor a violation could be shown")
        return "; ".join(dict.fromkeys(parts))

    def _is_empty(self, side: SideProof) -> bool:
        """Whether a level says nothing: every margin is at least 0."""
        quantity = QUANTITIES[self.requirement.quantity]
        return quantity.is_margin and not side.upper and side.level is not None and side.level <= 0.0

    @property
    def _missing(self) -> str:
        is_margin = QUANTITIES[self.requirement.quantity].is_margin
        return (
            "a plant's loop is not stable, so that it has no margin" if is_margin else "a plant has no gain crossover"
        )

    @property
    def budget_spent(self) -> bool:
        """Whether a search that left it undecided ended because its counted budget was spent."""
        return any(side.budget_spent for side in self.sides)

    @property
    def explanation(self) -> str:
        """The reason, and whether the searches ended before they had an answer."""
        return f"{self.reason}; {_BUDGET_SPENT}" if self.budget_spent else self.reason

    @property
    def bounds(self) -> tuple[float | None, float | None]:
        """Proved lower and upper bound of the value over the whole scope, public unit; None where not proved."""
        from_natural = QUANTITIES[self.requirement.quantity].from_natural
        found: dict[bool, float | None] = {False: None, True: None}
        for side in self.sides:
            if side.level is not None and side.records:
                found[side.upper] = from_natural(side.level)
        return found[False], found[True]

    @property
    def gap(self) -> float | None:
        """The largest relative distance between a proved bound and a proved witness; None where one of them is missing.

        For a gain or a frequency it is the difference of the logarithms; for an angle or a time it is relative to the
        value.  For a requirement `equals`, which is about one plant, it is the distance between the two bounds.
        """
        if self.requirement.relation is Relation.EQUALS:
            levels = [side.level if side.records else None for side in self.sides]
            low, high = levels if len(levels) == 2 else (None, None)
            return None if low is None or high is None else (high - low) / gap_scale(self.requirement, high)
        gaps = [
            None
            if side.level is None or side.witness is None or not side.records
            else abs(side.level - side.witness) / gap_scale(self.requirement, side.witness)
            for side in self.sides
        ]
        known = [gap for gap in gaps if gap is not None]
        return max(known) if len(known) == len(gaps) and known else None


def gap_scale(requirement: Requirement, natural: float) -> float:
    """The scale by which a difference in natural units is divided: the value for angles and times, else 1."""
    relative = requirement.quantity in ("phase_margin_deg", "delay_margin_s", "phase_slope_deg_per_decade")
    return max(abs(natural), 1e-3) if relative else 1.0


@dataclass(frozen=True)
class StabilityProof:
    """Closed-loop stability of the whole family.

    Args:
        verdict: of the family.
        level: neper; |S| <= e^level for every plant and frequency, so no pole crosses the axis; None if not proved.
        point: the plant whose poles were counted.
        poles: its closed-loop poles in the right half-plane; None when they could not be counted.
        records: of the claims of `obligations.stability_claims`.
        budget_spent: as of a `SideProof`.
        member: of a list of plants, the name of the member that decides, whose index is before `point`.
    """

    verdict: Verdict
    level: float | None
    point: tuple[float, ...]
    poles: int | None
    records: tuple[Record, ...]
    budget_spent: bool = field(default=False, compare=False)
    member: str = ""

    @property
    def reason(self) -> str:
        """One sentence."""
        if self.verdict is Verdict.PROVED:
            peak_db = (self.level or 0.0) / NEPER_PER_DB
            return f"the nominal plant is stable, and |S| stays below {peak_db:.2f} dB over the family"
        if self.verdict is Verdict.REFUTED and self.poles is None:
            return "a plant's integral is cancelled, or its dead time is inside a direct path with |L| > 1"
        if self.poles is None:
            return "a plant's closed-loop poles could not be told from the border of stability"
        if self.verdict is Verdict.REFUTED:
            return f"a plant has {self.poles} unstable closed-loop pole{'s' * (self.poles > 1)}"
        return "no bound of |S| over the family could be shown"

    @property
    def explanation(self) -> str:
        """The reason, and whether the searches ended before they had an answer."""
        return f"{self.reason}; {_BUDGET_SPENT}" if self.budget_spent else self.reason


@dataclass(frozen=True, repr=False)
class Certificate:
    """What is proved, refuted or undecided about gains and a spec.

    Args:
        name: of the spec.
        spec_sha256: of its file.
        case: gains and family.
        tolerance: allowed violation of a requirement, natural units (of a delay margin: relative).
        stability: of the whole family.
        requirements: in the order of the spec.
        versions: installed distribution -> version.
        scenarios: of requirements on measures of scenarios.
        limited: the loop with the limits of its control; None where there are none, or no samples.
        members: of a list of plants, the certificate of each; `case` is then that of the first, and everything else
            what they say together (`lists.combine`).
    """

    name: str
    spec_sha256: str
    case: Case
    tolerance: float
    stability: StabilityProof
    requirements: tuple[RequirementProof, ...]
    versions: Mapping[str, str]
    scenarios: tuple[ScenarioProof, ...] = ()
    limited: LimitedLoop | None = None
    members: tuple[MemberCertificate, ...] = ()

    def __repr__(self) -> str:
        proved = sum(proof.verdict is Verdict.PROVED for proof in self.requirements)
        every, boxes = counted(len(self.requirements), "requirement"), counted(self.boxes, "box", "boxes")
        return f"<Certificate of {self.name}: {self.verdict.value}, {proved} of {every} of the loop proved, {boxes}>"

    @property
    def verdict(self) -> Verdict:
        """Verdict of stability and all requirements together.

        Those on scenarios that were left to the check are aside, and the loop with its limits, which was not asked for.
        """
        of_loop = (proof.verdict for proof in self.requirements)
        return overall((self.stability.verdict, *of_loop, *decided(self.scenarios)))

    @property
    def boxes(self) -> int:
        """Number of examined boxes."""
        if self.members:
            return sum(member.certificate.boxes for member in self.members)
        records = [record for proof in self.requirements for side in proof.sides for record in side.records]
        of_scenarios = sum(max(len(each.proof.boxes), 1) for each in self.scenarios)
        return sum(record.boxes for record in (*self.stability.records, *records)) + of_scenarios


@dataclass(frozen=True)
class MemberCertificate:
    """The certificate of one member of a list of plants.

    Args:
        name: of the member.
        certificate: about its plants alone; of any but the first without what is about the nominal plant.
    """

    name: str
    certificate: Certificate


def relaxed_limit(requirement: Requirement, upper: bool, tolerance: float) -> float:
    """The limit relaxed by the tolerance, in natural units."""
    quantity = QUANTITIES[requirement.quantity]
    limit = requirement.upper if upper else requirement.lower
    natural = quantity.to_natural(limit)
    slack = tolerance * (abs(natural) if requirement.quantity == "delay_margin_s" else 1.0)
    return natural + slack if upper else natural - slack
