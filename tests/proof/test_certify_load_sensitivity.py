"""Never a wrong proof of |P S|:  limits 1e-5 neper around the worst case, closed forms at the ends of the axis."""

from __future__ import annotations

import json
import math
from dataclasses import replace

import numpy as np
import pytest
from cases.limits_told_apart import outcomes
from cases.plants import lag, pole, spec_of, transfer_function
from cases.random_pids import mirrored, on_samples, pid_for, plants_of, sized, uncertain
from cases.sampled_limits_told_apart import outcomes as sampled_outcomes
from flint import ctx
from oracles.pid_loops import PidFamily

import fopi_tune as ft
from fopi_tune.core.controller import Pid
from fopi_tune.core.parallel_form import Implementation
from fopi_tune.core.peaks import Response, extremes
from fopi_tune.core.plant import PlantFamily
from fopi_tune.core.terms.measurement_filter import MeasurementFilter
from fopi_tune.proof import certify, recheck, verify
from fopi_tune.proof.balls.sampled import SampledBallLoop
from fopi_tune.proof.certificate import Certificate, Verdict
from fopi_tune.proof.claims.bound import Bound
from fopi_tune.proof.claims.branch_and_bound import search
from fopi_tune.proof.documents import to_document
from fopi_tune.quantities.base import NEPER_PER_DB
from fopi_tune.spec.model import Relation, Requirement

#: of the random numbers
SALT = 51
ASKED = (("load_sensitivity_db", True), ("load_sensitivity_db", True), ("load_sensitivity_db", False))


def _family(rng: np.random.Generator) -> PidFamily:
    plants = uncertain(rng, plants_of(rng))
    pid = pid_for(rng, plants)
    plants, pid = mirrored(plants, pid) if rng.random() < 0.15 else (plants, pid)
    if rng.random() < 0.4:
        time_s = pid.derivative_filter_time_constant_s * sized(rng, 0.3, 3.0)
        pid = replace(pid, measurement_filter=MeasurementFilter(int(rng.integers(1, 3)), time_s))
    return PidFamily(plants, pid)


def _loop(rng: np.random.Generator) -> tuple[PlantFamily, Pid, Implementation]:
    plants = uncertain(rng, plants_of(rng), least=1)
    pid = pid_for(rng, plants)
    sample_time_s = pid.derivative_filter_time_constant_s * sized(rng, 0.1, 5.0)
    delay = float(rng.choice([0.0, 0.0, 1.0, rng.uniform(0.0, 2.0)]))
    return plants, pid, Implementation(on_samples(pid, sample_time_s), delay)


@pytest.mark.parametrize(("seeds", "least"), [(range(4), 2), pytest.param(range(4, 60), 37, marks=pytest.mark.long)])
def test_limits_around_the_worst_case_are_told_apart(seeds: range, least: int) -> None:
    counted, undecided, _ = outcomes(seeds, _family, SALT, ASKED)
    assert undecided == []
    assert counted["told apart"] >= least, counted


def _lag_on_samples(rng: np.random.Generator) -> tuple[PlantFamily, Pid, Implementation]:
    """A closed form where the delay is whole."""
    tau = sized(rng, 0.3, 3.0)
    plants = lag(sized(rng, 0.5, 2.0), (0.7 * tau, 1.4 * tau))
    pid = Pid(sized(rng, 0.3, 3.0), sized(rng, 0.1, 2.0), 0.0, 0.1)
    sample_time_s = 0.1 * sized(rng, 0.2, 3.0)
    return plants, pid, Implementation(on_samples(pid, sample_time_s), float(rng.choice([0.0, 1.0])))


def test_limits_around_the_worst_case_of_a_lag_on_samples_are_told_apart() -> None:
    counted, undecided = sampled_outcomes(range(4), _lag_on_samples, SALT, ASKED)
    assert undecided == []
    assert counted["told apart"] >= 3, counted


@pytest.mark.parametrize(("seeds", "least"), [(range(3), 1), pytest.param(range(3, 30), 14, marks=pytest.mark.long)])
def test_limits_around_the_worst_case_on_samples_are_told_apart(seeds: range, least: int) -> None:
    counted, undecided = sampled_outcomes(seeds, _loop, SALT, ASKED)
    assert undecided == []
    assert counted["told apart"] >= least, counted


def certificate(plants: PlantFamily, gains: ft.FoPi, *requirements: Requirement) -> Certificate:
    spec = spec_of(plants, *requirements)
    found = certify(spec, verify(spec, gains), {})
    assert recheck(json.loads(json.dumps(to_document(found)))).problems == ()
    return found


def verdicts(plants: PlantFamily, gains: ft.FoPi, worst: float, upper: bool = True) -> tuple[Verdict, ...]:
    """Of limits 1e-4 dB beyond a worst value and short of it, at all frequencies."""
    relation, sign = (Relation.AT_MOST, 1.0) if upper else (Relation.AT_LEAST, -1.0)
    limits = [20.0 * math.log10(worst) + sign * step for step in (1e-4, -1e-4)]
    asked = [Requirement("load_sensitivity_db", relation, (limit,)) for limit in limits]
    return tuple(certificate(plants, gains, each).requirements[0].verdict for each in asked)


