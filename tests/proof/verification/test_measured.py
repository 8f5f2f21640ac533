"""Checks of measured responses, against those of the plants that were sampled and against a dense evaluation."""

from __future__ import annotations

import math

import numpy as np
import pytest
from cases.measured import INTEGRATOR, LAG, PLANTS, TWO, csv, curve, measured_spec, rational_spec

from fopi_tune.core.controller import FoPi, FoPid, Pid
from fopi_tune.core.measured.family import MeasuredFamily
from fopi_tune.errors import DomainError
from fopi_tune.proof.verification.measured import reassessed
from fopi_tune.proof.verification.results import Outcome
from fopi_tune.proof.verification.verify import reassess, verify
from fopi_tune.spec.load import parse_spec
from fopi_tune.spec.model import DesignSpec

EVERY = """[
  {crossover_rad_s: {between: [0.1, 9]}}, {phase_margin_deg: {at_least: 30}}, {gain_margin_db: {at_least: 3}},
  {delay_margin_s: {at_least: 0.05}}, {phase_slope_deg_per_decade: {at_most: 500}},
  {sensitivity_db: {at_most: {by_frequency: [[0.01, -20], [0.1, -3], [10, 6]]}}},
  {complementary_sensitivity_db: {at_most: 6}, from_rad_s: 0.01, to_rad_s: 100},
  {control_sensitivity_db: {at_most: 30}, to_rad_s: 100},
  {load_sensitivity_db: {at_most: 20}}, {loop_gain_db: {at_least: -30}, to_rad_s: 1},
  {sensitivity_db: {at_most: 3}, at_rad_s: 0.3}
]"""
FOPID = "{structure: fopid, kp: 2, ki: 1, alpha: 0.9, kd: 0.2, mu: 0.8, derivative_filter_time_constant_s: 0.05}"
PID = "{structure: pid, kp: 2, ki: 1, kd: 0.2, derivative_filter_time_constant_s: 0.05}"
FILTERED = "{kp: 1, ki: 0.8, alpha: 0.9, measurement_filter: {order: 2, time_constant_s: 0.05}}"


@pytest.mark.parametrize("name", ["lag", "two", "integrator", "unstable"])
@pytest.mark.parametrize("controller", ["{kp: 1, ki: 0.8, alpha: 0.9}", PID, FOPID, FILTERED])
def test_every_quantity_is_that_of_the_sampled_plant(name: str, controller: str) -> None:
    objective = "{minimize: sensitivity_peak_db}"
    measured = measured_spec(PLANTS[name], EVERY, objective, controller)
    exact = rational_spec(PLANTS[name], EVERY, objective, controller)
    gains = measured.controller.fixed
    assert gains is not None
    mine, other = verify(measured, gains), verify(exact, gains)
    assert mine.stability.stable == other.stability.stable
    assert mine.stability.unstable_poles == other.stability.unstable_poles
    for found, known in zip(mine.requirements, other.requirements, strict=True):
        # 60 points a decade: some 1e-4 neper and, where the dead time turns fast, rad
        assert found.outcome == known.outcome, found.requirement.quantity
        if known.achieved is not None:
            # a slope of the curve is less exact than its values
            off = 2e-2 if "slope" in found.requirement.quantity else 2e-3
            assert found.achieved == pytest.approx(known.achieved, rel=off, abs=2e-3), found.requirement.quantity
    assert mine.nominal.crossover_rad_s == pytest.approx(other.nominal.crossover_rad_s, rel=1e-4)
    assert mine.objective == pytest.approx(other.objective, abs=2e-3)


def test_values_are_those_of_a_dense_evaluation_of_its_own() -> None:
    """The curve by NumPy alone: interpolation, controller, response and extreme are written down again here."""
    spec = measured_spec(
        TWO,
        "[{sensitivity_db: {at_most: 6}}, {phase_margin_deg: {at_least: 10}}]",
        "{maximize: ki}",
        data=csv(TWO, 0.01, 100.0, 61, 0.03),
    )
    family = spec.plant
    assert isinstance(family, MeasuredFamily)
    gains = FoPi(1.2, 1.5, 0.9)
    found = verify(spec, gains)
    u = np.linspace(math.log(0.01), math.log(100.0), 200_001)
    s = 1j * np.exp(u)
    peaks, margins = [], []
    for member in family.members:
        loop = np.exp(member.table.log_at(u)) * (gains.kp + gains.ki * s**-gains.alpha)
        peaks.append(np.max(-20.0 * np.log10(np.abs(1.0 + loop))))
        k = np.flatnonzero(np.diff(np.sign(np.abs(loop) - 1.0)))
        margins.append(np.min(np.abs(np.degrees(np.angle(-loop[k])))))
    assert found.requirements[0].achieved == pytest.approx(max(peaks), abs=1e-6)
    assert found.requirements[1].achieved == pytest.approx(min(margins), abs=0.02)
    assert found.requirements[0].worst.member == family.members[int(np.argmax(peaks))].name
    assert found.requirements[1].worst.point == (float(np.argmin(margins)),)


def _of(plant: str, requirements: str, objective: str = "{maximize: ki}") -> DesignSpec:
    files = {"a.csv": csv(LAG), "b.csv": csv(TWO), "c.csv": csv(LAG, 0.4, 100.0, 61)}
    text = f"schema: 1\nname: x\nplant: {plant}\nrequirements: {requirements}\nobjective: {objective}\n"
    return parse_spec(text, files=files)


