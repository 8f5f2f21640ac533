"""Margins in words: finite, infinite, and those that an unstable loop has not."""

from __future__ import annotations

import json
import math

import pytest

from fopi_tune.core.controller import FoPi
from fopi_tune.core.margins import margins
from fopi_tune.core.plant import Plant
from fopi_tune.report.text.formatting import (
    TIE,
    drawn_phrase,
    endless_phrase,
    gains_lines,
    margins_phrase,
    missed_digits,
    next_sentence,
)
from fopi_tune.results.documents import margins_dict

LAG = Plant((1.0,), (1.0, 1.0))


def phrase(controller: FoPi, plant: Plant) -> str:
    # as it is read back from a file
    plain = json.loads(json.dumps(margins_dict(margins(controller, plant)), allow_nan=False))
    return margins_phrase(plain).replace(TIE, " ")


@pytest.mark.parametrize(
    ("controller", "plant", "words"),
    [
        # 2/s: 90 deg and pi/4 s at 2 rad/s
        (
            FoPi(2.0, 0.0, 1.0),
            Plant((1.0,), (1.0, 0.0)),
            "crossover 2 rad/s, phase margin 90 deg, gain margin infinite, delay margin 0.7854 s",
        ),
        (
            FoPi(0.5, 0.0, 1.0),
            LAG,
            "no gain crossover, phase margin infinite, gain margin infinite, delay margin infinite",
        ),
        (
            FoPi(-3.0, 0.0, 1.0),
            Plant((1.0, 2.0), (1.0, 1.0)),
            "no gain crossover, phase margin infinite, gain margin infinite, gain reduction margin -9.5424 dB, "
            "delay margin 0 s",
        ),
        # an unstable plant is told as any other once its loop is stable
        (
            FoPi(2.0, 0.0, 1.0),
            Plant((1.0,), (1.0, -1.0)),
            "crossover 1.7321 rad/s, phase margin 60 deg, gain margin infinite, gain reduction margin -6.0206 dB, "
            "delay margin 0.6046 s",
        ),
        # s^-1.9/s: -171 - 90 deg
        (
            FoPi(0.0, 1.0, 1.9),
            Plant((1.0,), (1.0, 0.0)),
            "no margin: unstable; crosses |L| = 1 at 1 rad/s, -81 deg from -1",
        ),
        (FoPi(0.5, 0.0, 1.0), Plant((1.0,), (1.0, -1.0)), "no margin: unstable; |L| never crosses 1"),
    ],
)
def test_margins_are_told_as_what_they_are(controller: FoPi, plant: Plant, words: str) -> None:
    assert phrase(controller, plant) == words


def test_every_crossing_of_an_unstable_loop_is_told() -> None:
    # an undamped plant: |L| = 1 on both sides of its pole, and below
    words = phrase(FoPi(0.1, 0.05, 0.5), Plant((1.0,), (1.0, 0.0, 1.0)))
    assert words.startswith("no margin: unstable; crosses |L| = 1 at ")
    assert words.count("deg from -1") == 3
    assert words.count(", and at ") == 2


def test_an_infinite_margin_says_which_crossover_is_missing() -> None:
    assert endless_phrase("gain_margin_db") == "no phase crossover sets it"
    assert endless_phrase("phase_margin_deg") == endless_phrase("delay_margin_s") == "no gain crossover sets it"


@pytest.mark.parametrize(
    ("name", "upper", "met", "words"),
    [
        ("phase_margin_deg", False, True, "infinite"),
        ("phase_margin_deg", False, False, "none"),
        ("phase_margin_deg", True, False, "infinite or none"),
        ("crossover_rad_s", False, False, "none"),
        ("crossover_rad_s", True, False, "none"),
        ("settling_time_s", True, False, "infinite"),
        ("sensitivity_db", True, False, "infinite"),
    ],
)
def test_what_a_drawn_plant_lacks_is_told_apart_from_what_does_not_end(
    name: str, upper: bool, met: bool, words: str
) -> None:
    assert drawn_phrase(name, upper, met) == words


def test_no_number_that_is_infinite_reaches_the_json_and_a_flag_stays_one() -> None:
    stable, unstable = (margins_dict(margins(FoPi(k, 0.0, 1.0), Plant((1.0,), (1.0, -1.0)))) for k in (2.0, 0.5))
    endless = margins_dict(margins(FoPi(0.5, 0.0, 1.0), LAG))
    assert stable is not None
    assert unstable is not None
    assert endless is not None
    assert (stable["stable"], unstable["stable"], endless["stable"]) == (True, False, True)
    assert type(stable["stable"]) is bool
    assert stable["angles_from_minus_one_deg"] == pytest.approx([60.0])
    assert unstable["phase_margin_deg"] is unstable["gain_margin_db"] is endless["phase_margin_deg"] is None
    assert not any(isinstance(value, float) and math.isinf(value) for value in endless.values())


def test_long_gains_do_not_touch_their_formula() -> None:
    short, long, longest = FoPi(0.09, 0.025, 0.8), FoPi(0.010885, 0.23023, 0.79673), FoPi(1.0885e-5, 2.3023e-5, 0.79673)
    lines = [line for line, _ in gains_lines({"throttle": short, "brake": long, "other": longest})]
    assert lines == [
        "throttle  kp = 0.09   ki = 0.025   alpha = 0.8          C(s) = kp + ki / s^alpha",
        "brake     kp = 0.010885  ki = 0.23023  alpha = 0.79673  C(s) = kp + ki / s^alpha",
        "other     kp = 1.0885e-05   ki = 2.3023e-05   alpha = 0.79673",
    ]


@pytest.mark.parametrize("name", ["retarder", "retarders", "hysteresis2", "r" * 32])
def test_a_modes_name_of_any_length_stands_apart_from_its_gains(name: str) -> None:
    (line, _), (fan, _) = gains_lines({name: FoPi(0.09, 0.025, 0.8), "fan": FoPi(0.07, 0.11, 0.45)})
    assert fan.startswith("fan       kp = 0.07 ")
    assert line.startswith(f"{name} ")
    assert len(line) <= 80


def test_a_value_that_misses_a_limit_has_the_digits_that_tell_them_apart() -> None:
    assert missed_digits(14.6040615, (60.0,)) == 5
    assert missed_digits(59.99999, (60.0,)) == 7
    assert missed_digits(60.0 - 1e-12, (60.0,)) == 9


@pytest.mark.parametrize(
    ("words", "told"),
    [
        ("there are no gains", "There are no gains."),
        ("All is proved.", "All is proved."),
        ("kp cannot be larger", "kp cannot be larger."),
        ("phase_margin_deg is undecided", "phase_margin_deg is undecided."),
        ("|S| is small", "|S| is small."),
    ],
)
def test_a_sentence_that_follows_another_has_a_capital_unless_a_name_begins_it(words: str, told: str) -> None:
    assert next_sentence(words) == told
