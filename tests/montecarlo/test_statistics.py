"""Fractions, quantiles and tallies: against SciPy, published tables, coverage by simulation, and brute force."""

from __future__ import annotations

import functools
import itertools
import math
import random
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import stats

from fopi_tune.errors import DomainError
from fopi_tune.montecarlo.statistics import Quantile, fraction, quantiles
from fopi_tune.montecarlo.tally import IndexedValue, Tally, Worst, merge, tally

Array = NDArray[np.float64]

# --- fractions ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("confidence", [0.5, 0.95, 0.999999])
@pytest.mark.parametrize(("met", "total"), [(0, 1), (1, 1), (3, 10), (0, 500), (500, 500), (9999, 10_000)])
def test_the_interval_is_scipys_exact_one(met: int, total: int, confidence: float) -> None:
    ours = fraction(met, total, confidence)
    theirs = stats.binomtest(met, total).proportion_ci(confidence, method="exact")
    at_least = stats.binomtest(met, total, alternative="greater").proportion_ci(confidence, method="exact")
    at_most = stats.binomtest(met, total, alternative="less").proportion_ci(confidence, method="exact")
    # SciPy takes 1 - tail where the tail is small: digits of the tail are lost, 1e-16/5e-7 here
    expected = (theirs.low, theirs.high, at_least.low, at_most.high)
    np.testing.assert_allclose((ours.low, ours.high, ours.at_least, ours.at_most), expected, rtol=1e-9, atol=0.0)


@pytest.mark.parametrize(
    ("met", "total", "low", "high"),
    [
        # R. G. Newcombe, Statistics in Medicine 17 (1998), table I, method 5
        (81, 263, 0.2527, 0.3676),
        (15, 148, 0.0578, 0.1617),
        (0, 20, 0.0, 0.1684),
        (1, 29, 0.0009, 0.1776),
        # the usual tables for n = 10
        (0, 10, 0.0, 0.3085),
        (1, 10, 0.0025, 0.4450),
        (5, 10, 0.1871, 0.8129),
    ],
)
def test_the_interval_is_that_of_published_tables(met: int, total: int, low: float, high: float) -> None:
    ours, mirrored = fraction(met, total), fraction(total - met, total)
    # four digits are printed
    assert (ours.low, ours.high) == pytest.approx((low, high), abs=5.1e-5)
    assert (1 - mirrored.high, 1 - mirrored.low) == pytest.approx((low, high), abs=5.1e-5)


@pytest.mark.parametrize(("met", "total"), [(9_999_990, 10_000_000), (12, 10_000_000), (5_000_000, 10_000_000)])
def test_the_interval_solves_its_equations_for_ten_million_draws(met: int, total: int) -> None:
    ours = fraction(met, total)
    at_low, at_high = stats.binom.sf(met - 1, total, ours.low), stats.binom.cdf(met, total, ours.high)
    # the tail moves by about its size times sqrt(total) times the ends' relative rounding of 1e-16, and SciPy's error
    assert float(at_low) == pytest.approx(0.025, rel=1e-8)
    assert float(at_high) == pytest.approx(0.025, rel=1e-8)


def test_when_all_or_none_are_met_one_side_gets_the_whole_risk() -> None:
    every, none = fraction(1000, 1000, 0.99), fraction(0, 1000, 0.99)
    # (1 - c)^(1/n), to roundings
    assert every.at_least == pytest.approx(0.01 ** (1 / 1000), rel=1e-13)
    assert none.at_most == pytest.approx(1 - 0.01 ** (1 / 1000), rel=1e-12)
    assert every.low < every.at_least
    assert (every.high, every.at_most, none.low, none.at_least) == (1.0, 1.0, 0.0, 0.0)
    assert (every.estimate, none.estimate) == (1.0, 0.0)


@pytest.mark.parametrize("total", [10, 37])
@pytest.mark.parametrize("confidence", [0.8, 0.95])
def test_every_promise_is_kept_whatever_the_true_fraction(total: int, confidence: float) -> None:
    p = np.linspace(0.0005, 0.9995, 2000)
    kept = np.zeros((3, len(p)))
    for met in range(total + 1):
        found = fraction(met, total, confidence)
        chance = stats.binom.pmf(met, total, p)
        kept[0] += chance * ((found.low <= p) & (p <= found.high))
        kept[1] += chance * (found.at_least <= p)
        kept[2] += chance * (p <= found.at_most)
    # exact sums, so only roundings
    assert kept.min() >= confidence - 1e-12


