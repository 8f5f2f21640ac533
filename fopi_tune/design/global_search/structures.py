"""Structures:  a controller is linear gains times basis responses; a ray gives its gains by a direction and a shape.

With scaled s and three numbers x, whose first `linear` ones are gains and the others shapes,

    fractional      C = x0 + x1 s^-alpha ,                          x2 = alpha ,                                    (1)
    with derivative C = x0 + x1/s + x2 D ,    D = s/(Tf s + 1) ,    x2 = kd' ,                                      (2)
    with orders     C = x0 + x1 s^-alpha + x2 D ,    D = s^mu/(Tf s + 1) ,    x2 = kd', x3 = alpha, x4 = mu ,      (2a)

where on samples s^-alpha, 1/s and s^mu are the filters of `samples.py`, and D of (2) is the same function of s.  With
given orders, which `Sampling` holds, (2a) is searched as (2) is.  A ray is C = k C0.  Its direction is the ratio of x1
to the rest, its shape what else there is to choose: alpha in (1), and in (2) u in [-1, 1] with

    x0 = c cos(theta) ,   x2 = c sin(theta) ,   ln tan(theta) = r u/sqrt(1 - u^2) ,                                 (3)

so that u = -1 is kd = 0 and u = 1 is kp = 0.  The part of a search that knows the structure is here and, compiled, in
`controllers.py`; the solver's symbols are in `nonlinear/controllers.py`.

Source: derived.
"""

from __future__ import annotations

import itertools
import math
from typing import NamedTuple

import numpy as np

from fopi_tune.core.bode_form import Array
from fopi_tune.core.terms.controller_spec import ControllerSpec
from fopi_tune.design.global_search.compiled import Box, Sampling, Table, compiled, entry
from fopi_tune.design.global_search.controllers import order_of

#: rays: so many directions for each shape
_DIRECTIONS = 33
#: neper: the part of the reach of directions that does not depend on the order
_BASE = 2.5
#: r of (3), and the largest |ln tan(theta)| between the ends
_REACH, _MOST = 2.0, 9.0
#: of the largest gain: a term without an influence
_IDLE = 1e-3
#: of the size of each gain: those that are this much apart are polished on their own
_FAR = 0.23
#: scaled gains beyond this are taken for unbounded
LARGEST_GAIN = 1e6


class Structure(NamedTuple):
    """What a search has to know of the numbers x.

    Args:
        names: of the numbers in specs and results.
        linear: how many of them are gains.
        step: the distance of shapes in a scan.
        fewest: shapes in a scan at least.
    """

    names: tuple[str, ...]
    linear: int
    step: float
    fewest: int

    @classmethod
    def of(cls, spec: ControllerSpec) -> Structure:
        """That of a spec's box."""
        if spec.has_derivative_order:
            return WITH_ORDERS
        return WITH_DERIVATIVE if spec.has_derivative else FRACTIONAL

    @property
    def has_orders(self) -> bool:
        """Whether integral and derivative have an order each."""
        return len(self.names) > 3

    def sampling_at(self, x: Array, sampling: Sampling) -> Sampling:
        """With the orders of the numbers x."""
        return sampling._replace(order=float(x[3]), rise=float(x[4])) if self.has_orders else sampling

    @property
    def gains(self) -> tuple[int, ...]:
        """Indices of the gains."""
        return tuple(range(self.linear))

    def order(self, x: Array) -> float:
        """The order of the integral."""
        return float(x[3]) if self.has_orders else float(x[2]) if self.linear == FRACTIONAL.linear else 1.0

    def times(self, k: float, x: Array) -> Array:
        """The numbers of k C."""
        return np.concatenate([k * x[: self.linear], x[self.linear :]])

    def size(self, x: Array) -> float:
        """The largest gain."""
        return float(np.max(np.abs(x[: self.linear])))

    def units(self, x: Array) -> Array:
        """What the solver's unknowns are measured in near x: of the size of each number, never of a vanishing one."""
        unit = max(self.size(x), 1e-12)
        return np.concatenate([np.maximum(np.abs(x[: self.linear]), 0.1 * unit), np.ones(len(x) - self.linear)])

    def without_idle_orders(self, x: Array) -> Array:
        """With 0 in place of orders whose terms are so small that they hardly matter."""
        found, idle = x.copy(), np.abs(x) <= _IDLE * self.size(x)
        if self.linear < 3 and idle[1]:
            found[2] = 0.0
        elif self.has_orders:
            found[3:] = np.where(idle[1:3], 0.0, x[3:])
        return found

    def are_apart(self, one: Array, other: Array) -> bool:
        """Whether a polish from one may end elsewhere than at the other."""
        near = 0.05 + 0.1 * np.abs(other)
        # small gains are compared by their size
        near[: self.linear] = np.minimum(near, _FAR * self.units(other))[: self.linear]
        return bool(np.any(((one == 0.0) != (other == 0.0)) | (np.abs(one - other) > near)))

    def reach(self, z: Array) -> Array:
        """How far the solver's unknowns may go from z by a region of radius 1."""
        return np.concatenate([0.3 + np.abs(z[: self.linear]), np.full(len(z) - self.linear, 0.5)])


