"""What a mode of a system says of itself: a feed-forward of the setpoint."""

from __future__ import annotations

import math
from pathlib import Path

import jsonschema
import pytest
from cases.two_modes import rig, write
from ruamel.yaml import YAML

from fopi_tune.core.terms.feedforward import FeedForward
from fopi_tune.errors import SpecError
from fopi_tune.spec.load import load_system
from fopi_tune.spec.systems import system_json_schema


def with_words(folder: Path, words: str, mode: str = "heater") -> Path:
    path = write(folder)
    text = path.read_text(encoding="utf-8")
    path.write_text(text.replace(f"spec: {mode}.yaml,", f"spec: {mode}.yaml, {words},"), encoding="utf-8")
    return path


@pytest.mark.parametrize(
    ("words", "fed"),
    [
        ("feedforward: {static_gain: 0.05}", FeedForward(0.05)),
        ("feedforward: {static_gain: 0.05, rate_gain: 0.2}", FeedForward(0.05, 0.2)),
        ("feedforward: {rate_gain: 0.2}", FeedForward(0.0, 0.2)),
        # the nominal plant is 20/(4 s + 1)
        ("feedforward: inverse_of_nominal_lag", FeedForward(1.0 / 20.0, 4.0 / 20.0)),
    ],
)
def test_a_feed_forward_is_understood_as_meant(tmp_path: Path, words: str, fed: FeedForward) -> None:
    path = with_words(tmp_path, words)
    first, second = load_system(path).modes
    assert first.feedforward is not None
    assert first.feedforward.static_gain == pytest.approx(fed.static_gain, rel=1e-15)
    assert first.feedforward.rate_gain == pytest.approx(fed.rate_gain, rel=1e-15)
    assert second.feedforward is None
    jsonschema.validate(YAML(typ="safe", pure=True).load(path.read_text()), system_json_schema())


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ("feedforward: {}", "system.heater.feedforward: nothing is fed forward; write static_gain, rate_gain, or both"),
        ("feedforward: inverse", "system.heater.feedforward: 'inverse' is not known here"),
        (
            "feedforward: bumpless",
            "system.heater.feedforward: 'bumpless' is not known here; write inverse_of_nominal_lag, or the gains",
        ),
        ("feedforward: {static_gian: 1}", "system.heater.feedforward.static_gian"),
    ],
)
def test_what_is_no_feed_forward_is_told(tmp_path: Path, words: str, said: str) -> None:
    with pytest.raises(SpecError) as refused:
        load_system(with_words(tmp_path, words))
    found = refused.value.problems[0]
    assert f"{found.path}: {found.message}".startswith(said)


def test_only_a_lag_has_the_inverse_of_one(tmp_path: Path) -> None:
    path = with_words(tmp_path, "feedforward: inverse_of_nominal_lag")
    spec = tmp_path / "heater.yaml"
    spec.write_text(spec.read_text().replace(LAG, "{model: pole, gain: 5, pole_rad_s: 0}"))
    with pytest.raises(SpecError, match=r"inverse_of_nominal_lag is of a lag .* which the heater.s plant is not"):
        load_system(path)


def test_a_bumpless_start_is_refused_beside_it(tmp_path: Path) -> None:
    path = with_words(tmp_path, "feedforward: {static_gain: 0.1}")
    path.write_text(path.read_text().replace("duration_s: 40,", "duration_s: 40, bumpless: yes,"))
    with pytest.raises(SpecError, match="heater's feedforward would come on top of the input that held the plant"):
        load_system(path)


def test_a_standstill_is_understood_as_meant(tmp_path: Path) -> None:
    path = with_words(tmp_path, "standstill: {hold_below_per_s: 0.4}", "fan")
    system = load_system(path)
    assert [mode.hold_below_per_s for mode in system.modes] == [None, 0.4]
    assert system.hold_below == (-math.inf, 0.4)
    assert rig(tmp_path).hold_below == ()


