"""Studies of `lag.yaml` in the current folder, written and read."""

from __future__ import annotations

from pathlib import Path

import pytest

from fopi_tune.errors import SpecError
from fopi_tune.study.load import load_study
from fopi_tune.study.model import Study

#: a spec for `lag.yaml`, of which each stage takes little time
LAG = """\
schema: 1
name: lag
plant: {model: lag, static_gain: 1, time_constant_s: {min: 1.6, nominal: 2.25, max: 3.1}}
controller: {kp: 0.385, ki: 0.388, alpha: 0.82}
requirements: [{phase_margin_deg: {at_least: 80}}]
digital: {sample_time_s: 0.2}
validation: {samples: 50}
"""


def study(text: str, force: bool = False) -> Study:
    """The study with this text behind its head."""
    Path("s.yaml").write_text(f"schema: 1\nname: s\nspecs: [lag.yaml]\n{text}", encoding="utf-8")
    return load_study("s.yaml", force)


def mistakes(text: str) -> list[str]:
    """What is wrong with such a study."""
    with pytest.raises(SpecError) as caught:
        study(text)
    return [str(problem) for problem in caught.value.problems]
