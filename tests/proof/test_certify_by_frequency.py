"""Never a wrong proof of a limit by the frequency:  lines 1e-5 neper around the worst case, recheck, tampering."""

from __future__ import annotations

import copy
import json
import math
from dataclasses import replace
from itertools import product
from typing import Any

import numpy as np
import pytest
from cases.plants import lag, spec_of
from cases.random_pids import on_samples, pid_for, plants_of, sized, uncertain
from oracles import sampled_loops as oracle
from oracles.pid_loops import PidFamily

import fopi_tune as ft
from fopi_tune.core.controller import FoPi
from fopi_tune.core.parallel_form import Implementation
from fopi_tune.core.plant import PlantFamily
from fopi_tune.errors import CertificateError
from fopi_tune.proof import certify, recheck, verify
from fopi_tune.proof.certificate import Certificate, Verdict
from fopi_tune.proof.documents import to_document
from fopi_tune.quantities.base import NEPER_PER_DB
from fopi_tune.spec.model import Relation, Requirement

RESPONSES = (
    "sensitivity_db", "complementary_sensitivity_db", "control_sensitivity_db", "load_sensitivity_db", "loop_gain_db",
)  # fmt: skip
#: neper
OFFSET = 1e-5


def line(quantity: str, upper: bool, level: float, low: float, high: float, rise_db: float) -> Requirement:
    """A line whose limit at its lower end is `level` neper."""
    relation = Relation.AT_MOST if upper else Relation.AT_LEAST
    first = level / NEPER_PER_DB
    return Requirement(quantity, relation, (first,), from_rad_s=low, to_rad_s=high, end_limit=first + rise_db)


def certificate(
    plants: PlantFamily, gains: FoPi, asked: Requirement, implementation: Implementation | None = None
) -> Certificate:
    spec = spec_of(plants, asked)
    found = certify(spec, verify(spec, gains, implementation=implementation), {}, implementation)
    assert recheck(json.loads(json.dumps(to_document(found)))).problems == ()
    return found


def told_apart(
    plants: PlantFamily, gains: FoPi, asked: tuple[str, bool, float, float, float], worst: float,
    implementation: Implementation | None = None,
) -> bool:  # fmt: skip
    """Whether a line beyond the worst value is proved; one short of it never is."""
    quantity, upper, low, high, rise = asked
    step = OFFSET if upper else -OFFSET
    beyond, short = (
        certificate(plants, gains, line(quantity, upper, worst + s, low, high, rise), implementation)
        for s in (step, -step)
    )
    assert short.requirements[0].verdict is not Verdict.PROVED, (asked, worst)
    return (beyond.requirements[0].verdict, short.requirements[0].verdict) == (Verdict.PROVED, Verdict.REFUTED)


def drawn(rng: np.random.Generator, most_rad_s: float = math.inf) -> tuple[str, bool, float, float, float]:
    low = float(10.0 ** rng.uniform(-1.5, 0.0))
    high = min(low * float(10.0 ** rng.uniform(0.3, 1.3)), most_rad_s)
    return str(rng.choice(RESPONSES)), bool(rng.random() < 0.7), low, high, float(rng.uniform(-40.0, 40.0))


def worst_of(values: list[np.ndarray], omega: np.ndarray, asked: tuple[str, bool, float, float, float]) -> float:
    """The worst value along a line of responses on a grid."""
    _, upper, low, high, rise = asked
    lines = rise * NEPER_PER_DB * np.log(omega / low) / math.log(high / low)
    return max(float((v - lines).max()) for v in values) if upper else min(float((v - lines).min()) for v in values)


@pytest.mark.parametrize(("seeds", "least"), [(range(5), 3), pytest.param(range(5, 60), 35, marks=pytest.mark.long)])
def test_lines_around_the_worst_case_are_told_apart(seeds: range, least: int) -> None:
    count = 0
    for seed in seeds:
        rng = np.random.default_rng([seed, 61])
        plants = uncertain(rng, plants_of(rng))
        pid = pid_for(rng, plants)
        family, asked = PidFamily(plants, pid), drawn(rng)
        if not family.is_stable():
            continue
        omega = np.geomspace(asked[2], asked[3], 60_001)
        low, high = plants.low, plants.high
        shares = np.array(list(product(np.linspace(0.0, 1.0, 9), repeat=len(low))))
        points = low + shares * (high - low)
        values = [family.loop(point).log_response(asked[0], omega) for point in points]
        worst = worst_of(values, omega, asked)
        # the worst plant may lie between those of the grid: a refutation of the line beyond must then show it
        if abs(worst) < 12.0:
            count += told_apart(plants, pid, asked, worst)
    assert count >= least