FRACTIONAL = Structure(("kp", "ki", "alpha"), 2, 0.07, 7)
WITH_DERIVATIVE = Structure(("kp", "ki", "kd"), 3, 0.13, 2)
WITH_ORDERS = Structure(("kp", "ki", "kd", "alpha", "mu"), 3, 0.3, 2)


def quadrants_of(box: Box) -> Array:
    """The signs of kp, ki and kd that their ranges allow, shape (k, 3)."""
    ranges = ((box.kp_low, box.kp_high), (box.ki_low, box.ki_high), (box.kd_low, box.kd_high))
    signs = [[s for s in (1.0, -1.0) if (high > 0.0 if s > 0 else low < 0.0)] or [1.0] for low, high in ranges]
    return np.array(list(itertools.product(*signs)))


def directions_of(box: Box) -> tuple[Array, bool]:
    """The grid of tau, and whether it is a single one."""
    if box.ki_low == box.ki_high == 0.0:
        return np.array([-1.0]), True
    if box.kp_low == box.kp_high == 0.0 and box.kd_low == box.kd_high == 0.0:
        return np.array([1.0]), True
    return np.concatenate([[-1.0], np.linspace(-0.96, 0.96, _DIRECTIONS - 2), [1.0]]), False


@compiled
def with_orders(alpha, mu, table):
    """A table whose controllers have these orders."""
    own = table.sampling
    sampling = Sampling(own.half, own.corners, own.matched, own.gain, own.derivative, alpha, mu, own.rise_corners)
    return Table(
        table.v, table.omega, table.gain, table.phase, table.real, table.imag, table.delay, table.unstable,
        table.start_phase, table.low_slope, table.high_slope, table.alias, table.error_gain, table.members,
        table.points, table.log_omega, table.late, sampling, table.filter_gain, table.plant_gain,
    )  # fmt: skip


@entry
def box_with_orders(mu, box):
    """A box whose range of kd' = kd g omega_s^mu is that of this order."""
    factor = math.exp((mu - 1.0) * box.log_omega)
    low, high = max(box.kd_low * factor, -LARGEST_GAIN), min(box.kd_high * factor, LARGEST_GAIN)
    return Box(
        box.kp_low, box.kp_high, box.ki_low, box.ki_high, box.alpha_low, box.alpha_high, box.log_omega, box.log_gain,
        box.log_horizon, low, high, box.shape_low, box.shape_high,
    )  # fmt: skip


@compiled
def clamped(ratio, top_low, top_high, bottom_low, bottom_high):
    """A ratio of two numbers in [low, high], not negative, that is as close to the given one as their ranges allow."""
    low = top_low / bottom_high if bottom_high > 0.0 else (np.inf if top_high > 0.0 else 0.0)
    high = top_high / bottom_low if bottom_low > 0.0 else (np.inf if top_high > 0.0 else 0.0)
    return min(max(ratio, low), high)


@compiled
def sizes(sign, low, high):
    """The sizes of a gain of one sign in its range: (least, largest)."""
    return (max(low, 0.0), max(high, 0.0)) if sign > 0.0 else (max(-high, 0.0), max(-low, 0.0))


