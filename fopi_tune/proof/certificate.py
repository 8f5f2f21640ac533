"""The certificate:  what is proved of gains, and the records with which anybody can check it.

A certificate holds no trust: `recheck` rebuilds every claim from the plant, the gains and the requirements it is about,
tests every box of its record in ball arithmetic, and compares the verdict with the levels that were shown.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum

from fopi_tune.proof.obligations import Case
from fopi_tune.proof.results import Place
from fopi_tune.quantities import QUANTITIES
from fopi_tune.quantities.base import NEPER_PER_DB
from fopi_tune.spec.model import Relation, Requirement

#: a requirement that may be missed by more has not been proved in any sense of the word; natural units
LARGEST_TOLERANCE = 1e-2


class Verdict(StrEnum):
    """What became of a statement; `advice` says what that means."""

    PROVED = "proved"
    REFUTED = "refuted"
    UNDECIDED = "undecided"

    @property
    def advice(self) -> str:
        """One sentence."""
        return {
            Verdict.PROVED: "It holds for every plant of the family and every frequency.",
            Verdict.REFUTED: "A plant and a frequency are named at which it does not hold.",
            Verdict.UNDECIDED: "Neither was shown; the gap that is left is stated.",
        }[self]


def overall(verdicts: tuple[Verdict, ...]) -> Verdict:
    """Of several statements together: refuted if one is, proved if all are."""
    if Verdict.REFUTED in verdicts:
        return Verdict.REFUTED
    return Verdict.PROVED if all(v is Verdict.PROVED for v in verdicts) else Verdict.UNDECIDED


@dataclass(frozen=True)
class Record:
    """How one claim was shown.

    Args:
        tokens: the tree of boxes, as `fopi_tune.proof.claims.branch_and_bound` describes it, one token a box that was looked at.
    """

    tokens: tuple[str, ...]

    @property
    def boxes(self) -> int:
        """Boxes looked at."""
        return len(self.tokens)


@dataclass(frozen=True)
class SideProof:
    """One limit of a requirement.

    Args:
        upper: the limit is an upper one.
        verdict: what became of it.
        level: natural unit; when proved every plant stays on this side of it, when undecided none is known to break it.
            None when nothing was shown.
        witness: natural unit; the plant `worst` reaches at least (at most, for a lower limit) this; None when that was
            not shown.
        worst: the plant and frequency of the witness.
        records: of the claims that show the level, in the order of `obligations.stays`.
        witness_records: of those that show the witness, in the order of `obligations.breaks`.
    """

    upper: bool
    verdict: Verdict
    level: float | None
    witness: float | None
    worst: Place
    records: tuple[Record, ...]
    witness_records: tuple[Record, ...]

    @property
    def boxes(self) -> int:
        """Boxes looked at for the level."""
        return sum(record.boxes for record in self.records)


@dataclass(frozen=True)
class RequirementProof:
    """One requirement, both of its limits where it has two."""

    requirement: Requirement
    sides: tuple[SideProof, ...]

    @property
    def verdict(self) -> Verdict:
        """What became of it."""
        return overall(tuple(side.verdict for side in self.sides))

    @property
    def reason(self) -> str:
        """Why it is not proved; empty when it is."""
        from_natural = QUANTITIES[self.requirement.quantity].from_natural
        parts = []
        for side in self.sides:
            if side.verdict is Verdict.REFUTED:
                reached = None if side.witness is None else f"a plant reaches {from_natural(side.witness):.10g}"
                parts.append(reached or "a plant has no gain crossover")
            elif side.verdict is Verdict.UNDECIDED and side.level is not None:
                parts.append(f"shown only up to {from_natural(side.level):.6g}")
            elif side.verdict is Verdict.UNDECIDED:
                parts.append("neither a bound nor a violation could be shown")
        return "; ".join(dict.fromkeys(parts))

    @property
    def bounds(self) -> tuple[float | None, float | None]:
        """What is proved of the value over the whole scope: it lies from the first to the second; public unit."""
        from_natural = QUANTITIES[self.requirement.quantity].from_natural
        found: dict[bool, float | None] = {False: None, True: None}
        for side in self.sides:
            if side.level is not None and side.records:
                found[side.upper] = from_natural(side.level)
        return found[False], found[True]

    @property
    def gap(self) -> float | None:
        """The largest distance from a proved bound to a value that is reached, relative; None where one is missing.

        Of a gain or a frequency the difference of logarithms; of an angle or a time relative to its size.  Of a
        requirement `equals`, which is about one plant, the width between its two bounds.
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
    """What a difference in natural units is relative to."""
    relative = requirement.quantity in ("phase_margin_deg", "delay_margin_s", "phase_slope_deg_per_decade")
    return max(abs(natural), 1e-3) if relative else 1.0


@dataclass(frozen=True)
class StabilityProof:
    """Closed-loop stability of the whole family.

    Args:
        verdict: what became of it.
        level: neper; |S| <= e^level for every plant and frequency, so that no pole passes the axis; None if not shown.
        point: the plant whose poles were counted.
        poles: its closed-loop poles in the right half-plane; None when they could not be counted.
        records: of the claims of `obligations.stable_throughout`.
    """

    verdict: Verdict
    level: float | None
    point: tuple[float, ...]
    poles: int | None
    records: tuple[Record, ...]

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


@dataclass(frozen=True)
class Certificate:
    """What is proved, refuted or left undecided of gains against a spec.

    Args:
        name: of the spec.
        spec_sha256: of its file.
        case: gains and family.
        tolerance: by how much a requirement may be missed, natural units (a delay margin: relative).
        stability: of the whole family.
        requirements: in the order of the spec.
        versions: distribution to version, of what computed it.
    """

    name: str
    spec_sha256: str
    case: Case
    tolerance: float
    stability: StabilityProof
    requirements: tuple[RequirementProof, ...]
    versions: Mapping[str, str]

    @property
    def verdict(self) -> Verdict:
        """Of everything together."""
        return overall((self.stability.verdict, *(proof.verdict for proof in self.requirements)))

    @property
    def boxes(self) -> int:
        """Boxes looked at."""
        records = [record for proof in self.requirements for side in proof.sides for record in side.records]
        return sum(record.boxes for record in (*self.stability.records, *records))


def relaxed_limit(requirement: Requirement, upper: bool, tolerance: float) -> float:
    """A limit and what it may be missed by, in natural units."""
    quantity = QUANTITIES[requirement.quantity]
    limit = requirement.upper if upper else requirement.lower
    natural = quantity.to_natural(limit)
    slack = tolerance * (abs(natural) if requirement.quantity == "delay_margin_s" else 1.0)
    return natural + slack if upper else natural - slack
