"""Coefficients by expressions: their values, the divisors that are cleared, and every mistake of a file in one run."""

from __future__ import annotations

import random
import time

import numpy as np
import pytest
from cases.parametric_plants import RANGES, document, expression, family_of, ranges_of, scraps

from fopi_tune.errors import SpecError
from fopi_tune.spec import parse_spec

NAMES = ["a", "b", "k"]


def response(family: object, point: np.ndarray, s: complex) -> complex:
    plant = family.member(point)  # type: ignore[attr-defined]
    return complex(np.polyval(plant.numerator, s) / np.polyval(plant.denominator, s))


@pytest.mark.parametrize("seed", range(60))
def test_a_plant_by_expressions_has_the_response_of_their_values(seed: int) -> None:
    rng = random.Random(seed)
    texts = [expression(rng, NAMES, 3) for _ in range(3)]
    numerator = [f"k + 0*({texts[0]})", f"a*b*({texts[1]}) + 1e3*k*a*b"]
    denominator = [1, f"a + b + ({texts[2]})/1e4", "b*k"]
    try:
        family = family_of(RANGES, numerator, denominator)
    except SpecError:
        return  # a divisor may be 0, or a number too large
    for point in np.random.default_rng(seed).uniform(family.low, family.high, (3, 3)):
        values, s = dict(zip(family.uncertain_names, point.tolist(), strict=True)), 0.7 + 3.0j
        numbers = [eval(text, {}, values) for text in texts]
        k, a, b = values["k"], values["a"], values["b"]
        wanted = (k * s + a * b * numbers[1] + 1e3 * k * a * b) / (s * s + (a + b + numbers[2] / 1e4) * s + b * k)
        assert response(family, point, s) == pytest.approx(wanted, rel=1e-9)


def test_divisors_are_cleared_and_leave_polynomials() -> None:
    family = family_of({"m": (1.0, 2.0), "c": (0.5, 1.0)}, ["1 / m"], [1, "c / m", "1 / (m * (c + 1))"])
    plant = family.member(np.array([0.75, 1.6]))
    scale = plant.denominator[0]
    assert np.allclose(np.array(plant.denominator) / scale, [1.0, 0.75 / 1.6, 1.0 / 1.6 / 1.75])
    assert plant.numerator[0] / scale == pytest.approx(1.0 / 1.6)
    # (c + 1) m s^2 and not (c + 1)^2 m^3 s^2
    assert family.powers.max(axis=0).tolist() == [2, 1]


def test_a_number_is_divided_exactly() -> None:
    family = family_of({"k": (1.0, 2.0)}, ["k / 3", "k"], ["1 / 42", 1])
    assert family.denominator[0].value is not None
    assert family.denominator[0].value.denominator == 42


MISTAKES = """schema: 1
name: bad
plant:
  parameters:
    k: {min: 1, max: 10}
    a: {min: -1, max: 5}
    b: {min: 30, max: 20}
    never: 3
    2x: 4
  model: transfer_function
  numerator: [k + gama, 'k + aa', 1 / a]
  denominator:
    - 1
    - a + * b
    - "a * (b + 3"
    - k ** 0.5
    - k ** 99
    - exp(a)
    - 3 k
    - a^2
    - k / (a - a)
    - k ** a
    - (k + 1) ** 8 * (k + a) ** 31
    - ''
    - '5'
    - q + w
  dead_time_s: a + k
requirements:
  - phase_margin_deg: {at_least: 60}
"""


def test_all_mistakes_of_a_plant_are_found_in_one_run_each_at_its_place() -> None:
    with pytest.raises(SpecError) as caught:
        parse_spec(MISTAKES)
    found = [(each.line, each.column, each.path.removeprefix("plant.")) for each in caught.value.problems]
    assert found == [
        (7, 14, "parameters.b.min"),
        (8, 5, "parameters.never"),
        (9, 5, "parameters.2x"),
        (11, 19, "numerator[0]"),
        (11, 30, "numerator[1]"),
        (11, 39, "numerator[2]"),
        (14, 11, "denominator[1]"),
        (15, 18, "denominator[2]"),
        (16, 12, "denominator[3]"),
        (17, 12, "denominator[4]"),
        (18, 7, "denominator[5]"),
        (19, 9, "denominator[6]"),
        (20, 8, "denominator[7]"),
        (21, 11, "denominator[8]"),
        (22, 12, "denominator[9]"),
        (23, 7, "denominator[10]"),
        (24, 8, "denominator[11]"),
        (25, 7, "denominator[12]"),
        (26, 7, "denominator[13]"),
        (26, 11, "denominator[13]"),
        (27, 16, "dead_time_s"),
    ]


