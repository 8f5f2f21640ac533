"""Lags from step responses: exact data, SciPy's covariance, the intervals' coverage, what a recording cannot tell."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.optimize import curve_fit
from scipy.stats import t as student

from fopi_tune.errors import DomainError
from fopi_tune.identification import (
    CONFIDENCE,
    Fit,
    Interval,
    Recording,
    fit_plant,
    identify_recordings,
    parse_recording,
)

Array = NDArray[np.float64]
HEADER = "time_s,input,output\n"


def response(time: Array, y0: float, change: float, tau: float, dead: float) -> Array:
    """Of a lag to a step at time 0."""
    return y0 + np.where(time > dead, change * (1 - np.exp(-np.maximum(time - dead, 0) / tau)), 0.0)


def recording(
    gain: float = 2.0,
    tau: float = 5.0,
    dead: float = 1.03,
    y0: float = 3.0,
    step: float = 0.5,
    n: int = 100,
    length_s: float = 40.0,
    first: int = 10,
    name: str = "a.csv",
    noise: Array | float = 0.0,
) -> Recording:
    time = np.linspace(0.0, length_s, n)
    return stepped(time, response(time - time[first], y0, gain * step, tau, dead) + noise, first, step, name)


def stepped(time: Array, output: Array, first: int, step: float = 1.0, name: str = "a.csv") -> Recording:
    """A recording whose input steps from 0 on the row `first`."""
    return Recording(name, time, np.where(np.arange(len(time)) < first, 0.0, step), output)


def text_of(time: Array, moved: Array, output: Array) -> str:
    rows = zip(time.tolist(), moved.tolist(), output.tolist(), strict=True)
    return HEADER + "".join(f"{t!r},{u!r},{y!r}\n" for t, u, y in rows)


def numbers(fit: Fit) -> tuple[Interval, Interval, Interval]:
    return fit["static_gain"], fit["time_constant_s"], fit["dead_time_s"]


def later(given: Recording, rows: int) -> Recording:
    """The same with an input that steps some rows later."""
    return replace(given, input=np.concatenate([np.zeros(rows), given.input[:-rows]]))


GAP_S = 40.0 / 99


def since(given: Recording) -> Array:
    """Times from the first line with the new input on."""
    return given.time_s - given.time_s[np.flatnonzero(given.input)[0]]


# -- exact data --------------------------------------------------------------------------------------------------------


@pytest.mark.thinned(3)
@pytest.mark.parametrize(
    ("gain", "tau", "dead", "y0", "step", "n", "length_s"),
    [
        (2.0, 5.0, 1.03, 3.0, 0.5, 100, 40.0),
        (-3.0, 5.0, 0.0, -20.0, 0.5, 100, 40.0),
        (25.1, 5.73, 0.2, 30.0, -0.1, 300, 60.0),  # a step down
        (2.0, 0.3, 7.0, 0.0, 1.0, 800, 40.0),  # mostly dead time
        (2.0, 25.0, 1.03, 0.0, 1.0, 200, 40.0),  # ends before it settles
        (1e-6, 2e-3, 1e-3, 1e-3, 1e3, 200, 2e-2),
        (1e4, 7e3, 2e3, 1e6, 1e-2, 200, 4e4),
    ],
)
def test_exact_data_give_the_plant_back(
    gain: float, tau: float, dead: float, y0: float, step: float, n: int, length_s: float
) -> None:
    fit = fit_plant(recording(gain, tau, dead, y0, step, n, length_s))
    # 1e-6 is asked for; y0 = 1e6 over a change of 100 leaves 12 digits of the data
    assert fit["static_gain"].value == pytest.approx(gain, rel=1e-6)
    assert fit["time_constant_s"].value == pytest.approx(tau, rel=1e-6)
    assert fit["dead_time_s"].value == pytest.approx(dead, rel=1e-6, abs=1e-6 * tau)
    # the step may have come up to one line earlier, which the dead time's upper end knows
    gap_s = length_s / (n - 1)
    widths = [each.high - each.low for each in numbers(fit)]
    for each, width, expected in zip(numbers(fit), widths, (0.0, 0.0, gap_s), strict=True):
        assert width == pytest.approx(expected, abs=1e-6 * max(abs(each.value), tau))
    assert fit.notes == ()


def test_a_plant_that_is_stepped_from_sample_to_sample_is_found() -> None:
    # the oracle: y[k+1] = a y[k] + (1 - a) K u[k - d], exact for a held input
    dt, tau, gain, delay = 0.1, 1.7, 0.8, 4
    moved = np.where(np.arange(120) < 15, 2.0, 3.5)
    output, decay = np.full(120, gain * 2.0), math.exp(-dt / tau)
    for k in range(119):
        output[k + 1] = decay * output[k] + (1 - decay) * gain * moved[max(k - delay, 0)]
    fit = fit_plant(parse_recording(text_of(dt * np.arange(120.0), moved, output), "held.csv"))
    found = [each.value for each in numbers(fit)]
    assert found == pytest.approx([gain, tau, delay * dt], rel=1e-6)


def test_the_times_need_not_be_equally_spaced() -> None:
    rng = np.random.default_rng(2)
    time = np.sort(rng.uniform(0, 40, 90))
    output = response(time - time[9], 1.0, 2.0, 4.0, 0.7)
    fit = fit_plant(stepped(time, output, 9))
    assert [each.value for each in numbers(fit)] == pytest.approx([2.0, 4.0, 0.7], rel=1e-6)


# -- noise -------------------------------------------------------------------------------------------------------------


def test_the_intervals_are_those_of_scipys_curve_fit() -> None:
    rng = np.random.default_rng(4)
    given = recording(noise=0.02 * rng.standard_normal(100))
    fit = fit_plant(given)
    time = since(given)

    def with_own_motion(time: Array, y0: float, change: float, tau: float, dead: float, own: float) -> Array:
        return response(time, y0, change, tau, dead) + own * np.exp(-(time - time[0]) / tau)

    values, covariance = curve_fit(with_own_motion, time, given.output, p0=[3.0, 1.0, 5.0, 1.03, 0.0])
    half = student.ppf(0.5 + CONFIDENCE / 2, 95) * np.sqrt(np.diag(covariance))
    scale = np.array([0.5, 1.0, 1.0])
    # curve_fit stops at its 1e-8 and takes finite differences; its dead time moves within the gap between two samples
    found = np.array([[each.value, each.high - each.value] for each in numbers(fit)])
    assert found[:, 0] * scale == pytest.approx(values[1:4], rel=1e-4)
    assert found[:, 1] * scale == pytest.approx(half[1:4] + np.array([0, 0, GAP_S]), rel=1e-3)


def held_in(fits: Sequence[Fit], truth: tuple[float, float, float]) -> Array:
    """How many fits' intervals hold each of the numbers."""
    inside = [[each.low <= true <= each.high for each, true in zip(numbers(fit), truth, strict=True)] for fit in fits]
    return np.sum(inside, axis=0)