def test_without_the_number_of_unstable_poles_margins_are_undecided_and_the_rest_is_checked() -> None:
    spec = _of(
        "{model: frequency_response, file: a.csv}",
        "[{phase_margin_deg: {at_least: 50}}, {sensitivity_db: {at_most: 6}}]",
    )
    found = verify(spec, FoPi(1.0, 1.0, 0.9))
    assert found.stability.undecided
    assert not found.stability.stable
    assert [each.outcome for each in found.requirements] == [Outcome.UNDECIDED, Outcome.MET]
    assert found.nominal.phase_margin_deg is None
    assert not found.all_met


def test_the_ends_of_the_band_can_leave_stability_open() -> None:
    spec = _of("{model: frequency_response, file: c.csv, unstable_poles: 0}", "[{phase_margin_deg: {at_least: 50}}]")
    found = verify(spec, FoPi(1.0, 1.0, 0.9))
    assert found.stability.undecided
    assert "measure from lower frequencies" in found.stability.reason


def test_what_is_nominal_is_about_the_first_file() -> None:
    asked = "[{phase_margin_deg: {at_least: 10}, on: nominal}, {phase_margin_deg: {at_least: 10}}]"
    both = verify(
        _of("{model: frequency_response, files: [b.csv, a.csv], unstable_poles: 0}", asked), FoPi(1.0, 1.0, 0.9)
    )
    alone = [
        verify(_of(f"{{model: frequency_response, file: {file}, unstable_poles: 0}}", asked), FoPi(1.0, 1.0, 0.9))
        for file in ("b.csv", "a.csv")
    ]
    assert both.requirements[0].achieved == alone[0].requirements[0].achieved
    worst = min(alone, key=lambda each: each.requirements[1].achieved or 0.0)
    assert both.requirements[1].achieved == worst.requirements[1].achieved
    assert both.requirements[1].worst.member == ["b.csv", "a.csv"][alone.index(worst)]


def test_an_unstable_loop_has_no_margin_and_is_named() -> None:
    spec = _of(
        "{model: frequency_response, files: [a.csv, b.csv], unstable_poles: 0}", "[{phase_margin_deg: {at_least: 10}}]"
    )
    found = verify(spec, FoPi(30.0, 30.0, 1.0))
    assert not found.stability.stable
    assert not found.stability.undecided
    assert found.stability.unstable_poles == 2
    assert found.requirements[0].outcome is Outcome.UNSTABLE


@pytest.mark.parametrize("objective", ["phase_margin_spread_deg", "crossover_spread_db"])
def test_spreads_are_measured_from_the_first_member(objective: str) -> None:
    asked = "[{sensitivity_db: {at_most: 9}}]"
    spec = _of(
        "{model: frequency_response, files: [a.csv, b.csv], unstable_poles: 0}", asked, f"{{minimize: {objective}}}"
    )
    gains = FoPi(1.0, 1.0, 0.9)
    found = verify(spec, gains)
    margins = [
        verify(_of(f"{{model: frequency_response, file: {file}, unstable_poles: 0}}", asked), gains).nominal
        for file in ("a.csv", "b.csv")
    ]
    if objective == "phase_margin_spread_deg":
        expected = abs((margins[0].phase_margin_deg or 0.0) - (margins[1].phase_margin_deg or 0.0))
    else:
        omega = margins[0].crossover_rad_s or 0.0
        loop = np.exp(curve(TWO).log_at(np.log([omega]))) * (1.0 + (1j * omega) ** -0.9)
        expected = abs(20.0 * math.log10(abs(loop[0])))
    assert found.objective == pytest.approx(expected, rel=1e-3)


def test_other_limits_need_no_new_look() -> None:
    spec = measured_spec(LAG, "[{phase_margin_deg: {at_least: 50}}]", "{maximize: ki}")
    found = verify(spec, FoPi(1.0, 1.0, 0.9))
    stricter = measured_spec(LAG, "[{phase_margin_deg: {at_least: 100}}]", "{maximize: ki}")
    assert reassess(stricter, found).requirements == verify(stricter, FoPi(1.0, 1.0, 0.9)).requirements
    unknown = _of("{model: frequency_response, file: a.csv}", "[{phase_margin_deg: {at_least: 50}}]")
    undecided = verify(unknown, FoPi(1.0, 1.0, 0.9))
    assert reassessed(unknown, undecided).requirements[0].outcome is Outcome.UNDECIDED
    assert reassess(unknown, undecided).requirements[0].outcome is Outcome.UNDECIDED


def test_no_controller_is_refused() -> None:
    with pytest.raises(DomainError, match="there is no controller"):
        verify(measured_spec(INTEGRATOR, "[{phase_margin_deg: {at_least: 50}}]", "{maximize: ki}"), FoPi(0.0, 0.0, 1.0))


@pytest.mark.parametrize("gains", [Pid(1.0, 1.0, 0.1, 0.05), FoPid(1.0, 1.0, 0.9, 0.1, 0.8, 0.05)])
def test_a_loop_without_a_crossover_in_the_band_has_no_crossover_value(gains: FoPi) -> None:
    asked = "[{crossover_rad_s: {at_least: 20}}]"
    found = verify(measured_spec(TWO, asked, data=csv(TWO, 10.0, 100.0, 61)), gains)
    assert found.requirements[0].outcome is Outcome.NO_CROSSOVER
