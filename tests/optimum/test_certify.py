"""The bound of the best gains:  against closed forms, scans, and gains that are better than they should be."""

from __future__ import annotations

import copy
import json
import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from cases.plants import lag, spec_of, transfer_function
from cases.project import CONTINUOUS
from flint import acb, arb, ctx
from hypothesis import given, settings
from hypothesis import strategies as st
from typer.testing import CliRunner

import fopi_tune as ft
from fopi_tune.cli.commands import app
from fopi_tune.core.controller import FoPi
from fopi_tune.core.loops import Loops, Plants
from fopi_tune.core.margins import margins
from fopi_tune.core.peaks import Response, extremes
from fopi_tune.core.stability import is_stable
from fopi_tune.errors import CertificateError, DomainError
from fopi_tune.optimum import Optimum, OptimumStatus, certify_optimum, recheck_optimum, to_document
from fopi_tune.optimum.crossover_gains import CrossoverParametrization
from fopi_tune.optimum.parametrization import GainParametrization, Parametrization
from fopi_tune.optimum.problem import Problem
from fopi_tune.optimum.pruning.conditions import Test as Kind
from fopi_tune.optimum.pruning.exclusion import Reason, is_excluded
from fopi_tune.optimum.pruning.loop_gain_bounds import LoopGainBounds
from fopi_tune.optimum.pruning.response_bounds import quadratic
from fopi_tune.optimum.pruning.screen import gains_at
from fopi_tune.proof import verify
from fopi_tune.proof.balls.loop import PRECISION
from fopi_tune.spec import load_spec
from fopi_tune.spec.model import ControllerSpec, DesignSpec, GainRange, Objective, Relation, Requirement, Scope, Sense

#: gains of the shipped specs, from `fopi tune`
TUNED = {
    "throttle": FoPi(0.08862553040674244, 0.024775906607786436, 0.7920318628338017),
    "pi_baseline": FoPi(0.675, 0.3, 1.0),
    "brake": FoPi(0.38512473433142086, 0.3877569243622711, 0.8203825948834322),
    "brake_delay": FoPi(1.984583714035147, 0.5295689457685306, 1.438111972003619),
    "second_order": FoPi(0.9816674525171568, 0.5307050538184653, 1.3999999999815975),
    "lag_gain_and_delay": FoPi(1.7986865132161245, 0.7843545525764833, 1.2133034669966298),
}
SIDE = st.floats(0.0, 1.0)


def spec_named(name: str) -> DesignSpec:
    return load_spec(CONTINUOUS / f"{name}.yaml")


def with_limit(spec: DesignSpec, place: int, limit: float) -> DesignSpec:
    """The spec with one limit moved."""
    found = list(spec.requirements)
    found[place] = replace(found[place], limits=(limit,))
    return replace(spec, requirements=tuple(found))


