"""The compiled NLP against `core/`: two derivations of the same loop."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fopi_tune.core.controller import FoPi
from fopi_tune.core.crossings import gain_crossovers
from fopi_tune.core.loops import Loops, Plants
from fopi_tune.core.margins import margins
from fopi_tune.core.peaks import Response, log_response_at
from fopi_tune.core.plant import PlantFamily, Uncertain
from fopi_tune.design.constraints import scale_of
from fopi_tune.design.nlp.compile import log_discounted_error
from fopi_tune.design.nlp.symbols import OUTPUTS, SymbolicLoop, loop_function
from fopi_tune.design.starts import closed_form_gains
from fopi_tune.quantities import QUANTITIES
from fopi_tune.spec import parse_spec
from fopi_tune.spec.model import DesignSpec

SPECS = {
    "lag": """
plant: {model: lag, static_gain: {min: 0.5, max: 2.0}, time_constant_s: {min: 1.6, max: 3.1},
  dead_time_s: {min: 0, max: 0.4}}
""",
    "pole": """
plant: {model: pole, gain: -4.39, pole_rad_s: {min: -0.2, max: 0.3}, dead_time_s: 0.1}
""",
    "transfer_function": """
plant: {model: transfer_function, numerator: [0.3, {min: -1, max: 2}], denominator: [1, {min: 0.1, max: 2}, 3, 1],
  dead_time_s: 0.05}
""",
}


def spec(model: str) -> DesignSpec:
    return parse_spec(
        "schema: 1\nname: x\n" + SPECS[model].strip() + "\nrequirements: [{sensitivity_db: {at_most: 6}}]\n"
    )


@pytest.mark.parametrize("model", SPECS)
@given(
    kp=st.floats(-3, 3).filter(lambda x: abs(x) > 1e-3),
    ki=st.floats(-3, 3).filter(lambda x: abs(x) > 1e-3),
    alpha=st.floats(0.05, 1.95),
    place=st.floats(0, 1),
    log_omega=st.floats(-5, 4),
)
@settings(max_examples=60, deadline=None)
def test_compiled_loop_agrees_with_core(
    model: str, kp: float, ki: float, alpha: float, place: float, log_omega: float
) -> None:
    family = spec(model).plant
    scale = scale_of(spec(model))
    gains = FoPi(kp, ki, alpha)
    theta = family.low + place * (family.high - family.low)
    loops = Loops.of(gains, Plants.members(family, theta[None, :]))
    row, u = np.zeros(1, dtype=np.intp), np.array([log_omega])
    log_l, slope = loops.log_response(row, u)[0], loops.log.derivative(row, u)[0]
    omega = np.exp(log_omega)
    near = log_l.imag + omega * loops.plants.dead_time_s[0]
    outputs = loop_function(family, scale)(scale.scaled(gains), theta, log_omega - np.log(scale.omega_rad_s), near)
    found = dict(zip(OUTPUTS, (float(v) for v in outputs), strict=True))
    sensitivity = log_response_at(loops, Response.SENSITIVITY, row, np.array([omega]))[0]
    control = log_response_at(loops, Response.CONTROL_SENSITIVITY, row, np.array([omega]))[0]
    # Rounding of some hundred operations; near -1 or a zero of C the logarithms magnify it.
    room = 1e-9 * (1.0 + np.exp(sensitivity) + abs(log_l))
    assert found["log_gain"] == pytest.approx(log_l.real, abs=room)
    assert found["phase_rad"] == pytest.approx(log_l.imag, abs=room)
    assert found["phase_slope_rad"] == pytest.approx(slope.imag, abs=10 * room)
    assert -found["log_return_difference"] == pytest.approx(sensitivity, abs=room)
    assert found["log_controller"] - found["log_return_difference"] == pytest.approx(control, abs=room)
    assert found["log_omega"] == pytest.approx(log_omega, abs=1e-12)


@pytest.mark.parametrize("name", [n for n, q in QUANTITIES.items() if not q.takes_band])
def test_symbolic_margins_agree_with_the_measured_ones(name: str) -> None:
    quantity, family = QUANTITIES[name], spec("lag").plant
    scale, gains = scale_of(spec("lag")), FoPi(0.9, 0.5, 0.8)
    for theta in itertools.product((0.6, 1.7), (1.7, 3.0), (0.1, 0.4)):
        loops = Loops.of(gains, Plants.members(family, np.array([theta])))
        measured = quantity.measure(loops, True, 0.0, np.inf)
        omega = float(measured.omega_rad_s[0])
        log_l = loops.log_response(np.zeros(1, dtype=np.intp), np.array([np.log(omega)]))[0]
        near = log_l.imag + omega * theta[2]
        v = np.log(omega / scale.omega_rad_s)
        at = SymbolicLoop(*(float(x) for x in loop_function(family, scale)(scale.scaled(gains), theta, v, near)))
        assert quantity.from_natural(quantity.natural(at)) == pytest.approx(float(measured.value[0]), rel=1e-9)


@pytest.mark.parametrize("name", QUANTITIES)
def test_natural_units_are_undone(name: str) -> None:
    quantity = QUANTITIES[name]
    for value in (0.01, 1.0, 60.0):
        assert quantity.from_natural(quantity.to_natural(value)) == pytest.approx(value, rel=1e-12)
        assert quantity.to_natural(value * 1.01) > quantity.to_natural(value)


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
    family = PlantFamily(
        "lag",
        {
            name: Uncertain.exactly(v)
            for name, v in (("static_gain", 1.0), ("time_constant_s", 2.0), ("dead_time_s", 0.1))
        },
    )
    plants = Plants.members(family, np.zeros((1, 0)))
    row, at = np.zeros(1, dtype=np.intp), np.array([omega])
    response = plants.response(row, at) * np.exp(-0.1j * at)
    kp, ki = closed_form_gains(response, at, np.radians([margin]), np.array([alpha]))[0]
    loops = Loops.of(FoPi(float(kp), float(ki), alpha), plants)
    crossings = gain_crossovers(loops)
    nearest = int(np.argmin(np.abs(np.log(crossings.omega_rad_s / omega))))
    assert crossings.omega_rad_s[nearest] == pytest.approx(omega, rel=1e-7)
    assert np.mod(crossings.phase_margin_deg[nearest] - margin + 180, 360) - 180 == pytest.approx(0.0, abs=1e-5)


def test_discounted_error_tends_to_one_over_ki_for_a_pi() -> None:
    family = spec("lag").plant
    log_error = log_discounted_error(family, [1.0, 2.0, 0.1], 0.5, 0.25, 1.0, 1e7)
    assert float(np.exp(float(log_error))) == pytest.approx(1 / 0.25, rel=1e-5)


def test_scale_moves_with_the_plants_time() -> None:
    seconds = parse_spec(
        "schema: 1\nname: x\nplant: {model: lag, static_gain: 1, time_constant_s: 2}\nobjective: {maximize: ki}\n"
    )
    hours = parse_spec(
        "schema: 1\nname: x\nplant: {model: lag, static_gain: 1, time_constant_s: 7200}\nobjective: {maximize: ki}\n"
    )
    assert scale_of(seconds).omega_rad_s == pytest.approx(3600 * scale_of(hours).omega_rad_s)
    gains = FoPi(1.0, 2.0, 0.7)
    assert scale_of(hours).controller(scale_of(hours).scaled(gains)).ki == pytest.approx(2.0)
    assert margins(gains, seconds.plant.member(np.zeros(0))).crossover_rad_s is not None
