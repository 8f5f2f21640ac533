"""Specs as people bring them, and what is right for each, computed independently of the package."""

from __future__ import annotations

import numpy as np
import pytest
from cases.project import ROOT

import fopi_tune as ft

FIELD = ROOT / "tests" / "cases" / "field"


def test_a_flat_phase_is_designed_and_proved_on_samples() -> None:
    design = ft.tune(FIELD / "flat_phase_sampled.yaml")
    assert design.status is ft.Status.SOLVED
    assert design.certificate is not None
    assert design.certificate.verdict is ft.Verdict.PROVED
    # the value is read on samples of 2 ms, where it differs from the continuous loop's by half a sample of phase
    slope = design.requirements[2].result
    assert slope is not None
    assert slope.achieved is not None
    assert -5.0 <= slope.achieved <= 5.0


def test_margins_of_a_resonance_behind_a_dead_time_are_distances_to_minus_one() -> None:
    design = ft.tune(FIELD / "resonance_and_delay.yaml", proof=False)
    assert design.status is ft.Status.SOLVED
    assert design.gains is not None
    phase, delay, peak = (report.result.achieved for report in design.requirements if report.result is not None)
    w = np.geomspace(1e-4, 10.0, 4_000_001)
    loop = (1.0 + design.gains.ki / (1j * w)) * 0.1 / (1.0 - w**2 + 0.04j * w) * np.exp(-4.7j * w)
    at = np.flatnonzero(np.diff(np.abs(loop) > 1.0))
    turned = np.angle(-loop[at])
    # a step of the scan is 3e-6 of omega, in which the phase turns by at most 1e-4 rad
    assert phase == pytest.approx(np.degrees(np.abs(turned).min()), abs=0.01)
    assert delay == pytest.approx((np.mod(turned, 2.0 * np.pi) / w[at]).min(), rel=1e-3)
    assert peak == pytest.approx(-20.0 * np.log10(np.abs(1.0 + loop).min()), abs=1e-4)


def test_a_loop_that_leads_past_minus_one_by_little_has_little_margin() -> None:
    design = ft.tune(FIELD / "phase_lead_side.yaml", proof=False)
    assert design.status is ft.Status.INFEASIBLE
    result = design.requirements[0].result
    assert result is not None
    # |L| = 1 at 1/sqrt(999) rad/s, where the phase is 180 deg - 2 atan(omega)
    assert result.achieved == pytest.approx(np.degrees(2.0 * np.arctan(1.0 / np.sqrt(999.0))))
    assert design.clash[0].new_limit == pytest.approx(result.achieved, abs=1e-3)


def test_bounds_of_robustness_alone_give_the_best_rejection_that_they_allow() -> None:
    design = ft.tune(FIELD / "margins_only.yaml")
    assert design.status is ft.Status.SOLVED
    assert design.gains is not None
    # of a PI with phase margin 60 deg at omega_c the largest ki, by a dense scan of omega_c
    w = np.geomspace(1e-3, 0.2, 400_001)
    plant = np.exp(-14.7j * w) / (1.0 + 21.3j * w)
    controller = -np.exp(1j * np.pi / 3.0) / plant
    kp, ki = controller.real, -controller.imag * w
    best = np.argmax(np.where((kp > 0.0) & (ki > 0.0), ki, 0.0))
    # iae_disturbance is 1/ki but for its horizon
    assert design.gains.ki == pytest.approx(ki[best], rel=2e-3)
    assert design.gains.kp == pytest.approx(kp[best], rel=0.05)
    assert design.to_dict()["objective_quantity"].startswith("minimize iae_disturbance")
    assert any("no objective" in note for note in design.notes)


def test_an_integral_that_vanishes_is_taken_out_and_said() -> None:
    design = ft.tune(FIELD / "no_integral.yaml")
    assert design.status is ft.Status.SOLVED
    assert design.gains is not None
    # |kp/(1 + 0.3j 2.25)| = 1
    assert design.gains.kp == pytest.approx(abs(1.0 + 0.675j))
    assert design.gains.ki == 0.0
    assert design.steady_state_error == pytest.approx(1.0 / (1.0 + abs(1.0 + 0.675j)))
    assert any("no integral action" in note and "45 %" in note for note in design.notes)
