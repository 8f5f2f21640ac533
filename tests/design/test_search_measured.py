"""Gains for measured responses: those of the plants that were sampled, and no gains of a brute search are better."""

from __future__ import annotations

import math

import numpy as np
import pytest
from cases.measured import LAG, PLANTS, TWO, csv, curve, measured_spec, rational_spec, text_of
from scipy.optimize import minimize

from fopi_tune.core.bode_form import Array
from fopi_tune.core.controller import FoPi
from fopi_tune.core.measured.family import MeasuredFamily
from fopi_tune.design.measured.problem import problem_of
from fopi_tune.errors import DomainError
from fopi_tune.pipeline.tune import tune
from fopi_tune.proof.verification.verify import verify
from fopi_tune.results.status import Status
from fopi_tune.spec.load import parse_spec
from fopi_tune.spec.model import DesignSpec

FOPI = "{kp: {min: 0, max: 20}, ki: {min: 0, max: 20}, alpha: {min: 0.5, max: 1.4}}"
PI = "{structure: pi, kp: {min: 0, max: 20}, ki: {min: 0, max: 20}}"
PID = (
    "{structure: pid, kp: {min: 0, max: 20}, ki: {min: 0, max: 20}, kd: {min: 0, max: 5}, "
    "derivative_filter_time_constant_s: 0.05}"
)
FOPID = (
    "{structure: fopid, kp: {min: 0, max: 20}, ki: {min: 0, max: 20}, kd: {min: 0, max: 5}, alpha: {min: 0.6, max: "
    "1.3}, mu: {min: 0.5, max: 1}, derivative_filter_time_constant_s: 0.05}"
)
ASKED = {
    "ki": ("[{phase_margin_deg: {at_least: 50}}, {sensitivity_db: {at_most: 5}}]", "{maximize: ki}"),
    "peak": (
        "[{crossover_rad_s: {at_least: 1}}, {gain_margin_db: {at_least: 6}}]", "{minimize: sensitivity_peak_db}",
    ),
    "load": ("[{sensitivity_db: {at_most: 5}}]", "{minimize: load_sensitivity_peak_db}"),
    "control": (
        "[{sensitivity_db: {at_most: 5}}, {crossover_rad_s: {at_least: 0.8}}]",
        "{minimize: control_sensitivity_peak_db}",
    ),
    "lag": (
        "[{delay_margin_s: {at_least: 0.4}}, {complementary_sensitivity_db: {at_most: 3}}, "
        "{sensitivity_db: {at_most: {by_frequency: [[0.01, -30], [0.1, -10]]}}}]", "{maximize: ki}",
    ),
}  # fmt: skip


@pytest.mark.thinned(7)
@pytest.mark.parametrize("name", ["lag", "two", "integrator", "unstable"])
@pytest.mark.parametrize("controller", [FOPI, PI, PID])
@pytest.mark.parametrize("asked", ASKED)
def test_the_best_gains_are_those_of_the_sampled_plant(asked: str, controller: str, name: str) -> None:
    measured = tune(measured_spec(PLANTS[name], *ASKED[asked], controller))
    exact = tune(rational_spec(PLANTS[name], *ASKED[asked], controller), proof=False, bracket=False)
    assert measured.status is exact.status
    assert measured.certificate is None
    if exact.status is Status.SOLVED:
        assert all(report.verdict == "checked" for report in measured.requirements)
        # at 60 points a decade, in dB and as a part of ki
        assert measured.objective == pytest.approx(exact.objective, rel=1e-3, abs=2e-3)


@pytest.mark.thinned(3)
@pytest.mark.parametrize("asked", ["ki", "peak", "lag"])
def test_a_fopid_is_that_of_the_sampled_plant(asked: str) -> None:
    measured = tune(measured_spec(TWO, *ASKED[asked], FOPID))
    exact = tune(rational_spec(TWO, *ASKED[asked], FOPID), proof=False, bracket=False)
    assert measured.status is exact.status is Status.SOLVED
    assert measured.objective == pytest.approx(exact.objective, rel=3e-3, abs=5e-3)


def test_equalities_are_met_on_the_curve() -> None:
    asked = "[{crossover_rad_s: {equals: 1.2}, on: nominal}, {phase_margin_deg: {equals: 60}, on: nominal}]"
    design = tune(measured_spec(LAG, asked, "{minimize: sensitivity_peak_db}"))
    assert design.status is Status.SOLVED
    gains, known = design.gains, curve(LAG)
    assert gains is not None
    loop = np.exp(known.log_at(np.log([1.2])))[0] * (gains.kp + gains.ki * 1.2j**-gains.alpha)
    assert abs(loop) == pytest.approx(1.0, abs=1e-5)
    assert math.degrees(np.angle(-loop)) == pytest.approx(60.0, abs=1e-3)


