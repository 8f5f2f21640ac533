"""The controller's arithmetic on the target, in NumPy:  the same operations and roundings as the exported C.

    e = setpoint - measurement
    v = direct e + x_0 + x_1 + ...                          from left to right
    u = v within the limits, and within D of the last output
    d = g (u - v)
    x_k <- p_k (x_k + w_k d) + r_k e                                                                               (1)

D = output_rate_per_s Ts, infinite without a limit of the rate.  As the last output is within the limits, so is u, in
floating point too: where u - u_last > D, the sum u_last + D does not round beyond u.  The last output is that of the
last sample, what was tracked, or where `reset` started.

At a sample with any number that is not finite, output and states are held.

Anti-windup is back-calculation by weights that sum to 1.  While the output is limited, w_k = r_k/sum r_j (over p_j > 0)
makes the correction take from each section what a constant error adds to it: no section winds up, not even a slow one.
While the rate is limited it does the same: v stays near what the actuator can follow.
g = min(1, |sum r_j/direct|) lets the output leave a limit as the error changes sign.  With g = 1, a sample of noise
beyond the limit would change the integrator by all of its excess, and the output would settle off the setpoint.

Since (1) always feeds back u, the states obey, limited in value or rate or not,

    x <- P (I - g w 1') x + g P w (u - direct e) + r e,       P = diag(p_k) ,                                      (2)

and stay bounded with u and e when P (I - g w 1') is stable.  For w >= 0 it always is: over the sections with w_k > 0
and in the inner product sum x_k y_k/w_k the matrix w 1' is the orthogonal projection on w, so that I - g w 1' does not
expand for g in (0, 1]; nor does P, and what P leaves as it is, a multiple of the integrator's axis, is not orthogonal
to w and is shortened by the other.  (A rank-one update: the eigenvalues lie between neighbouring poles, and one in
[0, p_min].)  Residues of both signs, alpha > 1, give weights of both signs: they are used when the eigenvalues are
inside, and |r_k| in place of r_k if not.

While another controller or a driver has the actuator (`track`), the other sections decay and the integrator holds the
difference to the applied output u,

    x_k <- p_k x_k  (k > 0),        x_0 = u - (direct e + x_1 + x_2 + ...) ,                                        (3)

so that the next output with the same error is u, and stays u while the error is 0: errors during tracking are not
integrated.

A section that decays would end as a subnormal number and stay one, and some processors are slow with those.  With F =
`Precision.flush_below`, after a sample at rest, |e| < F, and after one of tracking,

    x_k <- 0 where |x_k| < F .                                                                                       (4)

An error of F or more is always integrated.  A smaller one with r e < F is lost on an integrator at 0, where 10^23
samples of it would make the last place of an output of 1 in float32 (F is 1e-31; 1e-292 in float64); on one that holds
`Precision.absorbs_flushed` rounding loses it anyway.

Source: back-calculation as in Astrom and Hagglund, Advanced PID Control, 2006; weights and (2) derived here.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace
from enum import StrEnum
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from fopi_tune.core.bode_form import Array
from fopi_tune.core.parallel_form import Sections
from fopi_tune.digital.realise import Precision, parallel_rows
from fopi_tune.errors import DomainError

#: least distance of eigenvalues from the unit circle for weights of both signs; above the rounding of `eigvals`
_INSIDE = 1e-9


@dataclass(frozen=True)
class Runtime:
    """A controller with the coefficients that its target stores; each is representable in `precision`.

    Args:
        precision: of coefficients, states and arithmetic.
        direct: the path without memory.
        poles: the integrator's, exactly 1, comes first.
        residues: of the same length.
        weights: w_k of the anti-windup; they sum to 1 up to rounding; all 0 when no section takes a correction.
        tracking_gain: g, in [0, 1].
        limits: of the output, lower first.
        most_change: D, by which the output changes at most from sample to sample; inf: any change.
    """

    precision: Precision
    direct: float
    poles: tuple[float, ...]
    residues: tuple[float, ...]
    weights: tuple[float, ...]
    tracking_gain: float
    limits: tuple[float, float]
    most_change: float = math.inf

    @classmethod
    def of(
        cls, sections: Sections, precision: Precision, limits: tuple[float, float] | None = None,
        rate_per_s: float | None = None,
    ) -> Runtime:  # fmt: skip
        """Round a controller to a precision, once.

        Args:
            sections: the controller.
            precision: of the target.
            limits: of the output, lower first; infinite, or None for both, where there is none.
            rate_per_s: fastest change of the output, per s; None where there is no limit.

        Raises:
            DomainError: the limits are empty, the rate is not greater than 0 or lost to rounding, a coefficient is
                beyond the precision's range, or a rounded pole is not inside the unit circle.
        """
        if sections.has_derivative:
            raise DomainError("simulation and C are not available for structure: pid in this version; leave them out")
        within = _limits(limits, precision)
        change = _most_change(rate_per_s, sections.sample_time_s, within, precision)
        with np.errstate(over="ignore", under="ignore"):
            rows = parallel_rows(sections, precision).astype(np.float64)
        direct, poles, residues = float(rows[0, 1]), rows[1:, 0], rows[1:, 1]
        _check_coefficients(sections, rows, precision)
        weights, gain = _anti_windup(direct, poles, residues, precision)
        return cls(precision, direct, _floats(poles), _floats(residues), _floats(weights), gain, within, change)

    @property
    def has_integrator(self) -> bool:
        """Whether the first section is an integrator; `reset` starts it at the output."""
        return bool(self.poles) and self.poles[0] == 1.0

    @property
    def limits_rate(self) -> bool:
        """Whether the output's change from sample to sample is limited."""
        return math.isfinite(self.most_change)

    @cached_property
    def stored(self) -> StoredCoefficients:
        """The same numbers in the type of the precision."""
        dtype = self.precision.dtype
        direct, gain, low, high = (dtype(number) for number in (self.direct, self.tracking_gain, *self.limits))
        poles, residues, weights = (np.array(row, dtype=dtype) for row in (self.poles, self.residues, self.weights))
        largest, flush_below = np.finfo(dtype).max, dtype(self.precision.flush_below)
        change = dtype(self.most_change)
        return StoredCoefficients(direct, poles, residues, weights, gain, low, high, change, largest, flush_below)


