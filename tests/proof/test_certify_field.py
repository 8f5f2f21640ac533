"""Specs of the field whose margins were once read from the unwrapped phase."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from cases.project import ROOT

import fopi_tune as ft
from fopi_tune.proof import recheck
from fopi_tune.spec import load_spec

FIELD = ROOT / "tests" / "cases" / "field"
RESONANCE_GAINS = ft.FoPi(1.0, 0.01, 1.0)


def test_a_loop_that_passes_minus_1_by_lead_is_not_called_robust() -> None:
    """1000 s^2/(s + 1)^2: |L| = 1 at omega^2 = 1/999, where L leads -1 by 2 atan(omega).

    An unwrapped phase of +176.38 deg there was once a phase margin of 356.38 deg, proved.
    """
    check = ft.prove(FIELD / "phase_lead_side.yaml", ft.FoPi(1.0, 0.0, 1.0))
    margin = math.degrees(2.0 * math.atan(1.0 / math.sqrt(999.0)))
    assert margin == pytest.approx(3.62, abs=5e-3)
    assert check.status == "violated"
    assert check.verification.nominal.phase_margin_deg == pytest.approx(margin, rel=1e-9)
    assert check.certificate.stability.verdict is ft.Verdict.PROVED
    (proof,) = check.certificate.requirements
    assert proof.verdict is ft.Verdict.REFUTED
    (side,) = proof.sides
    assert side.witness is not None
    assert math.degrees(side.witness) == pytest.approx(margin, rel=1e-8)
    # |S| is largest a little beside the crossover
    omega = np.geomspace(0.01, 0.1, 200_001)
    peak = np.abs(1.0 / (1.0 + 1000.0 * (1j * omega) ** 2 / (1j * omega + 1.0) ** 2)).max()
    assert check.verification.stability.peak_sensitivity_db == pytest.approx(20.0 * math.log10(peak), abs=1e-6)
    assert 20.0 * math.log10(peak) == pytest.approx(24.0, abs=0.1)


def loop(omega: np.ndarray) -> np.ndarray:
    s = 1j * omega
    return (1.0 + 0.01 / s) * 0.1 * np.exp(-4.7 * s) / (s * s + 0.04 * s + 1.0)


def test_a_resonance_behind_a_dead_time_has_the_margins_of_its_distance_to_minus_1() -> None:
    """Crossovers 95.5, -99.5 and 102.9 deg from -1; the unwrapped phase made a margin of -257 deg of them."""
    spec = load_spec(FIELD / "resonance_and_delay.yaml")
    check = ft.prove(spec, RESONANCE_GAINS)
    omega = np.geomspace(1e-4, 100.0, 2_000_001)
    gain = loop(omega)
    rows = np.flatnonzero(np.diff(np.sign(np.log(np.abs(gain)))))
    angles, at = np.angle(-gain[rows]), omega[rows]
    assert np.degrees(angles) == pytest.approx([95.5, -99.5, 102.9], abs=0.05)
    # the grid's crossovers are 7e-6 of them away
    nominal = check.verification.nominal
    assert nominal.phase_margin_deg == pytest.approx(np.degrees(np.abs(angles)).min(), rel=1e-4)
    assert nominal.delay_margin_s == pytest.approx((np.mod(angles, 2.0 * np.pi) / at).min(), rel=1e-4)
    assert nominal.delay_margin_s == pytest.approx(1.719, abs=5e-4)
    assert check.status == "met"
    assert check.certificate.verdict is ft.Verdict.PROVED
    phase, delay, sensitivity = check.certificate.requirements
    assert phase.bounds[0] == pytest.approx(nominal.phase_margin_deg, rel=1e-6)
    assert delay.bounds[0] == pytest.approx(nominal.delay_margin_s, rel=1e-6)
    assert sensitivity.bounds[1] == pytest.approx(20.0 * math.log10(np.abs(1.0 / (1.0 + gain)).max()), abs=1e-4)
    assert sensitivity.bounds[1] == pytest.approx(1.91, abs=5e-3)
    assert recheck(check.certificate_document(), spec).is_sound


@pytest.mark.parametrize(("more_s", "stable"), [(1.70, True), (1.72, False)])
def test_that_much_more_dead_time_makes_it_unstable(more_s: float, stable: bool) -> None:
    """Stable at 6.40 s of dead time, unstable at 6.42 s; its delay margin there is none."""
    spec = load_spec(FIELD / "resonance_and_delay.yaml")
    late = {**spec.plant.parameters, "dead_time_s": type(spec.plant.parameters["dead_time_s"]).exactly(4.7 + more_s)}
    spec = dataclasses.replace(spec, plant=dataclasses.replace(spec.plant, parameters=late))
    certificate = ft.prove(spec, RESONANCE_GAINS).certificate
    assert certificate.stability.verdict is (ft.Verdict.PROVED if stable else ft.Verdict.REFUTED)
    delay = certificate.requirements[1]
    assert delay.verdict is ft.Verdict.REFUTED
    assert ("not stable" in delay.reason) is not stable
