"""Texts of transfer functions:  what people write and print -> exact coefficients, or what is wrong and where."""

from __future__ import annotations

import random
from fractions import Fraction

import numpy as np
import pytest

from fopi_tune.errors import DomainError
from fopi_tune.spec.transfer_functions import WrittenPlant, from_text

LAG = WrittenPlant((Fraction("4.39"),), (Fraction(1), Fraction("0.1746")), Fraction(0))
MATLAB = """
G =

                   4.39
  exp(-0.3*s) * ----------
                s + 0.1746

Continuous-time transfer function.
Model Properties
"""
OCTAVE = """
Transfer function 'ans' from input 'u1' to output ...

         4.39
 y1:  ----------
      s + 0.1746

Continuous-time model.
"""
PYTHON = "<TransferFunction>: sys[0]\nInputs (1): ['u[0]']\nOutputs (1): ['y[0]']\n\n   4.39\n----------\ns + 0.1746\n"


@pytest.mark.parametrize(
    "text",
    [
        "4.39/(s+0.1746)",
        "G(s) = 4.39 / ( s + .1746 );",
        "4.39*(s+0.1746)^-1",
        "8.78/(2 s + 0.3492)*1",
        "tf([4.39],[1 0.1746])",
        "tf(4.39, [1, 0.1746])",
        "control.tf([4.39], [1, 0.1746])",
        "tf([0 0 4.39], [0 1 0.1746])",
        "zpk([], -0.1746, 4.39)",
        "s = tf('s');\nG = 4.39/(s + 0.1746);",
        "k = 4.39; a = 0.1746; k/(p + a)",
        "      4.39\n  ----------\n  s + 0.1746",
        OCTAVE,
        PYTHON,
    ],
)
def test_every_way_to_write_a_lag_is_the_same_plant(text: str) -> None:
    found = from_text(text)
    size = found.denominator[0]
    same = WrittenPlant(
        tuple(v / size for v in found.numerator), tuple(v / size for v in found.denominator), found.dead_time_s
    )
    assert same == LAG


@pytest.mark.parametrize(
    ("text", "numerator", "denominator", "dead_time"),
    [
        (MATLAB, "4.39", "1 0.1746", "0.3"),
        ("exp(-0.3*s)*2/((s+1)*(0.5*s+1)^2)", "2", "0.25 1.25 2 1", "0.3"),
        ("(s^2+2*s+1)/(s^3 + 3 s^2)", "1 2 1", "1 3 0 0", "0"),
        ("1.5*e^(-2s)/(12 s + 1)", "1.5", "12 1", "2"),
        ("1/(12s+1) e^{-2s}", "1", "12 1", "2"),
        ("1/exp(2*s)/(s+1)", "1", "1 1", "2"),
        ("exp(-s)*exp(-s/2)/(s+1)", "1", "1 1", "1.5"),
        ("66.16 (s+1)/((s+2)(s+3))", "66.16 66.16", "1 5 6", "0"),
        ("  66.16 (s+1)\n  -------------\n  s (s+2) (s^2+2s+5)", "66.16 66.16", "1 4 9 10 0", "0"),
        ("1\n-\ns", "1", "1 0", "0"),
        ("(s−1)/(s²+2·s+1)", "1 -1", "1 2 1", "0"),
        ("1/(s+1) + 1/(s+2)", "2 3", "1 3 2", "0"),
        ("zpk([-1],[-2, -3],[5],'InputDelay',0.3)", "5 5", "1 5 6", "0.3"),
        ("zpk([-1+2i -1-2i],[-1-3j -1+3j 0],5)", "5 10 25", "1 2 10 0", "0"),
        ("G = tf(4.39,[1 0.1746]); G.InputDelay = 0.3", "4.39", "1 0.1746", "0.3"),
        ("tf([1 -2],[1 - 2 3], IODelay=1)", "1 -2", "-1 3", "1"),
        ("tf(1, conv([1 1],[0.5 1]))", "1", "0.5 1.5 1", "0"),
        ("tf([1;2],[1 2*0.7*3 9])", "1 2", "1 4.2 9", "0"),
        ("0.1/(0.1 s + 0.2 - 0.3 + s*1e-3)", "0.1", "0.101 -0.1", "0"),
        ("5", "5", "1", "0"),
    ],
)
def test_coefficients_are_the_decimals_that_are_written(
    text: str, numerator: str, denominator: str, dead_time: str
) -> None:
    found = from_text(text)
    assert found.numerator == tuple(map(Fraction, numerator.split()))
    assert found.denominator == tuple(map(Fraction, denominator.split()))
    assert found.dead_time_s == Fraction(dead_time)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "there is no transfer function"),
        ("4,39/(s+1)", "line 1, column 2: a comma does not belong here; the decimal sign is a point"),
        ("1/(s+1)(s+2)", "line 1, column 8: it is not clear whether this is divided by or multiplied with"),
        ("1/2 s", "line 1, column 5: it is not clear"),
        ("1/(s+1", "line 1, column 7: the parenthesis of column 3 of the expression is not closed"),
        ("2 3", "line 1, column 3: a sign is missing"),
        ("k = 2;\nk/(s+a)", "line 2, column 6: 'a' is not known"),
        ("foo(s)", "line 1, column 1: 'foo' is no function"),
        ("__import__('os')", "'__import__' is no function"),
        ("s.__class__", "sign is missing"),
        ("1/s^0.5", "line 1, column 4: a power must be a whole number"),
        ("1/(s+1)^40", "a power must be from -32 to 32"),
        ("1/((s+1)^30*(s+2)^3)", "the degree is 33; at most 31"),
        ("s^2/(s+1)", "the numerator's degree 2 exceeds the denominator's 1"),
        ("exp(0.3*s)/(s+1)", "the positive exponent 0.3 s"),
        ("exp(-0.3)/(s+1)", "column 1: exp: the exponent of e must be a number times s"),
        ("e^-2s/(s+1)", "write exp(-L*s), or e^(-L*s) in parentheses"),
        ("1/(s+1) + exp(-s)/(s+2)", "column 9: a sum of terms with different dead times"),
        ("1/(s-s)", "column 2: divides by 0"),
        ("0/(s+1)", "the transfer function is 0"),
        ("1/z", "a system in discrete time"),
        ("tf([1],[1 2],0.1)", "a sample time makes it discrete"),
        ("tf('z')", "'z' is not s; a sample time makes it discrete"),
        (
            "1\n---\nz\n\nSample time: 0.1 seconds\nDiscrete-time transfer function.",
            "line 5, column 1: this is a system",
        ),
        ("tf({[1] [2]},{[1 2] [1 2]})", "several inputs, outputs or fractions"),
        ("1\n--\ns\n\n2\n---\ns+1", "line 6, column 1: this has several inputs"),
        ("tf([1],[1 2],'OutputName',3)", "'OutputName' is no option"),
        ("tf([1 s],[1 2])", "the numerator has an entry with s"),
        ("zpk([],[-1+2i -1-3i],5)", "complex zeros or poles must come in conjugate pairs"),
        ("1/(s+1i)", "the transfer function is not real"),
        ("tf(1,[1 1],'InputDelay',-1)", "InputDelay must be a number of s, at least 0"),
        ("\\frac{1}{s}", "LaTeX is not read"),
        ("[1 2]", "this is no transfer function"),
        ("s/s^2", "the common factor s: a mode that is not stable"),
        ("(s-1)/((s-1)*(s+2))", "the common factor s - 1: a mode that is not stable"),
        ("1e-200/(s+1)", "too small to compute with"),
        ("1e60*1e60/(s+1)", "lies beyond 1e-100 … 1e+100"),
        ("(" * 60 + "s", "more than 40 parentheses"),
        ("1" * 5000, "has 5000 characters"),
    ],
)
def test_what_is_no_plant_is_told_with_its_place(text: str, said: str) -> None:
    with pytest.raises(DomainError) as caught:
        from_text(text)
    assert said in str(caught.value)


