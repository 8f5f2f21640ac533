"""Closed-loop poles of PID loops in balls, against the roots of their polynomials and `core`'s Nyquist count."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
import pytest
from cases.plants import lag, pole, spec_of, transfer_function
from cases.random_loops import random_plant
from flint import ctx

from fopi_tune.core.controller import Pid
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

#: relative; a root closer to the axis than this is nobody's certain knowledge in double precision
NEAR_AXIS = 1e-6
EVERYWHERE = (-math.inf, math.inf)


@pytest.fixture(autouse=True)
def precision() -> Iterator[None]:
    with ctx.workprec(64):
        yield


def count(pid: Pid, family: PlantFamily, origin: float = 0.0) -> int | None:
    return count_unstable_poles(BallLoop(pid, family), (), origin)


def family_of(plant: Plant) -> PlantFamily:
    return transfer_function(plant.numerator, plant.denominator, plant.dead_time_s)


def random_pid(rng: np.random.Generator) -> Pid:
    """A term is missing at times, or has the other sign."""
    kp, ki, kd = (
        float(rng.choice([1.0, -1.0, 0.0], p=[0.75, 0.15, 0.1]) * 10.0 ** rng.uniform(-1.5, 1.0)) for _ in "pid"
    )
    return Pid(kp, ki, kd or 0.3, float(10.0 ** rng.uniform(-2.5, 0.5)))


def by_roots(pid: Pid, plant: Plant) -> int | None:
    """Roots of s (Tf s + 1) D + M N on the right; None when one is too close to the axis."""
    filter_s = pid.derivative_filter_time_constant_s
    top, bottom = [pid.kp * filter_s + pid.kd, pid.kp + pid.ki * filter_s, pid.ki], [filter_s, 1.0, 0.0]
    if pid.ki == 0.0:
        top, bottom = top[:-1], bottom[:-1]
    roots = np.roots(np.polyadd(np.polymul(bottom, plant.denominator), np.polymul(top, plant.numerator)))
    close = np.abs(roots.real) < NEAR_AXIS * np.maximum(np.abs(roots), 1e-3)
    return None if np.any(close) else int(np.sum(roots.real > 0.0))


def test_the_count_is_that_of_the_polynomials_roots() -> None:
    rng = np.random.default_rng(701)
    seen: list[int] = []
    for _ in range(110):
        plant, pid = random_plant(rng, int(rng.integers(1, 5))), random_pid(rng)
        expected = by_roots(pid, plant)
        found = count(pid, family_of(plant), float(rng.uniform(-3.0, 3.0)))
        if expected is not None:
            assert found == expected, (pid, plant)
            seen.append(expected)
    assert len(seen) >= 100
    assert set(seen) >= {0, 1, 2, 3}


def test_unstable_loops_are_refuted_and_never_proved() -> None:
    rng = np.random.default_rng(702)
    refuted = 0
    asked = Requirement("sensitivity_db", Relation.AT_MOST, (60.0,))
    while refuted < 25:
        plant, pid = random_plant(rng, int(rng.integers(1, 4))), random_pid(rng)
        expected = by_roots(pid, plant)
        if not expected:
            continue
        spec = spec_of(family_of(plant), asked)
        certificate = certify(spec, verify(spec, pid), {})
        assert certificate.stability.verdict is Verdict.REFUTED, (pid, plant)
        assert certificate.stability.poles == expected, (pid, plant)
        if refuted % 5 == 0:
            assert recheck(to_document(certificate)).problems == ()
        refuted += 1


def test_the_count_with_dead_time_is_that_of_the_encirclements() -> None:
    rng = np.random.default_rng(703)
    seen: list[int] = []
    for _ in range(70):
        plant = random_plant(rng, int(rng.integers(1, 5)), float(10.0 ** rng.uniform(-2, 0.3)), rng.random() < 0.3)
        pid = random_pid(rng)
        expected = float(unstable_closed_loop_poles(Loops.of(pid, Plants.of(plant)))[0])
        found = count(pid, family_of(plant))
        if math.isfinite(expected):
            assert found == expected, (pid, plant)
            seen.append(round(expected))
        else:
            assert not found, (pid, plant)
    assert len(seen) > 50
    assert set(seen) >= {0, 1, 2, 3}


@pytest.mark.parametrize(
    ("pid", "family", "unstable"),
    [
        # the direct path around a dead time: (kp + kd/Tf) n/d = 1.1, -1.1, and kp alone 2 but 0.5 with the derivative
        (Pid(0.1, 0.1, 0.1, 0.1), transfer_function([1.0, 2.0], [1.0, 1.0], 0.3), True),
        (Pid(0.1, 0.1, -0.12, 0.1), transfer_function([1.0, 2.0], [1.0, 1.0], 0.3), True),
        (Pid(2.0, 0.1, -0.15, 0.1), transfer_function([1.0, 2.0], [1.0, 1.0], 0.3), False),
        (Pid(0.1, 0.1, 0.08, 0.1), transfer_function([1.0, 2.0], [1.0, 1.0], 0.3), False),
        # a zero of the plant at 0 cancels the integral; without one the derivative may share it
        (Pid(0.1, 0.1, 0.1, 0.1), transfer_function([1.0, 0.0], [1.0, 2.0, 1.0]), True),
        (Pid(0.1, 0.0, 0.1, 0.1), transfer_function([1.0, 0.0], [1.0, 2.0, 1.0]), False),
        # an integrator behind nothing but a derivative
        (Pid(0.0, 0.0, 0.1, 0.1), pole(1.0, 0.0), True),
        (Pid(0.0, 0.0, 0.1, 0.1), pole(1.0, 0.1), False),
        (Pid(0.1, 0.0, 0.1, 0.1), pole(1.0, 0.0), False),
    ],
)
def test_loops_that_are_unstable_by_their_structure(pid: Pid, family: PlantFamily, unstable: bool) -> None:
    assert is_structurally_unstable(BallLoop(pid, family), ()) is unstable
    if unstable:
        assert not count(pid, family)
        assert not verify(spec_of(family), pid).stability.stable


@pytest.mark.parametrize("distance", [1e-4, 1e-6])
def test_a_loop_close_to_minus_1_is_still_counted(distance: float) -> None:
    # (s + 1)^3 with kp = 8 and a derivative that moves the crossing: at omega the phases of C P sum up to -180 deg
    pid = Pid(4.0, 0.0, 2.0, 0.05)
    omega = np.geomspace(1.0, 50.0, 400_001)
    s = np.asarray(1j * omega, dtype=complex)
    gain = pid(s) / (s + 1.0) ** 3
    k = int(np.flatnonzero((gain.imag[1:] >= 0.0) & (gain.imag[:-1] < 0.0))[0])
    share = gain.imag[k] / (gain.imag[k] - gain.imag[k + 1])
    scale = 1.0 / abs(gain.real[k] + share * (gain.real[k + 1] - gain.real[k]))
    plant = [1.0, 3.0, 3.0, 1.0]
    for factor, poles in ((1.0 - distance, 0), (1.0 + distance, 2)):
        assert count(pid, transfer_function([float(scale * factor)], plant)) == poles


def shown(pid: Pid, family: PlantFamily) -> bool:
    loop = BallLoop(pid, family)
    return search(NoPoleAtTheEnds(loop, (EVERYWHERE, *loop.family_box), 0.0), 300).shown


@pytest.mark.parametrize(
    ("pid", "family"),
    [
        (Pid(0.4, 0.4, 0.3, 0.1), lag((0.8, 1.2), (1.0, 2.0), (0.1, 0.5))),
        (Pid(2.0, 0.0, 5.0, 0.1), pole(1.0, (-1.0, 1.0))),
        (Pid(0.1, 0.1, 0.05, 0.1), transfer_function([(0.5, 1.5), 1.0], [1.0, 4.0], (0.0, 0.1))),
        (Pid(2.0, 0.1, -0.15, 0.1), transfer_function([(0.5, 1.5), 1.0], [1.0, 4.0], 0.1)),
    ],
)
def test_no_pole_comes_from_the_ends_of_the_half_plane(pid: Pid, family: PlantFamily) -> None:
    assert shown(pid, family)


@pytest.mark.thinned(slow=["pid3"])
@pytest.mark.parametrize(
    ("pid", "family"),
    [
        # through 0: D(0) + kp N(0), ki N(0), and D(0) behind a derivative alone
        (Pid(-1.0, 0.0, 0.2, 0.1), pole(1.0, (0.5, 1.5))),
        (Pid(1.0, 0.5, 0.2, 0.1), transfer_function([1.0, (-0.1, 0.2)], [1.0, 2.0, 1.0])),
        (Pid(0.0, 0.0, 0.2, 0.1), pole(1.0, (-0.5, 0.5))),
        # through infinity: 1 + (kp + kd/Tf) b1/a1, which kp alone would not show
        (Pid(-0.1, 0.0, -0.09, 0.1), transfer_function([(0.5, 1.5), 1.0], [1.0, 4.0])),
        # infinitely many with a direct path of 1 around a dead time
        (Pid(0.1, 0.0, 0.09, 0.1), transfer_function([(0.5, 1.5), 1.0], [1.0, 4.0], 0.1)),
    ],
)
def test_a_pole_that_passes_an_end_of_the_half_plane_is_never_overlooked(pid: Pid, family: PlantFamily) -> None:
    assert not shown(pid, family)
