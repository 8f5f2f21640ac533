"""Output and memories stay within numbers under any switching, proved in balls:  model, BoundedProof -> whether.

Nothing is asked of the hysteresis here: which mode is active, which members of the families the plants are and how the
setpoint moves between its bounds may be chosen anew, and worst, at every sample.

The output is driven by a stable plant of first order whose control lies within limits, so that it stays between the
least and the largest K u of both modes.  Let |u| <= U and |e| <= E be bounds of a controller's output and error then.
Its active samples are

    x <- M x + b u + f e,     M = P (I - g w 1'),  b = g P w,  f = r - direct b .                                    (1)

Memories that are held or reset see nothing but these: from x = (x_0, 0, ...) with |x_0| <= U, for t = 0, 1, ...

    |c x_t| <= U |c M^t e_0| + sum_{i<t} (U |c M^i b| + E |c M^i f|)                                                 (2)

for each row c.  While a controller tracks, its other sections decay, x_k <- p_k x_k, and the integrator follows: an
active phase begins with x = J z + e_0 s, where z are the other sections, the sum of J z is 0, and |s| <= U + |direct| E
is the sum of x.  Numbers X_k that bound z at the end of a phase are |p_k| X_k at the start of the next, however long
it tracked.  They are bounds for ever if, for all t and k > 0,

    sum_j |(M^t J)_kj| |p_j| X_j  +  the right side of (2)  <=  X_k .                                                (3)

That is linear in X.  M^t = V D^t V^-1 with eigenvalues in balls bounds everything from some t on by a geometric series.
A common quadratic function for both maps of a tracking controller exists for many loops, but bounds 30 times as wide.

Source: (2) is the l1 norm of an impulse response, as in Dahleh and Diaz-Bobillo, Control of Uncertain Systems, 1995;
(3) is derived here.
"""

from __future__ import annotations

from dataclasses import dataclass

from flint import acb_mat, arb, arb_mat, ctx

from fopi_tune.digital.runtime import Runtime
from fopi_tune.proof.switched.model import (
    COASTING_NOT_MODELLED,
    Memory,
    SwitchedLoop,
    SwitchedModel,
    lag_range,
    loop_obstacle,
)

#: bits; and samples of (2) and (3) that are followed at most
_PRECISION = 192
MOST_FOLLOWED = 4_000


@dataclass(frozen=True)
class MemoryBounds:
    """Of one controller.

    Args:
        samples: how many t are followed one by one.
        sections: bounds of |x_k|, in the control's unit.
        total: bound of |sum of x_k|: what the controller demands besides direct e.
    """

    samples: int
    sections: tuple[float, ...]
    total: float


@dataclass(frozen=True)
class BoundedProof:
    """That output and memories stay within numbers.

    Args:
        setpoints: least and largest r, output unit; it may move between them.
        outputs: least and largest y, output unit; one that starts between them stays there.
        memories: of both controllers, the raising mode's first; None where there is no proof.
    """

    setpoints: tuple[float, float]
    outputs: tuple[float, float]
    memories: tuple[MemoryBounds | None, MemoryBounds | None]


def why_not_bounded(model: SwitchedModel) -> str:
    """Why nothing is shown of the output; empty where it can be."""
    for loop in model.loops:
        if found := loop_obstacle(loop):
            return found
        if not loop.is_limited:
            return f"{loop.name}: without output_limits nothing bounds the output under every switching"
    return COASTING_NOT_MODELLED if model.lines.coasts else ""


def output_range(model: SwitchedModel) -> tuple[arb, arb]:
    """The least and the largest K u of both modes, at the current precision.

    Args:
        model: with `why_not_bounded(model) == ""`.
    """
    held = [
        gain * arb(limit)
        for loop in model.loops
        for gain in lag_range(loop, model.sample_time_s).gains
        for limit in loop.controller.limits
    ]
    low, high = held[0], held[0]
    for each in held[1:]:
        low, high = low.min(each), high.max(each)
    return low, high


def verify_bounded(model: SwitchedModel, proof: BoundedProof) -> bool:
    """Whether everything that is claimed holds.

    Args:
        model: of the system.
        proof: what is claimed of it.
    """
    if why_not_bounded(model) or not proof.setpoints[0] <= proof.setpoints[1]:
        return False
    with ctx.workprec(_PRECISION):
        low, high = output_range(model)
        if not (low >= arb(proof.outputs[0]) and high <= arb(proof.outputs[1])):
            return False
        return all(
            bounds is None or _holds(model.memory, loop, bounds, largest_error(proof))
            for loop, bounds in zip(model.loops, proof.memories, strict=True)
        )


