"""Expressions: the field's precedence, places of mistakes, and nothing but arithmetic."""

from __future__ import annotations

import random
from fractions import Fraction

import pytest
from cases.parametric_plants import expression, scraps

from fopi_tune.spec.parametric.descent import MAX_DEPTH, ExpressionError
from fopi_tune.spec.parametric.expressions import (
    MAX_LENGTH,
    Expression,
    Name,
    Negative,
    Number,
    parse_expression,
)


def value(tree: Expression, numbers: dict[str, float]) -> float:
    if isinstance(tree, Number):
        return float(tree.value)
    if isinstance(tree, Name):
        return numbers[tree.name]
    if isinstance(tree, Negative):
        return -value(tree.part, numbers)
    left, right = value(tree.left, numbers), value(tree.right, numbers)
    signs = {"+": left + right, "-": left - right, "*": left * right}
    if tree.sign in signs:
        return signs[tree.sign]
    return left / right if tree.sign == "/" else left**right


@pytest.mark.parametrize(
    "text", ["-2 ** 2", "2 ** 3 ** 2", "2 ** -1", "8 / 4 / 2", "1 - 2 - 3", "-(1 + 2) * -3", "+.5e1", " ( 7. ) "]
)
def test_signs_bind_as_python_and_matlab_have_them(text: str) -> None:
    assert value(parse_expression(text), {}) == eval(text.strip())


@pytest.mark.parametrize("seed", range(100))
def test_random_expressions_have_the_values_that_python_gives_them(seed: int) -> None:
    rng, numbers = random.Random(seed), {"a": 1.25, "b": 0.75, "k": 3.5}
    text = expression(rng, list(numbers), 4)
    try:
        wanted = eval(text, {}, dict(numbers))
    except (ZeroDivisionError, OverflowError):
        return
    assert value(parse_expression(text), numbers) == wanted


@pytest.mark.parametrize(
    ("text", "at", "words"),
    [
        ("", 0, "is empty"),
        ("a + * b", 4, "a number or a parameter is missing before '*'"),
        ("a +", 3, "is missing at the end"),
        ("(a + b", 6, "not closed at the end"),
        ("a + b)", 5, "a sign is missing before ')'"),
        ("2 a", 2, "write * between factors"),
        ("a^2", 1, "write **"),
        ("2 · a", 2, "write *"),
        ("exp(a)", 0, "is no function"),
        ("a.b", 1, "does not belong here"),
        ("__import__('os')", 0, "'"),
        ("1e400", 0, "too large"),
        ("a" * (MAX_LENGTH + 1), 0, "at most"),
        ("(" * (MAX_DEPTH + 2) + "a", MAX_DEPTH + 1, "lie within each other"),
        ("-" * (MAX_DEPTH + 2) + "a", MAX_DEPTH + 1, "lie within each other"),
    ],
)
def test_a_mistake_has_its_place(text: str, at: int, words: str) -> None:
    with pytest.raises(ExpressionError) as caught:
        parse_expression(text)
    assert words in str(caught.value)
    assert caught.value.at == at or text.startswith("__")


def test_long_chains_of_powers_end_with_a_message() -> None:
    with pytest.raises(ExpressionError, match="within each other"):
        parse_expression("**".join(["2"] * 60))


def test_anything_is_an_expression_or_a_mistake_inside_the_text() -> None:
    rng, places = random.Random(3), []
    for _ in range(2000):
        text = scraps(rng)
        try:
            parse_expression(text)
        except ExpressionError as wrong:
            places.append(wrong.at / max(len(text), 1))
    assert min(places) == 0.0
    assert max(places) <= 1.0


def test_a_decimal_is_what_is_written() -> None:
    assert parse_expression("0.1") == Number(Fraction(1, 10), 0, 3)
    assert parse_expression("1.25e-2") == Number(Fraction(1, 80), 0, 7)
