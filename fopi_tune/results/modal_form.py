"""Modal state space:  poles and residues instead of expanded polynomials, whose coefficients lose digits.

    x' = A x + b u,  y = c x + direct u,     A block-diagonal and real:                                              (1)

a real pole is a block of its own; a complex pair p, conj p is [[Re p, Im p], [-Im p, Re p]]; poles that (nearly)
repeat share a block, with these on its diagonal and couplings above it: a Jordan block where they are equal.  On
samples the same holds of z, with x at the next sample for x'.

Two systems in series are (1) again after x_2 = z_2 + X x_1, where X solves, block by block,

    A_2 X - X A_1 + b_2 c_1 = 0   (for real poles  X = b_2 c_1/(p_1 - p_2)),                                         (2)

but for blocks whose poles are nearly equal, which stay coupled.

Source: Golub and Van Loan, Matrix Computations, 4th ed., 2013, section 7.6 (block diagonalisation).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import chain, pairwise

import numpy as np
from numpy.typing import NDArray

from fopi_tune.core.bode_form import Array

#: poles whose distance is below this share of their own size count as repeated: of one polynomial, where many can be
#: close, and of two systems; X of (2) grows with the share's inverse
_CLOSE_ROOTS, _CLOSE = 0.05, 1e-3
#: the same of the loop's rate: seen at that rate, an integrator and a pole this slow are two integrators
_SLOW = 1e-2
#: shares within which roots are tried as equal, which the polynomial confirms
_EQUAL = (0.5, 0.1, 0.01)
#: relative to the coefficients' size; equal poles are taken to be exactly equal if the polynomial changes by less
_ROUNDING = 1e-13


@dataclass(frozen=True)
class ModalForm:
    """A system as in (1).

    Args:
        a: shape (n, n), rad/s, or without unit on samples.
        b: shape (n,).
        c: shape (n,).
        direct: the direct path.
        blocks: the poles of each block of A in order, with both of a pair.
    """

    a: Array
    b: Array
    c: Array
    direct: float
    blocks: tuple[tuple[complex, ...], ...]

    @classmethod
    def of_residues(cls, poles: Sequence[float], residues: Sequence[float], direct: float) -> ModalForm:
        """direct + sum_k residue_k/(s - pole_k), all real and different."""
        found = np.array(residues, dtype=float)
        size = np.sqrt(np.abs(found))
        blocks = tuple((complex(pole),) for pole in poles)
        return cls(np.diag(np.array(poles, dtype=float)), size, np.sign(found) * size, direct, blocks)

    @classmethod
    def of_polynomials(cls, numerator: Sequence[float], denominator: Sequence[float], rate: float = 0.0) -> ModalForm:
        """N/D, coefficients in descending powers, D[0] not 0 and N of no higher degree; `rate` as for `in_series`.

        With 1/D in the form (1) and N_1 = N - direct D, the output's row is c N_1(A).
        """
        bottom, top = np.array(denominator, dtype=float), np.zeros(len(denominator))
        given = np.trim_zeros(np.array(numerator, dtype=float), "f")
        top[len(top) - len(given) :] = given
        direct = float(top[0] / bottom[0])
        form, scale = cls(np.zeros((0, 0)), np.zeros(0), np.zeros(0), 1.0, ()), float(bottom[0])
        for pole in _poles(bottom):
            section, gain = _section(pole)
            form, scale = in_series(form, section, rate, close=_CLOSE_ROOTS), scale * gain
        row = np.zeros(len(form.a))
        for coefficient in (top - direct * bottom)[1:]:
            row = row @ form.a + coefficient * form.c
        return cls(form.a, form.b, row / scale, direct, form.blocks).balanced()

    def balanced(self) -> ModalForm:
        """The same with b and c of equal size in each block."""
        scale, start = np.ones(len(self.a)), 0
        for block in self.blocks:
            end = start + len(block)
            b, c = np.linalg.norm(self.b[start:end]), np.linalg.norm(self.c[start:end])
            if b > 0.0 and c > 0.0:
                scale[start:end] = math.sqrt(c / b)
            start = end
        return ModalForm(self.a, self.b * scale, self.c / scale, self.direct, self.blocks)

    def plus(self, gain: float) -> ModalForm:
        """The system with `gain` beside it."""
        return replace(self, direct=self.direct + gain)

    def in_units_of(self, time_s: float) -> ModalForm:
        """The system with s replaced by s time_s."""
        rate = 1.0 / time_s
        size, blocks = math.sqrt(rate), tuple(tuple(rate * pole for pole in block) for block in self.blocks)
        return ModalForm(self.a * rate, self.b * size, self.c * size, self.direct, blocks)

    def behind_hold(self, sample_time_s: float, part: float) -> ModalForm:
        """The samples of a continuous system behind a zero-order hold, without the whole samples of its delay.

        With the delay of d + f samples and g_0, g_1 of `fopi_tune.core.sampled_loops`, (1), the system is z^-d times

            c (zI - Phi)^-1 g_0                         if f = 0 and there is no direct path,
            z^-1 (c (zI - Phi)^-1 (Phi g_0 + g_1) + c g_0 + direct)          otherwise.

        Returns:
            The form without z^-d and z^-1.
        """
        n = len(self.a)
        phi, g0, g1 = np.zeros((n, n)), np.zeros(n), np.zeros(n)
        start = 0
        for block in self.blocks:
            inside = slice(start, start + len(block))
            a, b = self.a[inside, inside], self.b[inside]
            phi[inside, inside], _ = _held(a, b, sample_time_s)
            _, g0[inside] = _held(a, b, (1.0 - part) * sample_time_s)
            moved, late = _held(a, b, part * sample_time_s)[1], 1.0 - part
            g1[inside] = _held(a, b, late * sample_time_s)[0] @ moved
            start = inside.stop
        blocks = tuple(tuple(complex(np.exp(pole * sample_time_s)) for pole in block) for block in self.blocks)
        if part == 0.0 and self.direct == 0.0:
            return ModalForm(phi, g0, self.c, 0.0, blocks).balanced()
        direct = float(self.c @ g0) + self.direct
        return ModalForm(phi, phi @ g0 + g1, self.c, direct, blocks).balanced()


def in_series(
    first: ModalForm, second: ModalForm, rate: float = 0.0, origin: float = 0.0, close: float = _CLOSE
) -> ModalForm:
    """second times first, as in (2).

    Args:
        first: what the input enters.
        second: what the first one's output enters.
        rate: rad/s (on samples: per sample), where the product is of interest: a loop's crossover.
        origin: from where distances of poles are measured: s = 0, and z = 1 on samples.
        close: poles nearer than this share of their size stay coupled.
    """
    coupling, x = np.outer(second.b, first.c), np.zeros((len(second.b), len(first.c)))
    kept, together = np.zeros(x.shape), []
    for i, (rows, theirs) in enumerate(_spans(second)):
        for j, (columns, ours) in enumerate(_spans(first)):
            if _are_close(theirs, ours, rate, origin, close):
                kept[rows, columns] = coupling[rows, columns]
                together.append((i, len(second.blocks) + j))
            else:
                x[rows, columns] = _solve(second.a[rows, rows], first.a[columns, columns], coupling[rows, columns])
    a = np.block([[second.a, kept], [np.zeros(kept.T.shape), first.a]])
    b = np.concatenate([second.b * first.direct - x @ first.b, first.b])
    c = np.concatenate([second.c, second.direct * first.c + second.c @ x])
    blocks = (*second.blocks, *first.blocks)
    groups = _groups(len(blocks), together)
    ends = np.cumsum([0, *map(len, blocks)])
    states = [k for group in groups for one in group for k in range(ends[one], ends[one + 1])]
    merged = tuple(tuple(chain.from_iterable(blocks[one] for one in group)) for group in groups)
    direct = first.direct * second.direct
    return ModalForm(a[np.ix_(states, states)], b[states], c[states], direct, merged).balanced()


def _poles(denominator: Array) -> list[complex]:
    """The roots, of a pair the one above the real axis; those that repeat up to rounding are equal."""
    roots = np.roots(denominator).astype(complex)
    # what each coefficient's terms amount to
    size = np.poly(-np.abs(roots)).real * abs(denominator[0])
    for close in _EQUAL:
        near = [(i, j) for j in range(len(roots)) for i in range(j) if _near(roots[i], roots[j], close)]
        for group in _groups(len(roots), near):
            equal, mean = roots.copy(), complex(roots[group].mean())
            equal[group] = mean.real if abs(mean.imag) <= close * abs(mean) else mean
            if len(group) > 1 and np.all(np.abs(np.poly(equal) * denominator[0] - denominator) <= _ROUNDING * size):
                roots = equal
    return sorted((complex(root) for root in roots if root.imag >= 0.0), key=abs)


def _section(pole: complex) -> tuple[ModalForm, float]:
    """gain/(s - p), or gain/((s - p)(s - conj p)), of unit gain at s = 0 if p is not 0; and the gain."""
    size = abs(pole) or 1.0
    if pole.imag == 0.0:
        root = np.array([math.sqrt(size)])
        return ModalForm(np.array([[pole.real]]), root, root, 0.0, ((pole,),)), size
    # with a small imaginary part the block goes over into one of a repeated pole
    across = pole.imag if pole.imag > _CLOSE_ROOTS * size else size
    a = np.array([[pole.real, across], [-(pole.imag**2) / across, pole.real]])
    return ModalForm(a, np.array([0.0, size]), np.array([1.0, 0.0]), 0.0, ((pole, pole.conjugate()),)), size * across


def _held(a: Array, b: Array, time_s: float) -> tuple[Array, Array]:
    """e^{A t} and int_0^t e^{A s} b ds of one block."""
    from scipy.linalg import expm

    if len(a) == 1:
        exponent = float(a[0, 0]) * time_s
        ratio = math.expm1(exponent) / exponent if exponent else 1.0
        return np.array([[math.exp(exponent)]]), time_s * ratio * b
    n = len(a)
    whole = np.zeros((n + 1, n + 1))
    whole[:n, :n], whole[:n, n] = a * time_s, b * time_s
    moved = np.asarray(expm(whole), dtype=np.float64)
    return moved[:n, :n], moved[:n, n]


def _solve(second: Array, first: Array, coupling: Array) -> Array:
    """X of second X - X first + coupling = 0."""
    if second.size == first.size == 1:
        return coupling / (first - second)
    n, m = coupling.shape
    system = np.kron(second, np.eye(m)) - np.kron(np.eye(n), first.T)
    solved = np.asarray(np.linalg.solve(system, -coupling.ravel()), dtype=np.float64)
    return solved.reshape(n, m)


def _spans(form: ModalForm) -> list[tuple[slice, tuple[complex, ...]]]:
    ends = np.cumsum([0, *map(len, form.blocks)]).tolist()
    return [(slice(low, high), block) for (low, high), block in zip(pairwise(ends), form.blocks, strict=True)]


def _are_close(one: tuple[complex, ...], other: tuple[complex, ...], rate: float, origin: float, close: float) -> bool:
    return any(_near(p - origin, q - origin, close) or abs(p - q) <= _SLOW * rate for p in one for q in other)


def _near(p: complex, q: complex, close: float) -> bool:
    return abs(p - q) <= close * max(abs(p), abs(q))


def _groups(count: int, pairs: Sequence[tuple[int, int]]) -> list[NDArray[np.intp]]:
    """The numbers below `count` in groups that the pairs connect, each in order, by their first."""
    label = np.arange(count)
    for i, j in pairs:
        label[label == label[j]] = label[i]
    return [np.flatnonzero(label == one) for one in dict.fromkeys(label.tolist())]
