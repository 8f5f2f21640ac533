"""Global extremes over frequency of |S|, |T|, |C S|, |P S| and |L|, by branch and bound:  no peak is missed.

Each response is the reciprocal of a sum K of one or two functions whose logarithms l_i have a Bode form,

    1/S = 1 + L,      1/T = 1 + 1/L,      1/(C S) = 1/C + P,      1/(P S) = 1/P + C,      1/L ,

K(u) = sum_i e^{l_i(u)} with u = ln omega.  On a cell with centre c and half-width h,
|K - (K(c) + K'(c)(u - c))| <= M h^2/2 where M bounds |K''| = |sum e^{l_i} (l_i'^2 + l_i'')|; so |K| lies between the
smallest and largest distance of a straight segment from 0, with an error of at most M h^2/2.  Cells that cannot hold
the extreme are dropped, the others divided, until the bound meets the best value.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from fopi_tune.core.bode_form import NO_SUMS, Array, BodeForm, Complex, Rows
from fopi_tune.core.loops import Loops
from fopi_tune.errors import DomainError

if TYPE_CHECKING:
    from fopi_tune.core.compiled.loops import Terms

#: cells of a search in all
_MOST_CELLS = 2_000_000
#: |u| and ln|K| are clipped here (1e100 and 1e130), so that their products stay finite
_U_CAP, _GAIN_CAP = 230.0, 300.0


class Response(Enum):
    """The functions of frequency a requirement can bound."""

    SENSITIVITY = "S"
    COMPLEMENTARY_SENSITIVITY = "T"
    CONTROL_SENSITIVITY = "CS"
    LOOP_GAIN = "L"
    LOAD_SENSITIVITY = "PS"


@dataclass(frozen=True)
class Tilt:
    """A response R is looked at as  R (omega/omega_0)^-power .

    Args:
        power: neper a unit of ln omega.
        omega_rad_s: omega_0, rad/s, greater than 0.
    """

    power: float
    omega_rad_s: float

    def log(self, omega_rad_s: Array) -> Array:
        """ln of the factor that a limit has at frequencies against that at omega_0."""
        return np.asarray(self.power * np.log(omega_rad_s / self.omega_rad_s))


@dataclass(frozen=True)
class Extremes:
    """The largest (or smallest) value over a band, a row a loop; shapes (m,).

    Args:
        value: ln of the absolute value; -inf and inf are limits as omega -> 0 or inf.
        omega_rad_s: where; 0 or inf when it is approached in that limit.
        cells: examined for all rows together: the effort of the search.
    """

    value: Array
    omega_rad_s: Array
    cells: int = 0


@dataclass(frozen=True)
class _Sum:
    """K = sum of e^{l_i}; with `one`, the constant 1 is a summand too."""

    one: bool
    terms: tuple[BodeForm, ...]

    def logs(self, rows: Rows, u: Array) -> list[tuple[Complex, Complex]]:
        """l_i and dl_i/du of every term at u."""
        return [term.value_and_derivative(rows, u) for term in self.terms]

    def value_and_slope(self, logs: list[tuple[Complex, Complex]]) -> tuple[Complex, Complex]:
        """K and dK/du from the terms' logarithms."""
        value = np.full(len(logs[0][0]), 1.0 + 0j if self.one else 0j)
        slope = np.zeros_like(value)
        for log_value, log_slope in logs:
            e = _exp(log_value)
            value += e
            slope += e * log_slope
        return value, slope


def _exp(z: Complex) -> Complex:
    return np.exp(np.minimum(z.real, _GAIN_CAP)) * np.exp(1j * z.imag)


def inverse_response(loops: Loops, response: Response) -> _Sum:
    """One over the response, as the sum of the module's first formula."""
    if response is Response.SENSITIVITY:
        return _Sum(True, (loops.log,))
    if response is Response.COMPLEMENTARY_SENSITIVITY:
        return _Sum(True, (-loops.log,))
    if response is Response.CONTROL_SENSITIVITY:
        return _Sum(False, (-loops.log_controller, loops.plants.log))
    if response is Response.LOAD_SENSITIVITY:
        return _Sum(False, (loops.log_controller, -loops.plants.log))
    return _Sum(False, (-loops.log.undelayed(),))


