"""Half widths of intervals from a fit's residuals, which need be neither independent nor free of rounding.

With the Jacobian J at the fit and G = (J'J)^-1 J', the parameters' covariance is G R G' for residuals of covariance R.
R is that of an autoregression of the residuals, whose order is the one of least BIC: 0 for independent ones, where the
covariance is s^2 (J'J)^-1.  A coarse sensor adds what its rounding can do: a plant at rest between two of its steps is
rounded to the same one for ever, which no residual shows.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from fopi_tune.core.bode_form import Array
from fopi_tune.errors import DomainError

#: of the intervals
CONFIDENCE = 0.95
#: residuals below this share of the output's range are rounding errors, and not tested for correlation
ROUNDING_SHARE = 1e-6
_MAX_ORDER = 10
#: steps to the noise's autocovariance from the residuals' one, and the largest root that they may lead to
_CORRECTIONS, _LEAST_DAMPED = 8, 0.998
#: noise of so many steps of a sensor makes the mean of its rounded values right to 0.003 steps
_DITHER = 0.6
#: draws of where the steps of a coarse sensor lie
_DRAWS = 200


@dataclass(frozen=True, eq=False)
class Spread:
    """How far the parameters can be from the fit.

    Args:
        half: shape (p,), half widths of the intervals.
        deviations: shape (p,), standard deviations.
        residual_std: standard deviation of the residuals.
        correlation: of the residuals from one sample to the next; 0 where they are rounding errors.
        quantum: step of the sensor where it is coarse enough to matter, else 0.
        inflation: largest factor by which correlated residuals raise a parameter's variance, >= 1.
    """

    half: Array
    deviations: Array
    residual_std: float
    correlation: float
    quantum: float
    inflation: float = 1.0


def spread_of(jacobian: Array, residuals: Array, output: Array, modelled: Array) -> Spread:
    """Half widths of the parameters' intervals.

    Args:
        jacobian: shape (n, p), at the fit.
        residuals: shape (n,).
        output: shape (n,), as recorded.
        modelled: shape (n,), the fit's output.

    Raises:
        DomainError: the recording cannot tell the parameters apart.
    """
    from scipy.stats import t as student

    n, p = jacobian.shape
    sizes = np.sqrt((jacobian**2).sum(axis=0))
    if sizes.min() == 0.0 or np.linalg.cond(jacobian / sizes) > 1e8:
        raise DomainError(
            "cannot tell gain, time constant and dead time apart; record more samples while the output moves, and "
            "until it settles"
        )
    # G from the QR factors of J with unit columns
    q, r = np.linalg.qr(jacobian / sizes)
    influence = np.linalg.solve(r, q.T) / sizes[:, None]
    variance = float(residuals @ residuals) / (n - p)
    white = (influence**2).sum(axis=1) * variance
    size = float(np.ptp(modelled)) or 1.0
    if variance <= (ROUNDING_SHARE * size) ** 2:
        half = float(student.ppf(0.5 + CONFIDENCE / 2, n - p)) * np.sqrt(white)
        return Spread(half, np.sqrt(white), math.sqrt(variance), 0.0, 0.0)
    autocovariance, order = _autocovariance(residuals, jacobian)
    squares, free = white, float(n - p)
    if order > 0:
        squares = np.maximum(white, _sandwich(influence, autocovariance))
        # as many independent residuals have a mean of the same variance
        independent = n * autocovariance[0] / max(autocovariance[0] + 2 * autocovariance[1:].sum(), 1e-300)
        free = float(np.clip(independent - p, 3.0, n - p))
    deviations = np.sqrt(squares)
    quantum = quantum_of(output)
    if math.sqrt(variance) > _DITHER * quantum:
        quantum = 0.0
    rounding = _rounding(influence, modelled, quantum, variance) if quantum else 0.0
    half = float(student.ppf(0.5 + CONFIDENCE / 2, free)) * deviations + rounding
    correlation = float(residuals[1:] @ residuals[:-1]) / float(residuals @ residuals)
    return Spread(half, deviations, math.sqrt(variance), correlation, quantum, float((squares / white).max()))


def _sandwich(influence: Array, autocovariance: Array) -> Array:
    """Diagonal of G R G' with the Toeplitz matrix R of an autocovariance."""
    from scipy.linalg import matmul_toeplitz

    return np.maximum((influence.T * matmul_toeplitz(autocovariance, influence.T)).sum(axis=0), 0.0)


