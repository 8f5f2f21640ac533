"""What the search knows of samples against `digital/` and `core/`: filters, plants, slots, rays, worst cases."""

from __future__ import annotations

from dataclasses import replace
from functools import cache, partial

import casadi as ca
import numpy as np
import pytest
from oracles.sampled_search import checked

import fopi_tune as ft
from fopi_tune.core.controller import FoPi
from fopi_tune.core.loops import Loops, Plants
from fopi_tune.core.peaks import Response, log_response_at
from fopi_tune.core.sampled_loops import SampledLoops
from fopi_tune.core.stability import is_stable
from fopi_tune.design.constraints import Scale
from fopi_tune.design.global_search.compiled import work_for
from fopi_tune.design.global_search.controllers import controller_of, filter_at, integral_at_real
from fopi_tune.design.global_search.intervals import allowed_intervals
from fopi_tune.design.global_search.nonlinear.controllers import Filter, Kind
from fopi_tune.design.global_search.nonlinear.program import COEFFICIENTS, INDEX, PARAMETERS, _slot
from fopi_tune.design.global_search.polish import Polish
from fopi_tune.design.global_search.problem import Problem
from fopi_tune.design.global_search.samples import Samples
from fopi_tune.digital import sections_of
from fopi_tune.digital.implementation import implementation_of
from fopi_tune.quantities import QUANTITIES
from fopi_tune.spec.model import DesignSpec, DigitalSpec

FILTERS = [
    {"method": method, **rule}
    for method in ("oustaloup", "modified_oustaloup")
    for rule in ({"rule": "tustin"}, {"rule": "matched"}, {"rule": "tustin", "prewarp": "crossover"})
]
PLANTS = {
    "vertices": "{model: lag, static_gain: 1, time_constant_s: {min: 1.6, max: 3.1}, "
    "dead_time_s: {min: 0.2, max: 0.4}}",
    "samples": "{model: lag, static_gain: 1, time_constant_s: {min: 0.3, max: 3}, dead_time_s: {min: 0.1, max: 0.75}}",
    "interior": "{model: transfer_function, numerator: [{min: 1, max: 10}], "
    "denominator: [1, {min: 21, max: 35}, {min: 20, max: 40}]}",
    "resonance": "{model: transfer_function, numerator: [1], denominator: [1, 0.1, {min: 0.8, max: 1.3}], "
    "dead_time_s: 0.05}",
    "unstable": "{model: pole, gain: {min: 0.9, max: 1.1}, pole_rad_s: {min: -0.6, max: -0.4}}",
    "integrator": "{model: pole, gain: 1, pole_rad_s: {min: -0.1, max: 0.1}, dead_time_s: 0.3}",
    "double": "{model: transfer_function, numerator: [{min: 0.1, max: 0.2}, {min: 0.5, max: 1}], "
    "denominator: [1, 0, 0]}",
    "direct": "{model: transfer_function, numerator: [0.3, 1], denominator: [1, {min: 0.5, max: 2}], "
    "dead_time_s: 0.25}",
    "negative": "{model: lag, static_gain: {min: -1.5, max: -1}, time_constant_s: 2}",
    "none": "{model: lag, static_gain: 1, time_constant_s: 2, dead_time_s: 0.5}",
    "linked": "{parameters: {k: {min: 1, max: 2}, a: {min: 0.5, max: 1}, L: {min: 0.05, max: 0.3}}, "
    "model: transfer_function, numerator: [k * a, k], denominator: [[1, a], [1, a**2 + k]], dead_time_s: L}",
}
QUANTITIES_ASKED = [
    "sensitivity_db: {at_most: 3}",
    "sensitivity_db: {at_least: -60}, from_rad_s: 0.01, to_rad_s: 0.1",
    "complementary_sensitivity_db: {at_most: 3}",
    "control_sensitivity_db: {at_most: 3}",
    "loop_gain_db: {at_most: 3}, from_rad_s: 0.5, to_rad_s: 3",
    "phase_margin_deg: {at_least: 30}",
    "gain_margin_db: {at_least: 8}",
    "delay_margin_s: {at_least: 0.3}",
    "crossover_rad_s: {at_least: 0.5}",
    "phase_slope_deg_per_decade: {at_least: -30}",
]


def spec_of(plant: str, requirements: list[str], digital: str = "sample_time_s: 0.2", more: str = "") -> DesignSpec:
    rows = "".join(f"  - {{{r}}}\n" for r in requirements)
    return ft.parse_spec(
        f"schema: 1\nname: x\nplant: {plant}\nrequirements:\n{rows}digital: {{{digital}, design: sampled}}\n{more}"
    )


