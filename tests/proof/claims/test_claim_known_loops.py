"""Loops whose answers are closed forms or published, several crossovers, and members without any."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator

import numpy as np
import pytest
from cases.plants import Number, brake, lag, pole, transfer_function
from flint import ctx

from fopi_tune.core.controller import FoPi
from fopi_tune.core.peaks import Response
from fopi_tune.core.plant import PlantFamily
from fopi_tune.proof.balls.box import Box, Interval
from fopi_tune.proof.balls.loop import BallLoop
from fopi_tune.proof.claims.bound import Bound
from fopi_tune.proof.claims.branch_and_bound import check_record, search
from fopi_tune.proof.claims.claim import Claim
from fopi_tune.proof.claims.crossing_quantities import CrossingEvaluator, CrossingQuantity
from fopi_tune.proof.claims.crossings import EveryCrossover, EveryPhaseCrossover
from fopi_tune.proof.claims.existence import SomeCrossover, SomePhaseCrossover

EVERYWHERE: Interval = (-math.inf, math.inf)
P = FoPi(1.0, 0.0, 1.0)
#: a gap that no difference of two doubles' roundings comes near
HAIR = 1e-9


@pytest.fixture(autouse=True)
def precision() -> Iterator[None]:
    with ctx.workprec(64):
        yield


class Case:
    """One loop, and its claims."""

    def __init__(self, gains: FoPi, family: PlantFamily) -> None:
        self.loop = BallLoop(gains, family)
        self.evaluator = CrossingEvaluator(self.loop)
        self.domain: Box = (EVERYWHERE, *self.loop.family_box)

    def every(self, quantity: CrossingQuantity, upper: bool) -> Callable[[float], Claim]:
        return lambda level: EveryCrossover(self.loop, quantity, level, upper, self.domain, 0.1, self.evaluator)

    def some(self, quantity: CrossingQuantity, upper: bool) -> Callable[[float | None], Claim]:
        return lambda level: SomeCrossover(self.loop, quantity, level, upper, self.domain, 0.1, self.evaluator)

    def bound(self, response: Response, upper: bool, band: Interval = EVERYWHERE) -> Callable[[float], Claim]:
        return lambda level: Bound(self.loop, response, level, upper, (band, *self.domain[1:]), 0.1)

    def gain_margin(self, upper: bool) -> Callable[[float], Claim]:
        kind = SomePhaseCrossover if upper else EveryPhaseCrossover
        return lambda level: kind(self.loop, level, self.domain, 0.1)


def shown(claim: Claim, budget: int = 3000) -> bool:
    found = search(claim, budget)
    assert not found.shown or check_record(claim, found.record) is None
    return found.shown


def assert_sharp(claim: Callable[[float], Claim], worst: float, upper: bool, gap: float = HAIR) -> None:
    out = gap if upper else -gap
    assert shown(claim(worst + out))
    assert not shown(claim(worst - out), 500)


# --- closed forms --------------------------------------------------------------------------------------------------


def test_an_uncertain_integrator_with_dead_time_has_its_textbook_margins() -> None:
    # L = k e^{-Ls}/s: crossover k, PM = pi/2 - kL, delay margin pi/2k - L, slope -kL, GM = pi/(2kL)
    case = Case(P, pole((0.5, 0.8), 0.0, (0.8, 1.0)))
    least, most = 0.5 * 0.8, 0.8 * 1.0
    for quantity, low, high in (
        (CrossingQuantity.PHASE_MARGIN, 0.5 * math.pi - most, 0.5 * math.pi - least),
        (CrossingQuantity.DELAY_MARGIN, 0.5 * math.pi / 0.8 - 1.0, 0.5 * math.pi / 0.5 - 0.8),
        (CrossingQuantity.PHASE_SLOPE, -most, -least),
    ):
        assert_sharp(case.every(quantity, upper=False), low, upper=False)
        assert_sharp(case.every(quantity, upper=True), high, upper=True)
    assert_sharp(case.gain_margin(upper=False), math.log(0.5 * math.pi / most), upper=False)
    for some, worst, upper in (
        (case.some(CrossingQuantity.CROSSOVER, upper=False), math.log(0.5), False),
        (case.some(CrossingQuantity.CROSSOVER, upper=True), math.log(0.8), True),
        (case.gain_margin(upper=True), math.log(0.5 * math.pi / least), True),
    ):
        assert_sharp(some, worst, upper, gap=1e-6)


def test_three_lags_have_their_textbook_gain_margin_and_crossover() -> None:
    # k/(s + 1)^3: GM = 8/k, crossover sqrt(k^(2/3) - 1), PM = pi - 3 atan(crossover)
    case = Case(P, transfer_function([(3.0, 4.0)], [1.0, 3.0, 3.0, 1.0]))
    assert_sharp(case.gain_margin(upper=False), math.log(2.0), upper=False)
    assert_sharp(case.gain_margin(upper=True), math.log(8.0 / 3.0), upper=True)
    margins = [math.pi - 3.0 * math.atan(math.sqrt(k ** (2.0 / 3.0) - 1.0)) for k in (4.0, 3.0)]
    assert_sharp(case.every(CrossingQuantity.PHASE_MARGIN, upper=False), margins[0], upper=False)
    assert_sharp(case.every(CrossingQuantity.PHASE_MARGIN, upper=True), margins[1], upper=True)


def test_an_unstable_pole_has_its_textbook_phase_margin() -> None:
    # 2/(s - p): crossover sqrt(4 - p^2), PM = atan(crossover/p)
    case = Case(FoPi(2.0, 0.0, 1.0), pole(1.0, (-0.5, -0.3)))
    low, high = (math.atan(math.sqrt(4.0 - p * p) / p) for p in (0.5, 0.3))
    assert_sharp(case.every(CrossingQuantity.PHASE_MARGIN, upper=False), low, upper=False)
    assert_sharp(case.every(CrossingQuantity.PHASE_MARGIN, upper=True), high, upper=True)


def test_a_pole_may_pass_the_origin_and_the_phase_margin_with_it() -> None:
    case = Case(FoPi(2.0, 0.0, 1.0), pole(1.0, (-0.5, 0.5)))
    low = math.atan(math.sqrt(3.75) / 0.5)
    assert_sharp(case.every(CrossingQuantity.PHASE_MARGIN, upper=False), low, upper=False)
    assert_sharp(case.every(CrossingQuantity.PHASE_MARGIN, upper=True), math.pi - low, upper=True)


@pytest.mark.parametrize("alpha", [0.1, 0.9, 1.1, 1.9])
def test_a_fractional_integral_alone_has_its_closed_form(alpha: float) -> None:
    # |ki (jw)^-alpha k/(jw)| = 1: w = (ki k)^(1/(1 + alpha)), 90 - 90 alpha deg from -1, slope 0
    case = Case(FoPi(0.0, 3.0, alpha), pole((0.5, 2.0), 0.0))
    margin = abs(0.5 * math.pi * (1.0 - alpha))
    for upper in (True, False):
        assert_sharp(case.every(CrossingQuantity.PHASE_MARGIN, upper), margin, upper)
        assert_sharp(case.every(CrossingQuantity.PHASE_SLOPE, upper), 0.0, upper)
        end = math.log(3.0 * (2.0 if upper else 0.5)) / (1.0 + alpha)
        assert_sharp(case.some(CrossingQuantity.CROSSOVER, upper), end, upper, gap=1e-6)


def test_a_resonance_has_its_textbook_peaks() -> None:
    # 1/(s^2 + 2 z s + 1): |L| <= 1/(2 z sqrt(1 - z^2)); with kp the closed loop's peak of T alike
    case = Case(FoPi(3.0, 0.0, 1.0), transfer_function([1.0], [1.0, (0.4, 1.0), 1.0]))
    assert_sharp(case.bound(Response.LOOP_GAIN, upper=True), math.log(3.0 / (0.4 * math.sqrt(1.0 - 0.04))), upper=True)
    # T = 3/(s^2 + 2 z s + 4): natural frequency 2, damping z/2
    peak = 0.75 / (2.0 * 0.1 * math.sqrt(1.0 - 0.01))
    assert_sharp(case.bound(Response.COMPLEMENTARY_SENSITIVITY, upper=True), math.log(peak), upper=True)


def test_limits_at_zero_and_infinity_belong_to_the_claim() -> None:
    # L = k/s: |S| tends to 1 from below as omega -> inf, |T| as omega -> 0; |L| has no least value but 0
    case = Case(P, pole((0.5, 2.0), 0.0))
    for response in (Response.SENSITIVITY, Response.COMPLEMENTARY_SENSITIVITY):
        assert_sharp(case.bound(response, upper=True), 0.0, upper=True)
    assert not shown(case.bound(Response.LOOP_GAIN, upper=False)(-100.0), 300)
    assert not shown(case.bound(Response.LOOP_GAIN, upper=True)(100.0), 300)


def test_a_direct_path_around_a_dead_time_is_bounded_by_its_circle() -> None:
    # L = k e^{-Ls} touches |S| = 1/(1 - k) infinitely often, and 1/(1 + k)
    case = Case(P, transfer_function([(0.1, 0.2)], [1.0], 0.7))
    # the tail's enclosures are of a square around the circle: they reach 1.48 and 0.56
    assert shown(case.bound(Response.SENSITIVITY, upper=True)(math.log(1.5)))
    assert shown(case.bound(Response.SENSITIVITY, upper=False)(math.log(0.55)))
    assert not shown(case.bound(Response.SENSITIVITY, upper=True)(-math.log(1.0 - 0.2) - HAIR))
    assert not shown(case.bound(Response.SENSITIVITY, upper=False)(-math.log(1.0 + 0.2) + HAIR))


def test_a_direct_path_around_a_dead_time_has_the_gain_margin_of_its_circle() -> None:
    # |L| = |(k s + 0.1)/(s + 3)| rises towards k, where the dead time turns L through -180 deg without end
    case = Case(P, transfer_function([(0.4, 0.6), 0.1], [1.0, 3.0], (0.2, 0.3)))
    assert_sharp(case.gain_margin(upper=False), -math.log(0.6), upper=False, gap=1e-6)
    assert_sharp(case.gain_margin(upper=True), -math.log(0.4), upper=True)
    # without a dead time L(inf) is positive, and there is no crossing
    maybe_late = Case(P, transfer_function([(0.4, 0.6), 0.1], [1.0, 3.0], (0.0, 0.3)))
    assert not shown(maybe_late.gain_margin(upper=True)(50.0), 30)
    assert check_record(maybe_late.gain_margin(upper=True)(50.0), ("e+",)) == "leaf 0 does not hold on its box"
    # a circle outside of the unit circle, and one that passes it, hold no gain margin
    for low, high in ((1.1, 1.2), (0.9, 1.1)):
        outside = Case(P, transfer_function([(low, high), 0.1], [1.0, 3.0], 0.3))
        record = ("e+",)
        assert check_record(outside.gain_margin(upper=True)(50.0), record) == "leaf 0 does not hold on its box"


def test_the_published_brake_design_keeps_its_margins_over_all_time_constants() -> None:
    # PAPER.md: 106.5, 100.0 and 95.6 deg at 1.6, 2.35 and 3.1 s, to the digits printed
    case = Case(FoPi(0.3976732, 0.6527344, 0.55), lag(1.0, (1.6, 3.1)))
    assert_sharp(
        case.every(CrossingQuantity.PHASE_MARGIN, upper=False), math.radians(95.6), upper=False, gap=math.radians(0.06)
    )
    assert_sharp(
        case.every(CrossingQuantity.PHASE_MARGIN, upper=True), math.radians(106.5), upper=True, gap=math.radians(0.06)
    )
    assert_sharp(case.some(CrossingQuantity.CROSSOVER, upper=False), math.log(0.3444), upper=False, gap=2e-4)
    assert_sharp(case.some(CrossingQuantity.CROSSOVER, upper=True), math.log(0.4855), upper=True, gap=2e-4)
    # no dead time: no phase crossover, whatever the margin
    assert shown(case.gain_margin(upper=False)(50.0))
    assert not shown(case.gain_margin(upper=True)(50.0), 200)


# --- several crossovers, and none ----------------------------------------------------------------------------------


def resonant(gain: Number, damping: float = 0.06) -> PlantFamily:
    """k/((s + 0.1)(s^2 + damping s + 9)): past its crossover near k/9 it comes back around 3 rad/s."""
    return transfer_function([gain], np.polymul([1.0, 0.1], [1.0, damping, 9.0]).tolist())


def over_the_family(case: Case, places: int = 801) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Row, u, phase margin and phase slope of every crossover of so many `resonant` members; the ends are among them.

    |k/X| = 1 with X = (s + 0.1)(s^2 + d s + 9): |X|^2 = k^2 is a cubic in omega^2.
    """
    (low, high), damping = case.loop.family_box[0], case.loop.family.parameters["denominator[1]"].nominal - 0.1
    rows, omegas = [], []
    for row, k in enumerate(np.linspace(low, high, places)):
        square = np.polymul([1.0, 0.01], [1.0, damping**2 - 18.0, 81.0])
        roots = np.roots(np.polysub(square, [k * k]))
        omegas += sorted(math.sqrt(root.real) for root in roots if abs(root.imag) < 1e-9 and root.real > 0.0)
        rows += [row] * (len(omegas) - len(rows))
    row, s = np.array(rows), 1j * np.array(omegas)
    resonance = s * s + damping * s + 9.0
    # b = arg(-L);  d ln L/du = -s/(s + 0.1) - s (2 s + d)/(s^2 + d s + 9)
    angle = np.angle(-1.0 / ((s + 0.1) * resonance))
    slope = -(s / (s + 0.1) + s * (2.0 * s + damping) / resonance).imag
    return row, np.log(omegas), np.abs(angle), slope


