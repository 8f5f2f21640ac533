"""A lag with dead time fitted to a step response by least squares, each number with its interval.

After a step of the input by du at the time t0 the model's output is

    y(t) = y0 + K du (1 - exp(-(t - t0 - L)/tau))   for t > t0 + L,   y0 before

with four unknowns: y0, the static gain K, the time constant tau and the dead time L.  The sum of squares has several
minima in L: a search over a grid of (tau, L), in which y0 and K follow in closed form, gives the starts.

The recording shows the step only between two lines, the last with the old input and the first with the new one.  The
fit takes t0 at the latter; a step that came by up to that gap earlier has a dead time longer by as much, and leaves K
and tau as they are.  So the interval of L reaches further up by the gap, and the fitted L may lie below 0 by the gap.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from typing import Any

import numpy as np

from fopi_tune.core.logform import Array
from fopi_tune.errors import DomainError
from fopi_tune.identify.recording import Recording, pluralized

#: of the intervals
CONFIDENCE = 0.95
#: samples that the search looks at; the fit looks at all
_SEARCHED = 1500
#: samples on the curve's bend, up to three time constants after the dead time, without which it cannot be told
_ON_BEND = 3
#: correlation of one residual with the next beyond which they are no independent noise
_CORRELATED = 0.5
#: residuals below this share of the output's change are rounding, in which any shape may be found
_ROUNDING = 1e-6
#: shares of the record's length that are no dead time, but rounding
_NO_TIME = 1e-9


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
        residual_std: standard deviation of what the curve leaves, in the output's unit.
        notes: what is to be known before the numbers are trusted, a sentence each.
    """

    name: str
    static_gain: Interval
    time_constant_s: Interval
    dead_time_s: Interval
    residual_std: float
    notes: tuple[str, ...]


def fit_lag(recording: Recording) -> LagFit:
    """Static gain, time constant and dead time of a step response.

    The intervals are value +- t s, with s from the covariance s^2 (J'J)^-1 at the fit and t the quantile of Student's
    distribution with n - 4 degrees of freedom.  They hold for independent noise of equal size on a plant that is a lag;
    residuals that say otherwise are noted.  The dead time's upper end is further up by the time between the last line
    with the old input and the first with the new one, as the step may have come anywhere between.  A fitted dead time
    below 0 becomes 0; where even a step at the last old line does not explain it, that one is taken and the others are
    fitted again.

    Raises:
        DomainError: the recording cannot tell the numbers; the message says which and what to record instead.
    """
    try:
        return _fit(recording)
    except DomainError as error:
        raise DomainError(f"{recording.name}: {error}") from None


def _fit(recording: Recording) -> LagFit:
    scaled = _Scaled.of(recording)
    free = _refined(scaled, _starts(scaled), None)
    _check_bend(scaled, free)
    value, half = _spread(scaled, free, None)
    # the upper end of the dead time, of a step at the last line with the old input, is what the free fit says
    reach = float(value[3] + half[3]) + scaled.gap
    notes: list[str] = []
    if value[3] < -scaled.gap - _NO_TIME:
        if value[3] < -scaled.gap - _ROUNDING:
            below = f"{scaled.length_s * value[3]:.3g} s, below 0"
            notes.append(f"the fit's dead time is {below} by more than the time between two lines; 0 is taken")
        if reach < -_ROUNDING:
            notes.append("the output moves before the input does: compare the time of both columns")
        free = _refined(scaled, [free], -scaled.gap)
        value, half = _spread(scaled, free, -scaled.gap)
    _check_intervals(scaled, value, half)
    reach = reach if reach > _NO_TIME else 0.0
    residuals = scaled.output - _response(scaled.time, value)
    notes += _notes(residuals, float(value[1]))
    return _result(recording, scaled, (value, half, reach), residuals, notes)


