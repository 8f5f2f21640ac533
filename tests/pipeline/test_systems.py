"""Systems of two specs that take turns: the file, the loop on samples, the inclusion, and what the command says."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from cases.markdown_pages import blocks_of
from cases.project import CONTINUOUS, ROOT
from typer.testing import CliRunner, Result

import fopi_tune as ft
from fopi_tune.cli.commands import app
from fopi_tune.core.controller import FoPi
from fopi_tune.core.loops import Plants
from fopi_tune.digital import Memory
from fopi_tune.digital.implementation import implementation_of, runtime_of
from fopi_tune.digital.oustaloup import oustaloup
from fopi_tune.errors import DomainError, SpecError
from fopi_tune.montecarlo.draws import sample_points
from fopi_tune.montecarlo.outcomes import sampling_plan_of
from fopi_tune.montecarlo.systems import hybrid_scenario
from fopi_tune.simulation.fractional.linear import Signal, exact_response
from fopi_tune.simulation.hybrid.flow import ModeLoop
from fopi_tune.simulation.hybrid.inclusion import simulate_hybrid
from fopi_tune.simulation.hybrid.model import Corner, HybridCar, HybridStart, Mode, Watch
from fopi_tune.simulation.sampled.plants import discretize_plants
from fopi_tune.simulation.sampled.reference import simulate_reference
from fopi_tune.spec import load_any, load_spec, load_system
from fopi_tune.spec.model import DesignSpec, Knot, SystemSpec, ValidationSpec
from fopi_tune.spec.systems import system_json_schema

CAR, CAR_HELD = ROOT / "systems" / "car.yaml", ROOT / "systems" / "car_held.yaml"
SWITCHING = ROOT / "systems" / "switching.yaml"
MODES = "throttle", "brake"

SMALL = """
schema: 1
name: small
system:
  throttle: {spec: throttle.yaml, gains: {kp: 0.09, ki: 0.025, alpha: 0.8}, output_limits: [0, 1]}
  brake: {spec: brake.yaml, gains: {kp: 0.07, ki: 0.11, alpha: 0.45}, output_limits: [-1, 0]}
  hysteresis: 0.5
  inactive: tracking
scenarios:
  - {name: up, duration_s: 20, reference: [{at_s: 0, value: 10}, {at_s: 12, value: 4}]}
  - {name: down, duration_s: 20, initial_output: 20, before: free, noise_std: 0.1, reference: [{at_s: 0, value: 10}]}
limits:
  - acceleration_m_s2: {at_most: 2}
  - switch_count: {at_most: 3}
    scenario: down
