"""A box of plants behind a zero-order hold, as polynomials in the delay x of one sample.

    D(x) y = N(x) u + M(x) w + start,      y, u: deviations from the rest before the first sample                    (1)

u is the control, which is late by the dead time and the computing delay, w the load, which is late by the dead time.
The coefficients are models of second order in the uncertain numbers, and the polynomials beside them are exact.

Source: derived; `simulation.sampled.plants`, (1).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from flint import arb

from fopi_tune.core.bode_form import Array
from fopi_tune.proof.time_domain.bounded import Delays, above
from fopi_tune.proof.time_domain.models import Model

_U = 2.0**-53


@dataclass(frozen=True, eq=False)
class Polynomial:
    """A polynomial in x whose coefficients are uncertain:  base + sum_i coefficient_i basis_i.

    Args:
        base: exact; None for 0.
        terms: exact basis polynomials and their coefficients, models of length 1.
    """

    base: Delays | None
    terms: tuple[tuple[Delays, Model], ...]

    @cached_property
    def centre(self) -> tuple[Delays, float]:
        """The polynomial at the centres of the coefficients, and the norm of its rounding."""
        return self._combined([float(model.values[0]) for _, model in self.terms], self.base)

    @cached_property
    def slopes(self) -> list[tuple[Delays, float]]:
        """Of each axis, the slope and the norm of its rounding."""
        axes = range(len(self.terms[0][1].slopes))
        return [self._combined([float(model.slopes[j, 0]) for _, model in self.terms], None) for j in axes]

    @cached_property
    def pairs(self) -> list[tuple[Delays, float]]:
        """The same of the terms of second order, in the order of `pairs_of`."""
        rows = range(len(self.terms[0][1].pairs))
        return [self._combined([float(model.pairs[row, 0]) for _, model in self.terms], None) for row in rows]

    def exact_centre(self) -> dict[int, arb]:
        """Power -> coefficient of the polynomial at the centres, without rounding where the precision is high."""
        found: dict[int, arb] = {}
        parts = [(self.base, 1.0)] if self.base is not None else []
        for basis, factor in [*parts, *((basis, float(model.values[0])) for basis, model in self.terms)]:
            for power, value in enumerate(basis.values.tolist(), basis.first):
                if value and factor:
                    found[power] = found.get(power, arb(0)) + arb(value) * arb(factor)
        return found

    @property
    def rests(self) -> list[tuple[Delays, float]]:
        """Each basis polynomial with the largest |factor| that the terms up to second order leave out."""
        return [(basis, float(model.rest[0])) for basis, model in self.terms]

    def _combined(self, factors: Sequence[float], base: Delays | None) -> tuple[Delays, float]:
        parts = [(base, 1.0)] if base is not None else []
        parts += [(basis, factor) for (basis, _), factor in zip(self.terms, factors, strict=True)]
        first = min(basis.first for basis, _ in parts)
        values = np.zeros(max(basis.first + len(basis.values) for basis, _ in parts) - first)
        size = 0.0
        for basis, factor in parts:
            values[basis.first - first : basis.first - first + len(basis.values)] += factor * basis.values
            size += abs(factor) * basis.norm
        # one part a power: nothing was rounded
        rounding = 0.0 if len(parts) == 1 or not _overlap(parts) else above(2.0 * len(parts) * _U * size)
        return Delays(values, first), rounding


def _overlap(parts: Sequence[tuple[Delays, float]]) -> bool:
    powers = [basis.first + i for basis, _ in parts for i, value in enumerate(basis.values) if value]
    inexact = any(np.any((np.abs(basis.values) != 1.0) & (basis.values != 0.0)) for basis, _ in parts)
    return inexact or len(set(powers)) < len(powers)


@dataclass(frozen=True, eq=False)
class Arrivals:
    """dy/dt of plants of first order when an input arrives at the fraction `instant` of a sample.

        dy/dt = state y + control u_(k - delay) + control_before u_(k - delay - 1) + the same of the load            (2)

    Args:
        state, control, control_before, load, load_before: models of length 1.
        may_end: whether the instant may be the end of the sample, where the simulation counts it for the next one.

    Source: derived; `DiscretePlants.arrivals`.
    """

    state: Model
    control: Model
    control_before: Model
    load: Model
    load_before: Model
    may_end: bool


@dataclass(frozen=True, eq=False)
class HeldPlants:
    """(1) over a box.

    Args:
        order: of the plants.
        radii: of the box, shape (p,).
        denominator: D.
        control: N.
        load: M; None without a load.
        past: the input before the first sample, a model of length 1.
        output: y before the first sample; y is the deviation from it.
        kick: what is added to the output at the first sample, of a start without input.
        delay: whole samples d of the control and of the load.
        pole, gain: p and k, models of length 1; None of plants of higher order.
        arrivals: of control and load, where one of them arrives between samples.
    """

    order: int
    radii: Array
    denominator: Polynomial
    control: Polynomial
    load: Polynomial | None
    past: Model
    output: float
    kick: float
    delay: tuple[int, int]
    pole: Model | None
    gain: Model | None
    arrivals: tuple[Arrivals, ...]


@dataclass(frozen=True, eq=False)
class Start:
    """How the plants begin.

    Args:
        past: their input before the first sample, a model of length 1.
        output: y before the first sample.
        rests: whether that input holds it there; otherwise a plant of first order starts there and decays.
    """

    past: Model
    output: float
    rests: bool
