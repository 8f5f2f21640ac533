"""A periodic orbit of the switched loop, proved in balls:  word of modes and limits -> the orbit and its pull.

A word says, for each sample of a period, which mode is active and where its demanded control lies.  The product of the
maps of its samples is z -> M z + c; the orbit that follows the word begins at

    z = (I - M)^-1 c .                                                                                               (1)

It is an orbit of the loop if at each sample the output is on the side of the lines that the word's modes
ask for, except where the minimum dwell keeps the mode whatever the output is, and the demanded control in the part of
the limits that it says.  No mode of the word is shorter than that dwell.  All these inequalities are strict here, so
that the same word is followed from all states around z.  With S > 0 and

    S - M' S M > 0                                                                                                   (2)

these states come closer by every period: the orbit attracts them, and a small disturbance does not end it.

Source: (1) is the fixed point of an affine map, (2) Stein's inequality; both derived here for the loop of `model`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from flint import arb, arb_mat, ctx

from fopi_tune.proof.switched.definite import Triangle, is_positive_definite, symmetric
from fopi_tune.proof.switched.model import SwitchedModel, lag_at
from fopi_tune.proof.switched.sample_map import ABOVE, BELOW, SampleMap, sample_map

#: bits; samples of the longest word
_PRECISION = 256
LONGEST_WORD = 1000


@dataclass(frozen=True)
class CycleProof:
    """A periodic orbit.

    Args:
        setpoint: r, in the output's unit.
        plants: the uncertain numbers of both plants, the raising mode's first, by name, in the specs' units.
        modes: a letter for each sample of the period: `T` for the first mode, `B` for the second.
        parts: where the demanded control lies: `-` below its limits, `0` within, `+` above.
        attraction: lower triangle of S; None where (2) is not claimed.
        lowest: least y - r of the orbit, output unit, rounded.
        highest: largest y - r of the orbit, output unit, rounded.
    """

    setpoint: float
    plants: tuple[Mapping[str, float], Mapping[str, float]]
    modes: str
    parts: str
    attraction: Triangle | None
    lowest: float
    highest: float

    @property
    def attracts(self) -> bool:
        """Whether the orbit is proved to attract the states around it."""
        return self.attraction is not None


@dataclass(frozen=True)
class Orbit:
    """What the verification found.

    Args:
        matrix: M of the whole period without the constant, shape (N, N).
        deviations: y - r at each sample of the period, output unit, rounded.
    """

    matrix: arb_mat
    deviations: tuple[float, ...]

    @property
    def lowest(self) -> float:
        """Least y - r, output unit."""
        return min(self.deviations)

    @property
    def highest(self) -> float:
        """Largest y - r, output unit."""
        return max(self.deviations)


def verify_cycle(model: SwitchedModel, proof: CycleProof) -> Orbit | None:
    """Whether the orbit exists, follows its word strictly, and attracts where that is claimed; None where it does not.

    Args:
        model: with `obstacle == ""`.
        proof: what is claimed; its `lowest` and `highest` are not read.
    """
    if not _is_word(proof) or not _are_plants(model, proof):
        return None
    with ctx.workprec(_PRECISION):
        setpoint = arb(proof.setpoint)
        maps = _maps(model, proof, setpoint)
        size = maps[0].matrix.nrows()
        whole = maps[0].matrix
        for each in maps[1:]:
            whole = each.matrix * whole
        state = size - 1
        matrix = arb_mat([row[:state] for row in whole.tolist()[:state]])
        constant = arb_mat([row[state:] for row in whole.tolist()[:state]])
        identity = arb_mat([[int(i == j) for j in range(state)] for i in range(state)])
        try:
            start = (identity - matrix).solve(constant)
        except ZeroDivisionError:
            return None
        outputs = _outputs(model, proof, maps, arb_mat([*start.tolist(), [arb(1)]]), setpoint)
        if outputs is None or (proof.attraction is not None and not _attracts(proof.attraction, matrix)):
            return None
        return Orbit(matrix, tuple(float((y - setpoint).mid()) for y in outputs))


def _is_word(proof: CycleProof) -> bool:
    modes, parts = proof.modes, proof.parts
    letters = set(modes) == {"T", "B"} and set(parts) <= set("-0+")
    return letters and len(modes) == len(parts) <= LONGEST_WORD


def _are_plants(model: SwitchedModel, proof: CycleProof) -> bool:
    """Whether the plants are members of their families."""
    for loop, numbers in zip(model.loops, proof.plants, strict=True):
        if set(numbers) != set(loop.plant.uncertain_names):
            return False
        ranges = loop.plant.parameters
        if not all(ranges[name].min <= value <= ranges[name].max for name, value in numbers.items()):
            return False
    raising, lowering = proof.plants
    return all(raising[name] == lowering[name] for name in model.shared)


def _maps(model: SwitchedModel, proof: CycleProof, setpoint: arb) -> list[SampleMap]:
    """The map of each sample; equal ones are the same object."""
    lags = [lag_at(loop, model.sample_time_s, numbers) for loop, numbers in zip(model.loops, proof.plants, strict=True)]
    known: dict[tuple[str, str, bool], SampleMap] = {}
    found = []
    for k, (mode, part) in enumerate(zip(proof.modes, proof.parts, strict=True)):
        key = mode, part, proof.modes[k - 1] != mode
        if key not in known:
            known[key] = sample_map(model, lags, setpoint, "TB".index(mode), part, key[2])
        found.append(known[key])
    return found


def _outputs(
    model: SwitchedModel, proof: CycleProof, maps: list[SampleMap], z: arb_mat, setpoint: arb
) -> list[arb] | None:
    """y at each sample of the period; None where an inequality is not strict."""
    outputs, upper, lower = [], setpoint + arb(model.upper), setpoint + arb(model.lower)
    stayed = _samples_before_last_switch(proof.modes)
    for k, each in enumerate(maps):
        y, v = z[0, 0], (each.demand * z)[0, 0]
        kept = stayed[k] < model.min_dwell_samples
        # the line is the upper one as long as the raising mode was active, else the lower one
        line = upper if proof.modes[k - 1] == "T" else lower
        above, below = y > line, y < line
        controller = model.loops["TB".index(proof.modes[k])].controller
        low, high = arb(controller.limits[0]), arb(controller.limits[1])
        if proof.parts[k] == BELOW:
            within = v < low
        elif proof.parts[k] == ABOVE:
            within = v > high
        else:
            within = low < v < high
        switching = proof.modes[k] == proof.modes[k - 1] if kept else (above if proof.modes[k] == "B" else below)
        if not (within and switching):
            return None
        outputs.append(y)
        z = each.matrix * z
    return outputs


def _samples_before_last_switch(modes: str) -> list[int]:
    """How many samples the mode before each one has lasted when that one begins; the word goes on in a circle."""
    count, found = len(modes) - len(modes.rstrip(modes[-1])), []
    for k, mode in enumerate(modes):
        found.append(count)
        count = count + 1 if mode == modes[k - 1] else 1
    return found


def _attracts(triangle: Triangle, matrix: arb_mat) -> bool:
    """(2)."""
    if len(triangle) != matrix.nrows():
        return False
    s = symmetric(triangle)
    return is_positive_definite(s) and is_positive_definite(s - matrix.transpose() * s * matrix)
