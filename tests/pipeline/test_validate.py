"""Evidence by sampling: margins of thousands of loops, scenarios and limits, replay, and what contradicts a proof."""

from __future__ import annotations

import json
import math
import pickle
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from cases.project import CONTINUOUS
from typer.testing import CliRunner

import fopi_tune as ft
from fopi_tune.cli import app
from fopi_tune.core.loops import Plants
from fopi_tune.core.sampled_loops import SampledLoops
from fopi_tune.core.stability import unstable_closed_loop_poles
from fopi_tune.digital.implementation import implementation_of
from fopi_tune.errors import DomainError, SpecError
from fopi_tune.montecarlo import montecarlo
from fopi_tune.montecarlo import outcomes as drawn
from fopi_tune.montecarlo.contradiction import contradictions
from fopi_tune.montecarlo.margins import MarginScan
from fopi_tune.montecarlo.montecarlo import monte_carlo
from fopi_tune.pipeline.simulate import simulate
from fopi_tune.pipeline.validate import validate, validate_block
from fopi_tune.quantities import QUANTITIES
from fopi_tune.simulation.measures import piecewise_signal
from fopi_tune.spec import parse_spec
from fopi_tune.spec.model import DesignSpec, Knot, Relation, Requirement

#: meets specs/brake.yaml on samples
GAINS = ft.FoPi(0.44651475946456753, 0.37032589727989074, 0.8319673847369714)
OPTIONS = ["--kp", repr(GAINS.kp), "--ki", repr(GAINS.ki), "--alpha", repr(GAINS.alpha)]
SCENARIOS = """
scenarios:
  - {name: from_30, duration_s: 20, reference: [{at_s: 0, value: 0}], initial_output: 30, before: free}
  - {name: noisy, duration_s: 20, reference: [{at_s: 1, value: 1}], noise_std: 0.02, quantum: 0.01}
limits:
  - {acceleration_m_s2: {at_most: 5.5}, scenario: from_30}
  - {overshoot: {at_most: 0.2}, scenario: noisy}
"""


def brake(*pairs: tuple[str, str], more: str = SCENARIOS, samples: int = 600) -> DesignSpec:
    text = (CONTINUOUS / "brake.yaml").read_text(encoding="utf-8")
    for old, new in (
        ("delay_samples: 0}", "delay_samples: 0, design: sampled, output_limits: [-1, 1]}"),
        ("samples: 10000", f"samples: {samples}"),
        *pairs,
    ):
        assert old in text
        text = text.replace(old, new)
    return parse_spec(text + more)


# -- margins of many loops --------------------------------------------------------------------------------------------


@pytest.mark.thinned(3)
@pytest.mark.parametrize("name", ["brake", "brake_delay", "lag_gain_and_delay", "second_order", "throttle"])
def test_scanned_margins_are_those_of_the_core(name: str) -> None:
    spec = ft.load_spec(CONTINUOUS / f"{name}.yaml")
    rng = np.random.default_rng(31)
    for _ in range(2):
        gains = ft.FoPi(float(rng.uniform(0.1, 2.5)), float(rng.uniform(0.05, 1.0)), float(rng.uniform(0.5, 1.5)))
        implementation = implementation_of(spec, gains)
        points = rng.uniform(spec.plant.low, spec.plant.high, (10, len(spec.plant.low)))
        loops = SampledLoops.implemented(gains, implementation, Plants.members(spec.plant, points))
        found = MarginScan(loops)
        assert np.array_equal(found.unstable_poles, unstable_closed_loop_poles(loops))
        for quantity in QUANTITIES.values():
            bands = [(0.0, math.inf), (0.05, 2.0)] if quantity.takes_band else [(0.0, math.inf)]
            for low, high in bands:
                requirement = Requirement(quantity.name, Relation.AT_MOST, (1.0,), from_rad_s=low, to_rad_s=high)
                for largest in (False, True):
                    expected = quantity.measure(loops, largest, low, high).value
                    measured = found.measure(requirement, largest)
                    assert np.array_equal(np.isnan(measured), np.isnan(expected))
                    limit = np.isinf(expected)
                    # the smallest |S| is 0, and its logarithm -inf, only in a limit that a grid does not reach
                    there = ~np.isnan(expected) & ~limit & (np.abs(expected) < 300.0)
                    np.testing.assert_allclose(measured[there], expected[there], rtol=1e-9, atol=1e-9)


