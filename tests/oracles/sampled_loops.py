"""A second opinion on loops on samples:  state space and eigenvalues, sharing no formula with the package.

The plant's state runs through the hold by the matrix exponential, every whole sample of delay is a register, and the
measurement is taken just before the new control acts:

    x+ = Phi x + g0 u[k-d] + g1 u[k-d-1],    y = c x + d0 u[k-d-1],    e = -y .
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm
from scipy.optimize import minimize_scalar

from fopi_tune.core.parallel_form import Implementation, Sections
from fopi_tune.core.plant import Plant

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]


@dataclass(frozen=True)
class Sampled:
    """One plant behind a hold: x+ = phi x + g0 u[k-d] + g1 u[k-d-1]."""

    phi: Array
    g0: Array
    g1: Array
    c: Array
    direct: float
    whole: int
    sample_time_s: float

    def response(self, omega: Array) -> Complex:
        """y/u at e^{j omega Ts}, shape (n,)."""
        z = np.exp(1j * omega * self.sample_time_s)
        n = len(self.phi)
        inner = np.full(len(z), self.direct, dtype=complex)
        if n:
            drive = self.g0[None, :] * z[:, None] + self.g1
            inner = (
                inner + np.linalg.solve(z[:, None, None] * np.eye(n) - self.phi, drive[:, :, None])[:, :, 0] @ self.c
            )
        return np.asarray(inner * z ** -(self.whole + 1.0), dtype=complex)


def held(a: Array, b: Array, time: float) -> tuple[Array, Array]:
    """e^{At} and int_0^t e^{As} b ds, by the exponential of [[A, b], [0, 0]]."""
    n = len(a)
    block = np.zeros((n + 1, n + 1))
    block[:n, :n], block[:n, n] = a, b
    whole = np.asarray(expm(block * time), dtype=float)
    return whole[:n, :n], whole[:n, n]


def sample(plant: Plant, sample_time_s: float, delay_samples: float = 0.0) -> Sampled:
    """A plant with its dead time and the computing delay, at the samples."""
    denominator = np.array(plant.denominator) / plant.denominator[0]
    n = len(denominator) - 1
    numerator = np.concatenate([np.zeros(n + 1 - len(plant.numerator)), plant.numerator]) / plant.denominator[0]
    direct = float(numerator[0])
    c = numerator[1:] - direct * denominator[1:]
    samples = plant.dead_time_s / sample_time_s + delay_samples
    whole = math.floor(samples + 1e-12)
    part = max(samples - whole, 0.0)
    if n == 0:
        empty = np.zeros(0)
        return Sampled(np.zeros((0, 0)), empty, empty, empty, direct, whole, sample_time_s)
    a = np.zeros((n, n))
    a[0], a[1:, :-1] = -denominator[1:], np.eye(n - 1)
    b = np.eye(n)[0]
    phi, _ = held(a, b, sample_time_s)
    first, g0 = held(a, b, (1.0 - part) * sample_time_s)
    _, rest = held(a, b, part * sample_time_s)
    return Sampled(phi, g0, first @ rest, c, direct, whole, sample_time_s)


def controller(sections: Sections, omega: Array) -> Complex:
    """C(e^{j omega Ts}), shape (n,)."""
    z = np.exp(1j * omega * sections.sample_time_s)
    parts = [r / (z - p) for p, r in zip(sections.poles, sections.residues, strict=True)]
    return np.sum([np.full(len(z), sections.direct, dtype=complex), *parts], axis=0)


def closed_loop(plant: Sampled, sections: Sections) -> Array:
    """The closed loop's matrix over (x, u[k-1] ... u[k-d-1], controller)."""
    n, late, m = len(plant.phi), plant.whole + 1, len(sections.poles)
    size = n + late + m
    y = np.zeros(size)
    y[:n] = plant.c
    y[n + late - 1] += plant.direct
    u = -sections.direct * y
    u[n + late :] += sections.residues
    matrix = np.zeros((size, size))
    matrix[:n, :n] = plant.phi
    matrix[:n, n + late - 1] += plant.g1
    newest = u if plant.whole == 0 else np.eye(size)[n + plant.whole - 1]
    matrix[:n] += np.outer(plant.g0, newest)
    matrix[n] = u
    matrix[n + 1 : n + late, n : n + late - 1] = np.eye(late - 1)
    matrix[n + late :, n + late :] = np.diag(sections.poles)
    matrix[n + late :] -= y
    return matrix


def sizes(plant: Sampled, sections: Sections) -> Array:
    """|z| of every closed-loop pole."""
    return np.abs(np.linalg.eigvals(closed_loop(plant, sections)))


