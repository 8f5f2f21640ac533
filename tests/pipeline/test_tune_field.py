"""Specs as people bring them, and what is right for each, computed independently of the package."""

from __future__ import annotations

import numpy as np
import pytest
from cases.project import ROOT

import fopi_tune as ft
from fopi_tune.core.controller import FoPi
from fopi_tune.results.candidate import Candidate, Violation

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


def proved(design: ft.Design) -> FoPi:
    """The gains of a design that is solved and proved."""
    assert design.status is ft.Status.SOLVED, design.message
    assert design.certificate is not None
    assert design.certificate.verdict is ft.Verdict.PROVED
    assert design.gains is not None
    return design.gains


def test_a_limit_that_is_reached_as_the_frequency_grows_is_designed_for() -> None:
    # |C S| rises to kp as omega -> inf: 10^(8.16/20) = 2.55859 is the largest kp
    gains = proved(ft.tune(FIELD / "failed_kp_at_infinity.yaml"))
    assert gains.kp == pytest.approx(10.0 ** (8.16 / 20.0), rel=1e-5)
    assert gains.ki == pytest.approx(3.003, rel=1e-3)
    assert gains.alpha == pytest.approx(1.4, rel=1e-6)


def test_the_worst_plant_inside_of_a_wide_range_is_designed_for() -> None:
    gains = proved(ft.tune(FIELD / "wide_gain_range.yaml"))
    assert (gains.kp, gains.ki) == pytest.approx((37.04, 69.355), rel=1e-4)
    # the right values are those at which two plants bind: the largest gain, and one of 1.10 inside of the range
    omega = np.geomspace(0.5, 30.0, 40_001)
    peaks = []
    for gain, first, last in ((10.0, 21.0, 20.0), (1.1, 35.0, 20.0)):
        loop = (gains.kp + gains.ki / (1j * omega)) * gain / (last - omega**2 + 1j * first * omega)
        peaks.append(20.0 * np.log10(np.abs(loop / (1.0 + loop))).max())
    assert peaks == pytest.approx([1.5836, 1.5836], abs=2e-4)


def test_a_refutation_that_remains_is_named_with_its_plant_and_frequency(monkeypatch: pytest.MonkeyPatch) -> None:
    # a search that does not know of the limit: the check does
    spec = ft.load_spec(FIELD / "failed_kp_at_infinity.yaml")
    gains = FoPi(2.5588, 3.0, 1.4)
    monkeypatch.setattr("fopi_tune.design.design", lambda *_, **__: Candidate(ft.Status.SOLVED, gains, (None, None)))
    design = ft.tune(spec)
    assert design.status is ft.Status.FAILED
    assert "control_sensitivity_db is 8.16072" in design.message
    assert "(at_most 8.16) as omega tends to infinity with static_gain = " in design.message
    assert "time_constant_s = " in design.message


def test_what_the_proof_alone_refutes_is_named_too(monkeypatch: pytest.MonkeyPatch) -> None:
    # gains that a check in floating point passes which only samples this box; a plant of gain 1.09 exceeds the limit
    monkeypatch.setattr("fopi_tune.proof.verification.worst_case._NEXT_TO_THE_BOUNDARY", np.array([0.5]))
    spec = ft.load_spec(FIELD / "wide_gain_range.yaml")
    gains = FoPi(37.02698887179, 69.38097160089315, 1.0)
    asked: list[tuple[Violation, ...]] = []

    def search(_: object, violations: tuple[Violation, ...], *__: object, **___: object) -> Candidate:
        asked.append(violations)
        return Candidate(ft.Status.SOLVED, gains, (None,))

    monkeypatch.setattr("fopi_tune.design.design", search)
    design = ft.tune(spec)
    assert design.status is ft.Status.FAILED
    # the refutation came back as a violation, and the same one again ends it
    assert len(asked) == 2
    (violation,) = asked[1]
    assert 1.0 < violation.theta[0] < 1.3
    assert violation.theta[1:] == (35.0, 20.0)
    assert violation.omega_rad_s == pytest.approx(1.1, rel=0.2)
    assert "complementary_sensitivity_db is 1.58" in design.message
    assert f"at {violation.omega_rad_s:.6g} rad/s with numerator[0] = {violation.theta[0]:.9g}" in design.message


def test_a_refutation_after_which_the_search_finds_nothing_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    spec = ft.load_spec(FIELD / "failed_kp_at_infinity.yaml")

    def search(_: object, violations: tuple[Violation, ...], *__: object, **___: object) -> Candidate:
        if violations:
            return Candidate(ft.Status.FAILED, None, (None, None), (), "the search gave up")
        return Candidate(ft.Status.SOLVED, FoPi(2.5588, 3.0, 1.4), (None, None))

    monkeypatch.setattr("fopi_tune.design.design", search)
    message = ft.tune(spec, proof=False).message
    assert message.startswith(
        "the search gave up; the check refuted the best gains found: control_sensitivity_db is 8.16"
    )
    assert "as omega tends to infinity with static_gain = " in message


def test_an_unstable_plant_that_the_check_finds_comes_back_as_a_cut(monkeypatch: pytest.MonkeyPatch) -> None:
    # nothing is asked but a small |C S| from 1 rad/s on, which an unstable loop has too: only stability refutes it
    spec = ft.parse_spec(
        "schema: 1\nname: x\nplant: {model: pole, gain: 1, pole_rad_s: {min: -1, max: 1}}\n"
        "controller: {kp: {min: 0, max: 9}, ki: {min: 0, max: 9}, alpha: 1}\n"
        "requirements: [{control_sensitivity_db: {at_most: 20}, from_rad_s: 1}]\n"
        "objective: {maximize: ki}\n"
    )
    asked: list[tuple[Violation, ...]] = []
    known = ft.tune(spec, proof=False)

    def search(_: object, violations: tuple[Violation, ...], *__: object, **___: object) -> Candidate:
        asked.append(violations)
        return Candidate(ft.Status.SOLVED, known.gains if violations else FoPi(0.5, 0.1, 1.0), (None,))

    monkeypatch.setattr("fopi_tune.design.design", search)
    assert ft.tune(spec, proof=False).status is ft.Status.SOLVED
    assert [violation.requirement for violation in asked[1]] == [None]
    # kp + pole > 0 is stable: the worst plant found is one with a pole at -kp or beyond
    assert asked[1][0].theta[0] <= -0.5