# -- sampling ---------------------------------------------------------------------------------------------------------


def test_every_drawn_plant_meets_what_is_proved_of_all_of_them() -> None:
    result = validate(brake(), GAINS)
    assert result.status == "met"
    assert result.contradictions == ()
    assert result.evidence.stable.met == result.evidence.stable.total == 600
    assert [judged.fraction.met for judged in result.evidence.requirements] == [600] * 3
    # 1 - 600th root of half of 1 % : what 600 of 600 says with 99 %, both sides
    assert result.evidence.stable.low == pytest.approx(0.005 ** (1 / 600), rel=1e-12)


def test_the_fraction_of_a_requirement_that_half_the_family_misses_is_found() -> None:
    """|S(0.02j)| falls with tau: a limit at its value for the middle tau is met by just the plants beyond it."""
    spec = brake(more="", samples=4000)
    implementation = implementation_of(spec, GAINS)
    middle = SampledLoops.implemented(GAINS, implementation, Plants.members(spec.plant, np.array([[2.35]])))
    value = float(QUANTITIES["sensitivity_db"].measure(middle, True, 0.02, 0.02).value[0])
    requirement = Requirement("sensitivity_db", Relation.AT_MOST, (value,), from_rad_s=0.02, to_rad_s=0.02)
    evidence = monte_carlo(replace(spec, requirements=(requirement,)), GAINS, implementation)
    judged = evidence.requirements[0]
    assert judged.fraction.low < 0.5 < judged.fraction.high
    assert not evidence.all_met


def test_chunks_do_not_change_a_bit(monkeypatch: pytest.MonkeyPatch) -> None:
    spec = brake(samples=300)
    implementation = implementation_of(spec, GAINS)
    whole = monte_carlo(spec, GAINS, implementation)
    monkeypatch.setattr(drawn, "CHUNK", 77)
    assert monte_carlo(spec, GAINS, implementation).limits == whole.limits
    monkeypatch.setattr(montecarlo, "SCANNED", 300)
    again = monte_carlo(spec, GAINS, implementation)
    assert again.stable == whole.stable
    for one, other in zip(again.requirements, whole.requirements, strict=True):
        assert one.fraction == other.fraction
        # the grid of a chunk is its own: values agree to what they are polished to
        assert [q.value for q in one.quantiles] == pytest.approx([q.value for q in other.quantiles], rel=1e-9)


@pytest.mark.parametrize("design", ["random", "latin_hypercube", "sobol"])
def test_every_design_of_the_draw_covers_the_family(design: str) -> None:
    spec = brake(("seed: 1", f"seed: 1, design: {design}"), more="", samples=512)
    evidence = monte_carlo(spec, GAINS, implementation_of(spec, GAINS))
    margin = evidence.requirements[0]
    # PM falls with tau: 97.4 deg at 1.6 s, 82.95 deg at 3.1 s
    assert margin.worst[0].value < 83.1
    assert margin.worst[0].plant["time_constant_s"] > 3.09
    assert evidence.outside == 0


def test_a_drawn_plant_is_made_again_with_its_noise() -> None:
    spec = brake()
    evidence = monte_carlo(spec, GAINS, implementation_of(spec, GAINS))
    for judged, scenario, measure in zip(
        evidence.limits, ("from_30", "noisy"), ("acceleration_m_s2", "overshoot"), strict=True
    ):
        for worst in judged.worst[:2]:
            again = simulate(spec, GAINS, scenario=scenario, replay=worst.index)
            assert again.plant == worst.plant
            assert again.driven[0].measures[measure] == pytest.approx(worst.value, rel=1e-12)


