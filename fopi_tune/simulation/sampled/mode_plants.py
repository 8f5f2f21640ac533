"""Plants of two modes that share their output:  discretised plants -> shared states, and segments of a sample.

With time counted in samples, x' = A x + e_1 v and y = c x of each plant, the modes share the states

    z_1 = c x = y,    z_k = c A^(k-1) x,    k = 2 to n,    n the largest order,                                      (1)
    z_k' = z_(k+1) + h_k v,    h_k = c A^(k-1) e_1,

so that z_k is the derivative of the order k - 1 without what v adds to it: without zeros h_k = 0 for k < n, and z_k is
that derivative itself.  The output and its derivatives for an input of 0 go on at a change of the mode, as far as the
plant that is left has states for them: those beyond a plant's own order are 0 after its first step.

Control j of mode m arrives L_m samples after it was sent, by the computing delay and the dead time of its own plant,
whole or not.  At any time t, in samples, the control and the plant are those of

    j = max {i : i + L_(m_i) <= t},                                                                                  (2)

of the controls that have arrived the one that was sent last, and the load is that of t - D_m, D_m the dead time of the
plant that acts.  Between arrivals, at most four in a sample, everything is constant.

Source: (1) is the observability form with time counted in samples, as in Kailath, Linear Systems, 1980, section 2.1;
that the modes share it, and (2), are definitions.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from fopi_tune.core.bode_form import Array
from fopi_tune.core.loops import Plants
from fopi_tune.core.zero_order_hold import constant_input_step
from fopi_tune.errors import DomainError
from fopi_tune.simulation.sampled.plants import (
    MOST_DELAY_SAMPLES,
    SAME_PART,
    DelayedInput,
    DiscretePlants,
    discretize_plants,
    part_of_a_sample,
    whole_samples,
)


@dataclass(frozen=True, eq=False)
class Segments:
    """The parts of a sample between arrivals, of m pairs of plants; S segments, the last ones may last no time.

    Args:
        control: age of the control of each mode that has arrived last, whole samples, shape (S, 2, m).
        load: the same of the load behind each plant's dead time.
        arrives: whether a segment begins with an arrival at this mode's plant, shape (S, 2, m).
        transition: of the states (1) over the segment, shape (S, 2, m, n, n).
        weight: of the input, shape (S, 2, m, n).
    """

    control: NDArray[np.int64]
    load: NDArray[np.int64]
    arrives: NDArray[np.bool_]
    transition: Array
    weight: Array

    def __len__(self) -> int:
        return len(self.control)


def discretize_modes(
    plants: Sequence[Plants], sample_time_s: float, delays: tuple[float, float], loaded: bool
) -> tuple[list[DiscretePlants], Segments | None]:
    """Both modes' plants with the states (1), and segments where a plant has a dead time.

    Args:
        plants: of each mode, m strictly proper ones of order 1 or more.
        sample_time_s: Ts, s.
        delays: computing delay of each mode, samples.
        loaded: whether there is a load.

    Returns:
        The plants, without their dead times where these are in the segments; segments, or None.

    Raises:
        DomainError: as `discretize_plants`, or a plant has a direct path or order 0.
    """
    late = any(bool(np.any(each.dead_time_s != 0.0)) for each in plants)
    bare = [Plants(each.numerator, each.denominator, np.zeros(len(each))) for each in plants] if late else plants
    delay = delays[0] if delays[0] == delays[1] and not late else 0.0
    held = [discretize_plants(each, sample_time_s, delay) for each in bare]
    for each in held:
        if each.order < 1 or np.any(each.direct != 0.0):
            raise DomainError("a hybrid loop needs plants of order 1 or more without direct path")
    if not late:
        return in_derivatives(held), None
    samples = [each.dead_time_s / sample_time_s for each in plants]
    if any(not np.all(each >= 0.0) for each in samples):
        raise DomainError("a plant has a dead time that is negative or not finite")
    return in_derivatives(held), _segments(held, samples, delays, loaded)


def in_derivatives(plants: Sequence[DiscretePlants]) -> list[DiscretePlants]:
    """The plants of modes with the states (1); as they are where all are of order 1.

    Args:
        plants: of each mode, without direct path and dead time.
    """
    order = max(each.order for each in plants)
    return list(plants) if order == 1 else [_in_derivatives(each, order) for each in plants]


def _in_derivatives(plants: DiscretePlants, order: int) -> DiscretePlants:
    n, m = plants.order, len(plants)
    shared = _observability(plants)

    def stepped(given: DelayedInput) -> DelayedInput:
        transition, weight = np.zeros((2, m, order, order)), np.zeros((2, m, order))
        transition[:, :, :n, :n], weight[:, :, :n] = _converted(shared, given.transition, given.weight)
        return DelayedInput(given.delay, transition, weight)

    control = stepped(plants.control)
    load = control if plants.load is plants.control else stepped(plants.load)
    output, rate_state, resting = np.zeros((3, m, order))
    output[:, 0] = 1.0
    if n == 1:
        rate_state[:, :1] = plants.rate_state
    else:
        # z_1' = z_2 + h_1 v
        rate_state[:, 1] = 1.0 / plants.sample_time_s
    # z_k' = 0 at rest
    resting[:, 1:n] = -shared[:, :-1, 0]
    return replace(
        plants, control=control, load=load, output=output, rate_state=rate_state, equilibrium=resting,
        has_derivatives=True,
    )  # fmt: skip


def _observability(plants: DiscretePlants) -> Array:
    """The rows c A^(k-1), shape (m, n, n): z of the companion's states by (1)."""
    rows = [plants.output]
    for _ in range(plants.order - 1):
        rows.append(np.einsum("mi,mij->mj", rows[-1], plants.system))
    return np.stack(rows, axis=1)


