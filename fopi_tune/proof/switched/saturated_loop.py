"""One loop with its limits and anti-windup decays from every state:  the circle criterion, verified in balls.

Around an equilibrium strictly within the limits, the part q = v - u that is cut off obeys q (v - v* - q) >= 0, where v*
is the control at rest.  With P > 0, lambda >= 0 and 0 < rho < 1,

    [rho^2 P  0]                    [   0     C'/2]
    [   0     0]  - [A B]' P [A B]  - lambda [  C/2    -1  ]  > 0                                                    (1)

therefore proves zeta' P zeta <- at most rho^2 zeta' P zeta, whatever the state is and whichever the setpoint.  (1) is
concave in (A, B), and these are in the convex hull of the plants' vertices: it is enough there.

A semidefinite program finds P and lambda, in coordinates in which the loop's own Lyapunov matrix has a unit diagonal.
What it says is not trusted: (1) is tested by an interval factorisation.

Source: the circle criterion for anti-windup, as in Tarbouriech et al., Stability and Stabilization of Linear Systems
with Saturating Actuators, 2011; discrete time and convexity in the plants are derived here.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from flint import arb, arb_mat, ctx

from fopi_tune.core.bode_form import Array
from fopi_tune.digital.runtime import Runtime
from fopi_tune.errors import CertificateError
from fopi_tune.proof.strict_json import JsonObject
from fopi_tune.proof.switched.definite import Triangle, is_positive_definite, lower_triangle, midpoints, symmetric
from fopi_tune.proof.switched.model import Lag, SwitchedLoop, lag_range, loop_matrices

#: bits of the verification
_PRECISION = 192
#: parts of the linear loop's distance to the unit circle that are tried as the decay 1 - rho
_PARTS = (0.8, 0.5, 0.2, 0.05)
#: behind the point, that a double near 1 has
_MOST_DIGITS = 15


@dataclass(frozen=True)
class SaturatedLoopProof:
    """That a loop with its limits decays from every state.

    Args:
        matrix: lower triangle of P, shape (N, N) of A as a whole.
        multiplier: lambda, in the unit of P's entries for the control.
        decay: rho per sample, dimensionless.
    """

    matrix: Triangle
    multiplier: float
    decay: float

    @property
    def told_decay(self) -> str:
        """The decay with three digits of its distance to 1, not below it."""
        digits = 2 - math.floor(math.log10(1.0 - self.decay))
        slack = math.floor((1.0 - self.decay) * 10.0**digits)
        return f"{1.0 - slack * 10.0**-digits:.{digits}f}" if digits <= _MOST_DIGITS else repr(self.decay)


def prove_saturated_loop(loop: SwitchedLoop, sample_time_s: float) -> SaturatedLoopProof | None:
    """Search for P, lambda and rho; None where none was found or verified.

    Args:
        loop: the controller and its plants.
        sample_time_s: Ts, in s.
    """
    with ctx.workprec(_PRECISION):
        vertices = [
            tuple(midpoints(part) for part in loop_matrices(loop.controller, lag))
            for lag in lag_range(loop, sample_time_s).vertices
        ]
    radius = max(float(np.abs(np.linalg.eigvals(a)).max()) for a, _, _ in vertices)
    if not radius < 1.0:
        return None
    for part in _PARTS:
        decay = 1.0 - part * (1.0 - radius)
        found = _search(vertices, decay)
        if found is not None and verify_saturated_loop(loop, sample_time_s, found):
            return found
    return None


def verify_saturated_loop(loop: SwitchedLoop, sample_time_s: float, proof: SaturatedLoopProof) -> bool:
    """Whether (1) holds at every vertex of the plants.

    Args:
        loop: the controller and its plants.
        sample_time_s: Ts, in s.
        proof: what is claimed of it.
    """
    size = len(loop.controller.poles) + 1 + (loop.delay_samples > 0.0)
    if len(proof.matrix) != size or not (proof.multiplier >= 0.0 and 0.0 < proof.decay < 1.0):
        return False
    with ctx.workprec(_PRECISION):
        p = symmetric(proof.matrix)
        if not is_positive_definite(p):
            return False
        lags = lag_range(loop, sample_time_s).vertices
        return all(is_positive_definite(_circle(loop.controller, lag, p, proof)) for lag in lags)


def decay_entry(proof: SaturatedLoopProof) -> dict[str, Any]:
    """A proof as JSON."""
    rows = [list(row) for row in proof.matrix]
    return {"matrix": rows, "multiplier": proof.multiplier, "decay": proof.decay}


def read_decay(entry: JsonObject) -> SaturatedLoopProof:
    """A proof from JSON.

    Raises:
        CertificateError: an entry is missing or has the wrong type, or the decay is none.
    """
    decay = entry.number("decay")
    if not 0.0 < decay < 1.0:
        raise CertificateError(f"{entry.at('decay')} must be between 0 and 1")
    return SaturatedLoopProof(entry.lower_triangle("matrix"), entry.number("multiplier"), decay)


def _circle(controller: Runtime, lag: Lag, p: arb_mat, proof: SaturatedLoopProof) -> arb_mat:
    """The matrix of (1) for one plant."""
    a, b, c = loop_matrices(controller, lag)
    size = a.nrows()
    both = arb_mat([[*row, b[i, 0]] for i, row in enumerate(a.tolist())])
    after, decay, multiplier = both.transpose() * p * both, arb(proof.decay) ** 2, arb(proof.multiplier)
    found = arb_mat(size + 1, size + 1)
    for i in range(size):
        for j in range(size):
            found[i, j] = decay * p[i, j] - after[i, j]
        found[i, size] = found[size, i] = -after[i, size] - multiplier * c[0, i] / 2
    found[size, size] = multiplier - after[size, size]
    return found


def _search(vertices: Sequence[tuple[Array, ...]], decay: float) -> SaturatedLoopProof | None:
    """P and lambda from a semidefinite program; None where the solver found none."""
    import cvxpy as cp
    from cvxpy.error import SolverError
    from scipy.linalg import solve_discrete_lyapunov

    size = len(vertices[0][0])
    gramian = sum(solve_discrete_lyapunov(a.T / decay, np.eye(size)) for a, _, _ in vertices)
    scale = np.sqrt(np.diag(gramian))
    p, multiplier, gap = cp.Variable((size, size), PSD=True), cp.Variable(nonneg=True), cp.Variable()
    # the control is measured in the unit in which C has entries of at most 1
    unit = float(np.abs(vertices[0][2][0] / scale).max())
    constraints = [p >> gap * np.eye(size), cp.trace(p) == size]
    state = np.hstack([np.eye(size), np.zeros((size, 1))])
    for a, b, c in vertices:
        both = np.hstack([scale[:, None] * a / scale, scale[:, None] * b * unit])
        sector = np.zeros((size + 1, size + 1))
        sector[size, :size] = sector[:size, size] = 0.5 * c[0] / scale / unit
        sector[size, size] = -1.0
        matrix = decay**2 * state.T @ p @ state - both.T @ p @ both - multiplier * sector
        constraints.append(matrix >> gap * np.eye(size + 1))
    problem = cp.Problem(cp.Maximize(gap), constraints)
    with warnings.catch_warnings():
        # "may be inaccurate": what it says is verified in any case
        warnings.simplefilter("ignore")
        try:
            problem.solve(solver=cp.CLARABEL)
        except (SolverError, ValueError):
            return None
    if p.value is None or multiplier.value is None:
        return None
    matrix = scale[:, None] * np.asarray(p.value) * scale
    return SaturatedLoopProof(lower_triangle(matrix), float(multiplier.value) / unit**2, decay)
