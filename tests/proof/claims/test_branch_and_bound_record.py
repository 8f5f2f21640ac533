"""Records of a search:  what is accepted and what is refused, and how many boxes it takes."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from cases.plants import brake, lag_gain_and_delay, transfer_function
from flint import arb, ctx

from fopi_tune.core.controller import FoPi
from fopi_tune.core.peaks import Response
from fopi_tune.core.plant import PlantFamily
from fopi_tune.proof.balls.box import Box, Interval, split, with_interval
from fopi_tune.proof.balls.loop import BallLoop
from fopi_tune.proof.claims.bound import Bound, response_of
from fopi_tune.proof.claims.branch_and_bound import SearchResult, check_record, search
from fopi_tune.proof.claims.claim import HOLDS, BoxVerdict, Claim
from fopi_tune.proof.claims.crossing_quantities import CrossingEvaluator, CrossingQuantity
from fopi_tune.proof.claims.crossings import EveryCrossover
from fopi_tune.proof.claims.existence import SomeCrossover
from fopi_tune.proof.claims.lag import closed_form

EVERYWHERE: Interval = (-math.inf, math.inf)
GAINS = FoPi(0.55, 0.5, 0.9)
SECOND_ORDER = transfer_function([1.0], [1.0, (1.0, 1.4), (0.8, 1.2)])


@pytest.fixture(autouse=True)
def precision() -> Iterator[None]:
    with ctx.workprec(64):
        yield


@cache
def loop_of(name: str) -> BallLoop:
    families = {"lag": brake(), "three": lag_gain_and_delay(), "second": SECOND_ORDER}
    return BallLoop(GAINS, families[name])


@cache
def peak(name: str) -> float:
    """The largest ln|S|, at a corner of these families: corners on a fine grid of u, refined to the last digits."""
    family = loop_of(name).family
    u, best = np.linspace(-4.0, 4.0, 20_001), -math.inf
    for _ in range(6):
        values = np.max([log_sensitivity(family, corner, u) for corner in family.corners()], axis=0)
        k = int(np.argmax(values))
        best = max(best, float(values[k]))
        u = np.linspace(u[max(k - 1, 0)], u[min(k + 1, len(u) - 1)], 201)
    return best


def log_sensitivity(family: PlantFamily, theta: np.ndarray, u: np.ndarray) -> np.ndarray:
    s, plant = 1j * np.exp(u), family.member(theta)
    p = np.polyval(plant.numerator, s) / np.polyval(plant.denominator, s) * np.exp(-s * plant.dead_time_s)
    return -np.log(np.abs(1.0 + (GAINS.kp + GAINS.ki * s**-GAINS.alpha) * p))


def sensitivity_at_most(name: str, gap: float, kind: type[Bound] = Bound) -> Bound:
    loop = loop_of(name)
    return kind(loop, Response.SENSITIVITY, peak(name) + gap, True, (EVERYWHERE, *loop.family_box), 0.0)


def reading_claim(name: str, level: float, some: bool) -> Claim:
    loop = loop_of(name)
    kind = SomeCrossover if some else EveryCrossover
    return kind(
        loop, CrossingQuantity.PHASE_MARGIN, level, False, (EVERYWHERE, *loop.family_box), 0.0, CrossingEvaluator(loop)
    )


def found(claim: Claim) -> SearchResult:
    result = search(claim, 20_000)
    assert result.shown
    return result


CLAIMS: dict[str, Callable[[], Claim]] = {
    "bound": lambda: sensitivity_at_most("lag", 1e-4),
    "bound of a second order": lambda: sensitivity_at_most("second", 0.3),
    "closed form": lambda: closed_form(sensitivity_at_most("lag", 1e-4)),
    "every crossover": lambda: reading_claim("three", math.radians(50.0), some=False),
    "some crossover": lambda: reading_claim("three", math.radians(40.0), some=True),
}


@cache
def recorded(name: str) -> tuple[Claim, tuple[str, ...]]:
    claim = CLAIMS[name]()
    return claim, found(claim).record


# --- records -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", CLAIMS)
def test_a_record_that_was_found_is_accepted(name: str) -> None:
    result = found(CLAIMS[name]())
    assert check_record(CLAIMS[name](), result.record) is None
    assert len(result.record) == result.boxes


@pytest.mark.thinned(2)
@pytest.mark.parametrize("name", CLAIMS)
def test_a_record_with_a_token_less_more_or_different_is_refused(name: str) -> None:
    claim, record = recorded(name)
    rng = np.random.default_rng(701)
    for k in {0, len(record) - 1, *rng.integers(0, len(record), 8).tolist()}:
        token, before, after = record[k], record[:k], record[k + 1 :]
        leaf = token[0] not in "sp"
        changed = [(*record, token), (*record, "."), (*before, "s0" if leaf else ".", *after)]
        if leaf:
            changed += [before + after, (*before, "s0", *after), (*before, "", *after)]
        changed += [record[:k]] if k < len(record) else []
        for other in changed:
            assert isinstance(check_record(claim, other), str), (k, token, other[k : k + 2])


def test_the_empty_record_and_a_single_leaf_prove_nothing() -> None:
    for name in CLAIMS:
        assert check_record(CLAIMS[name](), ()) == "the record ends before the domain is covered"
        assert check_record(CLAIMS[name](), (".",)) == "leaf 0 does not hold on its box"
    assert not SearchResult((), 1, 1).shown


def test_a_record_does_not_prove_a_level_beyond_the_truth() -> None:
    for name in ("second", "lag"):
        claim = sensitivity_at_most(name, 1e-4)
        record = found(claim).record
        false = replace(claim, level=peak(name) - 1e-9)
        assert isinstance(check_record(false, record), str)
        assert isinstance(check_record(closed_form(false), record), str)


def test_a_record_of_one_claim_does_not_prove_another() -> None:
    claim = sensitivity_at_most("three", 0.3)
    record = found(claim).record
    for other in (
        replace(claim, response=Response.COMPLEMENTARY_SENSITIVITY, level=-0.1),
        replace(claim, upper=False),
        replace(claim, domain=((-1.0, 1.0), *claim.domain[1:]), upper=False),
        replace(claim, loop=BallLoop(FoPi(3.0, 3.0, 0.9), lag_gain_and_delay())),
    ):
        assert isinstance(check_record(other, record), str)


def test_a_face_at_the_other_end_or_of_another_axis_is_refused() -> None:
    claim = sensitivity_at_most("lag", 1e-4)
    record = found(claim).record
    pinned = [k for k, token in enumerate(record) if token[0] == "p"]
    assert len(pinned) > 3
    for k in pinned:
        swapped = record[k].translate(str.maketrans("+-", "-+"))
        further = record[k] + "0+" if "0" not in record[k] else record[k] + "9+"
        for token in (swapped, further, "p", "p1", "p+", "p9+"):
            reason = check_record(claim, (*record[:k], token, *record[k + 1 :]))
            assert reason is not None
            assert reason.endswith("takes a face that need not be the worst"), (token, reason)


def test_a_face_of_a_box_whose_worst_point_is_inside_is_refused() -> None:
    claim = sensitivity_at_most("second", 1e-4)
    assert isinstance(check_record(claim, ("p1+", *found(claim).record)), str)


@pytest.mark.parametrize(
    "token",
    [
        *("", "?", "s", "s-1", "s3", "s99", "s1.5", "sx", "s 1", "s²", "p", "p9+", "px+", "h", "h1:2", "x", "x1:2"),
        *("xa:b", "xnan:nan", "x2:1", "x-inf:inf", "x1:1e999", "h-1:inf", "hh", ". ", "..", "\x00"),
    ],
)
def test_a_token_that_is_nonsense_is_refused_and_never_raises(token: str) -> None:
    for name in ("bound", "every crossover", "closed form"):
        claim, record = recorded(name)
        for k in (0, len(record) // 2, len(record) - 1):
            assert isinstance(check_record(claim, (*record[:k], token, *record[k + 1 :])), str), (name, k)
    assert isinstance(check_record(CLAIMS["some crossover"](), (token,)), str)


def test_a_zone_without_a_crossing_or_with_a_worse_one_is_refused() -> None:
    claim = reading_claim("second", math.radians(40.0), some=True)
    result = found(claim)
    assert check_record(claim, result.record) is None
    k = next(k for k, token in enumerate(result.record) if token[0] == "x")
    low, high = map(float, result.record[k][1:].split(":"))
    for zone in ((low - 3.0, high - 3.0), (low + 3.0, high + 3.0), (low, low + 1e-12), (high, low)):
        token = f"x{zone[0]!r}:{zone[1]!r}"
        assert (
            check_record(claim, (*result.record[:k], token, *result.record[k + 1 :]))
            == f"leaf {k} does not hold on its box"
        )
    worse = reading_claim("second", math.radians(60.0), some=True)
    assert isinstance(check_record(worse, result.record), str)


# --- the search ----------------------------------------------------------------------------------------------------


def test_a_false_claim_ends_with_a_place_where_it_is_false() -> None:
    for name in ("three", "second"):
        claim = sensitivity_at_most(name, -1e-3)
        place = search(claim, 5000).counterexample
        assert place is not None
        value = log_sensitivity(claim.loop.family, np.array(place[1:]), np.array([place[0]]))[0]
        assert value > claim.level


def test_a_search_that_gives_up_says_so() -> None:
    result = search(sensitivity_at_most("three", 1e-4), 20)
    assert (result.shown, result.boxes, result.record) == (False, 20, ())
    assert result.open_boxes


class NaiveBound(Bound):
    """The same claim by the enclosure of the response alone, cut along its tail or its longest axis."""

    def examine(self, box: Box) -> BoxVerdict:
        if box[0] == EVERYWHERE:
            return BoxVerdict(None, 0)
        value = response_of(self.loop.over(box), self.response)
        if value.is_finite() and value.abs_upper() <= arb(self.level).exp():
            return HOLDS
        widths = [high - low for low, high in box]
        parts = [w / (high - low) for w, (low, high) in zip(widths[1:], self.domain[1:], strict=True)]
        return BoxVerdict(None, int(np.argmax([widths[0], *parts])))


@pytest.mark.parametrize("name", ["lag", "second"])
def test_without_derivatives_a_sharp_level_takes_ten_times_the_boxes(name: str) -> None:
    assert found(sensitivity_at_most(name, 0.5, NaiveBound)).shown
    boxes = found(sensitivity_at_most(name, 1e-6)).boxes
    assert not search(sensitivity_at_most(name, 1e-6, NaiveBound), 10 * boxes).shown


@pytest.mark.thinned(3)
@pytest.mark.parametrize("name", ["lag", "second", "three", "closed form"])
def test_boxes_grow_with_the_logarithm_of_the_gap(name: str) -> None:
    def boxes(gap: float) -> int:
        claim = sensitivity_at_most("lag" if name == "closed form" else name, gap)
        return found(closed_form(claim) if name == "closed form" else claim).boxes

    coarse, fine, finest = boxes(1e-3), boxes(1e-6), boxes(1e-9)
    # A thousandth of the gap means 5 more halvings around the worst place, since the excess is quadratic, each with a
    # few boxes: the same number again (measured: 42 and 42, 48 and 46, 119 and 44, 36 and 38), where a first-order test
    # would multiply by a thousand, or its root along a worst place that is smooth.
    assert finest - fine < 2 * (fine - coarse)
    assert finest < 3 * coarse


def test_cuts_meet_at_the_same_doubles_whatever_the_order() -> None:
    box: Box = ((-1.0, 2.0), (0.1, 0.7))
    first = split(box, 0)
    assert first is not None
    again = split(with_interval(box, 1, (0.1, 0.4)), 0)
    assert again is not None
    assert first[0][0] == again[0][0]
