"""Closed-form gains and the scaling of specs."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fopi_tune.core.controller import FoPi
from fopi_tune.core.crossings import gain_crossovers
from fopi_tune.core.loops import Loops, Plants
from fopi_tune.core.margins import margins
from fopi_tune.core.plant import PlantFamily, Uncertain
from fopi_tune.design.constraints import scale_of
from fopi_tune.design.reasons import closed_form_gains
from fopi_tune.spec import parse_spec


def test_closed_form_gains_give_the_published_brake_case() -> None:
    # PAPER section 8: alpha = 0.55, 0.4 rad/s, 100 deg, tau = 2.35.
    omega = np.array([0.4])
    response = 1.0 / (1.0 + 2.35j * omega)
    (kp, ki) = closed_form_gains(response, omega, np.radians([100.0]), np.array([0.55]))[0]
    assert kp == pytest.approx(0.3976732, rel=1e-7)
    assert ki == pytest.approx(0.6527344, rel=1e-7)


@given(alpha=st.floats(0.05, 1.95), margin=st.floats(20, 140), omega=st.floats(0.01, 10))
@settings(max_examples=100, deadline=None)
def test_closed_form_gains_put_the_crossover_where_asked(alpha: float, margin: float, omega: float) -> None:
    numbers = (("static_gain", 1.0), ("time_constant_s", 2.0), ("dead_time_s", 0.1))
    family = PlantFamily("lag", {name: Uncertain.exactly(v) for name, v in numbers})
    plants = Plants.members(family, np.zeros((1, 0)))
    row, at = np.zeros(1, dtype=np.intp), np.array([omega])
    response = plants.response(row, at) * np.exp(-0.1j * at)
    kp, ki = closed_form_gains(response, at, np.radians([margin]), np.array([alpha]))[0]
    loops = Loops.of(FoPi(float(kp), float(ki), alpha), plants)
    crossings = gain_crossovers(loops)
    nearest = int(np.argmin(np.abs(np.log(crossings.omega_rad_s / omega))))
    assert crossings.omega_rad_s[nearest] == pytest.approx(omega, rel=1e-7)
    assert np.degrees(crossings.phase_margin_rad[nearest]) == pytest.approx(margin, abs=1e-5)


def test_scale_moves_with_the_plants_time() -> None:
    text = "schema: 1\nname: x\nplant: {model: lag, static_gain: 1, time_constant_s: %d}\nobjective: {maximize: ki}\n"
    seconds, hours = parse_spec(text % 2), parse_spec(text % 7200)
    assert scale_of(seconds).omega_rad_s == pytest.approx(3600 * scale_of(hours).omega_rad_s)
    gains = FoPi(1.0, 2.0, 0.7)
    assert scale_of(hours).controller(scale_of(hours).scaled(gains)).ki == pytest.approx(2.0)
    assert margins(gains, seconds.plant.member(np.zeros(0))).crossover_rad_s is not None