def test_every_one_of_three_crossovers_counts_for_a_phase_margin() -> None:
    case = Case(P, resonant((7.0, 7.6)))
    row, _, margin, _ = over_the_family(case)
    assert np.all(np.bincount(row) == 3)
    # between 801 members the margins vary linearly to 1e-6
    assert_sharp(case.every(CrossingQuantity.PHASE_MARGIN, upper=False), float(margin.min()), upper=False, gap=1e-5)
    assert_sharp(case.every(CrossingQuantity.PHASE_MARGIN, upper=True), float(margin.max()), upper=True, gap=1e-5)
    of_each = margin.reshape(-1, 3)
    assert_sharp(
        case.some(CrossingQuantity.PHASE_MARGIN, upper=True), float(of_each.min(axis=1).max()), upper=True, gap=1e-5
    )
    assert_sharp(
        case.some(CrossingQuantity.PHASE_MARGIN, upper=False), float(of_each.max(axis=1).min()), upper=False, gap=1e-5
    )


def test_only_the_highest_of_three_crossovers_counts_for_the_phase_slope() -> None:
    case = Case(P, resonant((7.0, 7.6)))
    row, _, _, slope = over_the_family(case)
    highest, lower = slope.reshape(-1, 3)[:, 2], slope.reshape(-1, 3)[:, :2]
    assert np.all(np.bincount(row) == 3)
    assert lower.max() > highest.max() + 0.1
    assert_sharp(case.every(CrossingQuantity.PHASE_SLOPE, upper=True), float(highest.max()), upper=True, gap=1e-4)
    claim = case.every(CrossingQuantity.PHASE_SLOPE, upper=True)(float(highest.max()) + 1e-4)
    record = search(claim, 3000).record
    k = next(k for k, token in enumerate(record) if token[0] == "h")
    ends = record[k][1:].split(":")
    for zone in (f"{float(ends[0]) - 9.0!r}:{ends[1]}", f"{ends[1]}:{float(ends[1]) + 1.0!r}", f"{ends[0]}:{ends[0]}"):
        assert check_record(claim, (*record[:k], f"h{zone}", *record[k + 1 :])) == f"leaf {k} does not hold on its box"
    # of a margin every crossover counts: such a leaf is none
    margin = case.every(CrossingQuantity.PHASE_MARGIN, upper=True)(-10.0)
    assert isinstance(check_record(margin, record), str)


