"""Boxes of kp, ki and kd:  what is said of a box holds for each of its controllers, and bounds of PIDs are bounds."""

from __future__ import annotations

import json
import math
from dataclasses import replace

import numpy as np
import pytest
from cases.plants import lag, spec_of
from cases.random_pid_specs import pid_spec
from flint import acb, ctx
from hypothesis import given, settings
from hypothesis import strategies as st

import fopi_tune as ft
from fopi_tune.core.controller import Pid
from fopi_tune.optimum import Optimum, OptimumStatus, certify_optimum, recheck_optimum, to_document
from fopi_tune.optimum.derivative_gains import DerivativeParametrization
from fopi_tune.optimum.problem import Problem
from fopi_tune.optimum.pruning.loop_gain_bounds import LoopGainBounds
from fopi_tune.proof.balls.loop import PRECISION
from fopi_tune.report.text.design import optimum_lines
from fopi_tune.spec.model import ControllerSpec, DesignSpec, GainRange

SIDE = st.floats(0.0, 1.0)
GAIN = st.floats(-4.0, 4.0)
TF = 0.1
EVERY = GainRange(-9.0, 9.0)
CUBE = (
    "schema: 1\nname: x\nplant: {model: transfer_function, numerator: [1], denominator: [1, 3, 3, 1]}\n"
    "controller: {structure: pid, kp: {min: 0, max: 20}, ki: {min: 0, max: 20}, kd: {min: 0, max: 20}, "
    "derivative_filter_time_constant_s: 0.05}\n"
    "requirements: [{sensitivity_db: {at_most: %g}}, {control_sensitivity_db: {at_most: %g}}]\n"
    "objective: {maximize: ki}\n"
)


def box_of(kp: GainRange, ki: GainRange, kd: GainRange, filter_time_s: float = TF) -> ControllerSpec:
    return ControllerSpec(kp, ki, GainRange(1.0, 1.0), kd, filter_time_s)


@settings(max_examples=60, deadline=None)
@given(
    corner=st.tuples(GAIN, GAIN, GAIN), size=st.floats(-6, 0.5), inside=st.tuples(SIDE, SIDE, SIDE), u=st.floats(-6, 6)
)
def test_models_and_enclosures_hold_every_controller_of_a_box(
    corner: tuple[float, ...], size: float, inside: tuple[float, ...], u: float
) -> None:
    which = DerivativeParametrization(3.0, TF)
    box = tuple((low, low + 10.0**size) for low in corner)
    kp, ki, kd = (low + x * (high - low) for (low, high), x in zip(box, inside, strict=True))
    with ctx.workprec(PRECISION):
        controllers = which.controllers(box)
        for log_s in (complex(u, 0.5 * math.pi), complex(u, 0.0)):
            value = Pid(kp, ki, kd, TF)(np.exp(np.array([log_s])))[0]
            model = controllers.taylor_model(acb(log_s.real, log_s.imag))
            middle = [0.5 * (low + high) for low, high in box]
            linear = complex(model.middle) + sum(
                complex(s) * (x - m) for s, x, m in zip(model.slopes, (kp, ki, kd), middle, strict=True)
            )
            assert abs(value - linear) <= 1e-11 * (1.0 + abs(kp) + abs(ki * np.exp(-u)) + abs(kd) / TF)
        over = controllers.enclosure((u - 1e-9, u + 1e-9))
        s = 1j * math.exp(u)
        value, along = kp + ki / s + kd * s / (TF * s + 1.0), -ki / s + kd * s / (TF * s + 1.0) ** 2
        assert over.value.overlaps(acb(value.real, value.imag))
        assert over.along.overlaps(acb(along.real, along.imag))
        for name, gain in (("kp", kp), ("ki", ki), ("kd", kd)):
            low, high = controllers.gain_range(name)
            assert float(low) <= gain <= float(high)


@settings(max_examples=80, deadline=None)
@given(
    corner=st.tuples(GAIN, GAIN, GAIN), size=st.floats(-3, 0), inside=st.tuples(SIDE, SIDE, SIDE), u=st.floats(-5, 5)
)
def test_bounds_of_the_loop_over_a_cell_hold(
    corner: tuple[float, ...], size: float, inside: tuple[float, ...], u: float
) -> None:
    plant, box = lag(2.0, 1.5), tuple((low, low + 10.0**size) for low in corner)
    problem = Problem.of(replace(spec_of(plant), controller=box_of(EVERY, EVERY, EVERY)), None)
    kp, ki, kd = (low + x * (high - low) for (low, high), x in zip(box, inside, strict=True))
    gains = Pid(kp, ki, kd, TF)
    omega = np.exp(np.linspace(u - 0.1, u + 0.1, 9))
    c, p = gains(1j * omega), 2.0 / (1.5j * omega + 1.0)
    with ctx.workprec(PRECISION):
        cells = LoopGainBounds.of(problem, problem.parametrization.controllers(box), ())
        for cell in ((u - 0.1, u + 0.1), (-math.inf, u + 0.1), (u - 0.1, math.inf)):
            low, high = cells.controller_size(cell)
            assert float(low) <= np.abs(c).min() * (1 + 1e-12)
            assert not high.is_finite() or float(high) >= np.abs(c).max() * (1 - 1e-12)
        if cells.is_decreasing((u - 0.1, u + 0.1)):
            assert (np.diff(np.abs(c * p)) < 0.0).all()
        if cells.has_no_crossover(u - 0.1, u + 0.1):
            assert (np.abs(c * p) > 1.0).all() or (np.abs(c * p) < 1.0).all()


