"""Separate thresholds and coasting through every stage, from the file to C and to the certificate."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
from cases.c_export import replayed
from cases.two_modes import rig, write

import fopi_tune as ft
from fopi_tune.errors import CertificateError, DomainError
from fopi_tune.proof.switched import recheck_system
from fopi_tune.proof.switched.documents import from_document, to_document
from fopi_tune.report.system_page import system_report_files
from fopi_tune.spec.load import load_system

APART = "to_fan_above: 0.5\nto_heater_below: 0.1\ninactive: reset"
ABSOLUTE = "to_fan_above: {absolute: 8.4}\nto_heater_below: -0.2"
COASTING = "to_fan_above: 0.6\nto_heater_below: -0.4\ncoast: true\ncoast_below: 0.1\ninactive: tracking"
TURNS = {"apart": APART, "absolute": ABSOLUTE, "coasting": COASTING}
MORE = "limits: [{switch_count: {at_most: 30}}]\nvalidation: {samples: 60, seed: 2}"
each_kind = pytest.mark.parametrize("turns", TURNS.values(), ids=TURNS)
needs_gcc = pytest.mark.skipif(not shutil.which("gcc"), reason="gcc is not found")


@each_kind
def test_samples_and_continuous_time_change_modes_on_the_lines(tmp_path: Path, turns: str) -> None:
    system = rig(tmp_path, turns=turns, more=MORE)
    sampled, exact = (ft.simulate_system(system, exact=exact).driven[0] for exact in (False, True))
    lines = system.lines
    for driven in (sampled, exact):
        t = driven.traces
        r, y, mode = (np.asarray(row).ravel() for row in (driven.reference, t.measured, t.mode))
        begins = np.flatnonzero(np.diff(mode)) + 1
        assert len(begins) > 1
        # stored times of the inclusion lie up to 0.01 s behind a jump, in which y moves by less than this
        room = 1e-9 if driven is sampled else 0.1
        for k in begins:
            if mode[k] == 2:
                assert y[k] >= lines.up.level(r[k]) - room
            elif mode[k] == 1:
                assert y[k] <= lines.down.level(r[k]) + room
            else:
                left = lines.coast_above if mode[k - 1] == 1 else lines.coast_below
                assert left is not None
                assert (y[k] - left.level(r[k])) * (1.0 if mode[k - 1] == 1 else -1.0) >= -room
    assert (sampled.traces.mode == 0).any() == lines.coasts
    assert sampled.measures["switch_count"] >= 2


@each_kind
def test_drawn_plants_are_replayed_alone(tmp_path: Path, turns: str) -> None:
    system = rig(tmp_path, turns=turns, more=MORE)
    found = ft.validate_system(system).to_dict()
    (fraction,) = found["scenarios"][0]["limits"]
    assert fraction["of"] == 60 if "of" in fraction else True
    assert ft.simulate_system(system, replay=7).index == 7


@needs_gcc
@each_kind
def test_the_code_meets_its_vectors_and_its_description(tmp_path: Path, turns: str) -> None:
    made = ft.discretize_system(write(tmp_path, turns=turns))
    done = replayed(made.code(), tmp_path / "c", "gcc")
    assert done.returncode == 0, done.stdout + done.stderr
    found = made.to_dict()
    assert "hysteresis" not in found
    words = set(made.spec.lines.named("heater", "fan"))
    assert set(found["thresholds"]) == words


@each_kind
def test_a_certificate_says_what_it_does_not_model(tmp_path: Path, turns: str) -> None:
    system = rig(tmp_path, turns=turns)
    certificate = ft.prove_system(system, setpoints=(2.0, 8.0)).certificate
    assert certificate.verdict.value == "undecided"
    coasts = system.lines.coasts
    reasons = {
        APART: "heater: its plant is uncertain",
        ABSOLUTE: "an absolute line is not",
        COASTING: "coasting is not",
    }
    assert certificate.reason.startswith(reasons[turns])
    assert (certificate.bounded is None) == coasts
    document = json.loads(json.dumps(to_document(certificate)))
    again = from_document(document)
    assert again.model == certificate.model
    gains = {mode.name: mode.gains for mode in system.modes if mode.gains is not None}
    assert recheck_system(again, system, gains).accepted
    other = rig(tmp_path, turns=turns.replace("-0.", "-0.1").replace("below: 0.1", "below: 0.05"))
    assert not recheck_system(again, other, gains).accepted
    page = system_report_files(certificate, "K")["system_report.html"]
    assert isinstance(page, str)
    assert "to_fan_above" in page


def test_the_lines_are_told(tmp_path: Path) -> None:
    from fopi_tune.report.text.system_digital import system_digital_text

    text = " ".join(system_digital_text(ft.discretize_system(write(tmp_path, turns=COASTING))).plain.split())
    assert "fan from the setpoint + 0.6 on, heater from the setpoint - 0.4 on" in text.replace("\u00a0", " ")
    assert "heater rests from the setpoint + 0 on, fan from the setpoint + 0.1 on" in text.replace("\u00a0", " ")


def fed(folder: Path, turns: str = APART) -> Path:
    path = write(folder, turns=turns, more=MORE)
    text = path.read_text(encoding="utf-8")
    words = "spec: heater.yaml, feedforward: {static_gain: 0.04, rate_gain: 0.1},"
    path.write_text(text.replace("spec: heater.yaml,", words), encoding="utf-8")
    return path


@needs_gcc
def test_a_feed_forward_is_in_every_stage_or_refused_by_name(tmp_path: Path) -> None:
    path = fed(tmp_path)
    gains = {"heater": {"static_gain": 0.04, "rate_gain": 0.1}}
    made = ft.discretize_system(path)
    assert made.to_dict()["feedforward"] == gains
    done = replayed(made.code(), tmp_path / "c", "gcc")
    assert done.returncode == 0, done.stdout + done.stderr
    driven = ft.simulate_system(path).driven[0].traces
    (tmp_path / "plain").mkdir()
    plain = ft.simulate_system(write(tmp_path / "plain", turns=APART)).driven[0].traces
    assert np.abs(driven.output - plain.output).max() > 0.05
    assert ft.validate_system(path, samples=40).evidence.validation.samples == 40
    # each pulse of a sample is an impulse in continuous time, which the limits cut to nothing
    exact = ft.simulate_system(path, exact=True).driven[0].traces
    assert abs(exact.output[0, -1] - driven.output[0, -1]) < 0.3
    text = path.read_text(encoding="utf-8")
    path.write_text(text.replace(", output_limits: [0, 1]", ""), encoding="utf-8")
    with pytest.raises(DomainError, match="heater: the rate_gain of its feedforward makes an impulse of a step"):
        ft.simulate_system(path, exact=True)


def test_a_certificate_names_a_feed_forward(tmp_path: Path) -> None:
    system = load_system(fed(tmp_path, "hysteresis: 0.3\ninactive: reset"))
    certificate = ft.prove_system(system, setpoints=(2.0, 8.0)).certificate
    assert certificate.verdict.value == "undecided"
    assert certificate.reason == "heater: a feed-forward of the setpoint is not modelled in this proof"
    document = json.loads(json.dumps(to_document(certificate)))
    gains = {mode.name: mode.gains for mode in system.modes if mode.gains is not None}
    assert recheck_system(from_document(document), system, gains).accepted
    (tmp_path / "plain").mkdir()
    plain = rig(tmp_path / "plain", turns="hysteresis: 0.3\ninactive: reset")
    assert not recheck_system(from_document(document), plain, gains).accepted


def standing(folder: Path, turns: str) -> Path:
    """A rig that cools to 0 and is pulled from there by a load."""
    scenario = (
        "scenarios: [{name: day, duration_s: 30, initial_output: 4, before: free, reference: [{at_s: 0, value: 0}],"
        " load: [{at_s: 2, value: -0.2}, {at_s: 10, value: 0.03}, {at_s: 20, value: 0.2}]}]"
    )
    path = write(folder, turns=turns, more=MORE)
    text = path.read_text(encoding="utf-8")
    for name in ("heater", "fan"):
        text = text.replace(f"spec: {name}.yaml,", f"spec: {name}.yaml, standstill: {{hold_below_per_s: 0.3}},")
    begin, end = text.index("scenarios:"), text.index("\nlimits:") + 1
    path.write_text(text[:begin] + scenario + "\n" + text[end:], encoding="utf-8")
    return path


def test_an_output_that_stands_is_held_on_samples_and_in_continuous_time(tmp_path: Path) -> None:
    path = standing(tmp_path, COASTING)
    for exact in (False, True):
        t = ft.simulate_system(path, exact=exact).driven[0].traces
        y, time_s = t.output[0], t.time_s
        assert y.min() == 0.0
        # 0.03 drives the nominal fan's plant, 12/(2 s + 1), by 0.18 per s
        assert np.all(y[(time_s > 8.0) & (time_s < 19.9)] == 0.0)
        assert np.all(t.rate[0][(time_s > 8.0) & (time_s < 19.9)] == 0.0)
        assert y[time_s > 21.0].max() > 0.1
    found = ft.validate_system(path)
    assert found.evidence.validation.samples == 60
    assert ft.simulate_system(path, replay=5).driven[0].traces.output.min() == 0.0


def test_a_certificate_names_a_standstill(tmp_path: Path) -> None:
    system = load_system(standing(tmp_path, "hysteresis: 0.3\ninactive: reset"))
    certificate = ft.prove_system(system, setpoints=(2.0, 8.0)).certificate
    assert certificate.verdict.value == "undecided"
    assert certificate.reason == "heater: a standstill is not modelled in this proof"
    document = json.loads(json.dumps(to_document(certificate)))
    gains = {mode.name: mode.gains for mode in system.modes if mode.gains is not None}
    assert recheck_system(from_document(document), system, gains).accepted
    document["modes"][0]["hold_below_per_s"] = 0.4
    with pytest.raises(CertificateError):
        from_document(document)


def of_second_order(folder: Path) -> Path:
    path = write(folder, turns="hysteresis: 0.3\ninactive: reset", more=MORE)
    spec = folder / "heater.yaml"
    lag = "{model: lag, static_gain: 20, time_constant_s: {min: 3, max: 6, nominal: 4}}"
    plant = "{model: transfer_function, numerator: [20], denominator: [1.5, {min: 3, max: 6, nominal: 4}, 1]}"
    spec.write_text(spec.read_text(encoding="utf-8").replace(lag, plant), encoding="utf-8")
    return path


def test_a_plant_of_higher_order_is_driven_drawn_and_named_where_it_is_not_modelled(tmp_path: Path) -> None:
    path = of_second_order(tmp_path)
    driven = ft.simulate_system(path).driven[0]
    assert driven.measures["switch_count"] > 1
    assert ft.validate_system(path).evidence.validation.samples == 60
    assert ft.simulate_system(path, replay=3).plant["heater.denominator[1]"] != 4.0
    with pytest.raises(DomainError, match="its plant of order 2 is simulated on samples; leave `exact=True` out"):
        ft.simulate_system(path, exact=True)
    system = load_system(path)
    certificate = ft.prove_system(system, setpoints=(2.0, 8.0)).certificate
    assert certificate.reason == "heater: only plants of model lag or pole are handled"
    assert from_document(json.loads(json.dumps(to_document(certificate)))).model == certificate.model


@needs_gcc
def test_delays_of_their_own_are_driven_drawn_and_named_where_they_are_not_modelled(tmp_path: Path) -> None:
    path = write(tmp_path, turns="hysteresis: 0.3\ninactive: reset", more=MORE)
    before = ft.simulate_system(path).driven[0].traces
    spec = tmp_path / "fan.yaml"
    spec.write_text(
        spec.read_text(encoding="utf-8").replace("poles: 5", "poles: 5, delay_samples: 3"), encoding="utf-8"
    )
    after = ft.simulate_system(path).driven[0].traces
    # alike until the fan's first control, which now comes later
    first = int(np.argmax(before.mode[0] == 2))
    assert np.array_equal(before.output[0, : first + 1], after.output[0, : first + 1])
    assert np.abs(before.output - after.output).max() > 0.05
    assert ft.validate_system(path).evidence.validation.samples == 60
    code = ft.discretize_system(path).code()
    assert "0.0 in mode 1 and 3.0 in mode 2 samples were foreseen" in " ".join(code["fopi_rig_f64.h"].split())
    assert replayed(code, tmp_path / "c", "gcc").returncode == 0
    with pytest.raises(DomainError, match="delay_samples that differ are simulated on samples"):
        ft.simulate_system(path, exact=True)
    certificate = ft.prove_system(load_system(path), setpoints=(2.0, 8.0)).certificate
    assert certificate.verdict.value == "undecided"
    assert "delay" in certificate.reason
    page = system_report_files(certificate)["system_report.html"]
    assert isinstance(page, str)
    assert "0 in the heater and 3 in the fan" in page


def test_an_empty_load_is_none(tmp_path: Path) -> None:
    path = write(tmp_path)
    path.write_text(path.read_text().replace("duration_s: 40,", "duration_s: 40, load: [],"))
    assert load_system(path).scenarios[0].load == ()


def test_continuous_time_names_the_mode_whose_rate_is_limited(tmp_path: Path) -> None:
    path = write(tmp_path)
    path.write_text(path.read_text().replace("output_limits: [-1, 0]", "output_limits: [-1, 0], output_rate_per_s: 1"))
    with pytest.raises(DomainError, match="fan: output_rate_per_s belongs to the loop on samples"):
        ft.simulate_system(path, exact=True)