def test_members_without_a_crossover_are_never_overlooked() -> None:
    # k/(s + 1) crosses |L| = 1 for k > 1 alone
    for low, high, crosses, never in ((1.01, 2.0, True, False), (0.9, 2.0, False, False), (0.5, 0.99, False, True)):
        case = Case(P, lag((low, high), 1.0))
        assert shown(case.some(CrossingQuantity.CROSSOVER, upper=True)(None)) is crosses
        assert shown(case.every(CrossingQuantity.CROSSOVER, upper=True)(-1e300)) is never


def test_a_peak_a_hair_above_1_is_told_from_one_a_hair_below() -> None:
    # |L| <= k/(2 z sqrt(1 - z^2)) of the resonance k/(s^2 + 2 z s + 1)
    size = 2.0 * 0.05 * math.sqrt(1.0 - 0.05**2)
    for excess in (1e-4, 1e-8):
        below, above = (
            Case(FoPi(size * (1.0 + e), 0.0, 1.0), transfer_function([1.0], [1.0, 0.1, 1.0])) for e in (-excess, excess)
        )
        never = [case.every(CrossingQuantity.CROSSOVER, upper=True)(-1e300) for case in (below, above)]
        assert [shown(claim) for claim in never] == [True, False]
        assert [shown(case.some(CrossingQuantity.CROSSOVER, upper=True)(None), 50) for case in (below, above)] == [
            False,
            True,
        ]


