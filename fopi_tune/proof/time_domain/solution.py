"""The trajectories of a box of plants under a pattern of limited samples:  its terms up to second order.

With the plants of `plants`, the filter of `patterns` (v = v_a - path y, u = u_a - F y) and y, u as deviations from the
rest before the first sample, a trajectory is the solution of a linear system,

    A y = N u_a + M w + kick,      A = D + N F .                                                                     (1)

At the centre of the box A_0 has the inverse Q, which is tested.  On the box, A = A_0 + E and y = y_0 + z,

    z = b - (Q E) z,      b = Q (change of the right side - E y_0) .                                                 (2)

The terms of (2) of first and second order in the uncertain numbers are computed sample by sample; `remainders` bounds
what is left.  Nothing is propagated from sample to sample but at the centre, so that nothing wraps.

Source: derived here.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from fopi_tune.core.bode_form import Array
from fopi_tune.proof.time_domain.bounded import Causal, Delays, Signals, above
from fopi_tune.proof.time_domain.case import TimeDomainCase
from fopi_tune.proof.time_domain.centre import centre_signals
from fopi_tune.proof.time_domain.jets import pairs_of
from fopi_tune.proof.time_domain.models import Model
from fopi_tune.proof.time_domain.patterns import Filter, Pattern
from fopi_tune.proof.time_domain.plants.held import HeldPlants
from fopi_tune.proof.time_domain.remainders import Remainders, Sizes, operator_change, remainders_of

#: the centre is computed again, in balls, where its error is more than this share of the remainders
_MOST_ERROR = 1e-2


@dataclass(frozen=True, eq=False)
class Trajectory:
    """Signals over a box.

    Args:
        plants: of the box.
        output: y, K samples, as a deviation from `plants.output`.
        demanded: v, before the limits.
        applied: u, as a deviation from `plants.past`.
        shares: the part of each axis in what the output has beyond first order, shape (p, K).
        limited: whether a sample may be limited.
    """

    plants: HeldPlants
    output: Model
    demanded: Model
    applied: Model
    shares: Array
    limited: bool


def _apply(polynomial: tuple[Delays, float], signals: Signals) -> Signals:
    """A polynomial with the norm of its rounding."""
    delays, rounding = polynomial
    found = delays.apply(signals)
    return Signals(found.values, above(1.0) * (found.errors + rounding * signals.sizes))


@dataclass(frozen=True, eq=False)
class _Inputs:
    """v_a, and u_a as a deviation from the input before the first sample; a column each of something's effect."""

    demanded: Signals
    applied: Signals


@dataclass(frozen=True, eq=False)
class _Expansion:
    """A signal's terms:  value + slopes delta + rests symbols + pairs delta delta, columns each, + remainder."""

    value: Signals
    slopes: Signals
    rests: Signals
    pairs: Signals
    remainder: Array