def _result(
    recording: Recording, scaled: _Scaled, found: tuple[Array, Array, float], residuals: Array, notes: list[str]
) -> LagFit:
    """The fit in the recording's units; `reach` is the upper end of the dead time."""
    value, half, reach = found
    gain, tau, dead = (Interval(v, v - h, v + h) for v, h in zip(value[1:].tolist(), half[1:].tolist(), strict=True))
    gain_unit = scaled.height / recording.step
    low, high = sorted((gain.low * gain_unit, gain.high * gain_unit))
    seconds = scaled.length_s
    return LagFit(
        recording.name,
        Interval(gain.value * gain_unit, low, high),
        Interval(tau.value * seconds, tau.low * seconds, tau.high * seconds),
        Interval(*(max(0.0, end) * seconds for end in (dead.value, dead.low, max(reach, dead.value)))),
        float(np.sqrt(residuals @ residuals / (len(residuals) - 4))) * scaled.height,
        tuple(notes),
    )


# -- the problem in units of its own -----------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class _Scaled:
    """A recording in units of its own: time from the step in lengths of what follows it, output in its range."""

    time: Array
    output: Array
    length_s: float
    height: float
    #: from the last sample of the old input to the first of the new one, in which the step came
    gap: float

    @staticmethod
    def of(recording: Recording) -> _Scaled:
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
        return _Scaled(
            time, (recording.output - recording.output[0]) / height, length_s, height, recording.gap_s / length_s
        )


def _shape(time: Array, tau: Any, dead: Any) -> Array:
    # 1 - exp(-(t - L)/tau) for t > L, 0 before
    return -np.expm1(-np.maximum(time - dead, 0.0) / tau)


def _response(time: Array, parameters: Array) -> Array:
    y0, gain, tau, dead = parameters
    return y0 + gain * _shape(time, tau, dead)


def _slopes(time: Array, parameters: Array) -> Array:
    """Derivatives by (y0, gain, tau, dead), shape (n, 4)."""
    _, gain, tau, dead = parameters
    late = np.maximum(time - dead, 0.0)
    left = np.exp(-late / tau)
    by_tau = -gain * late * left / tau**2
    by_dead = np.where(time > dead, -gain * left / tau, 0.0)
    return np.column_stack([np.ones_like(time), 1.0 - left, by_tau, by_dead])


# -- the fit -----------------------------------------------------------------------------------------------------------


def _starts(scaled: _Scaled) -> list[Array]:
    """The best places of a grid of (tau, dead), and those of curves through 28 % and 63 % of the way."""
    rows = np.unique(np.linspace(0, len(scaled.time) - 1, min(_SEARCHED, len(scaled.time))).astype(int))
    time, output = scaled.time[rows], scaled.output[rows]
    finest = float(np.diff(scaled.time).min())
    taus = np.geomspace(max(finest / 3, 1e-5), 10.0, 24)
    found: list[tuple[float, Array]] = []
    for dead in np.linspace(max(float(time[0]), -0.1), 0.95, 48):
        shape = _shape(time[:, None], taus, dead)
        centred, level = shape - shape.mean(axis=0), output - output.mean()
        power = np.maximum((centred**2).sum(axis=0), 1e-300)
        # the best gain for a given shape leaves  |y|^2 - (h'y)^2/|h|^2
        gains = (centred * level[:, None]).sum(axis=0) / power
        left = level @ level - gains**2 * power
        best = int(np.argmin(left))
        y0 = output.mean() - gains[best] * shape[:, best].mean()
        found.append((float(left[best]), np.array([y0, gains[best], taus[best], dead])))
    found.sort(key=lambda pair: pair[0])
    return [place for _, place in found[:2]] + _through_two_points(scaled)


def _through_two_points(scaled: _Scaled) -> list[Array]:
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


