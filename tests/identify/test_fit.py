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
from fopi_tune.identify import CONFIDENCE, Interval, LagFit, Recording, fit_lag, identify_lag, parse_recording

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
    return Recording(name, time, response(time - time[first], y0, gain * step, tau, dead) + noise, first, step)


def text_of(time: Array, moved: Array, output: Array) -> str:
    rows = zip(time.tolist(), moved.tolist(), output.tolist(), strict=True)
    return HEADER + "".join(f"{t!r},{u!r},{y!r}\n" for t, u, y in rows)


def numbers(fit: LagFit) -> tuple[Interval, Interval, Interval]:
    return fit.static_gain, fit.time_constant_s, fit.dead_time_s


# -- exact data --------------------------------------------------------------------------------------------------------


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
    fit = fit_lag(recording(gain, tau, dead, y0, step, n, length_s))
    # 1e-6 is asked for; y0 = 1e6 over a change of 100 leaves 12 digits of the data
    assert fit.static_gain.value == pytest.approx(gain, rel=1e-6)
    assert fit.time_constant_s.value == pytest.approx(tau, rel=1e-6)
    assert fit.dead_time_s.value == pytest.approx(dead, rel=1e-6, abs=1e-6 * tau)
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
    fit = fit_lag(parse_recording(text_of(dt * np.arange(120.0), moved, output), "held.csv"))
    found = [each.value for each in numbers(fit)]
    assert found == pytest.approx([gain, tau, delay * dt], rel=1e-6)


def test_the_times_need_not_be_equally_spaced() -> None:
    rng = np.random.default_rng(2)
    time = np.sort(rng.uniform(0, 40, 90))
    output = response(time - time[9], 1.0, 2.0, 4.0, 0.7)
    fit = fit_lag(Recording("a.csv", time, output, 9, 1.0))
    assert [each.value for each in numbers(fit)] == pytest.approx([2.0, 4.0, 0.7], rel=1e-6)


# -- noise -------------------------------------------------------------------------------------------------------------


def test_the_intervals_are_those_of_scipys_curve_fit() -> None:
    rng = np.random.default_rng(4)
    given = recording(noise=0.02 * rng.standard_normal(100))
    fit = fit_lag(given)
    time = given.time_s - given.step_at_s
    values, covariance = curve_fit(response, time, given.output, p0=[3.0, 1.0, 5.0, 1.03])
    half = student.ppf(0.5 + CONFIDENCE / 2, 96) * np.sqrt(np.diag(covariance))
    scale = np.array([given.step, 1.0, 1.0])
    # curve_fit stops at its 1e-8 and takes finite differences; its dead time moves within the gap between two samples
    found = np.array([[each.value, each.high - each.value] for each in numbers(fit)])
    assert found[:, 0] * scale == pytest.approx(values[1:], rel=1e-4)
    assert found[:, 1] * scale == pytest.approx(half[1:] + np.array([0, 0, given.gap_s]), rel=1e-3)


def held_in(fits: Sequence[LagFit], truth: tuple[float, float, float]) -> Array:
    """How many fits' intervals hold each of the numbers."""
    inside = [[each.low <= true <= each.high for each, true in zip(numbers(fit), truth, strict=True)] for fit in fits]
    return np.sum(inside, axis=0)


def test_the_intervals_hold_the_truth_in_95_percent_of_the_recordings() -> None:
    rng = np.random.default_rng(8)
    fits = [fit_lag(recording(noise=0.02 * rng.standard_normal(100))) for _ in range(400)]
    # The dead time's interval reaches further up, by a gap between lines that is many deviations of the fit, for a step
    # that came between them: with the step on a line only its lower end can miss, in 2.5 %.
    # The count is binomial, with a standard deviation of sqrt(0.95 0.05/400) = 1.1 %; three numbers, four deviations.
    assert held_in(fits, (2.0, 5.0, 1.03)) / 400 == pytest.approx([0.95, 0.95, 0.975], abs=0.044)


@pytest.mark.parametrize("dead", [1.03, 0.1])
def test_the_intervals_hold_the_truth_wherever_between_two_lines_the_step_comes(dead: float) -> None:
    rng, count = np.random.default_rng(12), 200
    fits: list[LagFit] = []
    for phase in rng.uniform(0, 1, count):
        given = recording(dead=dead, noise=0.02 * rng.standard_normal(100))
        # the output of a step that came before the first line with the new input by a share of the gap
        earlier = response(given.time_s - given.step_at_s + phase * given.gap_s, 3.0, 1.0, 5.0, dead)
        now = response(given.time_s - given.step_at_s, 3.0, 1.0, 5.0, dead)
        fits.append(fit_lag(replace(given, output=given.output - now + earlier)))
    # a step may also come on a line, where the dead time's lower end misses in 2.5 %; so at least 95 %, less four
    # standard deviations of the count, sqrt(0.95 0.05/200) = 1.5 %.
    assert np.all(held_in(fits, (2.0, 5.0, dead)) / count >= 0.95 - 4 * math.sqrt(0.95 * 0.05 / count))


