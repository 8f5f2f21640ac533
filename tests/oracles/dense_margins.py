"""A second opinion on margins:  L on a dense grid of frequencies -> stability and the three margins, by NumPy alone.

Written from the definitions, sharing no formula with the package: crossings by scan, bisection and secants; extremes of
|L| and of the angle from -1 between the grid's points by golden section; stability by the argument of the
characteristic function on the whole contour, by the roots of a polynomial, or (on samples) by eigenvalues.  Radian, s
and neper.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray
from oracles import sampled_loops

from fopi_tune.core.parallel_form import Implementation
from fopi_tune.core.plant import Plant

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

#: a loop closer to -1 than this, or steps of the argument that stay wide, are nobody's certain knowledge
NEAR = 1e-7
#: points of the grid that follows a dead time
_MOST_POINTS = 300_000
_STEPS, _GOLDEN = 20, 20
_RATIO = 0.5 * (math.sqrt(5.0) - 1.0)


class UncertainError(Exception):
    """This oracle cannot tell."""


@dataclass(frozen=True)
class Continuous:
    """C P in continuous time, C = kp + ki s^-alpha."""

    plant: Plant
    kp: float
    ki: float
    alpha: float

    def gain(self, omega: Array) -> Complex:
        """L(j omega)."""
        s = 1j * omega
        c = self.kp + (self.ki * s**-self.alpha if self.ki else 0.0)
        p = np.polyval(self.plant.numerator, s) / np.polyval(self.plant.denominator, s)
        return np.asarray(c * p * np.exp(-s * self.plant.dead_time_s), dtype=complex)

    @cached_property
    def _roots(self) -> Complex:
        return np.concatenate([np.roots(self.plant.numerator), np.roots(self.plant.denominator)]).astype(complex)

    @cached_property
    def _corners(self) -> list[float]:
        corners = [float(abs(root)) for root in self._roots if root != 0.0]
        if self.kp and self.ki:
            corners.append(abs(self.ki / self.kp) ** (1.0 / self.alpha))
        if self.plant.dead_time_s:
            corners.append(1.0 / self.plant.dead_time_s)
        return corners or [1.0]

    @cached_property
    def plain_grid(self) -> Array:
        """Frequencies without regard to a dead time: dense over the corners, and wide of them."""
        low, high = math.log(min(self._corners)) - 5.0, math.log(max(self._corners)) + 5.0
        parts = [np.arange(low, high, 0.01), np.arange(low - 60.0, low, 0.1), np.arange(high, high + 60.0, 0.1)]
        for root in self._roots[self._roots.imag > 0]:  # resonances are as narrow as their damping
            width = max(abs(root.real) / abs(root), 1e-9)
            near = width * np.geomspace(1e-2, 0.3 / min(width, 0.3), 120)
            parts += [math.log(abs(root)) + near, math.log(abs(root)) - near]
        return np.exp(np.unique(np.concatenate(parts)))

    @cached_property
    def grid(self) -> Array:
        """The same, with every turn of the dead time as far as |L| can matter for any margin."""
        late, omega = self.plant.dead_time_s, self.plain_grid
        if late == 0.0:
            return omega
        size = np.abs(self.gain(omega))
        last = float(omega[size >= 0.9].max(initial=0.0))
        first = self._with_turns(last + 6.0 * math.pi / late, omega)
        small = [value for value in _negative_on(self, first) if value < 1.0]
        # a crossing at a higher frequency matters only where |L| is still as large, and not where |L| tends to L(inf)
        end = float(omega[size >= 0.99 * max(small, default=1.0)].max(initial=0.0))
        return self._with_turns(min(end, 30.0 * max(self._corners)), first)

    def _with_turns(self, end: float, known: Array) -> Array:
        late = self.plant.dead_time_s
        if end * late > 0.1 * _MOST_POINTS:
            raise UncertainError("too many turns of the dead time")
        return np.unique(np.concatenate([known, np.arange(0.1 / late, end, 0.1 / late)]))

    def _at_zero(self) -> float:
        """L(0); infinite with an integral, nan where it is a product of 0 and infinity."""
        top, bottom = self.plant.numerator[-1], self.plant.denominator[-1]
        size = math.inf if self.ki else self.kp
        if top == 0.0 or bottom == 0.0:
            return math.nan if self.ki and top == 0.0 else 0.0 if bottom != 0.0 else math.inf
        return math.inf if self.ki else size * top / bottom

    @property
    def direct(self) -> float:
        """L(inf), but for the turns of a dead time."""
        numerator = np.trim_zeros(self.plant.numerator, "f")
        if len(numerator) < len(self.plant.denominator):
            return 0.0
        return self.kp * numerator[0] / self.plant.denominator[0]

    @property
    def ends(self) -> list[float]:
        """-L at the ends of the axis, where it is a number that a gain margin counts; of a dead time, its circle."""
        zero, high = self._at_zero(), self.direct
        found = [-zero] if math.isfinite(zero) else []
        return [*found, abs(high) if self.plant.dead_time_s else -high]

    @property
    def end_size(self) -> float:
        """|L| at the upper end."""
        return abs(self.direct)

    @cached_property
    def is_stable(self) -> bool:
        """By the roots of a polynomial where it is one, else by the contour."""
        if np.min(np.abs(1.0 + self.gain(self.grid))) < NEAR:
            raise UncertainError("through -1")
        if self._at_the_origin == 0.0:
            return False
        late = self.plant.dead_time_s
        if late and abs(abs(self.direct) - 1.0) < NEAR:
            raise UncertainError("a direct path of 1")
        if late and abs(self.direct) > 1.0:
            return False
        poles = self._poles_by_contour()
        if late == 0.0 and (self.ki == 0.0 or self.alpha == 1.0):
            by_roots = int(np.sum(np.roots(self._polynomial()).real > 0.0))
            if by_roots != poles:
                raise UncertainError(f"{by_roots} roots, {poles} by the contour")
        return poles == 0

    @property
    def _at_the_origin(self) -> float:
        """F(0) of the characteristic function; 0 is a pole there, or an integral that the plant cancels."""
        if self.ki:
            return self.ki * self.plant.numerator[-1]
        return self.plant.denominator[-1] + self.kp * self.plant.numerator[-1]

    def _polynomial(self) -> Array:
        top, bottom = np.array(self.plant.numerator), np.array(self.plant.denominator)
        if not self.ki:
            return np.asarray(np.polyadd(bottom, self.kp * top), dtype=float)
        integral = np.polyadd(np.append(bottom, 0.0), np.polymul(top, [self.kp, self.ki]))
        return np.asarray(integral, dtype=float)

    def _poles_by_contour(self) -> int:
        """Zeros of F(s) = s^alpha D + (kp s^alpha + ki) N e^{-Ls} (without ki: D + kp N e^{-Ls}) on the right.

        Along +0, j0, j inf, +inf the argument of F turns by -pi each.  F is constant up to the grid's first
        frequency; from its last one back to the real axis F follows (1 + L) s^(alpha + n) d, |L| small or L real.
        """
        power = self.alpha if self.ki else 0.0

        def parts(omega: Array) -> tuple[Complex, Complex]:
            """D/|D| and 1 + L; their product with j^alpha has the argument of F."""
            d = np.polyval(self.plant.denominator, 1j * omega)
            return np.asarray(d / np.abs(d), dtype=complex), 1.0 + self.gain(omega)

        omega = self.grid
        d, f = parts(omega)
        for _ in range(40):
            steps = np.angle(d[1:] * f[1:] / (d[:-1] * f[:-1]))
            # where |L| < 1, 1 + L keeps to the right half-plane, however often the dead time turns it
            small = np.maximum(np.abs(f[1:] - 1.0), np.abs(f[:-1] - 1.0)) < 0.95
            apart = np.angle(d[1:] / d[:-1])
            steps = np.where(small, apart + np.diff(np.angle(f)), steps)
            wide = np.flatnonzero(np.abs(np.where(small, apart, steps)) > 0.5)
            if not len(wide):
                break
            middle = np.sqrt(omega[wide] * omega[wide + 1])
            more = parts(middle)
            omega = _inserted(omega, wide, middle)
            d, f = _inserted(d, wide, more[0]), _inserted(f, wide, more[1])
        else:
            raise UncertainError("the argument does not settle")
        value = 1j**power * d * f
        last = 1.0 + (0.0 if self.plant.dead_time_s else self.direct)
        degree = power + len(self.plant.denominator) - 1
        start = float(np.angle(value[0] / np.sign(self._at_the_origin)))
        # at the last frequency F/((j omega)^degree d last) is near 1, or on a dead time's circle around it
        end = float(np.angle(value[-1] / (1j**degree * np.sign(self.plant.denominator[0]) * last)))
        turn = start + float(steps.sum()) - end - 0.5 * math.pi * degree
        count = -turn / math.pi
        if abs(count - round(count)) > 1e-3 or round(count) < 0:
            raise UncertainError(f"{count} poles")
        return round(count)


@dataclass(frozen=True)
class OnSamples:
    """C P on samples: state space, and eigenvalues for the stability."""

    loop: sampled_loops.Loop

    @classmethod
    def of(cls, plant: Plant, implementation: Implementation) -> OnSamples:
        """One plant with a digital controller."""
        return cls(sampled_loops.Loop.of(plant, implementation))

    def gain(self, omega: Array) -> Complex:
        """L(e^{j omega Ts})."""
        return self.loop.gain(omega)

    @cached_property
    def grid(self) -> Array:
        """Up to just below Nyquist's frequency."""
        nyquist, late = self.loop.nyquist, self.loop.plant.whole + 2
        parts = [
            np.geomspace(1e-8, 1.0, 1600),
            np.linspace(0.0, 1.0, 40 * late + 400),
            1.0 - np.geomspace(1e-6, 0.3, 200),
        ]
        for pole in np.linalg.eigvals(self.loop.plant.phi) if len(self.loop.plant.phi) else ():
            turn, width = abs(np.angle(pole)) / math.pi, max(1.0 - abs(pole), 1e-9)
            parts += [turn + sign * width * np.geomspace(1e-2, 100.0, 120) for sign in (1.0, -1.0)]
        share = np.unique(np.concatenate(parts))
        return nyquist * share[(share > 0.0) & (share < 1.0)]

    @property
    def plain_grid(self) -> Array:
        """The same grid for |L|."""
        return self.grid

    @property
    def ends(self) -> list[float]:
        """-L at both ends of the axis; only where it is finite."""
        values = self.gain(np.array([1e-10 * self.loop.nyquist, self.loop.nyquist]))
        integrating = abs(values[0]) > 1e3
        return [*([] if integrating else [-float(values[0].real)]), -float(values[1].real)]

    @property
    def end_size(self) -> float:
        """|L(-1)|."""
        return abs(self.ends[-1])

    @cached_property
    def is_stable(self) -> bool:
        """Whether every eigenvalue of the closed loop is inside the unit circle."""
        radius = float(sampled_loops.sizes(self.loop.plant, self.loop.sections).max())
        if abs(radius - 1.0) < NEAR:
            raise UncertainError("a pole next to the circle")
        return radius < 1.0