def log_response_at(loops: Loops, response: Response, rows: Rows, omega_rad_s: Array) -> Array:
    """ln of the response's absolute value at given frequencies; rows and omega of shape (n,)."""
    inverse = inverse_response(loops, response)
    k, _ = inverse.value_and_slope(inverse.logs(rows, loops.u_of(omega_rad_s)))
    with np.errstate(divide="ignore"):
        return -np.log(np.abs(k))


def extremes(
    loops: Loops,
    response: Response,
    from_rad_s: float,
    to_rad_s: float,
    largest: bool = True,
    tilt: Tilt | None = None,
) -> Extremes:
    """The global maximum (or minimum) of a response over a band, for every loop.

    Args:
        loops: m loops.
        response: which.
        from_rad_s: lower end; 0 for all low frequencies, the limit included.
        to_rad_s: upper end; inf for all high frequencies, the limit included.  Sampled loops end at Nyquist's
            frequency, below which `from_rad_s` must lie.
        largest: False for the minimum.
        tilt: the response is looked at so, over a band with two ends.

    Raises:
        DomainError: more cells than the limit (a dead time far beyond the loop's other times).
    """
    to_rad_s = to_rad_s if np.isfinite(loops.u_of(np.array(to_rad_s))) else np.inf
    inverse = inverse_response(loops, response)
    if tilt is not None and inverse.one:
        inverse = _Sum(False, (BodeForm.constant(len(loops)), *inverse.terms))
    low, high = _band(loops, inverse, from_rad_s, to_rad_s)
    sign = 1.0 if largest else -1.0
    limits: list[tuple[Array, float]] = []
    if from_rad_s == 0.0:
        limits.append((sign * _limit(inverse, at_zero=True, sign=sign), 0.0))
    if to_rad_s == np.inf:
        limits.append((sign * _limit(inverse, at_zero=False, sign=sign), loops.highest_rad_s))
    floor = np.max([limit for limit, _ in limits], axis=0) if limits else np.full(len(loops), -np.inf)
    weight = (0.0, 0.0, 0.0) if tilt is None else (tilt.power, loops.log_unit, np.log(tilt.omega_rad_s))
    best, u, cells = _branch_and_bound(inverse, low, high, sign, floor, weight)
    where = loops.omega_of(u)
    for limit, omega in limits:
        best, where = _better(best, where, limit, omega)
    return Extremes(sign * best, where, cells)


def _better(best: Array, where: Array, candidate: Array, omega: float) -> tuple[Array, Array]:
    # At the ends of the searched range the value is the limit to 1e-9: report the limit itself.
    wins = candidate > best - 1e-9
    return np.where(wins, candidate, best), np.where(wins, omega, where)


def _band(loops: Loops, inverse: _Sum, from_rad_s: float, to_rad_s: float) -> tuple[Array, Array]:
    """The part of the band outside which every term equals its asymptote and one exceeds the others 10^4 times."""
    m = len(loops)
    low, high = np.full(m, np.inf), np.full(m, -np.inf)
    asymptotes = [(np.zeros(m), np.zeros(m), np.zeros(m), np.zeros(m))] if inverse.one else []
    for term in inverse.terms:
        first, last = term.corners()
        low, high = np.minimum(low, first), np.maximum(high, last)
        end_gain, _ = term.end()
        asymptotes.append((term.scale, term.slope0, end_gain, term.slope_end()))
        delayed = term.delay != 0
        low = np.minimum(low, np.where(delayed, np.log(1e-9 / np.abs(np.where(delayed, term.delay, 1.0))), np.inf))
    for i, (scale_i, slope_i, end_i, end_slope_i) in enumerate(asymptotes):
        for scale_j, slope_j, end_j, end_slope_j in asymptotes[:i]:
            first, last = slope_i - slope_j, end_slope_i - end_slope_j
            low = np.minimum(low, _meeting(scale_i - scale_j, first, np.inf) - _apart(first))
            high = np.maximum(high, _meeting(end_i - end_j, last, -np.inf) + _apart(last))
    low, high = np.clip(low - 1.0, -_U_CAP, _U_CAP), np.clip(high + 1.0, -_U_CAP, _U_CAP)
    if from_rad_s > 0.0:
        low = np.full(m, loops.u_of(np.array(from_rad_s)))
    if to_rad_s < np.inf:
        high = np.full(m, loops.u_of(np.array(to_rad_s)))
    # A band beyond all corners keeps its inner end.
    if from_rad_s == 0.0:
        low = np.minimum(low, high - 1.0)
    if to_rad_s == np.inf:
        high = np.maximum(high, low + 1.0)
    return low, high


