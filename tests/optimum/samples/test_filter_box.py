"""Filters over boxes of orders: what they state holds for orders and frequencies drawn from the boxes."""

from __future__ import annotations

import math

import numpy as np
import pytest
from flint import acb, arb

from fopi_tune.core.terms.digital_spec import DigitalSpec
from fopi_tune.optimum.samples.filter_box import FilterBox
from fopi_tune.optimum.samples.filter_of_order import FilterOfOrder
from fopi_tune.proof.balls.box import ball_of

METHODS = [DigitalSpec(0.2, "oustaloup", 7, (1e-3, 1e3)), DigitalSpec(0.1, "modified_oustaloup", 4, (0.05, 20.0))]
BOXES = [(0.3, 1.5), (0.79, 0.83), (1.2, 1.204), (0.9, 1.1), (0.1, 0.6), (1.0, 1.9), (0.7, 0.7)]
#: rounding of the floating-point numbers that are compared
ROOM = 1e-10


def box_of(digital: DigitalSpec, orders: tuple[float, float], nu: float = 0.03, log_unit: float = 0.0) -> FilterBox:
    middle = arb(0.5 * (orders[0] + orders[1]))
    return FilterBox(FilterOfOrder(digital), ball_of(orders), middle, arb(nu), arb(log_unit))


def holds(ball: acb, value: complex) -> bool:
    """Whether a value lies in both parts of a ball, but for rounding."""
    room = ROOM * abs(value)
    return bool((ball.real - value.real).abs_lower() <= room) and bool((ball.imag - value.imag).abs_lower() <= room)


@pytest.mark.parametrize("digital", METHODS, ids=lambda d: d.method)
@pytest.mark.parametrize("orders", BOXES)
def test_enclosures_hold_every_order_and_frequency(digital: DigitalSpec, orders: tuple[float, float]) -> None:
    pick, nu = np.random.default_rng(3), 0.03
    box, filtered = box_of(digital, orders, nu), FilterOfOrder(digital)
    for _ in range(12):
        middle, width = pick.uniform(-7.0, 4.0), 10.0 ** pick.uniform(-4.0, 0.0)
        u = (middle - width, middle + width)
        response, slope, lag = box.response(u), box.slope(u), box.lag(u)
        rates = box.derivatives_from_anchor(acb(0, ball_of(u).exp()))
        low, high = box.sizes(u[1])[0], box.sizes(u[0])[1]
        for _ in range(15):
            alpha, at = pick.uniform(*orders), pick.uniform(*u)
            value, one, two = filtered.in_floats(np.array([1j * math.exp(at)]), np.array([alpha]))
            anchor, anchor_one, anchor_two = filtered.in_floats(np.array([1j * nu]), np.array([alpha]))
            ratio = complex(value[0] / abs(anchor[0]))
            assert holds(response, ratio)
            assert low - ROOM <= abs(ratio) * (1.0 + ROOM)
            assert abs(ratio) * (1.0 - ROOM) <= high + ROOM
            assert (lag + math.atan2(ratio.imag, ratio.real)).abs_lower() <= ROOM
            assert holds(rates[0] + 9.0, complex(one[0] - anchor_one[0].real) + 9.0)
            assert holds(rates[1] + 9.0, complex(two[0] - anchor_two[0].real) + 9.0)
            step = 1e-5
            near = filtered.in_floats(1j * np.exp(at + step * np.array([-1.0, 1.0])), np.array([alpha]))[0]
            assert (slope.real - np.log(near[1] / near[0]).real / (2.0 * step)).abs_lower() <= 1e-5
            assert (slope.imag - np.log(near[1] / near[0]).imag / (2.0 * step)).abs_lower() <= 1e-5


@pytest.mark.parametrize("digital", METHODS, ids=lambda d: d.method)
@pytest.mark.parametrize("orders", BOXES)
def test_sizes_at_the_anchor_and_lags_in_the_tails_hold_every_order(
    digital: DigitalSpec, orders: tuple[float, float]
) -> None:
    pick, nu, unit = np.random.default_rng(4), 0.3, math.log(0.7)
    box, filtered = box_of(digital, orders, nu, unit), FilterOfOrder(digital)
    size = box.anchor_size
    for alpha in [*orders, *pick.uniform(*orders, 40)]:
        value = complex(filtered.in_floats(np.array([1j * nu]), np.array([alpha]))[0][0])
        assert (size / (abs(value) * math.exp(alpha * unit)) - 1).abs_lower() <= ROOM
        assert (box.lag_at_anchor + math.atan2(value.imag, value.real)).abs_lower() <= ROOM
        for u, interval in ((-40.0, (-math.inf, -5.0)), (9.0, (5.0, math.inf))):
            value = complex(filtered.in_floats(np.array([1j * math.exp(u)]), np.array([alpha]))[0][0])
            assert (box.lag(interval) + math.atan2(value.imag, value.real)).abs_lower() <= ROOM


@pytest.mark.parametrize("method", ["oustaloup", "modified_oustaloup"])
def test_sizes_fall_along_the_axis_and_no_filter_lags_by_more_than_180_deg(method: str) -> None:
    pick, w = np.random.default_rng(5), 1j * np.exp(np.linspace(-20.0, 12.0, 2001))
    for _ in range(100):
        low, poles = 10.0 ** pick.uniform(-4.0, 0.0), int(pick.integers(1, 9))
        digital = DigitalSpec(
            10.0 ** pick.uniform(-3.0, 0.5), method, poles, (low, low * 10.0 ** pick.uniform(0.3, 6.0))
        )
        for alpha in (*pick.uniform(0.01, 1.99, 3), 1.999):
            value = FilterOfOrder(digital).in_floats(w, np.full(len(w), alpha))[0]
            lag = np.arctan2(-value.imag, value.real) % (2.0 * math.pi)
            low_deg, high_deg = (0.0, 90.0) if alpha < 1.0 else (90.0, 180.0)
            assert low_deg - ROOM <= np.degrees(lag.min())
            assert np.degrees(lag.max()) <= high_deg + ROOM
            assert np.diff(np.log(np.abs(value))).max() <= ROOM


@pytest.mark.parametrize("digital", METHODS, ids=lambda d: d.method)
def test_narrow_boxes_have_sharp_enclosures(digital: DigitalSpec) -> None:
    box = box_of(digital, (0.8, 0.801))
    # of the size of the box, and not of the sum of the filter's terms
    assert float(box.derivatives_from_anchor(acb(0, arb(0.5)))[1].real.rad()) < 1e-3
    assert float(box.response((-1.0, -0.999)).real.rad()) < 5e-3
