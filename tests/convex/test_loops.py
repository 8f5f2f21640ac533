"""The convex path on samples:  its loops are those of the digital controller, its optima those of the other search."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from cases.project import ROOT

import fopi_tune as ft
from fopi_tune.convex import convex_design
from fopi_tune.convex.cone_constraints import constraints_at
from fopi_tune.convex.evaluate import ConstraintPoints, evaluate
from fopi_tune.convex.limits import task_of
from fopi_tune.core.controller import FoPi
from fopi_tune.core.loops import Plants
from fopi_tune.core.sampled_loops import SampledLoops
from fopi_tune.design import design
from fopi_tune.digital.implementation import implementation_of, nominal_crossover
from fopi_tune.proof import verify
from fopi_tune.results.status import Status
from fopi_tune.spec.model import DesignSpec

#: relative; what both searches may differ by
AGREE = 2e-6
LAG = "{model: lag, static_gain: 1, time_constant_s: {min: 1.6, max: 3.1}, dead_time_s: {min: 0.2, max: 0.4}}"
GAINS = FoPi(1.1, 0.6, 0.9)
EVERYTHING = (
    "sensitivity_db: {at_most: 2}",
    "complementary_sensitivity_db: {at_most: 0.5}",
    "control_sensitivity_db: {at_most: 2}",
    "loop_gain_db: {at_most: -15}, from_rad_s: 4",
    "phase_margin_deg: {at_least: 80}",
    "gain_margin_db: {at_least: 15}",
    "delay_margin_s: {at_least: 2}",
    "crossover_rad_s: {at_least: 3}",
    "phase_slope_deg_per_decade: {at_least: 10}",
)


def spec_of(*requirements: str, objective: str = "maximize: ki", alpha: str = "0.9", **digital: str) -> DesignSpec:
    section = {"sample_time_s": "0.1", "delay_samples": "0.5", "design": "sampled", **digital}
    rows = "".join(f"  - {{{row}}}\n" for row in requirements)
    return ft.parse_spec(
        f"schema: 1\nname: x\nplant: {LAG}\ncontroller: {{alpha: {alpha}}}\nrequirements:\n{rows}"
        f"objective: {{{objective}}}\ndigital: {{{', '.join(f'{k}: {v}' for k, v in section.items())}}}\n"
    )


def value(spec: DesignSpec, gains: FoPi | None) -> float:
    """The objective of gains that meet the spec on samples."""
    assert gains is not None
    found = verify(spec, gains, implementation=implementation_of(spec, gains))
    assert found.all_met
    assert found.objective is not None
    return found.objective


@pytest.mark.thinned(3)
@pytest.mark.parametrize(
    ("method", "rule"),
    [
        *((method, {"rule": "matched"}) for method in ("oustaloup", "modified_oustaloup")),
        *((method, {"prewarp": "crossover"}) for method in ("oustaloup", "modified_oustaloup")),
        *((method, {}) for method in ("oustaloup", "modified_oustaloup", "fit")),
    ],
)
def test_its_loops_are_those_of_the_digital_controller(method: str, rule: dict[str, str]) -> None:
    spec = spec_of("sensitivity_db: {at_most: 4}", method=method, band_rad_s="[0.003, 30]", **rule)
    task = task_of(spec, nominal_crossover(spec, GAINS))
    plants = Plants.members(spec.plant, spec.plant.corners())
    own = task.kind.loops(GAINS, task.kind.plants(plants))
    theirs = SampledLoops.implemented(GAINS, implementation_of(spec, GAINS), plants)
    rows, u = np.arange(len(plants)).repeat(30), np.tile(np.linspace(-8.0, 4.0, 30), len(plants))
    found, slope = own.log_response_and_slope(rows, u)
    wanted, steep = theirs.log_response_and_slope(rows, u)
    np.testing.assert_allclose(found, wanted, rtol=1e-9)
    np.testing.assert_allclose(slope, steep, rtol=1e-6)


@pytest.mark.thinned(2)
@pytest.mark.parametrize("requirement", EVERYTHING)
def test_slopes_of_all_limits_are_those_of_small_steps(requirement: str) -> None:
    """The slack of each row changes with the gains as the row says."""
    spec = spec_of(requirement, objective="minimize: iae_disturbance")
    task = task_of(spec)
    plants = task.kind.plants(Plants.members(spec.plant, spec.plant.corners()))
    here = evaluate(task, GAINS, plants)
    # at its limit the slope of a cone's row is that of its slack
    limit, slack = task.limits[0], here.points.slack[here.points.limit == 0].min()
    moved = replace(limit, limit=limit.limit - limit.bound.value * float(slack) / limit.scale)
    task = replace(task, limits=(moved, *task.limits[1:]))
    here = evaluate(task, GAINS, plants)
    for chosen in (0, -1):
        mine = here.points.take(np.flatnonzero(here.points.limit == chosen))
        k = int(np.argmin(mine.slack))
        point = mine.take(np.array([k]))
        rows = constraints_at(task, here, plants, point)
        for axis in range(2):
            changes = []
            for step in (1e-5, -1e-5):
                x = task.scaled(GAINS)
                x[axis] += step
                there = evaluate(task, task.gains(x, GAINS.alpha), plants).points
                other = there.take(np.flatnonzero((there.limit == chosen) & (there.plant == point.plant[0])))
                changes.append(_nearest(other, float(point.u[0])))
            towards = (np.conj(rows.cone0[0]) * rows.cone[0]).real / max(abs(rows.cone0[0]), 1e-300)
            slope = float((rows.slope[0] - towards)[axis])
            assert (changes[0] - changes[1]) / 2e-5 == pytest.approx(slope, rel=2e-4, abs=1e-6)


def _nearest(points: ConstraintPoints, u: float) -> float:
    return float(points.slack[np.argmin(np.abs(points.u - u))])


@pytest.mark.parametrize(
    ("name", "alpha"),
    [
        ("pi_baseline", None),
        ("brake_delay", 1.4),
        *(pytest.param(name, None, marks=pytest.mark.long) for name in ("throttle", "brake", "brake_delay")),
        *(pytest.param(name, None, marks=pytest.mark.long) for name in ("second_order", "lag_gain_and_delay")),
    ],
)
def test_both_searches_agree_on_a_shipped_spec_on_samples(name: str, alpha: float | None) -> None:
    spec = ft.load_spec(ROOT / "specs" / f"{name}.yaml")
    if alpha is not None:
        order = replace(spec.controller.alpha, min=alpha, max=alpha)
        spec = replace(spec, controller=replace(spec.controller, alpha=order))
    found = convex_design(spec)
    assert found.status is Status.SOLVED
    assert value(spec, found.gains) == pytest.approx(value(spec, design(spec).gains), rel=AGREE)


@pytest.mark.long
@pytest.mark.parametrize(
    "digital",
    [{"rule": "matched"}, pytest.param({"prewarp": "crossover", "delay_samples": "1"}, marks=pytest.mark.long)],
    ids=" ".join,
)
def test_both_searches_agree_where_the_filter_depends_on_the_crossover(digital: dict[str, str]) -> None:
    rows = "sensitivity_db: {at_most: 3.5}", "delay_margin_s: {at_least: 0.5}", "crossover_rad_s: {at_most: 1.5}"
    spec = spec_of(*rows, objective="minimize: iae_disturbance", **digital)
    assert value(spec, convex_design(spec).gains) == pytest.approx(value(spec, design(spec).gains), rel=AGREE)


def test_a_fitted_filter_is_designed_for_a_fixed_order_only() -> None:
    rows = "sensitivity_db: {at_most: 3}", "complementary_sensitivity_db: {at_most: 1}"
    spec = spec_of(*rows, method="fit", band_rad_s="[0.003, 30]")
    found = convex_design(spec)
    assert found.status is Status.SOLVED
    best = value(spec, found.gains)
    assert found.gains is not None
    # nothing near them is better
    for step in ((1.01, 1.003), (1.0, 1.003), (0.99, 1.003)):
        gains = FoPi(found.gains.kp * step[0], found.gains.ki * step[1], 0.9)
        assert not verify(spec, gains, implementation=implementation_of(spec, gains)).all_met
    assert best == found.gains.ki
    free = spec_of(*rows, method="fit", band_rad_s="[0.003, 30]", alpha="{min: 0.5, max: 1.2}")
    refused = convex_design(free)
    assert refused.status is Status.FAILED
    assert "for a fixed alpha only" in refused.message
