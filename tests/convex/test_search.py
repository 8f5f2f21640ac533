"""The convex path:  its constraints against the loops they linearise, its optima against those of Ipopt."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from cases.design_cases import CASES
from cases.plants import brake, lag, lag_gain_and_delay, spec_of, transfer_function
from cases.project import CONTINUOUS
from typer.testing import CliRunner

import fopi_tune as ft
from fopi_tune.cli import app
from fopi_tune.convex import convex_design
from fopi_tune.convex.cone_constraints import ConeConstraints, constraints_at
from fopi_tune.convex.convex_concave import TOLERANCE, ConvexConcaveProcedure, LocalResult, Members
from fopi_tune.convex.evaluate import ConstraintPoints, evaluate
from fopi_tune.convex.limits import Task, task_of
from fopi_tune.convex.program import Program
from fopi_tune.core.controller import FoPi
from fopi_tune.design import design
from fopi_tune.proof import verify
from fopi_tune.results.candidate import Candidate, Violation
from fopi_tune.spec import load_spec
from fopi_tune.spec.model import DesignSpec, DigitalSpec, GainRange, Objective, Relation, Requirement, Scope, Sense

#: the bar on the objective, relative; both searches keep 1e-6 of every limit to themselves
AGREE = 1e-4


def one(quantity: str, relation: Relation, limit: float, scope: Scope, ends: tuple[float, float]) -> Requirement:
    return Requirement(quantity, relation, (limit,), scope, *ends)


def at_least(quantity: str, limit: float, from_rad_s: float = 0.0, to_rad_s: float = math.inf) -> Requirement:
    return one(quantity, Relation.AT_LEAST, limit, Scope.FAMILY, (from_rad_s, to_rad_s))


def at_most(quantity: str, limit: float, from_rad_s: float = 0.0, to_rad_s: float = math.inf) -> Requirement:
    return one(quantity, Relation.AT_MOST, limit, Scope.FAMILY, (from_rad_s, to_rad_s))


def equals(quantity: str, limit: float, from_rad_s: float = 0.0, to_rad_s: float = math.inf) -> Requirement:
    return one(quantity, Relation.EQUALS, limit, Scope.NOMINAL, (from_rad_s, to_rad_s))


def minimize(quantity: str) -> Objective:
    return Objective(Sense.MINIMIZE, quantity)


KI = Objective(Sense.MAXIMIZE, "ki")


def with_alpha(spec: DesignSpec, alpha: float) -> DesignSpec:
    return replace(spec, controller=replace(spec.controller, alpha=GainRange(alpha, alpha)))


def value(spec: DesignSpec, found: Candidate) -> float:
    """The objective by the check, of gains that it finds to meet everything."""
    assert found.status is ft.Status.SOLVED, found.message
    assert found.gains is not None
    seen = verify(spec, found.gains)
    assert seen.all_met
    assert seen.objective is not None
    return seen.objective


@cache
def shipped(name: str) -> tuple[DesignSpec, Candidate]:
    spec = load_spec(CONTINUOUS / f"{name}.yaml")
    return spec, convex_design(spec)


#: what takes longer than some seconds
LONG = ("brake_delay", "lag_gain_and_delay", "second_order", "tight", "lags", "all_uncertain")


def quick(names: Iterable[str]) -> list:
    """Names as parameters, those that take long only with `-m long`."""
    return [pytest.param(name, id=name, marks=pytest.mark.long if name in LONG else ()) for name in names]


@pytest.mark.thinned(slow=["brake", "throttle"])
@pytest.mark.parametrize("name", quick(path.stem for path in sorted(CONTINUOUS.glob("*.yaml"))))
def test_both_searches_agree_on_a_shipped_spec(name: str) -> None:
    spec, found = shipped(name)
    assert value(spec, found) == pytest.approx(value(spec, design(spec)), rel=AGREE)


VARIATIONS = {
    "tight": (brake(dead_time_s=0.3), at_most("sensitivity_db", 1.5), at_least("phase_margin_deg", 70.0)),
    "noise": (brake(dead_time_s=0.5), at_most("control_sensitivity_db", 3.0), at_least("gain_margin_db", 14.0)),
    "all_uncertain": (lag_gain_and_delay(), at_most("sensitivity_db", 5.0), at_least("phase_margin_deg", 45.0)),
    "lags": (transfer_function([1.0], [1.0, (2.0, 3.0), 1.0], 0.1), at_most("sensitivity_db", 4.0)),
    "delay_margin": (brake(dead_time_s=0.3), at_least("delay_margin_s", 0.8), at_most("crossover_rad_s", 0.9)),
    "high_frequencies": (brake(dead_time_s=0.3), at_most("loop_gain_db", -14.0, from_rad_s=4.0),
                         at_most("complementary_sensitivity_db", 0.5)),
}  # fmt: skip


@pytest.mark.parametrize("name", quick(VARIATIONS))
def test_both_searches_agree_at_a_fixed_alpha_on_specs_not_shipped(name: str) -> None:
    plant, *requirements = VARIATIONS[name]
    spec = with_alpha(spec_of(plant, *requirements, objective=minimize("iae_disturbance")), 0.9)
    assert value(spec, convex_design(spec)) == pytest.approx(value(spec, design(spec)), rel=AGREE)


OBJECTIVES = {
    "ki": KI,
    "phase_margin_spread": minimize("phase_margin_spread_deg"),
    "crossover_spread": minimize("crossover_spread_db"),
    "sensitivity_peak": minimize("sensitivity_peak_db"),
    "control_sensitivity_peak": minimize("control_sensitivity_peak_db"),
    "depth": None,
}


@pytest.mark.thinned(4)
@pytest.mark.parametrize("name", OBJECTIVES)
def test_both_searches_agree_on_every_objective(name: str) -> None:
    asked = (
        Requirement("crossover_rad_s", Relation.BETWEEN, (0.3, 0.8)),
        at_least("phase_margin_deg", 60.0),
        at_most("sensitivity_db", -15.0, to_rad_s=0.03),
    )
    spec = with_alpha(spec_of(brake(dead_time_s=0.3), *asked, objective=OBJECTIVES[name]), 1.1)
    assert value(spec, convex_design(spec)) == pytest.approx(value(spec, design(spec)), rel=AGREE)


def test_two_equalities_leave_the_closed_form() -> None:
    # PAPER.md section 8: brake, alpha = 0.55, crossover 0.4, margin 100 deg, time constant 2.35 s
    spec = spec_of(brake(nominal_s=2.35), equals("crossover_rad_s", 0.4), equals("phase_margin_deg", 100.0))
    found = convex_design(with_alpha(spec, 0.55))
    assert found.gains is not None
    assert (found.gains.kp, found.gains.ki) == pytest.approx((0.3976732, 0.6527344), abs=1e-7)  # printed digits


@pytest.mark.thinned(3)
@pytest.mark.parametrize("name", ["alpha_half", "alpha_one", "kp_fixed", "depth_one_parameter"])
def test_the_convex_path_reaches_the_references_optimum(name: str) -> None:
    check_case(name)


@pytest.mark.long
@pytest.mark.parametrize("case", [c.name for c in CASES[::2]])
def test_the_convex_path_ends_as_every_other_case_says(case: str) -> None:
    check_case(case)


def check_case(name: str) -> None:
    case = next(c for c in CASES if c.name == name)
    spec = ft.parse_spec(case.text)
    found = convex_design(spec)
    assert found.status.value == case.status, found.message
    if case.status != "solved":
        return
    seen = value(spec, found)
    if case.objective is not None:
        least = -seen if spec.objective is None or spec.objective.sense is Sense.MAXIMIZE else seen
        # a peak of 0 dB has no relative distance: 1e-6 of its unit is nothing to anybody
        assert least <= case.objective + AGREE * abs(case.objective) + 1e-6


def test_impossible_requirements_are_infeasible_and_the_message_names_them() -> None:
    spec = spec_of(lag(dead_time_s=1.0), at_least("crossover_rad_s", 3.0), at_least("phase_margin_deg", 60.0))
    found = convex_design(with_alpha(spec, 0.9))
    assert found.status is ft.Status.INFEASIBLE
    assert "the convex path found no gains that meet all requirements" in found.message
    assert "crossover_rad_s" in found.message


def test_the_feasible_twin_of_the_impossible_spec_is_solved() -> None:
    spec = spec_of(lag(dead_time_s=1.0), at_least("crossover_rad_s", 0.6), at_least("phase_margin_deg", 60.0))
    assert value(spec, convex_design(with_alpha(spec, 0.9))) > 0.0


def test_an_objective_without_end_is_unbounded() -> None:
    spec = replace(spec_of(lag(), at_least("phase_margin_deg", 30.0), objective=KI))
    box = replace(spec.controller, kp=GainRange(0.0, math.inf), ki=GainRange(0.0, math.inf))
    found = convex_design(with_alpha(replace(spec, controller=box), 0.8))
    assert found.status is ft.Status.UNBOUNDED
    assert "ki" in found.message


REFUSED = {
    "fit": (DigitalSpec(0.2, "fit", design="sampled"), at_least("phase_margin_deg", 60.0), "for a fixed alpha only"),
    "equal over a band": (None, equals("sensitivity_db", -20.0, to_rad_s=0.1), "one frequency only"),
}


@pytest.mark.parametrize("name", REFUSED)
def test_what_the_convex_path_cannot_take_is_refused_by_name(name: str) -> None:
    digital, requirement, words = REFUSED[name]
    design = ft.tune(replace(spec_of(brake(), requirement), digital=digital), solver=ft.Solver.CONVEX)
    assert design.status is ft.Status.FAILED
    assert words in design.message
    assert design.gains is None


def test_fixed_gains_are_handed_on_and_no_controller_is_no_answer() -> None:
    spec = spec_of(brake(), at_least("phase_margin_deg", 60.0))
    fixed = replace(spec.controller, kp=GainRange(0.4, 0.4), ki=GainRange(0.4, 0.4), alpha=GainRange(0.8, 0.8))
    assert convex_design(replace(spec, controller=fixed)).gains == FoPi(0.4, 0.4, 0.8)
    off = replace(fixed, kp=GainRange(0.0, 0.0), ki=GainRange(0.0, 0.0))
    assert convex_design(replace(spec, controller=off)).status is ft.Status.INFEASIBLE


def test_solved_means_proved_and_the_stamp_names_the_solver() -> None:
    design = ft.tune(CONTINUOUS / "pi_baseline.yaml", solver=ft.Solver.CONVEX)
    assert design.status is ft.Status.SOLVED
    assert design.certificate is not None
    assert design.certificate.verdict is ft.Verdict.PROVED
    assert design.stamp.solver == "convex"
    assert {"clarabel", "cvxpy"} <= design.stamp.versions.keys()


def test_the_command_takes_the_solver_and_refuses_an_unknown_one(tmp_path: Path) -> None:
    spec = str(CONTINUOUS / "pi_baseline.yaml")
    run = CliRunner().invoke(app, ["tune", spec, "--solver", "convex", "--no-proof", "--json", "--out", str(tmp_path)])
    assert run.exit_code == 0
    found = json.loads(run.stdout)
    assert (found["status"], found["stamp"]["solver"]) == ("solved", "convex")
    assert [r["multiplier"] for r in found["requirements"]] == [None] * 5
    assert CliRunner().invoke(app, ["tune", spec, "--solver", "concave"]).exit_code == 2


def test_a_worst_plant_inside_the_box_becomes_a_member() -> None:
    # the closest approach to -1 of a resonance between its ends: corners alone would let a middle plant through
    plant = transfer_function([1.0], [1.0, 0.3, (0.5, 2.0)], 0.4)
    spec = with_alpha(spec_of(plant, at_most("sensitivity_db", 4.0), objective=KI), 1.0)
    found = convex_design(spec)
    assert value(spec, found) > 0.0


def test_a_violation_found_by_the_check_adds_its_plant() -> None:
    spec = with_alpha(spec_of(brake(), at_least("phase_margin_deg", 80.0), objective=KI), 0.8)
    assert convex_design(spec, (Violation(0, (2.6,), math.nan),)).cuts == convex_design(spec).cuts + 1


# rows


def steps(task: Task, gains: FoPi, points: np.ndarray) -> tuple[Members, ConeConstraints]:
    members = Members(task, points)
    found = evaluate(task, gains, members.plants)
    return members, constraints_at(task, found, members.plants, found.points)


FAMILY = lag((1.0, 0.8, 1.2), (2.25, 1.6, 3.1), 0.3)
GAINS = FoPi(0.9, 0.5, 0.9)
ONE_LIMIT = {
    "phase margin": (FAMILY, at_least("phase_margin_deg", 75.0)),
    "gain margin": (FAMILY, at_least("gain_margin_db", 12.0)),
    "delay margin": (FAMILY, at_least("delay_margin_s", 2.0)),
    "crossover": (FAMILY, at_most("crossover_rad_s", 0.3)),
    "phase slope": (FAMILY, at_most("phase_slope_deg_per_decade", -10.0)),
    "S at a frequency": (FAMILY, at_most("sensitivity_db", -1.0, from_rad_s=0.2, to_rad_s=0.2)),
    "T at a frequency": (FAMILY, at_least("complementary_sensitivity_db", 1.0, from_rad_s=0.2, to_rad_s=0.2)),
    "C S at a frequency": (FAMILY, at_most("control_sensitivity_db", 1.0, from_rad_s=0.2, to_rad_s=0.2)),
    "L at a frequency": (FAMILY, at_least("loop_gain_db", 1.0, from_rad_s=0.2, to_rad_s=0.2)),
}


@pytest.mark.parametrize("name", ONE_LIMIT)
def test_a_row_is_the_limits_slack_and_its_slope_at_small_steps(name: str) -> None:
    plant, requirement = ONE_LIMIT[name]
    task = task_of(spec_of(plant, requirement))
    points = plant.corners()[:1]
    members, rows = steps(task, GAINS, points)
    row = int(np.flatnonzero(rows.group == 0)[0])
    unit = task.unit(GAINS.alpha)

    def slack(d: np.ndarray) -> float:
        kp, ki = np.array([GAINS.kp, GAINS.ki]) + unit * d
        points = evaluate(task, FoPi(kp, ki, GAINS.alpha), members.plants).points
        return float(points.slack[points.limit == 0].min())

    def model(d: np.ndarray) -> float:
        return float(rows.slack0[row] + rows.slope[row] @ d - abs(rows.cone0[row] + rows.cone[row] @ d))

    # where the smallest slack is the objective a row is measured from it: only one limit, so from 0
    offset = slack(np.zeros(2)) - model(np.zeros(2))
    h = 1e-5
    for d in (np.array([h, 0.0]), np.array([0.0, h])):
        central = (slack(d) - slack(-d)) / (2.0 * h)
        # curvature cancels in both; the row of a far limit is scaled to its slack in neper, which its slope follows
        factor = slope_scale(rows, row, slack(np.zeros(2)), offset)
        assert (model(d) - model(-d)) / (2.0 * h) == pytest.approx(central * factor, rel=1e-5, abs=1e-8)


def slope_scale(rows: ConeConstraints, row: int, slack: float, offset: float) -> float:
    """A plane's slope is the slack's; a cone's is that of 1 - ratio times -ln(ratio)/(1 - ratio) at slack -ln ratio."""
    if not np.any(rows.cone[row]) and not abs(rows.cone0[row]):
        return 1.0
    ratio = math.exp(-(slack - offset))
    return 1.0 if ratio == 1.0 else math.log(ratio) / (ratio - 1.0) * ratio


