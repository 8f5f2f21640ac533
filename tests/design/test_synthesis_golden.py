"""The numbers the shipped specs must give, and what the published gains are really worth."""

from __future__ import annotations

import numpy as np
import pytest
from cases.project import CONTINUOUS
from cases.shipped_designs import design_of
from oracles.brute_loops import Gains, Loops

import fopi_tune as ft
from fopi_tune.core.controller import FoPi


@pytest.fixture(scope="module")
def brake() -> ft.Design:
    return design_of("brake")


def margins_deg(spec: ft.DesignSpec, gains: FoPi) -> np.ndarray:
    """Phase margins over the family by the tests' own loops, the nominal member first."""
    loops, own = Loops(spec), Gains(gains.kp, gains.ki, gains.alpha)
    row, _, phase = loops.gain_crossovers(own, loops.on_grid(own))
    assert np.array_equal(np.sort(row), np.arange(len(loops.delay)))  # one crossover a member
    return 180.0 + np.degrees(phase[np.argsort(row)])


def test_the_throttle_spec_gives_the_gains_behind_the_published_ones() -> None:
    design = design_of("throttle")
    assert design.status is ft.Status.SOLVED
    assert design.gains is not None
    # Half a unit of the last digit PAPER.md prints is 6e-5 of kp and 2e-4 of ki; the bar is 1e-4.
    assert design.gains.kp == pytest.approx(0.08863, rel=1e-4)
    assert design.gains.ki == pytest.approx(0.0247759, rel=1e-4)
    assert design.gains.alpha == pytest.approx(0.79203, rel=1e-4)
    assert design.objective == pytest.approx(design.gains.ki)


def test_the_brake_spec_gives_the_robust_gains(brake: ft.Design) -> None:
    assert brake.status is ft.Status.SOLVED
    assert brake.gains is not None
    assert brake.gains.kp == pytest.approx(0.38512, rel=1e-4)
    assert brake.gains.ki == pytest.approx(0.38776, rel=1e-4)
    assert brake.gains.alpha == pytest.approx(0.82038, rel=1e-4)


def test_the_brake_keeps_its_phase_margin_over_the_whole_family(brake: ft.Design) -> None:
    assert brake.gains is not None
    found = margins_deg(brake.spec, brake.gains)
    assert found[0] == pytest.approx(90.0, abs=1e-5)  # `equals` is met to 1e-6 rad at worst
    assert found.min() == pytest.approx(82.91, abs=0.005)  # printed to two digits
    assert found.max() == pytest.approx(97.39, abs=0.005)
    assert brake.objective == pytest.approx(np.abs(found - found[0]).max(), rel=1e-5)


def test_the_published_brake_gains_do_not_meet_the_brake_spec() -> None:
    check = ft.prove(CONTINUOUS / "brake.yaml", FoPi(0.07, 0.11, 0.45))
    assert check.status == "violated"
    nominal = check.verification.nominal
    assert nominal.crossover_rad_s == pytest.approx(0.00838, rel=1e-3)  # printed to three digits
    assert nominal.phase_margin_deg == pytest.approx(141.0, abs=0.05)


@pytest.mark.parametrize(("alpha", "kp", "ki"), [(0.8, 0.3501, 0.4013), (0.7, None, None)])
def test_two_equalities_and_a_fixed_alpha_give_the_closed_form(
    alpha: float, kp: float | None, ki: float | None
) -> None:
    # X = e^{j(phi - pi)}/P(j omega_c), phi = 90 deg, omega_c = 0.3 rad/s, tau = 2.25 s (PAPER.md section 3)
    x = -1j * (1 + 0.3j * 2.25)
    ki_closed = -x.imag * 0.3**alpha / np.sin(alpha * np.pi / 2)
    kp_closed = x.real - ki_closed * 0.3**-alpha * np.cos(alpha * np.pi / 2)
    design = ft.tune(
        ft.parse_spec(f"""
schema: 1
name: closed_form
plant: {{model: lag, static_gain: 1.0, time_constant_s: {{nominal: 2.25, min: 1.6, max: 3.1}}}}
controller: {{alpha: {alpha}}}
requirements:
  - {{crossover_rad_s: {{equals: 0.3}}, on: nominal}}
  - {{phase_margin_deg: {{equals: 90}}, on: nominal}}
objective: {{minimize: phase_margin_spread_deg}}
""")
    )
    assert design.gains is not None
    # Equalities are met to 1e-6 in natural units; gains follow them with a factor of a few.
    assert (design.gains.kp, design.gains.ki) == pytest.approx((kp_closed, ki_closed), rel=1e-5)
    if kp is not None:
        assert (design.gains.kp, design.gains.ki) == pytest.approx(
            (kp, ki), abs=5e-5
        )  # PAPER.md section 7, four digits
