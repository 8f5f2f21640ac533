"""What is wrong with a spec: every mistake with its place and what to do about it."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
from cases.project import CONTINUOUS, IMPORTED

from fopi_tune.errors import SpecError
from fopi_tune.spec import load_spec, parse_spec

BRAKE = (CONTINUOUS / "brake.yaml").read_text(encoding="utf-8")
POLE = "schema: 1\nname: a\nplant: {model: pole, gain: 2, pole_rad_s: 0.5}\n"
LAG = "schema: 1\nname: a\nplant: {model: lag, static_gain: 1, time_constant_s: {min: 1, max: 3}}\n"


def lines(text: str) -> list[str]:
    with pytest.raises(SpecError) as caught:
        parse_spec(text, "s.yaml")
    return [str(problem) for problem in caught.value.problems]


def brake_with(old: str, new: str) -> str:
    assert old in BRAKE
    return BRAKE.replace(old, new, 1)


def plant_lines(text: str) -> list[str]:
    return lines(f"schema: 1\nname: a\nobjective: {{maximize: ki}}\nplant: {text}\n")


def requirements(*items: str, head: str = LAG) -> str:
    return head + "requirements:\n" + "".join(f"- {item}\n" for item in items)


def test_every_mistake_is_reported_at_once_in_the_order_of_the_file() -> None:
    text = """\
schema: 1
name: all wrong
plant:
  model: lag
  static_gian: 1.0
  time_constant_s: {nominal: 5, min: 1.6, max: 3.1}
  dead_time_s: -1
controller:
  kp: {min: 2, max: 1}
  alpha: 2
requirements:
  - crossover_hz: {equals: 0.3}
  - phase_margin_deg: {atleast: 80}
    on: nominl
  - gain_margin_db: {at_least: yes}
  - sensitivity_db: {at_most: 0,5}
objective: {maximize: kp}
name: again
extra: 1
"""
    assert lines(text) == [
        "s.yaml:2:7: name: 'all wrong' cannot be used; a name becomes a folder's: write 1 to 64 letters, digits, "
        "'.', '_' or '-', the first a letter or digit",
        "s.yaml:5:3: plant.static_gian: the key is not known here; did you mean 'static_gain'?",
        "s.yaml:6:30: plant.time_constant_s.nominal: nominal 5.0 lies outside [1.6, 3.1]; move it inside",
        "s.yaml:9:13: controller.kp.min: min 2.0 is greater than max 1.0; swap them",
        "s.yaml:10:10: controller.alpha: 2 is out of range; it must be greater than 0.0 and less than 2.0",
        "s.yaml:12:5: requirements[0].crossover_hz: frequencies are in rad/s: multiply by 2π and write crossover_rad_s",
        "s.yaml:13:24: requirements[1].phase_margin_deg.atleast: the key is not known here; did you mean 'at_least'?",
        "s.yaml:14:9: requirements[1].on: 'nominl' is not known here; did you mean 'nominal'?",
        "s.yaml:15:32: requirements[2].gain_margin_db.at_least: 'yes' is yes or no where a number belongs; "
        "write a number",
        "s.yaml:16:33: requirements[3].sensitivity_db.5: is this the rest of a number with a decimal comma? "
        "write it with a decimal point",
        "s.yaml:17:23: objective.maximize: 'kp' is not known here; write ki",
        "s.yaml:18:1: name: the key is on line 2 and again on line 18; keep one",
        "s.yaml:19:1: extra: the key is not known here; remove it or write description, digital, validation, "
        "scenarios or limits",
    ]


# every number of the language: a place in a whole spec, then the place that is reported
EVERY_NUMBER = """\
schema: 1
name: a
plant: {model: lag, static_gain: 1, time_constant_s: {nominal: 2, min: 1, max: 3}, dead_time_s: 0}
controller: {kp: {min: 0, max: 9}, ki: 1, alpha: {min: 0.5, max: 1.5}}
requirements:
- crossover_rad_s: {equals: 0.3}
  on: nominal
- phase_margin_deg: {at_least: 50}
- gain_margin_db: {at_most: 40}
- delay_margin_s: {between: [0.1, 8]}
- sensitivity_db: {at_most: 6}
  from_rad_s: 0.01
  to_rad_s: 5