# -- the formulas --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("parametrization", [0.02, 1.0, 300.0, "crossover"])
@settings(max_examples=40, deadline=None)
@given(
    corner=st.tuples(SIDE, SIDE, SIDE), size=st.floats(-6, -0.5), inside=st.tuples(SIDE, SIDE, SIDE), u=st.floats(-6, 6)
)
def test_taylor_models_and_enclosures_hold_every_controller_of_a_box(
    parametrization: float | str, corner: tuple[float, ...], size: float, inside: tuple[float, ...], u: float
) -> None:
    on_circle = isinstance(parametrization, str)
    which: Parametrization = (
        CrossoverParametrization(0.4, acb(0.6, -0.5)) if on_circle else GainParametrization(parametrization)
    )
    ranges = [(0.3, 1.5), (0.0, 6.2)] if on_circle else [(-2.0, 5.0), (-2.0, 5.0), (0.3, 1.5)]
    box = tuple((a + c * (b - a), a + c * (b - a) + 10.0**size) for (a, b), c in zip(ranges, corner, strict=False))
    place = np.array([[low + x * (high - low) for (low, high), x in zip(box, inside, strict=False)]])
    there = gains_at(which, place)
    kp, ki, alpha = (float(gain[0]) for gain in (there.kp, there.ki, there.alpha))
    controllers = which.controllers(box)
    log_s = complex(u, 0.5 * math.pi)
    value = kp + ki * np.exp(-alpha * log_s)
    taylor_model = controllers.taylor_model(acb(log_s.real, log_s.imag))
    middle = [0.5 * (low + high) for low, high in box]
    linear = complex(taylor_model.middle) + sum(
        complex(s) * (x - m) for s, x, m in zip(taylor_model.slopes, place[0], middle, strict=True)
    )
    # 1e-12 relative is what the doubles of this test lose
    # without a bound of the rest nothing is claimed
    remainder = float(taylor_model.remainder.upper()) if taylor_model.remainder.is_finite() else math.inf
    assert abs(value - linear) <= remainder + 1e-12 * (1.0 + abs(value))
    assert controllers.enclosure((u - 1e-9, u + 1e-9)).value.overlaps(acb(value.real, value.imag))
    integral = ki * math.exp(-alpha * float(controllers.reference.mid()))
    assert all(
        abs(float(ball.mid()) - x) <= float(ball.rad()) + 1e-12 * (1.0 + abs(x))
        for ball, x in ((controllers.kp, kp), (controllers.integral, integral), (controllers.alpha, alpha))
    )
    for name, gain in (("kp", kp), ("ki", ki)):
        low, high = controllers.gain_range(name)
        model = controllers.gain_taylor_model(name)
        linear = float(model.middle.real.mid()) + sum(
            float(s.real.mid()) * (x - m) for s, x, m in zip(model.slopes, place[0], middle, strict=True)
        )
        rounding = 1e-11 * (1.0 + abs(gain) + abs(linear))
        if low.is_finite() and high.is_finite():
            assert float(low.lower()) - rounding <= gain <= float(high.upper()) + rounding
        assert abs(gain - linear) <= float(model.remainder.upper()) + rounding


@pytest.mark.parametrize("response", Response)
@settings(max_examples=40, deadline=None)
@given(
    c=st.complex_numbers(min_magnitude=0.05, max_magnitude=5),
    p=st.complex_numbers(min_magnitude=0.1, max_magnitude=3),
    limit=st.floats(0.2, 4),
)
def test_the_quadratic_is_positive_exactly_where_a_response_breaks_its_limit(
    response: Response, c: complex, p: complex, limit: float
) -> None:
    loop = c * p
    value = {
        Response.SENSITIVITY: abs(1.0 / (1.0 + loop)) if loop != -1.0 else math.inf,
        Response.COMPLEMENTARY_SENSITIVITY: abs(loop / (1.0 + loop)) if loop != -1.0 else math.inf,
        Response.CONTROL_SENSITIVITY: abs(c / (1.0 + loop)) if loop != -1.0 else math.inf,
        Response.LOOP_GAIN: abs(loop),
        Response.LOAD_SENSITIVITY: abs(p / (1.0 + loop)) if loop != -1.0 else math.inf,
    }[response]
    if abs(math.log(max(value, 1e-12) / limit)) < 1e-9 or math.isinf(value):
        return
    for upper in (True, False):
        a, b, remainder = (complex(x) for x in quadratic(response, acb(p.real, p.imag), arb(limit) ** 2, upper))
        q = a.real * abs(c) ** 2 + 2.0 * (b * c).real + remainder.real
        assert (q > 0.0) == ((value > limit) == upper)


@settings(max_examples=40, deadline=None)
@given(kp=st.floats(0.01, 5), ki=st.floats(0, 5), alpha=st.floats(0.3, 1.8), u=st.floats(-4, 4))
def test_bounds_of_the_controller_over_a_cell_hold(kp: float, ki: float, alpha: float, u: float) -> None:
    controller = ControllerSpec(GainRange(0.0, 9.0), GainRange(0.0, 9.0), GainRange(0.2, 1.9))
    problem = Problem.of(replace(spec_of(lag()), controller=controller), None)
    which = GainParametrization(3.0)
    controllers = which.controllers(((kp, kp + 0.1), (0.0, 3.0**-alpha * ki + 0.1), (alpha, alpha + 0.01)))
    cells = LoopGainBounds.of(problem, controllers, ())
    size = abs(kp + ki * np.exp(-alpha * complex(u, 0.5 * math.pi)))
    for cell in ((u - 0.1, u + 0.1), (-math.inf, u), (u, math.inf)):
        low, high = cells.controller_size(cell)
        assert float(low) <= size * (1 + 1e-12)
        assert float(high) >= size * (1 - 1e-12)


