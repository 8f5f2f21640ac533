"""Scenarios and systems as people bring them, and what is right for each, computed independently of the package."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from cases.project import ROOT
from typer.testing import CliRunner

import fopi_tune as ft
from fopi_tune.cli import app
from fopi_tune.cli.batch import OutputOptions
from fopi_tune.cli.gains import gains_of_earlier_design
from fopi_tune.core.controller import FoPi
from fopi_tune.errors import DomainError, SpecError
from fopi_tune.report import evidence_text, simulation_text
from fopi_tune.report.text.percentages import interval_phrase, share_phrase
from fopi_tune.results.stamp import stamp
from fopi_tune.spec import load_system, parse_spec
from fopi_tune.spec.digests import DESIGN_PARTS, digests_of
from fopi_tune.spec.model import Limit, Relation

FIELD = ROOT / "tests" / "cases" / "field"
UNIT = FoPi(1.0, 1.0, 1.0)


def spec_text(name: str, *pairs: tuple[str, str]) -> str:
    text = (FIELD / f"{name}.yaml").read_text(encoding="utf-8")
    for old, new in pairs:
        assert old in text
        text = text.replace(old, new)
    return text


def system_file(folder: Path, name: str, *pairs: tuple[str, str]) -> Path:
    """A system of the field with changes, beside its specs; a pair is looked for in all of them."""
    for path in FIELD.glob("*.yaml"):
        text = path.read_text(encoding="utf-8")
        for old, new in pairs:
            text = text.replace(old, new)
        (folder / path.name).write_text(text, encoding="utf-8")
    return folder / f"{name}.yaml"


# -- an actuator with a rate limit -------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("own", "least", "most", "noted"),
    [
        ("", 1.3, 1.4, "which the controller does not know, and it winds up; write output_rate_per_s: 0.25 in"),
        (", output_rate_per_s: 0.25", 0.0, 0.05, ""),
        (", output_rate_per_s: 0.1", -0.1, 0.02, ""),
        (
            ", output_rate_per_s: 1",
            0.05,
            1.4,
            "does not know, as its output_rate_per_s of 1 is faster, and it winds up",
        ),
    ],
    ids=["outside", "inside", "slower", "too fast"],
)
def test_a_rate_limit_in_the_controller_keeps_the_overshoot_below_5_percent(
    own: str, least: float, most: float, noted: str
) -> None:
    text = spec_text("slew_limit", ("sample_time_s: 0.05", f"sample_time_s: 0.05{own}"))
    (result,) = ft.simulate(parse_spec(text), FoPi(2.0, 2.0, 1.0)).driven
    assert least < result.measures["overshoot"] < most
    assert (noted in " ".join(result.notes)) if noted else not result.notes
    # the simulation's JSON and text say the same
    assert result.to_dict()["notes"] == list(result.notes)


def test_drawn_plants_are_driven_by_the_controller_that_limits_its_rate() -> None:
    family = ("time_constant_s: 2", "time_constant_s: {min: 1.8, max: 2.2}")
    judged = "limits: [{overshoot: {at_most: 0.06}}]\nvalidation: {samples: 40}\n"
    for own, met in ((", output_rate_per_s: 0.25", 40), ("", 0)):
        text = spec_text("slew_limit", family, ("sample_time_s: 0.05", f"sample_time_s: 0.05{own}"))
        (fraction,) = ft.validate(parse_spec(text + judged), FoPi(2.0, 2.0, 1.0)).evidence.limits
        assert (fraction.fraction.met, fraction.fraction.total) == (met, 40)


def test_an_actuator_whose_rate_is_not_reached_needs_no_note() -> None:
    text = spec_text("slew_limit", ("rate_per_s: 0.25", "rate_per_s: 200"))
    (result,) = ft.simulate(parse_spec(text), FoPi(2.0, 2.0, 1.0)).driven
    assert result.notes == ()


def test_a_rate_limit_in_the_controller_is_of_the_loop_on_samples_alone() -> None:
    text = spec_text("slew_limit", ("sample_time_s: 0.05", "sample_time_s: 0.05, output_rate_per_s: 0.25"))
    with pytest.raises(DomainError, match="belongs to the loop on samples; leave it or `exact=True` out"):
        ft.simulate(parse_spec(text.replace(", rate_per_s: 0.25", "")), FoPi(2.0, 2.0, 1.0), exact=True)


# -- references with several steps ------------------------------------------------------------------------------------


def lag_loop(reference: np.ndarray, step: float) -> np.ndarray:
    """y of the lag 1/(s + 1) behind a hold with u = kp e + the trapezoidal integral of e, kp = ki = 1."""
    decay, y, integral, before = math.exp(-step), 0.0, 0.0, 0.0
    found = []
    for r in reference:
        found.append(y)
        error = r - y
        integral += 0.5 * step * (error + before)
        before = error
        y = decay * y + (1.0 - decay) * (error + integral)
    return np.array(found)


def test_a_step_down_is_judged_by_itself() -> None:
    driven = ft.simulate(FIELD / "two_setpoints.yaml", UNIT).driven[0]
    time = 0.05 * np.arange(4001)
    y = lag_loop(np.where(time < 100.0 - 1e-9, 10.0, 5.0), 0.05)
    np.testing.assert_allclose(driven.traces.output[0], y, atol=1e-9)
    # each step within 2 % of its own size: 0.2 of the first, 0.1 of the second
    settled = [
        0.05 * (1 + np.flatnonzero(np.abs(y[a:b] - r) > band)[-1])
        for a, b, r, band in ((0, 2000, 10, 0.2), (2000, 4001, 5, 0.1))
    ]
    assert driven.measures["overshoot"] == pytest.approx(0.0, abs=1e-12)
    assert driven.measures["settling_time_s"] == pytest.approx(max(settled)) == pytest.approx(3.85)
    assert [step.settling_time_s for step in driven.steps] == pytest.approx(settled)
    # a hold's half sample later than 1 - e^-t, whose rise takes ln 9
    assert driven.measures["rise_time_s"] == pytest.approx(math.log(9.0), abs=0.06)
    assert driven.measures["undershoot"] == pytest.approx(0.0, abs=1e-12)
    assert set(driven.worst_steps) >= {"overshoot", "settling_time_s", "rise_time_s", "final_error"}
    assert all(met for _, met in driven.limits)


def test_rise_and_undershoot_in_continuous_time() -> None:
    # L = 1/s: each step is 1 - e^-t of its size
    driven = ft.simulate(FIELD / "two_setpoints.yaml", UNIT, exact=True).driven[0]
    assert driven.measures["rise_time_s"] == pytest.approx(math.log(9.0), rel=1e-3)
    assert driven.measures["undershoot"] == pytest.approx(0.0, abs=1e-9)
    # (1 - s)/(1 + s)^2 goes the wrong way first, in continuous time as on fine samples
    plant = (
        "model: lag, static_gain: 1, time_constant_s: 1",
        "model: transfer_function, numerator: [-1, 1], denominator: [1, 2, 1]",
    )
    spec = parse_spec(spec_text("two_setpoints", plant, ("sample_time_s: 0.05", "sample_time_s: 0.01")))
    exact, sampled = (ft.simulate(spec, FoPi(0.4, 0.3, 1.0), exact=way).driven[0] for way in (True, False))
    for name in ("undershoot", "rise_time_s"):
        assert exact.measures[name] == pytest.approx(sampled.measures[name], rel=0.02)
        assert exact.measures[name] > 0.5
    assert exact.worst_steps["undershoot"].at_s == 0.0
    document = exact.to_dict()
    assert document["steps"][0]["undershoot"] == pytest.approx(2.0 * document["steps"][1]["undershoot"], rel=1e-3)
    # the limits are judged
    spec = parse_spec(
        spec_text(
            "two_setpoints", ("overshoot: {at_most: 0.5}", "rise_time_s: {at_most: 2.1}}, {undershoot: {at_most: 0.1}")
        )
    )
    assert [met for _, met in ft.simulate(spec, UNIT).driven[0].limits] == [False, True]


def test_a_rise_that_is_not_over_is_never() -> None:
    driven = ft.simulate(parse_spec(spec_text("two_setpoints", ("at_s: 100", "at_s: 1"))), UNIT).driven[0]
    assert driven.measures["rise_time_s"] == math.inf
    assert driven.worst_steps["rise_time_s"].at_s == 0.0
    document = driven.to_dict()
    assert document["measures"]["rise_time_s"] is None
    assert document["steps"][0]["rise_time_s"] is None
    assert document["worst_steps"]["rise_time_s"] == 0


@pytest.mark.parametrize("back", [0.0, 10.0])
def test_a_step_back_to_the_start_value_overshoots_like_the_first(back: float) -> None:
    # a PI of 0.2 + 1.5/s overshoots; the loop is linear, so that down is the mirror of up
    knots = f"{{at_s: 0, value: 4}}, {{at_s: 60, value: {back}}}"
    text = spec_text("two_setpoints", ("{at_s: 0, value: 10}, {at_s: 100, value: 5}", knots), ("0.5}", "9}"))
    up, down = ft.simulate(parse_spec(text), FoPi(0.2, 1.5, 1.0)).driven[0].steps
    assert up.overshoot / 4.0 == pytest.approx(down.overshoot / abs(back - 4.0), rel=1e-6)
    assert up.overshoot > 0.5
    assert up.settling_time_s == down.settling_time_s


def test_a_step_that_comes_too_early_is_said() -> None:
    text = spec_text("two_setpoints", ("at_s: 100", "at_s: 1"))
    driven = ft.simulate(parse_spec(text), UNIT).driven[0]
    assert driven.measures["settling_time_s"] == math.inf
    assert driven.worst_steps["settling_time_s"].at_s == 0.0
    # at 1 s the first step is short of 10 by 10/e, a hold's half sample less
    assert driven.measures["final_error"] == pytest.approx(10.0 * math.exp(-1.0), rel=0.05)
    assert "the step at 1 s comes before the output has settled at the one before, of 0 s" in driven.notes


def test_judging_from_a_time_leaves_out_the_steps_before() -> None:
    early = {"judged_from_s": 0.0, "steps": [0.0, 100.0]}, {"judged_from_s": 50.0, "steps": [100.0]}
    for wanted in early:
        text = spec_text(
            "two_setpoints", ("duration_s: 200", f"duration_s: 200, judged_from_s: {wanted['judged_from_s']}")
        )
        assert [step.at_s for step in ft.simulate(parse_spec(text), UNIT).driven[0].steps] == wanted["steps"]
    # over the second step, nothing steps any more: the largest |r - y|
    text = spec_text("two_setpoints", ("duration_s: 200", "duration_s: 200, judged_from_s: 100.5"))
    driven = ft.simulate(parse_spec(text), UNIT).driven[0]
    y = driven.traces.output[0]
    assert driven.measures["overshoot"] == np.abs(y[2010:] - 5.0).max() > 2.0


def test_a_step_of_the_load_is_judged_from_its_own_beginning() -> None:
    text = spec_text("two_setpoints", (", {at_s: 100, value: 5}]", "], load: [{at_s: 100, value: 3}]"))
    driven = ft.simulate(parse_spec(text), UNIT).driven[0]
    y, band = driven.traces.output[0], 0.2
    recovered = 0.05 * (1 + np.flatnonzero(np.abs(y[2000:] - 10.0) > band)[-1])
    assert driven.steps[1].settling_time_s == pytest.approx(recovered)
    assert driven.measures["settling_time_s"] == pytest.approx(max(recovered, driven.steps[0].settling_time_s))
    assert driven.measures["overshoot"] == pytest.approx(y.max() - 10.0)
    assert driven.measures["overshoot"] > 0.5
    # the same load before the output is there goes on with the step's time
    soon = ft.simulate(parse_spec(text.replace("at_s: 100", "at_s: 1")), UNIT).driven[0]
    y = soon.traces.output[0]
    assert soon.measures["settling_time_s"] == pytest.approx(0.05 * (1 + np.flatnonzero(np.abs(y - 10.0) > band)[-1]))


def test_evidence_counts_what_single_plants_measure() -> None:
    text = spec_text("two_setpoints", ("time_constant_s: 1}", "time_constant_s: {min: 0.5, max: 2}}"), ("0.5}", "0.2}"))
    spec = parse_spec(text + "validation: {samples: 30, seed: 3}\n")
    judged = ft.validate(spec, UNIT).evidence.limits[0]
    values = [ft.simulate(spec, UNIT, replay=i).driven[0].measures["overshoot"] for i in range(30)]
    assert judged.fraction.met == sum(value <= 0.2 for value in values)
    assert judged.worst[0].value == pytest.approx(max(values), rel=1e-9)
    assert 0 < judged.fraction.met < 30


# -- the last sample, units, words ------------------------------------------------------------------------------------


@pytest.mark.parametrize("exact", [False, True])
def test_ten_seconds_at_a_limit_are_ten(exact: bool) -> None:
    found = ft.simulate(FIELD / "saturation_time.yaml", FoPi(1.0, 0.1, 1.0), exact=exact)
    assert found.driven[0].measures["saturation_time_s"] == pytest.approx(10.0, rel=1e-12)
    assert found.status == "met"
    assert "the setpoint 5 is out of reach" in found.driven[0].notes[0]


def test_only_a_velocity_has_an_acceleration() -> None:
    measures = ft.simulate(FIELD / "unitless_rate.yaml", UNIT).driven[0].measures
    assert "acceleration_m_s2" not in measures
    for unit, metres in (("km/h", 1 / 3.6), ("m/s", 1.0), ("mph", 0.44704)):
        text = spec_text("unitless_rate", ("sample_time_s: 0.05", f"sample_time_s: 0.05, measurement_unit: {unit}"))
        found = ft.simulate(parse_spec(text), UNIT).driven[0].measures
        assert found["acceleration_m_s2"] == pytest.approx(found["peak_rate_per_s"] * metres, rel=1e-12)
        assert found["peak_rate_per_s"] == measures["peak_rate_per_s"]


@pytest.mark.parametrize(
    ("unit", "words"),
    [("", "add measurement_unit: km/h"), ("kph", "measurement_unit: km/h, not kph"), ("degC", "degC")],
)
def test_a_limit_of_an_acceleration_without_a_velocity_is_refused(unit: str, words: str) -> None:
    digital = "sample_time_s: 0.05" + (f", measurement_unit: {unit}" if unit else "")
    text = (
        spec_text("unitless_rate", ("sample_time_s: 0.05", digital)) + "limits: [{acceleration_m_s2: {at_most: 2}}]\n"
    )
    with pytest.raises(SpecError, match=words):
        parse_spec(text)
    spec = parse_spec(spec_text("unitless_rate"))
    limited = replace(spec, limits=(Limit("acceleration_m_s2", Relation.AT_MOST, 2.0),))
    with pytest.raises(DomainError, match="measured velocity"):
        ft.simulate(limited, UNIT)


def test_an_unknown_key_that_ends_like_a_unit_is_only_unknown() -> None:
    with pytest.raises(SpecError, match="output_min: the key is not known here") as caught:
        ft.load_spec(FIELD / "unknown_output_min.yaml")
    assert "second" not in str(caught.value)


@pytest.mark.parametrize(
    "lines",
    [
        "time_constant_s;note\n0,5;a\n1,5;b\n",
        "day,time_constant_s\nMon,0.5\nTue,1.5\n",
        "i\ttime_constant_s\n0\t0.5\n1\t1.5\n",
    ],
)
def test_a_file_of_samples_may_have_semicolons_and_further_columns(tmp_path: Path, lines: str) -> None:
    (tmp_path / "draws.csv").write_text(lines, encoding="utf-8")
    plant = ("time_constant_s: 1}", "time_constant_s: {min: 0.1, max: 2}}")
    (tmp_path / "s.yaml").write_text(spec_text("two_setpoints", plant) + "validation: {samples_file: draws.csv}\n")
    found = [ft.simulate(tmp_path / "s.yaml", UNIT, replay=i).plant["time_constant_s"] for i in (0, 1)]
    assert found == [0.5, 1.5]


def test_shares_are_rounded_outwards() -> None:
    assert share_phrase(1_000_000, 1_000_000) == "100 %"
    assert share_phrase(999_991, 1_000_000) == "99.99 %"
    assert share_phrase(0, 10) == "0 %"
    assert interval_phrase(0.9999806, 0.9999966) == "99.99 .. 99.9997 %"
    assert interval_phrase(0.994716, 1.0) == "99.47 .. 100 %"
    assert interval_phrase(0.0, 0.0000123456) == "0 .. 0.001235 %"


# -- integrators ------------------------------------------------------------------------------------------------------


@pytest.mark.thinned(2)
@pytest.mark.parametrize("exact", [False, True])
@pytest.mark.parametrize(
    "plant",
    [
        "{model: pole, gain: 0.01, pole_rad_s: 0}",
        "{model: transfer_function, numerator: [1, 0.02], denominator: [1, 0.5, 0]}",
        "{model: transfer_function, numerator: [0.001], denominator: [1, 1, 0], dead_time_s: 1}",
    ],
)
def test_an_integrator_rests_anywhere(plant: str, exact: bool) -> None:
    text = spec_text("integrator_at_rest", ("{model: pole, gain: 0.01, pole_rad_s: 0}", plant))
    driven = ft.simulate(parse_spec(text), FoPi(0.5, 0.01, 1.0), exact=exact).driven[0]
    np.testing.assert_allclose(driven.traces.output, 1.0, atol=1e-12)
    np.testing.assert_allclose(driven.traces.applied, 0.0, atol=1e-12)


# -- systems ----------------------------------------------------------------------------------------------------------


def test_slow_samples_chatter_and_fast_ones_do_not(tmp_path: Path) -> None:
    slow = ft.simulate_system(FIELD / "chattering_slow_samples.yaml")
    assert slow.status == "chattering"
    assert load_system(FIELD / "chattering_slow_samples.yaml").chattering_window_s == 50.0
    # the mirror: some jumps in half a second, hundreds of samples of 0.1 ms apart
    knots = ", ".join(f"{{at_s: {0.06 * i:.2f}, value: {(i + 1) % 2}}}" for i in range(8))
    fast = system_file(
        tmp_path,
        "chattering_slow_samples",
        ("sample_time_s: 5, delay_samples: 3", "sample_time_s: 0.0001"),
        ("time_constant_s: {nominal: 175, min: 140, max: 210}", "time_constant_s: 0.01"),
        ("time_constant_s: {nominal: 110, min: 90, max: 140}", "time_constant_s: 0.01"),
        ("noise_std: 0.5, ", ""),
        ("hysteresis: 0", "hysteresis: 0.05"),
        ("duration_s: 1800", "duration_s: 0.5"),
        ("[{at_s: 0, value: 0}]", f"[{knots}]"),
    )
    found = ft.simulate_system(fast)
    assert found.driven[0].measures["switch_count"] >= 6
    assert found.status == "met"


def test_a_window_that_cannot_hold_the_switches_is_refused(tmp_path: Path) -> None:
    path = system_file(tmp_path, "chattering_slow_samples", ("hysteresis: 0", "hysteresis: 0\n  window_s: 24"))
    with pytest.raises(SpecError, match=r"window_s: 24 s cannot hold 6 samples of 5 s.*at least 25"):
        load_system(path)
    assert load_system(
        system_file(
            tmp_path,
            "chattering_slow_samples",
            ("window_s: 24", ""),
            ("hysteresis: 0", "hysteresis: 0\n  window_s: 25"),
        )
    )


def test_the_exact_run_keeps_the_delay_and_the_load() -> None:
    sampled = ft.simulate_system(FIELD / "delay_in_exact.yaml")
    exact = ft.simulate_system(FIELD / "delay_in_exact.yaml", exact=True)
    for one, two in zip(sampled.driven, exact.driven, strict=True):
        assert [met for _, met in one.limits] == [met for _, met in two.limits]
        assert two.measures["switch_count"] == one.measures["switch_count"]
        assert two.measures["peak_rate_per_s"] == pytest.approx(one.measures["peak_rate_per_s"], rel=0.01)
        assert "0.5 s of computing delay" in two.outcome
    assert sampled.status == exact.status == "violated"
    assert exact.driven[0].measures["peak_rate_per_s"] == pytest.approx(3.74, abs=0.01)
    assert exact.driven[0].measures["switch_count"] == 8


def test_a_delayed_load_response_solves_its_differential_equation(tmp_path: Path) -> None:
    # one mode only acts: a load pulls the throttle's loop away, which answers after 0.5 s
    path = system_file(tmp_path, "delay_in_exact", ("hysteresis: 0.1", "hysteresis: 9"), ("[0, 2]", "[-9, 9]"))
    driven = ft.simulate_system(path, scenario="hill", exact=True, accuracy=1e-5).driven[0]
    assert driven.accuracy is not None
    assert driven.accuracy <= 1e-5
    assert driven.switch_times_s == ()
    time, y = driven.traces.time_s, driven.traces.output[0]
    # the midpoint rule on y' = -0.02 y + u(t - 0.5) + w, x' = 0.18 e, u = 0.8 e + x, from rest at 15
    step, lag = 1e-3, 500
    state, integral, controls = 15.0, 0.3, [0.3] * lag
    for k in range(17_001):
        if k in (6500, 9000, 17_000):
            assert y[np.argmin(np.abs(time - k * step))] == pytest.approx(state, abs=2e-5)
        controls.append(0.8 * (15.0 - state) + integral)
        load = 0.6 * min(max((k + 0.5) * step - 5.0, 0.0), 2.0) / 2.0
        # two controls, of half a second ago, at the step's ends; the second follows at once from the history
        late = 0.5 * (controls[k] + controls[k + 1])
        middle = state + 0.5 * step * (-0.02 * state + controls[k] + load)
        following = state + step * (-0.02 * middle + late + load)
        integral += 0.18 * step * (15.0 - 0.5 * (state + following))
        state = following


def test_an_accuracy_is_reached_or_what_was_is_said() -> None:
    text = spec_text("two_setpoints", ("duration_s: 200", "duration_s: 8"), (", {at_s: 100, value: 5}", ""))
    rough, fine = (ft.simulate(parse_spec(text), FoPi(1.0, 1.0, 0.7), exact=True, accuracy=a) for a in (None, 1e-6))
    assert rough.driven[0].accuracy is not None
    assert fine.driven[0].accuracy is not None
    assert fine.driven[0].accuracy <= 1e-6 < rough.driven[0].accuracy
    never = ft.simulate(parse_spec(text), FoPi(1.0, 1.0, 0.7), exact=True, accuracy=1e-300)
    assert any("1e-300 was asked for" in note for note in never.driven[0].notes)
    for accuracy, exact in ((0.1, False), (0.0, True), (math.nan, True)):
        with pytest.raises(DomainError, match="accuracy"):
            ft.simulate(parse_spec(text), UNIT, exact=exact, accuracy=accuracy)


@pytest.mark.thinned(2)
@pytest.mark.parametrize("gains", ["kp: 0.8, ki: 0, alpha: 1", "kp: 0.8, ki: 0.18, alpha: 1"])
def test_tracking_without_an_integral_is_the_same_on_samples_and_exactly(tmp_path: Path, gains: str) -> None:
    for delay in ("delay_samples: 50", "delay_samples: 0"):
        path = system_file(
            tmp_path,
            "delay_in_exact",
            ("ki: 0.18, alpha: 1}, output_limits: [0, 2]", "ki: 0, alpha: 1}, output_limits: [0, 2]"),
            ("kp: 0.8, ki: 0.18, alpha: 1}, output_limits: [-3.5, 0]", f"{gains}}}, output_limits: [-3.5, 0]"),
            ("delay_samples: 50", delay),
        )
        sampled, exact = (
            ft.simulate_system(path, scenario="stop_go", exact=which).driven[0] for which in (False, True)
        )
        if "ki: 0," in gains:
            shared = exact.traces.time_s, sampled.traces.time_s
            y = np.interp(shared[1], shared[0], exact.traces.output[0])
            # the hold is half a sample of 10 ms behind, at rates up to 3.5/s, and jumps are seen a sample late
            np.testing.assert_allclose(sampled.traces.output[0], y, atol=0.1)


def test_what_is_not_known_after_chattering_is_not_called_violated(tmp_path: Path) -> None:
    text = (ROOT / "systems" / "switching.yaml").read_text().replace("../specs/", str(ROOT / "specs") + "/")
    limits = "limits:\n  - switch_count: {at_most: 40}\n  - overshoot: {at_most: 1}\n  - switch_count: {at_most: 1}"
    path = tmp_path / "switching.yaml"
    path.write_text(text.replace("limits:\n  - switch_count: {at_most: 4}", limits))
    found = ft.simulate_system(path, exact=True)
    assert found.status == "chattering"
    assert [met for _, met in found.driven[0].limits] == [None, None, False]
    said = simulation_text(found).plain
    assert "unknown: <= 1" in said
    assert said.count("VIOLATED") == 1
    assert [each["met"] for each in found.to_dict()["scenarios"][0]["limits"]] == [None, None, False]


def test_what_is_refused_is_refused_before_anything_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    ran: list[str] = []
    monkeypatch.setattr("fopi_tune.pipeline.tune_system.tune", lambda *_args, **_options: ran.append("tune"))
    path = system_file(
        tmp_path,
        "delay_in_exact",
        ("gains: {kp: 0.8, ki: 0.18, alpha: 1}, output_limits: [0, 2]", "output_limits: [0, 2]"),
        ("bumpless: yes", "bumpless: yes, noise_std: 0.1"),
    )
    with pytest.raises(DomainError, match="scenario hill: noise_std"):
        ft.simulate_system(path, exact=True)
    with pytest.raises(DomainError, match="no scenario 'x'"):
        ft.simulate_system(path, scenario="x")
    assert ran == []
    text = spec_text(
        "two_setpoints",
        ("scenarios: [{", "scenarios:\n  - {"),
        ("value: 5}]}]", "value: 5}]}"),
        ("limits:", "  - {name: late, duration_s: 9, initial_output: 1, reference: [{at_s: 0, value: 1}]}\nlimits:"),
        ("lag, static_gain: 1, time_constant_s: 1", "transfer_function, numerator: [1, 0], denominator: [1, 2, 1]"),
    )
    monkeypatch.setattr("fopi_tune.pipeline.simulate.run_scenario", lambda *_args: ran.append("run"))
    monkeypatch.setattr("fopi_tune.pipeline.validate.discretize", lambda *_args: ran.append("proof"))
    for verb in (ft.simulate, ft.validate):
        with pytest.raises(DomainError, match="scenario late: no input holds"):
            verb(parse_spec(text), UNIT)
    assert ran == []


def test_limits_that_leave_a_mode_nothing_to_act_with_are_noted(tmp_path: Path) -> None:
    path = system_file(tmp_path, "delay_in_exact", ("[-3.5, 0]", "[0, 3.5]"))
    found = ft.simulate_system(path, scenario="stop_go")
    assert found.notes == ("brake: its output_limits [0, 3.5] leave nothing below 0: it cannot lower the output",)
    # with a plant of negative gain these are the limits that brake
    path = system_file(tmp_path, "delay_in_exact", ("[-3.5, 0]", "[0, 3.5]"), ("gain: 1.0", "gain: -1.0"))
    assert [note.split(":")[0] for note in ft.simulate_system(path, scenario="stop_go").notes] == ["throttle"]
    assert ft.simulate_system(FIELD / "delay_in_exact.yaml", scenario="stop_go").notes == ()


# -- specs without scenarios, and digests -----------------------------------------------------------------------------


@pytest.mark.thinned(3)
@pytest.mark.parametrize("path", sorted((ROOT / "specs").glob("*.yaml")), ids=lambda path: path.stem)
@pytest.mark.parametrize("exact", [False, True])
def test_shipped_specs_are_driven_through_a_default_scenario(path: Path, exact: bool) -> None:
    found = ft.simulate(path, FoPi(0.45, 0.37, 0.83), exact=exact)
    (driven,) = found.driven
    assert found.status == "met"
    assert "the spec has no scenarios" in found.notes[-1]
    step, load = driven.steps
    assert (step.of_load, load.of_load) == (False, True)
    # each part is long enough to settle in, and not ten times as long
    part = load.at_s
    assert 0.1 * part < step.settling_time_s < part
    assert driven.measures["settling_time_s"] < part


@pytest.mark.parametrize("limits", ["[0, 100]", "[-1, 0]", "[0, 0.4]", "[-9, 9]"])
@pytest.mark.parametrize(
    "plant", ["{model: lag, static_gain: 2, time_constant_s: 3}", "{model: pole, gain: 0.5, pole_rad_s: 0}"]
)
def test_a_default_scenario_stays_within_what_the_control_can(limits: str, plant: str) -> None:
    text = spec_text("unitless_rate", ("{model: lag, static_gain: 1, time_constant_s: 1}", plant))
    text = text.replace("sample_time_s: 0.05", f"sample_time_s: 0.05, output_limits: {limits}").split("scenarios:")[0]
    driven = ft.simulate(parse_spec(text), FoPi(1.0, 0.3, 1.0)).driven[0]
    assert driven.notes == ()
    assert driven.measures["settling_time_s"] < driven.scenario.duration_s / 2 or limits != "[-9, 9]"
    assert math.isfinite(driven.measures["iae"])


def test_without_a_section_digital_the_loop_is_driven_in_continuous_time() -> None:
    text = spec_text("unitless_rate").split("digital:")[0]
    found = ft.simulate(parse_spec(text), UNIT)
    assert found.exact
    assert "no section digital" in found.notes[0]
    # y = 1 - e^-t until the load
    driven = found.driven[0]
    one = np.argmin(np.abs(driven.traces.time_s - 1.0))
    assert driven.traces.output[0, one] == pytest.approx(1.0 - math.exp(-driven.traces.time_s[one]), abs=1e-4)


def test_a_loop_that_does_not_stay_finite_is_not_met(tmp_path: Path) -> None:
    text = spec_text("unitless_rate", ("static_gain: 1", "static_gain: -3"), ("duration_s: 20", "duration_s: 500"))
    for exact in (False, True):
        found = ft.simulate(parse_spec(text), UNIT, exact=exact)
        assert found.status == "violated"
        assert "does not stay finite" in simulation_text(found).plain
        json.dumps(found.to_dict(), allow_nan=False)


def test_a_scenario_that_is_added_leaves_the_design(tmp_path: Path) -> None:
    text = spec_text(
        "unitless_rate", ("controller: {kp: 1, ki: 1, alpha: 1}", "controller: {kp: {min: 0, max: 9}, alpha: 1}")
    )
    spec, bare = parse_spec(text), parse_spec(text.split("scenarios:")[0])
    (tmp_path / "design.json").write_text(
        json.dumps(
            {
                "status": "solved",
                "gains": {"kp": 2.0, "ki": 3.0, "alpha": 1.0},
                "stamp": {"spec_sha256": bare.sha256, "digests": digests_of(bare)},
            }
        )
    )
    options = OutputOptions(str(tmp_path), False, True, False)
    assert gains_of_earlier_design(spec, options) == FoPi(2.0, 3.0, 1.0)
    assert gains_of_earlier_design(parse_spec(text.replace("max: 9", "max: 8")), options) is None
    assert stamp("x", None, digests_of(bare)).digests["plant"] == digests_of(spec)["plant"]


def test_digests_tell_parts_apart() -> None:
    text = spec_text("unitless_rate")
    base = digests_of(parse_spec(text))

    def changed(old: str, new: str) -> set[str]:
        assert old in text
        found = digests_of(parse_spec(text.replace(old, new)))
        return {name for name in base if base[name] != found[name]}

    assert changed("static_gain: 1,", "static_gain: 1.0,") == set()
    assert changed("schema: 1", "# a comment\nschema: 1") == set()
    assert changed("static_gain: 1,", "static_gain: 2,") == {"plant"}
    assert changed("kp: 1", "kp: 2") == {"controller"}
    assert changed("at_least: 60", "at_least: 61") == {"requirements"}
    assert changed("digital:", "objective: {minimize: iae_disturbance}\ndigital:") == {"objective"}
    assert changed("sample_time_s: 0.05", "sample_time_s: 0.1") == {"digital"}
    assert changed("sample_time_s: 0.05", "sample_time_s: 0.05, poles: 7") == set()
    assert changed("sample_time_s: 0.05", "sample_time_s: 0.05, design: sampled") == {"digital", "loop"}
    assert changed("duration_s: 20", "duration_s: 30") == {"scenarios"}
    assert set(DESIGN_PARTS) < set(base)


@pytest.mark.parametrize(
    "model", ["lag", *(pytest.param(model, marks=pytest.mark.long) for model in ("pole", "transfer_function"))]
)
def test_the_command_drives_what_init_writes(model: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    gains = ["--kp", "0.6", "--ki", "0.4", "--alpha", "0.9"]
    assert CliRunner().invoke(app, ["init", model, "--plant", model, "--no-schema"]).exit_code == 0
    for more in ([], ["--exact", "--accuracy", "0.01"]):
        ended = CliRunner().invoke(app, ["simulate", f"{model}.yaml", *gains, *more])
        assert ended.exit_code in (0, 1), ended.output
        assert all(len(line) <= 80 for line in ended.stdout.splitlines())
    ended = CliRunner().invoke(app, ["simulate", f"{model}.yaml", *gains, "--accuracy", "0.01"])
    assert ended.exit_code == 2
    assert "--exact" in ended.stderr


def test_evidence_of_nearly_all_is_not_printed_as_all() -> None:
    spec = parse_spec(spec_text("two_setpoints") + "validation: {samples: 10, seed: 1}\n")
    result = ft.validate(spec, UNIT)
    limits = result.evidence.limits
    nearly = replace(limits[0].fraction, met=999_991, total=1_000_000, low=0.99998, high=0.9999966)
    evidence = replace(result.evidence, limits=(replace(limits[0], fraction=nearly),))
    said = evidence_text(replace(result, evidence=evidence)).plain
    row = next(line for line in said.splitlines() if "overshoot" in line)
    assert "100" not in row
    assert "99.9997" in row


def test_the_text_has_the_units_that_the_spec_names() -> None:
    text = spec_text("two_setpoints")
    plain = simulation_text(ft.simulate(parse_spec(text), UNIT)).plain
    assert "output unit per s" in plain
    named = text.replace("digital: {", 'digital: {measurement_unit: mbar, output_unit: "%", ')
    assert named != text
    said = simulation_text(ft.simulate(parse_spec(named), UNIT)).plain
    assert "mbar per s" in said
    assert "mbar squared times s" in said
    assert "output unit" not in said
    assert "control unit" not in said
