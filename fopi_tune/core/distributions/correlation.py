"""Correlated uncertain numbers:  u in (0, 1)^p, independent -> u in (0, 1)^p, correlated (a Gaussian copula).

    z = Phi^-1(u),  z' = L z,  u' = Phi(z'),  L L^T = R the matrix of correlation coefficients.

Each column stays uniform, so that each number keeps its own distribution.  Two normal numbers then have the coefficient
rho as their (Pearson) correlation; of other distributions it is that of the normal numbers behind them, and the rank
correlation (Spearman's) is (6/pi) asin(rho/2).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from fopi_tune.core.bode_form import Array
from fopi_tune.errors import DomainError

#: the least pivot of a matrix of correlations: below it some number would be all but fixed by the others
_LEAST_PIVOT = 1e-6
#: ends of what is drawn in (0, 1)
_LEAST, _MOST = 2.0**-54, 1.0 - 2.0**-53


@dataclass(frozen=True)
class Correlation:
    """Two uncertain numbers that vary together.

    Args:
        numbers: their names.
        coefficient: correlation, between -1 and 1.
    """

    numbers: tuple[str, str]
    coefficient: float

    def __post_init__(self) -> None:
        if self.numbers[0] == self.numbers[1] or not -1.0 < self.coefficient < 1.0:
            raise DomainError(f"{self} is no correlation of two numbers, between -1 and 1")


def correlated(u: Array, names: Sequence[str], correlations: Sequence[Correlation]) -> Array:
    """Points of the unit cube, shape (n, p), whose columns are correlated; others keep their bits.

    Args:
        u: independent ones, shape (n, p), in (0, 1).
        names: of the columns.
        correlations: of pairs of columns; pairs that are left out are not correlated.

    Raises:
        DomainError: see `factor_of`.
    """
    from scipy import special

    places, factor = factor_of(names, correlations)
    found = np.array(u)
    normal = special.ndtri(u[:, places])
    for row, place in enumerate(places):
        if row == 0:
            continue  # L begins with 1
        # sums in a fixed order: a draw does not depend on its neighbours
        z = factor[row, 0] * normal[:, 0]
        for column in range(1, row + 1):
            z = z + factor[row, column] * normal[:, column]
        found[:, place] = np.clip(special.ndtr(z), _LEAST, _MOST)
    return found


def factor_of(names: Sequence[str], correlations: Sequence[Correlation]) -> tuple[list[int], Array]:
    """The columns that are correlated, k of them ascending, and Cholesky's factor L of their matrix, shape (k, k).

    Args:
        names: of the columns.
        correlations: of pairs of columns.

    Raises:
        DomainError: a name that no column has, a pair that is there twice, or coefficients that cannot hold together:
            a matrix of correlations has no negative eigenvalue.
    """
    named = {name for each in correlations for name in each.numbers}
    if unknown := sorted(named - set(names)):
        raise DomainError(f"{unknown[0]} is not among the numbers that are drawn")
    pairs = [frozenset(each.numbers) for each in correlations]
    if len(set(pairs)) < len(pairs):
        raise DomainError("a pair of numbers has two correlations; write one")
    places = [place for place, name in enumerate(names) if name in named]
    row_of = {names[place]: row for row, place in enumerate(places)}
    matrix = np.eye(len(places))
    for each in correlations:
        i, j = (row_of[name] for name in each.numbers)
        matrix[i, j] = matrix[j, i] = each.coefficient
    try:
        factor = np.linalg.cholesky(matrix)
    except np.linalg.LinAlgError:
        factor = np.zeros_like(matrix)
    if len(places) and float(np.diag(factor).min()) ** 2 < _LEAST_PIVOT:
        raise DomainError(
            "these correlations cannot hold together: where two numbers go with a third, they go with each other too; "
            "write smaller coefficients, or the missing pair"
        )
    return places, np.asarray(factor, dtype=float)
