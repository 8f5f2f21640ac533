"""The sides of -1 against closed forms, and against dense responses with closed-loop roots."""

from __future__ import annotations

import math

import numpy as np
import pytest

from fopi_tune.core.controller import FoPi
from fopi_tune.core.crossings import gain_crossovers
from fopi_tune.core.loops import Loops, Plants
from fopi_tune.core.plant import Plant
from fopi_tune.design.loop_grid import LoopGrid, numbers_at
from fopi_tune.design.margin_sides import sides_of

GRID = np.geomspace(1e-4, 1e4, 300)


def read(plant: Plant, gains: FoPi) -> tuple[np.ndarray, np.ndarray, np.ndarray, bool]:
    """Phase margin in deg, lag to -1 in deg and frequency of every crossover, and whether the loop is stable."""
    loops = Loops.of(gains, Plants.of(plant))
    crossings = gain_crossovers(loops)
    sides = sides_of(loops, crossings)
    numbers = numbers_at(loops, crossings.row, crossings.u, sides.side, sides.angle_rad)
    degrees = np.degrees(numbers.phase_margin_rad), np.degrees(numbers.lag_to_minus_one_rad)
    return *degrees, crossings.omega_rad_s, bool(sides.stable[0])


@pytest.mark.parametrize("lag_deg", [1.0, 60.0, 100.0, 230.0, 300.0, 415.0])
def test_a_margin_falls_with_the_dead_time_also_where_the_loop_is_unstable(lag_deg: float) -> None:
    # an integrator with kp = 1 crosses at 1 rad/s at -90 deg: a dead time of x rad leaves 90 deg - x, stable below 90
    margin, lag, omega, stable = read(Plant((1.0,), (1.0, 0.0), math.radians(lag_deg)), FoPi(1.0, 0.0, 1.0))
    assert omega == pytest.approx([1.0])
    assert stable is (lag_deg < 90.0)
    assert margin == pytest.approx([90.0 - lag_deg], abs=1e-9)
    assert lag == pytest.approx([90.0 - lag_deg], abs=1e-9)


def test_a_start_of_an_interval_has_to_lag_past_minus_one() -> None:
    # P = k s^2/(s + 1)^2 rises through |L| = 1 at omega = 1/sqrt(k - 1), at 180 deg - 2 atan(omega): it leads -1
    k = 1000.0
    omega = 1.0 / math.sqrt(k - 1.0)
    lead_deg = 2.0 * math.degrees(math.atan(omega))
    margin, lag, at, stable = read(Plant((k, 0.0, 0.0), (1.0, 2.0, 1.0)), FoPi(1.0, 0.0, 1.0))
    assert stable
    assert at == pytest.approx([omega])
    assert margin == pytest.approx([lead_deg])
    assert lag == pytest.approx([360.0 - lead_deg])
    # k s^2/(s - 1)^2 mirrors it: a turn by twice the lead makes the loop stable, and 1 + L has two roots on the right
    margin, _, at, stable = read(Plant((k, 0.0, 0.0), (1.0, -2.0, 1.0)), FoPi(1.0, 0.0, 1.0))
    assert not stable
    assert at == pytest.approx([omega])
    assert margin == pytest.approx([-lead_deg])


def test_crossovers_of_a_stable_loop_are_read_on_the_side_where_they_are() -> None:
    # three crossovers, the phase of two of them past -360 deg; the right values are a dense scan's
    plant = Plant((0.1,), (1.0, 0.04, 1.0), 4.7)
    margin, lag, omega, stable = read(plant, FoPi(1.0, 0.01, 1.0))
    w = np.geomspace(1e-4, 10.0, 4_000_001)
    loop = (1.0 + 0.01 / (1j * w)) * 0.1 / (1.0 - w**2 + 0.04j * w) * np.exp(-4.7j * w)
    at = np.flatnonzero(np.diff(np.abs(loop) > 1.0))
    turned = np.degrees(np.angle(-loop[at]))
    assert stable
    # a step of the scan is 3e-6 of omega, and its phase turns by at most 3e-3 deg in one, at the resonance
    assert margin == pytest.approx(np.abs(turned), abs=0.01)
    assert lag == pytest.approx(np.mod(turned, 360.0), abs=0.01)
    assert (np.radians(lag) / omega).min() == pytest.approx((np.radians(np.mod(turned, 360.0)) / w[at]).min(), rel=1e-4)


def test_the_sign_of_the_smallest_margin_is_stability_by_closed_loop_roots() -> None:
    rng = np.random.default_rng(3)
    seen = {True: 0, False: 0}
    for _ in range(300):
        poles = np.concatenate([-(10.0 ** rng.uniform(-1, 1, 2)), [rng.choice([0.5, -0.5, 0.0])]])
        zeros = rng.choice([-1.0, 1.0], 1) * 10.0 ** rng.uniform(-0.5, 1.5, 1)
        top, bottom = np.poly(zeros) * rng.choice([-1.0, 1.0]), np.poly(poles)
        kp, ki = 10.0 ** rng.uniform(-2, 2, 2)
        margin, _, _, _ = read(Plant(tuple(top), tuple(bottom)), FoPi(kp, ki, 1.0))
        roots = np.roots(np.polyadd(np.append(bottom, 0.0), np.convolve(top, [kp, ki])))
        stable = bool((roots.real < 0.0).all())
        if not len(margin):
            continue
        seen[stable] += 1
        assert bool(margin.min() > 0.0) is stable
    assert min(seen.values()) > 20


def test_the_grid_sees_the_margins_of_the_exact_crossovers() -> None:
    gains = FoPi(1.0, 0.01, 1.0)
    for plant in (Plant((0.1,), (1.0, 0.04, 1.0), 4.7), Plant((1.0,), (2.0, 1.0), 0.5), Plant((1.0,), (1.0, 0.0), 3.0)):
        omega = np.unique(np.concatenate([GRID, np.linspace(0.9, 1.1, 50)]))
        table = LoopGrid(gains, Plants.of(plant), omega)
        margin, _, crossovers, stable = read(plant, gains)
        nominal_margin, u = table.nominal()
        assert math.degrees(nominal_margin) == pytest.approx(margin.min(), abs=1e-6)
        assert math.exp(u) == pytest.approx(crossovers.max(), rel=1e-9)
        assert table.sides().stable[0] == stable
