"""Plants from python-control:  coefficients copied or exact, and what is no plant refused by name."""

from __future__ import annotations

from typing import Any

import control
import numpy as np
import pytest

from fopi_tune.core.plant import Plant
from fopi_tune.errors import DomainError


def response(plant: Plant, omega: Any) -> Any:
    s = 1j * omega
    return np.polyval(plant.numerator, s) / np.polyval(plant.denominator, s) * np.exp(-s * plant.dead_time_s)


def test_coefficients_of_a_transfer_function_are_copied() -> None:
    found = Plant.from_control(control.tf([0, 4.39, 0.1], [0, 1, -0.1746, 3]), dead_time_s=0.3)
    assert found == Plant((4.39, 0.1), (1.0, -0.1746, 3.0), 0.3)


def test_a_state_space_has_the_frequency_response_of_its_coefficients() -> None:
    rng = np.random.default_rng(3)
    for states in (1, 2, 5, 12):
        a, b, c = rng.standard_normal((states, states)), rng.standard_normal(states), rng.standard_normal(states)
        system = control.ss(a, b[:, None], c[None, :], 0.7 if states % 2 else 0.0)
        omega = np.geomspace(0.01, 100.0, 40)
        expected = np.array([complex(system(1j * w)) for w in omega])
        # python-control solves a system of at most 12 equations; its condition costs a few of the 16 digits
        np.testing.assert_allclose(response(Plant.from_control(system), omega), expected, rtol=1e-9)


def test_integrators_and_the_relative_degree_survive_other_coordinates() -> None:
    # (s + 1)^2/(s^2 (s + 3)) and 1/(s^3 (s + 1)), whose poles at 0 are numbers near 1e-8 to an eigenvalue solver
    rng = np.random.default_rng(1)
    for top, bottom in (([1, 2, 1], [1, 3, 0, 0]), ([1], [1, 1, 0, 0, 0])):
        n = len(bottom) - 1
        a = np.eye(n, k=1)
        a[-1] = -np.array(bottom[:0:-1])
        c = np.array([*top[::-1], *[0] * (n - len(top))], dtype=float)
        moved = rng.standard_normal((n, n))
        back = np.linalg.inv(moved)
        found = Plant.from_control(control.ss(moved @ a @ back, moved[:, -1:], (c @ back)[None, :], 0.0))
        assert len(found.numerator) == len(top)
        assert [value == 0.0 for value in found.denominator] == [value == 0 for value in bottom]
        # the coordinates are rounded to 16 digits, and inverted
        np.testing.assert_allclose(found.denominator, bottom, rtol=1e-10)
        np.testing.assert_allclose(found.numerator, top, rtol=1e-10)


def test_a_stiff_state_space_keeps_its_small_coefficients() -> None:
    # chains of lags over 12 decades: the product of the rates is what an expanded matrix loses
    rates = np.array([1e-6, 1e-3, 1.0, 1e3, 1e6])
    a = np.diag(-rates) + np.diag(rates[1:], k=-1)
    found = Plant.from_control(control.ss(a, np.eye(5)[:, :1], np.eye(5)[-1:], 0.0))
    # what np.poly makes of the rates is exact to a few digits of each coefficient, as all of them are positive
    np.testing.assert_allclose(found.denominator, np.poly(-rates), rtol=1e-13)
    assert len(found.numerator) == 1
    assert found.numerator[0] == pytest.approx(1e6 * 1e3 * 1e-3, rel=1e-14)


@pytest.mark.parametrize(
    ("system", "said"),
    [
        (control.tf([1], [1, 2], 0.1), "this TransferFunction is in discrete time (dt = 0.1)"),
        (control.ss([[0.5]], [[1.0]], [[1.0]], 0.0, True), "this StateSpace is in discrete time (dt = True)"),
        (control.tf([1, 0, 0], [1, 2]), "this TransferFunction is improper: the numerator's degree 2 exceeds"),
        (control.tf([[[1], [1]]], [[[1, 2], [1, 3]]]), "has 1 output and 2 inputs; give one of its entries"),
        (
            control.frd([1, 2], [1, 2]),
            "an object of type FrequencyResponseData is no plant; give a TransferFunction or StateSpace",
        ),
        ("4.39/(s+1)", "an object of type str is no plant"),
        (control.tf([0], [1, 1]), "the numerator is 0"),
        (control.ss(-np.eye(40), np.ones((40, 1)), np.ones((1, 40)), 0.0), "has 40 states; reduce it"),
    ],
)
def test_what_is_no_plant_is_refused_by_its_name(system: Any, said: str) -> None:
    with pytest.raises(DomainError) as caught:
        Plant.from_control(system)
    assert said in str(caught.value)


def test_a_negative_dead_time_is_refused() -> None:
    with pytest.raises(DomainError, match="dead_time_s = -1"):
        Plant.from_control(control.tf([1], [1, 2]), -1.0)
