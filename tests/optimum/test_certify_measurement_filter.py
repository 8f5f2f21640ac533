"""Bounds of objectives with a measurement filter: against plants that hold it, and against gains drawn at random."""

from __future__ import annotations

import json
import math
from dataclasses import replace

import numpy as np
import pytest

import fopi_tune as ft
from fopi_tune.core.controller import derivative_of
from fopi_tune.core.loops import Loops, Plants
from fopi_tune.core.peaks import Response, extremes
from fopi_tune.core.stability import is_stable
from fopi_tune.core.terms.derivatives import Derivatives
from fopi_tune.core.terms.measurement_filter import MeasurementFilter
from fopi_tune.optimum import OptimumStatus, certify_optimum, to_document
from fopi_tune.pipeline.optimum import recheck_optimum
from fopi_tune.spec.load import parse_spec
from fopi_tune.spec.model import DesignSpec

TIME_S = 0.4
#: of 1.5 s + 1, and of that times 1 + sT and 1 + sT + s^2 T^2/2
BARE = np.array([1.5, 1.0])
HELD = {1: np.polymul(BARE, [TIME_S, 1.0]), 2: np.polymul(BARE, [TIME_S**2 / 2, TIME_S, 1.0])}
STRUCTURES = {
    "pi": "kp: {min: 0, max: 20}, ki: {min: 0, max: 20}",
    "fopi": "kp: {min: 0, max: 20}, ki: {min: 0, max: 20}, alpha: {min: 0.6, max: 1.2}",
    "pid": "kp: {min: 0, max: 20}, ki: {min: 0, max: 20}, kd: {min: 0, max: 5}, derivative_filter_time_constant_s: 0.1",
}


def spec_of(
    structure: str, order: int | None, objective: str, asked: str, denominator: np.ndarray = BARE
) -> DesignSpec:
    used = "" if order is None else f", measurement_filter: {{order: {order}, time_constant_s: {TIME_S}}}"
    coefficients = ", ".join(repr(float(number)) for number in denominator)
    return parse_spec(
        "schema: 1\nname: filtered\n"
        f"plant: {{model: transfer_function, numerator: [{{min: 0.8, max: 1.2}}], denominator: [{coefficients}], "
        "dead_time_s: 0.3}\n"
        f"controller: {{structure: {structure}, {STRUCTURES[structure]}{used}}}\n"
        f"requirements: {asked}\nobjective: {objective}\n"
    )


@pytest.mark.parametrize(
    ("structure", "order"),
    [("pi", 2), *(pytest.param(*p, marks=pytest.mark.long) for p in (("pi", 1), ("fopi", 1), ("fopi", 2), ("pid", 1)))],
)
def test_the_bound_is_that_of_a_plant_that_holds_the_filter(structure: str, order: int) -> None:
    asked = "[{sensitivity_db: {at_most: 4}}, {phase_margin_deg: {at_least: 40}}]"
    bounds = []
    for spec in (
        spec_of(structure, order, "{maximize: ki}", asked),
        spec_of(structure, None, "{maximize: ki}", asked, HELD[order]),
    ):
        design = ft.tune(spec, proof=False)
        found = certify_optimum(spec, design.gains, gap=0.01, time_limit_s=120.0)
        assert found.status is OptimumStatus.CERTIFIED
        assert found.bound is not None
        assert found.objective is not None
        bounds.append((found.objective, found.bound))
    (one, above_one), (two, above_two) = bounds
    assert one == pytest.approx(two, rel=1e-4)
    assert above_one >= two * (1.0 - 1e-6)
    assert above_two >= one * (1.0 - 1e-6)


def _feasible(spec: DesignSpec, gains: list[ft.FoPi], response: Response, limit_db: float) -> np.ndarray:
    """Which controllers keep a response of every corner plant below a limit, and their loops stable."""
    plants = Plants.members(spec.plant, spec.plant.corners())
    n, m = len(gains), len(plants)
    rows = np.repeat(np.arange(n), m)
    kp, ki, alpha = (np.array([getattr(each, name) for each in gains])[rows] for name in ("kp", "ki", "alpha"))
    kd, mu, filter_s = np.array([derivative_of(each) for each in gains])[rows].T
    derivatives = Derivatives(kd, mu, filter_s) if kd.any() else None
    loops = Loops(
        kp, ki, alpha, plants.take(np.tile(np.arange(m), n)), derivatives=derivatives,
        measurement_filter=gains[0].measurement_filter,
    )  # fmt: skip
    peak = extremes(loops, response, 0.0, math.inf).value * 20.0 / math.log(10.0)
    return np.asarray(((peak <= limit_db) & is_stable(loops)).reshape(n, m).all(axis=1))


