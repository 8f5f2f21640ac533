"""Slopes, rests and rooms of random cells, beside the loops of many gains of the cell."""

from __future__ import annotations

import math

import numpy as np
import pytest

import fopi_tune as ft
from fopi_tune.core.bode_form import Array, Complex
from fopi_tune.core.controller import FoPi
from fopi_tune.design.bound.cells import fill_cell
from fopi_tune.design.bound.columns import (
    DOWN,
    PSI_IMAG,
    PSI_REAL,
    REST,
    ROOM,
    SHAPE_IMAG,
    SHAPE_REAL,
    SLOPES,
    SPREAD,
    UP,
)
from fopi_tune.design.bound.gain_ranges import order_over
from fopi_tune.design.bound.integrals import filters_over
from fopi_tune.design.global_search.compiled import Table, work_for
from fopi_tune.design.global_search.controllers import controller_of, filter_at
from fopi_tune.design.global_search.problem import Problem
from fopi_tune.design.global_search.rays import fill_ray

TEXT = (
    "schema: 1\nname: x\n"
    "plant: {model: lag, static_gain: {min: 1.5, max: 2.6}, time_constant_s: 4, dead_time_s: 0.9}\n"
    "controller: {kp: {min: 0, max: 20}, ki: {min: 0.001, max: 20}, alpha: {min: 0.3, max: 1.7}}\n"
    "requirements: [{sensitivity_db: {at_most: 4.1}}]\n"
)
DIGITAL = "digital: {sample_time_s: 0.2, design: sampled, band_rad_s: [0.001, 100], %s}\n"
PID = TEXT.replace(
    "alpha: {min: 0.3, max: 1.7}", "structure: pid, kd: {min: -9, max: 9}, derivative_filter_time_constant_s: %g"
)
LOOPS = {
    "continuous": TEXT,
    "oustaloup": TEXT + DIGITAL % "poles: 7",
    "modified": TEXT + DIGITAL % "poles: 5, method: modified_oustaloup",
    "pid": PID % 0.4,
    "pid on samples": (PID % 0.15) + DIGITAL % "poles: 7",
}
SIGNS = [(1.0, 1.0, 1.0), (1.0, -1.0, 1.0), (1.0, 1.0, -1.0), (-1.0, 1.0, 1.0)]


def controllers(table: Table, shape: float, psi: float, signs: Array) -> Complex:
    """C0 at the table's inner columns."""
    v, filter_time = np.asarray(table.v[1:-1]), table.sampling.derivative
    integral, rest = np.exp(-(v + 0.5j * math.pi)), signs[0]
    if filter_time > 0.0:
        rate = 1j * np.exp(v)
        rest = math.cos(shape) * signs[0] + math.sin(shape) * signs[2] * rate / (filter_time * rate + 1.0)
    elif table.sampling.half == 0.0:
        integral = integral**shape
    if table.sampling.half > 0.0:
        found = controller_of(np.array([1.0, 1.0, shape]), table.sampling)
        integral = np.array([complex(*filter_at(found, math.exp(x))) for x in v])
    return np.asarray(math.cos(psi) * rest + math.sin(psi) * signs[1] * integral, dtype=complex)


def cell_of(draws: np.random.Generator, shapes: tuple[float, float]) -> Array:
    """A cell, wide or narrow, sometimes of one shape or at an end of the directions."""
    size = 10.0 ** draws.uniform(-3.0, 0.0)
    middle, reach = draws.uniform(shapes[0] + 0.05, shapes[1] - 0.05), 0.5 * size * draws.choice([0.0, 1.0, 1.0])
    psi, turn = draws.uniform(0.0, 0.5 * math.pi), 0.5 * size
    low, high = max(middle - reach, shapes[0]), min(middle + reach, shapes[1])
    return np.array([low, high, max(psi - turn, 0.0), min(psi + turn, 0.5 * math.pi), 0.0, 0.0])


