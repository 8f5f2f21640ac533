"""Every raising phase that begins at the lower line settles without another switch, proved in balls.

As long as no limit is reached, zeta_{k+1} = A zeta_k for the corners of `entries`.  The proof follows them through N
samples and finds, r + a being the line to the lowering mode (a = eps of a hysteresis),

    y_k < r + a,      low <= v_k <= high      for k = 0, ..., N - 1,                                               (1)

which is affine in state and setpoint, so that it holds between the corners, and there is neither a switch nor a limit.
Then a level set of zeta' P zeta, P > 0 and A' P A <= rho^2 P, does the rest: with s^2 = zeta_N' P zeta_N,

    s sqrt(P^-1_00) < a,      s sqrt(C P^-1 C') < min(r/K - low, high - r/K),                                      (2)

|y - r| and |v - r/K| stay below these numbers for ever and vanish as rho^k.

Balls grow when they are multiplied by A many times.  Every few samples the columns are cut to their midpoints, and what
was cut off, measured by sqrt(zeta' P zeta), is carried along in one number, which A shrinks by rho per sample.

Source: derived here; (2) are support functions of an ellipsoid.
"""

from __future__ import annotations

from dataclasses import dataclass

from flint import arb, arb_mat, ctx

from fopi_tune.proof.switched.definite import Triangle, is_positive_definite, not_below, quadratic_norm, symmetric
from fopi_tune.proof.switched.entries import (
    dwell_margin,
    entry_corners,
    lowering_top,
    raising_lag,
    starts_above_low,
    why_no_entries,
)
from fopi_tune.proof.switched.model import SwitchedModel, loop_matrices

#: bits; and samples after which radii are collected
_PRECISION, _COLLECTED = 128, 16
#: more samples than this are not followed
MOST_SAMPLES = 40_000


@dataclass(frozen=True)
class SettlingProof:
    """That raising phases settle, for a range of setpoints.

    Args:
        setpoints: least and largest r, output unit.
        samples: N, until the level set is reached.
        matrix: lower triangle of P, shape (N, N) of A as a whole.
        decay: rho per sample, dimensionless.
        undershoot: bound on r - y from the switch on, output unit.
        overshoot: bound on y - r from the switch on, output unit; below the upper line.
    """

    setpoints: tuple[float, float]
    samples: int
    matrix: Triangle
    decay: float
    undershoot: float
    overshoot: float


@dataclass(frozen=True)
class Excursions:
    """How far the output is from the setpoint after the switch.

    Args:
        undershoot: bound on r - y, output unit.
        overshoot: bound on y - r, output unit.
    """

    undershoot: float
    overshoot: float


def verify_settling(model: SwitchedModel, proof: SettlingProof) -> Excursions | None:
    """Test a proof; the excursions are bounded anew, those of `proof` are not read.  None where it does not hold.

    Args:
        model: with `obstacle == ""`.
        proof: what is claimed of it.
    """
    lowest, highest = proof.setpoints
    if why_no_entries(model) or not lowest <= highest:
        return None
    if not (1 <= proof.samples <= MOST_SAMPLES and 0.0 < proof.decay < 1.0):
        return None
    with ctx.workprec(_PRECISION):
        if not lowering_top(model) + dwell_margin(model) < arb(lowest) + arb(model.lower):
            return None
        a, _, c = loop_matrices(model.loops[0].controller, raising_lag(model))
        if len(proof.matrix) != a.nrows():
            return None
        p = symmetric(proof.matrix)
        shrinks = arb(proof.decay) ** 2 * p - a.transpose() * p * a
        if not (is_positive_definite(p) and is_positive_definite(shrinks)):
            return None
        return _follow(model, proof, a, c, p)


@dataclass(frozen=True)
class _Corner:
    """One column's setpoint: the distances of v* = r/K to both limits."""

    below: arb
    above: arb


def _follow(model: SwitchedModel, proof: SettlingProof, a: arb_mat, c: arb_mat, p: arb_mat) -> Excursions | None:
    """(1) sample by sample, then (2)."""
    columns, corners = _start(model, proof)
    inverse, size = p.inv(), a.nrows()
    per_output = (inverse[0, 0].sqrt(), (c * inverse * c.transpose())[0, 0].sqrt())
    lengths = [p[i, i].sqrt() for i in range(size)]
    both, upper, decay = arb_mat([*a.tolist(), *c.tolist()]), arb(model.upper), arb(proof.decay)
    # the error that was cut off, in the norm of P; the same for all columns
    error, undershoot, overshoot = arb(0), arb(0), arb(0)
    wrong_y, wrong_v = arb(0), arb(0)
    known = starts_above_low(model)
    for k in range(proof.samples):
        if k % _COLLECTED == 0:
            columns, more = _cut(columns, lengths)
            error = (error + more).upper()
        wrong_y, wrong_v = (error * each for each in per_output)
        following = both * columns
        for j, corner in enumerate(corners):
            y, v = columns[0, j], following[size, j]
            above_low = (k == 0 and known) or v - wrong_v >= -corner.below
            inside = y + wrong_y < upper and v + wrong_v <= corner.above and above_low
            if not inside:
                return None
            undershoot, overshoot = undershoot.max(wrong_y - y), overshoot.max(y + wrong_y)
        columns = arb_mat(following.tolist()[:size])
        # within a block the error shrinks; not to count on it keeps one number per block
        if k % _COLLECTED == _COLLECTED - 1:
            error = error * decay
    for j, corner in enumerate(corners):
        level = quadratic_norm(p, arb_mat([[columns[i, j]] for i in range(size)])) + error
        y, v = level * per_output[0], level * per_output[1]
        if not (y < upper and v < corner.below and v < corner.above):
            return None
        undershoot, overshoot = undershoot.max(y), overshoot.max(y)
    return Excursions(not_below(undershoot), not_below(overshoot))


def _start(model: SwitchedModel, proof: SettlingProof) -> tuple[arb_mat, list[_Corner]]:
    """All corners, and the distances of their controls at rest to the limits."""
    low, high = (arb(limit) for limit in model.loops[0].controller.limits)
    tables: list[list[list[arb]]] = []
    corners = []
    for end in proof.setpoints:
        found, rest = entry_corners(model, arb(end)), arb(end) / raising_lag(model).gain
        tables.append(found.tolist())
        corners += [_Corner(rest - low, high - rest)] * found.ncols()
    return arb_mat([first + second for first, second in zip(*tables, strict=True)]), corners


def _cut(columns: arb_mat, lengths: list[arb]) -> tuple[arb_mat, arb]:
    """The midpoints, and a bound on the norm of P of what was cut off any column."""
    table = columns.tolist()
    largest = arb(0)
    for j in range(columns.ncols()):
        total = sum((lengths[i] * row[j].rad() for i, row in enumerate(table)), arb(0))
        largest = largest.max(total)
    return columns.mid(), largest.upper()
