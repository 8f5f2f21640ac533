"""Bounds of rounding hold against exact fractions, and inverses that are none are refused."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest

from fopi_tune.core.bode_form import Array
from fopi_tune.proof.time_domain.bounded import Causal, Delays, Signals

K = 40
Exact = list[list[Fraction]]


def exact(matrix: Array) -> Exact:
    return [[Fraction(float(x)) for x in row] for row in matrix]


def product(one: Exact, two: Exact) -> Exact:
    columns = list(zip(*two, strict=True))
    return [[sum((a * b for a, b in zip(row, column, strict=True)), Fraction(0)) for column in columns] for row in one]


def distance(one: Exact, values: Array) -> float:
    """The norm of a difference."""
    return float(max(sum(row) for row in differences(one, values)))


def differences(one: Exact, values: Array) -> Exact:
    rows = zip(one, values.tolist(), strict=True)
    return [[abs(a - Fraction(b)) for a, b in zip(x, y, strict=True)] for x, y in rows]


def operators() -> list[Causal]:
    rng = np.random.default_rng(7)
    series = np.concatenate([[1.0], 0.3 * rng.standard_normal(K - 1)])
    matrix = np.tril(rng.standard_normal((K, K))) * 0.1
    np.fill_diagonal(matrix, 1.0)
    return [Causal(series), Causal(matrix)]


@pytest.mark.thinned(3)
@pytest.mark.parametrize("first", [0, 1])
@pytest.mark.parametrize("second", [0, 1])
def test_products_and_signals(first: int, second: int) -> None:
    one, two = operators()[first], operators()[second]
    both = one.after(two)
    assert distance(product(exact(one.matrix), exact(two.matrix)), both.matrix) <= both.error
    assert both.error < 1e-10
    signals = Signals.exactly(np.random.default_rng(8).standard_normal((K, 3)))
    found = one.apply(signals)
    true = product(exact(one.matrix), exact(signals.values))
    off = np.array(differences(true, found.values), dtype=float)
    assert np.all(off.max(axis=0) <= found.errors)


@pytest.mark.thinned(2)
@pytest.mark.parametrize("kind", [0, 1])
def test_short_polynomials_before_and_after(kind: int) -> None:
    own, short = operators()[kind], Delays(np.array([0.5, -0.3]), 2)
    series = exact(Causal(short.series(K)).matrix)
    before, after = own.after_delays(short), own.delayed(short)
    assert distance(product(exact(own.matrix), series), before.matrix) <= before.error
    assert distance(product(series, exact(own.matrix)), after.matrix) <= after.error
    assert np.allclose(short.apply(Signals.exactly(np.eye(K))).values, np.array(series, dtype=float))


@pytest.mark.parametrize("kind", [0, 1])
def test_an_inverse_is_as_near_as_it_says(kind: int) -> None:
    own = operators()[kind]
    found = own.inverse()
    assert found is not None
    # column by column in exact fractions
    matrix, true = exact(own.matrix), [[Fraction(0)] * K for _ in range(K)]
    for j in range(K):
        for i in range(j, K):
            rest = Fraction(int(i == j)) - sum((matrix[i][k] * true[k][j] for k in range(j, i)), Fraction(0))
            true[i][j] = rest / matrix[i][i]
    assert distance(true, found.matrix) <= found.error
    assert found.error < 1e-8


def test_an_operator_that_is_not_known_well_has_no_inverse() -> None:
    series = np.concatenate([[1.0], np.full(K - 1, 1.0)])
    assert Causal(series, error=1.0).inverse() is None
    assert Causal(np.concatenate([[1.0], np.full(K - 1, -1e30)])).inverse() is None


def test_norms_are_those_up_to_each_sample() -> None:
    for own in operators():
        sums = np.abs(own.matrix).sum(axis=1)
        assert np.all(own.norms >= np.maximum.accumulate(sums))
        assert np.all(own.norms <= np.maximum.accumulate(sums) * (1.0 + 1e-12))


def test_long_series_are_no_matrices(monkeypatch: pytest.MonkeyPatch) -> None:
    series, signals = operators()[0], Signals.exactly(np.random.default_rng(8).standard_normal((K, 2)))
    expected = series.apply(signals)
    monkeypatch.setattr("fopi_tune.proof.time_domain.bounded._LONG", 10)
    found = series.apply(signals)
    assert np.all(np.abs(found.values - expected.values) <= found.errors + expected.errors)
    assert found.errors == pytest.approx(expected.errors)
    assert series.apply(signals[:0]).values.shape == (K, 0)