class Solution:
    """One box under one pattern."""

    def __init__(self, case: TimeDomainCase, plants: HeldPlants, pattern: Pattern, own: Filter) -> None:
        self.case, self.plants, self.pattern, self.own = case, plants, pattern, own
        self.radii, self.count = plants.radii, case.samples
        self.pairs = pairs_of(len(self.radii))
        self.products = np.array([self.radii[j] * self.radii[i] for j, i in self.pairs])
        self.free = 1.0 - pattern.share
        self.load = Signals.exactly((np.zeros(self.count) if case.load is None else case.load)[:, None])

    def trajectory(self) -> Trajectory | None:
        """(2) and (3)."""
        inverse = self._inverse()
        if inverse is None:
            return None
        base, slopes, bends, rests, rest_radii = self._inputs()
        y0 = inverse.apply(self._right(base))
        v0 = base.demanded - self.own.path.apply(y0)
        u0 = base.applied - self.own.control.apply(y0)
        sides = [self._slope_side(axis, y0, u0, slopes) for axis in range(len(self.radii))]
        plant_sides, plant_radii = self._plant_rests(y0, u0)
        rest_sides = _apply(self.plants.control.centre, rests.applied)
        first = inverse.apply(Signals.beside([*sides, *plant_sides, rest_sides]))
        along, others = first[: len(sides)], first[len(sides) :]
        u_along = slopes.applied - self.own.control.apply(along)
        bent = (along, u_along, y0, u0, bends)
        bent_sides = [self._pair_side(row, bent) for row in range(len(self.pairs))]
        second = inverse.apply(Signals.beside([*bent_sides, y0[:0]]))
        radii = np.concatenate([plant_radii, rest_radii])
        parts = ((slopes, self.radii), (bends, self.products), (rests, rest_radii))
        inputs = tuple(_total(each.applied, size) for each, size in parts)
        change = operator_change(inverse, self.plants, self.own)
        sizes = Sizes(inputs, _reach(along, self.radii), _reach(others, radii), _reach(second, self.products))
        remainders = remainders_of(change, sizes)
        if not np.isfinite(remainders.output[0]):
            return None
        path = self.own.path
        nothing = Signals.exactly(np.zeros((self.count, len(plant_radii))))
        direct = Signals.beside([nothing, rests.demanded])
        if max(y0.errors[0], v0.errors[0]) > _MOST_ERROR * min(remainders.output.max(), remainders.demanded.max()):
            y0, v0 = centre_signals(self.case, self.plants, self.pattern, float(self._first_state().values[0]))
        output = self._model(_Expansion(y0, along, others, second, remainders.output), radii)
        demanded = self._model(
            _Expansion(
                v0,
                slopes.demanded - path.apply(along),
                direct - path.apply(others),
                bends.demanded - path.apply(second),
                remainders.demanded,
            ),
            radii,
        )
        applied = demanded.times(self.free) + Model.constant(self.pattern.limited, self.radii)
        applied = applied.wider(self.pattern.reach) - self.plants.past
        shares = self._shares(second, remainders)
        return Trajectory(self.plants, output, demanded, applied, shares, not self.pattern.is_free)

    def _inverse(self) -> Causal | None:
        """Q."""
        denominator, rounding_d = self.plants.denominator.centre
        control, rounding_n = self.plants.control.centre
        found = self.own.control.delayed(control).plus_delays(denominator)
        error = found.error + rounding_d + rounding_n * self.own.control.norm
        return replace(found, error=above(error)).inverse()

    def _inputs(self) -> tuple[_Inputs, _Inputs, _Inputs, _Inputs, Array]:
        """At the centre, of first and of second order, and of all else with its radius: past input, start, symbols."""
        case, pattern = self.case, self.pattern
        past, first, count = self.plants.past, self._first_state(), self.count
        ones = np.ones((count, 1))
        reference = case.run.signals.reference - self.plants.output
        rounding = 2.0**-52 * np.abs(reference).max()
        error = case.path.apply(Signals(reference[:, None], np.array([rounding])))
        limited = case.correction.apply(Signals.exactly(pattern.limited[:, None])) if not pattern.is_free else None
        demanded = error + Signals.exactly(first.values[0] * ones)
        demanded = self._through(demanded if limited is None else demanded + limited)
        applied = demanded.times(self.free) + Signals.exactly(pattern.limited[:, None])
        base = _Inputs(demanded, applied - Signals.exactly(past.values[0] * ones))

        def uniform(starts: Array, pasts: Array) -> _Inputs:
            v = self._through(Signals.exactly(ones * starts[None, :]))
            return _Inputs(v, v.times(self.free) - Signals.exactly(ones * pasts[None, :]))

        slopes, bends = uniform(first.slopes[:, 0], past.slopes[:, 0]), uniform(first.pairs[:, 0], past.pairs[:, 0])
        rest = uniform(np.array([0.0, 1.0]), np.array([1.0, 0.0]))
        radii = np.array([past.rest[0], first.rest[0]])
        symbols = pattern.symbols
        if len(symbols):
            units = np.zeros((count, len(symbols)))
            units[symbols, np.arange(len(symbols))] = 1.0
            v = self._through(case.correction.apply(Signals.exactly(units)))
            each = _Inputs(v, v.times(self.free) + Signals.exactly(units))
            rest = _Inputs(Signals.beside([rest.demanded, each.demanded]), Signals.beside([rest.applied, each.applied]))
            radii = np.concatenate([radii, pattern.reach[symbols]])
        return base, slopes, bends, rest, radii

    def _first_state(self) -> Model:
        """The integrator's state at the first sample."""
        case, past = self.case, self.plants.past
        if not (case.run.start.bumpless and case.controller.has_integrator):
            return Model.constant(np.array([case.first_output]), self.radii)
        low, high = case.output_limits
        if past.low[0] >= low and past.high[0] <= high:
            return past
        ends = np.clip([past.low[0], past.high[0]], low, high)
        middle, reach = 0.5 * (ends[0] + ends[1]), 0.5 * (ends[1] - ends[0]) * (1.0 + 1e-15) + 1e-15 * abs(ends).max()
        return Model.constant(np.array([middle]), self.radii).wider(np.array([reach]))

    def _through(self, signals: Signals) -> Signals:
        return signals if self.own.own is None else self.own.own.apply(signals)

    def _right(self, base: _Inputs) -> Signals:
        """The right side of (1) at the centre."""
        plants = self.plants
        found = _apply(plants.control.centre, base.applied)
        if plants.load is not None:
            found = found + _apply(plants.load.centre, self.load)
        if plants.kick:
            kick = np.zeros((self.count, 1))
            kick[0] = plants.kick
            found = found + Signals.exactly(kick)
        return found

    def _slope_side(self, axis: int, y0: Signals, u0: Signals, slopes: _Inputs) -> Signals:
        """Q of it is the output's slope along an axis."""
        plants = self.plants
        found = _apply(plants.control.slopes[axis], u0) - _apply(plants.denominator.slopes[axis], y0)
        found = found + _apply(plants.control.centre, slopes.applied[axis : axis + 1])
        return found if plants.load is None else found + _apply(plants.load.slopes[axis], self.load)

    def _plant_rests(self, y0: Signals, u0: Signals) -> tuple[list[Signals], Array]:
        """The same for what centre and slopes leave out of each coefficient, with its radius."""
        plants = self.plants
        parts = [(plants.denominator, y0), (plants.control, u0)]
        parts += [(plants.load, self.load)] if plants.load is not None else []
        found = [(basis.apply(signals), rest) for part, signals in parts for basis, rest in part.rests]
        return [side for side, _ in found], np.array([rest for _, rest in found])

    def _pair_side(self, row: int, terms: tuple[Signals, Signals, Signals, Signals, _Inputs]) -> Signals:
        """Q of it is the output's term of second order in two numbers."""
        along, u_along, y0, u0, bends = terms
        plants, (j, i) = self.plants, self.pairs[row]

        def mixed(axis: int, other: int) -> Signals:
            column = slice(other, other + 1)
            found = _apply(plants.control.slopes[axis], u_along[column])
            return found - _apply(plants.denominator.slopes[axis], along[column])

        found = _apply(plants.control.pairs[row], u0) - _apply(plants.denominator.pairs[row], y0)
        found = found + _apply(plants.control.centre, bends.applied[row : row + 1]) + mixed(j, i)
        found = found if plants.load is None else found + _apply(plants.load.pairs[row], self.load)
        return found if i == j else found + mixed(i, j)

    def _model(self, terms: _Expansion, rest_radii: Array) -> Model:
        """The model of a signal."""
        h = self.radii
        values, pairs = terms.value.values[:, 0].copy(), terms.pairs.values.T.copy()
        errors = float(terms.value.errors[0] + terms.slopes.errors @ h + terms.pairs.errors @ self.products)
        errors = above(errors + float(terms.rests.errors @ rest_radii))
        rest = (np.abs(terms.rests.values) @ rest_radii + errors + terms.remainder) * above(1.0, len(rest_radii))
        return Model(values, terms.slopes.values.T.copy(), pairs, rest, h)

    def _shares(self, second: Signals, remainders: Remainders) -> Array:
        """The part of each axis in what is beyond first order, shape (p, K)."""
        found = np.zeros((len(self.radii), self.count))
        for (j, i), column in zip(self.pairs, np.abs(second.values).T, strict=True):
            for axis in (j, i):
                found[axis] += 0.5 * self.radii[j] * self.radii[i] * column
        whole = above(remainders.change.sum(axis=0))
        rest = np.where(np.isfinite(remainders.output), remainders.output, np.abs(second.values).sum(axis=1))
        found += remainders.change / np.maximum(whole, 1e-300) * rest
        return found / np.maximum(found.sum(axis=0), 1e-300)


def _reach(signals: Signals, radii: Array) -> Array:
    """The largest sample of sum_i |signal_i| radius_i up to each one, rounded up; shape (K,)."""
    sizes = np.abs(signals.values) @ radii + signals.errors @ radii
    return np.maximum.accumulate(above(sizes, len(radii)))


def _total(signals: Signals, radii: Array) -> float:
    return above(float(signals.sizes @ radii), len(radii))
