"""What is proved of a system of two loops that take turns, as frozen data with its words.

`settles` needs a settling proof for all setpoints that were asked for.  After `reset` it is about every state, so that
the throttle's loop must decay with its limits too: its first phase begins anywhere and may last for ever.  If it does
not, the brake follows, and then the throttle once more, from an entry that the settling proof covers.  A brake that is
active far below the setpoint adds a switch before that.  `cycles` needs an orbit.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum

from fopi_tune.proof.switched.cycles import CycleProof
from fopi_tune.proof.switched.model import Memory, SwitchedModel
from fopi_tune.proof.switched.saturated_loop import SaturatedLoopProof
from fopi_tune.proof.switched.settling import SettlingProof

#: of every certificate; part of its file
ASSUMPTIONS = (
    "Controllers and plants have exactly the numbers of this file; the controllers' arithmetic is exact.",
    "Controls are held from sample to sample, without computing delay, rate limit, quantisation or noise.",
    "The setpoint is constant from the time on that a statement is about.",
    "Plants are of first order; a time constant may vary within its range while driving, a gain is constant.",
)
#: bounds below are told as this one
_LEAST = 1e-12


class SystemVerdict(StrEnum):
    """What is known of a system; `advice` says what it means."""

    SETTLES = "settles"
    CYCLES = "cycles"
    UNDECIDED = "undecided"

    @property
    def advice(self) -> str:
        """One sentence."""
        return {
            SystemVerdict.SETTLES: "The output settles on every setpoint of the range, after a few switches.",
            SystemVerdict.CYCLES: "A periodic orbit is named in which the modes take turns for ever.",
            SystemVerdict.UNDECIDED: "Neither was shown; what is proved nevertheless is stated.",
        }[self]


@dataclass(frozen=True)
class SystemCertificate:
    """Everything that is proved of a system.

    Args:
        name: of the system.
        system_sha256: of its file and its specs.
        model: the loops that it is about.
        setpoints: least and largest setpoint that were asked for, output unit; None: as many as can be proved.
        loops: that each loop decays with its limits from every state, in the order of the modes; None where not.
        settling: of throttle phases; None where there is no proof.
        reason: why settling is not proved, or not for all setpoints that were asked for; empty where it is.
        cycles: orbits, each proved.
        versions: of the programs that made it, by name.
    """

    name: str
    system_sha256: str
    model: SwitchedModel
    setpoints: tuple[float, float] | None
    loops: tuple[SaturatedLoopProof | None, SaturatedLoopProof | None]
    settling: SettlingProof | None
    reason: str
    cycles: tuple[CycleProof, ...]
    versions: Mapping[str, str]

    @property
    def verdict(self) -> SystemVerdict:
        """What the proofs amount to."""
        if self.cycles:
            return SystemVerdict.CYCLES
        return SystemVerdict.SETTLES if self.settles else SystemVerdict.UNDECIDED

    @property
    def settles(self) -> bool:
        """Whether settling is stated for all setpoints that were asked for; then there is no reason why not."""
        if self.settling is None or (self.model.memory is Memory.RESET and self.loops[0] is None):
            return False
        (low, high), asked = self.settling.setpoints, self.setpoints or self.settling.setpoints
        return low <= asked[0] and asked[1] <= high

    @property
    def statements(self) -> tuple[str, ...]:
        """What is proved, a sentence each; the reason last where something is missing."""
        found = [
            f"{loop.name}: with its limits and anti-windup the loop alone settles from every state, on each setpoint "
            f"that a control within the limits holds; the state's norm shrinks by the factor "
            f"{proof.decay:.6g} or more per sample."
            for loop, proof in zip(self.model.loops, self.loops, strict=True)
            if proof is not None
        ]
        if self.settling is not None:
            found.append(self._settling(self.settling))
        found += [self._cycle(cycle) for cycle in self.cycles]
        return (*found, *([f"Not proved: {self.reason}."] if self.reason else ()))

    def _settling(self, proof: SettlingProof) -> str:
        (low, high), (throttle, brake) = proof.setpoints, (loop.name for loop in self.model.loops)
        if self.model.memory is Memory.TRACKING:
            start = f"After a step down from rest, from the {throttle} to the {brake}"
        elif self.loops[0] is not None:
            start = f"From every state with the {throttle} active, after at most two switches, and else after three"
        else:
            start = f"From every state with the {brake} active and the output above the hysteresis' lower line"
        return (
            f"{start}, the output settles on each setpoint from {low:g} to {high:g}: the {brake} ends in finite time, "
            f"then there is no other switch, and the output stays between {_upwards(proof.undershoot)} below and "
            f"{_upwards(proof.overshoot)} above the setpoint."
        )

    def _cycle(self, proof: CycleProof) -> str:
        plants = zip(self.model.loops, proof.plants, strict=True)
        numbers = [f"{loop.name}.{name} = {value:g}" for loop, plant in plants for name, value in plant.items()]
        pull = "an attracting" if proof.attracts else "a"
        return (
            f"At setpoint {proof.setpoint:g}{''.join(', ' + each for each in numbers)}: {pull} periodic orbit of "
            f"{len(proof.modes)} samples, from {proof.lowest:+.4g} to {proof.highest:+.4g} around the setpoint."
        )


def _upwards(bound: float) -> str:
    """A bound with four digits, not below it."""
    if bound < _LEAST:
        return "0" if bound <= 0.0 else f"{_LEAST:g}"
    step = 10.0 ** (math.floor(math.log10(bound)) - 3)
    return f"{math.ceil(bound / step) * step:.4g}"