def test_a_stable_common_factor_is_left_out_and_told() -> None:
    found = from_text("(s+1)/((s+1)*(s^2+0.1 s+2)) * (s^2 + 2)/(s^2 + 2 + s)")
    assert found.left_out == "s + 1"
    assert found.denominator == from_text("1/((s^2+0.1 s+2)*(s^2+s+2))").denominator


def test_formulas_have_the_value_that_they_have_in_python() -> None:
    rng = random.Random(5)

    def made(depth: int) -> str:
        kind = rng.randrange(6 if depth else 2)
        if kind == 0:
            return f"{rng.uniform(0.1, 9):.3g}"
        if kind == 1:
            return rng.choice(["s", "(s+1)", "(0.5*s + 2)"])
        if kind == 5:
            return f"({made(depth - 1)})**{rng.randrange(3)}"
        return f"({made(depth - 1)}{'+-*/'[kind - 2 + (kind == 4) * rng.randrange(2)]}{made(depth - 1)})"

    point, compared = 0.3 + 1.7j, 0
    for _ in range(300):
        text = made(3)
        try:
            found = from_text(f"({text})/(s+3)^9")
        except DomainError:
            continue
        value = eval(text.replace("s", str(point)), {}) / (point + 3) ** 9
        top, bottom = ([float(v) for v in side] for side in (found.numerator, found.denominator))
        # a dozen operations in double precision of numbers of like size; sums may cancel a few digits
        assert np.polyval(top, point) / np.polyval(bottom, point) == pytest.approx(value, rel=1e-9)
        compared += 1
    assert compared > 150


@pytest.mark.parametrize("count", [1500, pytest.param(40000, marks=pytest.mark.long)])
def test_mutated_texts_end_in_a_plant_or_in_a_message(count: int) -> None:
    seeds = [
        MATLAB, OCTAVE, PYTHON, "exp(-0.3*s)*2/((s+1)*(0.5*s+1)^2)", "zpk([-1+2i -1-2i],[-1-3j -1+3j 0],5)",
        "G = tf(4.39,[1 0.1746]); G.InputDelay = 0.3", "1.5*e^(-2s)/(12 s + 1)", "66.16 (s+1)/((s+2)(s+3))^9",
        "tf(1, conv([1 1],[0.5 1]))",
    ]  # fmt: skip
    pieces = [
        *"s+-*/^()[]{}.,;='eijpz0123456789 \n\t%²−\x00é",
        "exp(",
        "tf(",
        "zpk(",
        "----",
        "'s'",
        "^32",
        "e99",
        "\n---\n",
    ]
    rng, read = random.Random(11), 0
    for _ in range(count):
        text = rng.choice(seeds)
        for _ in range(rng.randrange(1, 6)):
            at, size = rng.randrange(len(text) + 1), rng.randrange(3)
            text = text[:at] + "".join(rng.choices(pieces, k=rng.randrange(3))) + text[at + size :]
        try:
            found = from_text(text)
        except DomainError:
            continue
        assert len(found.numerator) <= len(found.denominator) <= 32
        read += 1
    assert count // 20 < read < count
