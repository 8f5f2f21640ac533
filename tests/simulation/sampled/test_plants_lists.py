"""Plants of several degrees, discretised together."""

from __future__ import annotations

import numpy as np
import pytest

from fopi_tune.core.loops import Plants
from fopi_tune.errors import DomainError
from fopi_tune.simulation.sampled.plants import DiscretePlants, discretize_plants

TS = 0.1
#: (numerator, denominator) of degrees 0 to 3, an integrator among them
EACH = [([2.0], [1.0]), ([1.0], [2.0, 1.0]), ([1.5], [1.0, 0.0]), ([0.5, 1.0], [0.4, 1.6, 1.0]),
        ([1.0], [0.1, 0.5, 1.2, 1.0])]  # fmt: skip
DEAD = [0.0, 0.25, 0.1, 0.0, 0.37]


def batch() -> Plants:
    numerator, denominator = np.zeros((5, 4)), np.zeros((5, 4))
    for row, (top, bottom) in enumerate(EACH):
        numerator[row, 4 - len(top) :], denominator[row, 4 - len(bottom) :] = top, bottom
    return Plants(numerator, denominator, np.array(DEAD))


def outputs(plants: DiscretePlants, row: int, control: np.ndarray) -> np.ndarray:
    """The output at the samples for a control that holds between them."""
    delay = int(plants.control.delay[row])
    transition, new, old = (part[row] for part in plants.control.whole)
    x, y = np.zeros(plants.order), []
    padded = np.concatenate([np.zeros(delay + 2), control])
    for k in range(len(control)):
        now, before = padded[k + 2], padded[k + 1]
        y.append(plants.output[row] @ x + plants.direct[row] * before)
        x = transition @ x + new * now + old * before
    return np.array(y)


def test_a_plant_answers_as_it_does_alone_whatever_degree_others_have() -> None:
    control = np.random.default_rng(1).normal(size=200)
    together = discretize_plants(batch(), TS)
    for row, (top, bottom) in enumerate(EACH):
        alone = discretize_plants(Plants(np.array([top]), np.array([bottom]), np.array([DEAD[row]])), TS)
        np.testing.assert_allclose(outputs(together, row, control), outputs(alone, 0, control), atol=1e-11)
        assert together.static_gain[row] == alone.static_gain[0]


def test_leading_zeros_of_all_plants_are_refused_as_they_are_of_one() -> None:
    for rows in ([1], [1, 2]):
        with pytest.raises(DomainError, match="leave leading zeros out"):
            discretize_plants(batch().take(np.array(rows)), TS)