@pytest.mark.parametrize("options", FILTERS, ids=lambda o: " ".join(o.values()))
@pytest.mark.parametrize("poles", [2, 7])
def test_the_filter_is_that_of_the_digital_controller(options: dict[str, str], poles: int) -> None:
    digital = replace(DigitalSpec(sample_time_s=0.2, poles=poles), **options)
    samples = Samples(digital, Scale(0.7, 2.0, np.ones(1)), 0.8)
    sampling = samples.sampling
    omega = np.geomspace(1e-4, 0.999 * samples.nyquist_rad_s, 60)
    there = np.exp(samples.log_nu(omega)) / samples.half
    real = np.tanh(0.15) / samples.half
    symbol = ca.SX.sym("alpha")
    made = Filter.of(symbol, sampling.half, ca.DM(sampling.gain), ca.DM(sampling.corners.T), sampling.matched)
    program = ca.Function("filter", [symbol], [*made.parts(float(there[20])), made.at_real(float(real))])
    for alpha in (0.3, 0.7, 0.99, 1.0, 1.3, 1.9):
        gains = FoPi(0.7, 0.4, alpha)
        sections = sections_of(gains, digital, 0.8)
        x = controller_of(samples.scale.scaled(gains), sampling)
        found = np.array([complex(*filter_at(x, w)) for w in there])
        # residues of sections are differences, which cost digits
        np.testing.assert_allclose((x[0] + x[1] * found) / 2.0, sections.response(omega), rtol=1e-10)
        at_real = (x[0] + x[1] * integral_at_real(x, np.log(real))) / 2.0
        assert at_real == pytest.approx(sections.at(np.array([np.expm1(0.3) + 0j])).real[0], rel=1e-10)
        parts = [float(value) for value in program(alpha)]
        assert parts == pytest.approx([found[20].real, found[20].imag, integral_at_real(x, np.log(real))], rel=1e-12)


@pytest.mark.parametrize("plant", PLANTS)
@pytest.mark.parametrize("digital", ["sample_time_s: 0.2", "sample_time_s: 0.01, delay_samples: 0.5"])
def test_the_plants_of_a_box_are_those_behind_the_hold(plant: str, digital: str) -> None:
    problem = Problem.of(spec_of(PLANTS[plant], QUANTITIES_ASKED[:1], digital))
    samples, family = problem.scaled.samples, problem.spec.plant
    assert samples is not None
    chance = np.random.default_rng(3)
    points = family.low + chance.random((30, len(family.low))) * (family.high - family.low)
    plants = samples.plants(Plants.members(family, points))
    u = samples.log_nu(np.geomspace(1e-4, 0.9999, 80) * samples.nyquist_rad_s)
    s = 1j * np.exp(u) / samples.half
    for row, point in enumerate(points):
        c = problem.scaled.member(point)
        late = np.exp(-2j * c[18] * np.arctan(np.exp(u)))
        response = np.polyval(c[:9], s) / np.polyval(c[9:18], s) * late * problem.scale.gain
        # beside a resonance or a zero on the circle digits are lost
        wanted = plants.at(np.full(len(u), row), u)
        np.testing.assert_allclose(response, wanted, rtol=2e-9, atol=1e-12 * np.abs(wanted).max())


