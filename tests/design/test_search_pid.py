"""The design of a PID against a reference that shares nothing with it (`oracles/pid_search.py`)."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from cases.random_pid_specs import pid_spec
from oracles.pid_search import PidLoops, search

import fopi_tune as ft
from fopi_tune.core.controller import FoPi, Pid
from fopi_tune.design import design, neighbour
from fopi_tune.design.warm import Warm
from fopi_tune.proof import verify
from fopi_tune.results.candidate import Candidate
from fopi_tune.results.status import Status
from fopi_tune.spec.model import DesignSpec

CUBE = "{model: transfer_function, numerator: [1], denominator: [1, 3, 3, 1]}"
LAG = (
    "{model: lag, static_gain: {nominal: 1, min: 0.8, max: 1.2}, "
    "time_constant_s: {nominal: 1, min: 0.8, max: 1.5}, dead_time_s: 0.5}"
)
DELAYED = "{model: transfer_function, numerator: [1], denominator: [1, 2, 1], dead_time_s: 1}"
SWINGING = "{model: transfer_function, numerator: [1], denominator: [1, 0.3, 1], dead_time_s: 0.05}"
POSITIVE = "kp: {min: 0, max: 20}, ki: {min: 0, max: 20}, kd: {min: 0, max: 20}"
PEAKS = "{sensitivity_db: {at_most: 4.0824}}, {control_sensitivity_db: {at_most: 26}}"
#: relative; the bar on an objective, and what the reference's grids leave
OPTIMAL = 1e-3


def spec_of(
    plant: str, requirements: str = PEAKS, ranges: str = POSITIVE, more: str = "", tf: float = 0.05
) -> DesignSpec:
    return ft.parse_spec(
        f"schema: 1\nname: x\nplant: {plant}\ncontroller: {{structure: pid, {ranges}, "
        f"derivative_filter_time_constant_s: {tf}}}\nrequirements: [{requirements}]\n"
        f"{more or 'objective: {maximize: ki}'}\n"
    )


def solved(spec: DesignSpec, found: Candidate | None = None) -> tuple[Pid, float]:
    """The gains, verified, and their objective as something to be minimised."""
    found = design(spec) if found is None else found
    assert found.status is Status.SOLVED, found.message
    assert isinstance(found.gains, Pid)
    if spec.digital is not None:
        loops = PidLoops(spec, 5, 150)
        value, excess, unstable = loops.evaluate(np.array([[found.gains.kp, found.gains.ki, found.gains.kd]]))
        # a parabola through three points of the grid errs by this
        assert excess.max() <= 2e-5
        assert unstable[0] == 0
        return found.gains, float(value[0])
    verified = verify(spec, found.gains)
    assert verified.all_met
    assert verified.objective is not None
    is_maximised = spec.objective is None or spec.objective.sense.value == "maximize"
    return found.gains, -verified.objective if is_maximised else verified.objective


def test_a_margin_that_no_pi_reaches_is_reached() -> None:
    asked = "{crossover_rad_s: {equals: 1}}, {phase_margin_deg: {equals: 60}}"
    spec = spec_of(CUBE, asked, "kp: {min: 0}, ki: {min: 0}, kd: {min: 0}", tf=0.02)
    pi = ft.parse_spec(f"schema: 1\nname: x\nplant: {CUBE}\ncontroller: {{kp: {{min: 0}}, ki: {{min: 0}}}}\n"
                       f"requirements: [{asked}]\nobjective: {{maximize: ki}}\n")  # fmt: skip
    assert design(pi).status is Status.INFEASIBLE
    found = ft.tune(spec, proof=False)
    assert found.status is Status.SOLVED
    gains = found.gains
    assert isinstance(gains, Pid)
    loop = gains(np.array([1j])) / (1.0 + 1j) ** 3
    assert abs(loop[0]) == pytest.approx(1.0, abs=1e-6)
    assert np.degrees(np.angle(-loop[0])) == pytest.approx(60.0, abs=1e-4)
    # along the gains with this crossover and margin ki grows until |L| touches 1 above it, at kd = 5.35935
    d = 1j / (0.02j + 1.0)
    rest = np.exp(-2j * np.pi / 3.0) * (1.0 + 1j) ** 3 - 5.35935 * d
    # at the border itself the touching crossover is the highest one, which the check refutes
    assert -0.98 * rest.imag <= gains.ki <= -rest.imag * (1.0 + 1e-6)


def test_the_largest_integral_gain_of_a_cube_of_lags() -> None:
    # 1.158829 is what a grid that ends at 1000 rad/s allows, where |C S| has not yet reached kp + kd/Tf
    gains, cost = solved(spec_of(CUBE))
    assert -cost == pytest.approx(1.158659, rel=5e-6)
    assert 20.0 * np.log10(gains.kp + gains.kd / 0.05) == pytest.approx(26.0, abs=1e-5)


def test_the_largest_integral_gain_of_an_uncertain_lag() -> None:
    asked = "{sensitivity_db: {at_most: 4.0824}}, {control_sensitivity_db: {at_most: 14}}"
    ranges = "kp: {min: 0, max: 5}, ki: {min: 0.01, max: 5}, kd: {min: 0, max: 3}"
    assert -solved(spec_of(LAG, asked, ranges))[1] == pytest.approx(1.36268, rel=1e-5)


@pytest.mark.thinned(2)
@pytest.mark.parametrize("plant", [DELAYED, SWINGING])
def test_a_known_plant_is_solved_to_the_references_optimum(plant: str) -> None:
    spec = spec_of(plant)
    found = search(spec, population=24, generations=40)
    assert found is not None
    assert solved(spec)[1] <= found[1] + OPTIMAL * abs(found[1])


def test_a_plant_of_the_other_sign_has_the_gains_of_the_other_sign() -> None:
    negative = DELAYED.replace("[1],", "[-1],")
    ranges = "kp: {min: -20, max: 0}, ki: {min: -20, max: 0}, kd: {min: -20, max: 0}"
    iae = "objective: {minimize: iae_disturbance}"
    one, cost = solved(spec_of(DELAYED, more=iae))
    other, same = solved(spec_of(negative, ranges=ranges, more=iae))
    assert (other.kp, other.ki, other.kd) == pytest.approx((-one.kp, -one.ki, -one.kd), rel=1e-5)
    assert same == pytest.approx(cost, rel=1e-6)


def test_gains_of_either_sign_are_searched() -> None:
    # an unstable plant with a zero on the right needs a negative kp beside a positive kd, or the other way about
    ranges = "kp: {min: -20, max: 20}, ki: {min: -20, max: 20}, kd: {min: -20, max: 20}"
    wide, cost = solved(spec_of(DELAYED, ranges=ranges))
    assert (wide.kp > 0.0, wide.ki > 0.0, wide.kd > 0.0) == (True, True, True)
    assert cost == pytest.approx(solved(spec_of(DELAYED))[1], rel=1e-5)


@pytest.mark.thinned(2)
@pytest.mark.parametrize("held", [("kp",), ("ki",), ("kd",), ("kp", "kd"), ("kp", "ki"), ("ki", "kd")])
def test_gains_that_the_spec_fixes_stay(held: tuple[str, ...]) -> None:
    # gains that are fixed near their best values leave the peak of |S| near its best
    asked = "{control_sensitivity_db: {at_most: 26}}, {sensitivity_db: {at_most: -20}, to_rad_s: 0.1}"
    more = "objective: {minimize: sensitivity_peak_db}"
    best, cost = solved(spec_of(CUBE, asked, more=more))
    ranges = ", ".join(
        f"{n}: {getattr(best, n)!r}" if n in held else f"{n}: {{min: 0, max: 20}}" for n in ("kp", "ki", "kd")
    )
    gains, again = solved(spec_of(CUBE, asked.replace("26", "26.001").replace("-20}", "-19.999}"), ranges, more))
    assert [getattr(gains, name) for name in held] == [getattr(best, name) for name in held]
    # limits were moved by 1e-3 dB
    assert again == pytest.approx(cost, abs=5e-3)


def test_gains_in_narrow_ranges_are_found() -> None:
    best, cost = solved(spec_of(CUBE))
    ranges = ", ".join(
        f"{n}: {{min: {0.9999 * getattr(best, n)}, max: {1.0001 * getattr(best, n)}}}" for n in ("kp", "ki", "kd")
    )
    assert solved(spec_of(CUBE, ranges=ranges))[1] == pytest.approx(cost, rel=1e-6)


def test_a_derivative_that_may_not_act_leaves_a_pi() -> None:
    ranges = "kp: {min: 0, max: 20}, ki: {min: 0, max: 20}, kd: 0"
    pi = ft.parse_spec(
        f"schema: 1\nname: x\nplant: {CUBE}\n"
        "controller: {structure: pi, kp: {min: 0, max: 20}, ki: {min: 0, max: 20}}\n"
        f"requirements: [{PEAKS}]\nobjective: {{maximize: ki}}\n"
    )
    found = design(pi)
    assert found.gains is not None
    assert -solved(spec_of(CUBE, ranges=ranges))[1] == pytest.approx(found.gains.ki, rel=1e-6)


def test_a_derivative_that_helps_nothing_is_left_out() -> None:
    spec = spec_of(
        "{model: lag, static_gain: 1, time_constant_s: 1}",
        "{sensitivity_db: {at_most: -6}, to_rad_s: 0.3}, {phase_margin_deg: {at_least: 60}}",
        more="objective: {minimize: control_sensitivity_peak_db}",
    )
    gains, cost = solved(spec)
    pi = replace(spec, controller=replace(spec.controller, kd=type(spec.controller.kd)(0.0, 0.0)))
    assert cost == pytest.approx(solved(pi)[1], abs=1e-5)
    assert gains.kd == 0.0


def test_limits_that_clash_are_explained_with_a_derivative() -> None:
    found = design(spec_of(DELAYED, "{sensitivity_db: {at_most: -20}, to_rad_s: 1}, {sensitivity_db: {at_most: 3}}"))
    assert found.status is Status.INFEASIBLE
    assert "sensitivity_db at_most -20 from 0 to 1 rad/s (family)" in found.message


def test_a_double_integrator_is_damped_by_the_derivative() -> None:
    ranges = "kp: {min: 0, max: 20}, ki: 0, kd: {min: 0, max: 20}"
    plant = "{model: transfer_function, numerator: [1], denominator: [1, 0, 0]}"
    asked = "{sensitivity_db: {at_most: -20}, to_rad_s: 0.3}, {control_sensitivity_db: {at_most: 30}}"
    spec = spec_of(plant, asked, ranges, "objective: {minimize: sensitivity_peak_db}")
    gains, _ = solved(spec)
    assert gains.ki == 0.0
    assert gains.kd > 0.0


def test_multipliers_are_the_slopes_of_the_optimum() -> None:
    spec = spec_of(CUBE)
    found = design(spec)
    for k, limit in enumerate((4.0824, 26.0)):
        step = 1e-3
        requirements = list(spec.requirements)
        values = []
        for moved in (limit + step, limit - step):
            requirements[k] = replace(spec.requirements[k], limits=(moved,))
            values.append(-solved(replace(spec, requirements=tuple(requirements)))[1])
        assert found.multipliers[k] == pytest.approx((values[0] - values[1]) / (2.0 * step), rel=1e-3)


def test_a_neighbours_gains_start_another_design() -> None:
    spec = spec_of(CUBE)
    gains, _ = solved(spec)
    other = replace(spec, requirements=(replace(spec.requirements[0], limits=(4.2,)), spec.requirements[1]))
    whole = solved(other)[1]
    assert solved(other, design(other, start=neighbour(spec, gains)))[1] == pytest.approx(whole, rel=1e-6)
    # a PI too may start
    assert solved(other, design(other, start=FoPi(1.0, 0.3, 1.0)))[1] == pytest.approx(whole, rel=1e-6)
    warm = Warm.of(spec).settle(other, gains)
    assert warm is not None
    assert warm.objective == pytest.approx(-whole, rel=1e-6)


# --- random specs --------------------------------------------------------------------------------------------------


#: what the reference reached for a seed, to be minimised; 6 and 8 are on samples
KNOWN = {
    2: -0.1839692,
    4: -1.3737050,
    6: 0.1558215,
    7: 0.1253453,
    8: -0.2117184,
    16: -82.01269,
    28: -4.032839,
    33: -1.759314e-4,
    36: 0.3340678,
    39: -219.5307,
}


@pytest.mark.thinned(3)
@pytest.mark.parametrize("seed", KNOWN)
def test_a_random_spec_is_solved_to_the_references_optimum(seed: int) -> None:
    assert solved(ft.parse_spec(pid_spec(seed)))[1] <= KNOWN[seed] + OPTIMAL * abs(KNOWN[seed])


@pytest.mark.long
@pytest.mark.parametrize("seed", range(100, 115))
def test_the_reference_finds_nothing_better_for_a_random_spec(seed: int) -> None:
    spec = ft.parse_spec(pid_spec(seed))
    found, reference = design(spec), search(spec)
    if reference is None:
        assert found.status is not Status.FAILED
        return
    # a peak of nearly 0 dB has no relative distance
    assert solved(spec, found)[1] <= reference[1] + OPTIMAL * max(
        abs(reference[1]), 0.3 if spec.objective is None else 1e-9
    )