@pytest.mark.long
def test_the_intervals_hold_the_truth_in_95_percent_of_the_recordings() -> None:
    rng = np.random.default_rng(8)
    fits = [fit_plant(recording(noise=0.02 * rng.standard_normal(100))) for _ in range(400)]
    # The dead time's interval reaches further up, by a gap between lines that is many deviations of the fit, for a step
    # that came between them: with the step on a line only its lower end can miss, in 2.5 %.
    # The count is binomial, with a standard deviation of sqrt(0.95 0.05/400) = 1.1 %; three numbers, four deviations.
    assert held_in(fits, (2.0, 5.0, 1.03)) / 400 == pytest.approx([0.95, 0.95, 0.975], abs=0.044)


@pytest.mark.parametrize(
    ("dead", "count"), [(0.1, 20), *(pytest.param(dead, 200, marks=pytest.mark.long) for dead in (0.1, 1.03))]
)
def test_the_intervals_hold_the_truth_wherever_between_two_lines_the_step_comes(dead: float, count: int) -> None:
    rng = np.random.default_rng(12)
    fits: list[Fit] = []
    for phase in rng.uniform(0, 1, count):
        given = recording(dead=dead, noise=0.02 * rng.standard_normal(100))
        # the output of a step that came before the first line with the new input by a share of the gap
        earlier = response(since(given) + phase * GAP_S, 3.0, 1.0, 5.0, dead)
        now = response(since(given), 3.0, 1.0, 5.0, dead)
        fits.append(fit_plant(replace(given, output=given.output - now + earlier)))
    # a step may also come on a line, where the dead time's lower end misses in 2.5 %; so at least 95 %, less four
    # standard deviations of the count, with 200 of them sqrt(0.95 0.05/200) = 1.5 %.
    assert np.all(held_in(fits, (2.0, 5.0, dead)) / count >= 0.95 - 4 * math.sqrt(0.95 * 0.05 / count))


@pytest.mark.parametrize("count", [2, pytest.param(10, marks=pytest.mark.long)])
def test_no_other_dead_time_fits_better(count: int) -> None:
    # brute force over the dead time, in which the sum of squares has a kink at every sample
    rng = np.random.default_rng(5)
    for _ in range(count):
        given = recording(n=60, noise=0.1 * rng.standard_normal(60))
        fit = fit_plant(given)
        least = fit.residual_std**2 * 55
        time = since(given)
        for dead in np.linspace(0, 3, 61):
            for tau in fit["time_constant_s"].value * np.linspace(0.7, 1.3, 61):
                own = np.exp(-(time - time[0]) / tau)
                shape = np.column_stack([np.ones(60), own, response(time, 0, 1, tau, dead)])
                left = np.linalg.lstsq(shape, given.output, rcond=None)[1]
                assert left[0] >= least * (1 - 1e-9)  # rounding of two ways to sum