LEAD = transfer_function([1.0, 3.0], [1.0, 1.0])
#: plants, gains, the worst value, and whether it is the largest one
CLOSED_FORMS = {
    # 1/(s + kp), largest as omega -> 0, where P has no end
    "an integrator": (pole(1.0, 0.0), ft.FoPi(2.0, 0.0, 1.0), 0.5, True),
    "an integrator with a filter": (
        pole(1.0, 0.0), ft.FoPi(2.0, 0.0, 1.0, measurement_filter=MeasurementFilter(2, 0.01)), 0.5, True,
    ),
    # k/(s + p + k kp), largest for the largest gain as omega -> 0
    "a pole": (pole((1.0, 3.0), 1.0), ft.FoPi(2.0, 0.0, 1.0), 3.0 / 7.0, True),
    "a lag": (lag((1.0, 3.0), (1.0, 4.0)), ft.FoPi(2.0, 0.0, 1.0), 3.0 / 7.0, True),
    # the integral cancels the pole:  k tau s/((tau s + 1)(tau s + k kp))
    "a lag that is cancelled": (lag(2.0, 3.0), ft.FoPi(1.4, 1.4 / 3.0, 1.0), 2.0 / 3.8, True),
    # (s + 3)/((1 + kp) s + 1 + 3 kp), least as omega -> inf
    "a lead": (LEAD, ft.FoPi(0.5, 0.0, 1.0), 3.0 / 2.5, True),
    "a lead at its least": (LEAD, ft.FoPi(0.5, 0.0, 1.0), 1.0 / 1.5, False),
}  # fmt: skip


@pytest.mark.thinned(2)
@pytest.mark.parametrize("name", CLOSED_FORMS)
def test_limits_around_a_closed_form_are_told_apart(name: str) -> None:
    plants, gains, worst, upper = CLOSED_FORMS[name]
    assert verdicts(plants, gains, worst, upper) == (Verdict.PROVED, Verdict.REFUTED)


def test_a_direct_path_behind_a_dead_time_is_bounded_by_the_circle_on_which_the_loop_turns() -> None:
    # |P|/(1 - |L|) = 1/(1 - 0.9) as omega -> inf, where L comes to -0.9 once a turn
    plants, gains = transfer_function([1.0, 2.0], [1.0, 3.0], 1e-3), ft.FoPi(0.9, 0.0, 1.0)
    asked = [Requirement("load_sensitivity_db", Relation.AT_MOST, (20.0 + step,)) for step in (0.1, -0.1)]
    found = certificate(plants, gains, *asked).requirements
    assert [proof.verdict for proof in found] == [Verdict.PROVED, Verdict.REFUTED]


def test_behind_an_integral_the_response_to_a_slow_load_has_no_lower_limit() -> None:
    asked = Requirement("load_sensitivity_db", Relation.AT_LEAST, (-80.0,), to_rad_s=1.0)
    found = certificate(lag(1.0, 2.0), ft.FoPi(1.0, 0.5, 1.0), asked).requirements[0]
    assert found.verdict is Verdict.REFUTED


def test_a_band_holds_what_lies_in_it_alone() -> None:
    # 1/(s + 2): below 0.1 rad/s -6.02 dB, from 10 rad/s on 1/sqrt(104)
    value = -10.0 * math.log10(104.0)
    asked = [
        Requirement("load_sensitivity_db", Relation.AT_MOST, (value + step,), from_rad_s=10.0) for step in (1e-4, -1e-4)
    ]
    found = certificate(pole(1.0, 0.0), ft.FoPi(2.0, 0.0, 1.0), *asked).requirements
    assert [proof.verdict for proof in found] == [Verdict.PROVED, Verdict.REFUTED]
    (side,) = found[1].sides
    assert side.witness is not None
    # the limit is 1e-4 dB away
    assert abs(side.witness / NEPER_PER_DB - value) < 2e-4


@pytest.mark.parametrize("order", [1, 2])
def test_towards_nyquists_frequency_the_plants_gain_counts(order: int) -> None:
    bottom = (1.0, 1.0) if order == 1 else (1.0, 2.0, 1.0)
    plants = transfer_function([100.0], bottom)
    pid = Pid(0.01, 0.001, 0.0, 0.1)
    loop = SampledBallLoop(pid, plants, Implementation(on_samples(pid, 0.5), 0.3))
    # |P S| falls towards Nyquist's frequency, where it is this
    found = extremes(loop.loops_at(np.zeros((1, 0))), Response.LOAD_SENSITIVITY, 5.0, math.inf, largest=False)
    at = float(found.value[0])
    assert found.omega_rad_s[0] == pytest.approx(np.pi / 0.5)
    with ctx.workprec(64):
        for upper, sign in ((True, 1.0), (False, -1.0)):
            beyond, short = (
                Bound(loop, Response.LOAD_SENSITIVITY, at + sign * step, upper, ((8.0, math.inf),), 0.0)
                for step in (1e-3, -1e-3)
            )
            assert beyond.examine(beyond.domain).leaf is not None or search(beyond, 200).shown
            assert short.examine(short.domain).leaf is None
