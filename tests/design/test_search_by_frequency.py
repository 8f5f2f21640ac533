"""Designs with limits by the frequency:  met by dense scans, touched, priced, bracketed, bounded, on samples too."""

from __future__ import annotations

import math

import numpy as np
import pytest
from cases.thinned import thinned

import fopi_tune as ft
from fopi_tune.core.loops import Loops, Plants
from fopi_tune.core.stability import is_stable
from fopi_tune.optimum import OptimumStatus, certify_optimum
from fopi_tune.results.design import Design
from fopi_tune.results.status import Status
from fopi_tune.spec.model import DesignSpec

LAG = "{model: lag, static_gain: 1, time_constant_s: {min: 1.6, max: 3.1}, dead_time_s: 0.3}"
FOPI = "{kp: {min: 0, max: 20}, ki: {min: 0, max: 20}, alpha: {min: 0.5, max: 1.5}}"
SHAPE = ((0.01, -35.0), (0.1, -15.0), (0.5, 3.0), (30.0, 3.0))
EFFORT = "objective: {minimize: control_sensitivity_peak_db}\n"
DIGITAL = "digital: {sample_time_s: 0.1, band_rad_s: [0.001, 1000], design: sampled}\n"


def spec_of(shape: tuple[tuple[float, float], ...] = SHAPE, more: str = EFFORT, controller: str = FOPI) -> DesignSpec:
    points = ", ".join(f"[{omega}, {limit}]" for omega, limit in shape)
    return ft.parse_spec(
        f"schema: 1\nname: x\nplant: {LAG}\ncontroller: {controller}\n"
        f"requirements:\n  - sensitivity_db: {{at_most: {{by_frequency: [{points}]}}}}\n{more}"
    )


def excess(gains: ft.FoPi, shape: tuple[tuple[float, float], ...]) -> float:
    """The largest |S| above the limit, dB, over a dense grid of plants and frequencies."""
    omega = np.unique(np.concatenate([np.geomspace(shape[0][0], shape[-1][0], 6000), [at for at, _ in shape]]))
    limit = np.interp(np.log(omega), np.log([at for at, _ in shape]), [level for _, level in shape])
    s, found = 1j * omega, -math.inf
    for tau in np.linspace(1.6, 3.1, 31):
        loop = (gains.kp + gains.ki * s**-gains.alpha) * np.exp(-0.3 * s) / (tau * s + 1.0)
        found = max(found, float((-20.0 * np.log10(np.abs(1.0 + loop)) - limit).max()))
    return found


def solved(design: Design) -> tuple[ft.FoPi, float]:
    assert design.status is Status.SOLVED, design.message
    assert design.gains is not None
    assert design.objective is not None
    assert all(report.proof is not None and report.proof.verdict == "proved" for report in design.requirements)
    return design.gains, design.objective


def test_the_gains_meet_the_whole_shape_and_touch_it() -> None:
    design = ft.tune(spec_of())
    gains, _ = solved(design)
    # nothing beyond the limit but rounding, and the effort is least where a line is touched
    assert -1e-4 < excess(gains, SHAPE) < 1e-5
    assert design.gap == 0.001


def test_no_gains_of_a_grid_that_meet_the_shape_need_less_effort() -> None:
    _, best = solved(ft.tune(spec_of()))
    omega = np.geomspace(1e-3, 1e3, 400)
    inside = (omega >= SHAPE[0][0]) & (omega <= SHAPE[-1][0])
    limit = np.interp(np.log(omega[inside]), np.log([at for at, _ in SHAPE]), [level for _, level in SHAPE])
    plants = Plants(np.ones((3, 1)), np.array([[1.6, 1.0], [2.3, 1.0], [3.1, 1.0]]), np.full(3, 0.3))
    p = np.exp(-0.3j * omega) / (1j * omega * plants.denominator[:, :1] + 1.0)
    found = []
    for alpha in np.linspace(0.5, 1.5, 11):
        for kp in np.linspace(0.1, 2.5, 40):
            c = kp + np.geomspace(0.1, 2.0, 40)[:, None] * (1j * omega) ** -alpha
            apart = np.abs(1.0 + c[:, None, :] * p)
            meets = (-20.0 * np.log10(apart[:, :, inside]) <= limit).all(axis=(1, 2))
            effort = 20.0 * np.log10((np.abs(c)[:, None, :] / apart).max(axis=(1, 2)))
            found += [
                (float(effort[k]), kp, float(np.geomspace(0.1, 2.0, 40)[k]), alpha) for k in np.flatnonzero(meets)
            ]
    ones = np.ones(3)
    least = next(
        value
        for value, kp, ki, alpha in sorted(found)
        if is_stable(Loops(kp * ones, ki * ones, alpha * ones, plants)).all()
    )
    # the grid of gains is a few per cent wide
    assert best - 0.05 < least < best + 1.5
    assert least > best - 0.01


@pytest.mark.parametrize("kind", thinned(["sampled", "pid", "depth"], 3))
def test_other_loops_and_objectives_are_designed_and_proved(kind: str) -> None:
    pid = "{structure: pid, kp: {min: 0, max: 20}, ki: {min: 0, max: 20}, kd: {min: 0, max: 20}, "
    pid += "derivative_filter_time_constant_s: 0.05}"
    spec = {
        "sampled": spec_of(more=EFFORT + DIGITAL),
        "pid": spec_of(controller=pid),
        "depth": spec_of(more="  - gain_margin_db: {at_least: 6}\n"),
    }[kind]
    gains, _ = solved(ft.tune(spec))
    if kind != "sampled":
        assert excess(gains, SHAPE) < 1e-5


def test_a_shape_that_no_gains_meet_is_infeasible_and_told() -> None:
    # |S| cannot be small up to 3 rad/s behind a dead time of 0.3 s with a peak of 1 dB
    design = ft.tune(spec_of(((0.01, -40.0), (3.0, -20.0), (10.0, 1.0))))
    assert design.status is Status.INFEASIBLE
    assert "sensitivity_db at_most" in design.message


def test_the_price_of_a_line_is_that_of_moving_it_as_a_whole() -> None:
    # of the lines from 0.01 and to 0.5 rad/s, which meet at 0.1 rad/s, the first alone is moved
    shapes = [((0.01, -35.0 + d), (0.1, -15.0 + d)) for d in (0.0, -0.05, 0.05)]
    designs = [ft.tune(spec_of(shape, "  - sensitivity_db: {at_most: 3}\n" + EFFORT)) for shape in shapes]
    objectives = [solved(design)[1] for design in designs]
    multiplier = designs[0].requirements[0].multiplier
    assert multiplier is not None
    assert multiplier == pytest.approx((objectives[1] - objectives[2]) / 0.1, rel=0.02)
    assert multiplier > 0.1


def test_no_gains_beat_the_proved_bound() -> None:
    spec = spec_of(
        ((0.01, -35.0), (0.1, -15.0)),
        "  - sensitivity_db: {at_most: 3}\n" + EFFORT,
        FOPI.replace("min: 0.5, max: 1.5", "min: 1, max: 1"),
    )
    gains, objective = solved(ft.tune(spec))
    found = certify_optimum(spec, gains, gap=0.02, time_limit_s=120.0)
    assert found.status is OptimumStatus.CERTIFIED
    assert found.bound is not None
    assert objective - 0.5 < found.bound <= objective + 1e-6
    # without the line less effort would do
    free = ft.tune(spec_of(((0.01, -5.0), (0.1, 0.0)), "  - sensitivity_db: {at_most: 3}\n" + EFFORT, FOPI))
    assert free.objective is not None
    assert free.objective < found.bound