validation: {samples: 40, seed: 3}
"""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    for name in ("throttle", "brake"):
        (tmp_path / f"{name}.yaml").write_text((CONTINUOUS / f"{name}.yaml").read_text())
    (tmp_path / "small.yaml").write_text(SMALL)
    return tmp_path


def changed(folder: Path, old: str, new: str) -> Path:
    assert SMALL.count(old) == 1
    (folder / "changed.yaml").write_text(SMALL.replace(old, new))
    return folder / "changed.yaml"


# ---- the file ----


def test_a_system_names_two_specs_and_says_how_they_take_turns(folder: Path) -> None:
    system = load_system(folder / "small.yaml")
    assert [mode.name for mode in system.modes] == ["throttle", "brake"]
    assert system.modes[0].gains == FoPi(0.09, 0.025, 0.8)
    assert system.modes[1].spec.digital is not None
    assert system.modes[1].spec.digital.output_limits == (-1.0, 0.0)
    assert (system.hysteresis, system.inactive, system.first) == (0.5, "tracking", "throttle")
    assert system.family.uncertain_names == ("brake.time_constant_s",)


def test_a_mode_may_limit_the_rate_of_its_output(folder: Path) -> None:
    path = changed(folder, "output_limits: [-1, 0]}", "output_limits: [-1, 0], output_rate_per_s: 0.5}")
    digitals = [mode.spec.digital for mode in load_system(path).modes]
    assert [each.output_rate_per_s for each in digitals if each is not None] == [None, 0.5]
    found = ft.simulate_system(path)
    applied, mode = found.driven[1].traces.demanded[0], found.driven[1].traces.mode[0]
    braking = (mode[1:] == 2) & (mode[:-1] == 2)
    assert braking.sum() > 5
    assert np.abs(np.diff(applied))[braking].max() <= 0.1 * (1.0 + 1e-12)
    with pytest.raises(DomainError, match="output_rate_per_s belongs to the loop on samples"):
        ft.simulate_system(path, scenario="up", exact=True)


def test_an_actuator_with_a_rate_that_no_mode_knows_of_is_told(folder: Path) -> None:
    path = changed(folder, "up, duration_s: 20,", "up, duration_s: 20, rate_per_s: 0.02,")
    (note,) = [each for each in ft.simulate_system(path).driven[0].notes if "rate_per_s" in each]
    assert note.startswith("the actuator's rate_per_s of 0.02 acted, which the controller does not know")


def test_the_digest_of_a_system_knows_its_specs(folder: Path) -> None:
    before = load_system(folder / "small.yaml").sha256
    assert load_system(folder / "small.yaml").sha256 == before
    brake = folder / "brake.yaml"
    brake.write_text(brake.read_text().replace("max: 3.1", "max: 3.2"))
    assert load_system(folder / "small.yaml").sha256 != before


def test_the_page_of_systems_shows_one_that_can_be_read(tmp_path: Path) -> None:
    page = (ROOT / "docs" / "howto" / "two_loops.md").read_text(encoding="utf-8")
    block, *_ = (block for block in blocks_of(page) if block.language == "yaml")
    (tmp_path / "systems").mkdir()
    (tmp_path / "specs").symlink_to(ROOT / "specs")
    path = tmp_path / block.file
    path.write_text(block.text)
    assert load_system(path).modes[1].gains is None


def test_a_file_is_told_to_be_a_spec_or_a_system(folder: Path) -> None:
    assert isinstance(load_any(folder / "brake.yaml"), DesignSpec)
    assert isinstance(load_any(folder / "small.yaml"), SystemSpec)
    with pytest.raises(SpecError, match="describes a system"):
        load_spec(folder / "small.yaml")
    with pytest.raises(SpecError, match="no system"):
        load_system(folder / "brake.yaml")


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("spec: brake.yaml", "spec: none.yaml", r"brake\.spec: the spec cannot be used: .*none.yaml.*no such file"),
        ("hysteresis: 0.5", "hysteresis: -1", "out of range"),
        ("hysteresis: 0.5", "hysterisis: 0.5", "hysteresis"),
        ("inactive: tracking", "inactive: trackin", "tracking"),
        ("hysteresis: 0.5", "hysteresis: 0.5\n  min_dwell_s: -0.2", "-0.2 is out of range; it must be .*at least 0"),
        ("hysteresis: 0.5", "hysteresis: 0.5\n  min_dwell_s: .nan", "nan"),
        ("hysteresis: 0.5", "hysteresis: 0.5\n  min_dwell_s: .inf", "inf"),
        ("hysteresis: 0.5", "hysteresis: 0.5\n  min_dwell_s: 600", "600 s is longer than every scenario.* at most 20"),
        ("hysteresis: 0.5", "hysteresis: 0.5\n  min_dwell_s: 1 s", "has a unit; write 1 alone"),
        ("output_limits: [0, 1]", "output_limits: [1, 0]", "not less"),
        ("alpha: 0.45", "alpha: 2.5", "out of range"),
        ("scenario: down", "scenario: sideways", "no scenario has this name"),
        ("duration_s: 20, reference", "duration_s: 1e9, reference", "samples are more"),
        ("duration_s: 20, reference", "duration_s: 1e99, reference", "samples are more"),
        ("kp: 0.07, ki: 0.11, ", "kp: 0, ki: 0, ", None),
    ],
)
def test_mistakes_in_a_system_are_named(folder: Path, old: str, new: str, words: str | None) -> None:
    path = changed(folder, old, new)
    if words is None:  # no controller at all is one that can be simulated
        assert load_system(path).modes[1].gains == FoPi(0.0, 0.0, 0.45)
        return
    with pytest.raises(SpecError, match=words) as caught:
        load_system(path)
    assert str(caught.value).startswith(f"{path}:")


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (("sample_time_s: 0.2", "sample_time_s: 0.1"), "make them equal"),
        (("delay_samples: 0", "delay_samples: 0.5"), "those that differ are whole samples"),
        (("digital:", "description2:"), "cannot be used"),
    ],
)
def test_specs_that_do_not_fit_together_are_named(folder: Path, change: tuple[str, str], words: str) -> None:
    brake = folder / "brake.yaml"
    brake.write_text(brake.read_text().replace(*change))
    with pytest.raises(SpecError, match=words):
        load_system(folder / "small.yaml")


def test_the_schema_of_systems_accepts_the_shipped_ones_and_refuses_others() -> None:
    jsonschema = pytest.importorskip("jsonschema")
    yaml = pytest.importorskip("ruamel.yaml").YAML(typ="safe", pure=True)
    for path in (CAR, SWITCHING):
        document = yaml.load(path.read_text())
        jsonschema.validate(document, system_json_schema())
        document["system"]["inactive"] = "asleep"
        with pytest.raises(jsonschema.ValidationError):
            jsonschema.validate(document, system_json_schema())


# ---- on samples ----


def test_a_system_runs_as_the_plain_simulation_of_its_two_loops_does(folder: Path) -> None:
    system = load_system(folder / "small.yaml")
    found = ft.simulate_system(system, plant={"brake.time_constant_s": 2.9}, scenario="up")
    (driven,) = found.driven
    controllers, held, implementations = [], [], []
    for mode, tau in zip(system.modes, (None, 2.9), strict=True):
        assert mode.gains is not None
        implementation = implementation_of(mode.spec, mode.gains)
        implementations.append(implementation)
        controllers.append(runtime_of(implementation.sections, mode.spec))
        point = np.array([[tau]]) if tau else np.zeros((1, 0))
        held.append(discretize_plants(Plants.members(mode.spec.plant, point), 0.2))
    run = hybrid_scenario(system, system.scenarios[0], implementations[0], 3)
    plain = simulate_reference(controllers, held, run)
    # rounding of sums in another order, of signals up to 10
    np.testing.assert_allclose(driven.traces.output, plain.output, rtol=1e-12, atol=1e-12)
    np.testing.assert_array_equal(driven.traces.mode, plain.mode)
    assert list(driven.switch_times_s) == [
        float(plain.time_s[k]) for k in range(1, 101) if plain.mode[0, k] != plain.mode[0, k - 1]
    ]
    assert driven.measures["switch_count"] == len(driven.switch_times_s) > 0


def test_a_drawn_pair_is_made_again_with_its_noise(folder: Path) -> None:
    system = load_system(folder / "small.yaml")
    validated = ft.validate_system(system)
    for scenario, judged in zip(system.scenarios, validated.evidence.scenarios, strict=True):
        worst = judged.limits[0].worst[0]
        again = ft.simulate_system(system, scenario=scenario.name, replay=worst.index)
        assert again.plant == worst.plant
        assert again.driven[0].measures["acceleration_m_s2"] == worst.value


def test_uncertain_numbers_of_both_plants_are_drawn_together(folder: Path) -> None:
    throttle = folder / "throttle.yaml"
    throttle.write_text(throttle.read_text().replace("gain: 4.39", "gain: {min: 4, max: 5}"))
    system = load_system(folder / "small.yaml")
    assert system.family.uncertain_names == ("throttle.gain", "brake.time_constant_s")
    assert system.validation is not None
    drawn = sample_points(sampling_plan_of(system.validation), system.family, 7, 1)[0]
    again = ft.simulate_system(system, replay=7, scenario="up")
    assert again.plant == {"throttle.gain": drawn[0], "brake.time_constant_s": drawn[1]}
    named = ft.simulate_system(system, plant=again.plant, scenario="up")
    np.testing.assert_array_equal(named.driven[0].traces.output, again.driven[0].traces.output)


def test_distributions_and_files_of_samples_name_the_mode_of_their_number(folder: Path) -> None:
    named = "distributions: {brake.time_constant_s: {nominal_plus_noise: {shape: half_normal, mean: 0.85}}}"
    path = changed(folder, "seed: 3", f"seed: 3, {named}")
    validated = ft.validate_system(path)
    drawn = validated.to_dict()["drawn"]
    assert 0 < drawn["outside_the_family"] < 40
    assert "brake.time_constant_s" in drawn["distributions"]
    worst = validated.evidence.scenarios[0].limits[0].worst[0]
    assert ft.simulate_system(path, scenario="up", replay=worst.index).plant == worst.plant
    (folder / "pairs.csv").write_text("brake.time_constant_s\n1.7\n2.9\n")
    path = changed(folder, "samples: 40, seed: 3", "samples_file: pairs.csv")
    listed = ft.validate_system(path).evidence
    assert listed.scenarios[0].finite.total == 2
    assert ft.simulate_system(path, scenario="up", replay=1).plant == {"brake.time_constant_s": 2.9}
    path = changed(folder, "seed: 3", "seed: 3, distributions: {time_constant_s: uniform}")
    with pytest.raises(SpecError, match=r"brake\.time_constant_s"):
        load_system(path)


def test_gains_that_nobody_gives_are_tuned(folder: Path) -> None:
    path = changed(folder, ", gains: {kp: 0.09, ki: 0.025, alpha: 0.8}", "")
    found = ft.simulate_system(path, scenario="up")
    design = ft.tune(folder / "throttle.yaml", proof=False)
    assert found.gains["throttle"] == design.gains
    given = FoPi(0.1, 0.02, 0.9)
    assert ft.simulate_system(path, {"throttle": given}, scenario="up").gains["throttle"] == given
    with pytest.raises(DomainError, match="no mode 'clutch'"):
        ft.simulate_system(path, {"clutch": given})


def test_the_papers_car_chatters_with_held_memories_and_not_with_reset_ones(folder: Path) -> None:
    text = CAR.read_text().replace("../specs/", "")
    jumps = {}
    for inactive in ("held", "tracking", "reset"):
        (folder / "car.yaml").write_text(text.replace("inactive: reset", f"inactive: {inactive}"))
        driven = ft.simulate_system(folder / "car.yaml", scenario="experiment_1").driven[0]
        jumps[inactive] = driven.measures["switch_count"]
    assert jumps["reset"] <= 10 < 50 < jumps["held"]


@pytest.mark.thinned(2)
@pytest.mark.parametrize(("seconds", "samples"), [(0.0, 0), (0.2, 1), (0.6, 3), (0.61, 4), (1e-9, 1)])
def test_a_minimum_dwell_is_rounded_up_to_samples(folder: Path, seconds: float, samples: int) -> None:
    system = load_system(changed(folder, "hysteresis: 0.5", f"hysteresis: 0.5\n  min_dwell_s: {seconds}"))
    assert system.min_dwell_samples == samples
    notes = ft.simulate_system(system, scenario="up").notes
    rounded = [note for note in notes if "min_dwell_s" in note]
    assert len(rounded) == (seconds in (0.61, 1e-9))
    assert all(f"rounded up to {samples} sample" in note for note in rounded)
    assert not any("min_dwell_s" in note for note in ft.simulate_system(system, scenario="up", exact=True).notes)
    with pytest.raises(DomainError, match="min_dwell_s nan"):
        replace(system, min_dwell_s=math.nan)


def shortened(system: SystemSpec) -> SystemSpec:
    """Its first scenario alone, from the highest setpoint down in half of the time."""
    drive = replace(
        system.scenarios[0], duration_s=75.0, reference=(Knot(0.0, 20.0), Knot(25.0, 12.0), Knot(50.0, 5.0))
    )
    return replace(system, scenarios=(drive,))


def test_every_simulation_of_a_system_keeps_the_minimum_dwell(folder: Path) -> None:
    text = CAR.read_text().replace("../specs/", "").replace("inactive: reset", "inactive: held")
    late = [(folder / f"{name}.yaml").read_text().replace("delay_samples: 0", "delay_samples: 1") for name in MODES]
    (folder / "car.yaml").write_text(text)
    system = shortened(load_system(folder / "car.yaml"))
    for name, content in zip(MODES, late, strict=True):
        (folder / f"{name}.yaml").write_text(content)
    delayed = shortened(load_system(folder / "car.yaml"))
    # on samples; with located jumps; in equal steps
    for each, exact in ((system, False), (system, True), (delayed, True)):
        plain, dwelling = (
            np.diff(ft.simulate_system(s, scenario="experiment_1", exact=exact).driven[0].switch_times_s)
            for s in (each, replace(each, min_dwell_s=1.5))
        )
        least = 1.5 if exact else 1.6
        assert plain.min() < least - 0.1 <= dwelling.min() - 0.1 + 1e-9
        assert len(dwelling) > 4


def test_evidence_of_a_system_keeps_the_minimum_dwell() -> None:
    held = replace(load_system(CAR_HELD), min_dwell_s=4.0)
    evidence = ft.validate_system(held, samples=30).evidence
    for scenario in evidence.scenarios:
        (counted,) = (each for each in scenario.limits if each.limit and each.limit.measure == "switch_count")
        (duration,) = (each.duration_s for each in held.scenarios if each.name == scenario.scenario)
        assert counted.worst[0].value <= duration / 4.0 + 1.0
        assert counted.fraction.met == 30
        # the acceleration where the brake begins is what it is without one
    plain = ft.validate_system(replace(held, min_dwell_s=0.0), samples=30).evidence
    assert plain.scenarios[0].limits[1].fraction.met == 0


def test_the_joint_yield_of_a_system_is_that_of_its_pairs_one_by_one() -> None:
    system = replace(shortened(load_system(CAR_HELD)), validation=ValidationSpec(samples=25, seed=3))
    evidence = ft.validate_system(system).evidence
    met = []
    for index in range(25):
        driven = ft.simulate_system(system, replay=index).driven
        met.append([run.finite and not run.chattering and all(met for _, met in run.limits) for run in driven])
    flags = np.array(met)
    assert evidence.joint.fraction.met == flags.all(axis=1).sum()
    assert [each.joint.fraction.met for each in evidence.scenarios] == flags.sum(axis=0).tolist()
    assert evidence.joint.first_missed == tuple(np.flatnonzero(~flags.all(axis=1))[:5].tolist())


# ---- in continuous time ----


def test_the_exact_car_is_the_inclusion_with_a_filter_of_many_poles(folder: Path) -> None:
    system = load_system(folder / "small.yaml")
    driven = ft.simulate_system(system, scenario="up", exact=True).driven[0]
    band = (1e-6, 1e5)
    throttle = ModeLoop(4.39, 0.1746, FoPi(0.09, 0.025, 0.8), oustaloup(0.8, 33, band), (0.0, 1.0))
    brake = ModeLoop(1 / 2.25, 1 / 2.25, FoPi(0.07, 0.11, 0.45), oustaloup(0.45, 33, band), (-1.0, 0.0))
    car = HybridCar(throttle, brake, 0.5, Memory.TRACKING)
    run = simulate_hybrid(
        car, [Corner(0.0, 10.0), Corner(12.0, 4.0)], 20.0, [19.9], start=HybridStart(), watch=Watch(5, 2.0)
    )
    assert len(driven.switch_times_s) == len(run.events) > 0
    # two filters of s^-alpha that differ by 5e-4
    np.testing.assert_allclose(driven.switch_times_s, [event.time_s for event in run.events], atol=2e-3)


def test_the_sampled_car_tends_to_the_inclusion(folder: Path) -> None:
    first = {}
    for step in (0.2, 0.1, 0.05):
        for name in ("throttle", "brake"):
            spec = folder / f"{name}.yaml"
            text = (CONTINUOUS / f"{name}.yaml").read_text().replace("sample_time_s: 0.2", f"sample_time_s: {step}")
            spec.write_text(text.replace("poles: 7", "poles: 15").replace("[1.0e-3, 1.0e3]", "[1.0e-4, 1.0e4]"))
        first[step] = ft.simulate_system(folder / "small.yaml", scenario="up").driven[0].switch_times_s[0]
    exact = ft.simulate_system(folder / "small.yaml", scenario="up", exact=True).driven[0].switch_times_s[0]
    # the first jump is seen at the next sample, and the control is half a sample old on average
    for step, found in first.items():
        assert abs(found - exact) < 2.0 * step


def test_without_hysteresis_the_inclusion_slides_and_says_so() -> None:
    found = ft.simulate_system(SWITCHING, exact=True)
    (driven,) = found.driven
    assert found.status == "chattering"
    assert driven.chattering
    assert "sliding" in driven.outcome
    # nothing is judged that did not happen
    assert math.isnan(driven.measures["iae"])
    assert not any(met for _, met in driven.limits)
    # PAPER's setpoints: 30 to 15 at 20 s; the line is reached soon after
    assert driven.switch_times_s[-1] == pytest.approx(21.4734756, abs=1e-3)


def test_an_exact_loop_answers_as_laplace_inversion_does() -> None:
    text = """
