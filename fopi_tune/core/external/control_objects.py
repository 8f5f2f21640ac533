"""Systems of python-control -> coefficients:  a TransferFunction's are copied, a StateSpace's computed exactly.

For  P(s) = c (sI - A)^-1 b + d  of n states, Faddeev and LeVerrier's recursion

    M_1 = I,   a_k = -tr(A M_k)/k,   M_{k+1} = A M_k + a_k I
    D(s) = s^n + a_1 s^{n-1} + … + a_n,      N(s) = d D(s) + sum_k c M_k b s^{n-k}

loses digits in floating point.  Here it runs in whole numbers, which the matrices' entries are times a power of two:
each coefficient is that of the matrices as they are, rounded once.  Entries are themselves rounded: a coefficient that
is no larger than what a change of their last digits makes of it is 0, as that of an integrator in other coordinates.
"""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction
from typing import Any

import numpy as np

from fopi_tune.core.text_tables.words import counted
from fopi_tune.errors import DomainError

#: coefficients that polynomials have at most; longer ones are badly conditioned
_MOST_STATES = 31
#: changes of the entries' last digit, of random signs, by which the rounding of a coefficient is seen, and how often
_LAST_DIGIT, _CHANGES, _MANY_TIMES = 2.0**-52, 4, 4
_ADVICE = "give a TransferFunction or StateSpace of python-control, in continuous time, with one input and one output"
Coefficients = tuple[float, ...]


def coefficients_of(system: Any) -> tuple[Coefficients, Coefficients]:
    """Numerator and denominator in descending powers of s, without leading zeros.

    Args:
        system: a `control.TransferFunction` or `control.StateSpace`, stable or not.

    Raises:
        DomainError: of another kind, in discrete time, with several inputs or outputs, improper, or too large.
    """
    import control

    kind = type(system).__name__
    if not isinstance(system, control.TransferFunction | control.StateSpace):
        raise DomainError(f"an object of type {kind} is no plant; {_ADVICE}")
    if system.dt is not None and system.dt is not False and system.dt != 0:
        raise DomainError(f"this {kind} is in discrete time (dt = {system.dt}); {_ADVICE}")
    if (system.ninputs, system.noutputs) != (1, 1):
        size = f"{counted(system.noutputs, 'output')} and {counted(system.ninputs, 'input')}"
        raise DomainError(f"this {kind} has {size}; give one of its entries, such as system[0, 0]")
    if isinstance(system, control.TransferFunction):
        top, bottom = (_trimmed(side[0][0]) for side in (system.num, system.den))
    else:
        top, bottom = _of_matrices(system.A, system.B, system.C, system.D)
    if len(top) > len(bottom):
        raise DomainError(
            f"this {kind} is improper: the numerator's degree {len(top) - 1} exceeds the denominator's "
            f"{len(bottom) - 1}; add the fast pole that limits its bandwidth"
        )
    return top, bottom


def _trimmed(coefficients: Sequence[float]) -> Coefficients:
    return tuple(np.trim_zeros([float(value) for value in coefficients], "f"))


def _of_matrices(a: Any, b: Any, c: Any, d: Any) -> tuple[Coefficients, Coefficients]:
    whole = np.block([[np.asarray(a, dtype=float), np.asarray(b, dtype=float)], [np.asarray(c), np.asarray(d)]])
    if not np.all(np.isfinite(whole)):
        raise DomainError("a matrix of the StateSpace has an entry that is not finite")
    if len(whole) - 1 > _MOST_STATES:
        raise DomainError(f"the StateSpace has {len(whole) - 1} states; reduce it to at most {_MOST_STATES}")
    found = _exact(whole)
    random = np.random.default_rng(1)
    changed = [_exact(whole * (1.0 + _LAST_DIGIT * random.choice((-1.0, 1.0), whole.shape))) for _ in range(_CHANGES)]
    sides: list[Coefficients] = []
    for k, side in enumerate(found):
        kept = [
            value if abs(value) > _MANY_TIMES * max(abs(value - each[k][j]) for each in changed) else Fraction(0)
            for j, value in enumerate(side)
        ]
        try:
            sides.append(_trimmed([float(value) for value in kept]))
        except OverflowError:
            raise DomainError("the StateSpace's polynomials are too large to compute with; use other units") from None
    return sides[0], sides[1]


def _exact(whole: Any) -> tuple[list[Fraction], list[Fraction]]:
    """N and D of [[A, b], [c, d]]."""
    states = len(whole) - 1
    entries = [[Fraction(float(value)) for value in row] for row in whole]
    scale = max(value.denominator for row in entries for value in row)
    integers = np.array([[int(value * scale) for value in row] for row in entries], dtype=object)
    a, b, c, d = (
        integers[:states, :states],
        integers[:states, states],
        integers[states, :states],
        integers[states, states],
    )
    unit, moved = np.zeros((states, states), dtype=object), np.zeros((states, states), dtype=object)
    for k in range(states):
        unit[k, k] = 1
    # scale A has the coefficients scale^k a_k
    bottom, top, last = [Fraction(1)], [Fraction(0)], 1
    for k in range(1, states + 1):
        moved = unit if k == 1 else a.dot(moved) + last * unit
        top.append(Fraction(int(c.dot(moved).dot(b)), scale ** (k + 1)))
        last = -sum(int(a[i].dot(moved[:, i])) for i in range(states)) // k
        bottom.append(Fraction(last, scale**k))
    direct = Fraction(int(d), scale)
    return [direct * x + y for x, y in zip(bottom, top, strict=True)], bottom