# -- bounds against closed forms and scans -------------------------------------------------------------------------


def test_the_bound_of_the_throttle_is_just_above_every_feasible_point_of_its_one_dimension() -> None:
    spec = spec_named("throttle")
    found = certify_optimum(spec, TUNED["throttle"], gap=1e-4)
    assert found.status is OptimumStatus.CERTIFIED
    assert found.bound is not None
    # PAPER's closed form: X = e^{j(phi - pi)}/G, ki = -Im X wc^alpha/sin a, kp = Re X - ki wc^-alpha cos a
    alpha = np.linspace(0.3, 1.5, 4001)
    x = np.exp(1j * np.radians(88.0 - 180.0)) * (0.46j + 0.1746) / 4.39
    ki = -x.imag * 0.46**alpha / np.sin(0.5 * np.pi * alpha)
    kp = x.real - ki * 0.46**-alpha * np.cos(0.5 * np.pi * alpha)
    plants = Plants.of(spec.plant.member(np.zeros(0))).take(np.zeros(len(alpha), dtype=np.intp))
    peak = extremes(Loops(kp, ki, alpha, plants), Response.SENSITIVITY, 0.0, 0.035).value
    feasible = (kp >= 0.0) & (peak <= -20.0 * math.log(10.0) / 20.0)
    assert feasible.any()
    best = float(ki[feasible].max())
    # the scan's step of 3e-4 in alpha leaves it at most 1e-3 short of the optimum
    assert best <= found.bound <= best * 1.0012


def test_the_crossover_spread_is_bounded_at_the_lowest_crossover_that_is_allowed() -> None:
    limits = (
        Requirement("crossover_rad_s", Relation.AT_LEAST, (0.3,), Scope.NOMINAL),
        Requirement("sensitivity_db", Relation.AT_MOST, (4.0,)),
    )
    least = Objective(Sense.MINIMIZE, "crossover_spread_db")
    # |P/P0| of lags that differ by their time constant rises with the frequency
    spec = spec_of(lag(1.0, (2.25, 1.6, 3.1), 0.2), *limits, objective=least)
    known = max(10.0 * abs(math.log10((1.0 + (0.3 * t) ** 2) / (1.0 + (0.3 * 2.25) ** 2))) for t in (1.6, 3.1))
    # every loop that crosses there is as good: with a free order that takes many boxes
    spec = replace(spec, controller=replace(spec.controller, alpha=GainRange(1.0, 1.0)))
    found = certify_optimum(spec, ft.tune(spec, proof=False).gains)
    assert found.status is OptimumStatus.CERTIFIED
    assert found.objective == pytest.approx(known, rel=1e-6)
    assert recheck_optimum(json.loads(json.dumps(to_document(found, {}))), spec).is_sound
    # that of lags that differ by their gain is the same everywhere
    spec = spec_of(lag((1.0, 0.8, 1.1), 2.25, (0.2, 0.1, 0.3)), *limits, objective=least)
    found = certify_optimum(spec, FoPi(2.0, 0.5, 1.0))
    assert found.status is OptimumStatus.CERTIFIED
    assert found.objective == pytest.approx(-20.0 * math.log10(0.8))


def test_a_peak_that_every_integral_has_at_frequency_0_is_bounded_there() -> None:
    spec = spec_of(
        lag((1.0, 0.8, 1.1), 2.25, 0.5),
        Requirement("sensitivity_db", Relation.AT_MOST, (-6.0,), to_rad_s=0.02),
        objective=Objective(Sense.MINIMIZE, "control_sensitivity_peak_db"),
    )
    found = certify_optimum(spec, FoPi(0.46875, 0.20426441, 0.91875))
    assert found.status is OptimumStatus.CERTIFIED
    assert found.objective == pytest.approx(-20.0 * math.log10(0.8))