Loop = Continuous | OnSamples


def value(loop: Loop, quantity: str) -> float:
    """A margin of one loop, were it stable; rad, s or neper.

    Raises:
        UncertainError: too close to a border to tell.
    """
    if quantity == "gain_margin_db":
        return gain_margin(loop)
    omega = gain_crossovers(loop)
    angles = np.angle(-loop.gain(omega)) if len(omega) else np.zeros(0)
    if quantity == "phase_margin_deg":
        return float(np.abs(angles).min(initial=math.inf))
    if abs(loop.end_size - 1.0) < NEAR:
        raise UncertainError("|L| = 1 at the end")
    return 0.0 if loop.end_size > 1.0 else float((np.mod(angles, 2.0 * np.pi) / omega).min(initial=math.inf))


def gain_crossovers(loop: Loop) -> Array:
    """Every frequency with |L| = 1."""

    def height(omega: Array) -> Array:
        return np.log(np.abs(loop.gain(omega)))

    return _roots(height, loop.plain_grid, height(loop.plain_grid))


def gain_margin(loop: Loop) -> float:
    """The smallest -ln|L| at frequencies where L is real and negative with |L| < 1, both ends of the axis included."""

    def turn(omega: Array) -> Array:
        return np.angle(-loop.gain(omega))

    found = _roots(turn, loop.grid, turn(loop.grid), 0.5 * math.pi)
    inner = np.abs(loop.gain(found)).tolist() if len(found) else []
    small = [size for size in [*inner, *loop.ends] if 0.0 < size < 1.0]
    return -math.log(max(small)) if small else math.inf


