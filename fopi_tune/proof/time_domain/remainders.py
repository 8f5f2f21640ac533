"""What the terms of second order leave of a trajectory, bounded by norms.

With (2) of `solution`, Q E = E_1 + E' and b = b_1 + b_2 + b', where E_1, b_1 are of first and b_2 of second order,

    y = y_0 + b_1 + (b_2 - E_1 b_1) + b' - E_1 (b_2 + b') - E' b + (Q E)^2 (1 + Q E)^-1 b ,      q = |Q E| < 1 .     (1)

All of it up to the bracket is computed sample by sample, and the norms of the rest bound what is left.  A norm up to a
sample takes the samples up to it, which are all that this one depends on.  v = v_a - path y has the same with path Q.

Source: derived here; (1) is Neumann's series.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fopi_tune.core.bode_form import Array
from fopi_tune.proof.time_domain.bounded import Causal, Delays, above
from fopi_tune.proof.time_domain.jets import pairs_of
from fopi_tune.proof.time_domain.patterns import Filter
from fopi_tune.proof.time_domain.plants.held import HeldPlants, Polynomial

#: largest |Q E| for which (1) is used
_MOST_CHANGE = 0.75


@dataclass(frozen=True, eq=False)
class Sizes:
    """Sizes of the terms of a trajectory.

    Args:
        inputs: of the changes of u_a of first and second order, and of the others.
        first, others, second: of y, of first order, of the rests and of second order, up to each sample, shape (K,).
    """

    inputs: tuple[float, ...]
    first: Array
    others: Array
    second: Array


@dataclass(frozen=True, eq=False)
class _Side:
    """Norms for y, or for v with path Q in place of Q: |Q|, |E_1| of each axis, |E'|; shapes (K,), (p, K), (K,)."""

    inverse: Array
    axes: Array
    rest: Array


@dataclass(frozen=True, eq=False)
class OperatorChange:
    """How much the operator of a box changes, up to each sample.

    Args:
        output, demanded: for y and for v.
        control: sizes of the changes of N, of first and second order, and of the others.
    """

    output: _Side
    demanded: _Side
    control: tuple[float, float, float]


@dataclass(frozen=True, eq=False)
class Remainders:
    """What (1) leaves beyond second order, inf where it does not hold.

    Args:
        output, demanded: of y and of v, shape (K,).
        change: the part of |Q E| of each axis, up to each sample, shape (p, K).
    """

    output: Array
    demanded: Array
    change: Array


def operator_change(inverse: Causal, plants: HeldPlants, own: Filter) -> OperatorChange:
    """The norms of Q E and of path Q E.

    Args:
        inverse: Q.
        plants: of the box.
        own: the filter.
    """
    h, control = plants.radii, own.control
    products = np.array([h[j] * h[i] for j, i in pairs_of(len(h))])
    # what changes A beyond first order
    of_output, of_control = (_beyond(each, products) for each in (plants.denominator, plants.control))
    sides = []
    for each in (inverse, own.path.after(inverse)):
        axes = np.zeros((len(h), len(each.terms)))
        for axis, radius in enumerate(h):
            (d, rounding_d), (n, rounding_n) = plants.denominator.slopes[axis], plants.control.slopes[axis]
            sizes = (each.after_delays(d) + each.after_delays(n).after(control)).norms
            axes[axis] = above(radius * (sizes + each.norms * (rounding_d + rounding_n * control.norms)))
        steady = each.steady and control.steady
        loop = each.after(control).norms if steady else above(each.norms * control.norms)
        sides.append(_Side(each.norms, axes, above(each.norms * sum(of_output) + loop * sum(of_control))))
    first = sum(radius * _size(plants.control.slopes[axis]) for axis, radius in enumerate(h))
    return OperatorChange(sides[0], sides[1], (above(float(first)), *of_control))


def remainders_of(change: OperatorChange, sizes: Sizes) -> Remainders:
    """(1)."""
    (n1, n2, n_rest), (a1, a2, a_rest) = change.control, sizes.inputs
    crossed = above(n1 * (a2 + a_rest) + n2 * (a1 + a2 + a_rest) + n_rest * (a1 + a2 + a_rest))
    q1, q1_path = (above(side.axes.sum(axis=0)) for side in (change.output, change.demanded))
    rest, rest_path = change.output.rest, change.demanded.rest
    q = above(q1 + rest)
    b_others = above(sizes.others + change.output.inverse * crossed)
    # the terms of second order are those of b_2 and -E_1 b_1 together
    b2 = above(sizes.second + q1 * sizes.first)
    b = above(sizes.first + b2 + b_others)
    # (Q E) b without its part of second order
    later, later_path = (above(one * (b2 + b_others) + two * b) for one, two in ((q1, rest), (q1_path, rest_path)))
    left = np.where(q < _MOST_CHANGE, 1.0 - q, np.nan)
    twice = above((np.minimum(q1 * sizes.first, sizes.second + b2) + later) / left)
    # the rests themselves are terms of their own
    of_output = above(change.output.inverse * crossed + later + q * twice)
    of_demanded = above(change.demanded.inverse * crossed + later_path + (q1_path + rest_path) * twice)
    return Remainders(_known(of_output), _known(of_demanded), change.output.axes)


def _known(bounds: Array) -> Array:
    return np.where(np.isfinite(bounds), bounds, np.inf)


def _beyond(polynomial: Polynomial, products: Array) -> tuple[float, float]:
    """Norms of the terms of second order and of the rests of a polynomial."""
    second = sum(size * _size(polynomial.pairs[row]) for row, size in enumerate(products))
    return above(second), above(sum(basis.norm * rest for basis, rest in polynomial.rests))


def _size(polynomial: tuple[Delays, float]) -> float:
    """A polynomial's norm, rounding included."""
    return above(polynomial[0].norm + polynomial[1])
