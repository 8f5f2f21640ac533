"""proof/ against brute force:  plain complex NumPy on dense grids, straight from the definitions."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from cases.plants import (
    PUBLISHED_BRAKE,
    PUBLISHED_THROTTLE,
    ROBUST_BRAKE,
    brake,
    lag,
    lag_gain_and_delay,
    pole,
    spec_of,
    throttle,
    transfer_function,
)
from hypothesis import given, settings
from hypothesis import strategies as st

from fopi_tune.core.controller import FoPi
from fopi_tune.core.plant import Plant, PlantFamily
from fopi_tune.errors import DomainError
from fopi_tune.proof import Outcome, RequirementResult, verify
from fopi_tune.quantities.objectives import OBJECTIVES, default_horizon_s
from fopi_tune.spec.model import DesignSpec, Objective, Relation, Requirement, Scope, Sense

OMEGA = np.geomspace(1e-4, 1e4, 16_001)
#: linear interpolation on this grid errs by less (relative; margins in deg)
GRID_ERROR = 1e-4

EQUALS, AT_LEAST, AT_MOST, BETWEEN = Relation.EQUALS, Relation.AT_LEAST, Relation.AT_MOST, Relation.BETWEEN
BRAKE_REQUIREMENTS = (
    Requirement("crossover_rad_s", EQUALS, (0.3,), Scope.NOMINAL),
    Requirement("phase_margin_deg", EQUALS, (90.0,), Scope.NOMINAL),
    Requirement("phase_margin_deg", AT_LEAST, (80.0,)),
    Requirement("gain_margin_db", AT_LEAST, (12.04,)),
    Requirement("sensitivity_db", AT_MOST, (-20.0,), to_rad_s=0.02),
)


def response(gains: FoPi, plant: Plant, omega: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """C and P on s = j omega."""
    s = 1j * omega
    p = np.polyval(plant.numerator, s) / np.polyval(plant.denominator, s) * np.exp(-s * plant.dead_time_s)
    return gains.kp + gains.ki * s**-gains.alpha, p


def brute(name: str, gains: FoPi, plant: Plant, omega: np.ndarray = OMEGA) -> tuple[float, float]:
    """The smallest and the largest value of a quantity of one stable plant with positive gain."""
    c, p = response(gains, plant, omega)
    loop = c * p
    functions = {
        "sensitivity_db": 1 / (1 + loop),
        "complementary_sensitivity_db": loop / (1 + loop),
        "control_sensitivity_db": c / (1 + loop),
        "load_sensitivity_db": p / (1 + loop),
        "loop_gain_db": loop,
    }
    if name in functions:
        db = 20 * np.log10(np.abs(functions[name]))
        return float(db.min()), float(db.max())
    x, gain, phase = np.log(omega), np.log(np.abs(loop)), np.unwrap(np.angle(loop))
    if name == "gain_margin_db":
        turn = np.floor((phase + np.pi) / (2 * np.pi))
        k = np.flatnonzero(np.diff(turn) != 0)
        line = np.maximum(turn[k], turn[k + 1]) * 2 * np.pi - np.pi
        at = gain[k] + (line - phase[k]) / (phase[k + 1] - phase[k]) * (gain[k + 1] - gain[k])
        value = min((-20 / math.log(10) * at[at < 0]).tolist(), default=math.inf)
        return value, value
    k = np.flatnonzero((gain[1:] > 0) != (gain[:-1] > 0))
    share = -gain[k] / (gain[k + 1] - gain[k])
    at = np.exp(x[k] + share * (x[k + 1] - x[k]))
    margin = np.pi + phase[k] + share * (phase[k + 1] - phase[k])
    slope = (phase[k + 1] - phase[k]) / (x[k + 1] - x[k])
    value = {
        "crossover_rad_s": at[-1],
        "phase_margin_deg": np.degrees(margin.min()),
        "delay_margin_s": (margin / at).min(),
        "phase_slope_deg_per_decade": np.degrees(slope[-1]) * math.log(10),
    }[name]
    return float(value), float(value)


def only(spec: DesignSpec, gains: FoPi) -> RequirementResult:
    """The result of a spec with one requirement."""
    (result,) = verify(spec, gains).requirements
    return result


def one(plant: PlantFamily, name: str, relation: Relation, *limits: float, **more: float) -> DesignSpec:
    """A spec with one requirement over the family."""
    return spec_of(plant, Requirement(name, relation, limits, **more))  # pyright: ignore[reportArgumentType]


def random_members(family: PlantFamily, count: int = 16) -> np.ndarray:
    """Corners are where brute force would miss most, so they come on top of random places."""
    low, high = family.low, family.high
    p = len(low)
    corners = np.array(np.meshgrid(*[(0.0, 1.0)] * p)).reshape(p, -1).T
    return low + (high - low) * np.concatenate([corners, np.random.default_rng(1).random((count, p))])


# --- published and golden cases


def test_the_published_brake_gains_do_not_meet_their_specification():
    result = verify(spec_of(brake(), *BRAKE_REQUIREMENTS), PUBLISHED_BRAKE)
    assert result.requirements[0].achieved == pytest.approx(0.00838, abs=5e-6)
    assert result.requirements[1].achieved == pytest.approx(141.0, abs=0.05)
    assert result.nominal.phase_margin_deg == result.requirements[1].achieved
    assert [r.is_met for r in result.requirements] == [False, False, True, True, False]
    assert result.stability.stable
    assert not result.all_met


def test_the_published_throttle_gains_do_what_is_said_of_them():
    spec = spec_of(throttle(), Requirement("sensitivity_db", AT_MOST, (-20.0,), to_rad_s=0.035))
    result = verify(spec, PUBLISHED_THROTTLE)
    assert result.nominal.crossover_rad_s == pytest.approx(0.4649, abs=5e-5)
    assert result.nominal.phase_margin_deg == pytest.approx(87.76, abs=5e-3)
    assert result.requirements[0].achieved == pytest.approx(-20.246, abs=5e-4)
    assert result.requirements[0].worst.omega_rad_s == pytest.approx(0.035)
    assert result.all_met


def test_the_robust_brake_has_its_margins_over_the_whole_range():
    gains = FoPi(0.3976732, 0.6527344, 0.55)
    least = only(one(brake(2.35), "phase_margin_deg", AT_LEAST, 90.0), gains)
    most = only(one(brake(2.35), "phase_margin_deg", AT_MOST, 110.0), gains)
    assert (least.achieved, most.achieved) == (pytest.approx(95.6, abs=0.05), pytest.approx(106.5, abs=0.05))
    fastest = only(one(brake(2.35), "crossover_rad_s", AT_MOST, 1.0), gains)
    assert fastest.achieved == pytest.approx(0.4855, abs=5e-5)
    assert fastest.worst.plant == {"time_constant_s": 1.6}


def test_the_largest_sensitivity_of_a_family_is_found_with_its_plant_and_frequency():
    gains = FoPi(0.24027, 0.39344, 0.9)
    stability = verify(spec_of(brake(2.35)), gains).stability
    assert 10 ** (stability.peak_sensitivity_db / 20) == pytest.approx(1.1637075, abs=5e-8)
    assert stability.worst.omega_rad_s == pytest.approx(0.522, abs=5e-4)
    assert stability.worst.plant == {"time_constant_s": 3.1}
    low, high = (only(one(brake(2.35), "phase_margin_deg", r, 75.0), gains).achieved for r in (AT_LEAST, AT_MOST))
    assert (low, high) == (pytest.approx(68.9, abs=0.05), pytest.approx(83.3, abs=0.05))


def test_simc_on_an_integrator_with_dead_time_has_its_known_peak():
    stability = verify(spec_of(pole(1.0, 0.0, 1.0)), FoPi(0.5, 0.0625, 1.0)).stability
    assert 10 ** (stability.peak_sensitivity_db / 20) == pytest.approx(1.7035, abs=5e-5)


def test_the_designed_brake_gains_are_met_and_their_spread_is_known():
    # five digits of gains are not enough for an equality to 1e-6
    spec = spec_of(brake(), *BRAKE_REQUIREMENTS, objective=Objective(Sense.MINIMIZE, "phase_margin_spread_deg"))
    result = verify(spec, ROBUST_BRAKE, tolerance=1e-5)
    assert result.all_met
    assert result.objective == pytest.approx(97.39 - 90.0, abs=0.01)
    assert result.objective_worst is not None
    assert result.objective_worst.plant == {"time_constant_s": 1.6}


# --- stability


def test_an_unstable_loop_with_a_small_sensitivity_is_refuted():
    # |L| <= 0.5 around an unstable pole: |S| <= 2 everywhere, and no encirclement that would move the pole.
    family, gains = pole(1.0, -1.0), FoPi(0.5, 0.0, 1.0)
    result = verify(spec_of(family, Requirement("sensitivity_db", AT_MOST, (6.1,))), gains)
    assert result.requirements[0].outcome is Outcome.MET
    assert not result.stability.stable
    assert result.stability.unstable_poles == 1
    assert "1 closed-loop pole" in result.stability.reason
    assert not result.all_met


def test_a_loop_whose_sensitivity_never_exceeds_one_can_be_unstable():
    family, gains = transfer_function([1.0, 0.0005, 1.5], [1.0, 0.0005, 1.0]), FoPi(0.0, 0.1, 1.0)
    roots = np.roots(np.polyadd(np.polymul([1.0, 0.0], [1.0, 0.0005, 1.0]), 0.1 * np.array([1.0, 0.0005, 1.5])))
    stability = verify(spec_of(family), gains).stability
    assert stability.unstable_poles == int((roots.real > 0).sum()) == 2
    assert stability.peak_sensitivity_db < 0.01


def test_one_unstable_member_makes_the_family_unstable_and_is_named():
    # s(s + p) + kp s + ki is stable when kp + p > 0
    family = pole(1.0, (0.5, -0.3, 1.0))
    assert verify(spec_of(family), FoPi(0.31, 0.1, 1.0)).stability.stable
    stability = verify(spec_of(family), FoPi(0.29, 0.1, 1.0)).stability
    assert not stability.stable
    assert stability.worst.plant["pole_rad_s"] < -0.29


@pytest.mark.parametrize(
    ("family", "gains", "words"),
    [
        (transfer_function([1.0, 0.0], [1.0, 2.0, 1.0]), FoPi(1.0, 1.0, 0.5), "cancels"),
        (transfer_function([1.0, 1.0], [1.0, 2.0], 0.1), FoPi(1.1, 0.1, 1.0), "direct path"),
        (pole(1.0, 0.0), FoPi(0.0, 1.0, 1.0), "told from one through -1"),
        (transfer_function([1.0], [1.0, 0.0, 1.0, 0.0]), FoPi(1.0, 1.0, 1.0), "2 closed-loop poles"),
    ],
)
def test_the_reason_of_an_instability_is_said(family: PlantFamily, gains: FoPi, words: str):
    stability = verify(spec_of(family), gains).stability
    assert not stability.stable
    assert words in stability.reason


@given(
    st.lists(st.floats(-2.0, 3.0), min_size=3, max_size=3),
    st.floats(-3.0, 3.0),
    st.floats(-3.0, 3.0),
    st.booleans(),
)
@settings(max_examples=60, deadline=None, derandomize=True)
def test_stability_agrees_with_the_roots_of_the_polynomial_for_alpha_one(
    coefficients: list[float], kp: float, ki: float, zero: bool
):
    denominator = np.array([1.0, *coefficients])
    numerator = np.array([0.7, 1.0]) if zero else np.array([1.0])
    characteristic = np.polyadd(np.append(denominator, 0.0), np.polymul(numerator, [kp, ki]))
    roots = np.roots(characteristic)
    if abs(ki) < 1e-3 or np.abs(roots.real).min() < 1e-3 or np.abs(np.roots(denominator).real).min() < 1e-3:
        return  # too close to the axis to be told from it
    stability = verify(
        spec_of(transfer_function(numerator.tolist(), denominator.tolist())), FoPi(kp, ki, 1.0)
    ).stability
    assert stability.unstable_poles == int((roots.real > 0).sum())


# --- requirements


@pytest.mark.thinned(2)
@pytest.mark.parametrize(
    ("name", "band"),
    [
        ("crossover_rad_s", None),
        ("phase_margin_deg", None),
        ("gain_margin_db", None),
        ("delay_margin_s", None),
        ("phase_slope_deg_per_decade", None),
        ("sensitivity_db", (0.01, 0.2)),
        ("complementary_sensitivity_db", (0.2, 3.0)),
        ("control_sensitivity_db", (0.05, 5.0)),
        ("load_sensitivity_db", (0.05, 5.0)),
        ("loop_gain_db", (0.1, 0.5)),
        ("sensitivity_db", (0.7, 0.7)),
    ],
)
def test_every_quantity_and_relation_has_a_feasible_and_an_infeasible_twin(name: str, band: tuple[float, float] | None):
    family, gains = brake(dead_time_s=0.3), FoPi(0.5, 0.5, 0.9)
    omega = OMEGA if band is None else np.geomspace(*band, 20_001)
    values = [brute(name, gains, family.member(np.array([tau])), omega) for tau in np.linspace(1.6, 3.1, 31)]
    low, high = min(v[0] for v in values), max(v[1] for v in values)
    step = 1e-3 * max(abs(low), abs(high))
    more = {} if band is None else {"from_rad_s": band[0], "to_rad_s": band[1]}

    def holds(relation: Relation, *limits: float) -> bool:
        result = only(one(family, name, relation, *limits, **more), gains)
        assert result.score is not None
        assert result.is_met == (result.score <= 1.0)
        return result.is_met

    assert holds(AT_LEAST, low - step)
    assert not holds(AT_LEAST, low + step)
    assert holds(AT_MOST, high + step)
    assert not holds(AT_MOST, high - step)
    assert holds(BETWEEN, low - step, high + step)
    assert not holds(BETWEEN, low + step, high + step)
    assert not holds(BETWEEN, low - step, high - step)
    if band is None or band[0] == band[1]:
        single = lag(1.0, 2.25, 0.3)
        exact = only(one(single, name, AT_LEAST, low, **more), gains).achieved
        assert exact is not None
        assert exact == pytest.approx(brute(name, gains, single.member(np.zeros(0)), omega)[0], abs=step)
        assert only(one(single, name, EQUALS, exact, **more), gains).is_met
        assert not only(one(single, name, EQUALS, exact + 0.01 * step, **more), gains).is_met


def test_scores_are_one_at_the_limit_and_grow_with_the_violation():
    family = brake()
    achieved = only(one(family, "phase_margin_deg", AT_LEAST, 80.0), ROBUST_BRAKE).achieved
    assert achieved is not None
    at_limit = only(one(family, "phase_margin_deg", AT_LEAST, achieved), ROBUST_BRAKE)
    beyond = only(one(family, "phase_margin_deg", AT_LEAST, achieved + math.degrees(0.1)), ROBUST_BRAKE)
    inside = only(one(family, "phase_margin_deg", AT_LEAST, achieved - math.degrees(0.2)), ROBUST_BRAKE)
    scores = [at_limit.score, beyond.score, inside.score]
    assert scores == pytest.approx([math.exp(-1e-6), math.exp(0.1 - 1e-6), math.exp(-0.2 - 1e-6)])
    equal = verify(spec_of(family, Requirement("crossover_rad_s", EQUALS, (0.3,), Scope.NOMINAL)), ROBUST_BRAKE, 1e-3)
    (result,) = equal.requirements
    assert result.achieved is not None
    assert result.score == pytest.approx(abs(math.log(result.achieved / 0.3)) / 1e-3)


def test_a_gain_margin_that_does_not_end_satisfies_at_least_and_nothing_else():
    results = {
        relation: only(one(brake(), "gain_margin_db", relation, *limits), ROBUST_BRAKE)
        for relation, limits in ((AT_LEAST, (12.0,)), (AT_MOST, (12.0,)), (EQUALS, (12.0,)), (BETWEEN, (3.0, 12.0)))
    }
    assert all(r.outcome is Outcome.INFINITE and r.achieved == math.inf for r in results.values())
    assert [relation for relation, r in results.items() if r.is_met] == [AT_LEAST]
    assert results[AT_LEAST].score == 0.0


def test_a_gain_margin_that_ends_for_some_members_only_is_reported_for_those():
    family = brake(dead_time_s=(0.1, 0.0, 0.3))
    least = only(one(family, "gain_margin_db", AT_LEAST, 6.0), ROBUST_BRAKE)
    expected = brute("gain_margin_db", ROBUST_BRAKE, lag(1.0, 1.6, 0.3).member(np.zeros(0)))[0]
    assert least.achieved == pytest.approx(expected, abs=1e-3)
    assert only(one(family, "gain_margin_db", AT_MOST, 600.0), ROBUST_BRAKE).outcome is Outcome.INFINITE


def test_a_loop_without_a_crossover_says_so():
    family, gains = lag((0.9, 0.5, 2.0), 1.0), FoPi(0.6, 0.0, 1.0)
    for name in ("crossover_rad_s", "phase_slope_deg_per_decade"):
        for relation in (AT_LEAST, AT_MOST):
            limit = 1e9 if relation is AT_MOST else -1e9 if "slope" in name else 1e-9
            result = only(one(family, name, relation, limit), gains)
            missing = (Outcome.NO_CROSSOVER, None, None, False)
            assert (result.outcome, result.achieved, result.score, result.is_met) == missing
            assert result.worst.plant["static_gain"] * 0.6 < 1.0
    assert verify(one(family, "crossover_rad_s", AT_LEAST, 1.0), gains).objective is None


def test_the_margins_of_a_loop_without_a_crossover_are_infinite():
    # 0.6 k/(s + 1): the smallest margins are those of k = 2, where omega = sqrt(0.44) and arg L = -atan(omega)
    family, gains = lag((0.9, 0.5, 2.0), 1.0), FoPi(0.6, 0.0, 1.0)
    omega = math.sqrt(0.44)
    angle = math.pi - math.atan(omega)
    for name, least in (("phase_margin_deg", math.degrees(angle)), ("delay_margin_s", angle / omega)):
        smallest, largest = (only(one(family, name, relation, 1.0), gains) for relation in (AT_LEAST, AT_MOST))
        assert smallest.achieved == pytest.approx(least, rel=1e-9)
        assert smallest.is_met
        assert (largest.achieved, largest.outcome, largest.is_met) == (math.inf, Outcome.INFINITE, False)
        assert largest.worst.plant["static_gain"] * 0.6 < 1.0
        never = only(one(lag((0.9, 0.5, 1.5), 1.0), name, AT_LEAST, 1.0), gains)
        assert (never.achieved, never.outcome, never.is_met) == (math.inf, Outcome.INFINITE, True)
        for relation, limits in ((EQUALS, (1.0,)), (BETWEEN, (1.0, 2.0))):
            exact = one(lag(0.9, 1.0), name, relation, *limits)
            assert not only(exact, gains).is_met


def test_an_unstable_member_has_no_margin_and_misses_every_limit_of_it():
    # k/(s + 1)^3 is unstable for k > 8
    family, gains = transfer_function([(7.0, 6.0, 9.0)], [1.0, 3.0, 3.0, 1.0]), FoPi(1.0, 0.0, 1.0)
    for name in ("phase_margin_deg", "delay_margin_s", "gain_margin_db"):
        for relation in (AT_LEAST, AT_MOST):
            result = only(one(family, name, relation, 1e-3 if relation is AT_LEAST else 100.0), gains)
            assert (result.outcome, result.achieved, result.is_met) == (Outcome.UNSTABLE, None, False)
            assert result.worst.plant["numerator[0]"] > 8.0
            spec = spec_of(
                family, Requirement(name, relation, (1e-3 if relation is AT_LEAST else 100.0,), Scope.NOMINAL)
            )
            assert only(spec, gains).is_met


def test_a_direct_path_of_more_than_1_leaves_no_delay_margin():
    # (a s + 3)/(4 s + 1): any dead time makes infinitely many poles unstable where a >= 4
    gains = FoPi(1.0, 0.0, 1.0)
    result = only(one(transfer_function([(3.0, 5.0), 3.0], [4.0, 1.0]), "delay_margin_s", AT_LEAST, 0.1), gains)
    assert (result.achieved, result.worst.omega_rad_s, result.is_met) == (0.0, math.inf, False)
    assert result.worst.plant["numerator[0]"] >= 4.0
    # a = 3: omega^2 = 8/7, lag 180 deg + atan(omega) - atan(4 omega)
    omega = math.sqrt(8.0 / 7.0)
    lag_rad = math.pi + math.atan(omega) - math.atan(4.0 * omega)
    result = only(one(transfer_function([(2.0, 3.0), 3.0], [4.0, 1.0]), "delay_margin_s", AT_LEAST, 0.1), gains)
    assert result.achieved == pytest.approx(lag_rad / omega, rel=1e-9)


def test_nominal_requirements_look_at_the_nominal_member_alone():
    spec = spec_of(brake(), Requirement("phase_margin_deg", AT_LEAST, (89.0,), Scope.NOMINAL))
    result = only(spec, ROBUST_BRAKE)
    assert result.is_met
    assert result.worst.plant == {"time_constant_s": 2.25}
    assert not only(one(brake(), "phase_margin_deg", AT_LEAST, 89.0), ROBUST_BRAKE).is_met


def test_limits_of_a_band_do_not_become_nan():
    for name, relation in (("sensitivity_db", AT_LEAST), ("loop_gain_db", AT_MOST), ("loop_gain_db", AT_LEAST)):
        result = only(one(brake(), name, relation, 0.0), ROBUST_BRAKE)
        assert result.achieved is not None
        assert math.isinf(result.achieved)
        assert result.outcome is Outcome.VIOLATED
        assert result.score == pytest.approx(math.exp(700.0))


def test_no_controller_is_an_error_with_a_message():
    with pytest.raises(DomainError, match="there is no loop"):
        verify(spec_of(brake()), FoPi(0.0, 0.0, 0.5))


# --- the search over the family


@pytest.mark.thinned(2)
@pytest.mark.parametrize("name", ["phase_margin_deg", "gain_margin_db", "crossover_rad_s", "control_sensitivity_db"])
def test_no_random_member_of_three_uncertain_numbers_is_worse_than_the_worst(name: str):
    family, gains = lag_gain_and_delay(), FoPi(0.6, 0.5, 0.9)
    values = np.array([brute(name, gains, family.member(point)) for point in random_members(family)])
    for relation, extreme in ((AT_LEAST, float(values[:, 0].min())), (AT_MOST, float(values[:, 1].max()))):
        if name == "control_sensitivity_db" and relation is AT_LEAST:
            continue  # over all frequencies its infimum is a limit
        result = only(one(family, name, relation, 1.0), gains)
        assert result.achieved is not None
        assert (extreme - result.achieved) * (1 if relation is AT_LEAST else -1) > -GRID_ERROR
        member = family.member(np.array(result.worst.point))
        attained = brute(name, gains, member)[0 if relation is AT_LEAST else 1]
        assert result.achieved == pytest.approx(attained, rel=GRID_ERROR, abs=GRID_ERROR)


def test_four_uncertain_numbers_are_searched_too():
    family = transfer_function([(0.9, 1.1)], [(0.9, 1.1), (1.8, 2.2), (0.9, 1.1)], 0.1)
    gains = FoPi(0.8, 0.5, 0.9)
    values = [brute("phase_margin_deg", gains, family.member(point))[0] for point in random_members(family)]
    result = only(one(family, "phase_margin_deg", AT_LEAST, 30.0), gains)
    assert result.achieved is not None
    assert result.achieved <= min(values) + GRID_ERROR
    member = family.member(np.array(result.worst.point))
    assert result.achieved == pytest.approx(brute("phase_margin_deg", gains, member)[0], abs=GRID_ERROR)


def test_a_worst_member_inside_the_box_is_found():
    # a resonance that moves over the frequency the requirement looks at
    family, gains = transfer_function([1.0], [1.0, 0.02, (0.5, 2.0)]), FoPi(0.004, 0.001, 0.9)
    k = np.linspace(0.5, 2.0, 2_000_001)
    loop = (gains.kp + gains.ki * 1j**-gains.alpha) / (k - 1.0 + 0.02j)
    expected = -20 * np.log10(np.abs(1 + loop))
    result = only(one(family, "sensitivity_db", AT_MOST, 6.0, from_rad_s=1.0, to_rad_s=1.0), gains)
    assert result.achieved == pytest.approx(expected.max(), rel=1e-9)
    assert result.worst.plant["denominator[2]"] == pytest.approx(k[expected.argmax()], abs=1e-5)


def test_a_largest_phase_margin_inside_the_box_is_found():
    family, gains = transfer_function([(0.05, 5.0), 1.0], [1.0, 1.0, 0.3, 0.0], 0.2), FoPi(0.1, 0.02, 0.8)
    result = only(one(family, "phase_margin_deg", AT_MOST, 60.0), gains)
    lead = np.linspace(3.5, 4.5, 41)
    expected = max(brute("phase_margin_deg", gains, family.member(np.array([z])))[0] for z in lead)
    assert result.achieved == pytest.approx(expected, abs=1e-3)
    assert 3.5 < result.worst.point[0] < 4.5


def test_a_crossing_that_vanishes_in_a_narrow_part_of_the_box_is_noticed():
    # Zero and pole pair cancel near z = 1; only for |z - 1| < 0.005 the resonance does not reach |L| = 1.  Its
    # neighbours in a sample of 65 lie further away than that.
    family, gains = transfer_function([1.0, 0.0005, (1.5, 0.5, 2.1)], [1.0, 0.0005, 1.0]), FoPi(0.0, 0.1, 1.0)
    result = only(one(family, "crossover_rad_s", AT_LEAST, 0.5), gains)
    assert result.outcome is Outcome.VIOLATED
    assert result.achieved == pytest.approx(0.1, abs=0.001)
    assert 0.995 <= result.worst.point[0] <= 1.005


@given(st.sampled_from(["kp", "ki", "alpha"]), st.sampled_from([-1.0, 1.0]), st.floats(1e-5, 0.2))
@settings(max_examples=40, deadline=None, derandomize=True)
def test_perturbed_gains_are_rejected(name: str, sign: float, size: float):
    # closed form of PAPER.md, section 3: the gains that meet both equalities exactly
    alpha, omega = 0.8, 0.3
    x = 1j * (1 + 2.25j * omega) * np.exp(-1j * np.pi)
    ki = -x.imag * omega**alpha / math.sin(alpha * np.pi / 2)
    kp = x.real - ki * omega**-alpha * math.cos(alpha * np.pi / 2)
    gains = FoPi(float(kp), float(ki), alpha)
    spec = spec_of(lag(1.0, 2.25), *BRAKE_REQUIREMENTS[:2])
    assert verify(spec, gains).all_met
    assert not verify(spec, replace(gains, **{name: getattr(gains, name) * (1 + sign * size)})).all_met


@given(st.floats(-6.0, 4.0))
@settings(max_examples=6, deadline=None, derandomize=True)
def test_scaling_time_scales_frequencies_and_delays_and_nothing_else(exponent: float):
    c = 10.0**exponent
    gains = FoPi(0.5, 0.5, 0.9)
    slow = FoPi(0.5, 0.5 * c**-0.9, 0.9)
    names = ("phase_margin_deg", "gain_margin_db", "phase_slope_deg_per_decade", "crossover_rad_s", "delay_margin_s")
    requirements = tuple(Requirement(name, AT_LEAST, (1.0,)) for name in names)
    before = verify(spec_of(lag(1.0, (1.6, 3.1), 0.3), *requirements), gains)
    after = verify(spec_of(lag(1.0, (1.6 * c, 3.1 * c), 0.3 * c), *requirements), slow)
    ratio = [b.achieved / a.achieved for a, b in zip(before.requirements, after.requirements, strict=True)]  # type: ignore[operator]
    assert ratio == pytest.approx([1.0, 1.0, 1.0, 1.0 / c, c], rel=1e-7)
    assert after.stability.peak_sensitivity_db == pytest.approx(before.stability.peak_sensitivity_db, rel=1e-7)


# --- objectives


@pytest.mark.parametrize("name", [name for name in OBJECTIVES["minimize"] if name != "iae_disturbance"])
def test_every_objective_agrees_with_brute_force(name: str):
    family, gains = lag((1.0, 0.8, 1.2), (2.25, 1.6, 3.1), 0.3), FoPi(0.6, 0.5, 0.9)
    result = verify(spec_of(family, objective=Objective(Sense.MINIMIZE, name)), gains)
    nominal = family.member(family.nominal_point)
    margin, crossover = (brute(q, gains, nominal)[0] for q in ("phase_margin_deg", "crossover_rad_s"))

    def value(plant: Plant) -> float:
        if name == "phase_margin_spread_deg":
            return abs(brute("phase_margin_deg", gains, plant)[0] - margin)
        if name == "crossover_spread_db":
            return abs(brute("loop_gain_db", gains, plant, np.array([crossover]))[0])
        return brute(name.removesuffix("_peak_db") + "_db", gains, plant)[1]

    values = [value(family.member(point)) for point in random_members(family)]
    assert result.objective == pytest.approx(max(values), rel=GRID_ERROR)
    assert result.objective_worst is not None
    assert value(family.member(np.array(result.objective_worst.point))) == pytest.approx(max(values), rel=GRID_ERROR)


def test_maximizing_ki_is_worth_ki():
    assert verify(spec_of(brake(), objective=Objective(Sense.MAXIMIZE, "ki")), ROBUST_BRAKE).objective == 0.38776


def test_without_an_objective_the_value_is_the_depth():
    result = verify(spec_of(brake(), *BRAKE_REQUIREMENTS), ROBUST_BRAKE)
    slacks = [r.slack for r in result.requirements[2:]]
    assert slacks[1] == math.inf
    assert result.objective == min(s for s in slacks if s is not None)
    no_limits = verify(spec_of(brake(), *BRAKE_REQUIREMENTS[:2]), ROBUST_BRAKE)
    assert no_limits.objective == pytest.approx(-no_limits.stability.peak_sensitivity_db * math.log(10) / 20)


def test_the_discounted_error_is_the_integral_of_a_simulated_load_step():
    # tau y' = -y + k (u + 1), u = -kp y - ki q, q' = y, e = -y; the trapezoid rule on 40,000 steps errs by 1e-6
    family, gains, horizon = lag(2.0, 1.5), FoPi(0.7, 0.4, 1.0), 5.0
    a = np.array([[(-1 - 2.0 * gains.kp) / 1.5, -2.0 * gains.ki / 1.5], [1.0, 0.0]])
    b = np.array([2.0 / 1.5, 0.0])
    t = np.linspace(0.0, 150.0, 40_001)
    modes, vectors = np.linalg.eig(a)
    rest = -np.linalg.solve(a, b)
    y = ((vectors[0] * np.linalg.solve(vectors, -rest)) @ np.exp(np.outer(modes, t))).real + rest[0]
    expected = abs(np.trapezoid(y * np.exp(-t / horizon), t))
    objective = Objective(Sense.MINIMIZE, "iae_disturbance", horizon_s=horizon)
    assert verify(spec_of(family, objective=objective), gains).objective == pytest.approx(expected, rel=1e-5)
    patient = replace(objective, horizon_s=1e9)
    assert verify(spec_of(family, objective=patient), gains).objective == pytest.approx(1 / 0.4, rel=1e-6)


def test_the_discounted_error_is_that_of_the_worst_member_with_its_dead_time():
    family, gains = lag_gain_and_delay(), FoPi(0.6, 0.5, 0.9)
    result = verify(spec_of(family, objective=Objective(Sense.MINIMIZE, "iae_disturbance")), gains)
    horizon = 10.0 * (2.25 + 0.3)
    s = 1.0 / horizon

    def error(k: float, tau: float, delay: float) -> float:
        p = k * math.exp(-s * delay) / (tau * s + 1)
        return horizon * p / (1 + (gains.kp + gains.ki * s**-gains.alpha) * p)

    assert default_horizon_s(family) == pytest.approx(horizon)
    assert result.objective == pytest.approx(max(error(*point) for point in random_members(family)), rel=1e-9)


@pytest.mark.parametrize(
    ("family", "seconds"),
    [
        (throttle(), 10 / 0.1746),
        (pole(4.0, 0.0), 10 / 4.0),
        (pole(4.0, 0.0, 3.0), 30.0),
        (transfer_function([9.0], [1.0, 0.0, 0.0]), 10 / 3.0),
        (transfer_function([9.0], [2.0]), 10.0),
        (transfer_function([2.0, 1.0], [1.0, 0.0, 0.0]), 20.0),
    ],
)
def test_the_horizon_follows_from_the_plant_alone(family: PlantFamily, seconds: float):
    assert default_horizon_s(family) == pytest.approx(seconds)
