"""Designs for |P S|:  a limit and the objective, against scans of the gains and of the frequencies."""

from __future__ import annotations

import math

import numpy as np
import pytest
from cases.thinned import thinned

import fopi_tune as ft
from fopi_tune.core.loops import Loops, Plants
from fopi_tune.core.stability import is_stable
from fopi_tune.results.status import Status
from fopi_tune.spec.model import DesignSpec

LAG = "{model: lag, static_gain: 1, time_constant_s: {min: 1.6, max: 3.1}, dead_time_s: 0.3}"
RESONANT = (
    "{model: transfer_function, numerator: [2], denominator: [1, {min: 0.9, max: 1.5}, {min: 0.8, max: 1.2}], "
    "dead_time_s: 0.1}"
)
PLANTS = {"lag": LAG, "resonant": RESONANT, "integrator": "{model: pole, gain: 2, pole_rad_s: 0, dead_time_s: 0.4}"}
FOPI = "{kp: {min: 0, max: 20}, ki: {min: 0, max: 20}, alpha: {min: 0.5, max: 1.5}%s}"
DIGITAL = "digital: {sample_time_s: 0.1, band_rad_s: [0.001, 1000], design: sampled}\n"
OBJECTIVE = "objective: {minimize: load_sensitivity_peak_db}\n"


def spec_of(plant: str, requirements: str, more: str = "", controller: str = FOPI % "") -> DesignSpec:
    return ft.parse_spec(
        f"schema: 1\nname: x\nplant: {plant}\ncontroller: {controller}\nrequirements: [{requirements}]\n{more}"
    )


def scanned(spec: DesignSpec, most_db: float) -> float:
    """The smallest peak of |P S| in dB over a grid of gains with |S| below a limit, at the corners of the box."""
    omega = np.geomspace(1e-3, 1e3, 500)
    plants = Plants.members(spec.plant, spec.plant.corners())
    rows = np.repeat(np.arange(len(plants)), len(omega))
    p = plants.response(rows, np.tile(omega, len(plants))).reshape(len(plants), -1)
    p = p * np.exp(-1j * omega * plants.dead_time_s[:, None])
    found = []
    for alpha in (0.5, 0.75, 1.0, 1.25, 1.5):
        for kp in np.linspace(0.05, 4.0, 50):
            c = kp + np.concatenate([[0.0], np.geomspace(0.01, 5.0, 30)])[:, None] * (1j * omega) ** -alpha
            apart = np.abs(1.0 + c[:, None, :] * p)
            meets = 20.0 * np.log10((1.0 / apart).max(axis=(1, 2))) <= most_db
            peak = 20.0 * np.log10((np.abs(p) / apart).max(axis=(1, 2)))
            found += [
                (float(peak[k]), kp, 0.0 if k == 0 else float(np.geomspace(0.01, 5.0, 30)[k - 1]), alpha)
                for k in np.flatnonzero(meets)
            ]
    for value, kp, ki, alpha in sorted(found):
        ones = np.ones(len(plants))
        if is_stable(Loops(kp * ones, ki * ones, alpha * ones, plants)).all():
            return value
    return math.inf


@pytest.mark.parametrize("name", thinned(PLANTS, 3))
def test_no_gains_of_a_grid_have_a_smaller_peak(name: str) -> None:
    spec = spec_of(PLANTS[name], "{sensitivity_db: {at_most: 5}}", OBJECTIVE)
    design = ft.tune(spec)
    best = scanned(spec, 5.0)
    assert design.status is Status.SOLVED
    assert design.objective is not None
    # the grid of gains is a few per cent wide
    assert best - 0.7 < design.objective < best + 0.01
    assert design.gap == 0.001


@pytest.mark.parametrize(("limit", "status"), [(6.0, Status.SOLVED), (5.0, Status.INFEASIBLE)])
def test_a_limit_beyond_the_smallest_peak_is_met_and_one_short_of_it_is_infeasible(
    limit: float, status: Status
) -> None:
    # the smallest peak of a scan is 5.43 dB
    asked = f"{{sensitivity_db: {{at_most: 5}}}}, {{load_sensitivity_db: {{at_most: {limit}}}}}"
    design = ft.tune(spec_of(RESONANT, asked, "objective: {maximize: ki}\n"))
    assert design.status is status
    if status is Status.SOLVED:
        (report,) = [r for r in design.requirements if r.requirement.quantity == "load_sensitivity_db"]
        assert report.result is not None
        assert report.result.achieved == pytest.approx(limit, abs=1e-4)


