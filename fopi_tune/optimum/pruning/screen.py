"""Screening of boxes:  which can be discarded by which sample, many at once, in floating point.

The formulas are those of `optimum.parametrization` and `optimum.pruning.response_bounds` for arrays.  The results are
suggestions, not proofs: each is tested in ball arithmetic, and a box that fails the test is split.

A sample's ratio is the violation of its condition at a box's centre over its variation in the box.  Above 1 the box can
be discarded.  The sample with the largest ratio also gives the axis to split.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from flint import acb, arb
from numpy.typing import NDArray

from fopi_tune.core.bode_form import Array, Complex
from fopi_tune.core.controller import FoPi, Pid
from fopi_tune.core.loops import Loops, Plants
from fopi_tune.core.peaks import Response
from fopi_tune.core.sampled_loops import SampledLoops
from fopi_tune.core.terms.derivatives import Derivatives
from fopi_tune.core.terms.measurement_filter import MeasurementFilter
from fopi_tune.digital.implementation import designed_implementation
from fopi_tune.optimum.crossover_gains import CrossoverParametrization
from fopi_tune.optimum.derivative_gains import DerivativeParametrization
from fopi_tune.optimum.parametrization import GainParametrization, Parametrization
from fopi_tune.optimum.problem import Problem
from fopi_tune.optimum.pruning.conditions import Test
from fopi_tune.optimum.pruning.exclusion import Reason
from fopi_tune.optimum.pruning.response_bounds import quadratic
from fopi_tune.optimum.samples.gains import SampledCrossoverParametrization, SampledGainParametrization

_TINY = 1e-300


@dataclass(frozen=True)
class Boxes:
    """n boxes of coordinates.

    Args:
        low: shape (n, k).
        high: shape (n, k).
    """

    low: Array
    high: Array

    @property
    def middle(self) -> Array:
        """Centres, shape (n, k)."""
        return self.low + 0.5 * (self.high - self.low)

    @property
    def half(self) -> Array:
        """Half-widths, shape (n, k)."""
        return 0.5 * (self.high - self.low)

    def take(self, rows: NDArray[np.intp] | NDArray[np.bool_]) -> Boxes:
        """Some of them."""
        return Boxes(self.low[rows], self.high[rows])

    def __len__(self) -> int:
        return len(self.low)


@dataclass(frozen=True)
class TaylorModels:
    """Taylor models of C over n boxes at m frequencies: value (n, m), k slopes (n, m), remainder (n, m)."""

    value: Complex
    slopes: list[Complex]
    remainder: Array


def taylor_models(parametrization: Parametrization, boxes: Boxes, log_s: Complex) -> TaylorModels:
    """Taylor models of C over n boxes at ln s, of shape (m,) for all boxes or (n, m)."""
    log_s = np.atleast_2d(log_s)
    if isinstance(parametrization, SampledCrossoverParametrization):
        return _on_circle_of_samples(parametrization, boxes, log_s)
    if isinstance(parametrization, CrossoverParametrization):
        return _on_circle(parametrization, boxes, log_s)
    if isinstance(parametrization, DerivativeParametrization):
        return _linear(parametrization, boxes, log_s)
    if isinstance(parametrization, SampledGainParametrization):
        return _on_samples(parametrization, boxes, log_s)
    assert isinstance(parametrization, GainParametrization)
    exponent = log_s - math.log(parametrization.omega_rad_s)
    kp, z, alpha = (column[:, None] for column in boxes.middle.T)
    _, wide_z, wide_alpha = (column[:, None] for column in boxes.half.T)
    rho = np.exp(-alpha * exponent)
    x = np.minimum(np.abs(exponent) * wide_alpha, 300.0)
    integral = z * rho
    with np.errstate(over="ignore"):
        remainder = np.abs(rho) * x * np.exp(x) * (wide_z + 0.5 * np.abs(z) * x)
    return TaylorModels(kp + integral, [np.ones_like(rho), rho, -exponent * integral], remainder)


def _on_samples(parametrization: SampledGainParametrization, boxes: Boxes, log_s: Complex) -> TaylorModels:
    """(1) of `fopi_tune.optimum.samples.gains`."""
    kp, z, alpha = (column[:, None] for column in boxes.middle.T)
    _, wide_z, wide_alpha = (column[:, None] for column in boxes.half.T)
    log_unit = math.log(parametrization.omega_rad_s)
    value, slope, bend = parametrization.filter.in_floats(np.exp(log_s) + 0.0 * alpha, alpha)
    value, slope = value * np.exp(alpha * log_unit), slope + log_unit
    rest = 0.5 * np.abs(bend) * wide_alpha**2
    x = np.minimum(np.abs(slope) * wide_alpha + rest, 300.0)
    grown = x * np.exp(x)
    remainder = np.abs(value) * (wide_z * grown + np.abs(z) * (0.5 * x * grown + rest))
    return TaylorModels(kp + z * value, [np.ones_like(value), value, z * value * slope], remainder)


def _linear(parametrization: DerivativeParametrization, boxes: Boxes, log_s: Complex) -> TaylorModels:
    kp, ki, kd = (column[:, None] for column in boxes.middle.T)
    rho = np.exp(-log_s)
    d = 1.0 / (rho + parametrization.filter_time_s)
    value = kp + ki * rho + kd * d
    ones = np.ones_like(value)
    return TaylorModels(value, [ones, rho * ones, d * ones], np.zeros(value.shape))


def _on_circle(parametrization: CrossoverParametrization, boxes: Boxes, log_s: Complex) -> TaylorModels:
    alpha = boxes.middle.T[0][:, None]
    tau, k = log_s - math.log(parametrization.omega_rad_s), 0.5 * np.pi
    sine, cosine, e = np.sin(k * alpha), np.cos(k * alpha), np.exp(-alpha * tau)
    h = (cosine - e) / sine
    first = (-k / sine + tau * e + k * e * cosine / sine) / sine
    second = 2 * k * k * cosine / sine**2 - tau * tau * e - 2 * k * tau * e * cosine / sine
    second = (second - k * k * e * (1 + cosine * cosine) / sine**2) / sine
    return _models_on_circle(parametrization, boxes, h, first, second)


def _models_on_circle(
    parametrization: CrossoverParametrization, boxes: Boxes, h: Complex, first: Complex, second: Complex
) -> TaylorModels:
    """Of Re x + Im x h(alpha), from h and its derivatives in alpha."""
    wide_alpha, wide_psi = (column[:, None] for column in boxes.half.T)
    x = -np.exp(1j * boxes.middle[:, 1:]) / complex(parametrization.plant)
    remainder = np.abs(x) * wide_psi * (0.5 * wide_psi * (1 + np.abs(h)) + np.abs(first) * wide_alpha)
    remainder = remainder + np.abs(x.imag) * np.abs(second) * wide_alpha**2 / 2
    return TaylorModels(x.real + x.imag * h, [x.imag * first, -x.imag + x.real * h], remainder)


def _on_circle_of_samples(
    parametrization: SampledCrossoverParametrization, boxes: Boxes, log_s: Complex
) -> TaylorModels:
    """(2) of `fopi_tune.optimum.samples.gains`."""
    alpha = boxes.middle.T[0][:, None]
    at, at1, at2 = _with_derivatives(parametrization, 1j * float(parametrization.nu.mid()) + 0.0 * alpha, alpha)
    value, first, second = _with_derivatives(parametrization, np.exp(log_s) + 0.0 * alpha, alpha)
    h = (value - at.real) / at.imag
    h1 = (first - at1.real - h * at1.imag) / at.imag
    h2 = (second - at2.real - 2.0 * h1 * at1.imag - h * at2.imag) / at.imag
    return _models_on_circle(parametrization, boxes, h, h1, h2)


def _with_derivatives(
    parametrization: SampledCrossoverParametrization, w: Complex, alpha: Array
) -> tuple[Complex, Complex, Complex]:
    """F with its first and second derivatives in alpha."""
    value, slope, bend = parametrization.filter.in_floats(w, alpha)
    return value, value * slope, value * (slope * slope + bend)


@dataclass(frozen=True)
class Gains:
    """n controllers.

    Args:
        kp, ki, alpha: shape (n,).
        derivatives: those of the same controllers; None without.
    """

    kp: Array
    ki: Array
    alpha: Array
    derivatives: Derivatives | None = None

    def named(self, name: str) -> Array:
        """kp, ki or kd."""
        if name == "kd":
            assert self.derivatives is not None
            return self.derivatives.kd
        return self.kp if name == "kp" else self.ki

    @property
    def is_zero(self) -> NDArray[np.bool_]:
        """Whether C = 0, shape (n,)."""
        rest = True if self.derivatives is None else self.derivatives.kd == 0.0
        return np.asarray((self.kp == 0.0) & (self.ki == 0.0) & rest)

    def loops(self, problem: Problem, points: Array) -> Loops:
        """Each with every plant, a point of shape (p,) each: row = controller * plants + plant.

        On samples there is one controller, and its filter is that of the exported code.
        """
        if problem.is_on_samples:
            controller, plants = self.controller(problem.measurement_filter), Plants.members(problem.family, points)
            implementation = designed_implementation(problem.spec, controller)
            assert implementation is not None
            assert len(self.kp) == 1
            return SampledLoops.implemented(controller, implementation, plants)
        n, m, family = len(self.kp), len(points), problem.family
        rows, plants = np.repeat(np.arange(n), m), Plants.members(family, points).take(np.tile(np.arange(m), n))
        derivatives = None if self.derivatives is None else self.derivatives.take(rows)
        return Loops(
            self.kp[rows], self.ki[rows], self.alpha[rows], plants, derivatives=derivatives,
            measurement_filter=problem.measurement_filter,
        )  # fmt: skip

    def controller(self, used: MeasurementFilter | None = None) -> FoPi:
        """The first, with a measurement filter."""
        kp, ki, alpha = (float(gain[0]) for gain in (self.kp, self.ki, self.alpha))
        if self.derivatives is None:
            return FoPi(kp, ki, alpha, measurement_filter=used)
        kd, filter_s = float(self.derivatives.kd[0]), float(self.derivatives.filter_s[0])
        return Pid(kp, ki, kd, filter_s, measurement_filter=used)


def gains_at(parametrization: Parametrization, coordinates: Array) -> Gains:
    """The controllers at n points of the coordinates."""
    if isinstance(parametrization, DerivativeParametrization):
        kp, ki, kd = coordinates.T
        ones = np.ones_like(kp)
        return Gains(kp, ki, ones, Derivatives(kd, ones, parametrization.filter_time_s * ones))
    if isinstance(parametrization, GainParametrization):
        kp, z, alpha = coordinates.T
        return Gains(kp, z * parametrization.omega_rad_s**alpha, alpha)
    assert isinstance(parametrization, CrossoverParametrization)
    alpha, psi = coordinates.T
    x = -np.exp(1j * psi) / complex(parametrization.plant)
    if isinstance(parametrization, SampledCrossoverParametrization):
        at = parametrization.filter.in_floats(1j * float(parametrization.nu.mid()) + 0.0 * alpha, alpha)[0]
        return Gains(x.real - x.imag * at.real / at.imag, x.imag / at.imag, alpha)
    a = 0.5 * np.pi * alpha
    return Gains(x.real + x.imag / np.tan(a), -x.imag * parametrization.omega_rad_s**alpha / np.sin(a), alpha)


@dataclass(frozen=True)
class LinearBounds:
    """Linear lower bounds of m violations over n boxes, as `fopi_tune.optimum.pruning.response_bounds` has them.

    Args:
        middle: shape (n, m).
        slopes: times the half-widths, shape (n, m, k).
    """

    middle: Array
    slopes: Array


@dataclass(frozen=True)
class ScreeningResult:
    """Result of screening n boxes.

    Args:
        ratio: the largest ratio of each box.
        reason: index of its sample.
        axis: along which its condition varies most.
        bounds: of all samples.
    """

    ratio: Array
    reason: NDArray[np.intp]
    axis: NDArray[np.intp]
    bounds: LinearBounds


@dataclass(frozen=True)
class ScreeningSamples:
    """Reasons that name one frequency of one plant, as arrays of shape (m,)."""

    reasons: tuple[Reason, ...]
    log_s: Complex
    a: Array
    b: Complex
    c: Array

    @classmethod
    def of(cls, problem: Problem, reasons: tuple[Reason, ...]) -> ScreeningSamples:
        """With the levels of this problem."""
        rows = [_coefficients(problem, reason) for reason in reasons]
        table = np.array(rows, dtype=complex).reshape(len(rows), 4)
        return cls(reasons, table[:, 0], np.real(table[:, 1]), table[:, 2], np.real(table[:, 3]))

    @cached_property
    def _concave(self) -> Array:
        return np.maximum(-self.a, 0.0)

    def screen(self, parametrization: Parametrization, boxes: Boxes) -> ScreeningResult:
        """The largest ratio of every box."""
        n, k = boxes.low.shape
        if not self.reasons:
            none = np.full(n, -1)
            empty = LinearBounds(np.empty((n, 0)), np.empty((n, 0, k)))
            return ScreeningResult(np.full(n, -np.inf), none, none, empty)
        at, half = taylor_models(parametrization, boxes, self.log_s), boxes.half
        a, b, c, concave = self.a, self.b, self.c, self._concave
        with np.errstate(all="ignore"):
            w = a * at.value.conj() + b
            q = a * np.abs(at.value) ** 2 + 2.0 * np.real(b * at.value) + c
            slopes = np.stack([2.0 * np.real(w * s) * half[:, k, None] for k, s in enumerate(at.slopes)], axis=2)
            parts = np.abs(slopes)
            reach = sum(np.abs(s) * half[:, k, None] for k, s in enumerate(at.slopes)) + at.remainder
            rest = 2.0 * np.abs(w) * at.remainder + concave * reach**2
            ratio = q / (parts.sum(axis=2) + rest + _TINY)
        ratio = np.where(np.isfinite(ratio), ratio, -np.inf)
        best = np.argmax(ratio, axis=1)
        every = np.arange(n)
        axis = np.argmax(parts[every, best], axis=1)
        return ScreeningResult(ratio[every, best], best, axis, LinearBounds(q - rest, slopes))


def _coefficients(problem: Problem, reason: Reason) -> tuple[complex, complex, complex, complex]:
    condition = problem.conditions.every[reason.condition]
    if condition.test is Test.DISTURBANCE:
        log_s, p = problem.real_response(reason.point, condition.horizon_s)
        a, b, c = quadratic(Response.SENSITIVITY, p, problem.squared_error_limit(condition, p), True)
    elif condition.test is Test.GAIN_SPREAD:
        log_s, p = problem.response(problem.nominal, reason.omega[0])
        a, b, c = quadratic(Response.LOOP_GAIN, p, arb(1), True)
    else:
        assert condition.response is not None
        log_s, p = problem.response(reason.point, reason.omega[0])
        a, b, c = quadratic(condition.response, p, problem.squared_limit(condition, reason.omega[0]), condition.upper)
    return _complex(log_s), _complex(acb(a)), _complex(b), _complex(acb(c))


def _complex(ball: acb) -> complex:
    return complex(float(arb(ball.real).mid()), float(arb(ball.imag).mid()))
