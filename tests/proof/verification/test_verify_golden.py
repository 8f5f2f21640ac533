"""Worst values of the shipped specs and of 64 generated ones, as the search in NumPy alone found them."""

from __future__ import annotations

import csv
import sys
from collections import defaultdict
from pathlib import Path

import pytest
from cases.project import ROOT

from fopi_tune.core.controller import FoPi
from fopi_tune.digital.implementation import designed_implementation
from fopi_tune.proof import verify
from fopi_tune.spec import load_spec, parse_spec
from fopi_tune.spec.default_objective import with_default_objective
from fopi_tune.spec.model import DesignSpec

GOLDEN = Path(__file__).parents[2] / "cases" / "golden_verification.csv"
sys.path.insert(0, str(ROOT / "benchmarks" / "specs"))

from generate import spec_text  # noqa: E402  # pyright: ignore[reportMissingImports]


def cases() -> dict[tuple[str, str, str, str], dict[str, str]]:
    """What was found of each spec and its gains, by its name."""
    found: dict[tuple[str, str, str, str], dict[str, str]] = defaultdict(dict)
    with GOLDEN.open(newline="", encoding="utf-8") as file:
        for row in csv.DictReader(file):
            found[row["spec"], row["kp"], row["ki"], row["alpha"]][row["what"]] = row["value"]
    return found


def spec_of(name: str) -> DesignSpec:
    spec = parse_spec(spec_text(int(name))) if name.isdigit() else load_spec(ROOT / "specs" / f"{name}.yaml")
    return with_default_objective(spec)


@pytest.mark.thinned(7)
@pytest.mark.parametrize("case", [pytest.param(k, id=f"{k[0]}-{k[1]}") for k in cases()])
def test_the_worst_values_are_those_found_before(case: tuple[str, str, str, str]) -> None:
    name, *gains = case
    spec, controller = spec_of(name), FoPi(*(float(g) for g in gains))
    found = verify(spec, controller, implementation=designed_implementation(spec, controller))
    values = {
        f"{k}.{'max' if extreme.largest else 'min'}": extreme.achieved
        for k, result in enumerate(found.requirements)
        for extreme in result.extremes
    }
    values["objective"] = found.objective
    for what, value in cases()[case].items():
        if value == "None":
            assert values[what] is None
        else:
            # peaks are found to 1e-10 neper, which is 9e-10 dB
            assert values[what] == pytest.approx(float(value), rel=1e-9, abs=1e-9)
