"""The filter as a function of its order: against the exported filter's sections, and against differences."""

from __future__ import annotations

import numpy as np
import pytest
from flint import acb, arb

from fopi_tune.core.controller import FoPi
from fopi_tune.core.terms.digital_spec import DigitalSpec
from fopi_tune.digital.discretize import sections_of
from fopi_tune.optimum.samples.filter_of_order import FilterOfOrder

CASES = [
    DigitalSpec(0.2, "oustaloup", 7, (1e-3, 1e3)),
    DigitalSpec(0.05, "modified_oustaloup", 5, (1e-2, 40.0)),
    DigitalSpec(1e-5, "oustaloup", 1, (1e2, 1e5)),
    DigitalSpec(600.0, "modified_oustaloup", 2, (1e-6, 1e-2)),
]
ORDERS = (0.05, 0.6, 1.0, 1.37, 1.9)


def number(ball: acb) -> complex:
    return complex(float(ball.real.mid()), float(ball.imag.mid()))


@pytest.mark.parametrize("digital", CASES, ids=lambda d: f"{d.method} {d.poles}")
@pytest.mark.parametrize("alpha", ORDERS)
def test_the_value_is_that_of_the_exported_sections(digital: DigitalSpec, alpha: float) -> None:
    omega = np.array([1e-6, 1e-3, 0.2, 0.9, 0.999]) * np.pi / digital.sample_time_s
    wanted = sections_of(FoPi(0.0, 1.0, alpha), digital).response(omega)
    nu, filtered = np.tan(0.5 * omega * digital.sample_time_s), FilterOfOrder(digital)
    at = filtered.at_order(arb(alpha))
    balls = [at.value(acb(0, arb(float(x)))) for x in nu]
    # the sections' poles near 1 are rounded
    np.testing.assert_allclose([number(ball) for ball in balls], wanted, rtol=1e-8)
    floats = filtered.in_floats(1j * nu, np.full(len(nu), alpha))[0]
    np.testing.assert_allclose(floats, [number(ball) for ball in balls], rtol=1e-10)
    direct, pairs = at.sections(arb(0.7), arb(1.0))
    sums = [sum((rho / (acb(0, arb(float(x))) + sigma) for sigma, rho in pairs), acb(direct) - arb(0.7)) for x in nu]
    np.testing.assert_allclose([number(ball) for ball in sums], [number(ball) for ball in balls], rtol=1e-7)


@pytest.mark.parametrize("digital", CASES, ids=lambda d: f"{d.method} {d.poles}")
@pytest.mark.parametrize("alpha", ORDERS)
@pytest.mark.parametrize("w", [0.003j, 0.4j, 30j, 0.2])
def test_the_derivatives_are_those_of_differences(digital: DigitalSpec, alpha: float, w: complex) -> None:
    filtered, step = FilterOfOrder(digital), 1e-4
    s = acb(arb(w.real), arb(w.imag))
    orders = alpha + step * np.arange(-2, 3)
    below, own, above = (filtered.at_order(arb(float(order))) for order in orders[1:4])
    one, two, three = own.log_derivatives(s)
    scale = 1.0 + sum(abs(number(each)) for each in (one, two, three))
    first = (number(above.log_derivatives(s)[0]) - number(below.log_derivatives(s)[0])) / (2.0 * step)
    second = (number(above.log_derivatives(s)[1]) - number(below.log_derivatives(s)[1])) / (2.0 * step)
    third = (number(above.log_derivatives(s)[2]) - number(below.log_derivatives(s)[2])) / (2.0 * step)
    value = np.log(number(above.value(s)) / number(below.value(s))) / (2.0 * step)
    room = 1e-4 * scale * (1.0 + 1.0 / alpha**5)
    assert number(one) == pytest.approx(value, abs=room)
    assert number(two) == pytest.approx(first, abs=room)
    assert number(three) == pytest.approx(second, abs=room)
    assert number(own.fourth_derivative(s)) == pytest.approx(third, abs=room)
    _, in_floats, bend = filtered.in_floats(np.array([w], dtype=complex), np.array([alpha]))
    assert number(one) == pytest.approx(in_floats[0], rel=1e-9, abs=1e-9)
    assert number(two) == pytest.approx(bend[0], rel=1e-8, abs=1e-8)


@pytest.mark.parametrize("digital", CASES[:2], ids=lambda d: f"{d.method} {d.poles}")
@pytest.mark.parametrize("alpha", ORDERS)
def test_slopes_along_the_axis_are_those_of_differences(digital: DigitalSpec, alpha: float) -> None:
    filtered, step = FilterOfOrder(digital), 1e-5
    own = filtered.at_order(arb(alpha))
    below, above = filtered.at_order(arb(alpha - step)), filtered.at_order(arb(alpha + step))
    for u in (-5.0, -1.0, 0.5, 3.0):
        near = [acb(0, arb(u + shift).exp()) for shift in (-step, 0.0, step)]
        slope, first, second = own.slopes(near[1])
        wanted = np.log(number(own.value(near[2])) / number(own.value(near[0]))) / (2.0 * step)
        assert number(slope) == pytest.approx(wanted, abs=1e-7)
        assert number(own.slope(near[1])) == pytest.approx(number(slope), abs=1e-12)
        turn = (number(above.slope(near[1])) - number(below.slope(near[1]))) / (2.0 * step)
        bend = (number(above.slopes(near[1])[1]) - number(below.slopes(near[1])[1])) / (2.0 * step)
        room = 1e-6 * (1.0 + 1.0 / alpha**4)
        assert number(first) == pytest.approx(turn, abs=room)
        assert number(second) == pytest.approx(bend, abs=room)


def test_a_controller_without_integral_has_no_sections() -> None:
    assert FilterOfOrder(CASES[0]).at_order(arb(0.8)).sections(arb(2), arb(0)) == (arb(2), ())