@pytest.mark.parametrize("ki", [(0.0, 5.0), (-5.0, 0.0), (-2.0, 3.0), (0.5, 5.0), (0.0, 0.0)])
def test_the_roots_hold_every_gain_of_the_ranges(ki: tuple[float, float]) -> None:
    controller, pick = (
        ControllerSpec(GainRange(-1.0, 4.0), GainRange(*ki), GainRange(0.3, 1.5)),
        np.random.default_rng(1),
    )
    for omega in (1e-3, 1.0, 4e5):
        roots = GainParametrization(omega).roots(controller)
        for value in (*ki, 0.0, *pick.uniform(*ki, 20)):
            if not ki[0] <= value <= ki[1]:
                continue
            alpha = pick.choice([0.3, 1.5, pick.uniform(0.3, 1.5)])
            z = value * omega**-alpha
            # ki = 0 is any order's, and only in a box of its own: the other one's claims are not about it
            own = [root[1] for root in roots if (value == 0.0) == (root[1] == (0.0, 0.0))]
            assert len(own) == 1
            assert own[0][0] <= z <= own[0][1]


def test_the_crossover_spread_at_a_fixed_crossover_is_known_without_gains() -> None:
    spec = spec_of(
        lag(1.0, (2.25, 1.6, 3.1)),
        Requirement("crossover_rad_s", Relation.EQUALS, (0.5,), Scope.NOMINAL),
        Requirement("phase_margin_deg", Relation.AT_LEAST, (60.0,)),
        objective=Objective(Sense.MINIMIZE, "crossover_spread_db"),
    )
    design = ft.tune(spec, proof=False)
    found = certify_optimum(spec, design.gains, gap=1e-6)
    # |L| = |P/P0| at 0.5 rad/s, largest at tau = 1.6 or 3.1
    spread = max(abs(10.0 * math.log10((1 + (0.5 * 2.25) ** 2) / (1 + (0.5 * t) ** 2))) for t in (1.6, 3.1))
    assert found.status is OptimumStatus.CERTIFIED
    assert found.bound == pytest.approx(spread, rel=2e-6)


def test_no_gains_of_a_scan_beat_a_bound() -> None:
    plant = lag(1.0, 2.0, 0.3)
    spec = spec_of(
        plant, Requirement("sensitivity_db", Relation.AT_MOST, (4.0,)), objective=Objective(Sense.MAXIMIZE, "ki")
    )
    design = ft.tune(spec, proof=False)
    assert design.gains is not None
    found = certify_optimum(spec, design.gains, gap=0.01)
    assert found.status is OptimumStatus.CERTIFIED
    assert found.bound is not None
    pick = np.random.default_rng(3)
    low, high = np.array([0.0, 0.9 * found.bound, 0.3]), np.array([10.0, 10.0, 1.5])
    kp, ki, alpha = pick.uniform(low, high, size=(4000, 3)).T
    loops = Loops(kp, ki, alpha, Plants.of(plant.member(np.zeros(0))).take(np.zeros(4000, dtype=np.intp)))
    met = extremes(loops, Response.SENSITIVITY, 0.0, math.inf).value <= 4.0 * math.log(10.0) / 20.0
    assert met.any()
    met &= is_stable(loops)
    assert not (ki[met] > found.bound).any()


@pytest.mark.thinned(slow=["brake_delay"])
@pytest.mark.parametrize(("name", "gap"), [("pi_baseline", 1e-4), ("brake_delay", 0.1)])
def test_a_shipped_spec_is_certified(name: str, gap: float) -> None:
    found = certify_optimum(spec_named(name), TUNED[name], gap=gap, time_limit_s=300.0)
    assert found.status is OptimumStatus.CERTIFIED, found.reason
    assert found.gap is not None
    assert found.gap <= gap


@pytest.mark.long
@pytest.mark.parametrize("name", TUNED)
def test_every_shipped_spec_is_certified_to_a_tenth_of_a_percent(name: str) -> None:
    spec = spec_named(name)
    found = certify_optimum(spec, TUNED[name], gap=1e-3, time_limit_s=600.0)
    assert found.status is OptimumStatus.CERTIFIED, found.reason
    document = json.loads(json.dumps(to_document(found, {})))
    assert recheck_optimum(document, spec).problems == ()


# -- infeasible, and feasible twins --------------------------------------------------------------------------------