def largest_error(proof: BoundedProof) -> arb:
    """E, at the current precision."""
    (low, high), (least, most) = ([arb(end) for end in ends] for ends in (proof.setpoints, proof.outputs))
    return abs(high - least).max(abs(low - most))


def active_map(controller: Runtime) -> tuple[arb_mat, arb_mat, arb_mat]:
    """M, shape (n, n), b and f of (1), shape (n, 1), at the current precision."""
    gain, direct, count = arb(controller.tracking_gain), arb(controller.direct), len(controller.poles)
    m, b, f = arb_mat(count, count), arb_mat(count, 1), arb_mat(count, 1)
    rows = zip(controller.poles, controller.weights, controller.residues, strict=True)
    for k, (pole, weight, residue) in enumerate(rows):
        b[k, 0] = gain * arb(pole) * arb(weight)
        f[k, 0] = arb(residue) - direct * b[k, 0]
        for j in range(count):
            m[k, j] = (arb(pole) if j == k else arb(0)) - b[k, 0]
    return m, b, f


def starts(controller: Runtime, memory: Memory, largest: arb, error: arb) -> tuple[arb_mat, arb]:
    """J, shape (n, n - 1), or (n, 0) of memories that are not tracking, and the bound of |s|."""
    count = len(controller.poles)
    if memory is not Memory.TRACKING:
        return arb_mat(count, 0), largest
    rows = [[arb(-1)] * (count - 1)] + [[arb(int(i == j)) for j in range(count - 1)] for i in range(count - 1)]
    return arb_mat(rows) if count > 1 else arb_mat(1, 0), largest + abs(arb(controller.direct)) * error


def _holds(memory: Memory, loop: SwitchedLoop, bounds: MemoryBounds, error: arb) -> bool:
    """(2), or (3), at every t: one by one, and then by the series."""
    controller, count = loop.controller, len(loop.controller.poles)
    if len(bounds.sections) != count or not 1 <= bounds.samples <= MOST_FOLLOWED:
        return False
    largest = abs(arb(controller.limits[0])).max(abs(arb(controller.limits[1])))
    m, b, f = active_map(controller)
    j, start = starts(controller, memory, largest, error)
    try:
        # raised where eigenvalues cannot be told apart, or vectors are not independent
        eigenvalues, v = acb_mat(m).eig(right=True)
        inverse = v.inv()
    except (ValueError, ZeroDivisionError):
        return False
    decay = [abs(each) for each in eigenvalues]
    if not all(each < 1 for each in decay):
        return False
    rows = acb_mat([[1] * count, *([int(i == k) for i in range(count)] for k in range(count))]) * v
    # a column for each part: its size at the start, those of J first, then s, u and e
    others = [abs(arb(controller.poles[k])) * arb(bounds.sections[k]) for k in range(1, 1 + j.ncols())]
    sizes = [*others, start, largest, error]
    columns = [[*row, arb(int(k == 0)), b[k, 0], f[k, 0]] for k, row in enumerate(j.tolist())]
    columns = [[entry * size for entry, size in zip(row, sizes, strict=True)] for row in columns]
    modal = inverse * acb_mat(columns)
    claimed = [arb(bounds.total), *map(arb, bounds.sections)]
    sums = [arb(0)] * (count + 1)
    for _ in range(bounds.samples):
        for k, row in enumerate((rows * modal).tolist()):
            terms = [abs(entry.real) for entry in row]
            if not sum(terms[:-2], sums[k]) <= claimed[k]:
                return False
            sums[k] = (sums[k] + terms[-2] + terms[-1]).upper()
        modal = acb_mat(
            [[each * entry for entry in row] for each, row in zip(eigenvalues, modal.tolist(), strict=True)]
        )
    return all(
        sums[k] + _tail([abs(entry) for entry in row], modal, decay) <= claimed[k]
        for k, row in enumerate(rows.tolist())
    )


def _tail(row: list[arb], modal: acb_mat, decay: list[arb]) -> arb:
    """A bound for every later t of what a row sees of the starts, and of the sum of what it sees of u and e."""
    total = arb(0)
    for weight, rate, amounts in zip(row, decay, modal.tolist(), strict=True):
        sizes = [abs(each) for each in amounts]
        total += weight * (sum(sizes[:-2], arb(0)) + (sizes[-2] + sizes[-1]) / (1 - rate))
    return total
