"""Specs of plants by named parameters, random expressions, and the published QFT benchmark."""

from __future__ import annotations

import json
import random
from collections.abc import Mapping
from typing import Any

from fopi_tune.core.parametric.family import ParametricFamily
from fopi_tune.spec import parse_spec
from fopi_tune.spec.model import DesignSpec

RANGES = {"a": (1.0, 5.0), "b": (20.0, 30.0), "k": (1.0, 10.0)}
BENCHMARK = "{k: {min: 1, max: 10}, a: {min: 1, max: 5}, b: {min: 20, max: 30}}"
#: the two published compensators of k/((s + a)(s + b)), as a part of the plant, and their worst |T| in dB
LEADS = {"[1/247**2, 1/247, 1]": 1.248, "[1/165, 1]": 1.837}


def document(plant: Mapping[str, Any], **sections: Any) -> str:
    """A spec as text."""
    found = {"schema": 1, "name": "a", "plant": plant, "requirements": [{"phase_margin_deg": {"at_least": 20}}]}
    return json.dumps(found | sections)


def ranges_of(ranges: Mapping[str, tuple[float, float]]) -> dict[str, dict[str, float]]:
    """Parameters as a spec has them."""
    return {name: {"min": low, "max": high} for name, (low, high) in ranges.items()}


def family_of(ranges: Mapping[str, tuple[float, float]], numerator: Any, denominator: Any, **more: Any) -> Any:
    """A transfer function with parameters."""
    plant = {"model": "transfer_function", "numerator": numerator, "denominator": denominator}
    found = parse_spec(document({"parameters": ranges_of(ranges), **plant, **more})).plant
    assert isinstance(found, ParametricFamily)
    return found


def qft_benchmark(lead: str, at_most_db: float, parameters: str = BENCHMARK) -> DesignSpec:
    """379 (s/42 + 1)/lead k/((s + a)(s + b)) with the controller 1, and a limit of |T|."""
    text = f"""schema: 1
name: qft
plant:
  parameters: {parameters}
  model: transfer_function
  numerator: [[k], [379], [1/42, 1]]
  denominator: [[1, a], [1, b], {lead}]
controller: {{kp: 1, ki: 0, alpha: 1}}
requirements: [{{complementary_sensitivity_db: {{at_most: {at_most_db}}}}}]
"""
    return parse_spec(text)


def expression(rng: random.Random, names: list[str], depth: int) -> str:
    """Valid but for divisors and powers that are refused."""
    kind = rng.random()
    if depth == 0 or kind < 0.25:
        return rng.choice([*names, *names, "2", "0.5", "3", "1e1"])
    if kind < 0.35:
        return f"({expression(rng, names, depth - 1)})"
    if kind < 0.42:
        return f"-{expression(rng, names, depth - 1)}"
    if kind < 0.55:
        return f"({expression(rng, names, depth - 1)})**{rng.choice([2, 3, -1, 0, 1, -2, 7, 16])}"
    sign = rng.choice([" + ", " - ", "*", "*", "/"])
    return f"{expression(rng, names, depth - 1)}{sign}{expression(rng, names, depth - 1)}"


_WORDS = "a b k gamma x1 __import__ os @ lambda exp( é a. a.b a[0]"
_SIGNS = "+ - * / ** ( ) ^ () (a-b) ' [ , \\ **-1 **16 /(a*b) -- +- 1/ ; \t"
_NUMBERS = "1e5 2 0.5 0 1e-90 1e90 17 .5. 0x10 1_000"
_SCRAPS = f"{_WORDS} {_SIGNS} {_NUMBERS}".split(" ")


def scraps(rng: random.Random) -> str:
    """Anything."""
    count, between = rng.randint(1, rng.choice([4, 12, 60])), rng.choice(["", " "])
    return between.join(rng.choice(_SCRAPS) for _ in range(count))
