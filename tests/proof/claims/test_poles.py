"""Closed-loop poles in balls, against polynomial roots, roots in w = s^alpha, and `core`'s Nyquist count."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
import pytest
from cases.plants import brake, lag, lag_gain_and_delay, pole, transfer_function
from flint import ctx

from fopi_tune.core.controller import FoPi
from fopi_tune.core.loops import Loops, Plants
from fopi_tune.core.plant import PlantFamily
from fopi_tune.core.stability import unstable_closed_loop_poles
from fopi_tune.proof.balls.loop import BallLoop
from fopi_tune.proof.claims.branch_and_bound import check_record, search
from fopi_tune.proof.claims.claim import Claim
from fopi_tune.proof.claims.poles import NoPoleAtTheEnds, count_unstable_poles

#: rad; poles closer to the axis than this are nobody's certain knowledge in double precision
NEAR_AXIS = 1e-5
EVERYWHERE = (-math.inf, math.inf)


@pytest.fixture(autouse=True)
def precision() -> Iterator[None]:
    with ctx.workprec(64):
        yield


def shown(claim: Claim, budget: int = 500) -> bool:
    found = search(claim, budget)
    assert not found.shown or check_record(claim, found.record) is None
    return found.shown


def count(gains: FoPi, family: PlantFamily, theta: tuple[float, ...] = (), origin: float = 0.0) -> int | None:
    return count_unstable_poles(BallLoop(gains, family), theta, origin)


def random_roots(rng: np.random.Generator, number: int, at_origin: float) -> list[complex]:
    """Real, complex (damping down to 0.01) and zero roots over two decades, a quarter of them on the right."""
    roots: list[complex] = []
    while len(roots) < number:
        side, size = (1.0 if rng.random() < 0.25 else -1.0), 10.0 ** rng.uniform(-1, 1)
        if number - len(roots) >= 2 and rng.random() < 0.5:
            zeta = 10.0 ** rng.uniform(-2, 0)
            root = size * (side * zeta + 1j * math.sqrt(1.0 - zeta**2))
            roots += [root, root.conjugate()]
        else:
            roots.append(0.0 if rng.random() < at_origin else side * size)
    return roots


def random_case(rng: np.random.Generator, strictly_proper: bool) -> tuple[FoPi, list[float], list[float]]:
    order = int(rng.integers(1, 6))
    zeros = random_roots(rng, int(rng.integers(0, order + (not strictly_proper))), 0.0)
    numerator, denominator = np.atleast_1d(np.real(np.poly(zeros))), np.real(np.poly(random_roots(rng, order, 0.2)))
    scale = 10.0 ** rng.uniform(-1.5, 1.5) * rng.choice([-1.0, 1.0])
    kp, ki = (float(rng.choice([0.0, 1.0, -1.0], p=[0.1, 0.7, 0.2]) * 10.0 ** rng.uniform(-1, 1)) for _ in range(2))
    gains = FoPi(kp if kp or ki else 1.0, ki, float(rng.uniform(0.05, 1.95)))
    return gains, (scale * numerator).tolist(), denominator.tolist()


def by_roots(gains: FoPi, numerator: list[float], denominator: list[float], q: int) -> int | None:
    """Roots of the polynomial in w = s^(1/q) with |arg w| < 90/q deg, for alpha = 1/q; None when one is too close."""

    def spread(coefficients: list[float]) -> np.ndarray:
        wide = np.zeros((len(coefficients) - 1) * q + 1)
        wide[::q] = coefficients
        return wide

    n, d = spread(numerator), spread(denominator)
    integral = gains.ki != 0.0
    top = np.polymul(n, [gains.kp, gains.ki] if integral else [gains.kp])
    f = np.polyadd(np.append(d, 0.0) if integral else d, top)
    angles = np.abs(np.angle(np.roots(f)))
    return None if np.any(np.abs(angles - 0.5 * np.pi / q) < NEAR_AXIS) else int(np.sum(angles < 0.5 * np.pi / q))


# --- the count -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("q", [1, 2])
def test_the_count_is_that_of_the_polynomials_roots(q: int) -> None:
    rng = np.random.default_rng(600 + q)
    seen: list[int] = []
    for _ in range(120):
        drawn, numerator, denominator = random_case(rng, strictly_proper=False)
        gains = FoPi(drawn.kp, drawn.ki, 1.0 / q)
        expected = by_roots(gains, numerator, denominator, q)
        found = count(gains, transfer_function(numerator, denominator), origin=float(rng.uniform(-3.0, 3.0)))
        if expected is not None:
            assert found == expected, (gains, numerator, denominator)
            seen.append(expected)
    assert len(seen) > 110
    assert set(seen) >= {0, 1, 2, 3}


def test_the_count_with_dead_time_is_that_of_the_encirclements() -> None:
    rng = np.random.default_rng(603)
    seen: list[int] = []
    for _ in range(120):
        gains, numerator, denominator = random_case(rng, strictly_proper=True)
        family = transfer_function(numerator, denominator, float(10.0 ** rng.uniform(-2, 0.5)))
        expected = float(unstable_closed_loop_poles(Loops.of(gains, Plants.members(family, np.zeros((1, 0)))))[0])
        found = count(gains, family)
        if math.isfinite(expected):
            assert found == expected, (gains, family)
            seen.append(round(expected))
    assert len(seen) > 100
    assert set(seen) >= {0, 1, 2, 3, 4}


def test_an_integrator_with_dead_time_gains_pairs_of_poles_one_by_one() -> None:
    # s + k e^-s: a pair crosses at k = pi/2 + 2 pi i
    for k, expected in ((0.1, 0), (1.57, 0), (1.58, 2), (7.85, 2), (7.86, 4), (20.0, 6)):
        assert count(FoPi(k, 0.0, 1.0), pole(1.0, 0.0, 1.0)) == expected


def test_the_count_is_made_at_the_place_that_was_asked_for() -> None:
    # s + p + 2: unstable for p < -2
    family = pole(1.0, (-4.0, 1.0))
    assert [count(FoPi(2.0, 0.0, 1.0), family, (p,)) for p in (-3.0, -2.5, -1.9, 1.0)] == [1, 1, 0, 0]


@pytest.mark.parametrize(
    ("gains", "family"),
    [
        # through -1 at a frequency: k/(s + 1)^3 with k = 8, and an undamped closed loop
        (FoPi(8.0, 0.0, 1.0), transfer_function([1.0], [1.0, 3.0, 3.0, 1.0])),
        (FoPi(3.0, 0.0, 1.0), transfer_function([1.0], [1.0, 0.0, 1.0])),
        # L(0) = -1, and L(inf) = -1
        (FoPi(-1.0, 0.0, 1.0), lag(1.0, 2.0)),
        (FoPi(-1.0, 0.0, 1.0), transfer_function([1.0, 3.0], [1.0, 1.0])),
        # the plant's zero at 0 cancels the integral
        (FoPi(1.0, 1.0, 0.5), transfer_function([1.0, 0.0], [1.0, 2.0, 1.0])),
        # poles without end: the direct path around a dead time is 1 or more
        (FoPi(1.0, 0.0, 1.0), transfer_function([1.0, 3.0], [1.0, 1.0], 0.5)),
        (FoPi(-2.0, 0.3, 1.0), transfer_function([1.0, 3.0], [1.0, 1.0], 0.5)),
        # a common root of numerator and denominator on the axis
        (FoPi(1.0, 0.0, 1.0), transfer_function([1.0, 0.0, 1.0], [1.0, 1.0, 1.0, 1.0])),
    ],
)
def test_a_pole_on_the_boundary_leaves_the_count_open(gains: FoPi, family: PlantFamily) -> None:
    assert count(gains, family) is None


@pytest.mark.parametrize("distance", [1e-4, 1e-6])
def test_a_loop_close_to_minus_1_is_still_counted(distance: float) -> None:
    plant = transfer_function([1.0], [1.0, 3.0, 3.0, 1.0])
    assert count(FoPi(8.0 * (1.0 - distance), 0.0, 1.0), plant) == 0
    assert count(FoPi(8.0 * (1.0 + distance), 0.0, 1.0), plant) == 2


# --- the ends of the half-plane ------------------------------------------------------------------------------------


def ends(gains: FoPi, family: PlantFamily) -> NoPoleAtTheEnds:
    loop = BallLoop(gains, family)
    return NoPoleAtTheEnds(loop, (EVERYWHERE, *loop.family_box), 0.0)


@pytest.mark.parametrize(
    ("gains", "family"),
    [
        (FoPi(0.4, 0.4, 0.8), brake()),
        (FoPi(0.4, 0.4, 0.8), lag_gain_and_delay()),
        (FoPi(2.0, 0.0, 1.0), pole(1.0, (-1.0, 1.0))),
        (FoPi(-0.4, 0.4, 1.9), lag(1.0, (1.0, 2.0), (0.0, 0.5))),
        (FoPi(0.4, 0.1, 0.5), transfer_function([(0.5, 0.9), 1.0], [1.0, 1.0], (0.0, 0.5))),
        (FoPi(-0.4, 0.1, 0.5), transfer_function([(0.5, 2.4), 1.0], [1.0, 1.0])),
    ],
)
def test_no_pole_comes_from_the_ends_of_the_half_plane(gains: FoPi, family: PlantFamily) -> None:
    assert shown(ends(gains, family))


@pytest.mark.thinned(3)
@pytest.mark.parametrize(
    ("gains", "family"),
    [
        # a pole passes through 0: D(0) + kp N(0) = p - 1, and ki N(0)
        (FoPi(-1.0, 0.0, 1.0), pole(1.0, (0.5, 1.5))),
        (FoPi(1.0, 0.5, 0.7), transfer_function([1.0, (-0.1, 0.2)], [1.0, 2.0, 1.0])),
        # one passes through infinity: 1 + kp b1/a1
        (FoPi(-1.0, 0.0, 1.0), transfer_function([(0.5, 1.5), 1.0], [1.0, 4.0])),
        # infinitely many come with a direct path of 1 around a dead time
        (FoPi(1.0, 0.0, 1.0), transfer_function([(0.5, 1.5), 1.0], [1.0, 4.0], 0.1)),
        (FoPi(-1.0, 0.0, 1.0), transfer_function([(0.5, 1.5), 1.0], [1.0, 4.0], (0.0, 0.1))),
    ],
)
def test_a_pole_that_passes_an_end_of_the_half_plane_is_never_overlooked(gains: FoPi, family: PlantFamily) -> None:
    assert not shown(ends(gains, family), 200)
