"""Objects of python-control: their responses in frequency and in time are the loop's, on any time grid."""

from __future__ import annotations

import dataclasses
import itertools
from typing import Any

import control
import numpy as np
import pytest
from cases import plants
from cases.shipped_designs import design_of
from scipy.linalg import expm

import fopi_tune as ft
from fopi_tune.core.loops import Loops, Plants
from fopi_tune.core.parallel_form import Implementation
from fopi_tune.core.plant import PlantFamily
from fopi_tune.core.sampled_loops import SampledLoops
from fopi_tune.digital import sections_of
from fopi_tune.results.modal_form import ModalForm
from fopi_tune.results.to_control import to_control, to_sampled
from fopi_tune.simulation.fractional.linear import Signal, exact_response
from fopi_tune.spec.model import DigitalSpec

#: `control` warns of its own future; nothing here depends on it
pytestmark = pytest.mark.filterwarnings("default:::control")

SLOW_ARM = plants.transfer_function([2.0], [1.0, 1.0, 0.0])
#: family, gains, how the plant's poles stand
LOOPS = {
    "brake": (plants.brake(), plants.ROBUST_BRAKE),
    "throttle": (plants.throttle(), plants.PUBLISHED_THROTTLE),
    "ordinary PI": (plants.brake(), ft.FoPi(0.4, 0.3, 1.0)),
    "above first order": (plants.brake(), ft.FoPi(0.4, 0.3, 1.3)),
    "integrators in series": (SLOW_ARM, ft.FoPi(0.3, 0.02, 1.2)),
    "pole three times": (plants.transfer_function([1.0], [1.0, 3.0, 3.0, 1.0]), ft.FoPi(1.0, 0.4, 0.8)),
    "complex pair twice": (plants.transfer_function([1.0], [1.0, 2.0, 3.0, 2.0, 1.0]), ft.FoPi(0.2, 0.2, 0.9)),
    "with a direct path": (plants.transfer_function([1.0, 2.0], [1.0, 1.0]), ft.FoPi(0.2, 0.2, 0.8)),
    "unstable plant": (plants.pole(1.0, -2.0), ft.FoPi(50.0, 50.0, 0.7)),
}


def closed(loop: Any) -> Any:
    return control.feedback(loop, 1)


def by_matrix_exponential(system: Any, times: np.ndarray) -> np.ndarray:
    """The step response  D + C int_0^t e^{A s} ds B,  each time on its own."""
    whole = np.zeros((system.nstates + 1,) * 2)
    whole[:-1, :-1], whole[:-1, -1:] = system.A, system.B
    return np.array([(system.C @ expm(whole * t)[:-1, -1:] + system.D)[0, 0] for t in times])


@pytest.mark.thinned(3)
@pytest.mark.parametrize("alpha", [0.2, 0.82, 1.0, 1.3, 1.8])
@pytest.mark.parametrize("dead_time_s", [0.0, 0.3])
def test_control_objects_respond_as_the_exact_loop_does(alpha: float, dead_time_s: float) -> None:
    gains, family = ft.FoPi(0.385, 0.388, alpha), plants.brake(dead_time_s=dead_time_s)
    objects = to_control(gains, family)
    low, high = objects.band_rad_s
    omega = np.geomspace(low, min(high, 3.0 / dead_time_s) if dead_time_s else high, 300)
    plant = family.member(family.nominal_point)
    value = Loops.of(gains, Plants.of(plant)).log_response(np.zeros(300, dtype=np.intp), np.log(omega))
    # the filter's stated error: 1e-3 of |C|; Pade's of order 5 at omega = 3/dead time is 2e-5
    assert np.abs(objects.loop(1j * omega) / np.exp(value) - 1.0).max() < 1e-3
    controller = gains.kp + gains.ki * (1j * omega) ** -alpha
    assert np.abs(objects.controller(1j * omega) / controller - 1.0).max() < (1e-9 if alpha == 1.0 else 1e-3)
    # a true integrator: the gain at low frequencies has no end
    assert 0.0 in np.diag(objects.controller.A)


@pytest.mark.thinned(2)
@pytest.mark.parametrize("name", LOOPS)
def test_step_responses_are_the_matrix_exponentials_on_any_grid(name: str) -> None:
    family, gains = LOOPS[name]
    objects = to_control(gains, family)
    system = closed(objects.loop)
    grids = (
        np.array([0.0, 60.0]),
        np.linspace(0.0, 60.0, 7),
        np.linspace(0.0, 60.0, 601),
        np.linspace(0.0, 1.0, 1001),
        np.array([0.0, 0.5 * objects.horizon_s, objects.horizon_s]),
    )
    for grid in grids:
        found = np.asarray(control.step_response(system, T=grid).outputs)
        some = np.unique(np.linspace(0, len(grid) - 1, 15).astype(int))
        assert np.abs(found[some] - by_matrix_exponential(system, grid[some])).max() < 1e-9


