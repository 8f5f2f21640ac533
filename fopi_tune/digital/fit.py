"""The sampled controller fitted directly to s^-alpha on the unit circle.

    F(z) = d + (Ts/2)(z + 1)/(z - 1) r_0 + sum_k r_k (1 - p_k)/(z - p_k),    p_k in (0, 1) ,

minimises the largest relative error |F(e^{j omega Ts}) - (j omega)^-alpha|/|(j omega)^-alpha| over the band.  For given
poles this is convex in d and r_k (a second-order cone per frequency).  It is solved over a grid of poles first; the
poles with the largest residues are refined by least squares with weights that follow the error (Lawson), and the
residues of the refined poles are those of the convex problem again.

At the Nyquist frequency a real filter has a real value: its phase is 0 or 180 deg there and not -90 deg alpha.  The
error is minimised up to `FIT_UP_TO` of the Nyquist frequency; above, only a loose bound is kept.
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from fopi_tune.core.bode_form import Array
from fopi_tune.core.controller import FoPi
from fopi_tune.core.parallel_form import DirectParts, Sections
from fopi_tune.errors import DomainError

#: share of the Nyquist frequency up to which the error is minimised
FIT_UP_TO = 0.3
_FREQUENCIES, _UPPER_FREQUENCIES, _BEYOND = 120, 60, 20
#: factor by which the relative error may be larger above
_LOOSER = 400.0
_GRID = 60
_LAWSON_ROUNDS, _LAWSON_POWER = 25, 0.7
#: ln(1 - p) of the slowest pole that differs from the integrator, and of the fastest
_SLOWEST, _FASTEST = -16.0, 0.0


@dataclass(frozen=True)
class _Band:
    """Frequencies, and the relative error allowed at each in units of the largest error."""

    omega: Array
    allowed: Array
    z: NDArray[np.complex128]
    target: NDArray[np.complex128]
    sample_time_s: float

    def matrix(self, poles: Array) -> NDArray[np.complex128]:
        """Columns of F over the target, divided by the allowed errors: shape (n, 2 + poles)."""
        z = self.z[:, None]
        integrator = 0.5 * self.sample_time_s * (z + 1.0) / (z - 1.0)
        columns = np.hstack([np.ones_like(z), integrator, (1.0 - poles) / (z - poles)])
        return columns / (self.target * self.allowed)[:, None]

    @property
    def wanted(self) -> Array:
        """The sum of the columns for F equal to the target."""
        return 1.0 / self.allowed


def fit(gains: FoPi, sample_time_s: float, poles: int, band_rad_s: tuple[float, float]) -> Sections:
    """kp + ki s^-alpha as sections.

    Args:
        gains: the controller; alpha = 1 gives Tustin's integrator.
        sample_time_s: Ts.
        poles: sections besides the integrator.
        band_rad_s: where to fit; its upper end is cut at `FIT_UP_TO` of the Nyquist frequency.

    Raises:
        DomainError: the band begins above that frequency.
    """
    half = 0.5 * sample_time_s
    if gains.ki == 0.0:
        return Sections(sample_time_s, gains.kp, (), (), DirectParts(gains.kp))
    if gains.alpha == 1.0:
        parts = DirectParts(gains.kp, gains.ki * half)
        return Sections(sample_time_s, parts.on_error, (1.0,), (gains.ki * sample_time_s,), parts)
    direct, integral, residues, chosen = _fitted(gains.alpha, sample_time_s, poles, band_rad_s)
    parts = DirectParts(gains.kp, float(gains.ki * (direct + integral * half)))
    return Sections(
        sample_time_s,
        parts.on_error,
        (1.0, *chosen.tolist()),
        (float(gains.ki * integral * sample_time_s), *(gains.ki * residues).tolist()),
        parts,
    )


# a search of gains asks for one order again and again, and a fit takes about a second
@lru_cache(maxsize=64)
def _fitted(
    alpha: float, sample_time_s: float, poles: int, band_rad_s: tuple[float, float]
) -> tuple[float, float, Array, Array]:
    """d, r_0, the other residues and their poles."""
    band = _band(alpha, sample_time_s, band_rad_s)
    chosen = _refined_poles(band, _initial_poles(band, poles))
    values = _minimax(band, chosen)
    return values[0], values[1], values[2:] * (1.0 - chosen), chosen


def _band(alpha: float, sample_time_s: float, band_rad_s: tuple[float, float]) -> _Band:
    nyquist = np.pi / sample_time_s
    low, high = band_rad_s[0], min(band_rad_s[1], FIT_UP_TO * nyquist)
    if not low < high:
        where = f"{high:g} rad/s, where a fit ends: {FIT_UP_TO:g} of Nyquist's frequency or the band's upper end"
        raise DomainError(f"the band begins at {low:g} rad/s, not below {where}")
    # denser where the filter's phase has to depart from the ideal one
    upper = np.linspace(max(low, high / 10.0), high, _UPPER_FREQUENCIES)
    inside = np.unique(np.concatenate([np.geomspace(low, high, _FREQUENCIES), upper]))
    beyond = np.linspace(high, nyquist, _BEYOND + 1)[1:]
    omega = np.concatenate([inside, beyond])
    allowed = np.concatenate([np.ones(len(inside)), np.full(len(beyond), _LOOSER)])
    z = np.exp(1j * omega * sample_time_s)
    target = np.asarray((1j * omega) ** -alpha, dtype=complex)
    return _Band(omega, allowed, z, target, sample_time_s)


def _minimax(band: _Band, poles: Array) -> Array:
    """d, r_0 and r_k that minimise the largest error, for given poles."""
    import cvxpy as cp

    matrix = band.matrix(poles)
    scale = np.abs(matrix).max(axis=0)
    a, b = (matrix / scale).real, (matrix / scale).imag
    x, bound = cp.Variable(matrix.shape[1]), cp.Variable()
    error = cp.vstack([a @ x - band.wanted, b @ x])
    problem = cp.Problem(cp.Minimize(bound), [cp.norm(error, 2, axis=0) <= bound])
    with warnings.catch_warnings():
        # "may be inaccurate": the result's error is measured in any case
        warnings.simplefilter("ignore")
        problem.solve(solver=cp.CLARABEL)
    if x.value is None:
        raise DomainError(f"the residues' problem ended as {problem.status}; use fewer poles or another method")
    return np.asarray(x.value / scale, dtype=float)


def _initial_poles(band: _Band, count: int) -> Array:
    """Initial poles from a grid: where the convex problem's solution has its largest residues, kept apart."""
    slowest = np.log(band.omega[0] * band.sample_time_s)
    grid = 1.0 - np.exp(np.linspace(max(slowest - 1.0, _SLOWEST), -0.05, _GRID))
    share = np.abs(_minimax(band, grid)[2:])
    # cumulative residues over ln(1 - p): equal portions put poles where the residues are large
    ends = np.cumsum(share / np.abs(1.0 / (1.0 - grid)).max() + share.mean() * 0.5)
    portions = (np.arange(count) + 0.5) / count * ends[-1]
    return grid[np.searchsorted(ends, portions).clip(0, _GRID - 1)]


