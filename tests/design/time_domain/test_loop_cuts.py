"""Rows of the loop's frequency response: values by `core` on samples, slopes by its differences."""

from __future__ import annotations

import numpy as np
import pytest

from fopi_tune.core.controller import FoPi
from fopi_tune.core.loops import Plants
from fopi_tune.core.margins import margins_of
from fopi_tune.core.sampled_loops import SampledLoops
from fopi_tune.design.constraints import Bound
from fopi_tune.design.global_search.worst_case import FIELDS, ROW
from fopi_tune.design.time_domain.loop_cuts import LoopCuts
from fopi_tune.design.time_domain.problem import ScenarioProblem
from fopi_tune.digital.implementation import implementation_of
from fopi_tune.spec import parse_spec
from fopi_tune.spec.model import DesignSpec

TEXT = """
schema: 1
name: a
plant:
  model: lag
  static_gain: {min: 0.8, max: 1.25, nominal: 1}
  time_constant_s: {min: 1.6, max: 3.1, nominal: 2.3}
  dead_time_s: {min: 0.2, max: 0.4, nominal: 0.3}
controller: {kp: {min: 0, max: 9}, ki: {min: 0, max: 9}, alpha: {min: 0.3, max: 1.6}}
digital: {sample_time_s: 0.1, poles: 5}
scenarios: [{name: one, duration_s: 10, reference: [{at_s: 0, value: 1}]}]
objective: {minimize: iae, scenario: one}
requirements:
"""
REQUIREMENTS = (
    "sensitivity_db: {at_most: 3}",
    "complementary_sensitivity_db: {at_most: 2}",
    "control_sensitivity_db: {at_most: 9}",
    "sensitivity_db: {at_most: -20}, to_rad_s: 0.03",
    "loop_gain_db: {at_most: -3}, from_rad_s: 3",
    "phase_margin_deg: {at_least: 55}",
    "gain_margin_db: {at_least: 9}",
    "delay_margin_s: {at_least: 0.6}",
    "crossover_rad_s: {at_most: 0.7}",
    "phase_margin_deg: {equals: 80}, on: nominal",
    "crossover_rad_s: {equals: 0.9}, on: nominal",
)
GAINS = {"FOPI": FoPi(1.3, 0.62, 0.87), "PI": FoPi(1.1, 0.55, 1.0), "above 1": FoPi(1.2, 0.4, 1.2)}
#: below the first no response changes by what the test could tell
FREQUENCIES = np.geomspace(1e-9, np.pi / 0.1 * (1 - 1e-9), 6001)


def spec_of(*requirements: str) -> DesignSpec:
    return parse_spec(TEXT + "".join(f"  - {{{each}}}\n" for each in requirements))


def loop_of(spec: DesignSpec, gains: FoPi, point: np.ndarray) -> SampledLoops:
    return SampledLoops.implemented(gains, implementation_of(spec, gains), Plants.members(spec.plant, point[None, :]))


def peak(loop: SampledLoops, function: str, low: float, high: float) -> float:
    """The largest value in a band, dB: the best of a grid, then of finer ones about it."""
    omega = FREQUENCIES[np.searchsorted(FREQUENCIES, low) : np.searchsorted(FREQUENCIES, high, "right")]
    omega = np.concatenate([omega, [end for end in (low, high) if FREQUENCIES[0] <= end <= FREQUENCIES[-1]]])
    found = -np.inf
    for _ in range(5):
        rows = np.zeros(len(omega), dtype=np.intp)
        response = loop.response(rows, omega)
        values = {
            "sensitivity_db": 1.0 / (1.0 + response),
            "complementary_sensitivity_db": response / (1.0 + response),
            "control_sensitivity_db": loop.sections.response(omega) / (1.0 + response),
            "loop_gain_db": response,
        }[function]
        best = omega[int(np.abs(values).argmax())]
        found = 20.0 * np.log10(np.abs(values).max())
        width = np.log(omega.max() / omega.min()) / len(omega) * 4.0
        omega = np.clip(
            best * np.exp(np.linspace(-width, width, 201)), max(low, FREQUENCIES[0]), min(high, FREQUENCIES[-1])
        )
    return float(found)


def value_of(spec: DesignSpec, gains: FoPi, index: int, point: np.ndarray) -> float:
    """The public value of a requirement for one plant, by `core`."""
    requirement, loop = spec.requirements[index], loop_of(spec, gains, point)
    if requirement.quantity.endswith("_db") and requirement.quantity != "gain_margin_db":
        return peak(loop, requirement.quantity, requirement.from_rad_s, requirement.to_rad_s)
    found = margins_of(loop)
    value = getattr(found, requirement.quantity)
    assert value is not None
    return float(value)