@dataclass(frozen=True, eq=False)
class StoredCoefficients:
    """A runtime's numbers as NumPy's scalars and arrays of its precision."""

    direct: np.floating
    poles: NDArray[np.floating]
    residues: NDArray[np.floating]
    weights: NDArray[np.floating]
    tracking_gain: np.floating
    low: np.floating
    high: np.floating
    most_change: np.floating
    largest: np.floating
    flush_below: np.floating

    def finite(self, value: np.floating) -> bool:
        """By comparison, as on the target, which has no isfinite."""
        return bool(-self.largest <= value <= self.largest)

    def limited(self, value: np.floating) -> np.floating:
        """The value within the limits."""
        if value < self.low:
            return self.low
        return self.high if value > self.high else value

    def followed(self, value: np.floating, last: np.floating) -> np.floating:
        """What the output comes to on its way from the last one to a value within the limits."""
        change = value - last
        if change > self.most_change:
            return last + self.most_change
        return last - self.most_change if change < -self.most_change else value


@dataclass(frozen=True, eq=False)
class State:
    """What the controller remembers.

    Args:
        x: shape (n,), of the precision's type, a section's state each.
        output: the last output, of the precision's type.
    """

    x: NDArray[np.floating]
    output: np.floating


class Op(StrEnum):
    """What a caller can do; the value is the word in a table of operations."""

    INIT = "init"
    STEP = "step"
    TRACK = "track"
    RESET = "reset"


