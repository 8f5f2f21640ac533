"""Quantities at crossings: margins of stable loops alone, the others of every loop with a crossover."""

from __future__ import annotations

import math

import numpy as np
import pytest

from fopi_tune.core.controller import FoPi
from fopi_tune.core.loops import Loops, Plants
from fopi_tune.core.margins import margins
from fopi_tune.core.plant import Plant
from fopi_tune.quantities import QUANTITIES

MARGINS = {"phase_margin_deg", "delay_margin_s", "gain_margin_db"}
#: stable with and without a crossover, and unstable with and without
CASES = (
    (FoPi(2.0, 0.0, 1.0), Plant((1.0,), (1.0, 1.0))),
    (FoPi(0.5, 0.0, 1.0), Plant((1.0,), (1.0, 1.0))),
    (FoPi(0.0, 1.0, 1.9), Plant((1.0,), (1.0, 0.0))),
    (FoPi(0.5, 0.0, 1.0), Plant((1.0,), (1.0, -1.0))),
    (FoPi(4.0, 0.0, 1.0), Plant((1.0,), (1.0, 3.0, 3.0, 1.0), 0.1)),
)


def measured(quantity: str, controller: FoPi, plant: Plant) -> float:
    loops = Loops.of(controller, Plants.of(plant))
    return float(QUANTITIES[quantity].measure(loops, False, 0.0, math.inf).value[0])


def test_margins_are_the_quantities_that_are_distances_to_minus_one() -> None:
    assert {name for name, quantity in QUANTITIES.items() if quantity.is_margin} == MARGINS


@pytest.mark.parametrize(("controller", "plant"), CASES)
def test_a_margin_that_a_requirement_limits_is_that_of_the_loop(controller: FoPi, plant: Plant) -> None:
    found = margins(controller, plant)
    for quantity in (*MARGINS, "crossover_rad_s", "phase_slope_deg_per_decade"):
        expected = getattr(found, quantity)
        value = measured(quantity, controller, plant)
        assert math.isnan(value) if expected is None else value == pytest.approx(expected, rel=1e-12)


def test_the_sign_of_a_margin_is_that_of_stability_not_of_the_phase() -> None:
    """With k on the wrong side of 1 the angle lies beyond -1, by as much as on the right one."""
    # k (s + 1)/(s (s - 1)): s^2 + (k - 1) s + k is stable for k > 1; at |L| = 1 the angle is 2 atan(omega) - 90 deg
    plant = Plant((1.0, 1.0), (1.0, -1.0))
    for k, stable in ((1.5, True), (0.75, False)):
        controller = FoPi(0.0, k, 1.0)
        # |L| = k/omega
        angle = 2.0 * math.degrees(math.atan(k)) - 90.0
        assert margins(controller, plant).angles_from_minus_one_deg == pytest.approx((angle,), abs=1e-9)
        value = measured("phase_margin_deg", controller, plant)
        assert value == pytest.approx(angle, abs=1e-9) if stable else math.isnan(value)


@pytest.mark.parametrize("limit", [180.0, 179.0, 1e-3, 0.0, -5.0])
def test_a_phase_margin_of_half_a_turn_at_most_can_be_asked_for(limit: float) -> None:
    assert QUANTITIES["phase_margin_deg"].check_limit(limit) is None


@pytest.mark.parametrize("limit", [np.nextafter(180.0, 181.0), 200.0, 1e9])
def test_no_loop_is_farther_from_minus_one_than_half_a_turn(limit: float) -> None:
    words = QUANTITIES["phase_margin_deg"].check_limit(limit)
    assert words is not None
    assert "180 deg" in words
