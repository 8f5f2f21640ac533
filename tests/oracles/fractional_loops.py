"""A second opinion on loops with fractional plants:  margins, responses and stability by NumPy alone.

Powers are exp(order ln s).  Margins are those of `dense_margins`; poles are counted by the argument on the contour, and
by the roots of a polynomial in w = s^(1/q) where all orders are multiples of 1/q (Matignon: a root is a pole on the
right where |arg w| < pi/(2 q)).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray
from oracles.dense_margins import NEAR, Continuous, UncertainError
from oracles.fopid_loops import NEAR_EDGE, controller
from oracles.pid_loops import PidFamily, PidLoop

from fopi_tune.core.controller import FoPi, FoPid, derivative_of
from fopi_tune.core.plant import Plant

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]
#: coefficient and order of each term
Side = tuple[tuple[float, float], ...]


def side_at(side: Side, s: Any) -> Any:
    """sum c s^e."""
    return sum(c * np.exp(e * np.log(s)) for c, e in side)


@dataclass(frozen=True)
class Fractional(Continuous):
    """C P in continuous time, P = top/bottom e^{-Ls}; `plant` has the dead time alone."""

    gains: FoPi
    top: Side
    bottom: Side

    @classmethod
    def of(cls, gains: FoPi, top: Side, bottom: Side, dead_time_s: float = 0.0) -> Fractional:
        """One loop; terms with a coefficient of 0 are left out."""
        top, bottom = (tuple(term for term in side if term[0]) for side in (top, bottom))
        plant = Plant((1.0,), (1.0,), dead_time_s)
        return cls(plant, gains.kp, gains.ki, gains.alpha, gains, top, bottom)

    def response(self, s: Any) -> Any:
        """P(s)."""
        return side_at(self.top, s) / side_at(self.bottom, s) * np.exp(-self.plant.dead_time_s * s)

    def gain(self, omega: Array) -> Complex:
        """L(j omega)."""
        return np.asarray(controller(self.gains, omega) * self.response(1j * omega), dtype=complex)

    @cached_property
    def _roots(self) -> Complex:
        """Of a side where two of its terms are equal; resonances where it is much smaller than its terms."""
        found: list[complex] = []
        for side in (self.top, self.bottom):
            bends = [abs(c / d) ** (1.0 / (f - e)) for c, e in side for d, f in side if f > e]
            found += [complex(-bend) for bend in bends]
            if not bends:
                continue
            omega = np.geomspace(0.1 * min(bends), 10.0 * max(bends), 4000)
            part = np.abs(side_at(side, 1j * omega)) / sum(abs(c) * omega**e for c, e in side)
            k = 1 + np.flatnonzero((part[1:-1] <= part[:-2]) & (part[1:-1] < part[2:]) & (part[1:-1] < 0.5))
            found += [complex(-part[j] + 1j * math.sqrt(1.0 - part[j] ** 2)) * omega[j] for j in k]
        return np.array(found, dtype=complex)

    @cached_property
    def _corners(self) -> list[float]:
        found = [float(abs(root)) for root in self._roots]
        terms = [(self.kp, 0.0), (self.ki, -self.alpha)]
        if isinstance(self.gains, FoPid) and self.gains.kd:
            terms.append((self.gains.kd, self.gains.mu))
            found.append(1.0 / self.gains.derivative_filter_time_constant_s)
        found += [abs(c / d) ** (1.0 / (f - e)) for c, e in terms for d, f in terms if f > e and c and d]
        if self.plant.dead_time_s:
            found.append(1.0 / self.plant.dead_time_s)
        return found or [1.0]

    @cached_property
    def plain_grid(self) -> Array:
        """Slow powers need a wide grid."""
        low, high = math.log(min(self._corners)) - 12.0, math.log(max(self._corners)) + 12.0
        near = [np.log(abs(r)) + d for r in self._roots[self._roots.imag > 0] for d in self._near(r)]
        parts = [np.arange(low, high, 0.01), np.arange(low - 120.0, low, 0.1), np.arange(high, high + 120.0, 0.1)]
        return np.exp(np.unique(np.concatenate([*parts, *near])))

    @staticmethod
    def _near(root: complex) -> tuple[Array, Array]:
        width = max(abs(root.real) / abs(root), 1e-9)
        near = width * np.geomspace(1e-2, 0.3 / min(width, 0.3), 120)
        return near, -near

    @property
    def _first(self) -> tuple[float, float, float, float]:
        """Coefficient and order of the terms that dominate as s -> 0: of N, then of D."""
        return *min(self.top, key=lambda t: t[1]), *min(self.bottom, key=lambda t: t[1])

    def _at_zero(self) -> float:
        c, e, d, f = self._first
        if self.ki:
            return math.nan if e > 0.0 else math.inf
        return math.inf if f > e else 0.0 if e > f else self.kp * c / d

    @property
    def direct(self) -> float:
        """L(inf), but for the turns of a dead time; of filtered controllers."""
        c, e = max(self.top, key=lambda t: t[1])
        d, f = max(self.bottom, key=lambda t: t[1])
        if e < f:
            return 0.0
        kd, mu, filter_s = derivative_of(self.gains)
        return (self.kp + (kd / filter_s if mu == 1.0 else 0.0)) * c / d

    @property
    def _at_the_origin(self) -> float:
        c, e, d, f = self._first
        if self.ki:
            return self.ki * c if e == 0.0 else 0.0
        return (d if f == 0.0 else 0.0) + (self.kp * c if e == 0.0 else 0.0)

    @cached_property
    def is_stable(self) -> bool:
        """By the contour."""
        if np.min(np.abs(1.0 + self.gain(self.grid))) < NEAR:
            raise UncertainError("through -1")
        if self._at_the_origin == 0.0:
            return False
        late = self.plant.dead_time_s
        if late and abs(abs(self.direct) - 1.0) < NEAR:
            raise UncertainError("a direct path of 1")
        if late and abs(self.direct) > 1.0:
            return False
        return self._poles_on_the_right() == 0

    def _poles_on_the_right(self) -> int:
        """Zeros of F = s^a (D + C N e^{-Ls}) by the argument along the axis, and F's leading terms at its ends."""
        power = self.alpha if self.ki else 0.0
        d, f = max(self.bottom, key=lambda t: t[1])

        def over_leading(omega: Array) -> Complex:
            """F/(d s^(a + f)), which tends to 1 + L(inf)."""
            s = 1j * omega
            return np.asarray(side_at(self.bottom, s) / (d * np.exp(f * np.log(s))) * (1.0 + self.gain(omega)))

        omega = self.grid
        for _ in range(40):
            values = over_leading(omega)
            steps = np.angle(values[1:] / values[:-1])
            wide = np.flatnonzero(np.abs(steps) > 0.5)
            if not len(wide):
                break
            omega = np.insert(omega, wide + 1, np.sqrt(omega[wide] * omega[wide + 1]))
        else:
            raise UncertainError("the argument does not settle")
        last = 1.0 + (0.0 if self.plant.dead_time_s else self.direct)
        # arg F turns from F(0) to the first frequency, along the axis, and on the arc at infinity back by (a + f) pi/2
        first = np.exp((power + f) * np.log(1j * omega[0])) * values[0] * d / self._at_the_origin
        along = float(steps.sum()) - float(np.angle(values[-1] / last))
        count = (0.5 * math.pi * (power + f) - float(np.angle(first)) - along) / math.pi
        if abs(count - round(count)) > 1e-3:
            raise UncertainError(f"{count} poles")
        return round(count)


