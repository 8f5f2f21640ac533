"""The measurement's filter in the controller's arithmetic:  Tustin's rule, measurements at rest, rounding, refusals."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import bilinear, lfilter

from fopi_tune.core.controller import FoPi, Pid
from fopi_tune.core.terms.measurement_filter import MeasurementFilter
from fopi_tune.digital import discretize, sections_of
from fopi_tune.digital.coefficients import SampledFilter
from fopi_tune.digital.discretize import FILTER_TERM, to_document
from fopi_tune.digital.realise import Precision
from fopi_tune.digital.runtime import Runtime, init, reset, step, track
from fopi_tune.digital.vectors import Op, Operation, replay
from fopi_tune.errors import DomainError
from fopi_tune.spec.model import DigitalSpec

TS = 0.1
#: as slow as half a sample and as a thousand samples
TIMES = [0.05, 0.3, 2.0, 100.0]
PROPORTIONAL = FoPi(-1.0, 0.0, 1.0)
PID = Pid(2.0, 1.0, 0.8, 0.15)


def made(gains: FoPi, used: MeasurementFilter | None, precision: Precision = Precision.FLOAT64) -> Runtime:
    return Runtime.of(sections_of(gains, DigitalSpec(TS)), precision, measurement_filter=used)


def passed(used: MeasurementFilter, signal: np.ndarray, precision: Precision = Precision.FLOAT64) -> np.ndarray:
    """What a filter makes of a measurement: the output of a gain of -1."""
    rows = [Operation(Op.STEP, 0.0, float(y)) for y in signal]
    return np.array(replay(made(PROPORTIONAL, used, precision), [Operation(Op.INIT), *rows]))[1:]


def by_hand(used: MeasurementFilter, signal: np.ndarray) -> np.ndarray:
    """SciPy's bilinear transform as a difference equation, at rest before at the first value."""
    time = used.time_constant_s
    divisor = [time, 1.0] if used.order == 1 else [time**2 / 2, time, 1.0]
    b, a = (np.asarray(row) for row in bilinear([1.0], divisor, 1.0 / TS))
    return signal[0] + np.asarray(lfilter(b, a, signal - signal[0]))


@pytest.mark.parametrize("order", [1, 2])
@pytest.mark.parametrize("time_s", TIMES)
def test_the_filter_is_tustins(order: int, time_s: float) -> None:
    used = MeasurementFilter(order, time_s)
    signal = 3.0 + np.random.default_rng(2).normal(size=4000)
    wanted = by_hand(used, signal)
    # a polynomial with roots close to 1 loses digits in SciPy's form
    np.testing.assert_allclose(passed(used, signal), wanted, atol=1e-8)
    single = passed(used, signal, Precision.FLOAT32)
    # of a thousand samples 3.8e-6 were seen on 20,000 of such noise
    assert np.abs(single - wanted).max() < 5e-6 * np.abs(wanted).max()


@pytest.mark.parametrize("order", [1, 2])
@pytest.mark.parametrize("time_s", TIMES)
@pytest.mark.parametrize("precision", list(Precision))
def test_a_measurement_at_rest_passes_as_it_is(order: int, time_s: float, precision: Precision) -> None:
    value = float(np.float32(0.1))
    found = passed(MeasurementFilter(order, time_s), np.full(500, value), precision)
    assert np.all(found == value)


@pytest.mark.parametrize("order", [1, 2])
def test_the_controller_acts_on_what_the_filter_makes(order: int) -> None:
    used = MeasurementFilter(order, 0.3)
    signal = np.random.default_rng(5).normal(size=300)
    filtered = by_hand(used, signal)
    own = replay(made(PID, used), [Operation(Op.STEP, 1.0, float(y)) for y in signal])
    bare = replay(made(PID, None), [Operation(Op.STEP, 1.0, float(y)) for y in filtered])
    # the same up to the rounding of the two filters
    np.testing.assert_allclose(own, bare, atol=1e-9)


@pytest.mark.parametrize("order", [1, 2])
def test_a_sample_that_is_not_finite_leaves_the_filter_as_it_was(order: int) -> None:
    runtime = made(PID, MeasurementFilter(order, 0.3))
    state = step(runtime, step(runtime, init(runtime), 1.0, 0.3), 1.0, 0.7)
    for held in (step(runtime, state, 1.0, np.nan), track(runtime, state, 1.0, np.inf, 0.0)):
        assert held is state
    fresh = reset(runtime, 0.5)
    assert step(runtime, fresh, 1.0, np.nan).is_new


@pytest.mark.parametrize("order", [1, 2])
def test_tracking_goes_on_filtering(order: int) -> None:
    runtime = made(PID, MeasurementFilter(order, 0.3))
    state = step(runtime, init(runtime), 0.0, 2.0)
    tracked, stepped = track(runtime, state, 0.0, 1.0, 0.3), step(runtime, state, 0.0, 1.0)
    assert tracked.lagged is not None
    assert stepped.lagged is not None
    assert tracked.lagged.tobytes() == stepped.lagged.tobytes()


def test_a_filter_faster_than_half_a_sample_is_refused() -> None:
    with pytest.raises(DomainError, match=r"below half the sample time, 0\.05 s"):
        SampledFilter.of(MeasurementFilter(1, 0.049), TS, Precision.FLOAT64)
    with pytest.raises(DomainError, match="below half the sample time"):
        discretize(replace(PID, measurement_filter=MeasurementFilter(2, 0.04)), DigitalSpec(TS))


@pytest.mark.parametrize("order", [1, 2])
def test_a_filter_that_a_precision_loses_is_refused(order: int) -> None:
    with pytest.raises(DomainError, match="float32 loses"):
        discretize(replace(PID, measurement_filter=MeasurementFilter(order, 1e7)), DigitalSpec(TS))


@pytest.mark.parametrize("order", [1, 2])
def test_the_filters_error_is_stated_and_is_that_of_the_bent_frequency(order: int) -> None:
    used = MeasurementFilter(order, 0.3)
    found = discretize(replace(PID, measurement_filter=used), DigitalSpec(TS))
    errors = dict(found.errors_of_terms[FILTER_TERM])
    omega = next(iter(errors))
    bent = 2.0 / TS * np.tan(0.5 * omega * TS)
    wanted = abs(complex(used(1j * bent)) / complex(used(1j * omega)) - 1.0)
    # read at the last frequency of a grid below
    assert 0.95 * wanted <= errors[omega] <= wanted
    # at Nyquist's frequency nothing passes
    assert found.errors[-1][1] >= 0.999
    entry = to_document(found)["measurement_filter"]
    assert (entry["order"], entry["rule"], entry["acts_on"]) == (order, "tustin", "measurement")
