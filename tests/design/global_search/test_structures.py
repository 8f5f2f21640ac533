"""The structures' responses against the controllers themselves, and rays against the box that they are put into."""

from __future__ import annotations

import math

import casadi as ca
import numpy as np
import pytest

import fopi_tune as ft
from fopi_tune.core.controller import FoPid, Pid
from fopi_tune.design.constraints import Scale
from fopi_tune.design.global_search.basins import reach_of
from fopi_tune.design.global_search.compiled import work_for
from fopi_tune.design.global_search.controllers import controller_at, controller_of
from fopi_tune.design.global_search.controllers import controller_at_infinity as compiled_at_infinity
from fopi_tune.design.global_search.controllers import controller_at_real as compiled_at_real
from fopi_tune.design.global_search.nonlinear.controllers import (
    Kind,
    controller_at_infinity,
    controller_at_real,
    controller_parts,
)
from fopi_tune.design.global_search.problem import Problem
from fopi_tune.design.global_search.rays import fill_ray
from fopi_tune.design.global_search.structures import (
    FRACTIONAL,
    WITH_DERIVATIVE,
    WITH_ORDERS,
    box_with_orders,
    kappa_range,
    quadrants_of,
    ray_of,
)
from fopi_tune.digital import sections_of

PLANT = "{model: transfer_function, numerator: [1], denominator: [1, 2, 1], dead_time_s: 0.3}"
TF = 0.07


def problem_of(ranges: str = "", more: str = "") -> Problem:
    return Problem.of(ft.parse_spec(
        f"schema: 1\nname: x\nplant: {PLANT}\ncontroller: {{structure: pid, {ranges} "
        f"derivative_filter_time_constant_s: {TF}}}\nrequirements: [{{sensitivity_db: {{at_most: 6}}}}]\n{more}"
    ))  # fmt: skip


SAMPLED = "digital: {sample_time_s: 0.05, design: sampled}\n"


def random_gains(chance: np.random.Generator, size: float = 3.0) -> Pid:
    kp, ki, kd = chance.uniform(-size, size, 3).tolist()
    return Pid(kp, ki, kd, TF)


def test_numbers_are_scaled_there_and_back() -> None:
    gains, scale = Pid(1.5, -0.4, 0.3, TF), Scale(3.0, 0.2, np.ones(1), TF)
    back = scale.controller(scale.scaled(gains))
    assert isinstance(back, Pid)
    assert (back.kp, back.ki, back.kd) == pytest.approx((1.5, -0.4, 0.3), rel=1e-14)
    assert back.derivative_filter_time_constant_s == TF


@pytest.mark.parametrize("more", ["", SAMPLED])
def test_the_responses_are_those_of_the_controller(more: str) -> None:
    problem, chance = problem_of(more=more), np.random.default_rng(5)
    scale, sampling, samples = problem.scale, problem.scaled.sampling, problem.scaled.samples
    kind, numbers = Kind.of(sampling)
    for _ in range(20):
        gains = random_gains(chance)
        x = controller_of(scale.scaled(gains), sampling)
        omega = np.geomspace(1e-3, 60.0, 30)
        if samples is None:
            v, wanted = np.log(omega / scale.omega_rad_s), gains(1j * omega)
        else:
            v, wanted = (
                samples.log_nu(omega) - math.log(samples.half),
                sections_of(gains, samples.digital).response(omega),
            )
        found = np.array([complex(*controller_at(x, at)) for at in v]) / scale.gain
        # residues of sections are differences, which cost digits
        np.testing.assert_allclose(found, wanted, rtol=1e-9, atol=1e-12)
        kp, ki, kd = (float(value) for value in x[:3])
        made = kind.made(x, kd, ca.DM(numbers))
        parts = [complex(*map(float, controller_parts(kp, ki, kd, at, made))) for at in v]
        np.testing.assert_allclose(np.array(parts) / scale.gain, wanted, rtol=1e-9, atol=1e-12)
        log_s = math.log(0.37)
        at_real = float(controller_at_real(kp, ki, kd, log_s, made))
        assert at_real == pytest.approx(compiled_at_real(x, log_s), rel=1e-12)
        if samples is None:
            assert at_real / scale.gain == pytest.approx(gains(0.37 * scale.omega_rad_s + 0j).real, rel=1e-12)
            end = float(controller_at_infinity(kp, kd, made)) / scale.gain
            assert end == pytest.approx(gains.kp + gains.kd / TF, rel=1e-12)


