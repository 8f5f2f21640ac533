"""Exact responses in time of the linear fractional loop:  FoPi, Plant, times -> array.

C(s) = kp + ki s^-alpha, P = N/D e^{-Ls}, P0 = N/D, L0 = C P0, chi = D + C N e^{-Ls}, stimulus s^-j (j = 1 a step):

    output after a reference   C N e^{-Ls}/(chi s^j),      control after it   C D/(chi s^j),                         (1)
    output after a load at the plant's input   N e^{-Ls}/(chi s^j).

Without dead time the transform is inverted on a hyperbola, with the poles of the principal sheet subtracted.  With dead
time there are two methods, whose ranges overlap:

    steps: 1/(1 + L0 e^{-Ls}) = sum_k (-L0)^k e^{-kLs}, exact with the terms k <= t/L, each free of delay;           (2)
    a bent line, for t >> L and a stable loop: no pole lies where |L0 e^{-Ls}| < 1, and there the line may go left
    as long as |s|^{-r} e^{-L Re s}, r the relative degree of L0, stays small; with a direct path, as long as
    |L0(inf)| e^{-L Re s} does, which is useful once the jumps, of size |L0(inf)|^{t/L}, have decayed.               (3)

Source: derived from the loop's equations; (2) is a geometric series.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from fopi_tune.core.bode_form import Array, Complex
from fopi_tune.core.controller import FoPi, refuse_derivative_in, refuse_measurement_filter_in
from fopi_tune.core.loops import Loops, Plants
from fopi_tune.core.plant import Plant
from fopi_tune.core.stability import is_stable
from fopi_tune.errors import DomainError
from fopi_tune.simulation.fractional.inversion import (
    InversionResult,
    LineBounds,
    Transform,
    bent_line,
    checked_times,
    corner_frequency,
    invert_on_bent_line,
    invert_on_hyperbola,
)
from fopi_tune.simulation.fractional.plant_sides import PlantSides, PowerSides, sides_of
from fopi_tune.simulation.fractional.poles import Characteristic, principal_poles

#: largest tolerance that may be asked for, relative to the response's size
WORST_TOLERANCE = 1e-6
#: up to this many dead times by (2), beyond it by (3)
_STEPS_FIRST = 6.0
#: most terms of (2), where (3) does not apply
_MOST_STEPS = 200
#: share of the relative degree by which e^{-Ls} may grow along the line in (3)
_SPENT = 0.8
#: bounds of |L0 e^{-Ls}| on the line left of the axis, and on the axis from where the line goes left, if L0(inf) = 0
_SMALL, _SMALL_ON_AXIS = 0.9, 0.5
#: rounding of one inversion, of its largest intermediate
_ROUNDING = 1e-14


class Signal(Enum):
    """A response of the loop: which signal, after which input."""

    OUTPUT_AFTER_REFERENCE = "output after a reference"
    CONTROL_AFTER_REFERENCE = "control after a reference"
    OUTPUT_AFTER_LOAD = "output after a load at the plant's input"


class Stimulus(Enum):
    """The stimulus s^-j: a unit step, or a ramp of 1 per second."""

    STEP = 1
    RAMP = 2


def exact_response(
    gains: FoPi, plant: Plant, signal: Signal, times_s: object, stimulus: Stimulus = Stimulus.STEP,
    tolerance: float = 1e-8,
) -> Array:  # fmt: skip
    """The linear loop's response, as exact as `tolerance` says.

    Args:
        gains: the controller.
        plant: the plant, dead time included; it and the controller are at rest before t = 0.
        signal: which response.
        times_s: shape (n,), s, >= 0, in any order; at a jump the value just after it is given.
        stimulus: unit step, or ramp of 1 per second.
        tolerance: largest error, as estimated from two contours, relative to the response's largest value at the
            requested times; at most 1e-6.

    Returns:
        Shape (n,), the output's or the control's unit, per unit of the reference or of the load.

    Raises:
        DomainError: invalid times; a tolerance outside (0, 1e-6]; a loop that is not well posed; an unstable
            loop with dead time later than a few dead times; the tolerance cannot be met.
    """
    if not 0.0 < tolerance <= WORST_TOLERANCE:
        raise DomainError(f"tolerance = {tolerance!r} lies outside (0, {WORST_TOLERANCE}]")
    times = checked_times(times_s)
    loop = LoopTransform(gains, plant, signal, stimulus)
    answer = response_and_error(gains, plant, signal, times, stimulus)
    size = float(np.abs(answer.value).max(initial=0.0))
    failed = ~(answer.error <= tolerance * size)
    if np.any(failed):
        at, error = times[failed][0], answer.error[failed][0]
        why = "" if plant.dead_time_s == 0.0 or loop.stable else "the loop is unstable; "
        raise DomainError(
            f"{why}the {signal.value} at t = {at:g} s has an error of {error:.1g} on a scale of {size:.3g}; "
            f"ask for times nearer to 0, or for a larger tolerance (up to {WORST_TOLERANCE})"
        )
    return answer.value


def response_and_error(
    gains: FoPi, plant: Plant, signal: Signal, times_s: object, stimulus: Stimulus = Stimulus.STEP
) -> InversionResult:
    """The same with the error estimate of every value, however large: inf where no method applies.

    Args:
        gains, plant, signal, times_s, stimulus: as in `exact_response`.

    Returns:
        Values and absolute errors, shape (n,) each.

    Raises:
        DomainError: invalid times, or a loop that is not well posed.
    """
    times = checked_times(times_s)
    loop = LoopTransform(gains, plant, signal, stimulus)
    method = _without_dead_time if plant.dead_time_s == 0.0 else _with_dead_time
    value, error = np.full_like(times, loop.initial_value), np.zeros_like(times)
    later = times > 0.0
    if np.any(later):
        answer = method(loop, times[later])
        value[later], error[later] = answer.value, answer.error
    return InversionResult(value, error)


@dataclass(frozen=True)
class LoopTransform:
    """One of the transforms (1).

    Args:
        gains, plant, signal, stimulus: as in `exact_response`.

    Raises:
        DomainError: no controller, one with a derivative, or a loop that is not well posed.
    """

    gains: FoPi
    plant: Plant
    signal: Signal
    stimulus: Stimulus

    def __post_init__(self) -> None:
        refuse_derivative_in(self.gains, "an exact response in continuous time")
        refuse_measurement_filter_in(self.gains, "an exact response in continuous time")
        if self.gains.kp == 0.0 == self.gains.ki:
            raise DomainError("kp = ki = 0: there is no controller, so there is no loop; give one of them a value")
        if self.plant.dead_time_s == 0.0 and 1.0 + self.gains.kp * self.direct == 0.0:
            raise DomainError("1 + kp P(inf) = 0: the loop has no answer at high frequency; change kp")

    @cached_property
    def sides(self) -> PlantSides:
        """N and D."""
        return sides_of(self.plant)

    @property
    def direct(self) -> float:
        """P0(inf)."""
        return self.sides.direct

    @property
    def degree(self) -> float:
        """r: L0 falls as |s|^-r."""
        return self.sides.falls + (self.gains.alpha if self.gains.kp == 0.0 else 0.0)

    @property
    def stable(self) -> bool:
        """Whether the closed loop is stable."""
        return bool(is_stable(Loops.of(self.gains, Plants.of(self.plant)))[0])

    @property
    def initial_value(self) -> float:
        """The response just after t = 0, by the initial-value theorem."""
        if self.stimulus is Stimulus.RAMP:
            return 0.0
        delayed = self.plant.dead_time_s > 0.0
        start = self.first_at_infinity
        if self.signal is not Signal.CONTROL_AFTER_REFERENCE and delayed:
            return 0.0
        return start if delayed else start / (1.0 + self.gains.kp * self.direct)

    @property
    def first_at_infinity(self) -> float:
        """H(inf), H the factor of (1) before 1/(1 + L0 e^{-Ls}), free of delay."""
        match self.signal:
            case Signal.OUTPUT_AFTER_REFERENCE:
                return self.gains.kp * self.direct
            case Signal.CONTROL_AFTER_REFERENCE:
                return self.gains.kp
            case Signal.OUTPUT_AFTER_LOAD:
                return self.direct

    @property
    def first_delay(self) -> int:
        """1 where H comes with e^{-Ls}, else 0."""
        return 0 if self.signal is Signal.CONTROL_AFTER_REFERENCE else 1

    def parts(self, s: Complex) -> tuple[Complex, Complex, Complex, Complex]:
        """s^alpha, s^alpha C, N and D; with them neither s -> 0 nor alpha -> 2 overflows."""
        power = s**self.gains.alpha
        n, d = self.sides.at(s)
        return power, self.gains.kp * power + self.gains.ki, n, d

    def transform(self, s: Complex) -> Complex:
        """(1)."""
        power, c, n, d = self.parts(s)
        delayed = n * np.exp(-self.plant.dead_time_s * s)
        match self.signal:
            case Signal.OUTPUT_AFTER_REFERENCE:
                above = c * delayed
            case Signal.CONTROL_AFTER_REFERENCE:
                above = c * d
            case Signal.OUTPUT_AFTER_LOAD:
                above = power * delayed
        return above / (power * d + c * delayed) / s**self.stimulus.value

    def term(self, k: int) -> Transform:
        """H (-L0)^k/s^j."""

        def transform(s: Complex) -> Complex:
            power, c, n, d = self.parts(s)
            controller, plant = c / power, n / d
            match self.signal:
                case Signal.OUTPUT_AFTER_REFERENCE:
                    first = controller * plant
                case Signal.CONTROL_AFTER_REFERENCE:
                    first = controller
                case Signal.OUTPUT_AFTER_LOAD:
                    first = plant
            return first * (-controller * plant) ** k / s**self.stimulus.value

        return transform


def _without_dead_time(loop: LoopTransform, times: Array) -> InversionResult:
    sides, gains = loop.sides, loop.gains
    if isinstance(sides, PowerSides):
        # the poles of such a loop have no list: the line passes to the right of all
        radius = sides.farthest_closed_loop_pole_rad_s(gains.kp, gains.ki, gains.alpha)
        return invert_on_bent_line(loop.transform, times, LineBounds(0.0 if loop.stable else radius, radius))
    poles = principal_poles(loop.gains, loop.plant)
    with np.errstate(all="ignore"):
        power, c, n, d = loop.parts(poles)
        match loop.signal:
            case Signal.OUTPUT_AFTER_REFERENCE:
                above = c / power * n
            case Signal.CONTROL_AFTER_REFERENCE:
                above = c / power * d
            case Signal.OUTPUT_AFTER_LOAD:
                above = n
        _, slope = Characteristic.of(loop.gains, loop.plant).value_and_derivative(poles, 1.0 / power)
        return invert_on_hyperbola(loop.transform, times, poles, above / (slope * poles**loop.stimulus.value))


def _with_dead_time(loop: LoopTransform, times: Array) -> InversionResult:
    value, error = np.zeros_like(times), np.full_like(times, np.inf)
    dead_time = loop.plant.dead_time_s

    def improve(rows: NDArray[np.intp], method: Callable[[LoopTransform, Array], InversionResult]) -> None:
        if len(rows):
            answer = method(loop, times[rows])
            better = answer.error < error[rows]
            value[rows] = np.where(better, answer.value, value[rows])
            error[rows] = np.where(better, answer.error, error[rows])

    late = times > _STEPS_FIRST * dead_time
    improve(np.flatnonzero(late), response_on_bent_line)
    size = float(np.abs(value).max(initial=0.0))
    missing = ~late | ~(error <= 1e-10 * size)
    improve(np.flatnonzero(missing & (times <= _MOST_STEPS * dead_time)), response_by_steps)
    return InversionResult(value, error)


def response_by_steps(loop: LoopTransform, times: Array) -> InversionResult:
    """The method of steps (2), exact but for cancellation, which the error estimate includes.

    Args:
        loop: gains, plant, signal and stimulus.
        times: shape (n,), s, > 0.

    Returns:
        Values and absolute errors, shape (n,) each.
    """
    value, error = np.zeros_like(times), np.zeros_like(times)
    dead_time = loop.plant.dead_time_s
    last = math.floor(float(times.max(initial=0.0)) / dead_time)
    with np.errstate(all="ignore"):
        for k in range(last - loop.first_delay + 1):
            since = times - (k + loop.first_delay) * dead_time
            if loop.stimulus is Stimulus.STEP:
                value[since == 0.0] += loop.first_at_infinity * (-loop.gains.kp * loop.direct) ** k
            rows = np.flatnonzero(since > 0.0)
            if len(rows):
                term = _open_response(loop, k, since[rows])
                value[rows] += term.value
                error[rows] += term.error + _ROUNDING * np.abs(term.value)
    return InversionResult(value, error)


def _open_response(loop: LoopTransform, k: int, times: Array) -> InversionResult:
    """Term k of (2): its only poles are the plant's, which are multiple."""
    order = math.floor(k * loop.degree)
    farthest = loop.sides.farthest_pole_rad_s
    if farthest == 0.0:
        return invert_on_hyperbola(loop.term(k), times, order=order)
    bounds = LineBounds(loop.sides.rightmost_pole_rad_s, 1.5 * farthest)
    return invert_on_bent_line(loop.term(k), times, bounds)


