"""The search for bounds of output and memories, in floating point:  model -> BoundedProof.

Bounds of memories that are held or reset are sums; those of tracking ones solve the linear program of (3) of `bounded`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from flint import arb, ctx

from fopi_tune.core.bode_form import Array
from fopi_tune.proof.switched.bounded import (
    MOST_FOLLOWED,
    BoundedProof,
    MemoryBounds,
    active_map,
    largest_error,
    output_range,
    starts,
    verify_bounded,
    why_not_bounded,
)
from fopi_tune.proof.switched.definite import midpoints, not_below
from fopi_tune.proof.switched.model import Memory, SwitchedLoop, SwitchedModel

#: bits of the matrices; numbers of samples that are tried in turn
_PRECISION, _FOLLOWED = 128, (500, 2_000, MOST_FOLLOWED)
#: relative; what is left for rounding, in the program and in what is stated
_MARGIN = 1e-7
#: behind the point; a power of ten below would be no double
_MOST_DIGITS = 300


@dataclass(frozen=True)
class BoundedSearch:
    """What was found.

    Args:
        proof: verified; None where not even the output is bounded.
        reason: what is not bounded, and why; empty where everything is.
    """

    proof: BoundedProof | None
    reason: str


def prove_bounded(model: SwitchedModel, setpoints: tuple[float, float] | None) -> BoundedSearch:
    """Bounds of the output and of both memories under any switching.

    Args:
        model: of the system.
        setpoints: least and largest r that are asked for, output unit; those between the outputs that can be reached
            are taken in too.
    """
    if reason := why_not_bounded(model):
        return BoundedSearch(None, reason)
    with ctx.workprec(_PRECISION):
        low, high = output_range(model)
        outputs = _outwards(-not_below(-low), not_below(high))
        ends = (*outputs, *(setpoints or ()))
        found = BoundedProof((min(ends), max(ends)), outputs, (None, None))
        error = float(largest_error(found).upper())
    raising, lowering = (_memory(model.memory, loop, error) for loop in model.loops)
    tries = [(raising, lowering), (raising, None), (None, lowering), (None, None)]
    proofs = (replace(found, memories=each) for each in dict.fromkeys(tries))
    proof = next((each for each in proofs if verify_bounded(model, each)), None)
    if proof is None:
        return BoundedSearch(None, "the output's range could not be verified in balls")
    free = [loop.name for loop, bounds in zip(model.loops, proof.memories, strict=True) if bounds is None]
    what = f"no bound of the memory of {' and '.join(free)} under every switching was found"
    return BoundedSearch(proof, what if free else "")


def _memory(memory: Memory, loop: SwitchedLoop, error: float) -> MemoryBounds | None:
    """Bounds of one controller; None where none were found."""
    parts = _parts(memory, loop, error)
    if parts is None:
        return None
    return next((found for samples in _FOLLOWED if (found := parts.bounds(samples)) is not None), None)


@dataclass(frozen=True)
class _Parts:
    """The terms of (3) for the sum of the sections and for each of them.

    Args:
        coupling: of each other section's bound, shape (t, n + 1, n - 1), or (t, n + 1, 0).
        constant: all else, shape (t, n + 1).
        tails: both from t on, for the numbers of samples in `_FOLLOWED`.
    """

    coupling: Array
    constant: Array
    tails: dict[int, tuple[Array, Array]]

    def bounds(self, samples: int) -> MemoryBounds | None:
        """Bounds with so many samples that are followed; None where (3) has no solution."""
        coupling, constant = self.tails[samples]
        coupling = np.concatenate([self.coupling[:samples], coupling[None]])
        constant = np.concatenate([self.constant[:samples], constant[None]])
        others = _least(coupling, constant) if coupling.shape[2] else np.zeros(0)
        if others is None:
            return None
        found = (np.max(coupling @ others + constant, axis=0) * (1.0 + _MARGIN)).tolist()
        if len(others):
            # with margins of their own; (3) holds for these numbers
            found[2:] = others.tolist()
        return MemoryBounds(samples, tuple(found[1:]), found[0])


def _least(coupling: Array, constant: Array) -> Array | None:
    """The least X of (3), each measured by its constant part."""
    from scipy.optimize import linprog

    count = coupling.shape[2]
    scale = np.maximum(constant[:, 2:].max(axis=0), np.finfo(float).tiny)
    # rows (t, k) of X_k - sum_j coupling X_j >= constant, in units of the constant parts
    rows = (np.eye(count) - coupling[:, 2:, :]) * scale / scale[:, None]
    needed = (1.0 + _MARGIN) * constant[:, 2:] / scale + _MARGIN
    found = linprog(np.ones(count), A_ub=-rows.reshape(-1, count), b_ub=-needed.reshape(-1), method="highs")
    return None if found.x is None else found.x * scale


def _parts(memory: Memory, loop: SwitchedLoop, error: float) -> _Parts | None:
    """Follow M^t; None where it does not decay."""
    controller, count = loop.controller, len(loop.controller.poles)
    with ctx.workprec(_PRECISION):
        largest = max(map(abs, controller.limits))
        m, b, f = (midpoints(each) for each in active_map(controller))
        j, start = starts(controller, memory, arb(largest), arb(error))
        size = float(start)
        begun = midpoints(j) if j.ncols() else np.zeros((count, 0))
    eigenvalues, v = np.linalg.eig(m)
    decay = np.abs(eigenvalues)
    if not decay.max() < 1.0 or not np.linalg.cond(v) < 1.0 / np.finfo(float).eps:
        return None
    shrunk = np.abs(np.array(controller.poles[1:]))[: begun.shape[1]]
    columns = np.hstack([begun * shrunk, size * np.eye(count)[:, :1], largest * b, error * f])
    rows = np.vstack([np.ones(count), np.eye(count)])
    seen = np.zeros((MOST_FOLLOWED + 1, count + 1, columns.shape[1]))
    modal, tails = np.linalg.solve(v, columns), {}
    sums, constant = np.zeros(count + 1), np.zeros((MOST_FOLLOWED + 1, count + 1))
    for t in range(MOST_FOLLOWED + 1):
        if t in _FOLLOWED:
            reach = np.abs(rows @ v)
            left = reach @ np.abs(modal[:, :-2])
            later = reach @ (np.abs(modal[:, -2:]).sum(axis=1) / (1.0 - decay))
            tails[t] = left[:, :-1], left[:, -1] + later + sums
        seen[t] = np.abs(np.real(rows @ v @ modal))
        constant[t] = seen[t, :, -3] + sums
        sums = sums + seen[t, :, -2:].sum(axis=1)
        modal = eigenvalues[:, None] * modal
    return _Parts(seen[:, :, :-3], constant, tails)


def _outwards(low: float, high: float) -> tuple[float, float]:
    """The range with three digits of its width, outwards."""
    digits = min(2 - math.floor(math.log10(high - low)), _MOST_DIGITS) if high > low else 0
    step = 10.0**-digits
    ends = round(math.floor(low / step) * step, digits), round(math.ceil(high / step) * step, digits)
    return min(ends[0], low), max(ends[1], high)
