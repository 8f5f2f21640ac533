"""Quadrature weights of the time-stepping simulator: the fractional integral, and the plant's response over one step.

They are integrals of known functions over one step, by Gauss-Legendre panels that shrink towards both ends of the step:
they resolve a power t^alpha at its start and a pole much faster than the step at its end.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.polynomial.legendre import leggauss
from scipy.special import gamma

from fopi_tune.core.bode_form import Array
from fopi_tune.core.plant import Plant
from fopi_tune.core.zero_order_hold import matrix_expm1

#: panels towards each end of the step, and points in each
_PANELS, _POINTS = 48, 8
#: from this distance in steps on, quadrature of the smooth (k - v)^{alpha-1} is more exact than the closed form, which
#: cancels
_SMOOTH = 20
#: Chebyshev points that interpolate (k + v)^alpha to rounding, from which step k on
_CHEBYSHEV, _SINGULAR_STEPS = 10, 4


@dataclass(frozen=True)
class StateSpace:
    """x' = A x + B w, y = C x + g w in observable form: C = (1, 0, ..., 0), so x_1 is the output without direct path.

    Args:
        a: shape (n, n), rad/s.
        b: shape (n,).
        c: shape (n,).
        direct: g = P(inf).
    """

    a: Array
    b: Array
    c: Array
    direct: float


def state_space(plant: Plant) -> StateSpace:
    """The plant without its dead time in observable form; n is the denominator's degree.

    D = s^n + a_1 s^{n-1} + ..., N = b_0 s^n + b_1 s^{n-1} + ...:  x_i' = -a_i x_1 + x_{i+1} + (b_i - a_i b_0) w.
    """
    denominator = np.array(plant.denominator, dtype=float)
    degree = len(denominator) - 1
    numerator = np.zeros(degree + 1)
    trimmed = np.trim_zeros(np.array(plant.numerator, dtype=float), "f")
    numerator[degree + 1 - len(trimmed) :] = trimmed
    numerator, denominator = numerator / denominator[0], denominator / denominator[0]
    a = np.zeros((degree, degree))
    a[:, :1] = -denominator[1:, None]
    a[:-1, 1:] += np.eye(max(degree - 1, 0))
    c = np.zeros(degree)
    c[:1] = 1.0
    return StateSpace(a, numerator[1:] - denominator[1:] * numerator[0], c, float(numerator[0]))


def integral_weights(alpha: float, step_s: float, steps: int) -> tuple[Array, Array]:
    """l_k and r_k, k = 1 ... steps, of the product trapezoidal rule for I^alpha.

        r_k = h^alpha ((k^{alpha+1} - (k-1)^{alpha+1})/Gamma(alpha+2) - (k-1)^alpha/Gamma(alpha+1)),
        l_k = h^alpha (k^alpha - (k-1)^alpha)/Gamma(alpha+1) - r_k.

    Args:
        alpha: order, 0 < alpha < 2.
        step_s: h, s.
        steps: how many.

    Returns:
        l and r, shape (steps,) each, s^alpha.
    """
    k = np.arange(1.0, steps + 1.0)
    near = k[:_SMOOTH]
    right = (near ** (alpha + 1) - (near - 1) ** (alpha + 1)) / gamma(alpha + 2) - (near - 1) ** alpha / gamma(
        alpha + 1
    )
    left = (near**alpha - (near - 1) ** alpha) / gamma(alpha + 1) - right
    x, weight = leggauss(_POINTS)
    v, weight = 0.5 * (1.0 + x), 0.5 * weight / gamma(alpha)
    far = (k[_SMOOTH:, None] - v) ** (alpha - 1.0) * weight
    scale = step_s**alpha
    return scale * np.concatenate([left, far @ (1.0 - v)]), scale * np.concatenate([right, far @ v])


@dataclass(frozen=True)
class StepNodes:
    """Nodes v of one step, as shares of it, and their weights times h e^{Ah(1-v)} B.

    Args:
        v: shape (q,), from 0 to 1.
        weight: shape (q, n).
    """

    v: Array
    weight: Array


def matrix_exponentials(matrices: Array) -> Array:
    """e^A of many small matrices, shape (m, n, n), each exact to rounding of its largest entry."""
    return matrix_expm1(matrices) + np.eye(matrices.shape[-1])


def linear_input_weights(model: StateSpace, step_s: float) -> tuple[Array, Array, Array, StepNodes]:
    """The plant's response over one step h to an input that is linear in time.

    Returns:
        e^{Ah} (n, n), the weights of the input at the start and at the end of the step, (n,) each, and the nodes of the
        quadrature.
    """
    x, weight = leggauss(_POINTS)
    border = np.concatenate([[0.0], 0.5 ** np.arange(_PANELS, 0, -1.0)])
    width = np.diff(border)
    v = (border[:-1, None] + 0.5 * width[:, None] * (1.0 + x)).ravel()
    weights = (0.5 * width[:, None] * weight).ravel()
    # nodes near the end are stored by their distance from it, which 1 - v would lose to rounding
    since, left, weights = (
        np.concatenate([v, 1.0 - v]),
        np.concatenate([1.0 - v, v]),
        np.concatenate([weights, weights]),
    )
    degree = len(model.a)
    vectors = np.zeros((len(since), degree))
    if degree:
        vectors = matrix_exponentials(model.a * (step_s * left)[:, None, None]) @ model.b * (step_s * weights)[:, None]
    nodes = StepNodes(since, vectors)
    transition = matrix_exponentials(model.a[None] * step_s)[0] if degree else model.a
    return transition, left @ vectors, since @ vectors, nodes


def power_input_weights(nodes: StepNodes, alpha: float, step_s: float, steps: int) -> Array:
    """int_0^h e^{A(h-v)} B (k h + v)^alpha/Gamma(1+alpha) dv, k = 0 ... steps - 1; shape (steps, n).

    For k >= 4 the power is its interpolant at ten Chebyshev points of the step.
    """
    scale = step_s**alpha / gamma(1.0 + alpha)
    near = np.arange(min(steps, _SINGULAR_STEPS), dtype=float)
    exact = (near[:, None] + nodes.v) ** alpha @ nodes.weight
    if steps <= _SINGULAR_STEPS:
        return scale * exact
    angle = (np.arange(_CHEBYSHEV) + 0.5) * np.pi / _CHEBYSHEV
    points, bary = 0.5 + 0.5 * np.cos(angle), np.sin(angle) * (-1.0) ** np.arange(_CHEBYSHEV)
    terms = bary / np.where(nodes.v[:, None] == points, 1e-300, nodes.v[:, None] - points)
    moments = (terms / terms.sum(axis=1, keepdims=True)).T @ nodes.weight
    far = np.arange(_SINGULAR_STEPS, steps, dtype=float)
    return scale * np.concatenate([exact, (far[:, None] + points) ** alpha @ moments])