def test_no_other_dead_time_fits_better() -> None:
    # brute force over the dead time, in which the sum of squares has a kink at every sample
    rng = np.random.default_rng(5)
    for _ in range(10):
        given = recording(n=60, noise=0.1 * rng.standard_normal(60))
        fit = fit_lag(given)
        least = fit.residual_std**2 * 56
        time = given.time_s - given.step_at_s
        for dead in np.linspace(0, 3, 61):
            for tau in fit.time_constant_s.value * np.linspace(0.7, 1.3, 61):
                shape = np.column_stack([np.ones(60), response(time, 0, 1, tau, dead)])
                left = np.linalg.lstsq(shape, given.output, rcond=None)[1]
                assert left[0] >= least * (1 - 1e-9)  # rounding of two ways to sum


def test_a_step_just_after_the_last_old_line_is_a_dead_time_of_0_and_no_mistake() -> None:
    given = recording(dead=0.0)
    fit = fit_lag(replace(given, first=given.first + 1))
    assert fit.dead_time_s.value == fit.dead_time_s.low == 0.0
    assert fit.dead_time_s.high == pytest.approx(0.0, abs=1e-6)
    assert (fit.static_gain.value, fit.time_constant_s.value) == pytest.approx((2.0, 5.0), rel=1e-6)
    assert fit.notes == ()


def test_a_dead_time_below_0_becomes_0_and_says_so() -> None:
    given = recording(dead=0.0)
    fit = fit_lag(replace(given, first=given.first + 2))
    assert fit.dead_time_s.value == fit.dead_time_s.low == 0.0
    assert "below 0 by more than the time between two lines; 0 is taken" in fit.notes[0]
    assert any("output moves before the input" in note for note in fit.notes)


def test_a_dead_time_that_noise_makes_negative_keeps_its_upper_end() -> None:
    rng = np.random.default_rng(3)
    # the step comes right after the last old line: without dead time the fit falls on either side of the least one
    given = [recording(dead=0.0, noise=0.05 * rng.standard_normal(100)) for _ in range(12)]
    fits = [fit_lag(replace(each, first=each.first + 1)) for each in given]
    noted = [fit for fit in fits if fit.notes]
    assert 0 < len(noted) < len(fits)
    assert all(fit.dead_time_s.value == fit.dead_time_s.low == 0.0 for fit in noted)
    assert any(fit.dead_time_s.high > 0.0 for fit in noted)


def test_a_plant_that_is_no_lag_is_noted() -> None:
    time = np.linspace(0.0, 40.0, 200)
    late = np.maximum(time - time[20], 0.0)
    second_order = 1.0 - (1.0 + late / 3.0) * np.exp(-late / 3.0)
    fit = fit_lag(Recording("a.csv", time, second_order, 20, 1.0))
    assert "no independent noise" in fit.notes[0]
    rng = np.random.default_rng(1)
    assert fit_lag(recording(noise=0.02 * rng.standard_normal(100))).notes == ()


# -- what cannot be told -----------------------------------------------------------------------------------------------


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
        fit_lag(given(np.random.default_rng(6)))
    assert said in str(caught.value)


# -- families ----------------------------------------------------------------------------------------------------------


def test_three_recordings_give_a_family_that_holds_each_plant() -> None:
    plants = [(2.0, 5.0, 1.0), (2.2, 4.0, 0.8), (1.9, 7.0, 1.1)]
    family = identify_lag([recording(*plant, name=f"{k}.csv") for k, plant in enumerate(plants)])
    boxes = (family.static_gain, family.time_constant_s, family.dead_time_s)
    for plant in plants:
        # exact data: the lower ends differ from the values by rounding
        assert all(box.min * (1 - 1e-9) <= x <= box.max * (1 + 1e-9) for box, x in zip(boxes, plant, strict=True))
    assert [box.nominal for box in boxes] == pytest.approx([2.0, 5.0, 1.0], rel=1e-6)
    gap_s = 40.0 / 99  # in which the step may have come
    assert [box.max - box.min for box in boxes] == pytest.approx([0.3, 3.0, 0.3 + gap_s], rel=1e-6)
    assert [fit.name for fit in family.fits] == ["0.csv", "1.csv", "2.csv"]


def test_a_family_holds_the_interval_of_every_fit() -> None:
    rng = np.random.default_rng(9)
    family = identify_lag([recording(noise=0.05 * rng.standard_normal(100)) for _ in range(4)])
    for fit in family.fits:
        for box, each in zip(
            (family.static_gain, family.time_constant_s, family.dead_time_s), numbers(fit), strict=True
        ):
            assert box.min <= each.low <= each.value <= each.high <= box.max


def test_gains_of_both_signs_and_no_recording_are_refused() -> None:
    with pytest.raises(DomainError, match=r"2 in up\.csv and -2 in down\.csv"):
        identify_lag([recording(name="up.csv"), recording(-2.0, name="down.csv")])
    with pytest.raises(DomainError, match="at least one"):
        identify_lag([])


