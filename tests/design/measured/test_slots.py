"""A slot's plant in the solver's symbols, against the curve that it is a piece of."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from cases.measured import RESONANCE, curve, measured_spec

from fopi_tune.core.measured.curve import Curve
from fopi_tune.design.global_search.compiled import DELAY, LAG
from fopi_tune.design.global_search.nonlinear.program import MEASURED_PARAMETERS, measured_plant
from fopi_tune.design.measured.problem import problem_of
from fopi_tune.design.measured.slots import plant_at

FILTERED = "{kp: {min: 0, max: 5}, ki: {min: 0, max: 5}, measurement_filter: {order: 1, time_constant_s: 0.1}}"


@pytest.mark.parametrize("v", [-6.9, -0.3, 0.01, 1.0, 6.9])
def test_a_slots_plant_is_the_curve_about_its_frequency(v: float) -> None:
    asked = "[{phase_margin_deg: {at_least: 30}}]"
    problem = problem_of(measured_spec(RESONANCE, asked, "{maximize: ki}", FILTERED))
    plain = curve(RESONANCE)
    known = Curve(plain.omega_rad_s, plain.log_gain, plain.phase_rad, 0.07)
    scale = problem.scale
    v = float(np.clip(v, *(np.array(known.u[[0, -1]]) - np.log(scale.omega_rad_s))))
    parameters = plant_at(known, v, scale)
    p, at = ca.SX.sym("p", MEASURED_PARAMETERS), ca.SX.sym("v")
    top, bottom, log_plant = measured_plant(p, at)
    function = ca.Function("plant", [p, at], [ca.vertcat(*top), ca.vertcat(*bottom), log_plant])
    assert parameters[DELAY] == pytest.approx(0.07 * scale.omega_rad_s)
    assert parameters[LAG] == pytest.approx(0.1 * scale.omega_rad_s)
    # within the pieces that are the curve's own
    for near in v + np.array([-0.01, 0.0, 0.01]):
        u = near + np.log(scale.omega_rad_s)
        if not known.u[0] <= u <= known.u[-1]:
            continue
        above, below, size = (np.array(each).ravel() for each in function(parameters, near))
        s = 1j * np.exp(u)
        expected = np.exp(known.log_at(np.array([u]))[0] + s * 0.07) / (1.0 + 0.1 * s) / scale.gain
        found = np.exp(size[0]) * (above[0] + 1j * above[1]) / (below[0] + 1j * below[1])
        assert found == pytest.approx(expected, rel=1e-9)