def test_a_cone_never_promises_more_than_the_loop_keeps() -> None:
    # |1 + L| >= Re(conj(e)(1 + L)) for every unit e: the linearised row is an inner approximation at any step
    task = task_of(spec_of(FAMILY, at_most("sensitivity_db", 1.0, from_rad_s=0.8, to_rad_s=0.8), objective=KI))
    members, rows = steps(task, GAINS, FAMILY.corners())
    rng, unit = np.random.default_rng(1), task.unit(GAINS.alpha)
    mine = np.flatnonzero(rows.group == 0)
    kept = 0
    for d in rng.normal(scale=0.5, size=(200, 2)):
        model = rows.slack0[mine] + rows.slope[mine] @ d - np.abs(rows.cone0[mine] + rows.cone[mine] @ d)
        kp, ki = np.array([GAINS.kp, GAINS.ki]) + unit * d
        points = evaluate(task, FoPi(kp, ki, GAINS.alpha), members.plants).points
        met = (model >= 0.0).all()
        kept += met
        assert not met or points.slack[points.limit == 0].min() >= -1e-9  # rounding
    assert kept > 20


def found_from(spec: DesignSpec, start: FoPi) -> LocalResult:
    task = task_of(spec)
    return ConvexConcaveProcedure(task, Members.of(task), Program(task.equalities)).run(start)