- loop_gain_db: {at_most: 30}
  at_rad_s: 0.02
objective: {minimize: iae_disturbance, horizon_s: 60}
digital: {sample_time_s: 0.2, poles: 7, band_rad_s: [0.001, 1000], delay_samples: 0.25}
validation: {samples: 100, seed: 4}
"""
PLACES = {
    "schema: 1": "1:9: schema",
    "static_gain: 1": "3:34: plant.static_gain",
    "nominal: 2": "3:64: plant.time_constant_s.nominal",
    "min: 1": "3:72: plant.time_constant_s.min",
    "max: 3": "3:80: plant.time_constant_s.max",
    "dead_time_s: 0": "3:97: plant.dead_time_s",
    "min: 0": "4:24: controller.kp.min",
    "max: 9": "4:32: controller.kp.max",
    "ki: 1": "4:40: controller.ki",
    "min: 0.5": "4:56: controller.alpha.min",
    "max: 1.5": "4:66: controller.alpha.max",
    "equals: 0.3": "6:29: requirements[0].crossover_rad_s.equals",
    "at_least: 50": "8:32: requirements[1].phase_margin_deg.at_least",
    "at_most: 40": "9:29: requirements[2].gain_margin_db.at_most",
    "between: [0.1": "10:30: requirements[3].delay_margin_s.between[0]",
    "0.1, 8": "10:35: requirements[3].delay_margin_s.between[1]",
    "at_most: 6": "11:29: requirements[4].sensitivity_db.at_most",
    "from_rad_s: 0.01": "12:15: requirements[4].from_rad_s",
    "to_rad_s: 5": "13:13: requirements[4].to_rad_s",
    "at_rad_s: 0.02": "15:13: requirements[5].at_rad_s",
    "horizon_s: 60": "16:51: objective.horizon_s",
    "sample_time_s: 0.2": "17:26: digital.sample_time_s",
    "poles: 7": "17:38: digital.poles",
    "[0.001": "17:54: digital.band_rad_s[0]",
    "001, 1000": "17:61: digital.band_rad_s[1]",
    "delay_samples: 0.25": "17:83: digital.delay_samples",
    "samples: 100": "18:23: validation.samples",
    "seed: 4": "18:34: validation.seed",
}


@pytest.mark.thinned(3)
@pytest.mark.parametrize(("where", "place"), PLACES.items(), ids=PLACES.values())
def test_every_number_is_reported_at_its_own_place(where: str, place: str) -> None:
    assert EVERY_NUMBER.count(where) >= 1
    parse_spec(EVERY_NUMBER)
    start = max(where.rfind(" "), where.rfind("[")) + 1
    text = EVERY_NUMBER.replace(where, where[:start] + "x", 1)
    assert lines(text) == [f"s.yaml:{place}: 'x' is not a number; write one such as 0.5 or 1e-3"]


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        (
            "time_constant_s:",
            "time_constant:",
            "7:3: plant.time_constant: the unit is part of the name; write time_constant_s (s)",
        ),
        (
            "time_constant_s:",
            "time_constant_ms:",
            "7:3: plant.time_constant_ms: times are in seconds: divide by 1000 and write time_constant_s",
        ),
        (
            "time_constant_s:",
            "Time-Constant-s:",
            "7:3: plant.Time-Constant-s: the key is not known here; did you mean 'time_constant_s'?",
        ),
        (
            "phase_margin_deg: {equals",
            "phase_margin_rad: {equals",
            "16:5: requirements[1].phase_margin_rad: angles are in degrees: multiply by 180/π and "
            "write phase_margin_deg",
        ),
        (
            "to_rad_s",
            "to_hz",
            "21:5: requirements[4].to_hz: frequencies are in rad/s: multiply by 2π and write to_rad_s",
        ),
        (
            "crossover_rad_s",
            "crossover_rad",
            "14:5: requirements[0].crossover_rad: the unit is wrong; write crossover_rad_s (rad/s)",
        ),
        (
            "sample_time_s",
            "sample_time_ms",
            "23:11: digital.sample_time_ms: times are in seconds: divide by 1000 and write sample_time_s",
        ),
        ("model: lag", "model: lagg", "5:10: plant.model: 'lagg' is not known here; did you mean 'lag'?"),
        (
            "rule: tustin",
            "rule: bilinear",
            "23:95: digital.rule: 'bilinear' is not known here; write tustin or matched",
        ),
        ("schema: 1", "schema: 2", "1:9: schema: version 2 is newer than this tool, which reads 1; update fopi-tune"),
        ("schema: 1", "schema: 0", "1:9: schema: there is no version 0; write 1"),
        ("schema: 1\n", "", "1:1: schema: the key is missing; add it"),
        ("name: brake", "name: 2024", "2:7: name: '2024' is not text; put it in quotes"),
        ("name: brake", "name:", "2:1: name: the value is missing; write text"),
        ("description: Robust", "description: 5 #", "3:14: description: '5' is not text; put it in quotes"),
        (
            "on: nominal",
            "on: nominal\n    at_rad_s: 1",
            "16:5: requirements[0].at_rad_s: crossover_rad_s is one number a loop, not a function of frequency; "
            "remove the key",
        ),
        (
            "{at_least: 80}",
            "80",
            "18:23: requirements[2].phase_margin_deg: '80' is written where a mapping belongs; "
            "write one such as {at_least: 60} or {between: [60, 70]}",
        ),
        (
            "{at_least: 80}",
            "{at_least: 80, at_most: 99}",
            "18:38: requirements[2].phase_margin_deg.at_most: a second relation beside at_least on line 18; "
            "write one relation, such as {at_least: 60} or {between: [60, 70]}",
        ),
        (
            "{at_least: 80}",
            "{between: [90, 80]}",
            "18:33: requirements[2].phase_margin_deg.between: 90.0 is not less than 80.0; write [low, high]",
        ),
        (
            "to_rad_s: 0.02",
            "gain_margin_db: {at_least: 3}",
            "21:5: requirements[4].gain_margin_db: a second quantity beside sensitivity_db on line 20; "
            "write one quantity, such as {phase_margin_deg: {at_least: 60}}",
        ),
        ("equals: 0.3", "equals: 0", "14:31: requirements[0].crossover_rad_s.equals: must be greater than 0 rad/s"),
        (
            "{at_least: 80}",
            "{at_least: 180.5}",
            "18:34: requirements[2].phase_margin_deg.at_least: must be at most 180 deg, "
            "the largest angle between L and -1",
        ),
        (
            "{at_least: 80}",
            "{at_most: 400}",
            "18:33: requirements[2].phase_margin_deg.at_most: must be at most 180 deg, "
            "the largest angle between L and -1",
        ),
        (
            "{at_least: 80}",
            "{between: [80, 190]}",
            "18:38: requirements[2].phase_margin_deg.between[1]: must be at most 180 deg, "
            "the largest angle between L and -1",
        ),
        (
            "equals: 90",
            "equals: 270",
            "16:32: requirements[1].phase_margin_deg.equals: must be at most 180 deg, "
            "the largest angle between L and -1",
        ),
        (
            "at_most: -20",
            "equals: -20",
            "20:30: requirements[4].sensitivity_db.equals: no controller keeps a function of frequency at one value; "
            "add at_rad_s, or write between",
        ),
        (
            "minimize: phase_margin_spread_deg",
            "minimize: sensitivity_peak_db, horizon_s: 3",
            "22:55: objective.horizon_s: horizon_s belongs to minimize: iae_disturbance alone; remove it",
        ),
        (
            "minimize: phase_margin_spread_deg",
            "maximize: ki, horizon_s: 3",
            "22:27: objective.horizon_s: horizon_s belongs to minimize: iae_disturbance alone; remove it",
        ),
        (
            "seed: 1",
            "seed: 9223372036854775808",
            "24:36: validation.seed: 9223372036854775808 is out of range; "
            "it must be at least 0 and at most 9223372036854775807",
        ),
        (
            "samples: 10000",
            "samples: 1.5",
            "24:23: validation.samples: 1.5 is not a whole number; write one, such as 1 or 2",
        ),
    ],
)
def test_a_mistake_is_reported_with_its_place_and_what_to_do(old: str, new: str, expected: str) -> None:
    assert lines(brake_with(old, new)) == [f"s.yaml:{expected}"]


def test_both_ends_of_a_range_of_phase_margins_above_180_deg_are_reported() -> None:
    found = lines(brake_with("{at_least: 80}", "{between: [181, 190]}"))
    assert [line.partition(": must")[0] for line in found] == [
        "s.yaml:18:34: requirements[2].phase_margin_deg.between[0]",
        "s.yaml:18:39: requirements[2].phase_margin_deg.between[1]",
    ]


@pytest.mark.parametrize("words", ["{at_least: 180}", "{at_most: 180}", "{between: [0, 180]}"])
def test_a_phase_margin_of_180_deg_can_be_asked_for(words: str) -> None:
    assert parse_spec(requirements(f"phase_margin_deg: {words}"), "s.yaml").requirements[0].limits[-1] == 180.0


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("{model: pole, gain: 1}", ["4:8: plant.pole_rad_s: the key is missing; add it"]),
        (
            "{model: lag, static_gain: {min: -1, max: 1}, time_constant_s: 0}",
            [
                "4:34: plant.static_gain: must not be or contain 0; the family's sign must be known",
                "4:70: plant.time_constant_s: must be greater than 0; "
                "write an unstable or integrating plant as model: pole",
            ],
        ),
        (
            "{model: transfer_function, numerator: [1, 2, 3], denominator: [{min: -1, max: 1}, 1]}",
            [
                "4:46: plant.numerator: is longer than the denominator; "
                "a plant must be proper: leave leading zeros out",
                "4:71: plant.denominator[0]: must not be or contain 0; the family's sign must be known",
            ],
        ),
        (
            "{model: transfer_function, numerator: [0, 0], denominator: [1, 1]}",
            ["4:46: plant.numerator: can be 0 altogether, and no plant is left; keep one entry away from 0"],
        ),
        (
            "{model: transfer_function, numerator: [1, x], denominator: [1, {min: 3, max: 1}]}",
            [
                "4:50: plant.numerator[1]: 'x' is not a number; write one such as 0.5 or 1e-3",
                "4:77: plant.denominator[1].min: min 3.0 is greater than max 1.0; swap them",
            ],
        ),
        (
            f"{{model: transfer_function, numerator: [], denominator: [{', '.join(['1'] * 33)}]}}",
            [
                "4:46: plant.numerator: the list has 0 entries; write a list of 1 to 32 entries",
                "4:63: plant.denominator: the list has 33 entries; write a list of 1 to 32 entries",
            ],
        ),
        (
            "{model: pole, gain: {min: -1.7e308, max: 1e-320}, pole_rad_s: 1.0e+101}",
            [
                "4:34: plant.gain.min: -1.7e308 is too large to compute with; write at most 1e+100",
                "4:49: plant.gain.max: 1e-320 is too small to compute with; write 0, or at least 1e-100",
                "4:70: plant.pole_rad_s: 1.0e+101 is too large to compute with; write at most 1e+100",
            ],
        ),
        (
            "{gain: 1}",
            [
                "4:8: plant.model: the key is missing; add it with lag, pole, transfer_function, fractional, "
                "frequency_response or "
                "zeros_poles"
            ],
        ),
        (
            "lag",
            [
                "4:8: plant: 'lag' is written where a mapping belongs; "
                "write one such as {model: lag, static_gain: 1.0, time_constant_s: 2.0}"
            ],
        ),
    ],
)
def test_a_plant_that_cannot_be_is_reported(text: str, expected: list[str]) -> None:
    assert plant_lines(text) == [f"s.yaml:{line}" for line in expected]


@pytest.mark.parametrize(
    ("pair", "column", "path", "message"),
    [
        (
            ("phase_margin_deg: {at_least: 80}", "{phase_margin_deg: {at_most: 70}, on: nominal}"),
            32,
            "requirements[1].phase_margin_deg.at_most",
            "at_most 70 on line 6 contradicts at_least 80 on line 5; relax one",
        ),
        (
            ("{phase_margin_deg: {equals: 90}, on: nominal}", "phase_margin_deg: {between: [91, 95]}"),
            31,
            "requirements[1].phase_margin_deg.between",
            "between [91, 95] on line 6 contradicts equals 90 on line 5; relax one",
        ),
        (
            ("{sensitivity_db: {at_most: -20}, to_rad_s: 1}", "{sensitivity_db: {at_least: 0}, at_rad_s: 0.5}"),
            31,
            "requirements[1].sensitivity_db.at_least",
            "at_least 0 on line 6 contradicts at_most -20 on line 5; relax one",
        ),
    ],
)
def test_a_contradiction_names_both_lines(pair: tuple[str, str], column: int, path: str, message: str) -> None:
    assert lines(requirements(*pair)) == [f"s.yaml:6:{column}: {path}: {message}"]


def test_an_equality_over_an_uncertain_family_is_refused_with_a_way_out() -> None:
    assert lines(requirements("phase_margin_deg: {equals: 60}")) == [
        "s.yaml:5:30: requirements[0].phase_margin_deg.equals: "
        "not every plant of an uncertain family can have the same value; write between, or on: nominal"
    ]


@pytest.mark.parametrize(
    ("keys", "expected"),
    [
        (
            "at_rad_s: 1, to_rad_s: 2",
            "to_rad_s: is given beside at_rad_s; keep at_rad_s alone, or from_rad_s and to_rad_s",
        ),
        (
            "from_rad_s: 3, to_rad_s: 2",
            "from_rad_s: from 3.0 is not less than to 2.0; swap them, or write at_rad_s for one",
        ),
        ("from_rad_s: 0", "from_rad_s: 0 is out of range; it must be greater than 0"),
    ],
)
def test_a_band_that_cannot_be_is_reported(keys: str, expected: str) -> None:
    (line,) = lines(requirements(f"{{sensitivity_db: {{at_most: 6}}, {keys}}}"))
    assert line.endswith(f": requirements[0].{expected}")


@pytest.mark.parametrize(
    ("tail", "expected"),
    [
        ("", "1:1: there is nothing to design for; write at least one requirement or an objective"),
        (
            "requirements: []\n",
            "4:15: requirements: there is nothing to design for; write at least one requirement or an objective",
        ),
        (
            "requirements:\n",
            "4:1: requirements: nothing is written where a list belongs; write a list of at most 500 entries",
        ),
    ],
)
def test_a_spec_without_anything_to_do_is_refused(tail: str, expected: str) -> None:
    assert lines(POLE + tail) == [f"s.yaml:{expected}"]


def test_a_fixed_integral_gain_cannot_be_maximised() -> None:
    text = POLE + "objective: {maximize: ki}\ncontroller:\n  ki: 1\n"
    assert lines(text) == [
        "s.yaml:4:23: objective.maximize: ki is fixed on line 6; give it a range there or choose another objective"
    ]


INTEGRAL_TIME = "the integral term is ki/s^alpha; write ki; ki = kp/Ti for alpha: 1"
DERIVATIVE = (
    "write structure: pid, or fopid with an order mu, kd in place of a derivative time (kd = kp Td), and its filter's "
    "time"
)
DERIVATIVE_ORDER = "write structure: fopid and mu, the order of the derivative kd s^mu/(Tf s + 1)"
FILTER = "write derivative_filter_time_constant_s, Tf of kd s^mu/(Tf s + 1); Tf = Td/N"
ONLY_PID = "only structure: pid or fopid has a derivative; write structure: pid, or remove it"
ONLY_FOPID = "only structure: fopid has an order mu; write structure: fopid, or remove it"
IMPROPER = (
    "with mu above 1 the controller is improper: behind the filter of first order its gain grows without end with the "
    "frequency; write an order, or a max, of at most 1"
)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        (
            "{alpha: {min: 0, max: 1}}",
            "5:27: controller.alpha.min: 0 is out of range; it must be greater than 0.0 and less than 2.0",
        ),
        (
            "{alpha: {min: 1.95}}",
            "5:27: controller.alpha.min: min 1.95 is greater than max 1.9 (the default; write max as well)",
        ),
        (
            "{structure: pid}",
            "5:13: controller: structure pid needs derivative_filter_time_constant_s, Tf of kd s/(Tf s + 1): without "
            "it the controller's gain grows without end with the frequency; write a time of a tenth of the derivative "
            "time kd/kp or less",
        ),
        (
            "{structure: pid, derivative_filter_time_constant_s: 0}",
            "5:65: controller.derivative_filter_time_constant_s: 0 is out of range; it must be greater than 0.0",
        ),
        (
            "{structure: pid, alpha: 0.9, derivative_filter_time_constant_s: 1}",
            "5:37: controller.alpha: the integral of structure pid has the order 1; remove alpha, or write "
            "structure: fopid",
        ),
        ("{structure: pd}", "5:25: controller.structure: 'pd' is not known here; write pid, and ki: 0 beside it"),
        ("{structure: fopd}", "5:25: controller.structure: 'fopd' is not known here; write fopid, and ki: 0 beside it"),
        (
            "{structure: fopid}",
            "5:13: controller: structure fopid needs derivative_filter_time_constant_s, Tf of kd s^mu/(Tf s + 1): "
            "without it the controller's gain grows without end with the frequency; write a time of a tenth of the "
            "derivative time kd/kp or less",
        ),
        (
            "{structure: fopid, mu: 1.2, derivative_filter_time_constant_s: 1}",
            f"5:36: controller.mu: {IMPROPER}",
        ),
        (
            "{structure: fopid, mu: {min: 0.5, max: 1.5}, derivative_filter_time_constant_s: 1}",
            f"5:36: controller.mu: {IMPROPER}",
        ),
        (
            "{structure: fopid, mu: 0, derivative_filter_time_constant_s: 1}",
            "5:36: controller.mu: 0 is out of range; it must be greater than 0.0",
        ),
        ("{structure: pid, mu: 0.5, derivative_filter_time_constant_s: 1}", f"5:34: controller.mu: {ONLY_FOPID}"),
        ("{mu: 0.5}", f"5:18: controller.mu: {ONLY_FOPID}"),
        ("{kd: 2}", f"5:18: controller.kd: {ONLY_PID}"),
        (
            "{derivative_filter_time_constant_s: 2}",
            f"5:49: controller.derivative_filter_time_constant_s: {ONLY_PID}",
        ),
        ("{structure: P}", "5:25: controller.structure: 'P' is not known here; write fopi, and ki: 0 beside it"),
        ("{structure: PI}", "5:25: controller.structure: 'PI' is not known here; did you mean 'pi'?"),
        (
            "{structure: fractional}",
            "5:25: controller.structure: 'fractional' is not known here; write fopi, pi, pid or fopid",
        ),
        (
            "{structure: pi, alpha: 0.8}",
            "5:36: controller.alpha: the integral of structure pi has the order 1; remove alpha, or write "
            "structure: fopi",
        ),
        (
            "{structure: pi, alpha: {min: 1}}",
            "5:36: controller.alpha: the integral of structure pi has the order 1; remove alpha, or write "
            "structure: fopi",
        ),
        ("{Kp: 2}", "5:14: controller.Kp: the key is not known here; write kp"),
        ("{gain: 2}", "5:14: controller.gain: the key is not known here; write kp"),
        ("{K_I: 2}", "5:14: controller.K_I: the key is not known here; write ki"),
        ("{I: 2}", "5:14: controller.I: the key is not known here; write ki"),
        ("{Ti: 2}", f"5:14: controller.Ti: {INTEGRAL_TIME}"),
        ("{TI: 2}", f"5:14: controller.TI: {INTEGRAL_TIME}"),
        ("{integral_time_s: 2}", f"5:14: controller.integral_time_s: {INTEGRAL_TIME}"),
        ("{lambda: 0.9}", "5:14: controller.lambda: the key is not known here; write alpha"),
        ("{λ: 0.9}", "5:14: controller.'λ': write alpha, the order of the integral ki/s^alpha"),
        ("{order: 0.9}", "5:14: controller.order: the key is not known here; write alpha"),
        ("{Kd: 2}", "5:14: controller.Kd: the key is not known here; write kd"),
        ("{Td: 2}", f"5:14: controller.Td: {DERIVATIVE}"),
        ("{N: 10}", f"5:14: controller.N: {FILTER}"),
        ("{Tf: 0.1}", f"5:14: controller.Tf: {FILTER}"),
        ("{μ: 0.5}", f"5:14: controller.'μ': {DERIVATIVE_ORDER}"),
        ("{derivative_order: 0.5}", f"5:14: controller.derivative_order: {DERIVATIVE_ORDER}"),
        ("{PB: 50}", "5:14: controller.PB: write kp; kp = 100/band for a proportional band in %"),
        ("{beta: 0.5}", "5:14: controller.beta: write setpoint_weight, b of kp (b r - y)"),
        ("{c: 0.5}", "5:14: controller.c: the derivative acts on -y, never on the setpoint; remove it"),
        (
            "{measurement_filter: 0.5}",
            "5:34: controller.measurement_filter: '0.5' is written where a mapping belongs; write one such as "
            "{order: 1, time_constant_s: 0.1}",
        ),
        (
            "{measurement_filter: {order: 1}}",
            "5:34: controller.measurement_filter.time_constant_s: the key is missing; add it",
        ),
        (
            "{measurement_filter: {order: 3, time_constant_s: 1}}",
            "5:42: controller.measurement_filter.order: 3 is out of range; it must be at least 1 and at most 2",
        ),
        (
            "{measurement_filter: {order: 2, time_constant_s: 0}}",
            "5:62: controller.measurement_filter.time_constant_s: 0 is out of range; it must be greater than 0.0",
        ),
        (
            "{measurement_filter: {order: 2, time_constant_s: {min: 2, max: 1}}}",
            "5:68: controller.measurement_filter.time_constant_s.min: min 2.0 is greater than max 1.0; swap them",
        ),
        (
            "{filter_time_constant_s: 0.1}",
            "5:14: controller.filter_time_constant_s: write measurement_filter: {order: 1, time_constant_s: T} for "
            "1/(1 + sT) on the measurement",
        ),
        (
            "{setpoint_weight: {min: 0, max: 1}}",
            "5:31: controller.setpoint_weight: only what a scenario with a step or ramp of the setpoint measures "
            "decides it; add a requirement or an objective about one, or write one number",
        ),
        (
            "{setpoint_weight: .inf}",
            "5:31: controller.setpoint_weight: '.inf' is not a finite number; write a number, or leave the key out "
            "where it may be missing",
        ),
    ],
)
def test_a_controller_that_cannot_be_is_reported(text: str, expected: str) -> None:
    assert lines(f"{POLE}objective: {{maximize: ki}}\ncontroller: {text}\n") == [f"s.yaml:{expected}"]


def test_a_file_that_cannot_be_read_is_one_problem(tmp_path: Path) -> None:
    cases = {
        tmp_path / "missing.yaml": "there is no such file; check the path, or write one with `fopi init`",
        tmp_path: "this is a directory; give the spec file in it",
        # the reason is Python's, which words it by its version
        tmp_path / "a\0b": r"cannot be read \(.*embedded null.*\); check the path and its permissions",
    }
    for path, message in cases.items():
        with pytest.raises(SpecError) as caught:
            load_spec(path)
        (problem,) = caught.value.problems
        assert (problem.file, problem.line, problem.column, problem.path) == (str(path), 1, 1, "")
        assert re.fullmatch(message, problem.message)


def test_an_empty_path_is_seen_in_the_message() -> None:
    with pytest.raises(SpecError, match=r"^'':1:1: there is no such file"):
        load_spec("")


def test_a_file_below_a_file_cannot_be_read(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(SpecError, match=r"cannot be read .*; check the path and its permissions"):
        load_spec(tmp_path / "file" / "spec.yaml")


def test_messages_name_the_file_as_it_was_given(tmp_path: Path) -> None:
    path = tmp_path / "bad.yaml"
    path.write_text("schema: 3\n")
    with pytest.raises(SpecError) as caught:
        load_spec(path)
    assert {problem.file for problem in caught.value.problems} == {str(path)}


REPORT_A_MISTAKE = """
import sys
from fopi_tune.spec import parse_spec
try:
    parse_spec("schema: 2")
except ValueError as error:
    str(error)
slow = {"scipy", "casadi", "cvxpy", "numba", "flint", "control", "matplotlib", "jinja2", "pandas"}
print(*sorted(slow & set(sys.modules)))
"""


def test_reporting_a_bad_spec_imports_nothing_slow() -> None:
    # a new process: each of these imports takes longer than all that the report of a mistake needs
    environment = os.environ | {"PYTHONPATH": str(IMPORTED), "PYTHONSAFEPATH": "1"}
    done = subprocess.run(
        [sys.executable, "-c", REPORT_A_MISTAKE], check=True, env=environment, capture_output=True, text=True
    )
    assert done.stdout.split() == []