def test_a_step_just_after_the_last_old_line_is_a_dead_time_of_0_and_no_mistake() -> None:
    given = recording(dead=0.0)
    fit = fit_plant(later(given, 1))
    assert fit["dead_time_s"].value == fit["dead_time_s"].low == 0.0
    assert fit["dead_time_s"].high == pytest.approx(0.0, abs=1e-6)
    assert (fit["static_gain"].value, fit["time_constant_s"].value) == pytest.approx((2.0, 5.0), rel=1e-6)
    assert fit.notes == ()


def test_a_dead_time_below_0_becomes_0_and_says_so() -> None:
    given = recording(dead=0.0)
    fit = fit_plant(later(given, 2))
    assert fit["dead_time_s"].value == fit["dead_time_s"].low == 0.0
    assert "below 0 by more than the time between two lines; 0 is taken" in fit.notes[0]
    assert any("output moves before the input" in note for note in fit.notes)


def test_a_dead_time_that_noise_makes_negative_keeps_its_upper_end() -> None:
    rng = np.random.default_rng(3)
    # the step comes right after the last old line: without dead time the fit falls on either side of the least one
    given = [recording(dead=0.0, noise=0.05 * rng.standard_normal(100)) for _ in range(12)]
    fits = [fit_plant(later(each, 1)) for each in given]
    noted = [fit for fit in fits if fit.notes]
    assert 0 < len(noted) < len(fits)
    assert all(fit["dead_time_s"].value == fit["dead_time_s"].low == 0.0 for fit in noted)
    assert any(fit["dead_time_s"].high > 0.0 for fit in noted)


def test_a_plant_that_is_no_lag_is_noted() -> None:
    time = np.linspace(0.0, 40.0, 200)
    late = np.maximum(time - time[20], 0.0)
    second_order = 1.0 - (1.0 + late / 3.0) * np.exp(-late / 3.0)
    fit = fit_plant(stepped(time, second_order, 20))
    assert "no independent noise" in fit.notes[0]
    rng = np.random.default_rng(1)
    assert fit_plant(recording(noise=0.02 * rng.standard_normal(100))).notes == ()


# -- what cannot be told -----------------------------------------------------------------------------------------------


@pytest.mark.thinned(slow=["on the rise", "longer"])
@pytest.mark.parametrize(
    ("given", "said"),
    [
        (lambda rng: recording(gain=0.0), "does not move"),
        (lambda rng: recording(gain=1e-3, noise=0.05 * rng.standard_normal(100)), ""),
        (lambda rng: recording(tau=400.0), "longer than the record"),
        (lambda rng: recording(first=96, tau=0.2, dead=0.0), "samples from the step on"),
        (lambda rng: recording(tau=0.05, dead=0.0), "samples lie on the rise"),
        (lambda rng: recording(tau=0.4, dead=0.0, n=60, noise=0.3 * rng.standard_normal(60)), ""),
    ],
)
def test_what_a_recording_cannot_tell_is_named_with_the_file(
    given: Callable[[np.random.Generator], Recording], said: str
) -> None:
    with pytest.raises(DomainError, match=r"^a\.csv: .*(record|sample faster)") as caught:
        fit_plant(given(np.random.default_rng(6)))
    assert said in str(caught.value)


# -- families ----------------------------------------------------------------------------------------------------------


def test_three_recordings_give_a_family_that_holds_each_plant() -> None:
    plants = [(2.0, 5.0, 1.0), (2.2, 4.0, 0.8), (1.9, 7.0, 1.1)]
    family = identify_recordings([recording(*plant, name=f"{k}.csv") for k, plant in enumerate(plants)])
    boxes = (family["static_gain"], family["time_constant_s"], family["dead_time_s"])
    for plant in plants:
        # exact data: the lower ends differ from the values by rounding
        assert all(box.min * (1 - 1e-9) <= x <= box.max * (1 + 1e-9) for box, x in zip(boxes, plant, strict=True))
    assert [box.nominal for box in boxes] == pytest.approx([2.0, 5.0, 1.0], rel=1e-6)
    gap_s = 40.0 / 99  # in which the step may have come
    assert [box.max - box.min for box in boxes] == pytest.approx([0.3, 3.0, 0.3 + gap_s], rel=1e-6)
    assert [fit.name for fit in family.fits] == ["0.csv", "1.csv", "2.csv"]


@pytest.mark.long
def test_a_family_holds_the_interval_of_every_fit() -> None:
    rng = np.random.default_rng(9)
    family = identify_recordings([recording(noise=0.05 * rng.standard_normal(100)) for _ in range(4)])
    for fit in family.fits:
        for box, each in zip(
            (family["static_gain"], family["time_constant_s"], family["dead_time_s"]), numbers(fit), strict=True
        ):
            assert box.min <= each.low <= each.value <= each.high <= box.max


def test_gains_of_both_signs_and_no_recording_are_refused() -> None:
    with pytest.raises(DomainError, match=r"2 in up\.csv and -2 in down\.csv"):
        identify_recordings([recording(name="up.csv"), recording(-2.0, name="down.csv")])
    with pytest.raises(DomainError, match="at least one"):
        identify_recordings([])