def _noisy(deviation: float = 0.01) -> DesignSpec:
    asked = "[{phase_margin_deg: {at_least: 50}}, {sensitivity_db: {at_most: 5}}]"
    return measured_spec(TWO, asked, "{maximize: ki}", PI, csv(TWO, 0.02, 50.0, 61, deviation))


def _brute_force(spec: DesignSpec, known: FoPi) -> tuple[float, float]:
    """The largest ki by a grid over kp and ki and Nelder-Mead from its best, on dense columns of all members.

    And by how much gains that are known miss the requirements there, dB or deg.
    """
    family = spec.plant
    assert isinstance(family, MeasuredFamily)
    low, high = np.log(family.band_rad_s)
    u = np.linspace(low, high, 3001)
    plants = np.exp([member.table.log_at(u) for member in family.members])

    def misses(kp: float, ki: float) -> float:
        loops = plants * (kp + ki / (1j * np.exp(u)))
        sensitivity = -20.0 * np.log10(np.abs(1.0 + loops)).min() - 5.0
        size = np.abs(loops)
        crossing = (size[:, 1:] < 1.0) != (size[:, :-1] < 1.0)
        angle = np.degrees(np.abs(np.angle(-loops[:, 1:])))
        return max(sensitivity, float(50.0 - angle[crossing].min(initial=180.0)))

    def cost(x: Array) -> float:
        kp, ki = float(x[0]), float(x[1])
        return -ki + 10.0 * max(misses(kp, ki), 0.0) if min(kp, ki) > 0.0 else 1e9

    grid = [(kp, ki) for kp in np.linspace(0.05, 6.0, 40) for ki in np.linspace(0.05, 6.0, 40)]
    best = min(grid, key=lambda x: cost(np.array(x)))
    options = {"xatol": 1e-6, "fatol": 1e-7, "maxiter": 2000}
    found = -float(minimize(cost, np.array(best), method="Nelder-Mead", options=options).fun)
    return found, misses(known.kp, known.ki)


def test_no_gains_of_a_brute_search_are_better_for_nine_noisy_members() -> None:
    spec = _noisy()
    design = tune(spec)
    assert design.status is Status.SOLVED
    assert design.gains is not None
    assert design.objective is not None
    best, missed = _brute_force(spec, design.gains)
    # the columns of the brute search are 0.003 apart in ln omega, where the angle changes by 0.1 deg
    assert missed < 0.1
    assert design.objective > best * (1.0 - 2e-3)


def test_gains_for_a_measurement_with_its_deviation_hold_for_the_plant_behind_it() -> None:
    design = tune(_noisy(0.02))
    assert design.gains is not None
    assert verify(rational_spec(TWO, *ASKED["ki"], PI), design.gains).all_met


def test_a_spec_that_cannot_be_met_names_what_clashes() -> None:
    design = tune(
        measured_spec(LAG, "[{crossover_rad_s: {at_least: 4}}, {phase_margin_deg: {at_least: 70}}]", controller=PI)
    )
    assert design.status is Status.INFEASIBLE
    assert {each.requirement for each in design.clash} == {0, 1}
    assert all(each.new_limit is not None for each in design.clash)


def test_a_negative_plant_asks_for_negative_gains() -> None:
    asked = ("[{crossover_rad_s: {at_least: 1}}, {phase_margin_deg: {at_least: 50}}]", "{maximize: ki}")
    refused = tune(measured_spec(PLANTS["negative"], *asked, PI))
    assert refused.status is Status.INFEASIBLE
    assert "allow negative kp and ki" in refused.message
    other = "{structure: pi, kp: {min: -20, max: 0}, ki: {min: -20, max: -0.1}}"
    assert tune(measured_spec(PLANTS["negative"], *asked, other)).status is Status.SOLVED


def test_without_the_number_of_unstable_poles_no_gains_are_chosen() -> None:
    text = text_of("{model: frequency_response, file: f.csv}", *ASKED["ki"])
    with pytest.raises(DomainError, match="write unstable_poles: 0 under plant: for a stable plant"):
        tune(parse_spec(text, files={"f.csv": csv(LAG)}))
    with pytest.raises(DomainError, match="measure from lower frequencies"):
        tune(measured_spec(LAG, *ASKED["ki"], data=csv(LAG, 0.4, 100.0, 61)))


def test_gains_keep_the_loop_decided_at_both_ends_of_the_band() -> None:
    problem = problem_of(measured_spec(LAG, *ASKED["ki"]))
    upper, lower = problem.constraints[-2:]
    assert (upper.quantity.name, upper.from_rad_s) == ("loop_gain_db", pytest.approx(1e3))
    assert (lower.quantity.name, lower.from_rad_s) == ("loop_gain_db", pytest.approx(1e-3))


def test_fixed_gains_are_checked() -> None:
    design = tune(measured_spec(LAG, ASKED["ki"][0], controller="{kp: 1, ki: 1, alpha: 0.9}"))
    assert design.status is Status.SOLVED
    assert design.gains == FoPi(1.0, 1.0, 0.9)