@dataclass(frozen=True)
class Operation:
    """A call of the controller.

    Args:
        op: which one.
        setpoint: of step and track.
        measurement: of step and track.
        output: what was applied, of track; where to start, of reset.
    """

    op: Op
    setpoint: float = 0.0
    measurement: float = 0.0
    output: float = 0.0


def init(runtime: Runtime) -> State:
    """The state to start from: output 0, or the limit next to it."""
    return reset(runtime, 0.0)


@np.errstate(all="ignore")
def reset(runtime: Runtime, output: float) -> State:
    """The state of a controller that has rested at an output with no error.

    Args:
        runtime: the controller.
        output: taken within the limits; 0 in place of one that is not finite.
    """
    numbers, dtype = runtime.stored, runtime.precision.dtype
    wanted = dtype(output)
    start = numbers.limited(wanted if numbers.finite(wanted) else dtype(0.0))
    x = np.zeros(len(runtime.poles), dtype=dtype)
    if runtime.has_integrator:
        x[0] = start
    return State(x, start)


def step(runtime: Runtime, state: State, setpoint: float, measurement: float) -> State:
    """One sample; `output` of what is returned goes to the actuator."""
    return _one_sample(runtime, state, setpoint, measurement, None)


def track(runtime: Runtime, state: State, setpoint: float, measurement: float, applied: float) -> State:
    """One sample in which the actuator had another output than this controller's.

    Args:
        runtime: the controller.
        state: before the sample.
        setpoint: as for `step`.
        measurement: as for `step`.
        applied: what the actuator had; taken within the limits.
    """
    return _one_sample(runtime, state, setpoint, measurement, applied)


def follow_from(runtime: Runtime, state: State, output: np.floating) -> State:
    """The state whose next output is reached from one that another controller had, cut to the limits.

    Args:
        runtime: with a limit of the rate.
        state: of which the sections' states stay.
        output: of the other controller, in the precision.
    """
    return replace(state, output=runtime.stored.limited(output))


def replay(runtime: Runtime, operations: Iterable[Operation]) -> Array:
    """The output after each operation, from a fresh `init`; shape (n,)."""
    state, outputs = init(runtime), []
    for operation in operations:
        if operation.op is Op.STEP:
            state = step(runtime, state, operation.setpoint, operation.measurement)
        elif operation.op is Op.TRACK:
            state = track(runtime, state, operation.setpoint, operation.measurement, operation.output)
        else:
            state = init(runtime) if operation.op is Op.INIT else reset(runtime, operation.output)
        outputs.append(float(state.output))
    return np.array(outputs)


@np.errstate(all="ignore")
def _one_sample(runtime: Runtime, state: State, setpoint: float, measurement: float, applied: float | None) -> State:
    """(1) or (3), and (4); the state itself when a number is not finite."""
    c, dtype = runtime.stored, runtime.precision.dtype
    e = dtype(setpoint) - dtype(measurement)
    v = c.direct * e
    for x in state.x:
        v = v + x
    if not (c.finite(e) and c.finite(v)):
        return state
    if applied is None:
        u = c.followed(c.limited(v), state.output)
        d = c.tracking_gain * (u - v)
        following = c.poles * (state.x + c.weights * d) + c.residues * e
    else:
        if not c.finite(dtype(applied)):
            return state
        u = c.limited(dtype(applied))
        following = c.poles * state.x
        if runtime.has_integrator:
            rest = c.direct * e
            for x in following[1:]:
                rest = rest + x
            following[0] = u - rest
    if not np.all(np.isfinite(following)):
        return state
    if applied is not None or abs(e) < c.flush_below:
        following[np.abs(following) < c.flush_below] = 0.0
    return State(following, u)


def _floats(values: Array) -> tuple[float, ...]:
    return tuple(float(value) for value in values)


