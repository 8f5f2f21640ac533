"""The results of trying to prove statements, and what they amount to together."""

from __future__ import annotations

from enum import StrEnum

#: the largest tolerance of a certificate, natural units: a proof with a larger one would say nothing useful
LARGEST_TOLERANCE = 1e-2
#: why a loop whose controller limits its output's rate is outside of every proof that knows of output limits
RATE_NOT_MODELLED = "an output rate limit is not modelled in this proof"


class Verdict(StrEnum):
    """Result of trying to prove a statement; `advice` says what it means."""

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
    """Verdict of a conjunction: refuted if any statement is refuted, proved if all are proved."""
    if Verdict.REFUTED in verdicts:
        return Verdict.REFUTED
    return Verdict.PROVED if all(v is Verdict.PROVED for v in verdicts) else Verdict.UNDECIDED