OTHER_MISTAKES = """schema: 1
name: bad
plant:
  parameters: {k: 2, z: {min: 0.1, max: 0.3}, w: 5, t: 1}
  model: zeros_poles
  gain: k
  zeros: [{damping: z, natural_frequency_rad_s: [w]}]
  poles: [-t, {damping: q, natural_frequency: 3}]
requirements:
  - phase_margin_deg: {at_least: 60}
"""
MIXED_FACTORS = """schema: 1
name: bad
plant:
  parameters: {k: 2, a: {min: 1, max: 2}}
  model: transfer_function
  numerator: [k]
  denominator: [[1, a + q], a ** 0.5 +, [1, 2 ~ 3]]
requirements:
  - phase_margin_deg: {at_least: 60}
"""


@pytest.mark.parametrize(
    ("text", "places"),
    [
        (OTHER_MISTAKES, [(7, 49, "frequency_rad_s"), (8, 25, "damping"), (8, 28, "frequency")]),
        (MIXED_FACTORS, [(7, 29, "denominator[1]"), (7, 39, "denominator[1]"), (7, 47, "denominator[2][1]")]),
    ],
)
def test_what_cannot_be_read_hides_no_other_mistake(text: str, places: list[tuple[int, int, str]]) -> None:
    with pytest.raises(SpecError) as caught:
        parse_spec(text)
    found = [(each.line, each.column, each.path) for each in caught.value.problems]
    assert [(line, column) for line, column, _ in found] == [(line, column) for line, column, _ in places], found
    assert all(path.endswith(end) for (_, _, path), (_, _, end) in zip(found, places, strict=True)), found


@pytest.mark.parametrize(
    ("written", "column"),
    [("k + q", 19), ("'k + q'", 20), ('"k + q"', 20), ('"k \\u002B q"', 15), ("'k +\n    q'", 15)],
)
def test_a_column_is_told_where_each_character_has_its_own(written: str, column: int) -> None:
    text = MIXED_FACTORS.replace("numerator: [k]", f"numerator: [{written}]").replace(
        "[[1, a + q], a ** 0.5 +, [1, 2 ~ 3]]", "[1, a]"
    )
    with pytest.raises(SpecError) as caught:
        parse_spec(text)
    (problem,) = caught.value.problems
    assert (problem.line, problem.column) == (6, column)


@pytest.mark.parametrize(
    ("coefficient", "words"),
    [
        ("a + kk", "'kk' is no parameter of this plant"),
        ("k / (a - b)", "divides by '(a - b)', which is 0, or changes its sign, with a = "),
        ("1 / (a*a - 2*a*b + b*b + 1e-30)", "which may be 0"),
        ("k / 0", "divides by '0', which is 0"),
        ("a ** (b + 1)", "must be a whole number from -32 to 32"),
        ("2 ** a", "must be a whole number"),
        ("(a*b) ** 20 * (a*b) ** 20", "power above 32"),
        ("1e100 ** 3", "too large or too small"),
    ],
)
def test_what_cannot_be_computed_is_refused_by_name(coefficient: str, words: str) -> None:
    with pytest.raises(SpecError) as caught:
        family_of({"a": (1.0, 3.0), "b": (2.0, 4.0), "k": (1.0, 2.0)}, ["k"], [1, coefficient, "a + b"])
    assert words in str(caught.value)


def fuzz(count: int, seed: int) -> tuple[float, int]:
    """The slowest spec in s of process time, and how many are accepted."""
    rng, slowest, accepted, wrong = random.Random(seed), 0.0, 0, []
    ranges = {"a": (1.0, 2.0), "b": (-1.0, 3.0), "k": (0.1, 10.0)}
    for index in range(count):
        text = scraps(rng) if index % 2 else expression(rng, NAMES, rng.randint(1, 6))
        denominator = rng.choice([[1, text], [text, "b"], [[1, text], [1, "a"]], [1, "1/a", text]])
        plant = {"model": "transfer_function", "numerator": ["k"], "denominator": denominator}
        written, start = document({"parameters": ranges_of(ranges), **plant}), time.process_time()
        try:
            parse_spec(written)
            accepted += 1
        except SpecError as refused:
            wrong += [each for each in refused.problems if each.line != 1 or each.column < 1 or not each.message]
        slowest = max(slowest, time.process_time() - start)
    assert not wrong
    return slowest, accepted


def test_no_expression_ends_in_a_crash() -> None:
    _, accepted = fuzz(300, 1)
    assert accepted > 10


@pytest.mark.long
def test_none_of_twenty_thousand_expressions_ends_in_a_crash() -> None:
    slowest, accepted = fuzz(20_000, 2)
    assert accepted > 1000
    print(f"slowest {slowest:.3f} s")
