"""Turning points of known functions."""

from __future__ import annotations

import math

import numpy as np
import pytest

from fopi_tune.core.compiled.turning_points import turning_points
from fopi_tune.core.loops import Plants

GRID = np.linspace(-4.0, 4.0, 81)[None, :]


def test_the_peak_of_a_resonance_is_where_it_is_by_its_damping() -> None:
    zeta = 0.1
    plant = Plants(np.array([[1.0]]), np.array([[1.0, 2.0 * zeta, 1.0]]), np.zeros(1))
    found = turning_points(plant.log.terms, GRID, 1e-9)
    gain = found[found[:, 0] == 0.0]
    # omega^2 = 1 - 2 zeta^2; the slope at the root is below 1e-10
    assert gain[:, 1:] == pytest.approx(np.array([[0.0, 0.5 * math.log(1.0 - 2.0 * zeta**2), 1.0]]), abs=1e-9)


def test_the_largest_lead_of_a_compensator_is_at_the_mean_of_its_corners() -> None:
    lead = Plants(np.array([[1.0, 1.0]]), np.array([[0.1, 1.0]]), np.zeros(1))
    found = turning_points(lead.log.terms, GRID, 1e-9)
    assert found[found[:, 0] == 1.0][:, 1:] == pytest.approx(np.array([[0.0, 0.5 * math.log(10.0), 1.0]]), abs=1e-9)
    assert not (found[:, 0] == 0.0).any()