@pytest.mark.thinned(slow=["brake_delay-3"])
@pytest.mark.parametrize(
    ("name", "place", "infeasible", "feasible"),
    [("pi_baseline", 2, 81.5, 80.0), ("brake_delay", 2, 0.4, 2.5), ("brake_delay", 3, -42.0, -20.0)],
)
def test_an_infeasible_spec_is_proved_infeasible_and_its_twin_is_not(
    name: str, place: int, infeasible: float, feasible: float
) -> None:
    spec = with_limit(spec_named(name), place, infeasible)
    found = certify_optimum(spec, None, time_limit_s=300.0)
    assert found.status is OptimumStatus.INFEASIBLE
    assert recheck_optimum(json.loads(json.dumps(to_document(found, {}))), spec).is_sound
    twin = certify_optimum(with_limit(spec, place, feasible), None, time_limit_s=10.0, most_boxes=3000)
    assert twin.status is OptimumStatus.LIMIT_REACHED
    assert twin.proof is None


@pytest.mark.long
@pytest.mark.parametrize(("name", "place", "limit"), [("brake", 2, 84.0), ("brake_delay", 0, 110.0)])
def test_further_infeasible_specs_are_proved_infeasible(name: str, place: int, limit: float) -> None:
    spec = with_limit(spec_named(name), place, limit)
    assert certify_optimum(spec, None, time_limit_s=600.0).status is OptimumStatus.INFEASIBLE


def test_a_phase_margin_that_a_lower_crossover_has_is_not_taken_for_impossible() -> None:
    # zeros lift |L| above 1 once more: the smallest margin is not that of the highest crossover
    zeros, poles = [1.0, 0.335, 0.312], [1.0, 23.48, 139.0, 14.67, 0.2666]
    plant = transfer_function([112.0 * c for c in zeros], poles)
    gains = FoPi(1.6167744947986418, 0.11197580432966492, 0.8616549127941711)
    nominal = margins(gains, plant.member(np.zeros(0)))
    crossover, margin = nominal.crossover_rad_s, nominal.phase_margin_deg
    assert crossover is not None
    assert margin is not None
    assert nominal.phase_margin_rad_s is not None
    assert nominal.phase_margin_rad_s < 0.5 * crossover
    spec = spec_of(
        plant,
        Requirement("crossover_rad_s", Relation.EQUALS, (crossover,), Scope.NOMINAL),
        Requirement("phase_margin_deg", Relation.EQUALS, (margin,), Scope.NOMINAL),
    )
    assert verify(spec, gains).all_met
    assert certify_optimum(spec, None, time_limit_s=3.0).status is not OptimumStatus.INFEASIBLE
    with ctx.workprec(64):
        problem = Problem.of(spec, None)
        for width in (1e-2, 1e-4, 1e-6):
            alpha = (gains.alpha - width, gains.alpha + width)
            psi = psi_of(problem, gains)
            controllers = problem.parametrization.controllers((alpha, (psi - width, psi + width)))
            last = math.nextafter(math.log(crossover), math.inf)
            assert not LoopGainBounds.of(problem, controllers, ()).has_no_margin_below(
                last, arb(margin) * arb.pi() / 180
            )


def psi_of(problem: Problem, gains: FoPi) -> float:
    """pi + arg L at the crossover that is fixed."""
    assert isinstance(problem.parametrization, CrossoverParametrization)
    integral = np.exp(-gains.alpha * complex(math.log(problem.parametrization.omega_rad_s), 0.5 * math.pi))
    return float(np.angle((gains.kp + gains.ki * integral) * complex(problem.parametrization.plant)) + np.pi)


# -- incumbents that are not what they should be -------------------------------------------------------------------


def test_a_feasible_design_that_is_not_the_best_shows_a_gap_and_better_gains() -> None:
    spec = spec_of(
        lag(1.0, 2.0, 0.3),
        Requirement("sensitivity_db", Relation.AT_MOST, (4.0,)),
        objective=Objective(Sense.MAXIMIZE, "ki"),
    )
    best = ft.tune(spec, proof=False)
    assert best.objective is not None
    poor = FoPi(1.0, 0.3, 0.9)
    found = certify_optimum(spec, poor, gap=1e-3, time_limit_s=60.0)
    assert found.status is OptimumStatus.LIMIT_REACHED
    assert found.better_objective is not None
    # relative: the design is the best within the tolerance of the search
    assert 0.3 < found.better_objective <= best.objective * (1.0 + 1e-5)
    # there are better gains before anything is shown: they are named all the same
    assert found.bound is None
    assert found.reason == f"there are better gains: their objective is {found.better_objective:.8g}"
    assert found.reason in found.statement
    assert recheck_optimum(json.loads(json.dumps(to_document(found, {}))), spec).is_sound


