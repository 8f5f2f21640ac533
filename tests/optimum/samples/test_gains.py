"""Boxes of controllers on samples: Taylor models and enclosures hold every controller drawn from them."""

from __future__ import annotations

import math

import numpy as np
import pytest
from flint import acb, arb

from fopi_tune.core.terms.digital_spec import DigitalSpec
from fopi_tune.optimum.parametrization import ControllerBox, Parametrization
from fopi_tune.optimum.pruning.screen import Boxes, gains_at, taylor_models
from fopi_tune.optimum.samples.filter_of_order import FilterOfOrder
from fopi_tune.optimum.samples.gains import SampledCrossoverParametrization, SampledGainParametrization
from fopi_tune.proof.balls.box import Box

SAMPLE_TIME_S, CROSSOVER_RAD_S = 0.2, 0.3
NU = math.tan(0.5 * CROSSOVER_RAD_S * SAMPLE_TIME_S)
#: rounding of the floating-point numbers that are compared
ROOM = 1e-9


def filter_of(method: str) -> FilterOfOrder:
    return FilterOfOrder(DigitalSpec(SAMPLE_TIME_S, method, 5, (1e-3, 1e2)))


def parametrizations(method: str) -> list[Parametrization]:
    return [
        SampledGainParametrization(CROSSOVER_RAD_S, filter_of(method), arb(NU)),
        SampledCrossoverParametrization(CROSSOVER_RAD_S, acb(0.8, -0.6), filter_of(method), arb(NU)),
    ]


def box_at(parametrization: Parametrization, pick: np.random.Generator, width: float) -> Box:
    if isinstance(parametrization, SampledGainParametrization):
        middle = pick.uniform([-2.0, -2.0, 0.2], [3.0, 3.0, 1.8])
    else:
        middle = pick.uniform([0.2, -3.0], [1.8, 3.0])
    half = width * pick.uniform(0.1, 1.0, len(middle))
    low, high, order = middle - half, middle + half, 0 if len(middle) == 2 else 2
    low[order], high[order] = max(low[order], 0.05), min(high[order], 1.95)
    return tuple(zip(low.tolist(), high.tolist(), strict=True))


def controller(parametrization: Parametrization, point: np.ndarray, w: complex) -> tuple[complex, float, float]:
    """C, kp and ki of one point of the coordinates, by the filter in floating point."""
    assert isinstance(parametrization, SampledGainParametrization | SampledCrossoverParametrization)
    found = gains_at(parametrization, point[None])
    at = parametrization.filter.in_floats(np.array([w]), found.alpha)[0][0]
    return complex(found.kp[0] + found.ki[0] * at), float(found.kp[0]), float(found.ki[0])


def inside(ball: acb, value: complex) -> bool:
    room = ROOM * (1.0 + abs(value))
    return bool((abs(ball - acb(value.real, value.imag))).lower() <= room)


@pytest.mark.parametrize("method", ["oustaloup", "modified_oustaloup"])
@pytest.mark.parametrize("width", [0.4, 0.05, 0.002])
@pytest.mark.parametrize("which", [0, 1])
def test_taylor_models_and_enclosures_hold_every_controller(method: str, width: float, which: int) -> None:
    pick, parametrization = np.random.default_rng(5), parametrizations(method)[which]
    for _ in range(10):
        box = box_at(parametrization, pick, width)
        controllers = parametrization.controllers(box)
        middle, half = np.array([0.5 * (a + b) for a, b in box]), np.array([0.5 * (b - a) for a, b in box])
        u = float(pick.uniform(-6.0, 3.0))
        interval = (u - width, u + width)
        over, model = controllers.enclosure(interval), controllers.taylor_model(acb(arb(u), arb.pi() / 2))
        low, high = controllers.gain_range("ki")
        for _ in range(12):
            t = pick.uniform(-1.0, 1.0, len(box))
            value, kp, ki = controller(parametrization, middle + t * half, 1j * math.exp(u))
            linear = model.middle + sum((s * float(a) for s, a in zip(model.slopes, t * half, strict=True)), acb(0))
            assert (abs(linear - acb(value.real, value.imag)) - model.remainder).lower() <= ROOM * (1.0 + abs(value))
            if low.is_finite() and high.is_finite():
                assert low - ROOM <= ki * (1 + math.copysign(ROOM, ki))
                assert ki * (1 - math.copysign(ROOM, ki)) <= high + ROOM
            assert (controllers.kp - kp).abs_lower() <= ROOM * (1.0 + abs(kp))
            at = float(pick.uniform(*interval))
            assert inside(over.value, controller(parametrization, middle + t * half, 1j * math.exp(at))[0])
            check_integral(controllers, parametrization, middle + t * half, interval, at)


def check_integral(
    controllers: ControllerBox, parametrization: Parametrization, point: np.ndarray, u: tuple[float, float], at: float
) -> None:
    value, kp, _ = controller(parametrization, point, 1j * math.exp(at))
    integral = value - kp
    size = abs(integral)
    response = controllers.integral_response(controllers.integral, u)
    assert inside(response, integral)
    least = controllers.least_integral_size(controllers.integral, u[1])
    most = controllers.largest_integral_size(controllers.integral, u[0])
    assert least <= size * (1.0 + 1e-6) + ROOM
    assert size * (1.0 - 1e-6) - ROOM <= most


@pytest.mark.parametrize("method", ["oustaloup", "modified_oustaloup"])
@pytest.mark.parametrize("which", [0, 1])
def test_the_gain_of_positive_controllers_rises_no_faster_than_is_said(method: str, which: int) -> None:
    pick, parametrization, checked = np.random.default_rng(6), parametrizations(method)[which], 0
    while checked < 200:
        box = box_at(parametrization, pick, 0.2)
        controllers = parametrization.controllers(box)
        point = np.array([pick.uniform(*side) for side in box])
        u = float(pick.uniform(-6.0, 3.0))
        _, kp, ki = controller(parametrization, point, 1j * math.exp(u))
        if kp < 0.0 or ki < 0.0:
            continue
        checked += 1
        step, alpha = 1e-5, float(gains_at(parametrization, point[None]).alpha[0])
        near = [abs(controller(parametrization, point, 1j * math.exp(u + shift))[0]) for shift in (-step, step)]
        rise = math.log(near[1] / near[0]) / (2.0 * step)
        most = arb(0) if alpha <= 1.0 else controllers.steepest_rise((u - 0.01, u + 0.01))
        assert most.is_finite()
        assert rise <= most + 1e-6


@pytest.mark.parametrize("which", [0, 1])
def test_the_models_in_floating_point_are_those_of_the_balls(which: int) -> None:
    pick, parametrization = np.random.default_rng(7), parametrizations("oustaloup")[which]
    for _ in range(10):
        box = box_at(parametrization, pick, 0.01)
        ends = np.array(box)
        u = float(pick.uniform(-5.0, 2.0))
        balls = parametrization.controllers(box).taylor_model(acb(arb(u), arb.pi() / 2))
        floats = taylor_models(parametrization, Boxes(ends[None, :, 0], ends[None, :, 1]), np.array([u + 0.5j * np.pi]))
        assert inside(balls.middle, complex(floats.value[0, 0]))
        for ball, value in zip(balls.slopes, floats.slopes, strict=True):
            assert abs(ball - acb(value[0, 0].real, value[0, 0].imag)).lower() <= 1e-8 * (1.0 + abs(value[0, 0]))
        # a bound of the remainder is above its estimate, and not by much
        assert floats.remainder[0, 0] * 0.5 <= balls.remainder <= 3.0 * floats.remainder[0, 0] + 1e-12