@pytest.mark.thinned(12)
@pytest.mark.parametrize("plant", ["vertices", "integrator", "direct"])
@pytest.mark.parametrize("options", FILTERS[:3], ids=lambda o: " ".join(o.values()))
def test_the_slots_quantities_are_those_of_core(plant: str, options: dict[str, str]) -> None:
    spec = spec_of(PLANTS[plant], QUANTITIES_ASKED[:1], "sample_time_s: 0.2, delay_samples: 0.5")
    assert spec.digital is not None
    digital = replace(spec.digital, **options)
    spec = replace(spec, digital=digital)
    family, chance, problem = spec.plant, np.random.default_rng(2), Problem.of(spec)
    for _ in range(12):
        gains = FoPi(*chance.uniform((-3, -3, 0.1), (3, 3, 1.9)).tolist())
        if problem.needs_crossover:
            problem = problem.exact_at(1.3)
        sampling, samples = problem.scaled.sampling, problem.scaled.samples
        assert samples is not None
        theta = family.low + chance.random(len(family.low)) * (family.high - family.low)
        omega = float(np.exp(chance.uniform(-4, 2)))
        implementation = replace(
            implementation_of(spec, gains), sections=sections_of(gains, digital, samples.crossover_rad_s)
        )
        loops = SampledLoops.implemented(gains, implementation, Plants.members(family, theta[None, :]))
        row, at = np.zeros(1, dtype=np.intp), loops.u_of(np.array([omega]))
        log_l, slope = loops.log_response(row, at)[0], loops.log.derivative(row, at)[0]
        sensitivity = log_response_at(loops, Response.SENSITIVITY, row, np.array([omega]))[0]
        control = log_response_at(loops, Response.CONTROL_SENSITIVITY, row, np.array([omega]))[0]
        v = float(at[0]) - np.log(samples.half)
        near = log_l.imag + 2.0 * loops.plants.late[0] * np.arctan(np.exp(at[0]))
        made = Filter.of(gains.alpha, sampling.half, ca.DM(sampling.gain), ca.DM(sampling.corners.T), sampling.matched)
        value = partial(_slot_value, problem, gains, theta, v, near, made)
        room = 1e-9 * (1.0 + np.exp(sensitivity) + abs(log_l))
        stretch = float(loops.stretch(at)[0])
        assert value(log_l=1.0) == pytest.approx(log_l.real, abs=room)
        assert value(angle=1.0) == pytest.approx(log_l.imag, abs=room)
        assert value(lag=1.0) == pytest.approx(log_l.imag / omega * problem.scale.omega_rad_s, abs=100 * room)
        assert value(log_omega=1.0) == pytest.approx(np.log(omega / problem.scale.omega_rad_s), abs=room)
        assert value(slope=1.0) == pytest.approx(slope.imag * np.log(10.0) / stretch, abs=100 * room)
        assert value(log_s=1.0) == pytest.approx(sensitivity, abs=room)
        assert value(log_s=1.0, log_c=1.0) == pytest.approx(control + np.log(problem.scale.gain), abs=room)


def _slot_value(
    problem: Problem, gains: FoPi, theta: np.ndarray, v: float, near: float, made: Filter, **weights: float
) -> float:
    p = np.zeros(PARAMETERS)
    p[:COEFFICIENTS] = problem.scaled.member(theta)
    p[INDEX["sign"]], p[INDEX["near"]] = -1.0, near
    for name, weight in weights.items():
        p[INDEX[name]] = weight
    x = problem.scale.scaled(gains)
    symbol, kind = ca.SX.sym("v"), Kind(peaks=True, slopes=True)
    _, row, _ = _slot(float(x[0]), float(x[1]), float(x[2]), 0.0, symbol, 0.0, 0.0, ca.SX(p), kind, made)
    return float(ca.Function("row", [symbol], [row])(v))


GAINS = {
    "vertices": FoPi(1.2, 0.5, 1.2),
    "samples": FoPi(0.5, 0.6, 0.9),
    "interior": FoPi(5.0, 9.3, 1.0),
    "resonance": FoPi(0.01, 0.03, 1.0),
    "unstable": FoPi(3.0, 1.0, 1.1),
    "integrator": FoPi(0.8, 0.2, 0.8),
    "double": FoPi(2.0, 0.02, 0.6),
    "direct": FoPi(0.5, 0.4, 1.1),
    "negative": FoPi(-1.0, -0.6, 0.9),
    "none": FoPi(1.2, 0.6, 0.9),
    "linked": FoPi(0.8, 0.5, 0.9),
}


ASKED = [
    (name, digital) for name in PLANTS for digital in ("sample_time_s: 0.1", "sample_time_s: 0.3, delay_samples: 0.4")
]


def is_long(name: str, digital: str) -> bool:
    """Whether a plant with a sample time is for -m long; the unstable one's sensitivity takes long."""
    return name == "unstable" or ("0.3" in digital and name != "direct")


@pytest.mark.thinned(3)
@pytest.mark.parametrize(
    ("name", "digital"), [pytest.param(*pair, marks=[pytest.mark.long] * is_long(*pair)) for pair in ASKED]
)
def test_the_smallest_slack_of_every_row_is_the_verifications(name: str, digital: str) -> None:
    spec, gains = spec_of(PLANTS[name], QUANTITIES_ASKED, digital, "objective: {maximize: ki}\n"), GAINS[name]
    problem = Problem.of(spec)
    found, verified = Polish(problem).look(problem.scale.scaled(gains), within=np.inf), checked(spec, gains)
    if not verified.stability.stable:
        assert found is None
        return
    assert found is not None
    for index, result in enumerate(verified.requirements):
        rows = [k for k, c in enumerate(problem.constraints) if c.requirement == index]
        own = found[np.isin(found[:, 0], rows)]
        if result.slack is None or not np.isfinite(result.slack):
            assert not len(own)
            continue
        worst, requirement = own[np.argmin(own[:, 1])], result.requirement
        quantity = QUANTITIES[requirement.quantity]
        # rows are designed 4e-7 tighter; a slope is a difference quotient in the search
        # and where a delay goes into the next sample the worst plant is at a kink of the gain margin
        room = 1e-5 if "slope" in requirement.quantity or name == "linked" else 1e-6
        assert worst[1] <= result.slack + room, requirement.quantity
        # the verification may stop at a vertex beside a worse plant: there core/ has the same value
        largest = bool(np.isfinite(requirement.upper))
        loops = problem.loops(gains, worst[None, 6:])
        value = float(quantity.measure(loops, largest, requirement.from_rad_s, requirement.to_rad_s).value[0])
        limit = quantity.to_natural(requirement.limits[0])
        slack = (1.0 if largest else -1.0) * (limit - quantity.to_natural(value))
        assert worst[1] == pytest.approx(slack * quantity.natural_scale(requirement.limits[0]), abs=room)