def natural_slack(cuts: LoopCuts, row: int, value: float) -> float:
    """Of a public value; of an equality limit - value."""
    constraint = cuts.problem.constraints[row]
    natural = constraint.quantity.to_natural(value)
    if constraint.bound is Bound.EQUAL:
        return (constraint.limit - natural) * constraint.scale
    return constraint.slack(natural)


@pytest.mark.thinned(4)
@pytest.mark.parametrize("which", GAINS)
@pytest.mark.parametrize("requirement", REQUIREMENTS)
def test_a_cut_is_what_core_has_at_its_plant_and_its_slopes_are_cores_differences(requirement: str, which: str) -> None:
    spec, gains = spec_of(requirement), GAINS[which]
    cuts = LoopCuts(ScenarioProblem.of(spec).loop)
    found = cuts.look(gains)
    assert found is not None
    cuts.learn(found)
    values, slopes = cuts.slacks(gains)
    checked = 0
    for k, cut in enumerate(cuts.pool):
        row = int(cut[ROW])
        if cuts.problem.constraints[row].requirement != 0:
            continue
        point = np.array(cut[FIELDS:])
        expected = natural_slack(cuts, row, value_of(spec, gains, 0, point))
        if values[k] > expected + 1e-4:
            # of a plant with several peaks a cut may follow one that is not the highest
            continue
        checked += 1
        assert values[k] == pytest.approx(expected, abs=2e-6)
        for j, step in enumerate((1e-4, 1e-4, 1e-4)):
            both = []
            for side in (1.0, -1.0):
                numbers = [gains.kp, gains.ki, gains.alpha]
                numbers[j] += side * step
                both.append(natural_slack(cuts, row, value_of(spec, FoPi(*numbers), 0, point)))
            difference = (both[0] - both[1]) / (2.0 * step)
            assert slopes[k, j] == pytest.approx(difference, rel=2e-3, abs=2e-3), (j, which)
    assert checked >= 1
    # the worst plants of the box: none of a grid is worse
    low, high = spec.plant.low, spec.plant.high
    if "nominal" not in requirement:
        own = [k for k, cut in enumerate(cuts.pool) if cuts.problem.constraints[int(cut[ROW])].requirement == 0]
        rng = np.random.default_rng(7)
        points = low + rng.random((20, 3)) * (high - low)
        worst = min(natural_slack(cuts, int(cuts.pool[own[0]][ROW]), value_of(spec, gains, 0, p)) for p in points)
        assert min(values[k] for k in own) <= worst + 1e-6


def test_an_equality_counts_to_both_sides() -> None:
    spec = spec_of("crossover_rad_s: {equals: 0.9}, on: nominal")
    cuts = LoopCuts(ScenarioProblem.of(spec).loop)
    signs = []
    for factor in (0.5, 1.6):
        gains = FoPi(1.3 * factor, 0.62 * factor, 0.87)
        cuts.pool = []
        found = cuts.look(gains)
        assert found is not None
        cuts.learn(found)
        values, _ = cuts.slacks(gains)
        rows = cuts.rows_of_pool
        equal = cuts.is_equality(rows)
        assert equal.sum() == 1
        # limit - value: positive where the crossover is too low
        signs.append(np.sign(values[equal][0]))
        assert cuts.violation(found) >= abs(values[equal][0]) - 1e-9
    assert signs == [1.0, -1.0]


def test_an_unstable_loop_has_no_cuts() -> None:
    cuts = LoopCuts(ScenarioProblem.of(spec_of("sensitivity_db: {at_most: 3}")).loop)
    assert cuts.look(FoPi(9.0, 9.0, 1.0)) is None
    values, slopes = cuts.slacks(FoPi(1.0, 0.5, 1.0))
    assert (values.shape, slopes.shape) == ((0,), (0, 3))


def test_what_is_known_already_is_not_learnt_twice() -> None:
    cuts = LoopCuts(ScenarioProblem.of(spec_of("sensitivity_db: {at_most: 3}")).loop)
    found = cuts.look(GAINS["PI"])
    assert found is not None
    cuts.learn(found)
    for _ in range(2):
        again = cuts.look(GAINS["PI"])
        assert again is not None
        cuts.learn(again)
    count = len(cuts.pool)
    cuts.pool = []
    cuts.learn(found)
    assert len(cuts.pool) == count


@pytest.mark.parametrize(("objective", "is_ki"), [("{maximize: ki}", True), ("{minimize: sensitivity_peak_db}", False)])
def test_an_objective_of_the_loop_is_an_aim(objective: str, is_ki: bool) -> None:
    text = TEXT.replace("{minimize: iae, scenario: one}", objective) + "  - overshoot: {at_most: 0.1}\n"
    problem = ScenarioProblem.of(parse_spec(text))
    cuts = LoopCuts(problem.loop)
    assert cuts.maximises_ki is is_ki
    found = cuts.look(GAINS["PI"])
    assert found is not None
    cuts.learn(found)
    assert cuts.is_aim(cuts.rows_of_pool).any() != is_ki