@pytest.mark.parametrize("start", [FoPi(0.1, 0.05, 0.9), FoPi(3.0, 0.2, 0.9), FoPi(0.5, 2.5, 0.9)])
def test_every_start_leads_to_the_same_optimum(start: FoPi) -> None:
    spec = load_spec(CONTINUOUS / "brake_delay.yaml")
    best = found_from(spec, FoPi(1.5, 1.2, 0.9))
    found = found_from(spec, start)
    assert found.evaluation.violation <= TOLERANCE
    assert found.evaluation.cost == pytest.approx(best.evaluation.cost, abs=1e-6)  # ln of the objective


def test_a_brute_force_scan_finds_nothing_better() -> None:
    spec = with_alpha(load_spec(CONTINUOUS / "brake_delay.yaml"), 1.2)
    task = task_of(spec)
    members = Members(task, np.linspace(1.6, 3.1, 5)[:, None])
    found = convex_design(spec)
    assert found.gains is not None
    best = evaluate(task, found.gains, members.plants).cost
    scan = [
        evaluate(task, FoPi(found.gains.kp * a, found.gains.ki * b, 1.2), members.plants)
        for a in np.linspace(0.7, 1.3, 13)
        for b in np.linspace(0.95, 1.05, 11)
    ]
    feasible = [seen.cost for seen in scan if seen.violation <= TOLERANCE]
    assert len(feasible) > 5
    assert min(feasible) >= best - 1e-9  # rounding: the optimum itself is one of them


def test_points_beyond_what_a_double_holds_are_clipped() -> None:
    points = ConstraintPoints.of(0, np.zeros(3, dtype=np.intp), np.array([-math.inf, math.nan, math.inf]), np.zeros(3))
    assert points.u.tolist() == [-100.0, 0.0, 100.0]


def test_the_nominal_plant_comes_first_and_none_comes_twice() -> None:
    members = Members.of(task_of(spec_of(brake(), at_least("phase_margin_deg", 60.0))))
    assert members.points.ravel().tolist() == [2.25, 1.6, 3.1]
    assert members.add(np.array([[1.6], [2.0], [2.0]])) == 1
    assert len(members.plants) == 4
