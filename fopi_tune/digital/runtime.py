"""The controller's arithmetic on the target, in NumPy:  the same operations and roundings as the exported C.

    e = r - y,                                              r the setpoint, y the measurement
    v = direct e + x_0 + x_1 + ...                          from left to right
    u = v within the limits, and within D of the last output
    d = g (u - v)
    x_k <- p_k (x_k + w_k d) + r_k e                                                                               (1)

D = output_rate_per_s Ts, infinite without a limit of the rate.  As the last output is within the limits, so is u, in
floating point too: where u - u_last > D, the sum u_last + D does not round beyond u.  The last output is that of the
last sample, what was tracked, or where `reset` started.

At a sample with any number that is not finite, output and states are held.

With a weight b of the setpoint other than 1, `direct` is the integral's part alone; with a derivative, its parts are
taken off:

    v = kp (b r - y) + direct e - k_1 (y - m_1) - k_2 (y - m_2) - ... + x_0 + x_1 + ...
    m_j <- m_j + q_j (y - m_j),        of a PID  k_1 = 2 kd/(2 Tf + Ts),    q_1 = 2 Ts/(2 Tf + Ts) .               (5)

Those are the sections of `digital.transforms`, (2), in other coordinates: m_j is the measurement behind a lag, and the
derivative of a measurement at rest is 0, however the coefficients are rounded.  m_j follow y whatever becomes of the
output: no anti-windup acts on them, and (3) takes them as they are after the sample.  The first sample after `init` and
`reset` is one at rest at its own measurement, with r = y before it:

    m_j <- y,        x_0 <- x_0 - kp (b y - y) .                                                                   (6)

A measurement filter of order 1 or 2, by Tustin's rule, gives f in the place of y in all of the above but NaN's test:

    order 1:    p = c (y - m),                                        c = 1/(1 + a)
    order 2:    h = c (y - m) - d q,    p = q + h,    q <- p + h,     c = 2/(2 + 2a + a^2),    d = (1 + a) c
    f = m + p,    m <- f + p,                                         a = 2 T/Ts .                                 (7)

In w = (z - 1)/(z + 1) that is 1/(1 + wa) and 1/(1 + wa + w^2 a^2/2).  A measurement at rest is passed as it is, however
c and d are rounded, and close to 1 no pole is stored.  The first sample after `init` and `reset` has m <- y, q <- 0,
and so f = y; m and q are flushed as m_j are, by |y|.

Anti-windup is back-calculation by weights that sum to 1.  While the output is limited, w_k = r_k/sum r_j (over p_j > 0)
makes the correction take from each section what a constant error adds to it: no section winds up, not even a slow one.
While the rate is limited it does the same: v stays near what the actuator can follow.
g = min(1, |sum r_j/d|), d = `direct` for b = 1, lets the output leave a limit as the error changes sign.  With g = 1, a
sample of noise beyond the limit would change the integrator by all of its excess, and the output would settle off the
setpoint.  For a PI that is a tracking time Ts/g = Ti + Ts/2.  Beside a derivative g = sqrt(r_0 q_1/k_1), at most 1,
where that is larger: a tracking time of sqrt(Ti Td).  With orders other than 1 that is Ts omega, |ki omega^-alpha| =
|kd omega^mu|, as sqrt(Ti Td) is 1/omega of a PID.

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

(with (5): u less the other terms of v)
so that the next output with the same error is u, and stays u while the error is 0: errors during tracking are not
integrated.

A section that decays would end as a subnormal number and stay one, and some processors are slow with those.  With F =
`Precision.flush_below`, after a sample at rest, |e| < F, and after one of tracking,

    x_k <- 0 where |x_k| < F .                                                                                       (4)

An error of F or more is always integrated.  A smaller one with r e < F is lost on an integrator at 0, where 10^23
samples of it would make the last place of an output of 1 in float32 (F is 1e-31; 1e-292 in float64); on one that holds
`Precision.absorbs_flushed` rounding loses it anyway.  Likewise m_j <- 0 where |m_j| < F, after a sample with |y| < F
and after one of tracking.

Source: back-calculation with sqrt(Ti Td) as in Astrom and Hagglund, Advanced PID Control, 2006; weights and (2) derived
here; r_0 q_1/k_1 = Ts^2 ki/kd = Ts^2/(Ti Td).  (7) is the trapezoidal integration of a state-variable filter.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from fopi_tune.core.bode_form import Array
from fopi_tune.core.parallel_form import Sections
from fopi_tune.core.terms.measurement_filter import MeasurementFilter
from fopi_tune.digital.coefficients import (
    MeasuredDerivative,
    SampledFilter,
    StoredCoefficients,
    anti_windup,
    check_coefficients,
    limits_within,
    most_change,
    on_error,
)
from fopi_tune.digital.realise import Precision, parallel_rows
from fopi_tune.errors import DomainError


@dataclass(frozen=True)
class Runtime:
    """A controller with the coefficients that its target stores; each is representable in `precision`.

    Args:
        precision: of coefficients, states and arithmetic.
        direct: the path of r - y without memory.
        poles: of the integral's sections, which act on r - y; the integrator's, exactly 1, comes first.
        residues: of the same length.
        weights: w_k of the anti-windup; they sum to 1 up to rounding; all 0 when no section takes a correction.
        tracking_gain: g, in [0, 1].
        limits: of the output, lower first.
        most_change: D, by which the output changes at most from sample to sample; inf: any change.
        proportional: kp of kp (b r - y); 0 for b = 1, where `direct` has it.
        setpoint_weight: b.
        derivative: None without one.
        measurement_filter: None without one.
    """

    precision: Precision
    direct: float
    poles: tuple[float, ...]
    residues: tuple[float, ...]
    weights: tuple[float, ...]
    tracking_gain: float
    limits: tuple[float, float]
    most_change: float = math.inf
    proportional: float = 0.0
    setpoint_weight: float = 1.0
    derivative: MeasuredDerivative | None = None
    measurement_filter: SampledFilter | None = None

    @classmethod
    def of(
        cls, sections: Sections, precision: Precision, limits: tuple[float, float] | None = None,
        rate_per_s: float | None = None, setpoint_weight: float = 1.0,
        measurement_filter: MeasurementFilter | None = None,
    ) -> Runtime:  # fmt: skip
        """Round a controller to a precision, once.

        Args:
            sections: the controller.
            precision: of the target.
            limits: of the output, lower first; infinite, or None for both, where there is none.
            rate_per_s: fastest change of the output, per s; None where there is no limit.
            setpoint_weight: b; other than 1 for sections with their parts only.
            measurement_filter: F; None is 1.

        Raises:
            DomainError: the limits are empty, the rate is not greater than 0 or lost to rounding, a coefficient is
                beyond the precision's range, a rounded pole is not inside the unit circle, the sections of a weight
                have no parts, or F is faster than half a sample or lost to rounding.
        """
        within = limits_within(limits, precision)
        change = most_change(rate_per_s, sections.sample_time_s, within, precision)
        with np.errstate(over="ignore", under="ignore"):
            rows = parallel_rows(on_error(sections), precision).astype(np.float64)
        direct, poles, residues = float(rows[0, 1]), rows[1:, 0], rows[1:, 1]
        check_coefficients(sections, rows, precision)
        weights, gain = anti_windup(direct, poles, residues, precision)
        made = cls(precision, direct, _floats(poles), _floats(residues), _floats(weights), gain, within, change)
        made = _with_parts(made, sections, setpoint_weight)
        if measurement_filter is None:
            return made
        sampled = SampledFilter.of(measurement_filter, sections.sample_time_s, precision)
        return replace(made, measurement_filter=sampled)

    @property
    def has_integrator(self) -> bool:
        """Whether the first section is an integrator; `reset` starts it at the output."""
        return bool(self.poles) and self.poles[0] == 1.0

    @property
    def limits_rate(self) -> bool:
        """Whether the output's change from sample to sample is limited."""
        return math.isfinite(self.most_change)

    @property
    def acts_on_error(self) -> bool:
        """Whether the output depends on r and y by r - y alone."""
        return self.proportional == 0.0 and self.derivative is None and self.measurement_filter is None

    @property
    def can_take_turns(self) -> bool:
        """Whether it may be one of two that take turns: beside a derivative it acts on r - y alone."""
        return self.proportional == 0.0 and self.measurement_filter is None

    @property
    def starts_at_first_sample(self) -> bool:
        """Whether the first sample after `init` and `reset` sets states, (6) and (7)."""
        remembers = self.derivative is not None or self.measurement_filter is not None
        return remembers or (self.proportional != 0.0 and self.has_integrator)

    @cached_property
    def stored(self) -> StoredCoefficients:
        """The same numbers in the type of the precision."""
        dtype = self.precision.dtype
        direct, gain, low, high = (dtype(number) for number in (self.direct, self.tracking_gain, *self.limits))
        poles, residues, weights = (np.array(row, dtype=dtype) for row in (self.poles, self.residues, self.weights))
        largest, flush_below = np.finfo(dtype).max, dtype(self.precision.flush_below)
        change = dtype(self.most_change)
        derivative = self.derivative or MeasuredDerivative()
        gains, shares = (np.array(row, dtype=dtype) for row in (derivative.gains, derivative.shares))
        return StoredCoefficients(
            direct, poles, residues, weights, gain, low, high, change, largest, flush_below, dtype(self.proportional),
            dtype(self.setpoint_weight), gains, shares, *self._filter_numbers,
        )  # fmt: skip

    @property
    def _filter_numbers(self) -> tuple[np.floating, np.floating]:
        used, dtype = self.measurement_filter or SampledFilter(1.0), self.precision.dtype
        return dtype(used.share), dtype(used.damping or 0.0)


