"""Drawn plants' quantities with a measurement filter are those of the exact search."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from fopi_tune.core.controller import FoPi, Pid
from fopi_tune.core.loops import Plants
from fopi_tune.core.parallel_form import Implementation
from fopi_tune.core.sampled_loops import SampledLoops
from fopi_tune.core.terms.measurement_filter import MeasurementFilter
from fopi_tune.digital import sections_of
from fopi_tune.montecarlo.margins import MarginScan
from fopi_tune.quantities import QUANTITIES
from fopi_tune.spec.model import DigitalSpec, Relation, Requirement

UPPER = ("sensitivity_db", "complementary_sensitivity_db", "control_sensitivity_db", "load_sensitivity_db")
LOWER = ("phase_margin_deg", "gain_margin_db", "delay_margin_s", "crossover_rad_s")


@pytest.mark.parametrize("order", [1, 2])
@pytest.mark.parametrize("terms", [FoPi(0.9, 1.1, 0.8), Pid(1.0, 1.1, 0.1, 0.05)], ids=["fopi", "pid"])
def test_the_scan_of_drawn_plants_is_the_exact_search(terms: FoPi, order: int) -> None:
    rng = np.random.default_rng(3)
    tau, late = rng.uniform(0.8, 1.5, 12), rng.uniform(0.0, 0.3, 12)
    plants = Plants(np.ones((12, 1)), np.column_stack([tau, np.ones(12)]), late)
    controller = replace(terms, measurement_filter=MeasurementFilter(order, 0.11))
    implementation = Implementation(sections_of(controller, DigitalSpec(0.05)), 0.5)
    loops = SampledLoops.implemented(controller, implementation, plants)
    bare = SampledLoops.implemented(terms, implementation, plants)
    scan = MarginScan(loops)
    for name in (*UPPER, *LOWER):
        upper = name in UPPER
        asked = Requirement(name, Relation.AT_MOST if upper else Relation.AT_LEAST, (1.0,))
        wanted = QUANTITIES[name].measure(loops, upper, 0.0, np.inf).value
        np.testing.assert_allclose(scan.measure(asked, upper), wanted, rtol=1e-7, atol=1e-7)
        if name in UPPER:
            line = Requirement(name, Relation.AT_MOST, (1.0,), from_rad_s=0.3, to_rad_s=9.0, end_limit=-14.0)
            wanted_line = QUANTITIES[name].measure(loops, True, 0.3, 9.0, line.tilt).value
            np.testing.assert_allclose(scan.measure(line, True), wanted_line, rtol=1e-7, atol=1e-7)
        # |T| is largest as omega -> 0, where the filter passes all
        assert (
            name == "complementary_sensitivity_db"
            or np.abs(wanted - QUANTITIES[name].measure(bare, upper, 0.0, np.inf).value).max() > 1e-6
        )