def _negative_on(loop: Loop, grid: Array) -> list[float]:
    """|L| next to crossings of the negative real axis, a little too small."""
    gain = loop.gain(grid)
    angle = np.angle(-gain)
    k = np.flatnonzero((angle[1:] * angle[:-1] < 0.0) & (np.maximum(np.abs(angle[1:]), np.abs(angle[:-1])) < 1.5))
    return np.minimum(np.abs(gain[k]), np.abs(gain[k + 1])).tolist()


def _roots(function: Callable[[Array], Array], grid: Array, values: Array, most: float = math.inf) -> Array:
    """Roots between the grid's points, two at an extreme that just passes 0 included.

    Args:
        function: of omega.
        grid: ascending.
        values: of the function on the grid.
        most: a change of sign between larger values is a jump of the angle, no root.
    """
    omega = np.log(grid)
    k = np.arange(1, len(omega) - 1)
    before, here, after = (np.abs(values[k + j]) for j in (-1, 0, 1))
    same = (np.sign(values[k - 1]) == np.sign(values[k])) & (np.sign(values[k + 1]) == np.sign(values[k]))
    # a parabola through the three points comes as close to 0 as its neighbours are apart
    k = k[same & (here <= before) & (here <= after) & (here <= np.maximum(before, after) - here)]
    if len(k):
        sign = np.sign(values[k])
        low, high = omega[k - 1], omega[k + 1]
        for _ in range(_GOLDEN):
            left, right = high - _RATIO * (high - low), low + _RATIO * (high - low)
            nearer = sign * function(np.exp(left)) < sign * function(np.exp(right))
            low, high = np.where(nearer, low, left), np.where(nearer, right, high)
        place = 0.5 * (low + high)
        omega, order = np.unique(np.concatenate([omega, place]), return_index=True)
        values = np.concatenate([values, function(np.exp(place))])[order]
    jump = np.maximum(np.abs(values[1:]), np.abs(values[:-1])) > most
    k = np.flatnonzero((np.sign(values[1:]) != np.sign(values[:-1])) & ~jump)
    return np.exp(_polished(function, omega[k], omega[k + 1], values[k], values[k + 1]))


def _inserted(old: Any, after: NDArray[np.intp], new: Any) -> Any:
    return np.insert(old, after + 1, new)


def _polished(function: Callable[[Array], Array], low: Array, high: Array, f_low: Array, f_high: Array) -> Array:
    """ln omega of the roots in brackets, by bisection and the rule of Illinois in turns."""
    side = np.zeros(len(low))
    for step in range(_STEPS if len(low) else 0):
        flat = f_high == f_low
        secant = low - f_low * (high - low) / np.where(flat, 1.0, f_high - f_low)
        middle = 0.5 * (low + high) if step % 4 == 3 else np.where(flat, 0.5 * (low + high), secant)
        f = function(np.exp(middle))
        same = np.sign(f) == np.sign(f_low)
        f_high = np.where(same, np.where(side > 0, 0.5 * f_high, f_high), f)
        f_low = np.where(same, f, np.where(side < 0, 0.5 * f_low, f_low))
        low, high, side = np.where(same, middle, low), np.where(same, high, middle), np.where(same, 1.0, -1.0)
    return np.where(np.abs(f_low) < np.abs(f_high), low, high)
