"""Plants behind the hold: inputs that arrive together, and plants without dynamics."""

from __future__ import annotations

import numpy as np
import pytest

from fopi_tune.core.loops import Plants
from fopi_tune.core.plant import Plant
from fopi_tune.simulation.sampled.plants import discretize_plants
from fopi_tune.simulation.scenario import Start


@pytest.mark.parametrize("dead_time_s", [0.15, 0.05, 0.35, 0.1])
def test_a_whole_computing_delay_lets_control_and_load_arrive_together(dead_time_s: float) -> None:
    held = discretize_plants(Plants.of(Plant((1.0,), (2.0, 1.0), dead_time_s)), 0.2, 1.0)
    control, load = held.arrivals[0]
    # dy/dt just after either is one and the same: rounding of the delays must not tell them apart
    np.testing.assert_allclose(control[:1], load[:1], rtol=1e-13)
    np.testing.assert_allclose(control[1:3], control[3:5], rtol=1e-12)


def test_a_plant_without_dynamics_is_held_by_its_output_over_its_gain() -> None:
    held = discretize_plants(Plants.of(Plant((4.0,), (2.0,), 0.0)), 0.2)
    states, past = held.initial_state(Start(output=3.0))
    assert states.shape == (1, 0)
    assert past == pytest.approx([1.5])