@pytest.mark.thinned(2)
@pytest.mark.parametrize(("structure", "order"), [("pi", 1), ("pi", 2), ("fopi", 2), ("pid", 2)])
def test_no_gains_beat_the_bound_where_the_noise_gain_is_limited(structure: str, order: int) -> None:
    spec = spec_of(structure, order, "{maximize: ki}", "[{control_sensitivity_db: {at_most: 6}}]")
    design = ft.tune(spec, proof=False)
    assert design.gains is not None
    found = certify_optimum(spec, design.gains, gap=0.02, time_limit_s=60.0)
    assert found.status is OptimumStatus.CERTIFIED
    assert found.bound is not None
    pick, box, best = np.random.default_rng(4), spec.controller, design.gains
    drawn = []
    for _ in range(1500):
        kp, ki = best.kp * pick.uniform(0.5, 1.6), best.ki * pick.uniform(0.9, 1.3)
        alpha = best.alpha if box.alpha.is_fixed else float(np.clip(best.alpha + pick.normal() * 0.1, 0.6, 1.2))
        kd = derivative_of(best).kd * pick.uniform(0.5, 1.6)
        drawn.append(box.controller(kp, ki, alpha, kd))
    met = _feasible(spec, [*drawn, best], Response.CONTROL_SENSITIVITY, 6.0 + 1e-5)
    assert met[-1], "the design meets it"
    assert met[:-1].any()
    assert not any(each.ki > found.bound for each, good in zip(drawn, met, strict=False) if good)


@pytest.mark.parametrize("order", [1, 2])
def test_the_bound_of_the_discounted_error_has_no_filter_in_it(order: int) -> None:
    spec = spec_of("pi", order, "{minimize: iae_disturbance, horizon_s: 2.0}", "[{sensitivity_db: {at_most: 4}}]")
    design = ft.tune(spec, proof=False)
    found = certify_optimum(spec, design.gains, gap=0.01, time_limit_s=60.0)
    assert found.status is OptimumStatus.CERTIFIED
    held = spec_of(
        "pi", None, "{minimize: iae_disturbance, horizon_s: 2.0}", "[{sensitivity_db: {at_most: 4}}]", HELD[order]
    )
    other = certify_optimum(held, ft.tune(held, proof=False).gains, gap=0.01, time_limit_s=60.0)
    at = float(MeasurementFilter(order, TIME_S)(complex(0.5)).real)
    assert found.bound is not None
    assert other.bound is not None
    # both bounds lie within a percent of their optima, whose ratio is F(1/T)
    assert found.bound * at == pytest.approx(other.bound, rel=0.012)


def test_the_smallest_noise_gain_has_a_bound_with_the_filter_in_it() -> None:
    asked = "[{crossover_rad_s: {at_least: 0.4}}, {sensitivity_db: {at_most: 5}}]"
    spec = spec_of("pi", 2, "{minimize: control_sensitivity_peak_db}", asked)
    design = ft.tune(spec, proof=False)
    found = certify_optimum(spec, design.gains, gap=0.02, time_limit_s=60.0)
    assert found.status is OptimumStatus.CERTIFIED
    assert found.bound is not None
    assert found.objective is not None
    assert found.bound <= found.objective


def test_the_file_of_a_bound_is_sound_and_is_not_that_of_another_filter() -> None:
    asked = "[{control_sensitivity_db: {at_most: 6}}]"
    spec = spec_of("pi", 2, "{maximize: ki}", asked)
    found = certify_optimum(spec, ft.tune(spec, proof=False).gains, gap=0.02, time_limit_s=60.0)
    document = json.loads(json.dumps(to_document(found, {})))
    assert recheck_optimum(document, spec).problems == ()
    for used in (None, MeasurementFilter(2, 0.5), MeasurementFilter(1, TIME_S)):
        other = replace(spec, controller=replace(spec.controller, measurement_filter=used))
        assert recheck_optimum(document, other).problems != ()
