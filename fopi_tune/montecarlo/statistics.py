"""Statistics of a sample of plants:  counts and values -> fractions and quantiles with exact confidence intervals.

Nothing is assumed about the values' distribution, only that the draws are independent: `SamplingDesign.RANDOM`.  For a
Latin hypercube or a Sobol sequence the intervals are not exact.

Infinite values are allowed (a loop that never settles).  A value that is not a number is refused: the caller has to
decide whether it counts as met, as infinite, or as a failure.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from fopi_tune.core.bode_form import Array
from fopi_tune.errors import DomainError

#: relative rounding error of a probability times a number of draws
_ROUNDING = 2.0**-50
#: bins of a histogram
_BINS = 30


@dataclass(frozen=True)
class Fraction:
    """How many draws met a requirement, and confidence bounds of the probability that a draw meets it.

    Args:
        met: number of draws that met it.
        total: number of draws.
        low: lower end of the two-sided Clopper-Pearson interval.
        high: upper end.
        at_least: one-sided lower bound, to be stated when all draws met it; not below `low`.
        at_most: one-sided upper bound, to be stated when none met it.
        confidence: least probability that [low, high] contains the true value; the same for each one-sided bound.
    """

    met: int
    total: int
    low: float
    high: float
    at_least: float
    at_most: float
    confidence: float

    @property
    def estimate(self) -> float:
        """met/total."""
        return self.met / self.total


@dataclass(frozen=True)
class Histogram:
    """How many values lie between neighbouring edges, the last edge included; infinite values are left out.

    Args:
        edges: ascending.
        counts: one per interval between edges.
    """

    edges: tuple[float, ...]
    counts: tuple[int, ...]


@dataclass(frozen=True)
class Quantile:
    """An order statistic as estimate of a quantile, with a confidence interval whose ends are order statistics too.

    Args:
        probability: which quantile.
        value: the smallest value with at least this fraction of the draws at or below it.
        low: lower end, or None where even the least value does not reach the confidence.
        high: upper end, or None likewise.
        confidence: what was asked for.
        coverage: what the interval reaches at least (exactly, for a continuous distribution).
    """

    probability: float
    value: float
    low: float | None
    high: float | None
    confidence: float
    coverage: float


def fraction(met: int, total: int, confidence: float = 0.95) -> Fraction:
    """The exact interval of Clopper and Pearson (1934) for a binomial probability.

    low solves P(B >= met) = a and high solves P(B <= met) = a, B ~ Bin(total, .): a = (1 - confidence)/2 for the
    interval, a = 1 - confidence for the one-sided bounds.

    Raises:
        DomainError: not 0 <= met <= total, total < 1, or a confidence outside (0, 1).
    """
    if total < 1 or not 0 <= met <= total:
        raise DomainError(f"met = {met!r} of total = {total!r}: it takes 0 <= met <= total and total >= 1")
    _check_inside("confidence", confidence)
    one_sided = 1.0 - confidence
    return Fraction(
        met,
        total,
        low=_lower(met, total, one_sided / 2),
        high=_upper(met, total, one_sided / 2),
        at_least=_lower(met, total, one_sided),
        at_most=_upper(met, total, one_sided),
        confidence=confidence,
    )


def quantiles(values: Array, probabilities: Sequence[float], confidence: float = 0.95) -> tuple[Quantile, ...]:
    """Quantiles of a sample, with distribution-free intervals; one pass, in memory of twice the values.

    The q-quantile lies in [x_(r), x_(s)] with probability at least P(r <= B <= s - 1), B ~ Bin(n, q).  Here
    r = floor(m) - k and s = ceil(m) + k about m = (n + 1) q, with the smallest k that reaches the confidence; an r
    below 1 or an s above n has no order statistic.  For the median these are the ranks r and n + 1 - r of the tables.

    Args:
        values: shape (n,), n >= 1, infinities allowed; in any order.
        probabilities: each in (0, 1).
        confidence: in (0, 1), for each quantile by itself.

    Raises:
        DomainError: no values, some not a number, or a probability outside (0, 1).
    """
    values = checked_values(values)
    if values.size == 0:
        raise DomainError("no values, no quantiles")
    _check_inside("confidence", confidence)
    n = len(values)
    found = []
    for q in probabilities:
        _check_inside("probability", q)
        # a product within rounding of a whole number counts as that number: 30 times 0.1 is 3
        near = min(max(math.ceil(n * q * (1.0 - _ROUNDING)), 1), n)
        found.append((near, *_ranks(n, q, confidence)))
    wanted = sorted({rank - 1 for near, low, high, _ in found for rank in (near, low, high) if 1 <= rank <= n})
    ordered = np.partition(values, wanted) if wanted else values

    def statistic(rank: int) -> float | None:
        return float(ordered[rank - 1]) if 1 <= rank <= n else None

    return tuple(
        Quantile(q, float(ordered[near - 1]), statistic(low), statistic(high), confidence, coverage)
        for q, (near, low, high, coverage) in zip(probabilities, found, strict=True)
    )


def checked_values(values: Array) -> Array:
    """Values as an array of floats, shape (n,).

    Raises:
        DomainError: not of that shape, or some value is not a number.
    """
    values = np.asarray(values, dtype=float)
    if values.ndim != 1:
        raise DomainError(f"values must have the shape (n,), not {values.shape}")
    if (wrong := np.isnan(values)).any():
        raise DomainError(f"value {int(np.argmax(wrong))} is not a number; decide what it counts as before counting")
    return values


def _lower(met: int, total: int, tail: float) -> float:
    # P(B >= met) = I_p(met, total - met + 1)
    from scipy import special  # a quarter of a second

    return 0.0 if met == 0 else float(special.betaincinv(met, total - met + 1, tail))


def _upper(met: int, total: int, tail: float) -> float:
    # P(B <= met) = 1 - I_p(met + 1, total - met)
    from scipy import special  # a quarter of a second

    return 1.0 if met == total else float(special.betainccinv(met + 1, total - met, tail))


def _ranks(n: int, q: float, confidence: float) -> tuple[int, int, float]:
    """r and s of the smallest interval about (n + 1) q, below 1 or above n where there is none, and its coverage."""
    from scipy import special  # SciPy's distributions take a second and 40 MB

    middle = (n + 1) * q
    if abs(middle - round(middle)) <= _ROUNDING * middle:
        middle = round(middle)
    left, right = math.floor(middle), math.ceil(middle)

    def coverage(k: int) -> float:
        # P(B <= s - 1) - P(B <= r - 1), with P(B <= i) = 1 - I_q(i + 1, n - i); an end without an order statistic is
        # infinite and leaves nothing beyond it
        up_to_high = 1.0 if right + k > n else float(special.betaincc(right + k, n - right - k + 1, q))
        below_low = 0.0 if left - k < 1 else float(special.betaincc(left - k, n - left + k + 1, q))
        return up_to_high - below_low

    fails, reaches = -1, n
    while reaches - fails > 1:
        k = (fails + reaches) // 2
        fails, reaches = (fails, k) if coverage(k) >= confidence else (k, reaches)
    return left - reaches, right + reaches, coverage(reaches)


def histogram(values: Array) -> Histogram | None:
    """The finite values in bins of equal width; None without a finite value.

    Args:
        values: shape (n,), in any order.
    """
    finite = values[np.isfinite(values)]
    if not len(finite):
        return None
    low, high = float(finite.min()), float(finite.max())
    # values that are all the same, but for rounding, still need a width
    width = max(high - low, 1e-9 * max(abs(low), abs(high), 1e-9))
    edges = low + width * np.arange(_BINS + 1) / _BINS
    counts = np.bincount(np.clip((finite - low) / width * _BINS, 0, _BINS - 1).astype(int), minlength=_BINS)
    return Histogram(tuple(edges.tolist()), tuple(counts.tolist()))


def _check_inside(name: str, value: float) -> None:
    if not 0.0 < value < 1.0:
        raise DomainError(f"{name} = {value!r} is not between 0 and 1")
