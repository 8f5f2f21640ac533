"""The program's slots against `core/`: two derivations of the same loop."""

from __future__ import annotations

from functools import partial
from typing import Any

import casadi as ca
import numpy as np
import pytest
from cases.project import ROOT

from fopi_tune.core.controller import FoPi
from fopi_tune.core.loops import Loops, Plants
from fopi_tune.core.peaks import Response, log_response_at
from fopi_tune.design.global_search.basins import scan_box
from fopi_tune.design.global_search.nonlinear import solve as solving
from fopi_tune.design.global_search.nonlinear.controllers import Kind
from fopi_tune.design.global_search.nonlinear.program import COEFFICIENTS, INDEX, PARAMETERS, _slot, solver_of
from fopi_tune.design.global_search.polish import Polish, Polished
from fopi_tune.design.global_search.problem import Problem
from fopi_tune.spec import load_spec, parse_spec

PLANTS = [
    "{model: lag, static_gain: {min: 0.5, max: 2.0}, time_constant_s: {min: 1.6, max: 3.1}, dead_time_s: 0.4}",
    "{model: pole, gain: -4.39, pole_rad_s: {min: -0.2, max: 0.3}, dead_time_s: 0.1}",
    "{model: transfer_function, numerator: [0.3, {min: 1, max: 2}], denominator: [1, {min: 0.1, max: 2}, 3, 1]}",
]


def slot_value(problem: Problem, gains: FoPi, theta: np.ndarray, v: float, near: float, **weights: float) -> float:
    """The quantity of a slot with these weights: its row with sign -1 and limit 0."""
    p = np.zeros(PARAMETERS)
    p[:COEFFICIENTS] = problem.scaled.members(theta[None, :])[0]
    p[INDEX["sign"]], p[INDEX["near"]] = -1.0, near
    for name, weight in weights.items():
        p[INDEX[name]] = weight
    x = problem.scale.scaled(gains)
    symbols = ca.SX.sym("v")
    kind = Kind(peaks=True, slopes=True)
    _, row, _ = _slot(float(x[0]), float(x[1]), float(x[2]), 0.0, symbols, 0.0, 0.0, ca.SX(p), kind)
    return float(ca.Function("row", [symbols], [row])(v))


@pytest.mark.thinned(2)
@pytest.mark.parametrize("plant", PLANTS)
def test_the_slots_quantities_are_those_of_core(plant: str) -> None:
    spec = parse_spec(f"schema: 1\nname: x\nplant: {plant}\nrequirements: [{{sensitivity_db: {{at_most: 6}}}}]\n")
    problem, chance = Problem.of(spec), np.random.default_rng(2)
    family = spec.plant
    for _ in range(25):
        gains = FoPi(*chance.uniform((-3, -3, 0.1), (3, 3, 1.9)).tolist())
        theta = family.low + chance.random(len(family.low)) * (family.high - family.low)
        u = float(chance.uniform(-4, 3))
        omega = np.exp(u)
        loops = Loops.of(gains, Plants.members(family, theta[None, :]))
        row, at = np.zeros(1, dtype=np.intp), np.array([u])
        log_l, slope = loops.log_response(row, at)[0], loops.log.derivative(row, at)[0]
        sensitivity = log_response_at(loops, Response.SENSITIVITY, row, np.array([omega]))[0]
        control = log_response_at(loops, Response.CONTROL_SENSITIVITY, row, np.array([omega]))[0]
        v, near = u - np.log(problem.scale.omega_rad_s), log_l.imag + omega * loops.plants.dead_time_s[0]

        value = partial(slot_value, problem, gains, theta, v, near)

        # rounding of some hundred operations; near -1 or a zero of C the logarithms magnify it
        room = 1e-9 * (1.0 + np.exp(sensitivity) + abs(log_l))
        log_g = np.log(problem.scale.gain)
        assert value(log_l=1.0) == pytest.approx(log_l.real, abs=room)
        assert value(angle=1.0) == pytest.approx(log_l.imag, abs=room)
        assert value(slope=1.0) == pytest.approx(slope.imag * np.log(10.0), abs=30 * room)
        assert value(log_s=1.0) == pytest.approx(sensitivity, abs=room)
        assert value(log_s=1.0, log_c=1.0) == pytest.approx(control + log_g, abs=room)


@pytest.mark.parametrize("name", ["brake_continuous", "brake"])
def test_a_program_without_what_no_slot_asks_for_ends_at_the_same_gains(
    name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    problem, kinds = Problem.of(load_spec(ROOT / "specs" / f"{name}.yaml")), []
    start = scan_box(problem, 1).basins[0].gains

    def solved() -> Polished | None:
        return Polish(problem).run(start)

    def without(size: int, kind: Kind) -> Any:
        kinds.append(kind)
        return solver_of(size, kind)

    monkeypatch.setattr(solving, "solver_of", without)
    found = solved()
    monkeypatch.setattr(
        solving, "solver_of", lambda size, kind: solver_of(size, kind._replace(peaks=True, slopes=True))
    )
    whole = solved()
    assert not any(kind.peaks or kind.slopes for kind in kinds)
    assert found is not None
    assert whole is not None
    assert found.x == pytest.approx(whole.x, rel=1e-9)


def test_the_same_is_not_solved_twice() -> None:
    problem = Problem.of(load_spec(ROOT / "specs" / "brake_continuous.yaml"))
    polish, start = Polish(problem), scan_box(problem, 1).basins[0].gains
    found = polish.look(start)
    assert found is not None
    first, again = (polish._solve(list(found), start.copy(), 0.1, 0.5) for _ in range(2))
    assert first is again
    assert polish.counts.solves == 1
    polish._solve(list(found), start, 0.1, 0.25)
    assert polish.counts.solves == 2