# --- quantiles ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("n", "low", "high", "coverage"),
    # ranks of the median's 95 % interval as in the sign test's tables, and the exact coverage
    [(6, 1, 6, 0.9688), (10, 2, 9, 0.9785), (15, 4, 12, 0.9648), (20, 6, 15, 0.9586), (100, 40, 61, 0.9648)],
)
def test_the_medians_interval_is_that_of_the_tables(n: int, low: int, high: int, coverage: float) -> None:
    (found,) = quantiles(np.random.default_rng(1).permutation(np.arange(1.0, n + 1)), [0.5])
    assert (found.low, found.high) == (low, high)
    assert found.value == math.ceil(n / 2)
    assert found.coverage == pytest.approx(coverage, abs=5.1e-5)


@pytest.mark.parametrize("n", [1, 2, 9, 30, 59, 250])
@pytest.mark.parametrize("q", [0.001, 0.1, 0.5, 0.77, 0.95])
@pytest.mark.parametrize("confidence", [0.5, 0.95])
def test_the_interval_is_the_smallest_about_its_middle_that_suffices(n: int, q: float, confidence: float) -> None:
    (found,) = quantiles(np.arange(1.0, n + 1), [q], confidence)
    middle = round((n + 1) * q, 9)
    k, coverage = -1, 0.0
    r = s = 0
    while coverage < confidence:
        k += 1
        r, s = math.floor(middle) - k, math.ceil(middle) + k
        inside = [b for b in range(n + 1) if (r < 1 or r <= b) and (s > n or b <= s - 1)]
        coverage = math.fsum(stats.binom.pmf(inside, n, q))
    assert (found.low, found.high) == (r if r >= 1 else None, s if s <= n else None)
    # a sum of probabilities against a difference of SciPy's distribution function
    assert found.coverage == pytest.approx(coverage, abs=1e-11)
    assert (found.low or 0) <= found.value <= (found.high or n)


def test_an_end_without_an_order_statistic_is_none() -> None:
    # 59 draws are the fewest whose greatest bounds the 95 % quantile with 95 %
    (few,) = quantiles(np.arange(5.0), [0.99])
    assert few.high is None
    assert few.low is not None
    (one,) = quantiles(np.array([3.0]), [0.5])
    assert (one.low, one.value, one.high, one.coverage) == (None, 3.0, None, 1.0)


def test_a_whole_rank_survives_the_roundings_of_its_probability() -> None:
    # 0.1 * 30 and 0.7 * 10 are not whole in floats
    assert quantiles(np.arange(1.0, 31.0), [0.1])[0].value == 3.0
    assert quantiles(np.arange(1.0, 11.0), [0.7])[0].value == 7.0


@pytest.mark.thinned(4)
@pytest.mark.parametrize("q", [0.05, 0.5, 0.99])
@pytest.mark.parametrize("kind", ["continuous", "lumpy", "often infinite"])
def test_the_quantiles_interval_covers_the_truth(q: float, kind: str) -> None:
    runs, n = 500, 120
    u = np.random.default_rng(20).random((runs, n))
    if kind == "continuous":
        draws, truth = -np.log1p(-u), -math.log1p(-q)
    elif kind == "lumpy":
        draws, truth = np.floor(5 * u), math.ceil(5 * q) - 1.0
    else:
        draws, truth = np.where(u > 0.5, np.inf, u), q if q <= 0.5 else math.inf
    held, coverage = 0, 0.0
    for row in draws:
        (found,) = quantiles(row, [q])
        low = -math.inf if found.low is None else found.low
        coverage = found.coverage
        held += low <= truth <= (math.inf if found.high is None else found.high)
    # four standard deviations of the count of held promises
    assert held >= runs * 0.95 - 4 * math.sqrt(runs * 0.95 * 0.05)
    if kind == "continuous":
        assert held == pytest.approx(runs * coverage, abs=4 * math.sqrt(runs * 0.95 * 0.05))


def test_infinite_values_rank_as_values() -> None:
    values = np.array([math.inf, 1.0, -math.inf, 2.0, math.inf] * 20)
    low, middle, high = quantiles(values, [0.1, 0.5, 0.9])
    assert (low.value, middle.value, high.value) == (-math.inf, 2.0, math.inf)
    assert high.high == math.inf


# --- tallies --------------------------------------------------------------------------------------------------------


def state(found: Tally) -> tuple[Any, ...]:
    """Everything of a tally, for comparison bit for bit."""
    return found.met, found.total, found.worst, found.best, found.values().tobytes()


def pieces(values: Array, worst_are: Worst, keep: int = 7) -> list[Tally]:
    cuts = [0, 1, 2, 50, 50, 333, 334, 800, len(values)]
    return [tally(values[a:b], values[a:b] > 0.0, a, worst_are, keep) for a, b in itertools.pairwise(cuts)]


