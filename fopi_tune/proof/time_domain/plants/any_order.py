"""Plants of any order behind a zero-order hold, with their derivatives.

    y = c x + b_0 v,  x' = A x + b v,  time in samples:   Phi = e^A,   W(t) = int_0^t e^{As} b ds                    (1)

With an input that is d + f samples late, g = W(1 - f) and h = e^{A(1 - f)} W(f), and E = Phi - I,

    det(delta - E) = sum_k d_k delta^(n-k),    c adj(delta - E) g = sum_k n_k delta^(n-1-k),    delta = z - 1,       (2)

    D(x) = sum_k d_k x^k (1 - x)^(n-k),        N(x) = x^{d+1} sum_k (n_k(g) + x n_k(h)) x^k (1 - x)^(n-1-k) .        (3)

A direct path b_0 adds x^{d+1} b_0 D(x) to N: at a sample y still has the input of before.  The coefficients of (2) come
from the recursion of Faddeev and LeVerrier, and e^A from the series of a part of A, squared; both with first and second
derivatives.  What a series leaves out after m terms is, in the norm |A| of row sums, at most |A|^m/m! e^|A|, and of its
derivatives what the derivative of that is.

Source: Astrom and Wittenmark, Computer-Controlled Systems, 3rd ed., 1997, sections 2.3 and 2.4.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from flint import arb, arb_mat

from fopi_tune.core.bode_form import Array
from fopi_tune.proof.time_domain.bounded import Delays
from fopi_tune.proof.time_domain.jets import Jet, pairs_of
from fopi_tune.proof.time_domain.models import Model, number_model
from fopi_tune.proof.time_domain.plants.held import HeldPlants, Polynomial, Start
from fopi_tune.proof.time_domain.plants.lateness import Lateness

#: size of the last term of a series, and most terms
_LAST, _MOST_TERMS = 1e-28, 400

Coefficients = tuple[list[Jet], list[Jet]]
#: n_k of the new input and of the old one
_Weights = tuple[list[Jet], list[Jet]]


def any_order(
    over: Coefficients, centre: Coefficients, radii: Array, ts: arb, late: tuple[Lateness, Lateness], start: Start,
    loaded: bool,
) -> HeldPlants:  # fmt: skip
    """The plants of a box.

    Args:
        over: numerator and denominator over the box, descending powers.
        centre: the same at its centre.
        radii: of the box.
        ts: Ts.
        late: of control and load.
        start: at rest.
        loaded: whether there is a load.
    """
    order = len(over[1]) - 1
    wide, narrow = _StateSpace(*over, ts), _StateSpace(*centre, ts, bent=False)
    kept = list(zip(wide.characteristic, narrow.characteristic, strict=True))
    # without dynamics, D(x) = 1
    nothing = ((Delays(np.zeros(1)), Model.constant(np.zeros(1), radii)),) if order == 0 else ()
    base = Delays(np.array(_basis(0, order)))
    terms = ((_delays(0, k, order), number_model(*kept[k], radii)) for k in range(1, order + 1))
    denominator = Polynomial(base, (*terms, *nothing))
    polynomials: list[Polynomial] = []
    weights: list[_Weights] = []
    for number, each in enumerate(late[: 2 if loaded else 1]):
        if number == 0 or not _same(each, late[0]):
            weights = [wide.weights(each.part), narrow.weights(each.centre)]
        polynomials.append(_inputs(wide, narrow, each, weights, radii))
    return HeldPlants(
        order=order,
        radii=radii,
        denominator=denominator,
        control=polynomials[0],
        load=polynomials[1] if loaded else None,
        past=start.past,
        output=start.output,
        kick=0.0,
        delay=(late[0].whole, late[1].whole),
        pole=None,
        gain=None,
        arrivals=(),
    )


def _basis(power: int, factors: int) -> list[int]:
    """x^power (1 - x)^(factors - power), ascending powers."""
    found = [1]
    for _ in range(factors - power):
        found = [a - b for a, b in zip([*found, 0], [0, *found], strict=True)]
    return [0] * power + found


def _delays(first: int, power: int, factors: int) -> Delays:
    return Delays(np.array(_basis(power, factors), dtype=float), first)


def _same(one: Lateness, other: Lateness) -> bool:
    """Whether two inputs are late by the same part of a sample."""
    pairs = zip((one.part.value, *one.part.slopes), (other.part.value, *other.part.slopes), strict=True)
    return all(bool(a.mid() == b.mid()) and bool(a.rad() == b.rad()) for a, b in pairs)


def _inputs(
    wide: _StateSpace, narrow: _StateSpace, late: Lateness, weights: Sequence[_Weights], radii: Array
) -> Polynomial:
    """N of (3); what a delay just beyond a whole number of samples changes is added to the rests."""
    order = wide.order
    wider = wide.most_change(late.beyond) * (1.0 + 1e-9) if late.beyond else 0.0
    (new, old), (new_0, old_0) = weights
    pairs = [(late.whole + 1, new, new_0)]
    if not late.is_whole:
        pairs.append((late.whole + 2, old, old_0))
    terms = [
        (_delays(first, k, order - 1), number_model(own[k], at[k], radii, wider))
        for first, own, at in pairs
        for k in range(order)
    ]
    if wide.direct is not None and narrow.direct is not None:
        # its delay is exact
        found = [
            number_model(wide.direct * own, narrow.direct * at, radii)
            for own, at in zip(wide.characteristic, narrow.characteristic, strict=True)
        ]
        terms += [(_delays(late.whole + 1, k, order), model) for k, model in enumerate(found)]
    if late.beyond:
        nothing = Model.constant(np.zeros(1), radii).wider(np.array([wider]))
        outer = [first for first in (late.whole, late.whole + 2 + (not late.is_whole)) if first]
        terms += [(_delays(first, k, order - 1), nothing) for first in outer for k in range(order)]
    return Polynomial(None, tuple(terms))


@dataclass(frozen=True, eq=False)
class _Exponential:
    """e^M of a matrix of jets: its value and its derivatives."""

    value: arb_mat
    slopes: list[arb_mat]
    pairs: list[arb_mat]

    def entry(self, i: int, j: int) -> Jet:
        """One number of it."""
        return Jet(self.value[i, j], tuple(m[i, j] for m in self.slopes), tuple(m[i, j] for m in self.pairs))


class _StateSpace:
    """(1) and (2) of plants whose coefficients are jets; at a centre second derivatives are not needed."""

    def __init__(self, numerator: Sequence[Jet], denominator: Sequence[Jet], ts: arb, bent: bool = True) -> None:
        self._bent = bent
        leading, n = denominator[0], len(denominator) - 1
        self.order, self.axes = n, len(leading.slopes)
        # time in samples: coefficients of descending powers times Ts^0, Ts^1, ...
        self.top = [-(c / leading) * ts**k for k, c in enumerate(denominator[1:], 1)]
        self.direct = numerator[0] / leading if len(numerator) > n else None
        own = numerator if self.direct is None else numerator[1:]
        missing = n - len(own)
        rows = [Jet.constant(0, self.axes)] * missing
        self.c = [*rows, *(b / leading * ts ** (missing + 1 + k) for k, b in enumerate(own))]
        if self.direct is not None:
            self.c = [c + self.direct * a for c, a in zip(self.c, self.top, strict=True)]
        whole = _exponential(self.top, Jet.constant(1, self.axes), bent)
        phi = [[whole.entry(i, j) for j in range(n)] for i in range(n)]
        e = [[phi[i][j] - int(i == j) for j in range(n)] for i in range(n)]
        self.characteristic, self._adjoint = [Jet.constant(1, self.axes)], []
        b = [[Jet.constant(int(i == j), self.axes) for j in range(n)] for i in range(n)]
        for k in range(n):
            # c B_k, whose product with g is n_k
            self._adjoint.append([_total([self.c[i] * b[i][j] for i in range(n)]) for j in range(n)])
            eb = [[_total([e[i][h] * b[h][j] for h in range(n)]) for j in range(n)] for i in range(n)]
            self.characteristic.append(_total([eb[i][i] for i in range(n)]) * (arb(-1) / (k + 1)))
            b = [[eb[i][j] + self.characteristic[-1] if i == j else eb[i][j] for j in range(n)] for i in range(n)]
        for k in range(1, n + 1):
            # an integrator's pole is at z = 1 exactly
            if all(c.is_zero for c in denominator[k:]):
                self.characteristic[k] = Jet.constant(0, self.axes)

    def most_change(self, beyond: float) -> float:
        """By how much n_k may change where an input is late by so much of a sample more or less than a whole one.

        W(1) - e^{A s} W(1 - s) = W(s), and what is late by s in place of 0 moves e^{A (1 - s)} W(s).
        """
        late = Jet(arb(0).union(arb(beyond)), (), ())
        top = [Jet(x.value, (), ()) for x in self.top]
        early, moved = _exponential(top, late, False), _exponential(top, 1 - late, False)
        n, most = self.order, arb(0)
        for row in self._adjoint:
            column = [early.value[i, n] for i in range(n)]
            later = [sum((moved.value[i, j] * column[j] for j in range(n)), arb(0)) for i in range(n)]
            for each in (column, later):
                most = most.max(sum((abs(x.value * y) for x, y in zip(row, each, strict=True)), arb(0)))
        return float(most.upper())

    def weights(self, part: Jet) -> _Weights:
        """n_k of W(1 - part), and of e^{A (1 - part)} W(part)."""
        n = self.order
        late = _exponential(self.top, 1 - part, self._bent)
        new, old = [late.entry(i, n) for i in range(n)], [Jet.constant(0, self.axes)] * n
        if not part.is_zero:
            early = _exponential(self.top, part, self._bent)
            old = [_total([late.entry(i, j) * early.entry(j, n) for j in range(n)]) for i in range(n)]
        return self._products(new), self._products(old)

    def _products(self, column: Sequence[Jet]) -> list[Jet]:
        return [_total([x * y for x, y in zip(row, column, strict=True)]) for row in self._adjoint]


def _exponential(top: Sequence[Jet], time: Jet, bent_too: bool) -> _Exponential:
    """e^{M time}, M = [[A, b], [0, 0]] with the top row of A; second derivatives only where they are asked for."""
    n, axes = len(top), len(time.slopes)
    pairs = pairs_of(axes)
    rows = [[Jet.constant(0, axes) for _ in range(n + 1)] for _ in range(n + 1)]
    rows[0][:n] = [x * time for x in top]
    rows[0][n] = time
    for i in range(1, n):
        rows[i][i - 1] = time
    m = arb_mat([[x.value for x in row] for row in rows])
    first = [arb_mat([[x.slopes[j] for x in row] for row in rows]) for j in range(axes)]
    second = [arb_mat([[x.pairs[k] for x in row] for row in rows]) for k in range(len(pairs))]
    # e^M = (e^(M/2^halvings))^(2^halvings): the series of a large M cancels
    size = _norm(m)
    halvings = max(0, math.ceil(math.log2(size))) if 1.0 < size < math.inf else 0
    half = arb(2) ** -halvings
    m, first, second = m * half, [x * half for x in first], [x * half for x in second]
    size, slopes, bends = _norm(m), [_norm(x) for x in first], [_norm(x) for x in second]
    # the derivatives that are not 0
    moving = [j for j in range(axes) if slopes[j] > 0.0]
    bending = [row for row, (j, i) in enumerate(pairs) if bent_too and j in moving and i in moving]
    zero = arb_mat(n + 1, n + 1)
    term = total = arb_mat([[int(i == j) for j in range(n + 1)] for i in range(n + 1)])
    terms, bent = [zero] * axes, [zero] * len(pairs)
    totals, sums = [zero] * axes, [zero] * len(pairs)
    k, last = 0, 1.0
    while (last > _LAST or k < size + 4) and k < _MOST_TERMS and math.isfinite(size):
        k += 1
        scale = arb(1) / k
        for row in bending:
            j, i = pairs[row]
            mixed = first[j] * terms[i] + first[i] * terms[j]
            bent[row] = (second[row] * term + mixed + m * bent[row]) * scale
            sums[row] = sums[row] + bent[row]
        for j in moving:
            terms[j] = (first[j] * term + m * terms[j]) * scale
            totals[j] = totals[j] + terms[j]
        term = m * term * scale
        total = total + term
        last = last * max(size, 1e-3) / k
    # |M|^k/k! e^|M| of the terms from k + 1 on, of k and of k - 1 for the derivatives
    powers = [max(k + 1 - less, 0) for less in range(3)]
    rest = [arb(size) ** power / arb(power).fac() * arb(size).exp() for power in powers]
    total = _wider(total, rest[0])
    for j in moving:
        totals[j] = _wider(totals[j], rest[1] * slopes[j])
    for row in bending:
        j, i = pairs[row]
        sums[row] = _wider(sums[row], rest[1] * bends[row] + rest[2] * slopes[j] * slopes[i])
    for _ in range(halvings):
        for row in bending:
            j, i = pairs[row]
            mixed = totals[j] * totals[i] + totals[i] * totals[j]
            sums[row] = sums[row] * total + mixed + total * sums[row]
        for j in moving:
            totals[j] = totals[j] * total + total * totals[j]
        total = total * total
    return _Exponential(total, totals, sums)


def _total(terms: Sequence[Jet]) -> Jet:
    found = terms[0]
    for term in terms[1:]:
        found = found + term
    return found


def _norm(matrix: arb_mat) -> float:
    """The largest sum of a row, rounded up."""
    rows = range(matrix.nrows())
    sums = [sum((abs(matrix[i, j]) for j in range(matrix.ncols())), arb(0)) for i in rows]
    return max(float(s.upper()) for s in sums) * (1.0 + 1e-12)


def _wider(matrix: arb_mat, by: arb) -> arb_mat:
    """Each entry with a larger radius."""
    ball = arb(0, float(by.upper()) * (1.0 + 1e-12))
    return arb_mat([[matrix[i, j] + ball for j in range(matrix.ncols())] for i in range(matrix.nrows())])
