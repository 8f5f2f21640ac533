"""One sample of the switched loop as an affine map, exact in balls:  mode, part of the limits, plant -> matrix.

Which map acts at a sample is decided by the active mode, by the part of its limits in which the demanded control lies,
and by whether the mode begins.  With z = (y, x_1, x_2, 1), or (y, x_1, x_2, u_last, 1) with a
computing delay, each map is a matrix of formulas (1) to (4) of `model`; the last row keeps the 1.

Source: derived here from `model`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from flint import arb, arb_mat

from fopi_tune.proof.switched.model import Lag, Memory, SwitchedModel

#: letters of a word: where the demanded control lies, below, within or above the limits
BELOW, WITHIN, ABOVE = "-", "0", "+"


@dataclass(frozen=True)
class SampleMap:
    """A sample of one mode.

    Args:
        matrix: z at the next sample, shape (N, N).
        demand: v as a row, shape (1, N).
    """

    matrix: arb_mat
    demand: arb_mat


def sample_map(
    model: SwitchedModel, lags: Sequence[Lag], setpoint: arb, mode: int, part: str, begins: bool
) -> SampleMap:
    """The map of one sample, at the current precision.

    Args:
        model: with `obstacle == ""`, so that a control that is tracked lies at a limit of the idle controller.
        lags: of both plants, in the order of the modes.
        setpoint: r, in the output's unit.
        mode: index of the active loop.
        part: where the demanded control lies, `BELOW`, `WITHIN` or `ABOVE`.
        begins: whether the other mode was active at the sample before.
    """
    controller, lag, before = model.loops[mode].controller, lags[mode], lags[1 - mode if begins else mode]
    own, idle, size = _places(model, mode), _places(model, 1 - mode), sum(model.sizes) + 2 + (lag.late is not None)
    demand = arb_mat(1, size)
    demand[0, 0], demand[0, size - 1] = -arb(controller.direct), arb(controller.direct) * setpoint
    for place in own:
        demand[0, place] = arb(1)
    applied = demand
    if part != WITHIN:
        applied = arb_mat(1, size)
        applied[0, size - 1] = arb(controller.limits[0] if part == BELOW else controller.limits[1])
    matrix = arb_mat(size, size)
    matrix[0, 0], matrix[size - 1, size - 1] = 1 - lag.share, arb(1)
    if lag.late is not None and before.late is not None:
        last = size - 2
        matrix[0, 0] = (1 - lag.share) * (1 - before.late)
        matrix[0, last] = (1 - lag.share) * before.late * before.gain
        for j in range(size):
            matrix[last, j] = applied[0, j]
    for j in range(size):
        matrix[0, j] += lag.share * lag.gain * applied[0, j]
    rows = zip(own, controller.poles, controller.residues, controller.weights, strict=True)
    for place, pole, residue, weight in rows:
        back = arb(controller.tracking_gain) * arb(pole) * arb(weight)
        for j in range(size):
            matrix[place, j] = back * (applied[0, j] - demand[0, j])
        matrix[place, place] += arb(pole)
        matrix[place, 0] -= arb(residue)
        matrix[place, size - 1] += arb(residue) * setpoint
    _idle(model, matrix, idle, 1 - mode, setpoint)
    if begins and model.memory is Memory.RESET:
        first = _reset(model, own, mode, size)
        matrix, demand = matrix * first, demand * first
    return SampleMap(matrix, demand)


def _places(model: SwitchedModel, mode: int) -> range:
    """Where a controller's sections are in z."""
    first = 1 + (model.sizes[0] if mode else 0)
    return range(first, first + model.sizes[mode])


def _idle(model: SwitchedModel, matrix: arb_mat, idle: range, mode: int, setpoint: arb) -> None:
    """The rows of the controller that is not active."""
    controller, last = model.loops[mode].controller, matrix.nrows() - 1
    if model.memory is not Memory.TRACKING:
        for place in idle:
            matrix[place, place] = arb(1)
        return
    integrator, *others = idle
    for place, pole in zip(others, controller.poles[1:], strict=True):
        matrix[place, place] = arb(pole)
        matrix[integrator, place] = -arb(pole)
    # the other's control, cut to these limits: the limits of both do not overlap
    cut = controller.limits[0] if mode == 0 else controller.limits[1]
    matrix[integrator, 0] = arb(controller.direct)
    matrix[integrator, last] = arb(cut) - arb(controller.direct) * setpoint


def _reset(model: SwitchedModel, own: range, mode: int, size: int) -> arb_mat:
    """z with the controller's sections as after a reset to an output of 0."""
    low, high = model.loops[mode].controller.limits
    found = arb_mat(size, size)
    for place in range(size):
        found[place, place] = arb(0 if place in own else 1)
    found[own[0], size - 1] = arb(min(max(0.0, low), high))
    return found