def _converted(shared: Array, transition: Array, weight: Array) -> tuple[Array, Array]:
    """Transition, shape (..., m, n, n), and weight, shape (..., m, n), of the states (1).

    By Cayley and Hamilton their matrix is the companion's with both axes reversed, whatever c is.
    """
    return transition[..., ::-1, ::-1], (shared @ weight[..., None])[..., 0]


def _segments(
    held: Sequence[DiscretePlants], dead: Sequence[Array], delays: tuple[float, float], loaded: bool
) -> Segments:
    controls = [each + delay for each, delay in zip(dead, delays, strict=True)]
    if max(each.max(initial=0.0) for each in controls) > MOST_DELAY_SAMPLES:
        raise DomainError(f"a dead time is more than {MOST_DELAY_SAMPLES:,} samples long; take a longer sample time")
    parts = np.array([part_of_a_sample(each) for each in (*controls, *dead)])
    for later in range(1, 4):
        # the same part where only rounding differs
        for before in range(later):
            near = np.abs(parts[later] - parts[before]) <= SAME_PART
            parts[later] = np.where(near, parts[before], parts[later])
    begins = np.sort(np.vstack([np.zeros_like(parts[:1]), parts if loaded else parts[:2]]), axis=0)
    # one segment each; those that last no time come last
    begins[1:][np.diff(begins, axis=0) == 0.0] = 1.0
    begins = np.sort(begins, axis=0)
    begins = begins[(begins < 1.0).any(axis=1)]
    lasts = np.diff(begins, axis=0, append=1.0)
    waits = begins[:, None, :] < parts[None, :, :]
    whole = np.array([whole_samples(each) for each in (*controls, *dead)])
    ages = whole[None, :, :] + waits
    at = begins[:, None, :] == parts[None, :, :]
    n, (count, m) = max(each.order for each in held), begins.shape
    transition, weight = np.zeros((count, 2, m, n, n)), np.zeros((count, 2, m, n))
    for mode, plants in enumerate(held):
        size, shared = plants.order, _observability(plants)
        if size == 1:
            # of a plant of first order the state is y, and e_1 its share of y'
            shared = (plants.rate_input * plants.sample_time_s)[:, None, None]
        for segment in range(count):
            found = _converted(shared, *constant_input_step(plants.system, lasts[segment]))
            transition[segment, mode, :, :size, :size], weight[segment, mode, :, :size] = found
    return Segments(ages[:, :2], ages[:, 2:], at[:, :2] | (at[:, 2:] & loaded), transition, weight)