@pytest.mark.parametrize(("seeds", "least"), [(range(3), 1), pytest.param(range(3, 25), 12, marks=pytest.mark.long)])
def test_lines_around_the_worst_case_on_samples_are_told_apart(seeds: range, least: int) -> None:
    count = 0
    for seed in seeds:
        rng = np.random.default_rng([seed, 62])
        plants, pid = (
            lag(1.0, 2.0, float(rng.choice([0.0, 0.3]))),
            ft.Pid(sized(rng, 0.3, 2.0), sized(rng, 0.1, 1.0), float(rng.choice([0.0, 0.2])), 0.1),
        )
        implementation = Implementation(on_samples(pid, 0.1 * sized(rng, 0.3, 2.0)), 0.0)
        asked = drawn(rng, 0.9 * implementation.nyquist_rad_s)
        loop = oracle.Loop.of(plants.member(np.zeros(0)), implementation)
        omega = np.geomspace(asked[2], asked[3], 40_001)
        worst = worst_of([loop.response(asked[0], omega)], omega, asked)
        count += told_apart(plants, pid, asked, worst, implementation)
    assert count >= least


PLANTS, GAINS = lag(1.0, (1.6, 3.1), 0.3), FoPi(1.0, 0.5, 0.9)
SHAPED = Requirement("sensitivity_db", Relation.AT_MOST, (-22.0,), from_rad_s=0.02, to_rad_s=0.5, end_limit=4.0)


def tampered(change: Any) -> tuple[str, ...]:
    document = copy.deepcopy(to_document(certificate(PLANTS, GAINS, SHAPED)))
    change(document["requirements"][0])
    return recheck(json.loads(json.dumps(document)), spec_of(PLANTS, SHAPED)).problems


def test_a_certificate_of_a_line_is_sound_and_tells_both_ends_of_it() -> None:
    found = certificate(PLANTS, GAINS, SHAPED)
    assert found.requirements[0].verdict is Verdict.PROVED
    (entry,) = to_document(found)["requirements"]
    assert (entry["limits"], entry["limit_at_to_rad_s"]) == ([-22.0], 4.0)


@pytest.mark.parametrize(
    "change",
    [
        lambda entry: entry.update(limit_at_to_rad_s=3.0),
        lambda entry: entry.pop("limit_at_to_rad_s"),
        lambda entry: entry.update(limit_at_to_rad_s=-30.0),
        lambda entry: entry.update(to_rad_s=5.0),
    ],
)
def test_a_certificate_of_another_line_is_refused(change: Any) -> None:
    assert tampered(change) != ()


@pytest.mark.parametrize(
    "change",
    [
        lambda entry: entry.update(limit_at_to_rad_s="x"),
        lambda entry: entry.update(from_rad_s=0.0),
        lambda entry: entry.update(to_rad_s=None),
        lambda entry: entry.update(name="phase_margin_deg"),
    ],
)
def test_an_entry_that_is_no_line_is_no_certificate(change: Any) -> None:
    with pytest.raises(CertificateError):
        tampered(change)


def test_a_plant_that_the_verification_missed_refutes_a_line_by_its_value_there() -> None:
    spec = spec_of(PLANTS, SHAPED)
    found = verify(spec, GAINS)
    (result,) = found.requirements
    assert result.achieved is not None
    # a limit 0.2 dB short of the worst value, and a verification that sees 0.3 dB less than there is
    limit, seen = result.achieved - 0.2, result.achieved - 0.3
    asked = SHAPED.moved((limit,))
    extremes = tuple(replace(each, achieved=seen) for each in result.extremes)
    blind = replace(result, requirement=asked, achieved=seen, extremes=extremes)
    proof = certify(spec_of(PLANTS, asked), replace(found, requirements=(blind,)), {}).requirements[0]
    assert proof.verdict is Verdict.REFUTED
    (side,) = proof.sides
    assert side.witness is not None
    assert side.worst.omega_rad_s is not None
    # told as at the lower end, as the limit is: the response where it was found, less the line there
    s, tau = 1j * side.worst.omega_rad_s, side.worst.point[0]
    loop = (GAINS.kp + GAINS.ki * s**-GAINS.alpha) * np.exp(-0.3 * s) / (tau * s + 1.0)
    there = asked.value_at(side.witness / NEPER_PER_DB, side.worst.omega_rad_s)
    assert there == pytest.approx(-20.0 * math.log10(abs(1.0 + loop)), abs=1e-6)
    assert limit < side.witness / NEPER_PER_DB <= result.achieved + 1e-9
