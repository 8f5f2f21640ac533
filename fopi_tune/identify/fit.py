"""A lag with dead time fitted to a step response by least squares, each number with its interval.

After a step of the input by du at the time t0 the model's output is

    y(t) = y0 + K du (1 - exp(-(t - t0 - L)/tau))   for t > t0 + L,   y0 before

with four unknowns: y0, the static gain K, the time constant tau and the dead time L.  The sum of squares has several
local minima in L.  So the initial guesses come from a grid of (tau, L), on which y0 and K follow in closed form.

The time of the step is known only to lie in the gap between two lines: the last with the old input and the first with
the new one.  The fit takes t0 at the latter.  If the step came earlier by d, the dead time is longer by d, while K and
tau are unchanged.  So the upper end of the interval of L is raised by the gap, and a fitted L may be negative by up to
the gap.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from typing import Any

import numpy as np

from fopi_tune.core.bode_form import Array
from fopi_tune.errors import DomainError
from fopi_tune.identify.recording import Recording, pluralized

#: of the intervals
CONFIDENCE = 0.95
#: at most this many samples are used in the grid search; the fit uses all
_MAX_SEARCH_SAMPLES = 1500
#: fewest samples within three time constants after the dead time that determine the time constant
_MIN_RISE_SAMPLES = 3
#: residuals with a larger lag-one correlation are not independent noise
_MAX_CORRELATION = 0.5
#: residuals below this share of the output's change are rounding errors and are not tested for correlation
_ROUNDING_SHARE = 1e-6
#: dead times below this share of the record's length are rounding errors
_ZERO_DEAD_TIME = 1e-9


@dataclass(frozen=True)
class Interval:
    """A fitted number and the interval of 95 % (`CONFIDENCE`) around it, low <= value <= high.

    Args:
        value: the fitted one, in the number's unit.
        low: lower end, in the number's unit.
        high: upper end, in the number's unit.
    """

    value: float
    low: float
    high: float


@dataclass(frozen=True)
class LagFit:
    """A fitted lag.

    Args:
        name: the recording's.
        static_gain: output unit per input unit.
        time_constant_s: s, > 0.
        dead_time_s: s, >= 0; the value is that of a step at the first line with the new input, the upper end that of a
            step at the line before.
        residual_std: standard deviation of the residuals, in the output's unit.
        notes: warnings about the numbers, a sentence each.
    """

    name: str
    static_gain: Interval
    time_constant_s: Interval
    dead_time_s: Interval
    residual_std: float
    notes: tuple[str, ...]


def fit_lag(recording: Recording) -> LagFit:
    """Static gain, time constant and dead time of a step response.

    Each interval is value +- t sqrt(s^2 c).  Here s^2 is the variance of the residuals, c the number's diagonal entry
    of (J'J)^-1 with the Jacobian J at the fit, and t the quantile of Student's distribution with n - 4 degrees of
    freedom for n samples.  The intervals hold for independent noise of constant variance on a plant that is a lag;
    correlated residuals give a note.  The upper end of the dead time is raised by the gap between the last line with
    the old input and the first with the new one, because the step may lie anywhere between.  A fitted dead time below 0
    becomes 0.  If it is below 0 by more than the gap, it is fixed at minus the gap and the other numbers are fitted
    again.

    Raises:
        DomainError: the recording cannot tell the numbers; the message says which and what to record instead.
    """
    try:
        return _fit(recording)
    except DomainError as error:
        raise DomainError(f"{recording.name}: {error}") from None


def _fit(recording: Recording) -> LagFit:
    scaled = _ScaledRecording.of(recording)
    free = _least_squares(scaled, _initial_guesses(scaled), None)
    _check_rise(scaled, free)
    value, half = _interval_half_widths(scaled, free, None)
    # upper end of the dead time: that of the free fit, for a step at the last line with the old input
    upper = float(value[3] + half[3]) + scaled.gap
    notes: list[str] = []
    if value[3] < -scaled.gap - _ZERO_DEAD_TIME:
        if value[3] < -scaled.gap - _ROUNDING_SHARE:
            below = f"{scaled.length_s * value[3]:.3g} s, below 0"
            notes.append(f"the fit's dead time is {below} by more than the time between two lines; 0 is taken")
        if upper < -_ROUNDING_SHARE:
            notes.append("the output moves before the input does: compare the time of both columns")
        free = _least_squares(scaled, [free], -scaled.gap)
        value, half = _interval_half_widths(scaled, free, -scaled.gap)
    _check_intervals(scaled, value, half)
    upper = upper if upper > _ZERO_DEAD_TIME else 0.0
    residuals = scaled.output - _response(scaled.time, value)
    notes += _residual_notes(residuals, float(value[1]))
    return _result(recording, scaled, (value, half, upper), residuals, notes)


def _result(
    recording: Recording,
    scaled: _ScaledRecording,
    found: tuple[Array, Array, float],
    residuals: Array,
    notes: list[str],
) -> LagFit:
    """The fit in the recording's units; `upper` is the upper end of the dead time, scaled."""
    value, half, upper = found
    gain, tau, dead = (Interval(v, v - h, v + h) for v, h in zip(value[1:].tolist(), half[1:].tolist(), strict=True))
    gain_unit = scaled.height / recording.step
    low, high = sorted((gain.low * gain_unit, gain.high * gain_unit))
    seconds = scaled.length_s
    return LagFit(
        recording.name,
        Interval(gain.value * gain_unit, low, high),
        Interval(tau.value * seconds, tau.low * seconds, tau.high * seconds),
        Interval(*(max(0.0, end) * seconds for end in (dead.value, dead.low, max(upper, dead.value)))),
        float(np.sqrt(residuals @ residuals / (len(residuals) - 4))) * scaled.height,
        tuple(notes),
    )


# -- the problem in scaled units -------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class _ScaledRecording:
    """A recording in scaled units: time from the step over the record's length after it, output over its range."""

    time: Array
    output: Array
    length_s: float
    height: float
    #: scaled time between the last sample with the old input and the first with the new one
    gap: float

    @staticmethod
    def of(recording: Recording) -> _ScaledRecording:
        height = float(np.ptp(recording.output))
        if height == 0.0:
            raise DomainError(
                f"column 'output' does not move, it is {recording.output[0]:g} on every line; record a larger step, or "
                "until the output follows"
            )
        after = len(recording.time_s) - recording.first
        if after < 6:
            raise DomainError(
                f"has {pluralized(after, 'sample')} from the step on; record at least 6, and until the output settles"
            )
        length_s = float(recording.time_s[-1]) - recording.step_at_s
        time = (recording.time_s - recording.step_at_s) / length_s
        return _ScaledRecording(
            time, (recording.output - recording.output[0]) / height, length_s, height, recording.gap_s / length_s
        )


def _unit_response(time: Array, tau: Any, dead: Any) -> Array:
    # 1 - exp(-(t - L)/tau) for t > L, 0 before
    return -np.expm1(-np.maximum(time - dead, 0.0) / tau)


def _response(time: Array, parameters: Array) -> Array:
    y0, gain, tau, dead = parameters
    return y0 + gain * _unit_response(time, tau, dead)


def _jacobian(time: Array, parameters: Array) -> Array:
    """Derivatives of the response with respect to (y0, gain, tau, dead), shape (n, 4)."""
    _, gain, tau, dead = parameters
    late = np.maximum(time - dead, 0.0)
    left = np.exp(-late / tau)
    by_tau = -gain * late * left / tau**2
    by_dead = np.where(time > dead, -gain * left / tau, 0.0)
    return np.column_stack([np.ones_like(time), 1.0 - left, by_tau, by_dead])


# -- the fit -----------------------------------------------------------------------------------------------------------


def _initial_guesses(scaled: _ScaledRecording) -> list[Array]:
    """The best points of a grid of (tau, dead), and the curve through 28 % and 63 % of the output's change."""
    rows = np.unique(np.linspace(0, len(scaled.time) - 1, min(_MAX_SEARCH_SAMPLES, len(scaled.time))).astype(int))
    time, output = scaled.time[rows], scaled.output[rows]
    finest = float(np.diff(scaled.time).min())
    taus = np.geomspace(max(finest / 3, 1e-5), 10.0, 24)
    found: list[tuple[float, Array]] = []
    for dead in np.linspace(max(float(time[0]), -0.1), 0.95, 48):
        shape = _unit_response(time[:, None], taus, dead)
        centred, level = shape - shape.mean(axis=0), output - output.mean()
        power = np.maximum((centred**2).sum(axis=0), 1e-300)
        # for centred output y and unit response h the best gain leaves the sum of squares  |y|^2 - (h'y)^2/|h|^2
        gains = (centred * level[:, None]).sum(axis=0) / power
        left = level @ level - gains**2 * power
        best = int(np.argmin(left))
        y0 = output.mean() - gains[best] * shape[:, best].mean()
        found.append((float(left[best]), np.array([y0, gains[best], taus[best], dead])))
    found.sort(key=lambda pair: pair[0])
    return [place for _, place in found[:2]] + _through_two_points(scaled)


def _through_two_points(scaled: _ScaledRecording) -> list[Array]:
    # 1 - e^{-1/3} = 0.283 and 1 - e^{-1} = 0.632:  tau = 1.5 (t63 - t28), L = t63 - tau
    before, after = scaled.output[scaled.time < 0], scaled.output[scaled.time >= 0]
    time = scaled.time[scaled.time >= 0]
    y0, end = float(np.median(before)), float(np.median(after[-max(3, len(after) // 10) :]))
    if end == y0:
        return []
    way = (after - y0) / (end - y0)
    t28, t63 = float(time[np.argmax(way > 0.283)]), float(time[np.argmax(way > 0.632)])
    tau = max(1.5 * (t63 - t28), 0.5 * float(np.diff(time).min()))
    return [np.array([y0, end - y0, tau, max(t63 - tau, 0.0)])]


def _least_squares(scaled: _ScaledRecording, starts: list[Array], dead: float | None) -> Array:
    """The least-squares solution from several initial guesses; `dead` fixes the dead time."""
    if dead is not None:
        return min((_solve_from(scaled, start, (dead, dead)) for start in starts), key=lambda found: found[0])[1]
    anywhere = (float(scaled.time[0]), 1.0)
    rough = min((_solve_from(scaled, start, anywhere, 1e-4) for start in starts), key=lambda found: found[0])
    found = [rough]
    # The sum of squares has a kink where the dead time passes a sample, and a solver may stop there.  So the intervals
    # between neighbouring samples are searched one by one.  With many samples a single kink does not matter.
    if len(scaled.time) <= _MAX_SEARCH_SAMPLES:
        at = int(np.searchsorted(scaled.time, rough[1][3]))
        edges = scaled.time[max(at - 2, 0) : at + 2].tolist()
        found += [_solve_from(scaled, rough[1], gap, 1e-7) for gap in itertools.pairwise(edges)]
    best = min(found, key=lambda pair: pair[0])
    return min(best, _solve_from(scaled, best[1], anywhere), key=lambda pair: pair[0])[1]


def _solve_from(
    scaled: _ScaledRecording, start: Array, dead: tuple[float, float], tolerance: float = 1e-12
) -> tuple[float, Array]:
    """Half the least sum of squares from one guess with the dead time in a range, and the parameters there."""
    from scipy.optimize import least_squares

    kept = 4 if dead[0] < dead[1] else 3
    fixed = np.array(dead[:1])[: 4 - kept]
    low = np.array([-np.inf, -np.inf, 1e-7, dead[0]])[:kept]
    high = np.array([np.inf, np.inf, 1e3, dead[1]])[:kept]
    inside = 1e-3 * np.minimum(1e-4, high - low)

    def full(p: Array) -> Array:
        return np.concatenate([p, fixed])

    solution: Any = least_squares(
        lambda p: _response(scaled.time, full(p)) - scaled.output,
        np.clip(start[:kept], low + inside, high - inside),
        jac=lambda p: _jacobian(scaled.time, full(p))[:, :kept],  # pyright: ignore[reportArgumentType]
        bounds=(low, high),
        x_scale="jac",
        ftol=tolerance,
        xtol=tolerance,
        gtol=tolerance,
        max_nfev=300,
    )
    return float(solution.cost), full(solution.x)


def _interval_half_widths(scaled: _ScaledRecording, value: Array, dead: float | None) -> tuple[Array, Array]:
    """The parameters, and half the widths of their intervals; 0 for a fixed dead time."""
    from scipy.stats import t as student

    kept = 4 if dead is None else 3
    jacobian = _jacobian(scaled.time, value)[:, :kept]
    residuals = scaled.output - _response(scaled.time, value)
    degrees_of_freedom = len(residuals) - kept
    sizes = np.sqrt((jacobian**2).sum(axis=0))
    if sizes.min() == 0.0 or np.linalg.cond(jacobian / sizes) > 1e8:
        raise DomainError(
            "cannot tell gain, time constant and dead time apart; record more samples while the output rises, and "
            "until it settles"
        )
    # (J'J)^-1 from the QR factors of J with unit columns
    inverse = np.linalg.inv(np.linalg.qr(jacobian / sizes, mode="r"))
    variance = (inverse**2).sum(axis=1) / sizes**2 * (residuals @ residuals / degrees_of_freedom)
    half = float(student.ppf(0.5 + CONFIDENCE / 2, degrees_of_freedom)) * np.sqrt(variance)
    return value, np.concatenate([half, np.zeros(4 - kept)])


# -- recordings that do not suffice ----------------------------------------------------------------------------------


def _check_rise(scaled: _ScaledRecording, value: Array) -> None:
    _, _, tau, dead = value.tolist()
    seconds = scaled.length_s
    if tau + dead > 1.0:
        # a ramp: the response depends only on the ratio of gain and time constant
        longer = f"about {tau * seconds:.3g} s" if tau < 100 else "far longer"
        raise DomainError(
            f"the time constant ({longer}) with the dead time is longer than the record after the step "
            f"({seconds:.3g} s): record at least three time constants"
        )
    on_rise = int(np.count_nonzero((scaled.time > dead) & (scaled.time < dead + 3 * tau)))
    if on_rise < _MIN_RISE_SAMPLES:
        raise DomainError(
            f"only {pluralized(on_rise, 'sample')} {'lies' if on_rise == 1 else 'lie'} on the rise, which takes about "
            f"{3 * tau * seconds:.3g} s: too few to tell "
            "the time constant; sample faster"
        )


def _check_intervals(scaled: _ScaledRecording, value: Array, half: Array) -> None:
    if half[1] >= abs(value[1]):
        raise DomainError(
            "the output does not move beyond its noise: the static gain may be 0; record a larger step or less noise"
        )
    if half[2] >= value[2]:
        told, around = value[2] * scaled.length_s, half[2] * scaled.length_s
        raise DomainError(
            f"the time constant is {told:.3g} +- {around:.3g} s, which may be 0; record more samples on the rise, or a "
            "larger step"
        )


def _residual_notes(residuals: Array, gain: float) -> list[str]:
    power = float(residuals @ residuals)
    if power <= len(residuals) * (_ROUNDING_SHARE * gain) ** 2:
        return []
    correlation = float(residuals[1:] @ residuals[:-1]) / power
    if correlation <= _MAX_CORRELATION:
        return []
    return [
        f"what the curve leaves is no independent noise (correlation {correlation:.2f} from one sample to the next): "
        "the plant is not quite a lag, or is disturbed, and the intervals are too narrow; widen them"
    ]
