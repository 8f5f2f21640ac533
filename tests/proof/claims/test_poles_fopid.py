"""Closed-loop poles with a derivative of any order, against polynomials of s^(1/q) and `core`'s Nyquist count."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
import pytest
from cases.plants import lag, pole, spec_of, transfer_function
from cases.random_fopids import orders
from cases.random_loops import random_plant
from flint import ctx
from oracles.fopid_loops import poles_by_sector

from fopi_tune.core.controller import FoPid
from fopi_tune.core.loops import Loops, Plants
from fopi_tune.core.plant import Plant, PlantFamily
from fopi_tune.core.stability import unstable_closed_loop_poles
from fopi_tune.proof import certify, recheck, verify
from fopi_tune.proof.balls.loop import BallLoop
from fopi_tune.proof.certificate import Verdict
from fopi_tune.proof.claims.branch_and_bound import search
from fopi_tune.proof.claims.poles import NoPoleAtTheEnds, count_unstable_poles, is_structurally_unstable
from fopi_tune.proof.documents import to_document
from fopi_tune.spec.model import Relation, Requirement

EVERYWHERE = (-math.inf, math.inf)


@pytest.fixture(autouse=True)
def precision() -> Iterator[None]:
    with ctx.workprec(64):
        yield


def count(found: FoPid, plant: Plant, origin: float = 0.0) -> int | None:
    return count_unstable_poles(BallLoop(found, family_of(plant)), (), origin)


def family_of(plant: Plant) -> PlantFamily:
    return transfer_function(plant.numerator, plant.denominator, plant.dead_time_s)


def random_gains(rng: np.random.Generator, q: int = 0) -> FoPid:
    """A term is missing at times, or has the other sign; with q orders are multiples of 1/q."""
    kp, ki, kd = (
        float(rng.choice([1.0, -1.0, 0.0], p=[0.75, 0.15, 0.1]) * 10.0 ** rng.uniform(-1.5, 1.0)) for _ in "pid"
    )
    alpha, mu = (int(rng.integers(1, 2 * q)) / q, int(rng.integers(1, q + 1)) / q) if q else orders(rng)
    return FoPid(kp, ki, alpha, kd or 0.3, mu, float(10.0 ** rng.uniform(-2.5, 0.5)))


def test_the_count_is_that_of_matignons_sector() -> None:
    rng = np.random.default_rng(711)
    seen: list[int] = []
    for _ in range(60):
        plant, q = random_plant(rng, int(rng.integers(1, 4))), int(rng.integers(2, 6))
        found = random_gains(rng, q)
        expected = poles_by_sector(found, plant, q)
        counted = count(found, plant, float(rng.uniform(-3.0, 3.0)))
        if expected is not None and counted is not None:
            assert counted == expected, (found, plant)
            seen.append(expected)
    # next to a pole at s = 0, or with 1 + C(inf) n/d about 0, balls do not tell
    assert len(seen) >= 50
    assert set(seen) >= {0, 1, 2}


def test_unstable_loops_are_refuted_and_never_proved() -> None:
    rng = np.random.default_rng(712)
    refuted = 0
    asked = Requirement("sensitivity_db", Relation.AT_MOST, (60.0,))
    while refuted < 8:
        plant, q = random_plant(rng, int(rng.integers(1, 4))), int(rng.integers(2, 5))
        found = random_gains(rng, q)
        expected = poles_by_sector(found, plant, q)
        if not expected:
            continue
        spec = spec_of(family_of(plant), asked)
        certificate = certify(spec, verify(spec, found), {})
        assert certificate.stability.verdict is Verdict.REFUTED, (found, plant)
        assert certificate.stability.poles == expected, (found, plant)
        if refuted % 5 == 0:
            assert recheck(to_document(certificate)).problems == ()
        refuted += 1


def test_the_count_with_dead_time_is_that_of_the_encirclements() -> None:
    rng = np.random.default_rng(713)
    seen: list[int] = []
    for _ in range(30):
        plant = random_plant(rng, int(rng.integers(1, 5)), float(10.0 ** rng.uniform(-2, 0.3)), rng.random() < 0.3)
        found = random_gains(rng)
        expected = float(unstable_closed_loop_poles(Loops.of(found, Plants.of(plant)))[0])
        counted = count(found, plant)
        if math.isfinite(expected):
            assert counted in (expected, None), (found, plant)
            seen += [] if counted is None else [counted]
        else:
            assert not counted, (found, plant)
    assert len(seen) > 20
    assert set(seen) >= {0, 1, 2}


@pytest.mark.parametrize(
    ("found", "family", "unstable"),
    [
        # the direct path around a dead time: with mu < 1 kp n/d alone, however large kd is
        (FoPid(1.2, 0.1, 0.7, 0.1, 0.5, 0.1), transfer_function([1.0, 2.0], [1.0, 1.0], 0.3), True),
        (FoPid(0.2, 0.1, 0.7, 5.0, 0.5, 0.1), transfer_function([1.0, 2.0], [1.0, 1.0], 0.3), False),
        (FoPid(0.1, 0.1, 0.7, 0.1, 1.0, 0.1), transfer_function([1.0, 2.0], [1.0, 1.0], 0.3), True),
        # a plant's zero at s = 0 behind the integral, its integrator behind s^mu
        (FoPid(0.1, 0.1, 0.7, 0.1, 0.5, 0.1), transfer_function([1.0, 0.0], [1.0, 1.0, 1.0]), True),
        (FoPid(0.0, 0.0, 0.7, 0.1, 0.5, 0.1), pole(1.0, 0.0), True),
        (FoPid(0.1, 0.0, 0.7, 0.1, 0.5, 0.1), pole(1.0, 0.0), False),
    ],
)
def test_what_is_unstable_without_counting(found: FoPid, family: PlantFamily, unstable: bool) -> None:
    assert is_structurally_unstable(BallLoop(found, family), ()) is unstable


@pytest.mark.thinned(2)
@pytest.mark.parametrize(
    ("found", "family", "shown"),
    [
        (FoPid(0.5, 0.4, 0.8, 0.2, 0.6, 0.1), lag((0.5, 1.5), (1.0, 2.0), 0.3), True),
        # ki N(0) passes 0, 1 + kp n/d passes 0
        (FoPid(0.5, 0.4, 0.8, 0.2, 0.6, 0.1), lag((-0.5, 1.5), 1.0), False),
        (FoPid(-1.0, 0.4, 0.8, 0.2, 0.6, 0.1), transfer_function([(0.5, 1.5), 1.0], [1.0, 4.0]), False),
        (FoPid(-1.0, 0.4, 0.8, 0.2, 0.6, 0.1), transfer_function([(0.5, 0.9), 1.0], [1.0, 4.0]), True),
    ],
)
def test_a_pole_that_passes_an_end_of_the_half_plane_is_never_overlooked(
    found: FoPid, family: PlantFamily, shown: bool
) -> None:
    loop = BallLoop(found, family)
    claim = NoPoleAtTheEnds(loop, (EVERYWHERE, *loop.family_box), 0.0)
    assert search(claim, 2_000).shown is shown