def test_a_plant_beyond_what_is_proved_is_a_defect_of_the_tool() -> None:
    result = validate(brake(), GAINS)
    certificate = result.digital.certificate
    assert certificate is not None
    proofs = list(certificate.requirements)
    # a proof that says more than is true: PM of at least 84 deg
    side = replace(proofs[2].sides[0], level=math.radians(84.0))
    proofs[2] = replace(proofs[2], sides=(side,))
    found = contradictions(result.evidence, replace(certificate, requirements=tuple(proofs)))
    assert found
    assert "phase_margin_deg" in found[0]
    wrong = replace(result, contradictions=found)
    assert wrong.status == "contradiction"


# -- signals ----------------------------------------------------------------------------------------------------------


def test_a_course_steps_and_ramps() -> None:
    time_s = np.array([0.5 * k for k in range(13)])
    knots = [Knot(1.0, 2.0), Knot(2.0, 4.0, 2.0), Knot(5.0, 0.0)]
    expected = [1, 1, 2, 2, 2, 2.5, 3, 3.5, 4, 4, 0, 0, 0]
    assert piecewise_signal(knots, 1.0, time_s).tolist() == pytest.approx(expected, abs=1e-8)


def test_a_ramp_starts_where_the_entry_before_ended_also_between_samples() -> None:
    time_s = np.asarray(0.2 * np.arange(8), dtype=float)
    found = piecewise_signal([Knot(0.05, 5.0), Knot(0.1, 10.0, 1.0)], 0.0, time_s)
    assert found[:6] == pytest.approx([0.0, 5.5, 6.5, 7.5, 8.5, 9.5])
    found = piecewise_signal([Knot(0.0, 10.0, 0.9), Knot(0.9, 0.0, 1.0)], 0.0, time_s)
    assert found[5] == pytest.approx(9.0)


def test_a_knot_on_a_sample_acts_from_that_sample_on() -> None:
    time_s = np.array([0.2 * k for k in range(200)])  # 0.2 k is not the nearest double to k/5
    for k in range(1, 200):
        assert piecewise_signal([Knot(k / 5, 1.0)], 0.0, time_s).tolist() == [0.0] * k + [1.0] * (200 - k)


def test_without_limits_a_pi_settles_where_the_theory_says() -> None:
    text = SCENARIOS.replace("noise_std: 0.02, quantum: 0.01", "load: [{at_s: 10, value: 0.3}]").replace("20,", "400,")
    spec = brake((", output_limits: [-1, 1]", ", output_limits: [-9, 9]"), more=text)
    driven = simulate(spec, ft.FoPi(0.7, 0.3, 1.0), scenario="noisy").driven[0]
    # with a load of 0.3 at the plant's input the control ends at 1 - 0.3; the integrator leaves no error
    assert driven.traces.applied[0, -1] == pytest.approx(0.7, abs=1e-6)
    assert driven.traces.output[0, -1] == pytest.approx(1.0, abs=1e-6)


# -- the commands -----------------------------------------------------------------------------------------------------


@pytest.fixture
def spec_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    monkeypatch.chdir(tmp_path)
    text = (CONTINUOUS / "brake.yaml").read_text(encoding="utf-8")
    text = text.replace("delay_samples: 0}", "delay_samples: 0, design: sampled, output_limits: [-1, 1]}")
    Path("b.yaml").write_text(text + SCENARIOS.replace("5.5", "5.0"), "utf-8")
    return "b.yaml"