@pytest.mark.thinned(6)
@pytest.mark.parametrize("zero", ["", "ki", "kp ki", "kp", "kd"])
def test_the_phase_of_a_ray_is_followed_from_low_frequency_on(zero: str) -> None:
    problem, chance = problem_of(), np.random.default_rng(8)
    table = problem.fine_table
    work = work_for(table)
    v = np.linspace(-40.0, 40.0, 400_001)
    for _ in range(40):
        x = chance.uniform(-1.0, 1.0, 3) * 10.0 ** chance.uniform(-1.5, 1.5, 3)
        for name in zero.split():
            x[("kp", "ki", "kd").index(name)] = 0.0
        fill_ray(x[2], x[0], x[1], table, work)
        s = 1j * np.exp(v)
        c = x[0] + x[1] / s + x[2] * s / (problem.scaled.sampling.derivative * s + 1.0)
        first = next(gain for gain in (x[1], x[0], x[2]) if gain != 0.0)
        order = -1.0 if x[1] else (0.0 if x[0] else 1.0)
        angle = np.unwrap(np.angle(c))
        angle += 0.5 * np.pi * order - (np.pi if first < 0.0 else 0.0) - angle[0]
        inner = slice(1, -1)
        # between the fine grid's points the phase bends
        np.testing.assert_allclose(work.controller[3][inner], np.interp(table.v[inner], v, angle), atol=2e-4)
        assert work.controller[3][0] == pytest.approx(angle[0], abs=1e-9)
        assert work.controller[3][-1] == pytest.approx(angle[-1], abs=1e-9)


RANGES = [
    "",
    "kp: {min: 0, max: 4}, ki: {min: 0, max: 2}, kd: {min: 0, max: 1},",
    "kp: {min: 1, max: 1.1}, ki: {min: 0.3, max: 0.31}, kd: {min: 0.2, max: 0.21},",
    "kp: 1, ki: 0.3, kd: {min: 0, max: 1},",
    "kp: {min: 0, max: 4}, ki: 0.3, kd: 0.2,",
    "kp: -1, ki: {min: -2, max: 2}, kd: -0.2,",
    "kp: 0, ki: {min: 0.1, max: 2}, kd: {min: 0, max: 1},",
]


@pytest.mark.parametrize("ranges", RANGES)
def test_every_ray_meets_the_box_of_gains(ranges: str) -> None:
    problem = problem_of(ranges)
    box, sampling, spec = problem.box, problem.scaled.sampling, problem.spec.controller
    for signs in quadrants_of(problem.box):
        for shape in np.linspace(box.shape_low, box.shape_high, 9):
            for tau in (-1.0, -0.9, -0.3, 0.0, 0.5, 0.95, 1.0):
                third, c, s = ray_of(shape, tau, signs, *reach_of(problem), box, sampling)
                low, high = kappa_range(third, c, s, -25.0, 30.0, box, sampling)
                assert low <= high
                x = WITH_DERIVATIVE.times(math.exp(high), np.array([c, s, third]))
                found = problem.scale.controller(x)
                for name, side in spec.ranges.items():
                    # rounding of a quotient
                    room = 1e-8 * max(abs(getattr(found, name)), 1e-6)
                    assert side.min - room <= getattr(found, name) <= side.max + room