@compiled
def parts_of(ratio):
    """(cos, sin) of an angle in [0, 90 deg] with this tangent."""
    if ratio == np.inf:
        return 0.0, 1.0
    size = math.sqrt(1.0 + ratio * ratio)
    return 1.0 / size, ratio / size


@compiled
def direction_ratio(order, tau, most, span):
    """ki'/kp' of a direction: from 0 at tau = -1 to inf at tau = 1."""
    if tau <= -1.0:
        return 0.0
    if tau >= 1.0:
        return np.inf
    t = (_BASE + order * span) * tau / math.sqrt(1.0 - tau * tau)
    return math.exp(min(max(t, -order * most), order * most))


@compiled
def tau_of(order, ratio, most, span):
    """The inverse of `direction_ratio`: tau of ki'/kp' >= 0, and whether a direction reaches it."""
    if ratio == 0.0:
        return -1.0, True
    if ratio == np.inf:
        return 1.0, True
    t = math.log(ratio)
    x = t / (_BASE + order * span)
    return x / math.sqrt(1.0 + x * x), abs(t) <= order * most


@compiled
def shape_ratio(u):
    """tan(theta) by (3)."""
    if u <= -1.0:
        return 0.0
    if u >= 1.0:
        return np.inf
    return math.exp(min(max(_REACH * u / math.sqrt(1.0 - u * u), -_MOST), _MOST))


@entry
def ray_of(shape, tau, signs, most, span, box, sampling):
    """The numbers (third, c, s) of the ray C0 with a shape and a direction that is nearest to them in the box of gains.

    Args:
        shape: alpha, or u of (3).
        tau: in [-1, 1]: -1 is ki = 0, 1 is ki alone.
        signs: of the gains.
        most, span: of `reach_of`.
        box: the ranges.
        sampling: tells the structure.
    """
    order = order_of(shape, sampling)
    ki_low, ki_high = sizes(signs[1], box.ki_low, box.ki_high)
    unit = math.exp(box.log_gain - order * box.log_omega)
    first_low, first_high = sizes(signs[0], box.kp_low, box.kp_high)
    cosine, sine = 1.0, 0.0
    if sampling.derivative > 0.0:
        kd_low, kd_high = sizes(signs[2], box.kd_low, box.kd_high)
        cosine, sine = parts_of(clamped(shape_ratio(shape), kd_low, kd_high, first_low, first_high))
        low, high = 0.0, np.inf
        if cosine > 0.0:
            low, high = first_low / cosine, first_high / cosine
        if sine > 0.0:
            low, high = max(low, kd_low / sine), min(high, kd_high / sine)
        first_low, first_high = low, high
    ratio = clamped(direction_ratio(order, tau, most, span), ki_low * unit, ki_high * unit, first_low, first_high)
    c, s = parts_of(ratio)
    if sampling.derivative > 0.0:
        return c * sine * signs[2], c * cosine * signs[0], s * signs[1]
    return shape, c * signs[0], s * signs[1]


@compiled
def kappa_range(third, c, s, least, largest, box, sampling):
    """The kappa in [least, largest] that the ranges of the gains allow: (low, high)."""
    low, high = 0.0, math.exp(largest)
    order = order_of(third, sampling)
    factor = s * math.exp(order * box.log_omega - box.log_gain)
    for part in range(3 if sampling.derivative > 0.0 else 2):
        x, a, b = c, box.kp_low, box.kp_high
        if part == 1:
            x, a, b = factor, box.ki_low, box.ki_high
        elif part == 2:
            x, a, b = third, box.kd_low, box.kd_high
        if x == 0.0:
            if a > 0.0 or b < 0.0:
                return 1.0, 0.0
        elif x > 0.0:
            low, high = max(low, a / x), min(high, b / x)
        else:
            low, high = max(low, b / x), min(high, a / x)
    lowest = math.log(low) if low > math.exp(least) else least
    highest = math.log(high) if high > 1e-300 else 2.0 * least
    if highest < lowest < highest + 1e-9:
        # both are ends of the box on which the ray was put
        return highest, highest
    return lowest, highest
