"""Modes of any names through every stage: the same numbers as of a throttle and a brake, in those names."""

from __future__ import annotations

import json
import re
import shutil
from pathlib import Path

import pytest
from cases.c_export import replayed
from cases.two_modes import rig, write

import fopi_tune as ft
from fopi_tune.report.figures.plots import simulation_svg

NAMES = ("heater", "switch")


def renamed(text: str) -> str:
    return text.replace("throttle", NAMES[0]).replace("brake", NAMES[1])


@pytest.fixture
def systems(tmp_path: Path):
    more, made = "limits: [{switch_count: {at_most: 3}}]\nvalidation: {samples: 40, seed: 2}", []
    for names in (("throttle", "brake"), NAMES):
        (tmp_path / names[0]).mkdir()
        made.append(rig(tmp_path / names[0], names, "hysteresis: 0.3\ninactive: reset", more=more))
    return made


def document(result: object) -> str:
    """Its JSON without the stamp and digests."""
    found = result.to_dict()  # pyright: ignore[reportAttributeAccessIssue]
    for key in ("stamp", "system_sha256", "digest"):
        found.pop(key, None)
    return re.sub('"(?:system_sha256|digest)": "[0-9a-f]*"', "", json.dumps(found))


def test_results_have_the_modes_own_names_and_the_same_numbers(systems: list[ft.SystemSpec]) -> None:
    usual, named = systems
    for stage in (ft.simulate_system, ft.validate_system, ft.discretize_system):
        assert renamed(document(stage(usual))) == document(stage(named))
    exact = ft.simulate_system(named, exact=True, plant={"switch.time_constant_s": 1.7})
    assert exact.plant["switch.time_constant_s"] == 1.7
    assert exact.driven[0].measures["switch_count"] > 0


def test_the_figure_names_the_mode_that_is_grey(systems: list[ft.SystemSpec]) -> None:
    found = ft.simulate_system(systems[1])
    text = simulation_svg(found, found.driven[0])
    assert "switch acts" in text
    assert "brake" not in text


def test_a_certificate_speaks_of_the_modes_by_their_names(systems: list[ft.SystemSpec]) -> None:
    usual, named = (ft.prove_system(each, setpoints=(2.0, 8.0)).certificate for each in systems)
    assert renamed(" ".join(usual.statements)) == " ".join(named.statements)
    assert not re.search("throttle|brake", " ".join(named.statements))


@pytest.mark.skipif(not shutil.which("gcc"), reason="gcc is not found")
def test_names_that_c_has_for_itself_are_exported_and_replayed(tmp_path: Path) -> None:
    for names in (("output", "mode"), ("double", "stayed")):
        folder = tmp_path / names[0]
        folder.mkdir()
        code = ft.discretize_system(write(folder, names, "hysteresis: 0.3\nmin_dwell_s: 0.5")).code()
        assert f"state {names[0]}_controller;" in code["fopi_rig_f64.h"]
        done = replayed(code, folder / "c", "gcc")
        assert done.returncode == 0, done.stdout + done.stderr