@pytest.mark.parametrize("worst_are", Worst)
@pytest.mark.parametrize("kind", ["distinct", "many equal", "many infinite"])
def test_merging_in_any_order_and_grouping_gives_the_same_bits(worst_are: Worst, kind: str) -> None:
    values = np.random.default_rng(3).standard_normal(1000)
    if kind == "many equal":
        values = np.round(values)
    elif kind == "many infinite":
        values[::3], values[1::7] = math.inf, -math.inf
    whole = tally(values, values > 0.0, 0, worst_are, 7)
    shuffler = random.Random(4)
    for _ in range(20):
        parts = pieces(values, worst_are)
        shuffler.shuffle(parts)
        cut = shuffler.randrange(1, len(parts))
        grouped = merge([merge(parts[:cut]), merge(parts[cut:])])
        one_by_one = functools.reduce(lambda a, b: merge([a, b]), parts)
        assert state(grouped) == state(one_by_one) == state(whole)
    sign = worst_are.value
    ranked = sorted((sign * v, i) for i, v in enumerate(values.tolist()))
    assert [(sign * found.value, found.index) for found in whole.worst] == ranked[:7]
    assert whole.best is not None
    assert (sign * whole.best.value, -whole.best.index) == max((v, -i) for v, i in ranked)
    assert whole.met == sum(v > 0.0 for v in values.tolist())


def test_a_tally_answers_for_the_whole_sample() -> None:
    values = np.random.default_rng(5).standard_normal(1000)
    whole = merge(pieces(values, Worst.SMALLEST))
    assert whole.fraction(0.9) == fraction(int((values > 0).sum()), 1000, 0.9)
    assert whole.quantiles([0.5, 0.01]) == quantiles(values, [0.5, 0.01])
    assert isinstance(whole.quantiles([0.5])[0], Quantile)


def test_a_chunk_with_fewer_draws_than_are_kept_or_none_is_fine() -> None:
    none = tally(np.empty(0), np.empty(0, dtype=bool), 0, Worst.LARGEST)
    two = tally(np.array([1.0, 3.0]), np.array([True, False]), 8, Worst.LARGEST)
    both = merge([none, two])
    assert both.worst == (IndexedValue(3.0, 9), IndexedValue(1.0, 8))
    assert (both.best, both.met, both.total) == (IndexedValue(1.0, 8), 1, 2)
    assert (none.total, none.best, none.values().shape) == (0, None, (0,))


def test_a_tally_keeps_its_values_whatever_becomes_of_the_array() -> None:
    mine = np.array([1.0, 2.0])
    kept = tally(mine, mine > 1.5, 0, Worst.LARGEST)
    mine[:] = 9.0
    assert kept.values().tolist() == [1.0, 2.0]


def small(first: int = 0, worst_are: Worst = Worst.SMALLEST, keep: int = 3) -> Tally:
    return tally(np.arange(4.0), np.ones(4, dtype=bool), first, worst_are, keep)


@pytest.mark.parametrize(
    ("make", "complaint"),
    [
        (lambda: fraction(1, 0), "total >= 1"),
        (lambda: fraction(-1, 5), "0 <= met <= total"),
        (lambda: fraction(6, 5), "0 <= met <= total"),
        (lambda: fraction(1, 5, 1.0), "confidence = 1.0 is not between 0 and 1"),
        (lambda: fraction(1, 5, math.nan), "confidence = nan"),
        (lambda: quantiles(np.empty(0), [0.5]), "no values"),
        (lambda: quantiles(np.ones((2, 2)), [0.5]), "shape"),
        (lambda: quantiles(np.array([1.0, math.nan]), [0.5]), "value 1 is not a number"),
        (lambda: quantiles(np.ones(3), [0.0]), "probability = 0.0"),
        (lambda: quantiles(np.ones(3), [0.5], 0.0), "confidence = 0.0"),
        (lambda: tally(np.array([math.nan]), np.array([True]), 0, Worst.LARGEST), "value 0 is not a number"),
        (lambda: tally(np.ones(2), np.array([True]), 0, Worst.LARGEST), "met must be"),
        (lambda: tally(np.ones(2), np.array([1, 0]), 0, Worst.LARGEST), "met must be"),
        (lambda: small(first=-1), "first = -1"),
        (lambda: small(keep=0), "keep = 0"),
        (lambda: merge([]), "nothing to merge"),
        (lambda: merge([small(0), small(3)]), "draw 3 was counted twice"),
        (lambda: merge([small(), small(4, Worst.LARGEST)]), "differ in what is the worst"),
        (lambda: merge([small(), small(4, keep=4)]), "how many to keep"),
        (lambda: tally(np.empty(0), np.empty(0, dtype=bool), 0, Worst.LARGEST).fraction(), "total >= 1"),
        (lambda: tally(np.empty(0), np.empty(0, dtype=bool), 0, Worst.LARGEST).quantiles([0.5]), "no values"),
    ],
)
def test_what_cannot_be_counted_is_refused_by_name(make: Any, complaint: str) -> None:
    with pytest.raises(DomainError, match=complaint):
        make()
