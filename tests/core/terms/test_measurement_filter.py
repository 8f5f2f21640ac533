"""A filter of the measurement:  its formulas, loops with it against python-control and against plants that hold it."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.signal import bilinear

from fopi_tune.core.controller import FoPi, FoPid, Pid, controller_of, numbers_of
from fopi_tune.core.loops import Loops, Plants
from fopi_tune.core.margins import margins
from fopi_tune.core.parallel_form import Implementation, Sections
from fopi_tune.core.peaks import Response, extremes, log_response_at
from fopi_tune.core.plant import Plant
from fopi_tune.core.sampled_loops import SampledLoops
from fopi_tune.core.stability import is_stable
from fopi_tune.core.terms.controller_spec import ControllerSpec, GainRange
from fopi_tune.core.terms.measurement_filter import FILTER_NAMES, MeasurementFilter, filter_of
from fopi_tune.errors import DomainError

FILTERS = [MeasurementFilter(1, 0.3), MeasurementFilter(2, 0.3)]
CONTROLLERS = [
    FoPi(1.2, 0.8, 1.0),
    FoPi(0.7, 0.9, 0.6),
    Pid(1.2, 0.8, 0.4, 0.05),
    FoPid(0.9, 0.7, 0.8, 0.3, 0.6, 0.05),
    FoPid(0.0, 0.0, 0.8, 0.3, 0.6, 0.05),
]
#: an integrating one with a dead time, a third-order one, an unstable one, one with a direct path behind a dead time
PLANTS = [
    Plant((1.0,), (1.0, 0.0), 0.2),
    Plant((1.0,), (1.0, 3.0, 3.0, 1.0)),
    Plant((2.0,), (1.0, -0.5)),
    Plant((0.4, 1.0), (1.0, 1.0), 0.3),
]
RESPONSES = (Response.SENSITIVITY, Response.COMPLEMENTARY_SENSITIVITY, Response.LOOP_GAIN)
OMEGA = np.geomspace(1e-3, 1e3, 41)
ONE = np.zeros(len(OMEGA), dtype=np.intp)


def holding(plant: Plant, used: MeasurementFilter) -> Plant:
    """The plant with the filter behind it, written down by hand."""
    time = used.time_constant_s
    divisor = [time, 1.0] if used.order == 1 else [time**2 / 2, time, 1.0]
    return replace(plant, denominator=tuple(np.polymul(plant.denominator, divisor).tolist()))


def test_a_filter_of_order_two_is_flat_as_butterworths_is() -> None:
    size = np.abs(MeasurementFilter(2, 0.3)(1j * OMEGA))
    np.testing.assert_allclose(size, (1.0 + (0.3 * OMEGA) ** 4 / 4.0) ** -0.5, rtol=1e-12)


@pytest.mark.parametrize("used", FILTERS)
def test_the_controller_is_its_terms_times_the_filter(used: MeasurementFilter) -> None:
    s = 1j * OMEGA
    for terms in CONTROLLERS:
        np.testing.assert_allclose(replace(terms, measurement_filter=used)(s), terms(s) * used(s), rtol=1e-13)


@pytest.mark.parametrize("used", FILTERS)
@pytest.mark.parametrize("plant", PLANTS)
def test_the_loop_is_that_of_a_plant_that_holds_the_filter(plant: Plant, used: MeasurementFilter) -> None:
    for terms in CONTROLLERS:
        found = Loops.of(replace(terms, measurement_filter=used), Plants.of(plant))
        wanted = Loops.of(terms, Plants.of(holding(plant, used)))
        np.testing.assert_allclose(found.response(ONE, OMEGA), wanted.response(ONE, OMEGA), rtol=1e-11)
        ours, theirs = (loops.log_response(ONE, np.log(OMEGA)) for loops in (found, wanted))
        # phases that agree count the same turns
        np.testing.assert_allclose(ours, theirs, atol=1e-8)
        assert is_stable(found)[0] == is_stable(wanted)[0]
        for response in RESPONSES:
            largest = [extremes(loops, response, 0.0, np.inf).value[0] for loops in (found, wanted)]
            assert largest[0] == pytest.approx(largest[1], abs=1e-8), (terms, response)
        # |C S| has the filter, which the other loop's controller has not
        noise = log_response_at(wanted, Response.CONTROL_SENSITIVITY, ONE, OMEGA) + np.log(np.abs(used(1j * OMEGA)))
        own = log_response_at(found, Response.CONTROL_SENSITIVITY, ONE, OMEGA)
        np.testing.assert_allclose(own, noise, atol=1e-8)


@pytest.mark.parametrize("used", FILTERS)
def test_margins_of_integer_orders_are_those_of_python_control(used: MeasurementFilter) -> None:
    import control

    s: Any = control.tf("s")
    terms = 1.2 + 0.8 / s + 0.4 * s / (0.05 * s + 1)
    divisor = 1 + 0.3 * s + (used.order - 1) * 0.045 * s**2
    for plant in (Plant((1.0,), (1.0, 3.0, 3.0, 1.0)), Plant((1.0,), (1.0, 1.0, 0.0))):
        loop = terms / divisor * control.tf(list(plant.numerator), list(plant.denominator))
        gain, phase, _, _, crossover, _ = control.stability_margins(loop)
        found = margins(replace(CONTROLLERS[2], measurement_filter=used), plant)
        assert found.phase_margin_deg == pytest.approx(phase, rel=1e-9)
        assert found.crossover_rad_s == pytest.approx(crossover, rel=1e-9)
        assert found.gain_margin_db == pytest.approx(20 * np.log10(gain), rel=1e-9)


@pytest.mark.parametrize("used", FILTERS)
def test_the_loop_on_samples_has_the_filter_by_tustins_rule(used: MeasurementFilter) -> None:
    ts, pid = 0.1, replace(CONTROLLERS[2], measurement_filter=used)
    # 1.2 + 0.8/s and 0.4 s/(0.05 s + 1) with s = (2/Ts)(z - 1)/(z + 1)
    sections = Sections(ts, 1.2 + 0.04 + 4.0, (1.0, 0.0), (0.08, -4.0))
    loops = SampledLoops.implemented(pid, Implementation(sections, 0.5), Plants.of(PLANTS[1]))
    bare = SampledLoops.implemented(CONTROLLERS[2], Implementation(sections, 0.5), Plants.of(PLANTS[1]))
    omega = np.geomspace(1e-2, 0.99 * np.pi / ts, 40)
    time = used.time_constant_s
    b, a = bilinear([1.0], [time, 1.0] if used.order == 1 else [time**2 / 2, time, 1.0], 1.0 / ts)
    z = np.exp(1j * omega * ts)
    by_hand = np.asarray(np.polyval(np.asarray(b), z) / np.polyval(np.asarray(a), z), dtype=complex)
    rows = np.zeros(len(omega), dtype=np.intp)
    np.testing.assert_allclose(loops.response(rows, omega), bare.response(rows, omega) * by_hand, rtol=1e-9)
    ours = np.exp(loops.log_response(rows, loops.u_of(omega)))
    np.testing.assert_allclose(ours, bare.response(rows, omega) * by_hand, rtol=1e-8)
    noise = log_response_at(bare, Response.CONTROL_SENSITIVITY, rows, omega)
    s, filtered = (1.0 / (1.0 + each.response(rows, omega)) for each in (bare, loops))
    wanted = noise + np.log(np.abs(filtered / s * by_hand))
    np.testing.assert_allclose(log_response_at(loops, Response.CONTROL_SENSITIVITY, rows, omega), wanted, atol=1e-8)


@pytest.mark.parametrize("used", [None, *FILTERS])
def test_a_controller_survives_its_numbers(used: MeasurementFilter | None) -> None:
    for terms in CONTROLLERS:
        controller = replace(terms, measurement_filter=used)
        assert controller_of(numbers_of(controller)) == controller


def test_numbers_of_half_a_filter_are_refused() -> None:
    with pytest.raises(DomainError, match="one of them is missing"):
        controller_of({"kp": 1.0, "ki": 1.0, "alpha": 1.0, "measurement_filter_order": 1})


@pytest.mark.parametrize(("order", "time_s"), [(3, 0.1), (0, 0.1), (1, 0.0), (2, -1.0), (1, np.inf)])
def test_filters_that_are_none_are_refused(order: int, time_s: float) -> None:
    with pytest.raises(DomainError):
        MeasurementFilter(order, time_s)


def test_another_filter_is_another_structure() -> None:
    free = GainRange()
    box = ControllerSpec(free, free, free, measurement_filter=FILTERS[0])
    assert box.has_structure_of(box.controller(1.0, 2.0, 0.5))
    for used in (None, FILTERS[1], MeasurementFilter(1, 0.4)):
        assert not box.has_structure_of(FoPi(1.0, 2.0, 0.5, measurement_filter=used))


def test_a_controller_names_its_filter_only_where_it_has_one() -> None:
    assert repr(FoPi(1.0, 2.0, 0.5)) == "FoPi(kp=1.0, ki=2.0, alpha=0.5)"
    assert "order=1, time_constant_s=0.3" in repr(FoPi(1.0, 2.0, 0.5, measurement_filter=FILTERS[0]))


@pytest.mark.parametrize("order", [True, 0, 3, 1.5, "1"])
def test_a_filter_of_another_order_is_refused(order: Any) -> None:
    with pytest.raises(DomainError, match="is not known; take 1 or 2"):
        MeasurementFilter(order, 0.1)


@pytest.mark.parametrize("time_constant_s", ["a", True, None, 0.0, -1.0, math.nan, math.inf, 1e300, 1e-300])
def test_a_filters_time_that_cannot_be_computed_with_is_refused(time_constant_s: Any) -> None:
    with pytest.raises(DomainError, match="time_constant_s"):
        MeasurementFilter(1, time_constant_s)


@pytest.mark.parametrize("used", [(1, 0.1), 0.1, "first order"])
def test_a_controller_refuses_what_is_no_filter(used: Any) -> None:
    with pytest.raises(DomainError, match="give a MeasurementFilter"):
        FoPi(1.0, 1.0, 1.0, measurement_filter=used)


def test_an_order_is_a_whole_number_however_it_is_given() -> None:
    assert repr(MeasurementFilter(np.float64(2.0), 0.1)) == "MeasurementFilter(order=2, time_constant_s=0.1)"  # type: ignore[arg-type]
    with pytest.raises(DomainError, match="order 3 is not known"):
        filter_of(dict(zip(FILTER_NAMES, (3.0, 0.1), strict=True)))