def _limits(limits: tuple[float, float] | None, precision: Precision) -> tuple[float, float]:
    """The limits in a precision, rounded inwards: never wider than the given ones."""
    low, high = limits if limits is not None else (-np.inf, np.inf)
    what = f"output limits ({low!r}, {high!r})"
    if not low < high:
        raise DomainError(f"{what} are empty; the lower one must be smaller than the upper one")
    dtype = precision.dtype
    with np.errstate(over="ignore"):
        lower, upper = dtype(low), dtype(high)
    if float(lower) < low or lower == -np.inf:
        lower = np.nextafter(lower, dtype(np.inf))
    if float(upper) > high or upper == np.inf:
        upper = np.nextafter(upper, dtype(-np.inf))
    if not lower < upper:
        raise DomainError(f"{what} hold no two numbers of {precision.value}; widen them")
    return float(lower), float(upper)


def _most_change(
    rate_per_s: float | None, sample_time_s: float, within: tuple[float, float], precision: Precision
) -> float:  # fmt: skip
    """D in a precision, rounded down: never faster than the given rate, but for the rounding of outputs."""
    if rate_per_s is None or rate_per_s == math.inf:
        return math.inf
    if not rate_per_s > 0.0:
        raise DomainError(f"output_rate_per_s {rate_per_s!r} must be greater than 0; leave it out for no limit")
    dtype, wanted = precision.dtype, rate_per_s * sample_time_s
    with np.errstate(over="ignore", under="ignore"):
        change = dtype(wanted)
    if float(change) > wanted:
        change = np.nextafter(change, dtype(0.0))
    # an output at the larger limit must still move
    largest = dtype(max(abs(limit) for limit in within))
    lost = largest - change == largest if largest < 0.5 * np.finfo(dtype).max else change == 0.0
    if lost:
        what = f"output_rate_per_s {rate_per_s!r} is {wanted:.3g} a sample, which {precision.value} loses"
        raise DomainError(
            f"{what} beside an output of {float(largest):.3g}; give a longer sample time or a faster rate"
        )
    return float(change)


def _check_coefficients(sections: Sections, rows: Array, precision: Precision) -> None:
    """Refuse rounded coefficients (pole, residue) of an unusable controller."""
    poles, residues = rows[1:, 0], rows[1:, 1]
    if not np.all(np.isfinite(rows)):
        raise DomainError(f"a coefficient of the filter is beyond the range of {precision.value}; scale the signals")
    # the integrator is one before rounding too; another pole may round to 1
    integrates = bool(sections.poles) and sections.poles[0] == 1.0
    if np.any(np.abs(poles[int(integrates) :]) >= 1.0):
        what = f"the filter has a pole outside the unit circle after rounding to {precision.value}"
        raise DomainError(f"{what}; use a higher lower end of the band or a longer sample time")
    if integrates and residues[0] == 0.0:
        raise DomainError(f"the integrator's residue is 0 in {precision.value}; scale the signals")


def _anti_windup(direct: float, poles: Array, residues: Array, precision: Precision) -> tuple[Array, float]:
    """Weights and gain: r_k/sum r_j if stable, else |r_k|/sum |r_j|, 0 without such sections."""
    dtype = precision.dtype
    taking = np.where(poles > 0.0, residues, 0.0)
    for shares in (taking, np.abs(taking)):
        with np.errstate(all="ignore"):
            weights = (shares / shares.sum()).astype(dtype).astype(np.float64)
        if not np.all(np.isfinite(weights)):
            continue
        # g = min(1, |sum r_j/direct|)
        ratio = abs(float(shares.sum()))
        gain = float(dtype(1.0 if ratio >= abs(direct) else ratio / abs(direct)))
        if np.all(weights >= 0.0) or _stable(poles, weights, (gain, 1.0)):
            return weights, gain
    return np.zeros(len(poles)), 0.0


def _stable(poles: Array, weights: Array, gains: tuple[float, ...]) -> bool:
    """Whether the eigenvalues of P (I - g w 1') are inside the unit circle, for every g."""
    ones = np.ones(len(poles))
    matrices = [np.diag(poles) - gain * np.outer(poles * weights, ones) for gain in gains]
    return all(np.abs(np.linalg.eigvals(matrix)).max() < 1.0 - _INSIDE for matrix in matrices)