def test_a_structure_says_which_numbers_are_gains() -> None:
    x = np.array([1.0, -0.01, 0.5])
    assert FRACTIONAL.times(2.0, x).tolist() == [2.0, -0.02, 0.5]
    assert WITH_DERIVATIVE.times(2.0, x).tolist() == [2.0, -0.02, 1.0]
    # alpha is never small beside the gains
    assert FRACTIONAL.units(x).tolist() == [1.0, 0.1, 1.0]
    assert WITH_DERIVATIVE.units(x).tolist() == [1.0, 0.1, 0.5]
    assert (FRACTIONAL.order(x), WITH_DERIVATIVE.order(x)) == (0.5, 1.0)
    assert (FRACTIONAL.size(x), WITH_DERIVATIVE.size(np.array([0.0, 0.1, -3.0]))) == (1.0, 3.0)


# --- orders of integral and derivative ------------------------------------------------------------------------------


#: every way to make the integral's filter; the derivative's is always Tustin's
FILTERS = [
    SAMPLED,
    "digital: {sample_time_s: 0.05, design: sampled, method: modified_oustaloup, poles: 4, prewarp: crossover}\n",
    "digital: {sample_time_s: 0.1, design: sampled, rule: matched, band_rad_s: [0.01, 40]}\n",
]


def problem_with_orders(ranges: str = "", more: str = "") -> Problem:
    return Problem.of(ft.parse_spec(
        f"schema: 1\nname: x\nplant: {PLANT}\ncontroller: {{structure: fopid, {ranges} "
        f"derivative_filter_time_constant_s: {TF}}}\nrequirements: [{{sensitivity_db: {{at_most: 6}}}}]\n{more}"
    ))  # fmt: skip


def random_orders(chance: np.random.Generator) -> FoPid:
    kp, ki, kd = chance.uniform(-3.0, 3.0, 3).tolist()
    return FoPid(kp, ki, float(chance.uniform(0.2, 1.8)), kd, float(chance.choice([chance.uniform(0.2, 1.0), 1.0])), TF)


def test_numbers_with_orders_are_scaled_there_and_back() -> None:
    gains, scale = FoPid(1.5, -0.4, 0.7, 0.3, 0.6, TF), Scale(3.0, 0.2, np.ones(1), TF, True)
    found = scale.scaled(gains)
    assert found.tolist() == pytest.approx([0.3, -0.08 * 3.0**-0.7, 0.06 * 3.0**0.6, 0.7, 0.6])
    back = scale.controller(found)
    assert isinstance(back, FoPid)
    for name in ("kp", "ki", "alpha", "kd", "mu", "derivative_filter_time_constant_s"):
        assert getattr(back, name) == pytest.approx(getattr(gains, name), rel=1e-14)
    # a start of another structure
    assert scale.scaled(Pid(1.5, 1.0, 0.0, TF))[2:].tolist() == [0.0, 1.0, 1.0]


def test_the_responses_with_orders_are_those_of_the_controller() -> None:
    problem, chance = problem_with_orders(), np.random.default_rng(51)
    scale = problem.scale
    for _ in range(30):
        gains = random_orders(chance)
        x = scale.scaled(gains)
        sampling = WITH_ORDERS.sampling_at(x, problem.scaled.sampling)
        at = controller_of(x[:3], sampling)
        omega = np.geomspace(1e-3, 60.0, 30)
        v, wanted = np.log(omega / scale.omega_rad_s), gains(1j * omega)
        found = np.array([complex(*controller_at(at, u)) for u in v]) / scale.gain
        np.testing.assert_allclose(found, wanted, rtol=1e-10, atol=1e-12)
        kind, numbers = Kind.of(problem.scaled.sampling, True)
        made, (kp, ki, kd) = kind.made(x, float(x[2]), ca.DM(numbers)), (float(value) for value in x[:3])
        parts = np.array([complex(*map(float, controller_parts(kp, ki, kd, u, made))) for u in v])
        np.testing.assert_allclose(parts / scale.gain, wanted, rtol=1e-10, atol=1e-12)
        log_s = math.log(0.37)
        at_real = float(controller_at_real(kp, ki, kd, log_s, made))
        assert at_real == pytest.approx(compiled_at_real(at, log_s), rel=1e-12)
        assert at_real / scale.gain == pytest.approx(gains(0.37 * scale.omega_rad_s + 0j).real, rel=1e-12)
        is_first = float(gains.mu == 1.0)
        end = gains.kp + is_first * gains.kd / TF
        assert compiled_at_infinity(at) / scale.gain == pytest.approx(end, rel=1e-12)
        assert float(controller_at_infinity(kp, kd, made, is_first)) / scale.gain == pytest.approx(end, rel=1e-12)


