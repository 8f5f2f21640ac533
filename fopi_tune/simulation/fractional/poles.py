"""Poles of the fractional closed loop without dead time on the principal sheet.

    chi(s) = D(s) + (kp + ki s^-alpha) N(s),   |arg s| < pi.                                                         (1)

With alpha near p/q, s^alpha chi is a polynomial in w = s^{1/q}, whose roots with |arg w| < pi/q start Newton's method
on chi(e^v), an entire function of v = ln s, while p/q moves to alpha.  The argument principle confirms their number:

    number = (1/pi) (change of arg chi along  +R -> R e^{j theta} -> r e^{j theta} -> +r),                           (2)

taken along the upper half of the sector's border.

Source: derived from the argument principle; the sectors of commensurate orders are Matignon's (1996).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from fractions import Fraction

import numpy as np

from fopi_tune.core.bode_form import Array, Complex
from fopi_tune.core.controller import FoPi, refuse_derivative_in, refuse_measurement_filter_in
from fopi_tune.core.plant import Plant
from fopi_tune.errors import DomainError
from fopi_tune.simulation.fractional.inversion import SECTOR_RAD

#: largest q of the fractions p/q, tried in this order
_DENOMINATORS = (8, 16, 5, 24)
_STEPS = 12
#: poles closer than this in ln s count as one
_SAME = 1e-8
#: the sector's edge is put into the widest gap up to here
_WIDEST_RAD = 0.93 * math.pi
#: the sector is counted between these multiples of the slowest and fastest corner
_REACH = 1e6
#: corners further than this from the others count as infinite
_FARTHEST = 1e30


@dataclass(frozen=True)
class Characteristic:
    """chi(s) of (1).

    Args:
        numerator: N, descending powers, leading zeros left out.
        denominator: D, descending powers.
        kp, ki, alpha: the gains as in `FoPi`.
    """

    numerator: Array
    denominator: Array
    kp: float
    ki: float
    alpha: float

    @classmethod
    def of(cls, gains: FoPi, plant: Plant) -> Characteristic:
        """chi of a loop without its dead time.

        Raises:
            DomainError: the controller has a derivative.
        """
        refuse_derivative_in(gains, "the list of a loop's poles")
        refuse_measurement_filter_in(gains, "the list of a loop's poles")
        numerator = np.trim_zeros(np.array(plant.numerator, dtype=float), "f")
        return cls(numerator, np.array(plant.denominator, dtype=float), gains.kp, gains.ki, gains.alpha)

    def value_and_derivative(self, s: Complex, power: Complex) -> tuple[Complex, Complex]:
        """chi and dchi/ds at s, with power = s^-alpha on the wanted sheet; all of one shape."""
        n, d = np.polyval(self.numerator, s), np.polyval(self.denominator, s)
        dn, dd = np.polyval(np.polyder(self.numerator), s), np.polyval(np.polyder(self.denominator), s)
        c = self.kp + self.ki * power
        return d + c * n, dd + c * dn - self.alpha * self.ki * power / s * n

    def scaled(self, unit: float) -> Characteristic:
        """The same in s/unit."""
        rise = [unit ** np.arange(len(p) - 1, -1, -1.0) for p in (self.numerator, self.denominator)]
        top = float(np.abs(self.denominator * rise[1]).max())
        return Characteristic(
            self.numerator * rise[0] / top,
            self.denominator * rise[1] / top,
            self.kp,
            self.ki * unit**-self.alpha,
            self.alpha,
        )


def principal_poles(gains: FoPi, plant: Plant) -> Complex:
    """All closed-loop poles in a sector |arg s| < theta, theta >= SECTOR_RAD, of a loop without dead time.

    Args:
        gains: the controller; the loop may be unstable.
        plant: its dead time is ignored.

    Returns:
        Shape (m,), rad/s, conjugates included; `invert_on_hyperbola` needs no poles further left.

    Raises:
        DomainError: the number found differs from (2), two poles too close to separate, or a loop that is not well
            posed (1 + kp P(inf) = 0).
    """
    chi = Characteristic.of(gains, plant)
    if len(chi.numerator) == len(chi.denominator) and chi.denominator[0] + chi.kp * chi.numerator[0] == 0.0:
        raise DomainError("1 + kp P(inf) = 0: the loop has no answer at high frequency; change kp")
    with np.errstate(all="ignore"):
        corners = _corners(chi)
        unit = float(np.median(corners))
        corners = np.clip(np.concatenate([corners, _balances(chi)]), unit / _FARTHEST, unit * _FARTHEST)
        scaled = chi.scaled(unit)
        reach = (math.log(corners.min() / unit / _REACH), math.log(corners.max() / unit * _REACH))
        found = np.zeros(0, dtype=complex)
        for q in _DENOMINATORS:
            found = _distinct(np.concatenate([found, _refined(scaled, _seeds(scaled, q), q)]))
            theta = _edge(found)
            inside = found[np.abs(found.imag) < theta]
            low = min(reach[0], float(inside.real.min(initial=0.0)) - 1.0)
            high = max(reach[1], float(inside.real.max(initial=0.0)) + 1.0)
            if _count(scaled, theta, low, high) == len(inside):
                return np.asarray(unit * np.exp(inside), dtype=complex)
    raise DomainError(
        f"the closed loop's poles cannot be told apart for {gains}; two of them almost coincide: change a gain a little"
    )


def _fraction(alpha: float, most: int) -> tuple[int, int]:
    fraction = Fraction(alpha).limit_denominator(most)
    return fraction.numerator, fraction.denominator


def _seeds(chi: Characteristic, most: int) -> Complex:
    """ln s of the roots of s^{p/q} D + (kp s^{p/q} + ki) N, |arg s| < 1.2 pi."""
    p, q = _fraction(chi.alpha, most)
    width = p + (len(chi.denominator) - 1) * q + 1
    total = np.zeros(width)
    for coefficients, gain, shift in (
        (chi.denominator, 1.0, p),
        (chi.numerator, chi.kp, p),
        (chi.numerator, chi.ki, 0),
    ):
        degree = len(coefficients) - 1
        for k, coefficient in enumerate(coefficients):
            total[width - 1 - shift - (degree - k) * q] += gain * coefficient
    roots = np.asarray(np.roots(total), dtype=complex)
    log = np.asarray(q * np.log(roots[roots != 0.0]), dtype=complex)
    return log[np.isfinite(log) & (np.abs(np.imag(log)) < 1.2 * math.pi)]


def _refined(chi: Characteristic, v: Complex, most: int) -> Complex:
    """Newton's method in v = ln s while p/q moves to alpha; what does not converge is dropped."""
    p, q = _fraction(chi.alpha, most)
    change = np.full(len(v), np.inf)
    for step in range(1, _STEPS + 1):
        alpha = p / q + (chi.alpha - p / q) * step / _STEPS
        now = Characteristic(chi.numerator, chi.denominator, chi.kp, chi.ki, alpha)
        for _ in range(4 if step < _STEPS else 30):
            s = np.exp(v)
            value, derivative = now.value_and_derivative(s, np.exp(-alpha * v))
            move = value / (derivative * s)
            change = np.abs(move)
            v = v - move / np.maximum(1.0, change / 0.3)
    return v[np.isfinite(v) & (change < 1e-10) & (np.abs(v.imag) <= math.pi)]


