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
