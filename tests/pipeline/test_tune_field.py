"""Specs as people bring them, and what is right for each, computed independently of the package."""

from __future__ import annotations

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
