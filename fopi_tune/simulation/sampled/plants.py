"""Exact discretisation behind a zero-order hold:  m continuous plants -> transition matrices and input weights.

An input delayed by D samples, D = d + f with d whole and 0 <= f < 1, is constant on the two segments of a sample:

    x <- e^{A(1-f)} (e^{Af} x + w(f) v_{k-1-d}) + w(1-f) v_{k-d},      w(t) = int_0^t e^{As} b ds,                   (1)

(Astrom and Wittenmark, Computer-Controlled Systems, 3rd ed., 1997, section 2.3), where control and load
have different delays D.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from fopi_tune.core.bode_form import Array
from fopi_tune.core.loops import Plants
from fopi_tune.core.zero_order_hold import companion, constant_input_step
from fopi_tune.errors import DomainError
from fopi_tune.simulation.scenario import InitialInput, Start

#: a delay this close to a whole number of samples counts as whole
_WHOLE = 1e-12
MOST_DELAY_SAMPLES = 10_000
#: of a sample; arrivals this close are one
SAME_PART = 1e-9


@dataclass(frozen=True, eq=False)
class DelayedInput:
    """A delayed input and its effect on the states over one sample, by (1).

    Args:
        delay: d, whole samples, shape (m,).
        transition: of the segments [0, f) and [f, 1), shape (2, m, n, n).
        weight: w of the same, shape (2, m, n).
    """

    delay: NDArray[np.int64]
    transition: Array
    weight: Array

    @property
    def whole(self) -> tuple[Array, Array, Array]:
        """e^A, shape (m, n, n), and the weights of v_{k-d} and v_{k-1-d}, shape (m, n) each."""
        (first, second), (old, new) = self.transition, self.weight
        if old.shape[1] == 1:
            # products of numbers, without a call for each
            return second * first, new, second[:, :, 0] * old
        return second @ first, new, (second @ old[:, :, None])[:, :, 0]


@dataclass(frozen=True, eq=False)
class DiscretePlants:
    """m plants of order n behind a zero-order hold; y = c x + direct v at the samples, v the input just before.

    A plant of first order has its output without the direct path as its state (c = 1).

    Args:
        control: how the control acts, computing delay included.
        load: how the load acts, the plant's dead time included.
        output: c, shape (m, n).
        direct: shape (m,).
        rate_state: dy/dt = rate_state x + rate_input v between the samples, shape (m, n), per s.
        rate_input: shape (m,).
        static_gain: P(0), inf where there is an integrator, shape (m,).
        equilibrium: the state that a constant input of 1 holds, shape (m, n); not finite where there is an integrator.
        parts: fractions of a sample after which control and load arrive, shape (m,) each.
        system: A of the companion's states, shape (m, n, n), time counted in samples.
        sample_time_s: Ts.
        has_derivatives: whether the states are those that two modes share, by `mode_plants`.
    """

    control: DelayedInput
    load: DelayedInput
    output: Array
    direct: Array
    rate_state: Array
    rate_input: Array
    static_gain: Array
    equilibrium: Array
    parts: tuple[Array, Array]
    system: Array
    sample_time_s: float
    has_derivatives: bool = False

    def __len__(self) -> int:
        return len(self.direct)

    @property
    def order(self) -> int:
        """n."""
        return self.output.shape[1]

    @cached_property
    def acts_at_samples(self) -> NDArray[np.bool_]:
        """Whether control and load act at the samples, not between them; shape (m,)."""
        return ~(np.any(self.control.weight[0] != 0.0, axis=1) | np.any(self.load.weight[0] != 0.0, axis=1))

    @property
    def rate_step(self) -> Array:
        """Jump of dy/dt at a sample per unit jump of the input; shape (m,)."""
        return np.where(self.acts_at_samples, self.rate_input, 0.0)

    @cached_property
    def arrivals(self) -> Array:
        """dy/dt just after the control arrives, and just after the load does; shape (m, 2, n + 4).

        From the sample's start state, the control that arrives, the one before, and the same two of the load; used
        where an input arrives between samples, of plants that share no states.
        """
        (m, n), parts, a = self.output.shape, self.parts, self.system
        found = np.zeros((m, 2, n + 4))
        if n == 0 or not any(part.any() for part in parts):
            return found
        scale = self.rate_input[:, None] * self.sample_time_s if n == 1 else 1.0
        for row, instant in enumerate(parts):
            found[:, row, :n] = np.einsum("mi,mij->mj", self.rate_state, constant_input_step(a, instant)[0])
            for column, part in zip((n, n + 2), parts, strict=True):
                # the old input acts until `part`, the new one from there to `instant`
                late = np.maximum(instant - part, 0.0)
                transition, new = constant_input_step(a, late)
                old = np.einsum("mij,mj->mi", transition, constant_input_step(a, np.minimum(instant, part))[1])
                arrived = instant >= part
                for place, weight, acts in ((column, new, arrived), (column + 1, old, ~arrived)):
                    effect = np.einsum("mi,mi->m", self.rate_state, weight * scale)
                    found[:, row, place] = effect + np.where(acts, self.rate_input, 0.0)
        return found

    def initial_state(self, start: Start) -> tuple[Array, Array]:
        """States, shape (m, n), and the input before the first sample, shape (m,), that give the initial output.

        An integrator is held anywhere by the input 0.

        Raises:
            DomainError: no input holds a plant there, or "free" is asked of a plant that is not of first order.
        """
        m, y0 = len(self), start.output
        if y0 == 0.0:
            return np.zeros((m, self.order)), np.zeros(m)
        if self.has_derivatives and start.before is InitialInput.FREE:
            return _resting(m, self.order, y0), np.zeros(m)
        if start.before is InitialInput.FREE:
            if self.order != 1:
                raise DomainError(f"an initial output without input needs plants of order 1, not {self.order}")
            return np.full((m, 1), y0), np.zeros(m)
        integrates = np.isinf(self.static_gain)
        if not np.all(integrates | (np.isfinite(self.static_gain) & (self.static_gain != 0.0))):
            raise DomainError(f"no input holds a plant at {y0!r}, because P(0) is 0; start it at initial_output: 0")
        held = np.where(integrates, 0.0, y0 / np.where(integrates, 1.0, self.static_gain))
        if self.order == 0:
            return np.zeros((m, 0)), held
        if self.has_derivatives:
            return _resting(m, self.order, y0) + self.equilibrium * held[:, None], held
        states = np.where(integrates[:, None], 0.0, self.equilibrium) * held[:, None]
        with np.errstate(divide="ignore"):
            states[:, -1] = np.where(integrates, y0 / self.output[:, -1], states[:, -1])
        return states, held


def discretize_plants(plants: Plants, sample_time_s: float, delay_samples: float = 0.0) -> DiscretePlants:
    """Discretise plants exactly behind a zero-order hold.

    Args:
        plants: m proper plants with their dead times.
        sample_time_s: Ts, s.
        delay_samples: computing delay, whole or not, of the control; the load has none.

    Raises:
        DomainError: a number is not finite, every leading one is 0, a plant is improper or its delay above 10,000
            samples.
    """
    top, bottom = _of_one_degree(plants.numerator, plants.denominator, sample_time_s)
    if not all(np.all(np.isfinite(values)) for values in (top, bottom, plants.dead_time_s)):
        raise DomainError("a plant has a number that is not finite")
    if top.shape[1] > bottom.shape[1] or not np.all(bottom[:, 0] != 0.0):
        raise DomainError("a plant is improper or its denominator starts with 0; leave leading zeros out")
    if np.any(plants.dead_time_s < 0.0):
        raise DomainError("a plant has a negative dead time; it cannot answer before it is asked")
    a, c, direct = companion(top, bottom, sample_time_s)
    n = c.shape[1]
    samples = plants.dead_time_s / sample_time_s
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        arrives = late = _split(samples)
        load = control = _delayed(a, *late)
        if delay_samples != 0.0:
            arrives = _split(samples + delay_samples)
            control = _delayed(a, *arrives)
        gain = top[:, -1] / bottom[:, -1]
        equilibrium = np.zeros(c.shape)
        if n:
            equilibrium[:, -1] = -1.0 / a[:, 0, -1]
        rate_state = np.einsum("mi,mij->mj", c, a) / sample_time_s
        rate_input = c[:, 0] / sample_time_s if n else np.zeros(len(c))
        if n == 1:
            control, load = _scaled(control, c), _scaled(load, c)
            equilibrium, rate_state, c = equilibrium * c, a[:, 0, :] / sample_time_s, np.ones_like(c)
    # the same part where only rounding differs
    parts = np.where(np.abs(arrives[1] - late[1]) <= SAME_PART, late[1], arrives[1]), late[1]
    return DiscretePlants(control, load, c, direct, rate_state, rate_input, gain, equilibrium, parts, a, sample_time_s)


def _resting(m: int, order: int, output: float) -> Array:
    """Shared states of an output that does not move without an input."""
    states = np.zeros((m, order))
    states[:, 0] = output
    return states


def _of_one_degree(top: Array, bottom: Array, sample_time_s: float) -> tuple[Array, Array]:
    """Numerators and denominators, those of a lower degree than others times powers of 1 + s Ts, which cancel.

    Plants of several models are simulated together; the states that are added follow the input and reach no output.
    """
    if np.all(bottom[:, :1] != 0.0):
        return top, bottom
    missing = np.argmax(bottom != 0.0, axis=1)
    if not missing.any() or missing.all():
        return top, bottom
    bottom = bottom.copy()
    top = np.hstack([np.zeros((len(top), bottom.shape[1] - top.shape[1])), top])
    for power in range(int(missing.max())):
        rows = missing > power
        for side in (top, bottom):
            # the first coefficient of these rows is 0
            side[rows] += sample_time_s * np.roll(side[rows], -1, axis=1)
    return top, bottom


def whole_samples(samples: Array) -> NDArray[np.int64]:
    """The whole samples in a delay."""
    return np.floor(samples + _WHOLE).astype(np.int64)


def part_of_a_sample(samples: Array) -> Array:
    """The fraction of a sample in a delay."""
    return np.clip(samples - whole_samples(samples), 0.0, 1.0)


def _split(samples: Array) -> tuple[NDArray[np.int64], Array]:
    """Whole samples and the part of one in a delay."""
    if np.any(samples > MOST_DELAY_SAMPLES):
        raise DomainError(f"the delay is {samples.max():.3g} samples long; take a longer sample time")
    return whole_samples(samples), part_of_a_sample(samples)


def _delayed(a: Array, whole: NDArray[np.int64], part: Array) -> DelayedInput:
    m, n = a.shape[:2]
    transition, weight = np.empty((2, m, n, n)), np.empty((2, m, n))
    # most delays are whole, and usually 0
    transition[0], weight[0] = constant_input_step(a, part) if part.any() else (np.eye(n), 0.0)
    transition[1], weight[1] = constant_input_step(a, 1.0 - part)
    return DelayedInput(whole, transition, weight)


def _scaled(delayed: DelayedInput, c: Array) -> DelayedInput:
    return DelayedInput(delayed.delay, delayed.transition, delayed.weight * c)
