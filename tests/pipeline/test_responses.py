"""Many plants driven at once against single simulations, which are an entry of their own."""

from __future__ import annotations

import numpy as np
import pytest
from cases.plants import PUBLISHED_BRAKE
from cases.project import ROOT

import fopi_tune as ft
from fopi_tune.errors import DomainError
from fopi_tune.pipeline.responses import family_responses, system_responses
from fopi_tune.simulation.measures import measure_values
from fopi_tune.spec import load_spec, load_system, parse_spec

BRAKE = (ROOT / "specs/brake.yaml").read_text(encoding="utf-8")
LIMITED = BRAKE.replace("measurement_unit: km/h", "output_limits: [-1, 0.6]") + (
    "scenarios:\n  - {name: up, duration_s: 8, reference: [{at_s: 0, value: 1}], noise_std: 0.01}\n"
    "  - {name: hit, duration_s: 6, reference: [{at_s: 0, value: 0.5}], load: [{at_s: 3, value: -0.2}]}\n"
)


def test_every_plant_is_driven_as_it_is_alone() -> None:
    spec = parse_spec(LIMITED)
    points = np.array([[2.25], [1.6], [3.1]])
    found = family_responses(spec, PUBLISHED_BRAKE, points)
    assert [each.scenario.name for each in found] == ["up", "hit"]
    hit = found[1]
    for row, (tau,) in enumerate(points.tolist()):
        alone = ft.simulate(spec, PUBLISHED_BRAKE, scenario="hit", plant={"time_constant_s": tau}).driven[0]
        np.testing.assert_array_equal(hit.traces.output[row], alone.traces.output[0])
        np.testing.assert_array_equal(hit.traces.applied[row], alone.traces.applied[0])
        for name, value in alone.measures.items():
            # sums of many rows are added in another order
            np.testing.assert_allclose(measure_values(hit.measures, name, "")[row], value, rtol=1e-12, err_msg=name)


def test_a_spec_without_scenarios_is_driven_through_the_default_one() -> None:
    spec = load_spec(ROOT / "specs/brake.yaml")
    (found,) = family_responses(spec, PUBLISHED_BRAKE, np.array([[2.25]]))
    alone = ft.simulate(spec, PUBLISHED_BRAKE).driven[0]
    assert found.scenario == alone.scenario
    np.testing.assert_array_equal(found.traces.output[0], alone.traces.output[0])


def test_a_long_scenario_is_driven_with_fewer_plants() -> None:
    long = LIMITED.replace("duration_s: 8", "duration_s: 20000")
    found = family_responses(parse_spec(long), PUBLISHED_BRAKE, np.linspace(1.6, 3.1, 30)[:, None])
    assert len(found[0].points) == 400_000 // 100_001
    assert len(found[1].points) == 30


def test_pairs_of_a_system_are_driven_as_they_are_alone() -> None:
    system = load_system(ROOT / "systems/car.yaml")
    alone = ft.simulate_system(system)
    found = system_responses(system, alone.gains, system.family.corners(2))
    assert [each.scenario.name for each in found] == [each.scenario.name for each in alone.driven]
    for many, one in zip(found, alone.driven, strict=True):
        np.testing.assert_array_equal(many.traces.output[0], one.traces.output[0])
        np.testing.assert_array_equal(many.traces.mode[0], one.traces.mode[0])
        assert measure_values(many.measures, "switch_count", "")[0] == one.measures["switch_count"]


def test_what_cannot_be_simulated_is_refused_with_its_reason() -> None:
    spec = parse_spec(BRAKE.replace("digital:", "# digital:"))
    with pytest.raises(DomainError, match="no section digital"):
        family_responses(spec, PUBLISHED_BRAKE, np.array([[2.25]]))
