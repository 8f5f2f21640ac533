"""Bounds of |P S|:  the least peak that any gains can have, and gains drawn at random that do not beat it."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest

import fopi_tune as ft
from fopi_tune.core.loops import Loops, Plants
from fopi_tune.core.peaks import Response, extremes
from fopi_tune.core.stability import is_stable
from fopi_tune.optimum import OptimumStatus, certify_optimum, to_document
from fopi_tune.pipeline.optimum import recheck_optimum
from fopi_tune.spec.load import parse_spec
from fopi_tune.spec.model import DesignSpec

PEAK, KI = "{minimize: load_sensitivity_peak_db}", "{maximize: ki}"
DB = 20.0 / math.log(10.0)


def spec_of(objective: str, asked: str, used: str = "") -> DesignSpec:
    return parse_spec(
        "schema: 1\nname: load\n"
        "plant: {model: lag, static_gain: {min: 0.8, max: 1.2}, time_constant_s: 1.5, dead_time_s: 0.3}\n"
        f"controller: {{structure: pi, kp: {{min: 0, max: 20}}, ki: {{min: 0, max: 20}}{used}}}\n"
        f"requirements: {asked}\nobjective: {objective}\n"
    )


def drawn(spec: DesignSpec, count: int = 4000) -> tuple[Loops, np.ndarray]:
    """Random gains with every corner plant, controller by controller, and the number of plants."""
    rng = np.random.default_rng(5)
    kp, ki = rng.uniform(0.0, 6.0, count), 10.0 ** rng.uniform(-2.0, 1.0, count)
    plants = Plants.members(spec.plant, spec.plant.corners())
    rows, m = np.repeat(np.arange(count), len(plants)), len(plants)
    loops = Loops(
        kp[rows], ki[rows], np.ones(len(rows)), plants.take(np.tile(np.arange(m), count)),
        measurement_filter=spec.controller.measurement_filter,
    )  # fmt: skip
    return loops, ki


def largest(loops: Loops, response: Response, count: int) -> np.ndarray:
    """The largest value of each controller over its plants, dB."""
    return np.asarray(DB * extremes(loops, response, 0.0, math.inf).value.reshape(count, -1).max(axis=1))


@pytest.mark.thinned(3)
@pytest.mark.parametrize("used", ["", ", measurement_filter: {order: 2, time_constant_s: 0.2}"])
@pytest.mark.parametrize("objective", [PEAK, KI])
def test_no_gains_beat_the_bound(objective: str, used: str) -> None:
    asked = "[{sensitivity_db: {at_most: 5}}, {load_sensitivity_db: {at_most: -6}}]"
    spec = spec_of(objective, asked, used)
    design = ft.tune(spec, proof=False)
    found = certify_optimum(spec, design.gains, gap=0.02, time_limit_s=120.0)
    assert found.status is OptimumStatus.CERTIFIED
    assert found.bound is not None
    loops, ki = drawn(spec)
    count = len(ki)
    meets = (largest(loops, Response.SENSITIVITY, count) <= 5.0) & is_stable(loops).reshape(count, -1).all(axis=1)
    peak = largest(loops, Response.LOAD_SENSITIVITY, count)
    meets &= peak <= -6.0
    assert meets.sum() > 5
    assert (ki[meets].max() <= found.bound) if objective == KI else (peak[meets].min() >= found.bound)


def test_the_file_of_a_bound_is_sound_and_is_not_that_of_a_smaller_limit() -> None:
    asked = "[{sensitivity_db: {at_most: 5}}, {load_sensitivity_db: {at_most: -6}}]"
    spec = spec_of(KI, asked)
    found = certify_optimum(spec, ft.tune(spec, proof=False).gains, gap=0.02, time_limit_s=60.0)
    document = json.loads(json.dumps(to_document(found, {})))
    assert recheck_optimum(document, spec).problems == ()
    assert recheck_optimum(document, spec_of(KI, asked.replace("-6", "-5"))).problems != ()


def test_a_limit_that_no_gains_meet_is_proved_to_be_infeasible() -> None:
    spec = spec_of(KI, "[{sensitivity_db: {at_most: 5}}, {load_sensitivity_db: {at_most: -14}}]")
    found = certify_optimum(spec, None, time_limit_s=120.0)
    assert found.status is OptimumStatus.INFEASIBLE
