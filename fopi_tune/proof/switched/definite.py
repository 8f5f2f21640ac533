"""Symmetric matrices of balls:  stored lower triangles, and an interval LDL' factorisation that proves definiteness.

A symmetric matrix is positive definite exactly when all pivots of

    d_j = a_jj - sum_{k<j} l_jk^2 d_k,     l_ij = (a_ij - sum_{k<j} l_ik l_jk d_k)/d_j                              (1)

are positive.  In balls the pivots enclose those of every matrix inside, so that positive balls are a proof.

Source: the LDL' factorisation, as in Golub and Van Loan, Matrix Computations, 2013, section 4.1.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from flint import arb, arb_mat

from fopi_tune.core.bode_form import Array

#: rows of a lower triangle, the first of length 1
Triangle = tuple[tuple[float, ...], ...]


def is_positive_definite(matrix: arb_mat) -> bool:
    """Whether (1) shows that every symmetric matrix inside is positive definite; only the lower triangle is read."""
    size = matrix.nrows()
    rest = [[matrix[i, j] for j in range(i + 1)] for i in range(size)]
    for j in range(size):
        pivot = rest[j][j]
        if not pivot > 0:
            return False
        column = {i: rest[i][j] / pivot for i in range(j + 1, size)}
        for i in range(j + 1, size):
            for k in range(j + 1, i + 1):
                rest[i][k] = rest[i][k] - column[i] * rest[k][j]
    return True


def symmetric(triangle: Sequence[Sequence[float]]) -> arb_mat:
    """The symmetric matrix of a lower triangle, exact."""
    size = len(triangle)
    return arb_mat([[arb(triangle[max(i, j)][min(i, j)]) for j in range(size)] for i in range(size)])


def lower_triangle(matrix: Array) -> Triangle:
    """The lower triangle of the symmetric part of a matrix, shape (n, n)."""
    even = 0.5 * (matrix + matrix.T)
    return tuple(tuple(float(number) for number in even[i, : i + 1]) for i in range(len(even)))


def midpoints(matrix: arb_mat) -> Array:
    """The midpoints as doubles, shape (m, n): for searches, which prove nothing."""
    return np.array([[float(entry.mid()) for entry in row] for row in matrix.tolist()], dtype=float)


def quadratic_norm(matrix: arb_mat, column: arb_mat) -> arb:
    """sqrt(z' P z) of a positive definite P, where `column` is z, shape (n, 1)."""
    square = (column.transpose() * matrix * column)[0, 0]
    # rounding may leave the ball of a tiny square with negative numbers in it
    return abs(square).sqrt()


def not_below(number: arb) -> float:
    """The least double, or the one after it, that no number of the ball is above."""
    found = float(number.upper())
    return found if arb(found) >= number else math.nextafter(found, math.inf)
