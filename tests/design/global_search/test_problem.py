"""Tables are shared by specs of the same loop alone."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest

import fopi_tune as ft
from fopi_tune.design.global_search.problem import Problem
from fopi_tune.spec.model import DesignSpec

PLANT = "{model: transfer_function, numerator: [1], denominator: [1, 2, 1], dead_time_s: 0.2}"
OTHER_PLANT = PLANT.replace("0.2", "{min: 0.1, max: 0.2}")
GAINS = "kp: {min: 0, max: 20}, ki: {min: 0, max: 20}"
WITH_KD = f"{GAINS}, kd: {{min: 0, max: 20}}, derivative_filter_time_constant_s: 0.1"
CONTROLLERS = {
    "pi": f"structure: pi, {GAINS}",
    "fopi": f"{GAINS}, alpha: {{min: 0.5, max: 1.5}}",
    "pid": f"structure: pid, {WITH_KD}",
    "pid of another filter": f"structure: pid, {WITH_KD}".replace("0.1", "0.2"),
    "fopid": f"structure: fopid, {WITH_KD}, alpha: {{min: 0.5, max: 1.5}}, mu: {{min: 0.5, max: 1}}",
}


def spec_of(controller: str, plant: str = PLANT, sampled: bool = True, most: float = 4.5) -> DesignSpec:
    digital = "digital: {sample_time_s: 0.05, design: sampled}\n" if sampled else ""
    return ft.parse_spec(
        f"schema: 1\nname: x\nplant: {plant}\ncontroller: {{{controller}}}\n"
        f"requirements: [{{sensitivity_db: {{at_most: {most}}}}}, {{control_sensitivity_db: {{at_most: 20}}}}]\n"
        f"objective: {{minimize: iae_disturbance}}\n{digital}"
    )


@pytest.mark.parametrize("sampled", [False, True])
def test_a_table_is_the_loops_own_whatever_was_asked_for_before(sampled: bool) -> None:
    specs = [spec_of(CONTROLLERS[name], sampled=sampled) for name in CONTROLLERS if name not in ("pi", "fopi")]
    first, last = ([Problem.of(spec).fine_table for spec in order] for order in (specs, specs[::-1]))
    for one, other in zip(first, last[::-1], strict=True):
        for a, b in zip(one.sampling, other.sampling, strict=True):
            assert np.array_equal(a, b)
    # in continuous time orders are no part of a table
    for one, other in combinations(first if sampled else first[:2], 2):
        assert any(not np.array_equal(a, b) for a, b in zip(one.sampling, other.sampling, strict=True))
    assert Problem.of(spec_of(CONTROLLERS["pid"], OTHER_PLANT, sampled)).fine_table is not first[0]


def test_specs_that_differ_in_a_limit_share_their_tables() -> None:
    problems = [Problem.of(spec_of(CONTROLLERS["fopi"], most=most)) for most in (4.5, 5.0)]
    assert problems[0].fine_table is problems[1].fine_table


def test_a_structure_is_designed_the_same_after_another_one() -> None:
    alone = ft.tune(spec_of(CONTROLLERS["pid of another filter"]), proof=False)
    ft.tune(spec_of(CONTROLLERS["pid"]), proof=False)
    assert ft.tune(spec_of(CONTROLLERS["pid of another filter"]), proof=False).gains == alone.gains
    fopid = ft.tune(spec_of(CONTROLLERS["fopid"]), proof=False)
    # found in a process of its own
    assert fopid.objective == pytest.approx(0.0954741, rel=1e-4)
