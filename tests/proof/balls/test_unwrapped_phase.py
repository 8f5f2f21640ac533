"""The unwrapped phase in balls against `core`'s, a phase followed along the axis, closed forms, and roots."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

import numpy as np
import pytest
from cases.plants import lag, pole, transfer_function
from flint import arb, ctx

from fopi_tune.core.controller import FoPi
from fopi_tune.core.loops import Loops, Plants
from fopi_tune.core.plant import PlantFamily
from fopi_tune.proof.balls.loop import BallLoop
from fopi_tune.proof.balls.unwrapped_phase import PolynomialPhase, plant_phases, unwrapped_phase
from fopi_tune.proof.claims.crossing_quantities import CrossingEvaluator, CrossingQuantity

#: rad; the phases of doubles carry rounding of a few hundred radians of factors and dead time
PHASE = 1e-9


@pytest.fixture(autouse=True)
def precision() -> Iterator[None]:
    with ctx.workprec(64):
        yield


def polynomial(*coefficients: float) -> PolynomialPhase:
    return PolynomialPhase.of([arb(c) for c in coefficients])


def phase_of(loop: BallLoop, u: float, theta: tuple[float, ...] = ()) -> arb:
    at = loop.over(((u, u), *((value, value) for value in theta)))
    return unwrapped_phase(loop, at, plant_phases(loop, theta))


def core_phase(loop: BallLoop, u: Sequence[float], theta: tuple[float, ...] = ()) -> np.ndarray:
    loops = Loops.of(loop.gains, Plants.members(loop.family, np.array([theta], dtype=float).reshape(1, len(theta))))
    return loops.log_response(np.zeros(len(u), dtype=np.intp), np.array(u)).imag


def random_roots(
    rng: np.random.Generator, number: int, right_half_plane_roots: float, roots_at_origin: float
) -> list[complex]:
    """Real, complex (damping down to 0.01) and zero roots over two decades."""
    roots: list[complex] = []
    while len(roots) < number:
        side, size = (1.0 if rng.random() < right_half_plane_roots else -1.0), 10.0 ** rng.uniform(-1, 1)
        if number - len(roots) >= 2 and rng.random() < 0.5:
            zeta = 10.0 ** rng.uniform(-2, 0)
            root = size * (side * zeta + 1j * math.sqrt(1.0 - zeta**2))
            roots += [root, root.conjugate()]
        else:
            roots.append(0.0 if rng.random() < roots_at_origin else side * size)
    return roots


def random_gains(rng: np.random.Generator) -> FoPi:
    kp, ki = (float(rng.choice([0.0, 1.0, -1.0], p=[0.1, 0.7, 0.2]) * 10.0 ** rng.uniform(-1, 1)) for _ in range(2))
    return FoPi(kp if kp or ki else -1.0, ki, float(rng.uniform(0.05, 1.95)))


def random_family(rng: np.random.Generator) -> PlantFamily:
    order = int(rng.integers(1, 6))
    poles = random_roots(rng, order, 0.25, 0.2)
    zeros = random_roots(rng, int(rng.integers(0, order + 1)), 0.3, 0.1)
    numerator, denominator = (np.atleast_1d(np.real(np.poly(roots))) for roots in (zeros, poles))
    numerator, denominator = (
        c * float(rng.choice([-1.0, 1.0]) * 10.0 ** rng.uniform(-1, 1)) for c in (numerator, denominator)
    )
    delay = 0.0 if rng.random() < 0.5 else float(10.0 ** rng.uniform(-2, 0.5))
    return transfer_function(numerator.tolist(), denominator.tolist(), delay)


# --- the phase -----------------------------------------------------------------------------------------------------


def test_the_phase_is_that_of_the_factors_sheet_included() -> None:
    rng = np.random.default_rng(201)
    turned = 0
    for _ in range(150):
        loop = BallLoop(random_gains(rng), random_family(rng))
        places = rng.uniform(-7.0, 6.0, 4).tolist()
        for u, expected in zip(places, core_phase(loop, places), strict=True):
            found = phase_of(loop, u)
            assert float(found.rad()) < 1e-9, (loop, u)
            # A dead time turns by e^6 * 3 rad at most, which a double knows to 1e-13.
            assert float(found.mid()) == pytest.approx(expected, abs=PHASE), (loop, u)
            turned += abs(expected) > math.pi
    assert turned > 100


def test_the_phase_is_continuous_along_the_axis_from_its_low_frequency_limit() -> None:
    rng = np.random.default_rng(202)
    for _ in range(12):
        loop = BallLoop(random_gains(rng), random_family(rng))
        numerator, denominator = (
            [p.nominal for n, p in loop.family.parameters.items() if n.startswith(word)]
            for word in ("numerator", "denominator")
        )
        delay = loop.family.parameters["dead_time_s"].nominal
        u = np.linspace(-16.0, 3.0, 20_001)
        s = 1j * np.exp(u)
        c = loop.gains.kp + loop.gains.ki * s**-loop.gains.alpha
        expected = np.unwrap(np.angle(c * np.polyval(numerator, s) / np.polyval(denominator, s) * np.exp(-s * delay)))
        found = [float(phase_of(loop, float(u[k])).mid()) for k in range(0, 20_001, 1000)]
        np.testing.assert_allclose(np.array(found) - found[0], expected[::1000] - expected[0], atol=PHASE)


@pytest.mark.parametrize("order", [3, 4, 5, 8])
def test_a_multiple_pole_turns_the_phase_by_its_arc_tangents(order: int) -> None:
    loop = BallLoop(FoPi(2.0, 0.0, 1.0), transfer_function([1.0], np.poly([-1.0] * order).tolist()))
    for u in np.linspace(-6.0, 6.0, 25).tolist():
        expected = -order * math.atan(math.exp(u))
        assert float(phase_of(loop, u).mid()) == pytest.approx(expected, abs=1e-12)


@pytest.mark.parametrize(
    ("numerator", "denominator", "at_low", "at_high"),
    [
        ([1.0], [1.0, 1.0], 0, -90),
        ([1.0], [1.0, -1.0], -180, -90),
        ([1.0], [1.0, -2.0, 2.0], -360, -180),
        ([1.0], [1.0, 0.0, -1.0], -180, -180),
        ([1.0], [1.0, 0.0], -90, -90),
        ([1.0], [1.0, 0.0, 0.0], -180, -180),
        ([1.0, 1.0], [1.0, 0.0, 0.0], -180, -90),
        ([-1.0, 1.0], [1.0, 1.0], 0, -180),
        ([-1.0], [1.0, 1.0], -180, -270),
        ([1.0, 0.0], [1.0, 1.0], 90, 0),
        ([1.0], [1.0, 3.0, 3.0, 1.0], 0, -270),
        ([1.0], np.poly([1.0, 2.0, 3.0]).tolist(), -540, -270),
        ([1.0], np.poly([0.0, 0.1 + 1j, 0.1 - 1j, -1.0]).tolist(), -450, -360),
    ],
)  # fmt: skip
def test_the_phase_has_its_textbook_limits(
    numerator: list[float], denominator: list[float], at_low: float, at_high: float
) -> None:
    loop = BallLoop(FoPi(1.0, 0.0, 1.0), transfer_function(numerator, denominator))
    # At e^-25 and e^25 roots near 1 have turned the phase by 1e-10.
    for u, expected in ((-25.0, at_low), (25.0, at_high)):
        assert math.degrees(float(phase_of(loop, u).mid())) == pytest.approx(expected, abs=1e-7)


@pytest.mark.parametrize(
    "gains", [FoPi(-2.0, -0.1, 0.8), FoPi(-2.0, 0.0, 0.8), FoPi(0.0, -0.3, 1.5), FoPi(3.0, -0.2, 0.6)]
)
@pytest.mark.parametrize(
    ("negative", "positive"),
    [(pole(-1.0, 0.5), pole(1.0, 0.5)), (pole(-1.0, -0.5, 0.1), pole(1.0, -0.5, 0.1)), (lag(-2.0, 3.0), lag(2.0, 3.0))],
)
def test_two_negative_signs_are_none(gains: FoPi, negative: PlantFamily, positive: PlantFamily) -> None:
    opposite = FoPi(-gains.kp, -gains.ki, gains.alpha)
    for u in (-3.0, 0.0, 2.0):
        both, none = phase_of(BallLoop(gains, negative), u), phase_of(BallLoop(opposite, positive), u)
        assert abs(both - none).abs_upper() < 1e-15


def test_the_controllers_phase_runs_from_its_integral_to_its_proportional_part() -> None:
    rng = np.random.default_rng(203)
    for _ in range(40):
        gains = random_gains(rng)
        loop = BallLoop(gains, lag())
        u = np.linspace(-12.0 / gains.alpha, 8.0, 4001)
        s = 1j * np.exp(u)
        expected = np.unwrap(np.angle(gains.kp + gains.ki * s**-gains.alpha))
        lead = gains.ki or gains.kp
        start = -(0.5 * math.pi * gains.alpha if gains.ki else 0.0) - (math.pi if lead < 0.0 else 0.0)
        assert loop.controller_is_negative is (lead < 0.0)
        sign = -math.pi if lead < 0.0 else 0.0
        # at so low a frequency kp is still there with up to e^-12 * 100
        offset = 2.0 * math.pi * round((start - expected[0]) / (2.0 * math.pi))
        for k in range(0, 4001, 400):
            assert sign + float(loop.controller_phase(arb(float(u[k]))).mid()) == pytest.approx(
                expected[k] + offset, abs=PHASE
            )


def test_an_uncertain_plant_is_read_at_its_own_place() -> None:
    family = transfer_function([1.0, (0.5, 2.0)], [1.0, (-1.0, 1.0), 2.0, (0.5, 1.0)], (0.0, 0.3))
    loop = BallLoop(FoPi(0.7, 0.4, 0.9), family)
    evaluator = CrossingEvaluator(loop)
    rng = np.random.default_rng(204)
    for _ in range(40):
        theta = tuple(rng.uniform(family.low, family.high).tolist())
        u = float(rng.uniform(-2.0, 2.0))
        at = loop.over(((u, u), *((value, value) for value in theta)))
        expected = float(core_phase(loop, [u], theta)[0])
        assert float(evaluator.phase(at, theta).mid()) == pytest.approx(expected, abs=PHASE)
        margin, delay = (
            evaluator.value(quantity, at, theta)
            for quantity in (CrossingQuantity.PHASE_MARGIN, CrossingQuantity.DELAY_MARGIN)
        )
        assert float(margin.mid()) == pytest.approx(math.pi + expected, abs=PHASE)
        assert float(delay.mid()) == pytest.approx((math.pi + expected) / math.exp(u), abs=PHASE / math.exp(u))


# --- roots ---------------------------------------------------------------------------------------------------------


def test_roots_on_the_right_are_counted() -> None:
    rng = np.random.default_rng(205)
    seen = set()
    for _ in range(200):
        roots = random_roots(rng, int(rng.integers(0, 7)), 0.4, 0.0)
        coefficients = np.atleast_1d(np.real(np.poly(roots))) * float(rng.choice([-3.0, 0.2]))
        # counted from the rounded coefficients; a damping of 0.01 is far beyond what rounding moves
        expected = int(np.sum(np.roots(coefficients).real > 0))
        assert polynomial(*coefficients.tolist()).right_half_plane_roots == expected, roots
        seen.add((len(roots), expected))
    assert len(seen) > 20


def test_roots_at_the_origin_are_taken_out_and_leading_zeros_are_none() -> None:
    x = polynomial(0.0, 0.0, 2.0, 3.0, 0.0)
    assert (x.roots_at_origin, x.right_half_plane_roots, len(x.coefficients)) == (1, 0, 2)
    assert polynomial(1.0, -1.0, 0.0, 0.0).roots_at_origin == 2


@pytest.mark.parametrize(
    "coefficients",
    [(1, 1, 1, 1), (1, -1, 4, -4), (1, 0, 2, 0, 1), (1, 0.5, 2, 0.5, 1), (1, 0, 5, 0, 4)],
)
@pytest.mark.parametrize("below", [True, False])
def test_a_root_on_the_imaginary_axis_leaves_the_sheet_open(coefficients: tuple[float, ...], below: bool) -> None:
    assert polynomial(*coefficients).right_half_plane_roots is None
    top, bottom = ([1.0], list(coefficients)) if below else (list(coefficients), np.poly([-1.0] * 4).tolist())
    loop = BallLoop(FoPi(1.0, 0.5, 0.7), transfer_function(top, bottom))
    for u in (-2.0, 3.0):
        assert not phase_of(loop, u).is_finite()


@pytest.mark.parametrize(("numerator", "denominator"), [([1.0], [2.0, 0.0, 3.0]), ([-2.0, 0.0, -3.0], [1.0, 3.0, 2.0])])
def test_an_undamped_pair_alone_counts_as_damped_like_everywhere(
    numerator: list[float], denominator: list[float]
) -> None:
    assert polynomial(2.0, 0.0, 3.0).right_half_plane_roots == 0
    loop = BallLoop(FoPi(0.7, 0.5, 0.8), transfer_function(numerator, denominator, 0.1))
    places = [-3.0, 0.1, 0.3, 2.0]  # the pair is at u = ln sqrt 1.5 = 0.203
    found = [float(phase_of(loop, u).mid()) for u in places]
    np.testing.assert_allclose(found, core_phase(loop, places), atol=PHASE)


def test_a_coefficient_that_may_be_zero_leaves_the_count_open() -> None:
    assert PolynomialPhase.of([arb(1), arb(3), arb(0, 1e-3)]).right_half_plane_roots is None
    assert PolynomialPhase.of([arb(0, 1e-3), arb(3), arb(1)]).right_half_plane_roots is None


@pytest.mark.parametrize("damping", [1e-3, 1e-5, -1e-3, -1e-5])
def test_a_root_close_to_the_axis_is_told_from_one_on_it(damping: float) -> None:
    coefficients = np.polymul([1.0, 2.0 * damping, 1.0], [1.0, 3.0, 2.0])
    assert polynomial(*coefficients.tolist()).right_half_plane_roots == (0 if damping > 0 else 2)