@pytest.mark.parametrize("name", LOOPS)
def test_loops_of_a_cell_stay_inside_what_is_said_of_it(name: str) -> None:
    table = Problem.of(ft.parse_spec(LOOPS[name])).scan_table
    draws, work, slopes = np.random.default_rng(3), work_for(table), np.empty((SLOPES, len(table.v)))
    linear, wide, with_derivative = 0, 0, table.sampling.derivative > 0.0
    shapes = (0.0, 0.5 * math.pi) if with_derivative else (0.3, 1.7)
    for _ in range(60):
        cell, signs = cell_of(draws, shapes), np.array(SIGNS[int(draws.integers(4 if with_derivative else 2))])
        shape, reach = 0.5 * (cell[0] + cell[1]), 0.5 * (cell[1] - cell[0])
        psi, turn = 0.5 * (cell[2] + cell[3]), 0.5 * (cell[3] - cell[2])
        fill_cell(cell, signs, table, filters_over(*order_over(cell, table.sampling), table.sampling), work, slopes)
        radius, inner = work.high[1:-1].copy(), slopes[:, 1:-1]
        by_shape, by_psi = inner[SHAPE_REAL] + 1j * inner[SHAPE_IMAG], inner[PSI_REAL] + 1j * inner[PSI_IMAG]
        centre = controllers(table, shape, psi, signs)
        places = [(a, b) for a in (-1.0, 1.0) for b in (-1.0, 1.0)]
        places += [tuple(place) for place in draws.uniform(-1.0, 1.0, (12, 2))]
        for a, b in places:
            ratio = controllers(table, shape + a * reach, psi + b * turn, signs) / centre
            change: Complex = np.log(ratio)
            assert (np.abs(ratio - 1.0) <= radius * (1.0 + 1e-9) + 1e-10).all()
            assert (change.real <= inner[UP] + 1e-9).all()
            assert (change.real >= inner[DOWN] - 1e-9).all()
            near = inner[ROOM] < math.pi
            assert (np.abs(change.imag[near]) <= inner[ROOM][near] + 1e-9).all()
            told = inner[REST] < np.inf
            rest = np.abs(change - by_shape * a * reach - by_psi * b * turn)
            assert (rest[told] <= inner[REST][told] * (1.0 + 1e-6)).all()
            assert (np.abs(change[told]) <= inner[SPREAD][told] * (1.0 + 1e-6)).all()
            linear, wide = linear + int(told.sum()), wide + int((~told).sum())
    assert linear > 1000
    assert wide > 100


@pytest.mark.parametrize("signs", SIGNS)
@pytest.mark.parametrize("name", LOOPS)
def test_the_centres_loops_are_those_of_its_ray(name: str, signs: tuple[float, float, float]) -> None:
    table = Problem.of(ft.parse_spec(LOOPS[name])).scan_table
    cell, one, other = np.array([0.8, 1.1, 0.5, 0.7, 0.0, 0.0]), work_for(table), work_for(table)
    filters = filters_over(*order_over(cell, table.sampling), table.sampling)
    fill_cell(cell, np.array(signs), table, filters, one, np.empty((SLOPES, len(table.v))))
    third, c, s = 0.95, math.cos(0.6) * signs[0], math.sin(0.6) * signs[1]
    if table.sampling.derivative > 0.0:
        third, c = math.cos(0.6) * math.sin(0.95) * signs[2], c * math.cos(0.95)
    fill_ray(third, c, s, table, other)
    for name_of in ("gain", "phase"):
        a, b = getattr(one, name_of)[:, 1:-1], getattr(other, name_of)[:, 1:-1]
        np.testing.assert_allclose(a, b, rtol=1e-9, atol=1e-9)


def test_a_cells_centre_on_samples_is_the_loop_of_the_core() -> None:
    problem = Problem.of(ft.parse_spec(LOOPS["oustaloup"]))
    table, k, psi, alpha = problem.scan_table, 0.4, 0.6, 0.95
    cell, signs, work = np.array([0.9, 1.0, 0.55, 0.65, 0.0, 0.0]), np.array([1.0, 1.0]), work_for(table)
    fill_cell(cell, signs, table, filters_over(alpha, 0.05, table.sampling), work, np.empty((SLOPES, len(table.v))))
    gains: FoPi = problem.scale.controller(np.array([k * math.cos(psi), k * math.sin(psi), alpha]))
    loops = problem.loops(gains, problem.spec.plant.nominal_point[None, :])
    columns = np.arange(5, len(table.v) - 30, 7)
    omega = table.omega[columns] * problem.scale.omega_rad_s
    response = loops.response(np.zeros(len(columns), dtype=int), omega)
    found = k * np.exp(work.gain[0, columns] + 1j * work.phase[0, columns])
    np.testing.assert_allclose(found, response, rtol=1e-8)