@dataclass(frozen=True, eq=False)
class State:
    """What the controller remembers.

    Args:
        x: shape (n,), of the precision's type, a section's state each.
        output: the last output, of the precision's type.
        filtered: m_j, the measurements that the derivative is taken from, of its length; None without one.
        is_new: whether the next sample is the first one, where this sets states.
        lagged: m, and q of order 2, of a measurement filter; None without one.
    """

    x: NDArray[np.floating]
    output: np.floating
    filtered: NDArray[np.floating] | None = None
    is_new: bool = False
    lagged: NDArray[np.floating] | None = None


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
    filtered = None if runtime.derivative is None else np.zeros(len(numbers.derivative_gains), dtype=dtype)
    used = runtime.measurement_filter
    lagged = None if used is None else np.zeros(1 if used.damping is None else 2, dtype=dtype)
    return State(x, start, filtered, runtime.starts_at_first_sample, lagged)


def step(
    runtime: Runtime, state: State, setpoint: float, measurement: float, added: np.floating | None = None
) -> State:
    """One sample; `output` of what is returned goes to the actuator.

    Args:
        runtime: the controller.
        state: before the sample.
        setpoint: r.
        measurement: y.
        added: to v after its first term, in the precision: a feed-forward; None: nothing is.
    """
    return _one_sample(runtime, state, setpoint, measurement, None, added)