@pytest.mark.parametrize(
    ("words", "scenario", "said"),
    [
        ("standstill: {hold_below_per_s: -1}", "", "system.fan.standstill.hold_below_per_s: -1 is out of range"),
        (
            "standstill: 0.4",
            "",
            "system.fan.standstill: '0.4' is written where a mapping",
        ),
        (
            "standstill: {hold_below_per_s: 0}",
            "initial_output: -2, ",
            "scenarios[0].initial_output: the fan's standstill",
        ),
    ],
)
def test_what_is_no_standstill_is_told(tmp_path: Path, words: str, scenario: str, said: str) -> None:
    path = with_words(tmp_path, words, "fan")
    path.write_text(path.read_text().replace("duration_s: 40,", f"duration_s: 40, {scenario}"))
    with pytest.raises(SpecError) as refused:
        load_system(path)
    found = refused.value.problems[0]
    assert f"{found.path}: {found.message}".startswith(said)


LAG = "{model: lag, static_gain: 20, time_constant_s: {min: 3, max: 6, nominal: 4}}"


def with_plant(folder: Path, plant: str, words: str = "") -> Path:
    path = with_words(folder, words) if words else write(folder)
    spec = folder / "heater.yaml"
    spec.write_text(spec.read_text().replace(LAG, plant), encoding="utf-8")
    return path


@pytest.mark.parametrize(
    "plant",
    [
        "{model: transfer_function, numerator: [20], denominator: [{min: 2, max: 3}, 5, 1]}",
        "{model: transfer_function, numerator: [20], denominator: [1, 3, 3, 1]}",
        "{parameters: {t: {min: 1, max: 2}}, model: transfer_function, numerator: [20], denominator: [[1, 1], [t, 1]]}",
    ],
)
def test_a_plant_of_higher_order_is_understood_as_meant(tmp_path: Path, plant: str) -> None:
    first, second = load_system(with_plant(tmp_path, plant)).modes
    assert len(first.spec.plant.assemble({})[1]) > 2
    assert len(second.spec.plant.assemble({})[1]) == 2


def test_zeros_and_dead_times_are_understood_as_meant(tmp_path: Path) -> None:
    plant = "{model: transfer_function, numerator: [1, 20], denominator: [2, 5, 1], dead_time_s: {min: 0, max: 0.3}}"
    first, second = load_system(with_plant(tmp_path, plant)).modes
    assert (first.spec.plant.dead_time.min, first.spec.plant.dead_time.max) == (0.0, 0.3)
    assert len(first.spec.plant.assemble({})[0]) == 2
    assert second.spec.plant.dead_time.max == 0.0


@pytest.mark.parametrize(
    ("plant", "words", "said"),
    [
        (
            "{model: transfer_function, numerator: [1, 20], denominator: [2, 5]}",
            "",
            "has fewer zeros than poles: as many",
        ),
        (
            "{model: transfer_function, numerator: [0, 1, 20], denominator: [2, 5, 1]}",
            "",
            "its numerator begins with 0, in place of the direct path that a mode has not; leave it out",
        ),
        (
            "{model: transfer_function, numerator: [20], denominator: [2, 5, 1]}",
            "standstill: {hold_below_per_s: 1}",
            "the heater's plant is of higher order, and would move on; write a lag",
        ),
        (
            "{model: transfer_function, numerator: [20], denominator: [2, 5, 1]}",
            "feedforward: inverse_of_nominal_lag",
            "which the heater's plant is not",
        ),
    ],
)
def test_plants_that_take_no_turns_are_told(tmp_path: Path, plant: str, words: str, said: str) -> None:
    with pytest.raises(SpecError, match=said):
        load_system(with_plant(tmp_path, plant, words))


def with_delays(folder: Path, heater: str, fan: str) -> Path:
    path = write(folder)
    for name, delay in (("heater", heater), ("fan", fan)):
        spec = folder / f"{name}.yaml"
        spec.write_text(spec.read_text().replace("poles: 5", f"poles: 5, delay_samples: {delay}"), encoding="utf-8")
    return path


def test_each_mode_has_a_computing_delay_of_its_own(tmp_path: Path) -> None:
    assert load_system(with_delays(tmp_path, "0", "2")).own_delays == (0, 2)
    (tmp_path / "same").mkdir()
    assert load_system(with_delays(tmp_path / "same", "0.4", "0.4")).own_delays == ()


def test_delays_that_differ_are_whole(tmp_path: Path) -> None:
    with pytest.raises(SpecError, match=r"is 1.5, the heater's 1.0; those that differ are whole samples"):
        load_system(with_delays(tmp_path, "1.0", "1.5"))


def test_modes_without_it_have_none(tmp_path: Path) -> None:
    assert [mode.feedforward for mode in rig(tmp_path).modes] == [None, None]