@pytest.mark.parametrize("push", [1.02, 0.98])
@pytest.mark.parametrize("name", ["brake_delay", "throttle"])
def test_gains_pushed_beyond_the_optimum_are_never_certified(name: str, push: float) -> None:
    gains = TUNED[name]
    pushed = FoPi(gains.kp * push, gains.ki * push, gains.alpha)
    found = certify_optimum(spec_named(name), pushed, time_limit_s=10.0)
    assert found.status is OptimumStatus.NO_BOUND
    assert "no design of this spec" in found.reason


@pytest.fixture(scope="module")
def certified() -> tuple[DesignSpec, Optimum, dict[str, Any]]:
    spec = spec_named("throttle")
    found = certify_optimum(spec, TUNED["throttle"])
    return spec, found, json.loads(json.dumps(to_document(found, {"python-flint": "x"})))


def test_a_file_is_sound_until_something_in_it_is_changed(
    certified: tuple[DesignSpec, Optimum, dict[str, Any]],
) -> None:
    spec, found, document = certified
    again = recheck_optimum(document, spec)
    assert again.is_sound
    assert found.proof is not None
    assert again.leaves == found.proof.leaves
    assert found.objective is not None

    def changed(**values: Any) -> tuple[str, ...]:
        other = copy.deepcopy(document)
        for key, value in values.items():
            place: Any = other
            *path, last = key.split("__")
            for part in path:
                place = place[part]
            place[last] = value
        return recheck_optimum(other, spec).problems

    closer = found.objective * (1.0 + 1e-6)
    assert changed(objective=found.objective * 1.02)
    assert changed(gap=1e-9)
    assert changed(bound=closer)
    assert changed(bound=closer, proof__beat=closer, gap=1e-6)
    assert changed(proof__beat=None, status="infeasible", bound=None, gap=None)
    assert changed(gains={"kp": 0.09, "ki": 0.0253, "alpha": 0.79})
    assert changed(spec_sha256="0" * 64)
    assert changed(proof__covers=document["proof"]["covers"][1:])
    tokens = document["proof"]["covers"][0]["tokens"].split()
    for cut in (tokens[:-1], [*tokens, "#0"], ["#0"], ["9", *tokens[1:]], ["#999"]):
        covers = copy.deepcopy(document["proof"]["covers"])
        covers[0]["tokens"] = " ".join(cut)
        assert changed(proof__covers=covers)


#: a cover of the circle on which the nominal crossover is fixed
OFF_THE_LINE = "1 1 1 #0 1 #1 #0 1 #0 #0 1 #2 1 #0 1 #0 #0"


def test_what_discards_gains_off_the_line_of_a_fixed_margin_discards_none_on_it() -> None:
    # a spec that has a design, and a proof that it has none: each claim is true, the last is not about its box
    spec = spec_named("pi_baseline")
    honest = to_document(certify_optimum(spec, TUNED["pi_baseline"]), {})
    with ctx.workprec(PRECISION):
        problem = Problem.of(spec, None)
    lower = next(k for k, c in enumerate(problem.conditions.every) if c.test is Kind.LOWER_CROSSOVER)
    with ctx.workprec(PRECISION):
        assert is_excluded(problem, problem.parametrization.controllers(problem.roots[-1]), Reason(lower))

    def reason(condition: int, point: list[float], omega: list[float]) -> dict[str, Any]:
        return {"condition": condition, "point": point, "omega_rad_s": omega, "above": False}

    forged = {
        **honest,
        **dict.fromkeys(("gains", "objective", "bound", "gap", "better_gains", "better_objective")),
        "status": "infeasible",
        "statement": "No gains in the box meet every requirement.",
        "advice": OptimumStatus.INFEASIBLE.advice,
        "discarded_boxes": 11,
        "boxes": 19,
        "proof": {
            "beat": None,
            "reference_rad_s": None,
            "reasons": [reason(lower, [], []), reason(lower - 1, [1.6], [0.02]), reason(1, [], [])],
            "covers": [
                {"root": [list(side) for side in problem.roots[0]], "tokens": OFF_THE_LINE},
                *({"root": [list(side) for side in root], "tokens": "#0"} for root in problem.roots[1:]),
            ],
        },
    }
    problems = recheck_optimum(forged, spec).problems
    assert len(problems) == 1
    assert "on a line of the fixed margin" in problems[0]