def test_validate_writes_its_evidence(spec_file: str) -> None:
    result = CliRunner().invoke(app, ["validate", spec_file, *OPTIONS, "--samples", "300", "--seed", "7", "--json"])
    # 5 m/s^2 is exceeded by the fastest plants
    assert result.exit_code == 1
    document = json.loads(result.stdout)
    assert Path("results/brake/evidence.json").read_text(encoding="utf-8") == result.stdout
    assert document["drawn"]["samples"] == 300
    assert document["stamp"]["seed"] == 7
    assert [entry["name"] for entry in document["limits"]] == ["acceleration_m_s2", "overshoot"]
    text = CliRunner().invoke(app, ["validate", spec_file, *OPTIONS, "--samples", "300"]).stdout
    assert text.startswith("brake, validated: violated.")
    assert all(len(line) <= 80 for line in text.splitlines())


def test_simulate_writes_the_signals(spec_file: str) -> None:
    result = CliRunner().invoke(app, ["simulate", spec_file, *OPTIONS, "--plant", "time_constant_s=3.1"])
    assert result.exit_code == 0
    assert all(len(line) <= 80 for line in result.stdout.splitlines())
    rows = Path("results/brake/simulation_from_30.csv").read_text(encoding="utf-8").splitlines()
    assert rows[0].startswith("time_s,reference,output,output_rate_per_s")
    assert len(rows) == 1 + 101  # 20 s at 0.2 s, both ends
    first = [float(value) for value in rows[1].split(",")]
    assert first[:3] == [0.0, 0.0, 30.0]
    assert first[3] == pytest.approx(-30.0 / 3.1, rel=1e-12)  # no input before: it decays
    assert Path("results/brake/simulation_noisy.svg").read_text(encoding="utf-8").startswith("<?xml")


def test_files_of_a_scenario_that_was_left_out_are_told_to_be_old(spec_file: str) -> None:
    assert CliRunner().invoke(app, ["simulate", spec_file, *OPTIONS]).stderr.count("earlier result") == 0
    again = CliRunner().invoke(app, ["simulate", spec_file, *OPTIONS, "--scenario", "noisy"])
    told = "simulation_from_30.csv, simulation_from_30.svg in results/brake are of an earlier result, not of this one"
    assert told in again.stderr


def test_both_sides_of_a_requirement_are_told_apart(spec_file: str) -> None:
    text = Path(spec_file).read_text(encoding="utf-8").replace("{at_least: 80}", "{between: [80, 99]}")
    Path(spec_file).write_text(text, encoding="utf-8")
    said = CliRunner().invoke(app, ["validate", spec_file, *OPTIONS, "--samples", "50"]).stdout
    assert "phase_margin_deg >= 80" in said
    assert "phase_margin_deg <= 99" in said


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--scenario", "nowhere"], "there is from_30, noisy"),
        (["--plant", "tau=1"], "no uncertain number"),
        (["--plant", "time_constant_s"], "NAME=VALUE"),
        (["--plant", "time_constant_s=nan"], "time_constant_s: 'nan' is not a finite number"),
        (["--plant", "time_constant_s=2_0"], "time_constant_s: 2_0 has underscores; write 20"),
        (["--replay", "10000"], "was not drawn"),
        (["--replay", "1", "--plant", "time_constant_s=2"], "leave --plant out"),
    ],
)
def test_what_cannot_be_simulated_is_bad_input(spec_file: str, options: list[str], words: str) -> None:
    result = CliRunner().invoke(app, ["simulate", spec_file, *OPTIONS, *options])
    assert result.exit_code == 2
    assert words in result.stderr