def test_slow_loads_are_limited_in_their_band_alone() -> None:
    asked = "{sensitivity_db: {at_most: 5}}, {load_sensitivity_db: {at_most: -20}, to_rad_s: 0.05}"
    design = ft.tune(spec_of(LAG, asked, "objective: {minimize: control_sensitivity_peak_db}\n"))
    assert design.status is Status.SOLVED
    assert design.gains is not None
    # |P S| at the end of the band, where it is largest, of the plants at the ends of the range
    s = 0.05j
    plants = [np.exp(-0.3 * s) / (tau * s + 1.0) for tau in (1.6, 3.1)]
    worst = max(20.0 * math.log10(abs(p / (1.0 + p * complex(design.gains(s))))) for p in plants)
    assert worst == pytest.approx(-20.0, abs=1e-3)


@pytest.mark.parametrize("order", [2, pytest.param(1, marks=pytest.mark.long)])
def test_a_measurement_filter_is_no_part_of_the_loads_way(order: int) -> None:
    used = f", measurement_filter: {{order: {order}, time_constant_s: 0.2}}"
    spec = spec_of(LAG, "{sensitivity_db: {at_most: 5}}", OBJECTIVE, FOPI % used)
    design = ft.tune(spec)
    assert design.status is Status.SOLVED
    assert design.gains is not None
    omega = np.geomspace(1e-4, 1e3, 4000)
    s = 1j * omega
    filtered = 1.0 + 0.2 * s + (0.02 * s**2 if order == 2 else 0.0)
    peaks = []
    for tau in np.linspace(1.6, 3.1, 16):
        p = np.exp(-0.3 * s) / (tau * s + 1.0)
        c = (design.gains.kp + design.gains.ki * s**-design.gains.alpha) / filtered
        peaks.append(20.0 * np.log10(np.abs(p / (1.0 + c * p)).max()))
    # a grid of frequencies stops 1e-6 short of a peak
    assert design.objective == pytest.approx(max(peaks), abs=1e-4)


@pytest.mark.parametrize("name", thinned(["lag", "resonant"]))
def test_designs_on_samples_are_solved_proved_and_close_to_those_of_the_continuous_loop(name: str) -> None:
    asked = "{sensitivity_db: {at_most: 5}}"
    continuous, sampled = (ft.tune(spec_of(PLANTS[name], asked, OBJECTIVE + more)) for more in ("", DIGITAL))
    assert continuous.status is sampled.status is Status.SOLVED
    assert continuous.objective is not None
    assert sampled.objective is not None
    # half a sample of delay costs a part of the gain
    assert continuous.objective < sampled.objective < continuous.objective + 2.5


def test_a_pid_and_the_convex_path_know_the_load() -> None:
    pid = "{structure: pid, kp: {min: 0, max: 20}, ki: {min: 0, max: 20}, kd: {min: 0, max: 20}, "
    pid += "derivative_filter_time_constant_s: 0.05}"
    asked = "{sensitivity_db: {at_most: 5}}, {control_sensitivity_db: {at_most: 25}}"
    own, with_derivative = (ft.tune(spec_of(RESONANT, asked, OBJECTIVE, each)) for each in (FOPI % "", pid))
    assert own.status is with_derivative.status is Status.SOLVED
    assert own.objective is not None
    assert with_derivative.objective is not None
    assert with_derivative.objective < own.objective - 1.0
    convex = ft.tune(spec_of(RESONANT, asked, OBJECTIVE), solver=ft.Solver.CONVEX)
    assert convex.status is Status.SOLVED
    assert convex.objective == pytest.approx(own.objective, abs=1e-3)


def test_the_price_of_a_limit_is_that_of_differences() -> None:
    asked = "{sensitivity_db: {at_most: 5}}, {load_sensitivity_db: {at_most: %r}}"
    found = [
        ft.tune(spec_of(RESONANT, asked % limit, "objective: {minimize: control_sensitivity_peak_db}\n"))
        for limit in (6.5, 6.45, 6.55)
    ]
    assert all(design.status is Status.SOLVED for design in found)
    (report,) = [r for r in found[0].requirements if r.requirement.quantity == "load_sensitivity_db"]
    low, high = found[1].objective, found[2].objective
    assert low is not None
    assert high is not None
    assert report.multiplier is not None
    # the objective bends over 0.1 dB
    assert report.multiplier == pytest.approx((low - high) / 0.1, rel=0.01)
    assert report.multiplier > 1.0