@pytest.mark.thinned(2)
@pytest.mark.parametrize(
    "change",
    [
        {"statement": "No gains are better than 42."},
        {"advice": "Trust it."},
        {"better_gains": {"kp": 1.0, "ki": 1.0, "alpha": 1.0}, "better_objective": 1.0},
        {"discarded_boxes": 3},
        {"left_out": ["nothing"]},
    ],
)
def test_changed_words_are_refused_like_changed_numbers(change: dict[str, Any]) -> None:
    spec = spec_named("throttle")
    honest = to_document(certify_optimum(spec, TUNED["throttle"]), {})
    assert recheck_optimum(honest, spec).is_sound
    assert not recheck_optimum({**honest, **change}, spec).is_sound


def test_what_is_no_file_of_an_optimum_is_refused() -> None:
    spec = spec_named("throttle")
    for document in ({}, {"kind": "fopi_tune certificate"}, [], {"kind": "fopi_tune optimum", "schema": 2}):
        with pytest.raises(CertificateError):
            recheck_optimum(document, spec)


# -- named outcomes ------------------------------------------------------------------------------------------------


def test_what_cannot_be_bounded_says_why() -> None:
    spec = spec_named("brake_delay")
    gains = TUNED["brake_delay"]
    open_end = replace(spec, controller=replace(spec.controller, kp=GainRange(0.0, math.inf)))
    assert "kp has no upper end" in certify_optimum(open_end, gains).reason
    assert certify_optimum(open_end, gains).status is OptimumStatus.NO_BOUND


def test_what_is_not_used_is_named() -> None:
    spec = spec_named("throttle")
    slope = Requirement("phase_slope_deg_per_decade", Relation.AT_LEAST, (-90.0,))
    found = certify_optimum(replace(spec, requirements=(*spec.requirements, slope)), TUNED["throttle"])
    assert found.left_out == ("phase_slope_deg_per_decade at least -90",)
    assert found.status is OptimumStatus.CERTIFIED


@pytest.mark.parametrize("bad", [{"gap": 0.0}, {"time_limit_s": -1.0}, {"most_boxes": 0}, {"gap": math.nan}])
def test_limits_that_are_not_positive_are_refused(bad: dict[str, Any]) -> None:
    with pytest.raises(DomainError, match="greater than 0"):
        certify_optimum(spec_named("throttle"), TUNED["throttle"], **bad)


def test_a_limit_of_boxes_returns_what_was_reached_and_progress_is_told() -> None:
    told: list[tuple[int, int]] = []
    found = certify_optimum(
        spec_named("brake_delay"), TUNED["brake_delay"], most_boxes=400, progress=lambda *count: told.append(count)
    )
    assert found.status is OptimumStatus.LIMIT_REACHED
    assert found.reason
    assert told
    assert told[-1][0] == found.boxes


# -- the command ---------------------------------------------------------------------------------------------------


def test_the_command_certifies_writes_and_rechecks(tmp_path: Path) -> None:
    run, file = CliRunner(), str(CONTINUOUS / "throttle.yaml")
    plain = run.invoke(app, ["tune", file, "--no-proof", "--json", "--out", str(tmp_path / "plain")])
    assert "optimum" not in json.loads(plain.stdout)
    assert not (tmp_path / "plain" / "optimum.json").exists()
    done = run.invoke(app, ["tune", file, "--no-proof", "--certify-optimum", "--json", "--out", str(tmp_path)])
    assert done.exit_code == 0
    found = json.loads(done.stdout)["optimum"]
    assert found["status"] == "certified"
    assert found["gap"] <= 1e-3
    written = tmp_path / "optimum.json"
    assert run.invoke(app, ["prove", "--recheck", str(written), file]).exit_code == 0
    assert run.invoke(app, ["prove", "--recheck", str(written)]).exit_code == 2
    document = json.loads(written.read_text(encoding="utf-8"))
    document["objective"] *= 1.02
    written.write_text(json.dumps(document), encoding="utf-8")
    refused = run.invoke(app, ["prove", "--recheck", str(written), file])
    assert refused.exit_code == 1
    assert "refused" in refused.stdout
