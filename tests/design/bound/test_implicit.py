"""What is read at crossings of a box of gains, beside the crossings of many of its loops."""

from __future__ import annotations

import math

import numpy as np
import pytest

import fopi_tune as ft
from fopi_tune.design.bound.implicit import (
    AT,
    BY_KAPPA,
    BY_PSI,
    BY_SHAPE,
    DV_ERROR,
    DV_KAPPA,
    DV_PSI,
    DV_SHAPE,
    ERROR,
    REACH,
    SIZE,
    VALUE,
    implicit,
)
from fopi_tune.design.bound.integrals import filters_over
from fopi_tune.design.global_search.controllers import controller_of
from fopi_tune.design.global_search.problem import Problem
from fopi_tune.design.global_search.responses import crossing_near, loop_at

TEXT = (
    "schema: 1\nname: x\nplant: {model: lag, static_gain: 2, time_constant_s: 4, dead_time_s: 0.9}\n"
    "requirements: [{sensitivity_db: {at_most: 4.1}}]\n"
)
DIGITAL = "digital: {sample_time_s: 0.4, design: sampled, delay_samples: 0.5, %s}\n"
PID = TEXT + "controller: {structure: pid, kp: {min: 0, max: 9}, ki: {min: 0, max: 9}, kd: {min: 0, max: 9}, "
PID += "derivative_filter_time_constant_s: 0.3}\n"
LOOPS = {
    "pid": PID,
    "pid on samples": PID + DIGITAL % "poles: 7",
    "continuous": TEXT,
    "oustaloup": TEXT + DIGITAL % "poles: 7",
    "modified": TEXT + DIGITAL % "poles: 5, method: modified_oustaloup",
}


@pytest.mark.thinned(5)
@pytest.mark.parametrize("of_gain", [True, False])
@pytest.mark.parametrize("name", LOOPS)
def test_crossings_of_a_box_are_where_they_are_said_to_be(name: str, of_gain: bool) -> None:
    table = Problem.of(ft.parse_spec(LOOPS[name])).scan_table
    sampling, plant, draws, out = table.sampling, table.members[0], np.random.default_rng(8), np.empty(SIZE)
    signs, found, with_derivative = np.ones(3), 0, sampling.derivative > 0.0
    for _ in range(40):
        kappa, shape, psi = draws.uniform(-1.5, 0.5), draws.uniform(0.5, 1.4), draws.uniform(0.2, 1.3)
        half = 10.0 ** draws.uniform(-3.0, -1.0) * np.array([1.0, draws.choice([0.0, 0.5]), 0.5])

        def loop(dz, kappa=kappa, shape=shape, psi=psi, half=half):
            k, a, p = (kappa, shape, psi) + half * dz
            c, s = math.exp(k) * math.cos(p), math.exp(k) * math.sin(p)
            gains = [c * math.cos(a), s, c * math.sin(a)] if with_derivative else [c, s, a]
            return controller_of(np.array(gains), sampling)

        x = loop(np.zeros(3))
        # every loop here passes -180 deg for the first time within two decades of omega_s
        target = 0.0 if of_gain else -math.pi
        v = crossing_near(0 if of_gain else 1, target, x, plant, 0.5, -2.0)
        gain, phase, _ = loop_at(x, plant, v, -2.0)
        if abs((gain if of_gain else phase) - target) > 1e-9:
            continue
        filters = filters_over(*((1.0, 0.0) if with_derivative else (shape, half[1])), sampling)
        limits = table.v[1], table.v[-2]
        if not implicit(of_gain, x, signs, plant, half, v, -2.0, math.pi, *limits, filters, out):
            continue
        found += 1
        for dz in [*draws.uniform(-1.0, 1.0, (6, 3)), np.ones(3), -np.ones(3)]:
            other = loop(dz)
            at = crossing_near(0 if of_gain else 1, target, other, plant, v, -2.0)
            gain, phase, _ = loop_at(other, plant, at, -2.0)
            value = phase + math.pi if of_gain else gain
            told = out[VALUE] + out[[BY_KAPPA, BY_SHAPE, BY_PSI]] @ dz
            assert abs(value - told) <= out[ERROR] + 1e-8
            moved = out[AT] + out[[DV_KAPPA, DV_SHAPE, DV_PSI]] @ dz
            assert abs(at - moved) <= out[DV_ERROR] + 1e-8
            assert abs(at - v) <= out[REACH]
    assert found >= 10