@pytest.mark.parametrize("more", FILTERS)
def test_the_responses_with_orders_on_samples_are_those_of_the_digital_controller(more: str) -> None:
    problem, chance = problem_with_orders(more=more), np.random.default_rng(52)
    scale, samples = problem.scale, problem.scaled.samples
    assert samples is not None
    at = 1.3 if samples.digital.depends_on_crossover else None
    problem = problem.exact_at(at) if at else problem
    samples = problem.scaled.samples
    assert samples is not None
    kind, numbers = Kind.of(problem.scaled.sampling, True)
    assert kind.rise_corners == kind.corners > 0
    for _ in range(8):
        gains = random_orders(chance)
        x = scale.scaled(gains)
        made = controller_of(x[:3], WITH_ORDERS.sampling_at(x, problem.scaled.sampling))
        omega = np.geomspace(1e-3, 0.95 * samples.nyquist_rad_s, 30)
        v = samples.log_nu(omega) - math.log(samples.half)
        sections = sections_of(gains, samples.digital, at)
        wanted = sections.response(omega)
        found = np.array([complex(*controller_at(made, u)) for u in v]) / scale.gain
        # residues of sections are differences, which cost digits
        np.testing.assert_allclose(found, wanted, rtol=1e-8, atol=1e-11)
        kp, ki, kd = (float(value) for value in x[:3])
        symbols = kind.made(x, kd, ca.DM(numbers))
        parts = np.array([complex(*map(float, controller_parts(kp, ki, kd, u, symbols))) for u in v])
        np.testing.assert_allclose(parts / scale.gain, wanted, rtol=1e-8, atol=1e-11)
        # a real s is the real z = (1 + h s)/(1 - h s); s = inf is z = -1
        log_s, h = math.log(0.37), samples.half
        z = (1.0 + h * 0.37) / (1.0 - h * 0.37)
        at_real = float(sections.at(np.array([z - 1.0 + 0j]))[0].real)
        assert compiled_at_real(made, log_s) / scale.gain == pytest.approx(at_real, rel=1e-8)
        assert float(controller_at_real(kp, ki, kd, log_s, symbols)) / scale.gain == pytest.approx(at_real, rel=1e-8)
        end = float(sections.at(np.array([-2.0 + 0j]))[0].real)
        assert compiled_at_infinity(made) / scale.gain == pytest.approx(end, rel=1e-7, abs=1e-9)
        assert float(controller_at_infinity(kp, kd, symbols)) / scale.gain == pytest.approx(end, rel=1e-7, abs=1e-9)


@pytest.mark.thinned(2)
@pytest.mark.parametrize("more", FILTERS)
@pytest.mark.parametrize("zero", ["", "ki", "kp ki", "kp", "kd"])
def test_the_phase_of_a_ray_with_orders_on_samples_is_followed_from_low_frequency_on(zero: str, more: str) -> None:
    problem, chance = problem_with_orders(more=more), np.random.default_rng(82)
    table, samples = problem.fine_table, problem.scaled.samples
    assert samples is not None
    v = np.linspace(-30.0, 30.0, 150_001)
    for _ in range(6):
        gains = random_orders(chance)
        x = np.array([*(chance.uniform(-1.0, 1.0, 3) * 10.0 ** chance.uniform(-1.0, 1.0, 3)), gains.alpha, gains.mu])
        for name in zero.split():
            x[("kp", "ki", "kd").index(name)] = 0.0
        sampling, work = WITH_ORDERS.sampling_at(x, table.sampling), work_for(table)
        fill_ray(x[2], x[0], x[1], table._replace(sampling=sampling), work)
        sections = sections_of(problem.scale.controller(x), samples.digital, problem.scale.omega_rad_s)
        w = 1j * samples.half * np.exp(v)
        c = sections.at(2.0 * w / (1.0 - w))
        first = next(gain for gain in (x[1], x[0], x[2]) if gain != 0.0)
        order = -1.0 if x[1] else (0.0 if x[0] else 1.0)
        angle = np.unwrap(np.angle(c))
        start = 0.5 * np.pi * order - (np.pi if first < 0.0 else 0.0)
        angle += 2.0 * np.pi * np.round((start - angle[0]) / (2.0 * np.pi))
        inner = slice(1, -1)
        # between the dense grid's points the phase bends; sums of sections lose digits at the ends of the axis
        np.testing.assert_allclose(work.controller[3][inner], np.interp(table.v[inner], v, angle), atol=1e-3)
        assert work.controller[3][0] == pytest.approx(start, abs=1e-6)