@pytest.mark.parametrize("ki", [(0.0, 5.0), (-5.0, 0.0), (-2.0, 3.0), (0.5, 5.0), (0.0, 0.0)])
def test_the_roots_hold_every_gain_of_the_ranges(ki: tuple[float, float]) -> None:
    controller = box_of(GainRange(-1.0, 4.0), GainRange(*ki), GainRange(0.0, 2.0))
    roots = DerivativeParametrization(1.0, TF).roots(controller)
    for value in (*ki, 0.0, *np.random.default_rng(1).uniform(*ki, 20)):
        if ki[0] <= value <= ki[1]:
            own = [root for root in roots if (value == 0.0) == (root[1] == (0.0, 0.0))]
            assert len(own) == 1
            assert own[0][1][0] <= value <= own[0][1][1]
            assert (own[0][0], own[0][2]) == ((-1.0, 4.0), (0.0, 2.0))


def is_sound(found: Optimum, spec: DesignSpec) -> bool:
    return recheck_optimum(json.loads(json.dumps(to_document(found, {}))), spec).is_sound


def test_the_integral_gain_of_a_triple_lag_is_bounded_and_no_gains_of_a_scan_beat_it() -> None:
    spec = ft.parse_spec(CUBE % (4.0824, 26.0))
    gains = ft.tune(spec, proof=False).gains
    found = certify_optimum(spec, gains)
    assert found.status is OptimumStatus.CERTIFIED
    assert found.bound is not None
    assert found.objective == pytest.approx(1.15866, rel=1e-5)
    assert is_sound(found, spec)
    pick = np.random.default_rng(3)
    assert gains is not None
    kp, ki, kd = pick.uniform((1.4, 1.1, 0.7), (1.9, 1.3, 0.99), size=(8_000, 3)).T
    s = 1j * np.concatenate([np.geomspace(0.2, 5.0, 120), [20.0, 80.0, 4000.0]])[:, None]
    c = kp + ki / s + kd * s / (0.05 * s + 1.0)
    peak = np.abs(1.0 / (1.0 + c / (s + 1.0) ** 3)).max(axis=0)
    noise = np.abs(c / (1.0 + c / (s + 1.0) ** 3)).max(axis=0)
    met = (peak <= 10.0 ** (4.0824 / 20.0)) & (noise <= 10.0 ** (26.0 / 20.0))
    assert met.any()
    # the scan's grid of frequencies lets a little more pass than the limits do
    assert 0.97 * found.bound < ki[met].max() <= found.bound * 1.001


def test_a_pid_that_is_worse_is_never_certified() -> None:
    spec = ft.parse_spec(CUBE % (4.0824, 26.0))
    best = ft.tune(spec, proof=False).gains
    assert isinstance(best, Pid)
    worse = replace(best, ki=0.985 * best.ki)
    found = certify_optimum(spec, worse, most_boxes=800)
    assert found.status is OptimumStatus.LIMIT_REACHED
    assert found.gap is None or found.gap > 0.01
    assert is_sound(found, spec)


def test_better_gains_of_a_pid_are_told_with_their_derivative() -> None:
    spec = ft.parse_spec(CUBE % (4.0824, 26.0))
    design = ft.tune(spec, proof=False)
    assert isinstance(design.gains, Pid)
    worse = replace(design.gains, ki=0.9 * design.gains.ki)
    found = replace(certify_optimum(spec, worse, most_boxes=1500), better=design.gains, bound=1.2, gap=0.1)
    told = " ".join(line for line, _ in optimum_lines(found)).split()
    assert "kd" in told
    assert "alpha" not in told


def test_a_pid_that_cannot_be_is_proved_infeasible() -> None:
    spec = ft.parse_spec(CUBE % (1.0, 2.0))
    spec = replace(
        spec, requirements=(*spec.requirements, replace(spec.requirements[0], limits=(-20.0,), to_rad_s=0.2))
    )
    found = certify_optimum(spec, None)
    assert found.status is OptimumStatus.INFEASIBLE
    assert is_sound(found, spec)
    other = replace(spec, controller=replace(spec.controller, kd=GainRange(0.0, 21.0)))
    document = json.loads(json.dumps(to_document(found, {})))
    assert not recheck_optimum(document | {"spec_sha256": other.sha256}, other).is_sound


def test_an_open_range_of_kd_is_told() -> None:
    spec = ft.parse_spec((CUBE % (4.0, 26.0)).replace("kd: {min: 0, max: 20}", "kd: {min: 0}"))
    found = certify_optimum(spec, Pid(1.0, 0.5, 0.5, 0.05))
    assert found.status is OptimumStatus.NO_BOUND
    assert found.reason.startswith("kd has no upper end")


@pytest.mark.long
@pytest.mark.parametrize("seed", range(24))
def test_bounds_of_random_pids_are_sound_and_never_below_what_is_known(seed: int) -> None:
    text = "\n".join(line for line in pid_spec(seed).splitlines() if not line.startswith("digital:"))
    spec = ft.parse_spec(text + "\n")
    design = ft.tune(spec, proof=False)
    solved = design.status is ft.Status.SOLVED
    found = certify_optimum(spec, design.gains if solved else None, most_boxes=20_000)
    assert found.status in (OptimumStatus.CERTIFIED, OptimumStatus.LIMIT_REACHED, OptimumStatus.INFEASIBLE)
    assert (found.status is OptimumStatus.INFEASIBLE) <= (not solved)
    assert is_sound(found, spec)