def track(
    runtime: Runtime, state: State, setpoint: float, measurement: float, applied: float,
    added: np.floating | None = None,
) -> State:  # fmt: skip
    """One sample in which the actuator had another output than this controller's.

    Args:
        runtime: the controller.
        state: before the sample.
        setpoint: as for `step`.
        measurement: as for `step`.
        applied: what the actuator had; taken within the limits.
        added: as for `step`.
    """
    return _one_sample(runtime, state, setpoint, measurement, applied, added)


@np.errstate(all="ignore")
def _one_sample(
    runtime: Runtime, state: State, setpoint: float, measurement: float, applied: float | None,
    added: np.floating | None,
) -> State:  # fmt: skip
    """(1) or (3), with (4) to (7); the state itself when a number is not finite."""
    c, dtype = runtime.stored, runtime.precision.dtype
    r, measured, held = dtype(setpoint), dtype(measurement), state
    state = _at_rest(runtime, state, measured) if state.is_new else state
    y, lagged = c.lowpass(state.lagged, measured)
    e = r - y
    v = _total(_without_memory(runtime, r, y, e, state.filtered, added), state.x)
    filtered = None if state.filtered is None else state.filtered + c.derivative_shares * (y - state.filtered)
    if not (c.finite(e) and c.finite(v)):
        return held
    if applied is None:
        u = c.followed(c.limited(v), state.output)
        d = c.tracking_gain * (u - v)
        following = c.poles * (state.x + c.weights * d) + c.residues * e
    else:
        if not c.finite(dtype(applied)):
            return held
        u = c.limited(dtype(applied))
        following = c.poles * state.x
        if runtime.has_integrator:
            following[0] = u - _total(_without_memory(runtime, r, y, e, filtered, added), following[1:])
    if not all(part is None or np.all(np.isfinite(part)) for part in (following, filtered, lagged)):
        return held
    if applied is not None or abs(e) < c.flush_below:
        following[np.abs(following) < c.flush_below] = 0.0
    if filtered is not None and (applied is not None or abs(y) < c.flush_below):
        filtered[np.abs(filtered) < c.flush_below] = 0.0
    if lagged is not None and (applied is not None or abs(measured) < c.flush_below):
        lagged[np.abs(lagged) < c.flush_below] = 0.0
    return State(following, u, filtered, lagged=lagged)


