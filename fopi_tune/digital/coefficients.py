"""The numbers that a controller's target stores:  sections, limits and rates, rounded to its precision.

Source: weights and gain of the anti-windup are those of `runtime`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from fopi_tune.core.bode_form import Array
from fopi_tune.core.parallel_form import Sections
from fopi_tune.core.terms.measurement_filter import MeasurementFilter
from fopi_tune.digital.realise import Precision
from fopi_tune.errors import DomainError

#: least distance of eigenvalues from the unit circle for weights of both signs; above the rounding of `eigvals`
_INSIDE = 1e-9


@dataclass(frozen=True)
class MeasuredDerivative:
    """The derivative -sum k_j (y - m_j), m_j <- m_j + q_j (y - m_j).

    Args:
        gains: k_j, in the order in which they are taken off.
        shares: q_j, in (0, 2); above 1 for a part that is faster than half the sample time.
    """

    gains: tuple[float, ...] = ()
    shares: tuple[float, ...] = ()

    @classmethod
    def of(cls, sections: Sections, precision: Precision) -> MeasuredDerivative:
        """The derivative's sections, rounded.

        Raises:
            DomainError: a gain is beyond the precision's range, or a rounded share not in (0, 2).
        """
        assert sections.parts is not None
        direct, count = sections.parts.derivative, sections.integral_sections
        # a section is k - k q/(z - p), p = 1 - q; as its residue q keeps all digits
        rows = zip(direct, sections.poles[count:], sections.residues[count:], strict=True)
        shares = [-residue / gain if gain else 1.0 - pole for gain, pole, residue in rows]
        found = cls(*(tuple(float(precision.dtype(number)) for number in row) for row in (direct, shares)))
        if not all(map(math.isfinite, found.gains)) or not all(0.0 < share < 2.0 for share in found.shares):
            raise DomainError(f"a coefficient of the controller is beyond the range of {precision.value}; scale it")
        return found

    def shorter_tracking(self, residue: float | None, equal_at_rad_s: float | None, sample_time_s: float) -> float:
        """g beside a derivative: Ts omega, or, of a PID, sqrt(r_0 q_1/k_1) of its stored numbers; 0 without.

        Args:
            residue: r_0, of an integrator; None without one.
            equal_at_rad_s: omega, where integral and derivative are equally large.
            sample_time_s: Ts.
        """
        if equal_at_rad_s is not None:
            return sample_time_s * equal_at_rad_s
        if len(self.gains) != 1 or residue is None:
            return 0.0
        (gain,), (share,) = self.gains, self.shares
        return math.sqrt(max(residue * share / gain, 0.0)) if gain else 0.0


@dataclass(frozen=True)
class SampledFilter:
    """A measurement filter by Tustin's rule, (7) of `runtime`.

    Args:
        share: c, of y - m that moves the filtered measurement at once.
        damping: d, of q that a sample takes; None of a filter of order 1, which has no q.
    """

    share: float
    damping: float | None = None

    @classmethod
    def of(cls, used: MeasurementFilter, sample_time_s: float, precision: Precision) -> SampledFilter:
        """The filter, rounded.

        Raises:
            DomainError: T < Ts/2, or T is so long that the precision loses a sample's share.
        """
        time, half = used.time_constant_s, 0.5 * sample_time_s
        if time < half:
            what = f"measurement_filter.time_constant_s {time:g} is below half the sample time, {half:g} s"
            raise DomainError(
                f"{what}: sampled, the filter would ring from sample to sample; write {half:g} or more, or a "
                f"sample_time_s of {2.0 * time:g} or less"
            )
        a, dtype = time / half, precision.dtype
        with np.errstate(over="ignore", under="ignore"):
            if used.order == 1:
                found = cls(float(dtype(1.0 / (1.0 + a))))
            else:
                whole = 2.0 + a * (2.0 + a)
                found = cls(float(dtype(2.0 / whole)), float(dtype(2.0 * (1.0 + a) / whole)))
        # in a sample the filtered measurement comes about 1/(1 + a) of the way
        if 1.0 / (1.0 + a) < float(np.finfo(dtype).eps):
            raise DomainError(
                f"measurement_filter.time_constant_s {time:g} is so many samples long that {precision.value} loses "
                "what one of them adds; take a longer sample time or a faster filter"
            )
        return found


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
    proportional: np.floating
    setpoint_weight: np.floating
    derivative_gains: NDArray[np.floating]
    derivative_shares: NDArray[np.floating]
    filter_share: np.floating
    filter_damping: np.floating

    def lowpass(
        self, lagged: NDArray[np.floating] | None, y: np.floating
    ) -> tuple[np.floating, NDArray[np.floating] | None]:
        """f of (7) in `runtime`, and m and q after the sample; y itself without a filter."""
        if lagged is None:
            return y, None
        after, m = lagged.copy(), lagged[0]
        p = self.filter_share * (y - m)
        if len(lagged) > 1:
            h = p - self.filter_damping * lagged[1]
            p = lagged[1] + h
            after[1] = p + h
        f = m + p
        after[0] = f + p
        return f, after

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


def on_error(sections: Sections) -> Sections:
    """The terms that act on r - y where b = 1."""
    parts, count = sections.parts, sections.integral_sections
    if parts is None or not sections.has_derivative:
        return sections
    return replace(
        sections, direct=parts.on_error, poles=sections.poles[:count], residues=sections.residues[:count], parts=None
    )


def limits_within(limits: tuple[float, float] | None, precision: Precision) -> tuple[float, float]:
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


def most_change(
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


def check_coefficients(sections: Sections, rows: Array, precision: Precision) -> None:
    """Refuse rounded coefficients (pole, residue) of an unusable controller."""
    poles, residues = rows[1:, 0], rows[1:, 1]
    if not np.all(np.isfinite(rows)):
        raise DomainError(f"a coefficient of the filter is beyond the range of {precision.value}; scale the signals")
    # the integrator is one before rounding too; another pole may round to 1; the derivative's is not in these rows
    integrates = bool(sections.poles) and sections.poles[0] == 1.0
    if np.any(np.abs(poles[int(integrates) :]) >= 1.0):
        what = f"the filter has a pole outside the unit circle after rounding to {precision.value}"
        raise DomainError(f"{what}; use a higher lower end of the band or a longer sample time")
    if integrates and residues[0] == 0.0:
        raise DomainError(f"the integrator's residue is 0 in {precision.value}; scale the signals")


def anti_windup(direct: float, poles: Array, residues: Array, precision: Precision) -> tuple[Array, float]:
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