# -- the file ----------------------------------------------------------------------------------------------------------


def rows(count: int = 20, step_at: int = 5) -> list[str]:
    return [f"{k},{0 if k < step_at else 1},{max(0, k - step_at)}" for k in range(count)]


def changed(line: int, text: str) -> str:
    """A usable file with another text on one of its lines, counted from 1."""
    lines = [HEADER.strip(), *rows()]
    lines[line - 1] = text
    return "\n".join(lines)


def semicolons(text: str) -> str:
    return text.replace(",", ";")


@pytest.mark.parametrize("separator", [";", "\t"])
@pytest.mark.parametrize("point", [".", ","])
def test_semicolons_and_tabs_separate_too_and_leave_the_comma_to_decimals(separator: str, point: str) -> None:
    lines = ["time_s,input,output", *(f"{k}.5,{k // 8}.25,{k}e-1" for k in range(16))]
    text = "\n".join(line.replace(",", separator).replace(".", point) for line in lines)
    found = parse_recording(text, "a.csv")
    assert found.time_s.tolist() == [k + 0.5 for k in range(16)]
    assert found.output.tolist() == [float(f"{k}e-1") for k in range(16)]
    assert (found.first, found.step) == (8, 1.0)


def test_a_headers_letters_may_be_small_or_large() -> None:
    text = "\n".join(['"Time_s", INPUT,Output', *rows()])
    assert parse_recording(text, "a.csv").time_s.tolist() == list(range(20))


def test_one_sample_is_no_samples() -> None:
    with pytest.raises(DomainError, match="has 1 sample; a fit"):
        parse_recording("\n".join([HEADER.strip(), *rows(1)]), "a.csv")
    with pytest.raises(DomainError, match="only 1 sample lies on the rise"):
        fit_lag(recording(tau=0.1, dead=0.2))


def test_columns_may_stand_in_any_order_and_a_file_may_end_in_empty_lines() -> None:
    lines = [f"{y}, {t} ,{u}" for t, u, y in (row.split(",") for row in rows())]
    found = parse_recording("\ufeffoutput, time_s,input\r\n" + "\r\n".join(lines) + "\r\n\r\n", "a.csv")
    assert (found.first, found.step, found.step_at_s) == (5, 1.0, 5.0)
    assert found.output.tolist() == [max(0, k - 5) for k in range(20)]


def test_a_measured_input_may_be_noisy() -> None:
    rng = np.random.default_rng(7)
    moved = np.where(np.arange(50) < 12, 4.0, 1.0) + 0.01 * rng.uniform(-1, 1, 50)
    found = parse_recording(text_of(np.arange(50.0), moved, np.arange(50.0)), "a.csv")
    assert found.first == 12
    assert found.step == pytest.approx(-3.0, abs=0.02)  # the noise of two medians


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "line 1 has none of the columns; write the header time_s,input,output"),
        (HEADER, "no samples"),
        (changed(1, "t,u,y"), "line 1 has none of the columns; write the header time_s,input,output"),
        (changed(1, "t,input,y"), "line 1 is 't,input,y'; write the header time_s,input,output"),
        (changed(1, "time_s,input,output,extra"), "line 1"),
        (changed(1, "time_s,input,input"), "line 1"),
        (changed(1, "time_s|input|output"), "separated by commas, semicolons or tabs"),
        (changed(1, "time_s;input,output"), "line 1 is 'time_s;input,output'; write the header time_s,input,output"),
        (changed(1, "time_s;input;output"), "line 2 has 1 field; its header has 3"),
        (changed(4, "2;0;0"), "line 4 has 1 field; its header has 3"),
        (semicolons(changed(4, "2,0,1.000,5")), "line 4 has 4 fields"),
        (semicolons(changed(4, "2,0,1.000|5")).replace("|", ","), "line 4, column 'output': '1.000.5' is not a finite"),
        (changed(4, "2,0"), "line 4 has 2 fields"),
        (changed(4, "2,0,fast"), "line 4, column 'output': 'fast' is not a finite number"),
        (changed(4, "2,0,nan"), "line 4, column 'output'"),
        (changed(4, "1,0,0"), "line 4: time_s = 1 is not after 1"),
        (changed(4, "2,0.5,0"), "line 4, column 'input': 0.5 is not one step, which goes from 0 to 1 on line 7"),
        (changed(15, "13,2,0"), "is not one step"),
        ("\n".join([HEADER.strip(), *rows(9)]), "has 9 samples"),
        ("\n".join([HEADER.strip(), *rows(20, 0)]), "column 'input': there is no step"),
    ],
)
def test_what_is_wrong_with_a_file_is_said_with_its_line(text: str, said: str) -> None:
    with pytest.raises(DomainError) as caught:
        parse_recording(text, "a.csv")
    assert str(caught.value).startswith("a.csv: ")
    assert said in str(caught.value)
