"""What is proved of a system of two loops that take turns, as frozen data with its words.

`settles` needs a settling proof for all setpoints that were asked for.  After `reset` it is about every state, so that
the raising mode's loop must decay with its limits too: its first phase begins anywhere and may last for ever.  If it
does not, the lowering mode follows, and then the raising one once more, from an entry that the settling proof covers.
A lowering mode that is active far below the setpoint adds a switch before that.  `cycles` needs an orbit.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum

from fopi_tune.core.text_tables.words import counted
from fopi_tune.proof.switched.bounded import BoundedProof
from fopi_tune.proof.switched.cycles import CycleProof
from fopi_tune.proof.switched.model import Memory, SwitchedModel
from fopi_tune.proof.switched.saturated_loop import SaturatedLoopProof
from fopi_tune.proof.switched.settling import SettlingProof

#: of every certificate; part of its file
ASSUMPTIONS = (
    "Controllers and plants have exactly the numbers of this file; the controllers' arithmetic is exact.",
    "Controls are held from sample to sample and act after the computing delay, with their plants where modes change; "
    "there is no rate limit, quantisation or noise.",
    "The setpoint is constant from the time on that a statement is about.",
    "Plants are of first order; a time constant may vary within its range while driving, a static gain is constant.",
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
        settling: of raising phases; None where there is no proof.
        reason: why settling is not proved, or not for all setpoints that were asked for; empty where it is.
        cycles: orbits, each proved.
        bounded: that output and memories stay within numbers, whatever switches; None where not even the output does.
        unbounded: what is not bounded, and why; empty where everything is.
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
    bounded: BoundedProof | None
    unbounded: str
    versions: Mapping[str, str]

    @property
    def verdict(self) -> SystemVerdict:
        """What the proofs amount to."""
        if self.cycles:
            return SystemVerdict.CYCLES
        return SystemVerdict.SETTLES if self.settles else SystemVerdict.UNDECIDED

    @property
    def settles(self) -> bool:
        """Whether settling is proved for all setpoints that were asked for, from where the memory allows it."""
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
            f"{proof.told_decay} or more per sample."
            for loop, proof in zip(self.model.loops, self.loops, strict=True)
            if proof is not None
        ]
        if self.model.min_dwell_samples > 1 and (self.settling is not None or self.cycles):
            dwell = self.model.min_dwell_samples
            found.append(f"What follows is for modes that stay at least {counted(dwell, 'sample')} after a switch.")
        if self.settling is not None:
            found.append(self._settling(self.settling))
        if self.bounded is not None:
            found.append(self._bounded(self.bounded))
        if self.unbounded and self.unbounded != self.reason:
            found.append(f"Not bounded by a proof: {self.unbounded}.")
        found += [self._cycle(cycle) for cycle in self.cycles]
        return (*found, *([f"Not proved: {self.reason}."] if self.reason else ()))

    def _settling(self, proof: SettlingProof) -> str:
        (low, high), (raising, lowering) = proof.setpoints, (loop.name for loop in self.model.loops)
        then = (
            f"ends in finite time, then there is no other switch, and the output stays between "
            f"{_upwards(proof.undershoot)} below and {_upwards(proof.overshoot)} above the setpoint."
        )
        settles = f"the output settles on each setpoint from {told(low)} to {told(high)}"
        if self.model.memory is Memory.TRACKING:
            return (
                f"After a step down from rest, from the {raising} to the {lowering}, {settles}: the {lowering} {then}"
            )
        line = "the hysteresis' lower line" if self.model.lines.half_width is not None else self.model.lower_line
        above = f"with the {lowering} active and the output above {line}"
        if self.loops[0] is None:
            return f"From every state {above} {settles}: the {lowering} {then}"
        return (
            f"From every state {settles}, after at most two switches with the {raising} active at first and three "
            f"with the {lowering}. A phase {above} {then}"
        )

    def _bounded(self, proof: BoundedProof) -> str:
        (low, high), (least, most) = proof.outputs, proof.setpoints
        memories = [
            f"the memory of the {loop.name} within {_upwards(bounds.total)} in sum and "
            f"{_upwards(max(bounds.sections))} in each section, in its control's unit"
            for loop, bounds in zip(self.model.loops, proof.memories, strict=True)
            if bounds is not None
        ]
        return (
            f"Under every switching, also one without this hysteresis, every plant of the families, also one that "
            f"varies, and every setpoint that moves between {told(least)} and {told(most)}: from rest at an output "
            f"between {told(low)} and {told(high)} the output stays there{''.join('; ' + each for each in memories)}."
        )

    def _cycle(self, proof: CycleProof) -> str:
        plants = zip(self.model.loops, proof.plants, strict=True)
        numbers = [f"{loop.name}.{name} = {value:g}" for loop, plant in plants for name, value in plant.items()]
        pull = "an attracting" if proof.attracts else "a"
        return (
            f"At setpoint {proof.setpoint:g}{''.join(', ' + each for each in numbers)}: {pull} periodic orbit of "
            f"{counted(len(proof.modes), 'sample')}, from {proof.lowest:+.4g} to {proof.highest:+.4g} around "
            "the setpoint."
        )


def told(end: float) -> str:
    """An end of a range: with six digits where these are all, else with all that it has."""
    short = f"{end:g}"
    return short if float(short) == end else repr(end)


def _upwards(bound: float) -> str:
    """A bound with four digits, not below it."""
    if bound < _LEAST:
        return "0" if bound <= 0.0 else f"{_LEAST:g}"
    step = 10.0 ** (math.floor(math.log10(bound)) - 3)
    return f"{math.ceil(bound / step) * step:.4g}"
