"""A system's modes run on samples, and refuse a fractional plant where its spec is named."""

from __future__ import annotations

from pathlib import Path

import pytest

from fopi_tune.errors import SpecError
from fopi_tune.spec.load import load_system

LAG = "{model: lag, static_gain: 1, time_constant_s: 2}"
FRACTIONAL = (
    "{model: fractional, numerator: [{coefficient: 1, order: 0}], "
    "denominator: [{coefficient: 1, order: 0.5}, {coefficient: 1, order: 0}]}"
)
SYSTEM = (
    "schema: 1\nname: s\nsystem:\n  throttle: {spec: a.yaml, gains: {kp: 1, ki: 1, alpha: 1}}\n"
    "  brake: {spec: b.yaml, gains: {kp: 1, ki: 1, alpha: 1}}\n  hysteresis: 0.1\n"
    "scenarios: [{name: step, duration_s: 5, reference: [{at_s: 0, value: 1}]}]\n"
)


def test_a_mode_of_a_system_has_no_fractional_plant(tmp_path: Path) -> None:
    for name, plant in (("a", FRACTIONAL), ("b", LAG)):
        rest = "digital: {sample_time_s: 0.1}\n" if name == "b" else ""
        rest += "objective: {maximize: ki}\n"
        (tmp_path / f"{name}.yaml").write_text(f"schema: 1\nname: {name}\nplant: {plant}\n{rest}", encoding="utf-8")
    (tmp_path / "s.yaml").write_text(SYSTEM, encoding="utf-8")
    with pytest.raises(SpecError, match="a mode's plant has whole orders in this version, and is no fractional one"):
        load_system(tmp_path / "s.yaml")