@pytest.mark.parametrize("name", LOOPS)
def test_step_responses_are_the_fractional_loops_up_to_the_horizon(name: str) -> None:
    family, gains = LOOPS[name]
    objects = to_control(gains, family)
    plant = family.member(family.nominal_point)
    for end in (1.0, 60.0, objects.horizon_s):
        grid = np.linspace(0.0, end, 201)
        found = np.asarray(control.step_response(closed(objects.loop), T=grid).outputs)
        exact = exact_response(gains, plant, Signal.OUTPUT_AFTER_REFERENCE, grid)
        # at t = 0 itself a direct path lets through what no finite filter has
        assert np.abs(found - exact)[1:].max() < 1e-4 * np.abs(exact).max()


def test_the_brakes_output_after_a_minute_does_not_depend_on_the_grid() -> None:
    system = closed(to_control(plants.ROBUST_BRAKE, plants.brake()).loop)
    for count in (2, 4, 61, 6001):
        last = control.step_response(system, T=np.linspace(0.0, 60.0, count)).outputs[-1]
        assert last == pytest.approx(0.979984, abs=1e-6)  # by the inverse Laplace transform: 0.97998412


@pytest.mark.parametrize("dead_time_s", [0.3, 2.0])
def test_with_dead_time_the_step_response_is_exact_after_five_dead_times(dead_time_s: float) -> None:
    family = plants.brake(dead_time_s=dead_time_s)
    objects = to_control(plants.ROBUST_BRAKE, family)
    grid = np.linspace(0.0, 60.0, 601)
    found = np.asarray(control.step_response(closed(objects.loop), T=grid).outputs)
    plant = family.member(family.nominal_point)
    error = np.abs(found - exact_response(plants.ROBUST_BRAKE, plant, Signal.OUTPUT_AFTER_REFERENCE, grid))
    assert error[grid > 5 * dead_time_s].max() < 1e-4
    assert error.max() < 0.02


def test_distinct_real_poles_are_on_the_diagonal_and_nothing_beside_them() -> None:
    for name in ("brake", "throttle"):
        family, gains = LOOPS[name]
        objects = to_control(gains, family)
        for system in (objects.controller, objects.plant, objects.loop):
            assert np.array_equal(system.A, np.diag(np.diag(system.A)))


@pytest.mark.parametrize(
    ("denominator", "sizes"),
    [
        ([1.0, 3.0, 3.0, 1.0], [3]),
        ([1.0, 2.0, 3.0, 2.0, 1.0], [4]),
        ([1.0, 0.0, 0.0], [2]),
        ([1.0, 0.4, 1.0], [2]),
        ([1.0, 3.0, 2.0], [1, 1]),
        (np.poly([-1.0] * 8).tolist(), [8]),
    ],
)
def test_repeated_and_complex_poles_have_real_blocks(denominator: list[float], sizes: list[int]) -> None:
    form = ModalForm.of_polynomials([2.0, 3.0], denominator)
    assert [len(block) for block in form.blocks] == sizes
    assert np.isrealobj(form.a)
    outside = np.ones_like(form.a, dtype=bool)
    for low, high in itertools.pairwise(np.cumsum([0, *sizes])):
        outside[low:high, low:high] = False
    assert not form.a[outside].any()
    s = 1j * np.geomspace(1e-2, 1e2, 60)
    system = control.ss(form.a, form.b[:, None], form.c[None, :], [[form.direct]])
    expected = np.polyval([2.0, 3.0], s) / np.polyval(denominator, s)
    assert np.abs(np.asarray(system(s)) / expected - 1.0).max() < 1e-11


def test_a_pole_that_repeats_is_found_exactly() -> None:
    form = ModalForm.of_polynomials([1.0], [1.0, 2.0, 1.0])
    assert np.diag(form.a).tolist() == [-1.0, -1.0]
    assert form.a[1, 0] == 0.0 != form.a[0, 1]


def test_a_tuned_brake_has_its_margins_in_control_too() -> None:
    _, phase_margin_deg, _, crossover_rad_s = control.margin(design_of("brake").to_control().loop)
    # the filter's error at the crossover is below 1e-6 of |C|
    assert phase_margin_deg == pytest.approx(90.0, abs=1e-3)
    assert crossover_rad_s == pytest.approx(0.3, rel=1e-5)


def test_there_is_nothing_to_convert_without_gains() -> None:
    with pytest.raises(ft.DomainError, match="no gains"):
        dataclasses.replace(design_of("brake"), gains=None).to_control()