def _distinct(v: Complex) -> Complex:
    """Distinct values with their conjugates; nearly real ones are made real."""
    height = np.where(np.abs(v.imag) < _SAME, 0.0, np.abs(v.imag))
    upper = v.real + 1j * height
    kept: list[complex] = []
    for candidate in upper:
        if all(abs(candidate - other) > _SAME for other in kept):
            kept.append(complex(candidate))
    return np.array(kept + [k.conjugate() for k in kept if k.imag != 0.0], dtype=complex)


def _edge(v: Complex) -> float:
    """Middle of the widest gap between the poles' angles, within the range that the inversion allows."""
    angles = np.abs(v.imag)
    inside = np.sort(angles[(angles > SECTOR_RAD) & (angles < _WIDEST_RAD)])
    borders = np.concatenate([[SECTOR_RAD], inside, [_WIDEST_RAD]])
    widest = int(np.argmax(np.diff(borders)))
    return float(0.5 * (borders[widest] + borders[widest + 1]))


def _corners(chi: Characteristic) -> Array:
    """Corner frequencies, rad/s: roots of the plant, and where the two largest terms of chi balance."""
    found = [np.abs(np.roots(p)) for p in (chi.numerator, chi.denominator)]
    found.append(np.exp(_seeds(chi, 3).real))
    corners = np.concatenate(found)
    corners = corners[np.isfinite(corners) & (corners > 0.0)]
    return corners if len(corners) else np.ones(1)


def _balances(chi: Characteristic) -> Array:
    """Where ki s^-alpha N balances D + kp N at low and at high frequency, rad/s; far away when alpha is small."""
    found = []
    for end in (0, -1):
        n, d = chi.numerator[end], chi.denominator[end]
        ratio = abs(chi.ki * n / (d + chi.kp * n)) if d + chi.kp * n != 0.0 else 0.0
        if 0.0 < ratio < math.inf:
            found.append(math.exp(min(max(math.log(ratio) / chi.alpha, -300.0), 300.0)))
    return np.array(found)


def _count(chi: Characteristic, theta: float, low: float, high: float) -> int:
    """Poles with |arg s| < theta and low < ln|s| < high by (2); -1 where the border passes too close to one."""
    arc = np.linspace(0.0, theta, 400)
    ray = np.linspace(high, low, max(2, math.ceil((high - low) / 0.01)))
    path = np.concatenate([high + 1j * arc, (ray + 1j * theta)[1:-1], low + 1j * arc[::-1]])
    total = 0.0
    for _ in range(12):
        value, _unused = chi.value_and_derivative(np.exp(path), np.exp(-chi.alpha * path))
        turn = np.angle(value[1:] / value[:-1])
        if not np.all(np.isfinite(turn)):
            return -1
        total = float(turn.sum()) / math.pi
        wild = np.flatnonzero(np.abs(turn) > 0.7)
        if len(wild) == 0:
            break
        path = np.insert(path, wild + 1, 0.5 * (path[wild] + path[wild + 1]))
    else:
        return -1
    return round(total) if abs(total - round(total)) < 1e-3 else -1