def _autocovariance(residuals: Array, jacobian: Array) -> tuple[Array, int]:
    """Of the autoregression of least BIC, shape (n,), and its order.

    A fit takes the part of the noise that looks like its columns: with the projection M = I - Q Q' and noise of
    covariance R, residuals have the covariance M R M.  So the noise's autocovariance is changed until that of the
    residuals to be expected is the one that is seen.
    """
    n = len(residuals)
    most = min(_MAX_ORDER, n // 10)
    seen = np.array([residuals[k:] @ residuals[: n - k] for k in range(most + 1)]) / n
    scores = [n * math.log(seen[0])]
    for order in range(1, most + 1):
        left = seen[0] - _factors(seen[: order + 1]) @ seen[1 : order + 1]
        scores.append(n * math.log(max(left, 1e-12 * seen[0])) + order * math.log(n))
    order = int(np.argmin(scores))
    seen = seen[: order + 1]
    basis = np.linalg.qr(jacobian)[0]
    found = seen * n / (n - jacobian.shape[1])
    if order > 0:
        for _ in range(_CORRECTIONS):
            better = found + seen - _expected(_extended(found, n), basis, order)
            if np.abs(np.roots(np.concatenate([[1.0], -_factors(better)]))).max() > _LEAST_DAMPED:
                break
            found = better
    return _extended(found, n), order


def _factors(autocovariance: Array) -> Array:
    """Of the autoregression with these autocovariances, by the equations of Yule and Walker."""
    from scipy.linalg import solve_toeplitz

    order = len(autocovariance) - 1
    if order == 0:
        return np.zeros(0)
    return np.asarray(solve_toeplitz(autocovariance[:order], autocovariance[1:]), dtype=float)


def _extended(autocovariance: Array, n: int) -> Array:
    """The first n autocovariances of the autoregression that has these first ones."""
    from scipy.signal import lfilter, lfiltic

    factors = np.concatenate([[1.0], -_factors(autocovariance)])
    if len(factors) == 1:
        return np.concatenate([autocovariance, np.zeros(n - 1)])
    # gamma[k] = sum over i of factor[i] gamma[k - i]
    past = lfiltic([1.0], factors, autocovariance[:0:-1])
    rest = lfilter([1.0], factors, np.zeros(n - len(autocovariance)), zi=past)[0]
    return np.concatenate([autocovariance, rest])


def _expected(autocovariance: Array, basis: Array, most: int) -> Array:
    """Mean of the residuals' autocovariances 0 to `most`, of noise with this one:  sums over diagonals of M R M."""
    from scipy.linalg import matmul_toeplitz

    n = len(autocovariance)
    spread = matmul_toeplitz(autocovariance, basis)
    inner = basis @ (basis.T @ spread)
    found = np.empty(most + 1)
    for k in range(most + 1):
        early, late = slice(0, n - k), slice(k, n)
        found[k] = (n - k) * autocovariance[k] - np.sum(basis[early] * spread[late])
        found[k] += np.sum((inner[early] - spread[early]) * basis[late])
    return found / n


# -- coarse sensors ----------------------------------------------------------------------------------------------------


def quantum_of(output: Array) -> float:
    """The step on whose multiples the outputs, shape (n,), lie, in their unit; 0 where there is none."""
    gaps = np.diff(np.unique(output))
    if not gaps.size:
        return 0.0
    gaps = gaps[gaps > 0.01 * np.median(gaps)]
    step = float(gaps.min())
    step = float(np.median(gaps[gaps < 1.5 * step]))
    few = gaps[gaps < 5.5 * step] / step
    return step if float(np.mean(np.abs(few - np.round(few)) < 0.1)) > 0.9 else 0.0


def _rounding(influence: Array, modelled: Array, quantum: float, variance: float) -> Array:
    """What rounding to multiples of the quantum can do to the parameters: 95 % of where its multiples may lie.

    The mean of round(v + noise) - v is a Fourier series in v, damped by noise of the deviation s (derived by Poisson's
    summation):  sum over m of  (-1)^m / (pi m) sin(2 pi m v) exp(-2 pi^2 m^2 s^2),  in quanta.
    """
    noise = max(variance / quantum**2 - 1.0 / 12.0, 0.0)
    rng = np.random.default_rng(0)
    reach = float(np.ptp(modelled)) / quantum
    drawn: list[Array] = []
    for phase, stretch in rng.uniform(-0.5, 0.5, (_DRAWS, 2)).tolist():
        value = modelled / quantum * (1.0 + stretch / max(reach, 1.0)) + phase
        if noise < 0.01:
            error = np.round(value) - value
        else:
            error = sum(
                (-1) ** m / (math.pi * m) * math.exp(-2 * (math.pi * m) ** 2 * noise) * np.sin(2 * math.pi * m * value)
                for m in range(1, 6)
            )
        drawn.append(np.abs(influence @ np.asarray(error)) * quantum)
    return np.quantile(np.array(drawn), CONFIDENCE, axis=0)