@pytest.mark.parametrize("zero", ["", "ki", "kp ki", "kp", "kd"])
def test_the_phase_of_a_ray_with_orders_is_followed_from_low_frequency_on(zero: str) -> None:
    problem, chance = problem_with_orders(), np.random.default_rng(81)
    table = problem.fine_table
    v = np.linspace(-60.0, 60.0, 150_001)
    for _ in range(8):
        gains = random_orders(chance)
        x = np.array([*(chance.uniform(-1.0, 1.0, 3) * 10.0 ** chance.uniform(-1.0, 1.0, 3)), gains.alpha, gains.mu])
        for name in zero.split():
            x[("kp", "ki", "kd").index(name)] = 0.0
        sampling, work = WITH_ORDERS.sampling_at(x, table.sampling), work_for(table)
        fill_ray(x[2], x[0], x[1], table._replace(sampling=sampling), work)
        log_s = v + 0.5j * np.pi
        derivative = np.exp(x[4] * log_s) / (sampling.derivative * np.exp(log_s) + 1.0)
        c = x[0] + x[1] * np.exp(-x[3] * log_s) + x[2] * derivative
        first = next(gain for gain in (x[1], x[0], x[2]) if gain != 0.0)
        order = -x[3] if x[1] else (0.0 if x[0] else x[4])
        angle = np.unwrap(np.angle(c))
        start = 0.5 * np.pi * order - (np.pi if first < 0.0 else 0.0)
        # at e^-60 rad/s the first term still shares with the next one
        angle += 2.0 * np.pi * np.round((start - angle[0]) / (2.0 * np.pi))
        inner = slice(1, -1)
        # between the dense grid's points the phase bends
        np.testing.assert_allclose(work.controller[3][inner], np.interp(table.v[inner], v, angle), atol=1e-3)
        assert work.controller[3][0] == pytest.approx(start, abs=1e-6)


@pytest.mark.parametrize("ranges", ["", *RANGES[1:5]])
def test_every_ray_with_orders_meets_the_box_of_gains(ranges: str) -> None:
    problem = problem_with_orders(ranges)
    sampling, spec = problem.scaled.sampling, problem.spec.controller
    for alpha, mu in ((0.3, 0.2), (1.0, 0.7), (1.6, 1.0)):
        at, box = sampling._replace(order=alpha, rise=mu), box_with_orders(mu, problem.box)
        for signs in quadrants_of(problem.box):
            for shape in np.linspace(box.shape_low, box.shape_high, 5):
                for tau in (-1.0, -0.3, 0.5, 1.0):
                    third, c, s = ray_of(shape, tau, signs, *reach_of(problem), box, at)
                    low, high = kappa_range(third, c, s, -25.0, 30.0, box, at)
                    assert low <= high
                    found = problem.scale.controller(
                        WITH_ORDERS.times(math.exp(high), np.array([c, s, third, alpha, mu]))
                    )
                    for name in ("kp", "ki", "kd"):
                        # rounding of a quotient
                        room = 1e-8 * max(abs(getattr(found, name)), 1e-6)
                        side = spec.ranges[name]
                        assert side.min - room <= getattr(found, name) <= side.max + room
