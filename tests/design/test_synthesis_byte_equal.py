"""The same bytes, whatever was solved before in the process."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
from cases.project import CONTINUOUS, IMPORTED, ROOT

from fopi_tune.core.controller import FoPi
from fopi_tune.pipeline.tune import tune
from fopi_tune.proof import verify
from fopi_tune.spec import load_spec
from fopi_tune.spec.model import Sense

#: with an integral, equalities, three uncertain numbers; on samples, and with a filter exact at the crossover
SPECS = (
    CONTINUOUS / "brake.yaml",
    ROOT / "specs" / "brake.yaml",
    ROOT / "specs" / "pi_baseline.yaml",
    CONTINUOUS / "throttle.yaml",
)
INFEASIBLE = """\
schema: 1
name: infeasible
plant: {model: lag, static_gain: 1, time_constant_s: {min: 1, nominal: 2, max: 3}, dead_time_s: 0.5}
controller: {kp: {min: 0, max: 10}, ki: {min: 0, max: 10}, alpha: {min: 0.5, max: 1.4}}
requirements: [{phase_margin_deg: {at_least: 60}}, {crossover_rad_s: {at_least: 6}}]
objective: {maximize: ki}
"""
_PRINT = """\
import json, sys
from fopi_tune.pipeline.tune import tune
for path in sys.argv[1:]:
    print(json.dumps(tune(path, proof=False).to_dict()))
"""


@pytest.fixture
def paths(tmp_path: Path) -> tuple[str, ...]:
    (tmp_path / "infeasible.yaml").write_text(INFEASIBLE, encoding="utf-8")
    return (*map(str, SPECS), str(tmp_path / "infeasible.yaml"))


def printed(paths: tuple[str, ...], seed: str) -> list[str]:
    """Designs by a process of their own, one after the other, with its own order of sets and dicts of text."""
    # the package that these tests have imported, not the one in this folder: it would be compiled again
    environment = os.environ | {"PYTHONHASHSEED": seed, "PYTHONPATH": str(IMPORTED), "PYTHONSAFEPATH": "1"}
    done = subprocess.run([sys.executable, "-c", _PRINT, *paths], env=environment, capture_output=True, check=True)
    return done.stdout.decode().splitlines()


@pytest.mark.parametrize("chosen", [(1, 4), pytest.param((0, 1, 2, 3, 4), marks=pytest.mark.long)])
def test_a_design_has_the_same_bytes_whatever_was_solved_before(
    paths: tuple[str, ...], chosen: tuple[int, ...]
) -> None:
    paths = tuple(paths[k] for k in chosen)
    forwards = printed(paths, "1")
    backwards = printed(paths[::-1], "2")[::-1]
    twice = [json.dumps(tune(path, proof=False).to_dict()) for path in (*paths[2:], *paths[:3])]
    assert forwards == backwards
    assert twice == [*forwards[2:], *forwards[:3]]


@pytest.mark.thinned(3)
@pytest.mark.parametrize("path", SPECS)
@pytest.mark.parametrize("start", [FoPi(9.0, 0.1, 0.4), FoPi(0.05, 5.0, 1.4)])
def test_a_start_far_away_hides_no_better_optimum(path: Path, start: FoPi) -> None:
    spec = load_spec(path)
    near, anywhere = tune(spec, proof=False, start=start), tune(spec, proof=False, bracket=False)
    assert near.gains is not None
    assert anywhere.gains is not None
    sign = 1.0 if spec.objective is None or spec.objective.sense is Sense.MAXIMIZE else -1.0
    assert near.objective is not None
    assert anywhere.objective is not None
    # the polish ends at 1e-9 of the limits; a flat objective, and one with a steep multiplier, follow them to 1e-6
    assert sign * (near.objective - anywhere.objective) >= -1e-6 * abs(anywhere.objective)
    assert verify(spec, near.gains) is not None