schema: 1
name: exact
plant: {model: lag, static_gain: 1, time_constant_s: {nominal: 2.35, min: 1.6, max: 3.1}}
controller: {kp: 0.5, ki: 0.6, alpha: 0.55}
requirements: [{phase_margin_deg: {at_least: 60}}]
digital: {sample_time_s: 0.2}
scenarios: [{name: step, duration_s: 20, reference: [{at_s: 0, value: 1}]}]
"""
    spec = ft.parse_spec(text)
    gains = FoPi(0.5, 0.6, 0.55)
    found = ft.simulate(spec, gains, exact=True)
    (driven,) = found.driven
    # PAPER.md section 8: y(5), y(20) for tau = 2.35
    time = driven.traces.time_s
    at = {t: float(driven.traces.output[0, np.argmin(np.abs(time - t))]) for t in (5.0, 20.0)}
    assert driven.accuracy is not None
    assert driven.accuracy < 1e-5
    assert at[5.0] == pytest.approx(0.7414991568, abs=driven.accuracy)
    assert at[20.0] == pytest.approx(0.8489558463, abs=driven.accuracy)
    # the rate, by differences of the exact response
    h = 1e-3
    ends = exact_response(gains, spec.plant.member(np.array([2.35])), Signal.OUTPUT_AFTER_REFERENCE, [5.0 - h, 5.0 + h])
    rate = float(driven.traces.rate[0, np.argmin(np.abs(time - 5.0))])
    assert rate == pytest.approx((ends[1] - ends[0]) / (2 * h), abs=1e-4)


@pytest.mark.parametrize("key", ["noise_std: 0.1", "quantum: 0.1", "rate_per_s: 0.1"])
def test_what_only_samples_have_is_refused_in_continuous_time(folder: Path, key: str) -> None:
    path = changed(folder, "duration_s: 20, reference", f"duration_s: 20, {key}, reference")
    with pytest.raises(DomainError, match=key.split(":")[0]):
        ft.simulate_system(path, scenario="up", exact=True)


EVERY_START = {"held_step", "held_ramp", "released_step"}


# ---- the paper's manoeuvre: the comfort limit and what it depends on ----


@pytest.mark.parametrize(
    ("gain", "comfortable", "brakes"),
    [
        (1, {"held_step": True, "held_ramp": True, "released_step": False}, {"released_step"}),
        (10, {"held_step": False, "held_ramp": True, "released_step": False}, EVERY_START),
    ],
)
def test_the_comfort_limit_holds_with_the_pedal_held_and_not_with_it_released(
    gain: int, comfortable: dict[str, bool], brakes: set[str]
) -> None:
    spec = ft.load_spec(ROOT / "systems" / f"manoeuvre_gain_{gain}.yaml")
    evidence = ft.validate(spec, FoPi(0.07, 0.11, 0.45), samples=500).evidence
    for judged in evidence.limits:
        assert judged.limit is not None
        assert judged.scenario is not None
        about_comfort = judged.limit.measure == "acceleration_m_s2"
        expected = comfortable[judged.scenario] if about_comfort else judged.scenario in brakes
        assert judged.fraction.met == (500 if expected else 0), (judged.scenario, judged.limit.measure)
    # released, the plant alone slows by y/tau: 30/1.6/3.6 m/s^2 before any control
    worst = next(j for j in evidence.limits if j.scenario == "released_step").worst[0].value
    assert worst >= 30.0 / (3.6 * 1.61)


# ---- the command ----


def fopi(*arguments: str) -> Result:
    return CliRunner().invoke(app, list(arguments))


def test_the_command_drives_and_validates_a_system(folder: Path) -> None:
    path, out = str(folder / "small.yaml"), str(folder / "out")
    ended = fopi("simulate", path, "--out", out)
    assert ended.exit_code in (0, 1)
    assert "brake.time_constant_s = 2.25" in ended.stdout
    rows = (folder / "out" / "simulation_up.csv").read_text().splitlines()
    assert rows[0].endswith("control_applied,mode")
    assert {row.rsplit(",", 1)[1] for row in rows[1:]} <= {"1", "2"}
    exact = fopi("simulate", path, "--exact", "--scenario", "up", "--out", out, "--json")
    document = json.loads(exact.stdout)
    assert document["exact"] is True
    assert document["scenarios"][0]["switch_times_s"]
    assert (folder / "out" / "exact_up.svg").exists()
    said = fopi("validate", path, "--out", out)
    assert said.exit_code == 1
    assert "modes do not chatter" in said.stdout
    evidence = json.loads((folder / "out" / "evidence.json").read_text())
    assert [each["name"] for each in evidence["scenarios"]] == ["up", "down"]
    assert evidence["drawn"]["samples"] == 40


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["simulate", "--kp", "1", "--ki", "1", "--alpha", "1"], "belong into its file"),
        (["simulate", "--plant", "time_constant_s=2"], "brake.time_constant_s"),
        (["simulate", "--scenario", "none"], "there is up, down"),
        (["simulate", "--replay", "40"], "was not drawn"),
        (["validate", "--samples", "0"], "at least 1"),
        (["tune"], "says not what to tune"),
    ],
)
def test_what_a_system_cannot_do_is_bad_input(folder: Path, arguments: list[str], words: str) -> None:
    ended = fopi(arguments[0], str(folder / "small.yaml"), *arguments[1:], "--out", str(folder / "out"))
    assert ended.exit_code == 2
    assert words in ended.stderr
    assert not (folder / "out").exists()


def test_modes_are_numbered() -> None:
    assert [Mode.THROTTLE, Mode.BRAKE] == [1, 2]