def _meeting(offset: Array, slope: Array, otherwise: float) -> Array:
    """u where two asymptotes cross; `otherwise` when they are parallel."""
    parallel = np.abs(slope) < 1e-12
    return np.where(parallel, otherwise, -offset / np.where(parallel, 1.0, slope))


def _apart(slope: Array) -> Array:
    """The distance in u from there to where the two asymptotes differ by a factor of 10^4."""
    parallel = np.abs(slope) < 1e-12
    return np.where(parallel, 0.0, np.log(1e4) / np.abs(np.where(parallel, 1.0, slope)))


def _limit(inverse: _Sum, at_zero: bool, sign: float) -> Array:
    """ln of the response as omega -> 0 or inf, shape (m,); with a dead time at inf the limit superior (or inferior)."""
    m = len(inverse.terms[0].scale)
    parts = [(np.zeros(m), np.zeros(m), np.zeros(m), np.zeros(m))] if inverse.one else []
    for term in inverse.terms:
        if at_zero:
            parts.append((term.slope0, term.scale, term.phase0, np.zeros(m)))
        else:
            parts.append((-term.slope_end(), *term.end(), term.delay))
    # The term with the smallest exponent (of 1/omega at inf) dominates.
    leading = np.min([p[0] for p in parts], axis=0)
    total, turning = np.zeros(m, dtype=complex), np.zeros(m)
    for exponent, gain, phase, delay in parts:
        leads = np.abs(exponent - leading) < 1e-12
        vector = np.where(leads, np.exp(np.minimum(gain, _GAIN_CAP)), 0.0) * np.exp(1j * phase)
        total += np.where(delay == 0, vector, 0.0)
        turning += np.where(delay != 0, np.abs(vector), 0.0)
    size = np.maximum(np.abs(np.abs(total) - turning), 0.0) if sign > 0 else np.abs(total) + turning
    with np.errstate(divide="ignore"):
        constant = -np.log(np.where(size < 1e-15, 0.0, size))
    return np.where(np.abs(leading) < 1e-12, constant, np.where(leading < 0, -np.inf, np.inf))


def _branch_and_bound(
    inverse: _Sum, low: Array, high: Array, sign: float, floor: Array, weight: tuple[float, float, float]
) -> tuple[Array, Array, int]:
    """max over u of sign * (-ln|K|), its u, and the number of cells; a row an interval.

    Cells with a bound below `floor` are dropped.  K is multiplied by (omega/omega_0)^power, `weight` being power, the
    loops' `log_unit` and ln omega_0.
    """
    from fopi_tune.core.compiled.peaks import branch_and_bound

    first, *more = (term.terms for term in inverse.terms)
    second = more[0] if more else no_terms()
    low, high, floor = (np.ascontiguousarray(part, dtype=float) for part in (low, high, floor))
    best, where, work = branch_and_bound(
        inverse.one, first, second, low, high, sign, floor, _MOST_CELLS, *map(float, weight)
    )
    if work > _MOST_CELLS:
        raise DomainError("the response has too many peaks to search; the dead time is too long for this loop")
    return best, where, work


@lru_cache
def no_terms() -> Terms:
    """No function in Bode form, for a sum of one."""
    from fopi_tune.core.compiled.loops import Terms

    return Terms(np.zeros((4, 0)), np.zeros((7, 0, 0)), NO_SUMS)