def _refined_poles(band: _Band, poles: Array) -> Array:
    """Poles that minimise the largest error, by local search."""
    from scipy.optimize import least_squares

    wanted = np.concatenate([band.wanted, np.zeros(len(band.omega))])

    def errors(x: Array, weights: Array) -> Array:
        matrix = band.matrix(1.0 - np.exp(x))
        stacked = np.vstack([matrix.real, matrix.imag])
        root = np.sqrt(np.concatenate([weights, weights]))
        solution = np.linalg.lstsq(stacked * root[:, None], wanted * root, rcond=None)[0]
        return (stacked @ solution - wanted) * root

    count = len(band.omega)
    x = np.log(1.0 - poles) + 1e-3 * np.arange(len(poles))
    weights, best, smallest = np.ones(count), x, np.inf
    for _ in range(_LAWSON_ROUNDS):
        x = np.clip(x, _SLOWEST + 1e-6, _FASTEST - 1e-6)
        x = least_squares(errors, x, args=(weights,), bounds=(_SLOWEST, _FASTEST), max_nfev=30).x
        plain = errors(x, weights) / np.sqrt(np.concatenate([weights, weights]))
        size = np.hypot(plain[:count], plain[count:])
        if size.max() < smallest:
            best, smallest = x, float(size.max())
        weights = weights * (size / size.mean()) ** _LAWSON_POWER
        weights = weights / weights.mean()
    return np.sort(1.0 - np.exp(best))