def response_on_bent_line(loop: LoopTransform, times: Array) -> InversionResult:
    """The bent line (3); infinite errors where it does not apply: an unstable loop, jumps that have not decayed.

    Args:
        loop: gains, plant, signal and stimulus.
        times: shape (n,), s, > 0; times up to a few dead times need too many nodes.

    Returns:
        Values and absolute errors, shape (n,) each.
    """
    if not loop.stable:
        return InversionResult(np.zeros_like(times), np.full_like(times, np.inf))
    value, error = np.zeros_like(times), np.full_like(times, np.inf)
    octave = np.floor(np.log2(times))
    for exponent in np.unique(octave):
        rows = np.flatnonzero(octave == exponent)
        bounds = _line_bounds(loop, float(times[rows].max()))
        if bounds is not None:
            answer = invert_on_bent_line(loop.transform, times[rows], bounds)
            value[rows], error[rows] = answer.value, answer.error
    return InversionResult(value, error)


def _loop_gain(loop: LoopTransform, s: Complex) -> Array:
    power, c, n, d = loop.parts(s)
    return np.abs(c / power * n / d) * np.exp(-loop.plant.dead_time_s * s.real)


def _line_bounds(loop: LoopTransform, horizon: float) -> LineBounds | None:
    """A line with |L0 e^{-Ls}| < 1 between it and the axis, by the maximum principle; None if none is found."""
    corners = np.concatenate([loop.sides.corners_rad_s, [1.0 / loop.plant.dead_time_s, 1.0 / horizon]])
    corners = corners[corners > 0.0]
    omega = np.geomspace(corners.min() * 1e-6, corners.max() * 1e8, 6000)
    rest = abs(loop.gains.kp * loop.direct)
    # e^{-Ls} may grow by |L0(inf)|^-0.8 in all, or by omega^(0.8 r)
    power = _SPENT * (loop.degree if rest == 0.0 else -math.log(rest))
    small, on_axis = max(_SMALL, 0.5 + 0.5 * rest**0.2), max(_SMALL_ON_AXIS, 0.5 + 0.5 * rest)
    with np.errstate(all="ignore"):
        loud = np.flatnonzero(~(_loop_gain(loop, 1j * omega) < on_axis))
        if len(loud) and loud[-1] + 1 == len(omega):
            return None
        start = max(float(omega[loud[-1] + 1]) if len(loud) else 0.0, loop.sides.farthest_pole_rad_s)
        for _ in range(40):
            bounds = LineBounds(0.0, start, loop.plant.dead_time_s, power, rest > 0.0)
            s, _slope = bent_line(corner_frequency(horizon, bounds) * np.geomspace(1e-2, 1e10, 4000), horizon, bounds)
            if np.all(_loop_gain(loop, s)[s.real < 0.0] < small):
                return bounds
            start = max(1.5 * start, 1.0 / horizon)
    return None