# -- on samples -------------------------------------------------------------------------------------------------------

SAMPLED_FAMILIES = {
    "lag": plants.lag(1.0, 2.25),
    "lag and delay": plants.lag(1.0, 2.25, 0.47),
    "twice the same": plants.transfer_function([1.0], [1.0, 2.0, 1.0], 0.2),
    "complex": plants.transfer_function([1.0, 3.0], [1.0, 0.4, 4.0], 0.13),
    "integrator": plants.transfer_function([1.0], [1.0, 1.0, 0.0]),
    "direct path": plants.transfer_function([1.0, 2.0], [1.0, 1.0], 0.3),
    "much faster than a sample": plants.transfer_function([1.0], [0.001, 1.0], 0.5),
}


@pytest.mark.parametrize("delay_samples", [0.0, 1.0, 0.3])
@pytest.mark.parametrize("name", SAMPLED_FAMILIES)
def test_sampled_objects_respond_as_the_loop_on_samples_does(name: str, delay_samples: float) -> None:
    family: PlantFamily = SAMPLED_FAMILIES[name]
    gains, digital = ft.FoPi(0.4, 0.3, 0.8), DigitalSpec(0.2, delay_samples=delay_samples)
    plant = family.member(family.nominal_point)
    sections = sections_of(gains, digital)
    objects = to_sampled(sections, family, delay_samples, 0.3)
    omega = np.geomspace(1e-3, 15.0, 40)
    loops = SampledLoops.implemented(gains, Implementation(sections, delay_samples), Plants.of(plant))
    expected = loops.response(np.zeros(40, dtype=np.intp), omega)
    z = np.exp(0.2j * omega)
    # two ways of evaluating the same numbers, poles next to 1
    assert np.abs(np.asarray(objects.loop(z)) / expected - 1.0).max() < 1e-8
    assert np.abs(np.asarray(objects.controller(z)) * np.asarray(objects.plant(z)) / expected - 1.0).max() < 1e-8
    assert objects.loop.dt == 0.2


def test_sampled_objects_without_delay_are_diagonal_and_step_as_the_difference_equations() -> None:
    family = plants.lag(1.0, 2.25)
    sections = sections_of(ft.FoPi(0.4, 0.3, 0.8), DigitalSpec(0.2))
    objects = to_sampled(sections, family, 0.0, 0.3)
    for system in (objects.controller, objects.plant, objects.loop):
        assert np.array_equal(system.A, np.diag(np.diag(system.A)))
    times = 0.2 * np.arange(301)
    found = np.asarray(control.step_response(closed(objects.loop), T=times).outputs)
    poles, residues = np.array(sections.poles), np.array(sections.residues)
    decay = np.exp(-0.2 / 2.25)
    state, y, expected = np.zeros(len(poles)), 0.0, []
    for _ in times:
        expected.append(y)
        u = sections.direct * (1.0 - y) + state.sum()
        state, y = poles * state + residues * (1.0 - y), decay * y + (1.0 - decay) * u
    assert np.abs(found - np.array(expected)).max() < 1e-11


@pytest.mark.parametrize("order", [1, 2])
@pytest.mark.parametrize("gains", [ft.FoPi(0.385, 0.388, 0.82), ft.Pid(1.0, 0.8, 0.2, 0.05)], ids=["fopi", "pid"])
def test_a_measurement_filter_is_in_the_controller_and_the_loop(gains: ft.FoPi, order: int) -> None:
    used = ft.MeasurementFilter(order, 0.4)
    controller, family = dataclasses.replace(gains, measurement_filter=used), plants.brake()
    found = to_control(controller, family)
    omega = np.geomspace(1e-2, 1e2, 30)
    nominal = family.member(family.nominal_point)
    plant = np.polyval(nominal.numerator, 1j * omega) / np.polyval(nominal.denominator, 1j * omega)
    np.testing.assert_allclose(found.controller(1j * omega), controller(1j * omega), rtol=2e-3)
    np.testing.assert_allclose(found.loop(1j * omega), controller(1j * omega) * plant, rtol=2e-3)
    digital = DigitalSpec(0.1)
    sections = sections_of(controller, digital)
    sampled = to_sampled(sections, family, 0.5, 0.3, used)
    omega = np.geomspace(1e-2, 0.99 * np.pi / 0.1, 30)
    z = np.exp(0.1j * omega)
    np.testing.assert_allclose(sampled.controller(z), sections.response(omega, used), rtol=1e-7)
    loops = SampledLoops.implemented(controller, Implementation(sections, 0.5), Plants.of(nominal))
    wanted = loops.response(np.zeros(len(omega), dtype=np.intp), omega)
    np.testing.assert_allclose(sampled.loop(z), wanted, rtol=1e-6)