def test_leading_zeros_of_a_numerator_change_nothing() -> None:
    for zeros in range(3):
        case = Case(FoPi(100.0, 0.0, 1.0), transfer_function([0.0] * zeros + [1.0], [1.0, 1.0]))
        # |L| = 100/sqrt(1 + omega^2) beyond omega = 10
        worst = math.log(100.0 / math.sqrt(101.0))
        assert_sharp(case.bound(Response.LOOP_GAIN, upper=True, band=(math.log(10.0), math.inf)), worst, upper=True)


def test_a_crossover_at_the_plants_own_frequency_is_found_for_every_member() -> None:
    # Where omega_c^2 is the constant coefficient, |L| does not depend on that coefficient to first order.
    family = transfer_function([1.5], [1.0, (0.93, 1.38), (0.93, 1.27)], 0.1)
    case = Case(FoPi(0.68, 0.346, 1.22), family)
    assert shown(case.every(CrossingQuantity.PHASE_MARGIN, upper=False)(math.radians(10.0)))
    assert shown(case.some(CrossingQuantity.PHASE_MARGIN, upper=False)(math.radians(10.0)))


def test_the_brake_of_the_documentation_is_stable_with_a_bound_of_its_sensitivity() -> None:
    case = Case(FoPi(0.38512, 0.38776, 0.82038), brake())
    # of a lag and C in one half-plane, L stays there: |S| hardly exceeds 1
    assert shown(case.bound(Response.SENSITIVITY, upper=True)(0.1))
    assert not shown(case.bound(Response.SENSITIVITY, upper=True)(-HAIR))
