"""A second opinion on margins and stability:  dense Nyquist curves, sharing no formula with the package.

The loop is evaluated from its definition.  Its curve is sampled densely, local extrema of |L| and of its phase are
refined, and every change of sign is bisected; unstable poles are counted by following the argument of 1 + L along the
contour, or as roots of the closed-loop polynomial.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from fopi_tune.core.controller import FoPi
from fopi_tune.core.plant import Plant

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]
Curve = Callable[[Array], Complex]

#: points of a grid; a loop that needs more is given up
MOST_POINTS = 400_000
#: rad; the argument of 1 + L turns by less between neighbouring points
_STEP = 0.3
_GOLDEN = 0.5 * (math.sqrt(5.0) - 1.0)


class TooLongError(Exception):
    """The grid would need too many points."""


@dataclass(frozen=True)
class Loop:
    """L(s) = factor (kp + ki s^-alpha) N(s)/D(s) e^{-dead_time_s s}."""

    controller: FoPi
    plant: Plant
    factor: float = 1.0
    more_dead_time_s: float = 0.0

    def scaled(self, factor: float) -> Loop:
        """The same with another gain."""
        return replace(self, factor=self.factor * factor)

    def delayed(self, dead_time_s: float) -> Loop:
        """The same with so much more dead time."""
        return replace(self, more_dead_time_s=self.more_dead_time_s + dead_time_s)

    @property
    def dead_time_s(self) -> float:
        """All of it."""
        return self.plant.dead_time_s + self.more_dead_time_s

    @cached_property
    def roots(self) -> tuple[Complex, Complex]:
        """Zeros and poles of the plant."""
        return np.roots(self.plant.numerator).astype(complex), np.roots(self.plant.denominator).astype(complex)

    def at(self, s: Complex) -> Complex:
        """L(s), s in the closed right half-plane."""
        c = self.controller
        controller = c.kp + (c.ki * np.asarray(s, dtype=complex) ** -c.alpha if c.ki else 0.0)
        p = np.polyval(self.plant.numerator, s) / np.polyval(self.plant.denominator, s)
        return self.factor * controller * p * np.exp(-s * self.dead_time_s)

    def curve(self, omega: Array) -> Complex:
        """L(j omega)."""
        return self.at(np.asarray(1j * omega, dtype=complex))

    @property
    def at_infinity(self) -> float:
        """The limit of L without its dead time."""
        top, bottom = np.trim_zeros(self.plant.numerator, "f"), self.plant.denominator
        return self.factor * self.controller.kp * top[0] / bottom[0] if len(top) == len(bottom) else 0.0

    @property
    def at_rest(self) -> float | None:
        """L(0); None where it is not finite."""
        if self.controller.ki or self.plant.denominator[-1] == 0.0:
            return None
        return self.factor * self.controller.kp * self.plant.numerator[-1] / self.plant.denominator[-1]

    def grid(self, points: int = 60) -> Array:
        """Frequencies about every corner and crossover, dense at resonances, and six points a radian of dead time.

        Raises:
            TooLongError: the dead time turns too often.
        """
        roots = np.concatenate(self.roots)
        roots = roots[np.abs(roots) > 0.0]
        c = self.controller
        corners = [*np.abs(roots).tolist(), *([1.0 / self.dead_time_s] if self.dead_time_s else [])]
        corners += [abs(c.ki / c.kp) ** (1.0 / c.alpha)] if c.kp and c.ki else []
        wide = np.logspace(-25.0, 25.0, 1001)
        large = np.abs(self.curve(wide)) > 1.0
        corners += wide[1:][large[1:] != large[:-1]].tolist()
        corners = [x for x in corners if 1e-20 < x < 1e20] or [1.0]
        low, high = math.log10(min(corners)) - 5.0, math.log10(max(corners)) + 5.0
        grid = [np.logspace(low, high, int(points * (high - low)))]
        # through a resonance the phase turns within |Re r|
        spread = np.sinh(np.linspace(-9.0, 9.0, 181))
        for r in roots[np.abs(roots.imag) > 0.0]:
            near = abs(r.imag) + abs(r.real) * spread
            grid.append(near[near > 0.0])
        omega = np.unique(np.concatenate(grid))
        if not self.dead_time_s:
            return omega
        # beyond, |L| is smaller than where the phase has crossed -180 deg before, or has all but reached its limit
        large = np.abs(self.curve(omega)) > max(0.2, 1.02 * abs(self.at_infinity))
        own = 3.0 * float(np.abs(roots).max(initial=0.0))
        last = max(float(omega[large].max(initial=0.0)), own, 100.0 / self.dead_time_s)
        if last * self.dead_time_s * 6.0 > MOST_POINTS:
            raise TooLongError
        return np.unique(
            np.concatenate([omega, np.arange(1.0 / 6.0, last * self.dead_time_s, 1.0 / 6.0) / self.dead_time_s])
        )


# -- closed-loop poles ------------------------------------------------------------------------------------------------


def closed_loop_roots(loop: Loop) -> Complex:
    """Roots of the closed loop with a PI (alpha = 1) and no dead time."""
    assert loop.controller.alpha == 1.0
    assert loop.dead_time_s == 0.0
    kp, ki = loop.factor * loop.controller.kp, loop.factor * loop.controller.ki
    top = np.polymul([kp, ki], loop.plant.numerator) if ki else kp * np.array(loop.plant.numerator)
    bottom = np.polymul([1.0, 0.0], loop.plant.denominator) if ki else np.array(loop.plant.denominator)
    return np.roots(np.polyadd(bottom, top)).astype(complex)


def unstable_poles(loop: Loop) -> float:
    """Closed-loop poles right of the axis:  P - (turn of 1 + L along the upper half of Nyquist's contour)/pi.

    From a point +e on the real axis around the origin to j e, up the axis, and back to +infinity.  Beyond the last
    frequency with |L| >= 1, 1 + L stays right of the axis, so that its argument returns to 0.  Poles on the axis itself
    (but at the origin) are not allowed; with a dead time and |L| -> 1 or more there are infinitely many.

    Raises:
        TooLongError: the grid would need too many points, or to go on too far.
    """
    if loop.dead_time_s and abs(loop.at_infinity) >= 1.0:
        return math.inf
    axis = loop.grid(20)
    # small orders become integrators only at absurdly low frequencies
    lowest = -min(280.0, 9.0 + 10.0 / loop.controller.alpha) if loop.controller.ki else -9.0
    start = min(10.0**lowest, axis[0])
    below = np.logspace(math.log10(start), math.log10(axis[0]), 20 * math.ceil(math.log10(axis[0] / start)) + 2)
    # a direct path above 1 is followed until nothing is left of the rest
    above = axis[-1] * np.logspace(0.0, 9.0, 200 if abs(loop.at_infinity) >= 1.0 else 2)
    every = np.unique(np.concatenate([below, axis, above]))
    t = np.concatenate([np.linspace(-1.0, 0.0, 60), np.log(every / start)[1:]])

    def point(t: Array) -> Complex:
        # t from -1 to 0 is the arc, then ln(omega/start)
        arc = start * np.exp(0.5j * np.pi * (np.clip(t, -1.0, 0.0) + 1.0))
        return arc * np.exp(np.maximum(t, 0.0))

    returns = abs(loop.at_infinity) < 1.0
    if returns:
        large = np.flatnonzero(np.abs(loop.at(point(t))) >= 0.999)
        t = t[: max(int(large.max(initial=0)) + 2, 62)]
    for _ in range(80):
        value = 1.0 + loop.at(point(t))
        step = np.angle(value[1:] / value[:-1])
        coarse = np.abs(step) > _STEP
        if not coarse.any():
            break
        t = np.sort(np.concatenate([t, 0.5 * (t[1:] + t[:-1])[coarse]]))
        if len(t) > MOST_POINTS:
            raise TooLongError
    else:
        raise TooLongError
    turn = (float(step.sum()) - (float(np.angle(value[-1])) if returns else 0.0)) / np.pi
    if abs(1.0 + loop.at_infinity) < 1e-3 and abs(turn - round(turn)) >= 0.05:
        raise TooLongError  # a fractional tail hides on which side of 0 the path ends
    # both ends of the contour are real: anything else means that the path was lost
    assert abs(turn - round(turn)) < 0.05, (loop, turn)
    return int(np.sum(loop.roots[1].real > 0.0)) - round(turn)


# -- margins ----------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class DenseMargins:
    """What the curve of a stable loop says; empty arrays where nothing is crossed.

    Args:
        crossovers_rad_s: every |L| = 1.
        angles_rad: from -1 to L there, in (-pi, pi].
        levels: |L| wherever L is real and negative, the limits included.
    """

    crossovers_rad_s: Array
    angles_rad: Array
    levels: Array

    @property
    def phase_margin_deg(self) -> float:
        """The smallest angle."""
        return math.degrees(float(np.abs(self.angles_rad).min(initial=math.inf)))

    @property
    def delay_margin_s(self) -> float:
        """The shortest lag; inf without a crossover, also where |L| stays large."""
        lag = np.where(self.angles_rad < 0.0, self.angles_rad + 2.0 * np.pi, self.angles_rad)
        return float((lag / self.crossovers_rad_s).min(initial=math.inf))

    @property
    def gain_margin(self) -> float:
        """The smallest factor above 1; inf without."""
        below = self.levels[self.levels < 1.0]
        return 1.0 / float(below.max()) if len(below) else math.inf

    @property
    def reduction_margin(self) -> float:
        """The largest factor below 1; 0 without."""
        above = self.levels[self.levels > 1.0]
        return 1.0 / float(above.min()) if len(above) else 0.0


def dense_margins(curve: Curve, omega: Array, limits: tuple[float, ...] = ()) -> DenseMargins:
    """Every crossing of a curve.

    Args:
        curve: L at frequencies.
        omega: a dense grid.
        limits: real values of L at the ends of the axis.
    """

    def log_gain(w: Array) -> Array:
        return np.log(np.abs(curve(w)))

    def sine(w: Array) -> Array:
        value = curve(w)
        return value.imag / np.abs(value)

    gains = _roots(log_gain, omega)
    real = _roots(sine, omega)
    at_real: Complex = curve(real) if len(real) else np.zeros(0, dtype=complex)
    negative = [-value for value in limits if value < 0.0]
    levels = np.concatenate([np.abs(at_real[at_real.real < 0.0]), negative])
    angles = np.angle(-curve(gains)) if len(gains) else np.zeros(0)
    return DenseMargins(gains, angles, levels)


def _roots(f: Callable[[Array], Array], omega: Array) -> Array:
    """Changes of sign between the grid's points and its refined local extrema, bisected in ln omega."""
    u = np.log(omega)

    def g(x: Array) -> Array:
        return f(np.exp(x))

    values = g(u)
    inner = np.arange(1, len(u) - 1)
    # extrema that come close to 0 without a change of sign there
    turned = (values[inner] - values[inner - 1]) * (values[inner + 1] - values[inner]) <= 0.0
    toward = np.abs(values[inner]) <= np.minimum(np.abs(values[inner - 1]), np.abs(values[inner + 1]))
    at = inner[turned & toward]
    if len(at):
        sign = np.sign(values[at])
        low, high = u[at - 1], u[at + 1]
        for _ in range(70):
            a, b = high - _GOLDEN * (high - low), low + _GOLDEN * (high - low)
            left = sign * g(a) < sign * g(b)
            low, high = np.where(left, low, a), np.where(left, b, high)
        u = np.unique(np.concatenate([u, 0.5 * (low + high)]))
        values = g(u)
    k = np.flatnonzero((values[1:] > 0.0) != (values[:-1] > 0.0))
    low, high, rising = u[k], u[k + 1], values[k + 1] > values[k]
    for _ in range(70):
        middle = 0.5 * (low + high)
        right = (g(middle) > 0.0) == rising
        low, high = np.where(right, low, middle), np.where(right, middle, high)
    return np.exp(0.5 * (low + high))