def scaled(sections: Sections, factor: float) -> Sections:
    """The controller times a factor."""
    residues = tuple(factor * r for r in sections.residues)
    return Sections(sections.sample_time_s, factor * sections.direct, sections.poles, residues)


# -- what a requirement is about, of one plant, by dense scans and local refinement -----------------------------------


@dataclass(frozen=True)
class Loop:
    """One sampled loop."""

    plant: Sampled
    sections: Sections

    @classmethod
    def of(cls, plant: Plant, implementation: Implementation) -> Loop:
        """A plant with a digital controller."""
        sampled = sample(plant, implementation.sample_time_s, implementation.delay_samples)
        return cls(sampled, implementation.sections)

    @property
    def nyquist(self) -> float:
        """pi/Ts."""
        return math.pi / self.sections.sample_time_s

    def gain(self, omega: Array) -> Complex:
        """L."""
        return controller(self.sections, omega) * self.plant.response(omega)

    def response(self, name: str, omega: Array) -> Array:
        """ln of |S|, |T|, |C S|, |P S| or |L|."""
        gain = self.gain(omega)
        top = {
            "sensitivity_db": np.ones_like(gain),
            "complementary_sensitivity_db": gain,
            "control_sensitivity_db": controller(self.sections, omega),
            "loop_gain_db": gain * (1.0 + gain),
            "load_sensitivity_db": self.plant.response(omega),
        }[name]
        return np.log(np.abs(top)) - np.log(np.abs(1.0 + gain))

    def grid(self, low: float = 0.0, high: float = math.inf, points: int = 500) -> Array:
        """Frequencies of a band, both ends included; from 1e-9 of Nyquist's frequency on."""
        first, last = max(low, 1e-9 * self.nyquist), min(high, self.nyquist)
        return np.unique(np.concatenate([np.geomspace(first, last, points), np.linspace(first, last, points // 2)]))

    def extreme(self, name: str, low: float, high: float, sign: float, fine: bool) -> float:
        """The largest sign * ln|R| over a band."""
        omega = self.grid(low, high)
        values = sign * self.response(name, omega)
        best = float(values.max())
        if not fine:
            return best
        peaks = [k for k in range(1, len(omega) - 1) if values[k] >= max(values[k - 1], values[k + 1])]
        for k in sorted(peaks, key=lambda k: -values[k])[:4]:
            found = minimize_scalar(
                lambda x: -sign * float(self.response(name, np.array([x]))[0]),
                bounds=(omega[k - 1], omega[k + 1]),
                method="bounded",
                options={"xatol": 1e-10 * omega[k]},
            )
            best = max(best, -float(found.fun))  # pyright: ignore[reportAttributeAccessIssue]
        return best

    def gain_crossovers(self) -> list[float]:
        """Every omega with |L| = 1 that the grid tells."""
        omega = self.grid()
        values = np.log(np.abs(self.gain(omega)))
        turns = np.flatnonzero(values[1:] * values[:-1] < 0)
        return [_root(lambda x: float(np.log(np.abs(self.gain(x)[0]))), omega[k], omega[k + 1]) for k in turns]

    def phase_crossovers(self) -> list[float]:
        """Every -L > 0 on the grid's range, Nyquist's frequency included."""
        omega = self.grid(points=1500)
        gain = self.gain(omega)
        turns = np.flatnonzero((gain.imag[1:] * gain.imag[:-1] < 0) & (gain.real[1:] < 0))

        turns = [k for k in turns if omega[k + 1] < self.nyquist]
        inner = [_root(lambda x: float(self.gain(x)[0].imag), omega[k], omega[k + 1]) for k in turns]
        values = [float(-self.gain(np.array([x]))[0].real) for x in [*inner, self.nyquist]]
        return [value for value in values if value > 0]

    def angle_from_minus_one(self, omega: float) -> float:
        """pi + arg L in (-pi, pi], rad: by lag if positive."""
        return float(np.angle(-self.gain(np.array([omega]))[0]))

    def phase_slope(self, omega: float) -> float:
        """d arg L/d ln omega, rad, by a difference of the fourth order."""
        step = 1e-3
        gain = self.gain(omega * np.exp(step * np.array([-2.0, -1.0, 0.0, 1.0, 2.0])))
        turns = np.angle(gain / gain[2])
        return float((turns[0] - 8.0 * turns[1] + 8.0 * turns[3] - turns[4]) / (12.0 * step))


def _root(function: Callable[[Array], float], low: float, high: float) -> float:
    """Bisection to the last digits."""
    sign = function(np.array([low])) > 0
    for _ in range(60):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if (function(np.array([middle])) > 0) == sign else (low, middle)
    return 0.5 * (low + high)