def test_a_spec_without_scenarios_is_driven_through_a_default_one_and_validated() -> None:
    spec = brake(more="", samples=50)
    (driven,) = simulate(spec, GAINS).driven
    assert [driven.scenario.reference[0].at_s, driven.scenario.load[0].at_s] == [0.0, driven.scenario.duration_s / 2]
    assert driven.measures["settling_time_s"] < driven.scenario.duration_s / 2
    assert validate(spec, GAINS).status == "met"
    with pytest.raises(DomainError, match="samples"):
        validate(spec, GAINS, samples=0)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("scenario: noisy", "scenario: noisi", "no scenario has this name; there is from_30, noisy"),
        ("name: noisy", "name: from_30", "earlier scenario"),
        ("[{at_s: 1, value: 1}]", "[{at_s: 1, value: 1, ramp_s: 2}, {at_s: 2, value: 0}]", "is not after 3"),
        ("[{at_s: 1, value: 1}]", "[]", "0 entries"),
        ("duration_s: 20, reference: [{at_s: 1", "duration_s: 2e9, reference: [{at_s: 1", "more than 1000000"),
        ("noise_std: 0.02", "judged_from_s: 20", "is not before the end"),
        ("at_most: 0.2", "equals: 0.2", "equals"),
        ("before: free", "before: falling", "falling"),
        ("overshoot:", "overshot:", "overshot"),
    ],
)
def test_mistakes_in_scenarios_and_limits_are_named(old: str, new: str, words: str) -> None:
    assert old in SCENARIOS
    with pytest.raises(SpecError, match=words):
        brake(more=SCENARIOS.replace(old, new))


def test_limits_without_scenarios_and_scenarios_without_a_controller_are_refused() -> None:
    with pytest.raises(SpecError, match="no scenario to judge"):
        brake(more="limits: [{iae: {at_most: 1}}]\n")
    text = (CONTINUOUS / "brake.yaml").read_text(encoding="utf-8")
    without = "".join(line for line in text.splitlines(True) if not line.startswith("digital"))
    with pytest.raises(SpecError, match="add digital"):
        parse_spec(without + SCENARIOS)


# -- blocks -----------------------------------------------------------------------------------------------------------

FREE = "validation: {samples: 1200, seed: 1, distributions: {time_constant_s: {normal: {mean: 2.3, std: 0.9}}}}"


@pytest.mark.thinned(3)
@pytest.mark.parametrize("how", ["", "design: sobol, ", "design: latin_hypercube, "])
def test_blocks_put_together_in_any_order_are_the_whole(how: str) -> None:
    spec = brake(("samples: 600", f"{how}samples: 1030"))
    blocks = [validate_block(spec, GAINS, *edge) for edge in ((1024, 1030), (0, 512), (512, 1024))]
    whole = validate(spec, GAINS)
    assert validate(spec, GAINS, blocks=pickle.loads(pickle.dumps(blocks))).to_dict() == whole.to_dict()


def test_blocks_keep_apart_what_is_no_plant_of_the_family() -> None:
    spec = brake(("validation: {samples: 600, seed: 1}", FREE))
    blocks = [validate_block(spec, GAINS, *edge) for edge in ((0, 512), (512, 1024), (1024, 1200))]
    whole = validate(spec, GAINS)
    assert whole.evidence.outside > 0
    assert whole.evidence.no_plants > 0
    assert validate(spec, GAINS, blocks=blocks).to_dict() == whole.to_dict()


@pytest.mark.thinned(2)
@pytest.mark.parametrize("edges", [[(0, 512)], [(0, 1200), (1024, 1200)], [(512, 1200)], [(0, 512), (1024, 1200)]])
def test_blocks_that_are_not_all_draws_are_refused(edges: list[tuple[int, int]]) -> None:
    spec = brake(samples=1200, more="")
    blocks = [validate_block(spec, GAINS, *edge) for edge in edges]
    with pytest.raises(DomainError, match="do not make up 1200 draws"):
        validate(spec, GAINS, blocks=blocks)


@pytest.mark.thinned(3)
@pytest.mark.parametrize("edge", [(0, 511), (1, 600), (512, 512), (0, 1024), (1024, 512)])
def test_a_block_that_is_cut_elsewhere_is_refused(edge: tuple[int, int]) -> None:
    with pytest.raises(DomainError, match="are no block; cut at multiples of 512"):
        validate_block(brake(more=""), GAINS, *edge)