def _at_rest(runtime: Runtime, state: State, y: np.floating) -> State:
    """(6), and that of (7)."""
    c, x = runtime.stored, state.x.copy()
    if runtime.proportional != 0.0 and runtime.has_integrator:
        x[0] = x[0] - c.proportional * (c.setpoint_weight * y - y)
    filtered = None if state.filtered is None else np.full_like(state.filtered, y)
    lagged = None if state.lagged is None else np.zeros_like(state.lagged)
    if lagged is not None:
        lagged[0] = y
    return replace(state, x=x, filtered=filtered, is_new=False, lagged=lagged)


def _without_memory(
    runtime: Runtime, r: np.floating, y: np.floating, e: np.floating, filtered: NDArray[np.floating] | None,
    added: np.floating | None,
) -> np.floating:  # fmt: skip
    """The terms of v before the sections' states."""
    c = runtime.stored
    v = c.direct * e if added is None else c.direct * e + added
    if runtime.proportional != 0.0:
        v = c.proportional * (c.setpoint_weight * r - y) + v
    if filtered is not None:
        for gain, m in zip(c.derivative_gains, filtered, strict=True):
            v = v - gain * (y - m)
    return v


def _total(first: np.floating, rest: NDArray[np.floating]) -> np.floating:
    """The sum from left to right."""
    for x in rest:
        first = first + x
    return first


def _with_parts(made: Runtime, sections: Sections, setpoint_weight: float) -> Runtime:
    """The controller of the terms on r - y with the weight of the setpoint and the derivative."""
    parts, dtype = sections.parts, made.precision.dtype
    if parts is None:
        if setpoint_weight != 1.0:
            raise DomainError("a setpoint's weight needs sections that tell the proportional part of their sum")
        return made
    with np.errstate(over="ignore", under="ignore"):
        if setpoint_weight != 1.0 and parts.proportional != 0.0:
            kp, direct, weight = (float(dtype(n)) for n in (parts.proportional, parts.integral, setpoint_weight))
            made = replace(made, direct=direct, proportional=kp, setpoint_weight=weight)
        if sections.has_derivative:
            derivative = MeasuredDerivative.of(sections, made.precision)
            made = replace(made, derivative=derivative)
            first = made.residues[0] if made.has_integrator else None
            gain = derivative.shorter_tracking(first, parts.equal_at_rad_s, sections.sample_time_s)
            if made.tracking_gain > 0.0:
                made = replace(made, tracking_gain=max(made.tracking_gain, float(dtype(min(1.0, gain)))))
    if not math.isfinite(made.setpoint_weight):
        raise DomainError(f"a coefficient of the controller is beyond the range of {made.precision.value}; scale it")
    return made


def _floats(values: Array) -> tuple[float, ...]:
    return tuple(float(value) for value in values)