def _refined(scaled: _Scaled, starts: list[Array], dead: float | None) -> Array:
    """The least squares from several starts; `dead` fixes the dead time."""
    if dead is not None:
        return min((_solved(scaled, start, (dead, dead)) for start in starts), key=lambda found: found[0])[1]
    anywhere = (float(scaled.time[0]), 1.0)
    rough = min((_solved(scaled, start, anywhere, 1e-4) for start in starts), key=lambda found: found[0])
    found = [rough]
    # Where the dead time passes a sample the sum of squares has a kink, at which a solver may stop: the gaps between
    # samples around it are searched one by one.  Among many samples one kink is nothing.
    if len(scaled.time) <= _SEARCHED:
        at = int(np.searchsorted(scaled.time, rough[1][3]))
        edges = scaled.time[max(at - 2, 0) : at + 2].tolist()
        found += [_solved(scaled, rough[1], gap, 1e-7) for gap in itertools.pairwise(edges)]
    best = min(found, key=lambda pair: pair[0])
    return min(best, _solved(scaled, best[1], anywhere), key=lambda pair: pair[0])[1]


def _solved(scaled: _Scaled, start: Array, dead: tuple[float, float], tolerance: float = 1e-12) -> tuple[float, Array]:
    """Half the least sum of squares from one start with the dead time in a range, and where it is."""
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
        jac=lambda p: _slopes(scaled.time, full(p))[:, :kept],  # pyright: ignore[reportArgumentType]
        bounds=(low, high),
        x_scale="jac",
        ftol=tolerance,
        xtol=tolerance,
        gtol=tolerance,
        max_nfev=300,
    )
    return float(solution.cost), full(solution.x)


def _spread(scaled: _Scaled, value: Array, dead: float | None) -> tuple[Array, Array]:
    """The numbers, and half the widths of their intervals; 0 for what was fixed."""
    from scipy.stats import t as student

    kept = 4 if dead is None else 3
    slopes = _slopes(scaled.time, value)[:, :kept]
    residuals = scaled.output - _response(scaled.time, value)
    freedom = len(residuals) - kept
    sizes = np.sqrt((slopes**2).sum(axis=0))
    if sizes.min() == 0.0 or np.linalg.cond(slopes / sizes) > 1e8:
        raise DomainError(
            "cannot tell gain, time constant and dead time apart; record more samples while the output rises, and "
            "until it settles"
        )
    # (J'J)^-1 from the QR factors of J with unit columns
    inverse = np.linalg.inv(np.linalg.qr(slopes / sizes, mode="r"))
    variance = (inverse**2).sum(axis=1) / sizes**2 * (residuals @ residuals / freedom)
    half = float(student.ppf(0.5 + CONFIDENCE / 2, freedom)) * np.sqrt(variance)
    return value, np.concatenate([half, np.zeros(4 - kept)])


# -- what a recording cannot tell --------------------------------------------------------------------------------------


def _check_bend(scaled: _Scaled, value: Array) -> None:
    _, _, tau, dead = value.tolist()
    seconds = scaled.length_s
    if tau + dead > 1.0:
        # a ramp or worse: gain and time constant only appear as their ratio
        longer = f"about {tau * seconds:.3g} s" if tau < 100 else "far longer"
        raise DomainError(
            f"the time constant ({longer}) with the dead time is longer than the record after the step "
            f"({seconds:.3g} s): record at least three time constants"
        )
    bend = int(np.count_nonzero((scaled.time > dead) & (scaled.time < dead + 3 * tau)))
    if bend < _ON_BEND:
        raise DomainError(
            f"only {pluralized(bend, 'sample')} {'lies' if bend == 1 else 'lie'} on the rise, which takes about "
            f"{3 * tau * seconds:.3g} s: too few to tell "
            "the time constant; sample faster"
        )


def _check_intervals(scaled: _Scaled, value: Array, half: Array) -> None:
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


def _notes(residuals: Array, gain: float) -> list[str]:
    power = float(residuals @ residuals)
    if power <= len(residuals) * (_ROUNDING * gain) ** 2:
        return []
    correlation = float(residuals[1:] @ residuals[:-1]) / power
    if correlation <= _CORRELATED:
        return []
    return [
        f"what the curve leaves is no independent noise (correlation {correlation:.2f} from one sample to the next): "
        "the plant is not quite a lag, or is disturbed, and the intervals are too narrow; widen them"
    ]