def poles_by_sector(loop: Fractional, q: int) -> int | None:
    """Zeros of s^a (Tf s + 1) (D + C N) on the right, by the roots of a polynomial in w = s^(1/q).

    Args:
        loop: without a dead time; all its orders are multiples of 1/q.
        q: of which they are.

    Returns:
        The roots with |arg w| < pi/(2 q); None when one is too close to that edge, or to 0.
    """
    kd, mu, filter_s = derivative_of(loop.gains)
    filter_s = filter_s if kd else 0.0
    alpha = loop.alpha if loop.ki else 0.0

    def in_w(side: Side) -> Array:
        powers = [round(e * q) for _, e in side]
        found = np.zeros(max(powers) + 1)
        for (c, _), power in zip(side, powers, strict=True):
            found[-1 - power] += c
        return found

    over = in_w(((filter_s, 1.0), (1.0, 0.0)) if filter_s else ((1.0, 0.0),))
    shifted = in_w(((1.0, alpha),))
    pi = np.polymul(over, in_w(((loop.kp, alpha), (loop.ki, 0.0))))
    whole = np.polyadd(pi, in_w(((kd, alpha + mu),))) if kd else pi
    total = np.polyadd(np.polymul(np.polymul(shifted, over), in_w(loop.bottom)), np.polymul(whole, in_w(loop.top)))
    total = np.trim_zeros(total, "f")
    roots = np.roots(total)
    edge = 0.5 * math.pi / q
    off = np.abs(np.abs(np.angle(roots)) - edge)
    if np.any(off < NEAR_EDGE) or np.any(np.abs(roots) < 1e-4):
        return None
    return int(np.sum(np.abs(np.angle(roots)) < edge))


@dataclass(frozen=True)
class FractionalLoop(PidLoop):
    """One loop with a fractional plant."""

    top: Side
    bottom: Side

    @cached_property
    def joined(self) -> Continuous:
        return Fractional.of(self.pid, self.top, self.bottom, self.plant.dead_time_s)

    def controller(self, omega: Array) -> Complex:
        return controller(self.pid, omega)

    def log_response(self, quantity: str, omega: Array) -> Array:
        """As of a PID; |L| may be so large that its square is beyond the range of floating-point numbers."""
        gain, c = self.joined.gain(omega), np.log(np.abs(self.controller(omega)))
        log_l, log_s = np.log(np.abs(gain)), -np.log(np.abs(1.0 + gain))
        return {
            "sensitivity_db": log_s,
            "complementary_sensitivity_db": log_l + log_s,
            "control_sensitivity_db": c + log_s,
            "loop_gain_db": log_l,
            "load_sensitivity_db": log_l - c + log_s,
        }[quantity]


@dataclass(frozen=True)
class FractionalMembers(PidFamily):
    """The members of a fractional family with one controller; the coefficients are read by their names."""

    def loop(self, point: Array) -> PidLoop:
        plants: Any = self.plants
        found = {name: n.nominal for name, n in plants.parameters.items()}
        found |= dict(zip(plants.uncertain_names, point, strict=True))
        top, bottom = (
            tuple((float(found[f"{name}[{k}].coefficient"]), order) for k, order in enumerate(orders))
            for name, orders in (("numerator", plants.numerator_orders), ("denominator", plants.denominator_orders))
        )
        return FractionalLoop(Plant((1.0,), (1.0,), float(found["dead_time_s"])), self.pid, top, bottom)
