"""No box that holds gains which meet a spec and beat a level may be discarded, for any reason there is."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import replace

import numpy as np
import pytest
from cases.optimum_cases import FAMILIES, OBJECTIVES, just_met
from flint import arb, ctx

from fopi_tune.core.controller import FoPi, Pid, numbers_of
from fopi_tune.core.terms.digital_spec import DigitalSpec
from fopi_tune.core.terms.measurement_filter import MeasurementFilter
from fopi_tune.digital.discretize import sections_of
from fopi_tune.optimum.crossover_gains import CrossoverParametrization
from fopi_tune.optimum.parametrization import GainParametrization
from fopi_tune.optimum.problem import Problem
from fopi_tune.optimum.pruning.combinations import linear_bound_of
from fopi_tune.optimum.pruning.conditions import Test as Kind
from fopi_tune.optimum.pruning.crossover_suggestions import suggestions
from fopi_tune.optimum.pruning.exclusion import Reason, is_excluded
from fopi_tune.optimum.pruning.response_bounds import LinearBound
from fopi_tune.optimum.pruning.sample_points import constant_reasons, first_reasons, further_reasons, plants_to_try
from fopi_tune.optimum.pruning.screen import Boxes, gains_at
from fopi_tune.optimum.samples.gains import SampledCrossoverParametrization
from fopi_tune.proof.balls.box import Box
from fopi_tune.proof.balls.loop import PRECISION
from fopi_tune.spec.model import DesignSpec

#: relative sizes of the boxes around the gains, from most of the range to nearly a point
_SIZES = (0.5, 0.1, 0.02, 3e-3, 1e-4, 1e-6)


def _gains(name: str, pick: np.random.Generator) -> FoPi:
    kp, ki, alpha = pick.uniform(0.2, 3.0), pick.uniform(0.05, 1.5), pick.uniform(0.4, 1.4)
    if name == "unstable":
        kp += 0.5
    ki = 0.0 if pick.random() < 0.15 else ki
    return FoPi(-kp, -ki, alpha) if name == "negative gain" else FoPi(kp, ki, alpha)


def _pid(name: str, pick: np.random.Generator) -> Pid:
    """With a derivative of either sign, or none."""
    found, filter_s = _gains(name, pick), 10.0 ** pick.uniform(-2.0, 0.0)
    kd = pick.choice([0.0, 0.05, 0.3, 0.3, -0.05]) * pick.uniform(0.5, 1.5)
    return Pid(found.kp, found.ki, float(math.copysign(1.0, found.kp) * kd), filter_s)


def _place(problem: Problem, gains: FoPi) -> tuple[float, ...]:
    """The coordinates of gains."""
    parametrization = problem.parametrization
    if isinstance(gains, Pid):
        return gains.kp, gains.ki, gains.kd
    if isinstance(parametrization, GainParametrization):
        return gains.kp, gains.ki * parametrization.omega_rad_s**-gains.alpha, gains.alpha
    assert isinstance(parametrization, CrossoverParametrization)
    s = parametrization.omega_rad_s**-gains.alpha * np.exp(-0.5j * np.pi * gains.alpha)
    if isinstance(parametrization, SampledCrossoverParametrization):
        digital = parametrization.filter.digital
        s = sections_of(FoPi(0.0, 1.0, gains.alpha), digital).response(np.array([parametrization.omega_rad_s]))[0]
    first = problem.roots[0][1][0]
    psi = np.angle((gains.kp + gains.ki * s) * complex(parametrization.plant)) + np.pi
    return gains.alpha, float(first + (psi - first) % (2.0 * np.pi))


def _box_around(place: tuple[float, ...], size: float, pick: np.random.Generator) -> Box:
    """A box that holds a place somewhere, in the middle, at an edge or a corner."""
    low = np.array(place) - size * pick.choice([0.0, 0.5, 1.0, pick.random()], size=len(place))
    return tuple((min(a, x - 1e-9), max(a + size, x + 1e-9)) for a, x in zip(low.tolist(), place, strict=True))


def _reasons(problem: Problem, box: Box) -> list[Reason]:
    """Everything that the search might try."""
    points = plants_to_try(problem, [])
    ends = np.array(box)
    boxes = Boxes(ends[None, :, 0], ends[None, :, 1])
    found = [suggestion.reason for suggestion in suggestions(problem, boxes, points)]
    found += constant_reasons(problem, points) + further_reasons(problem, boxes.middle, points)
    numbered = list(enumerate(problem.conditions.every))
    found += [Reason(k) for k, condition in numbered if condition.test in (Kind.GAIN, Kind.LOWER_CROSSOVER)]
    found += [Reason(k, p) for k, c in numbered if c.test in (Kind.CROSSOVER, Kind.STABILITY) for p in points]
    return list(dict.fromkeys([*found, *first_reasons(problem, points, [])]))


def _at(bound: LinearBound, box: Box, place: tuple[float, ...]) -> arb:
    """What a violation is at least at some gains of the box, of which a sum of bounds is made."""
    value = bound.middle
    for slope, (low, high), x in zip(bound.slopes, box, place, strict=True):
        if low < high:
            value += slope * (2 * arb(x) - low - high) / (arb(high) - low)
    return value


def _wrongly_discarded(spec: DesignSpec, beat: float, gains: FoPi, pick: np.random.Generator) -> list[str]:
    wrong = []
    with ctx.workprec(PRECISION):
        problem = Problem.of(spec, beat, float(pick.choice([0.03, 1.0, 40.0])))
        place = _place(problem, gains)
        found = gains_at(problem.parametrization, np.array([place]))
        back = numbers_of(found.controller(gains.measurement_filter))
        assert back == {name: pytest.approx(value, rel=1e-7, abs=1e-9) for name, value in numbers_of(gains).items()}
        # where psi is the margin itself, the second root holds the gains, and the first need not
        on_line = problem.margin_is_fixed and abs(math.remainder(place[1] - problem.roots[1][1][0], math.tau)) < 1e-6
        for size in _SIZES:
            box = _box_around(place, size, pick)
            if not isinstance(problem.parametrization, CrossoverParametrization) and gains.ki == 0.0:
                box = box[0], (0.0, 0.0), box[2]  # what is shown of other boxes need not hold of ki = 0
            controllers = problem.parametrization.controllers(box)
            for reason in _reasons(problem, box):
                condition = problem.conditions.every[reason.condition]
                if condition.test is Kind.LOWER_CROSSOVER and on_line:
                    continue
                if is_excluded(problem, controllers, reason):
                    wrong.append(f"{condition.test} {condition.words} {reason} {box}")
                bound = linear_bound_of(problem, controllers, reason)
                if bound is not None and _at(bound, box, place) > 0:
                    wrong.append(f"linear bound of {condition.test} {condition.words} {reason} {box}")
    return wrong


@pytest.mark.thinned(slow=["three", "second order"])
@pytest.mark.parametrize(("name", "equalities"), [(name, k % 3) for k, name in enumerate(FAMILIES)])
def test_no_box_around_gains_that_just_meet_a_spec_is_discarded(name: str, equalities: int) -> None:
    pick = np.random.default_rng([equalities, *name.encode()])
    boxes_examined = 0
    for _ in range(12):
        made = just_met(FAMILIES[name], gains := _gains(name, pick), OBJECTIVES[pick.integers(7)], equalities, pick)
        if made is None:
            continue
        assert _wrongly_discarded(*made, gains, pick) == []
        boxes_examined += 1
        if boxes_examined == 1:
            break
    assert boxes_examined


def _digital(pick: np.random.Generator) -> DigitalSpec:
    return DigitalSpec(
        float(pick.choice([0.02, 0.1, 0.3])), str(pick.choice(["oustaloup", "modified_oustaloup"])),
        int(pick.integers(2, 8)), (1e-3, 1e2), delay_samples=float(pick.choice([0.0, 0.4, 1.0])), design="sampled",
    )  # fmt: skip


def _check_on_samples(name: str, seed: int, wanted: int) -> None:
    pick, boxes_examined = np.random.default_rng([23, seed, *name.encode()]), 0
    for k in range(40):
        gains = _gains(name, pick)
        if k % 4 == 3:
            used = MeasurementFilter(int(pick.integers(1, 3)), 10.0 ** pick.uniform(-0.8, -0.3))
            gains = replace(gains, measurement_filter=used)
        made = just_met(FAMILIES[name], gains, OBJECTIVES[pick.integers(7)], k % 3, pick, _digital(pick))
        if made is not None:
            assert _wrongly_discarded(*made, gains, pick) == []
            boxes_examined += 1
        if boxes_examined == wanted:
            break
    assert boxes_examined


@pytest.mark.thinned(slow=["three", "second order"])
@pytest.mark.parametrize("name", FAMILIES)
def test_nor_is_one_on_samples(name: str) -> None:
    _check_on_samples(name, 0, 1)


@pytest.mark.long
@pytest.mark.parametrize("seed", range(1, 6))
@pytest.mark.parametrize("name", FAMILIES)
def test_no_box_around_many_gains_is_discarded_on_samples(name: str, seed: int) -> None:
    _check_on_samples(name, seed, 3)


@pytest.mark.thinned(slow=["three", "second order"])
@pytest.mark.parametrize("name", FAMILIES)
def test_nor_is_one_around_gains_with_a_derivative(name: str) -> None:
    # gains meet an equality but for rounding, which boxes of the gains themselves tell
    pick, boxes_examined = np.random.default_rng([7, *name.encode()]), 0
    for _ in range(20):
        made = just_met(FAMILIES[name], gains := _pid(name, pick), OBJECTIVES[pick.integers(7)], 0, pick)
        if made is not None:
            assert _wrongly_discarded(*made, gains, pick) == []
            boxes_examined += 1
            break
    assert boxes_examined


@pytest.mark.thinned(2)
@pytest.mark.parametrize("seeds", [(3,), pytest.param(range(12), marks=pytest.mark.long)], ids=["one", "many"])
@pytest.mark.parametrize("name", ["lag with dead time", "unstable", "direct path", "resonant"])
def test_nor_is_one_around_gains_with_a_measurement_filter(name: str, seeds: Iterable[int]) -> None:
    for seed in seeds:
        pick, boxes_examined = np.random.default_rng([17, seed, *name.encode()]), 0
        for k in range(30):
            used = MeasurementFilter(int(pick.integers(1, 3)), 10.0 ** pick.uniform(-2.0, -0.3))
            gains = replace(_pid(name, pick) if k % 2 else _gains(name, pick), measurement_filter=used)
            made = just_met(FAMILIES[name], gains, OBJECTIVES[pick.integers(7)], 0 if k % 2 else k // 2 % 3, pick)
            if made is not None:
                assert _wrongly_discarded(*made, gains, pick) == []
                boxes_examined += 1
                break
        assert boxes_examined


@pytest.mark.long
@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("name", FAMILIES)
def test_no_box_around_many_gains_with_a_derivative_is_discarded(name: str, seed: int) -> None:
    pick, boxes_examined = np.random.default_rng([11, seed, *name.encode()]), 0
    for _ in range(30):
        made = just_met(FAMILIES[name], gains := _pid(name, pick), OBJECTIVES[pick.integers(7)], 0, pick)
        if made is not None:
            assert _wrongly_discarded(*made, gains, pick) == []
            boxes_examined += 1
        if boxes_examined == 3:
            break
    assert boxes_examined


@pytest.mark.long
@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("name", FAMILIES)
def test_no_box_around_many_gains_is_discarded(name: str, seed: int) -> None:
    pick = np.random.default_rng([seed, *name.encode()])
    boxes_examined = 0
    for k in range(30):
        made = just_met(FAMILIES[name], gains := _gains(name, pick), OBJECTIVES[pick.integers(7)], k % 3, pick)
        if made is None:
            continue
        assert _wrongly_discarded(*made, gains, pick) == []
        boxes_examined += 1
        if boxes_examined == 3:
            break
    assert boxes_examined