RAYS_DIGITAL = "sample_time_s: 0.3, delay_samples: 0.5"
RAYS = [(0.5, 1.0, 0.3), (1.0, 0.3, 1.0), (1.3, 1.0, 1.0), (0.9, 1.0, 0.0), (1.0, 0.0, 1.0), (1.1, -1.0, -0.5)]
#: neper; the grid shows the ends of intervals this exactly
NEAR = 0.06


@pytest.mark.thinned(3)
@pytest.mark.parametrize(
    "plant",
    [
        "unstable",
        "direct",
        *(pytest.param(plant, marks=pytest.mark.long) for plant in ("none", "negative", "resonance", "double")),
    ],
)
@pytest.mark.parametrize(
    "requirement",
    [
        "sensitivity_db: {at_most: 4}",
        "complementary_sensitivity_db: {at_most: 2}",
        "control_sensitivity_db: {at_most: 8}",
        "phase_margin_deg: {at_least: 50}",
        "gain_margin_db: {at_least: 8}",
        "delay_margin_s: {at_least: 0.5}",
        "crossover_rad_s: {between: [0.4, 1.2]}",
    ],
)
def test_the_allowed_gains_of_a_ray_are_those_of_core(plant: str, requirement: str) -> None:
    spec = spec_of(PLANTS[plant], [requirement], RAYS_DIGITAL)
    problem = Problem.of(spec)
    table = problem.scan_table
    rows = problem.rows(table, tightening=0.0)
    for alpha, c, s in RAYS:
        work = work_for(table)
        count = allowed_intervals(alpha, c, s, -8.0, 5.0, table, rows, work)
        kappas = np.linspace(-8.0, 5.0, 40)
        inside = np.zeros(len(kappas), dtype=bool)
        near_an_end = np.zeros(len(kappas), dtype=bool)
        for low, high in work.found[:count]:
            inside |= (kappas >= low) & (kappas <= high)
            near_an_end |= (np.abs(kappas - low) < NEAR) | (np.abs(kappas - high) < NEAR)
        # of gaps that are narrower than the grid shows both ends are near
        wrong = ~near_an_end & (inside != [_meets(problem, plant, alpha, c, s, k) for k in kappas])
        beside = [[_meets(problem, plant, alpha, c, s, k + d) for d in (-NEAR, 0.0, NEAR)] for k in kappas[wrong]]
        assert all(len(set(there)) > 1 for there in beside), (alpha, c, s, kappas[wrong])


@cache
def _problem(plant: str) -> Problem:
    return Problem.of(spec_of(PLANTS[plant], QUANTITIES_ASKED[:1], RAYS_DIGITAL))


@cache
def _guarded(plant: str, points: tuple[tuple[float, ...], ...], gains: FoPi) -> Loops | None:
    """The loops with gains, None where one is unstable or closer to -1 than the guard; requirements share them."""
    loops = _problem(plant).loops(gains, np.array(points))
    if not is_stable(loops).all():
        return None
    peak = QUANTITIES["sensitivity_db"].measure(loops, True, 0.0, np.inf).value.max()
    return loops if peak <= 40.0 else None


def _meets(problem: Problem, plant: str, alpha: float, c: float, s: float, kappa: float) -> bool:
    """By core/: every plant of the table stable, no closer to -1 than the guard, the requirement met."""
    gains = problem.scale.controller(np.array([np.exp(kappa) * c, np.exp(kappa) * s, alpha]))
    loops = _guarded(plant, tuple(map(tuple, problem.scan_table.points.tolist())), gains)
    if loops is None:
        return False
    r = problem.spec.requirements[0]
    measure = QUANTITIES[r.quantity].measure
    low = measure(loops, False, r.from_rad_s, r.to_rad_s).value if np.isfinite(r.lower) else np.array([np.inf])
    high = measure(loops, True, r.from_rad_s, r.to_rad_s).value if np.isfinite(r.upper) else np.array([-np.inf])
    return bool((low >= r.lower).all() and (high <= r.upper).all())
