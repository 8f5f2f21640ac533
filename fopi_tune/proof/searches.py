"""Searches of a certificate within counted budgets.

Every statement (stability, each limit of a requirement) has one budget of work for all its searches: its levels, its
rounds after a counterexample, and the witness.  A search may take a share of what is left, so that a level that
cannot be proved leaves enough for a wider one.  Work is counted, not timed, so the outcome is the same on every
machine.  Its unit is a box of a bound in continuous time, about 0.05 ms; see `BoxVerdict`.
"""

from __future__ import annotations

from fopi_tune.proof.certificate import Record
from fopi_tune.proof.claims.branch_and_bound import SearchResult, search
from fopi_tune.proof.claims.claim import Claim
from fopi_tune.proof.claims.crossing_quantities import CrossingQuantity
from fopi_tune.proof.claims.crossings import EveryCrossover
from fopi_tune.proof.claims.existence import SomeCrossover, SomePhaseCrossover
from fopi_tune.proof.claims.poles import StableOnEveryPiece
from fopi_tune.proof.obligations import Case

#: most boxes for a claim; for a claim that a crossing exists, whose boxes cost more; for a last attempt
BUDGET, CROSSING_BUDGET, LAST_BUDGET = 60_000, 8_000, 4_000
#: most work for a requirement, shared by its limits, and for stability: about 10 s and 3 s
REQUIREMENT_WORK, STABILITY_WORK = 220_000, 60_000
#: share of the work that is left for a search, unless its caller says otherwise
_SHARE = 0.5


class Searches:
    """Runs searches within the work that is left; results that do not depend on a level are cached.

    Args:
        case: the loop that the claims are about.
    """

    def __init__(self, case: Case) -> None:
        self._known: dict[tuple[object, ...], tuple[SearchResult, int]] = {}
        self._loop = case.loop
        self._left = 0
        self._was_cut = False

    def begin(self, work: int) -> None:
        """Begin a statement with this much work for all its searches."""
        self._left, self._was_cut = work, False

    @property
    def were_cut(self) -> bool:
        """Whether a search since `begin` ended because its boxes or its work were spent."""
        return self._was_cut

    def run(self, claim: Claim, most: int = BUDGET, share: float = _SHARE) -> SearchResult:
        """Search result for one claim; without boxes when no work is left.

        Args:
            claim: to be proved.
            most: most boxes.
            share: of the work that is left.
        """
        listing = isinstance(claim, SomeCrossover | SomePhaseCrossover) or _lists_crossings(claim)
        budget = min(CROSSING_BUDGET if listing else BUDGET, most)
        limit, key = int(share * self._left), _key(claim)
        if key in self._known and (self._known[key][0].shown or limit <= self._known[key][1]):
            return self._known[key][0]
        found = search(claim, budget, limit, lambda: self._loop.work)
        self._left -= found.work
        self._was_cut |= bool(found.open_boxes) and (found.boxes >= budget or found.work >= limit)
        if key:
            self._known[key] = found, limit
        return found

    def shown(self, claims: list[Claim], most: int = BUDGET, share: float = _SHARE) -> tuple[Record, ...] | None:
        """Records of all claims; None when there are no claims or one was not proved."""
        records: list[Record] = []
        for claim in claims:
            found = self.run(claim, most, share)
            if not found.shown:
                return None
            records.append(Record(found.record))
        return tuple(records) or None


def _key(claim: Claim) -> tuple[object, ...]:
    """What a claim that does not depend on a level is known by; empty for one that does."""
    if isinstance(claim, SomeCrossover) and claim.level is None:
        return SomeCrossover, claim.domain
    if isinstance(claim, StableOnEveryPiece):
        return StableOnEveryPiece, claim.domain
    return ()


def _lists_crossings(claim: Claim) -> bool:
    """Whether examining a box lists all crossings, because the highest of several decides."""
    if not isinstance(claim, EveryCrossover) or claim.quantity is not CrossingQuantity.PHASE_SLOPE:
        return False
    return claim.evaluator.may_cross_often
