"""A list of slips in the claims about margins, each of which a short battery of claims with closed forms notices."""

from __future__ import annotations

import inspect
import itertools
import math
import sys
from collections.abc import Callable, Iterator
from types import ModuleType, SimpleNamespace
from typing import Any

import numpy as np
import pytest
from cases.plants import Number, lag, pole, transfer_function
from cases.thinned import thinned
from flint import arb, ctx

from fopi_tune.core.controller import FoPi
from fopi_tune.core.plant import PlantFamily
from fopi_tune.proof.balls.box import Interval
from fopi_tune.proof.balls.loop import BallLoop
from fopi_tune.proof.claims import crossing_quantities, crossings, existence
from fopi_tune.proof.claims.branch_and_bound import search
from fopi_tune.proof.claims.claim import Claim

PI, INF = math.pi, math.inf
EVERYWHERE: Interval = (-INF, INF)
#: rad or s; how far from the worst value the claims are
HAIR = 1e-7
#: boxes; the true claims take a third of it at most
BUDGET = 400
#: makes a claim of the modules under test, and whether it is true
Question = tuple[Callable[[Any], Claim], bool]


@pytest.fixture(autouse=True)
def precision() -> Iterator[None]:
    with ctx.workprec(64):
        yield


# --- the battery ---------------------------------------------------------------------------------------------------


def integrator(gain: tuple[float, float], dead_time_s: Number, sign: float = 1.0) -> BallLoop:
    """L = +-k e^{-Ls}/s: the crossover is k, and arg L = -90 deg - kL, or +90 deg - kL."""
    return BallLoop(FoPi(sign, 0.0, 1.0), pole(gain, 0.0, dead_time_s))


def proportional(family: PlantFamily) -> BallLoop:
    return BallLoop(FoPi(1.0, 0.0, 1.0), family)


def claim(
    kind: str, loop: BallLoop, quantity: str, level: float, upper: bool, band: Interval = EVERYWHERE
) -> Callable[[Any], Claim]:
    """`every` crossover of the family meets the level, or each plant has `some` crossover that does."""

    def make(of: Any) -> Claim:
        domain, asked = (band, *loop.family_box), of.quantities.CrossingQuantity(quantity)
        evaluator = of.quantities.CrossingEvaluator(loop)
        made = {"every": of.crossings.EveryCrossover, "some": of.existence.SomeCrossover}[kind]
        return made(loop, asked, level, upper, domain, -0.1, evaluator)

    return make


def around(kind: str, loop: BallLoop, quantity: str, worst: float, upper: bool) -> Iterator[Question]:
    """True by a hair, and false by a hair."""
    out = HAIR if upper else -HAIR
    yield claim(kind, loop, quantity, worst + out, upper), True
    yield claim(kind, loop, quantity, worst - out, upper), False


#: |L| > 1 everywhere: no crossover, and a delay margin of 0
LARGE = proportional(transfer_function([(4.5, 5.0), 3.0], [4.0, 1.0]))
PM, DM, SLOPE = "phase_margin_rad", "delay_margin_s", "phase_slope_rad"


def questions_about_angles() -> Iterator[Question]:
    # lag: b = 90 deg - kL from 0.77 to 1.17 rad
    by_lag = integrator((0.5, 1.0), 0.8)
    yield from around("every", by_lag, PM, PI / 2 - 0.8, False)
    yield from around("some", by_lag, PM, PI / 2 - 0.4, True)
    yield from around("every", by_lag, DM, PI / 2 - 0.8, False)
    yield from around("some", by_lag, DM, PI - 0.8, True)
    yield from around("every", by_lag, SLOPE, -0.8, False)
    yield from around("every", by_lag, SLOPE, -0.4, True)
    # lead: b = 270 deg - kL, beyond 180 deg
    by_lead = integrator((0.5, 1.0), 0.8, -1.0)
    yield from around("every", by_lead, PM, PI / 2 + 0.4, False)
    yield from around("some", by_lead, PM, PI / 2 + 0.8, True)
    yield from around("every", by_lead, DM, 1.5 * PI - 0.8, False)
    yield from around("some", by_lead, DM, 3.0 * PI - 0.8, True)
    # an uncertain dead time too, at frequencies far from 1 rad/s
    fast, slow = integrator((6.0, 8.0), (0.05, 0.1)), integrator((0.1, 0.2), (1.0, 3.0))
    yield from around("every", fast, DM, PI / 16.0 - 0.1, False)
    yield from around("some", fast, DM, PI / 12.0 - 0.05, True)
    yield from around("every", slow, DM, PI / 0.4 - 3.0, False)
    yield from around("every", slow, PM, PI / 2 - 0.6, False)
    # through 180 deg, where the margin is largest: at k = 0.8 b is 72 deg on the other side
    both = integrator((0.8, 2.3), 1.0, -1.0)
    yield from around("every", both, PM, PI / 2 + 0.8, False)
    yield claim("some", both, PM, PI - 1e-3, True), False
    # through 0, where the delay margin jumps by a turn: b = 90 deg - k
    for ends in ((1.4, 1.6), (1.55, 1.75), (1.2, 1.9)):
        through = integrator(ends, 1.0)
        yield claim("every", through, PM, 1e-3, False), False
        yield claim("every", through, DM, 1.0, False), False
        yield claim("some", through, DM, 1.0, True), False
        widest = max(abs(PI / 2 - k) for k in ends)
        yield from around("some", through, PM, widest, True)


def questions_about_the_ends() -> Iterator[Question]:
    # (a s + 3)/(4 s + 1): |L(0)| = 3, |L(inf)| = a/4
    proper = proportional(transfer_function([(1.0, 3.0), 3.0], [4.0, 1.0]))
    yield from around("every", proper, DM, least_of_a_direct_path(3.0), False)
    # |L(inf)| > 1 for some plants: their delay margin is 0
    for direct in ((3.0, 5.0), (4.5, 5.0)):
        large = proportional(transfer_function([(direct[0], direct[1]), 3.0], [4.0, 1.0]))
        yield claim("every", large, DM, 0.01, False), False
        yield claim("every", large, PM, PI / 2, False), True
    yield claim("some", LARGE, DM, 0.0, True), True
    yield claim("some", LARGE, DM, -0.01, True), False
    yield claim("some", LARGE, DM, 0.01, False), False
    yield claim("some", LARGE, PM, PI, True), False
    yield claim("some", proportional(transfer_function([(3.0, 3.9), 3.0], [4.0, 1.0])), DM, 0.01, True), False
    # k/(s + 1): |L(0)| passes 1, where the crossover comes out of omega = 0 at 180 deg from -1
    born = proportional(lag((0.4, 4.0), 1.0))
    yield from around("every", born, PM, PI - math.atan(math.sqrt(15.0)), False)
    yield from around("every", born, DM, (PI - math.atan(math.sqrt(15.0))) / math.sqrt(15.0), False)
    slow = proportional(lag((0.4, 1.05), 1.0))
    reach = math.sqrt(1.05**2 - 1.0)
    yield from around("every", slow, DM, (PI - math.atan(reach)) / reach, False)
    yield claim("every", BallLoop(FoPi(-1.0, 0.0, 1.0), lag((0.4, 4.0), 1.0)), PM, 0.1, False), False
    # -k (1 + a s)/(1 + s) next to omega = 0: b is (a - 1) omega, from just above 0 or from just below 360 deg
    beside = BallLoop(FoPi(-1.0, 0.0, 1.0), transfer_function([(0.2, 1.2), (0.9, 1.1)], [1.0, 1.0]))
    yield claim("every", beside, DM, 5.0, False, (-INF, -1.0)), False
    # the same away from -1, where (1 + a s)/(1 + s) is 180 deg from it
    away = proportional(transfer_function([(0.2, 1.2), (0.9, 1.1)], [1.0, 1.0]))
    yield claim("every", away, PM, 2.0, False), True
    yield claim("every", away, DM, 2.0, False, (-INF, -1.0)), True
    yield claim("every", away, DM, 2.0, True, (-INF, -1.0)), False


def least_of_a_direct_path(most: float) -> float:
    """The delay margin of (a s + 3)/(4 s + 1) at a = most, where the crossover is highest."""
    omega = math.sqrt(8.0 / (16.0 - most**2))
    return (PI + math.atan(most * omega / 3.0) - math.atan(4.0 * omega)) / omega


BATTERY: list[Question] = [*questions_about_angles(), *questions_about_the_ends()]


def misjudges_an_interval(of: Any) -> bool:
    """Whether an interval of b is within a level against the definition at one of its points, or not though it is.

    The delay margin is b at omega = 1.
    """
    points = np.linspace(0.0, 1.0, 41)
    for low, width in itertools.product(np.arange(-2.45, 7.0, 0.3).tolist(), (0.02, 0.5, 2.5)):
        b, ball = low + width * points, arb(low).union(arb(low + width))
        for name, values in ((PM, np.abs(np.angle(np.exp(1j * b)))), (DM, np.mod(b, 2.0 * PI))):
            found = of.quantities.ValueOnUnitCircle(of.quantities.CrossingQuantity(name), ball, ball, [])
            for level, upper in itertools.product((0.3, 1.3, 3.0, 3.5), (True, False)):
                true = bool(np.all(values <= level) if upper else np.all(values >= level))
                said = found.is_within(level, upper)
                # of other sheets nothing has to be said
                if (said and not true) or (true and not said and low > 0.0 and low + width < 2.0 * PI):
                    return True
    return False


def takes_a_forged_leaf(of: Any) -> bool:
    """Whether `e+` stands for anything but a delay margin of 0."""
    domains = [claim("some", LARGE, *asked)(of) for asked in ((PM, PI, True), (DM, 0.1, False), (SLOPE, 9.0, True))]
    return any(made.holds(made.domain, "e+") for made in domains)


def is_caught(of: Any) -> bool:
    """Whether a claim of the battery is answered wrongly, or a true one not at all."""
    if any(search(make(of), BUDGET).shown is not true for make, true in BATTERY):
        return True
    return misjudges_an_interval(of) or takes_a_forged_leaf(of)


# --- the slips -----------------------------------------------------------------------------------------------------

MODULES = {"quantities": crossing_quantities, "crossings": crossings, "existence": existence}
PHASE = "bool(most <= level and -least <= level if upper else least >= level)"
DELAY_UPPER, DELAY_LOWER = (
    "bool(self.lag >= 0 and self.value <= level)",
    "bool(self.lag < 2 * arb.pi() and self.value >= level)",
)
TAIL = "bool(lag < 2 * arb.pi() and lag >= self.level * self.loop.frequency(over.omega))"
ANGLE_SLOPE, ANGLE_RATE = (
    "(phase[0] - around * loop.stretch(over.omega))",
    "(phase[0] + around * loop.stretch(over.omega))",
)
HIGH_TAIL = "if over.high_tail and self.quantity is CrossingQuantity.DELAY_MARGIN"
FAR = "((over.low_tail or over.high_tail) and self._is_far_from_minus_one(over))"
NO_UPPER = "is not CrossingQuantity.DELAY_MARGIN{}:\n            return False\n        # b"
LARGE_AT_END = "bool(gain.abs_lower() {} 1 if gain.is_finite() else inverse"
FAR_OUT = "over = self.loop.over((({}), *box[1:]))"
#: what a slip would change, and into what
SLIPS = [
    # the sheet
    ("(-gain).arg() if gain.real < 0 else", "gain.arg() if gain.real < 0 else"),
    ("(-gain).arg() if gain.real < 0 else", "(-gain).arg() if gain.real > 0 else"),
    ("else gain.arg() + arb.pi()", "else gain.arg()"),
    ("else gain.arg() + arb.pi()", "else -gain.arg() + arb.pi()"),
    ("return angle - 2 * arb.pi() * math.floor(", "return angle + 2 * arb.pi() * math.floor("),
    ("return angle - 2 * arb.pi() * math.floor(", "return angle - 2 * arb.pi() * math.ceil("),
    ("return angle - 2 * arb.pi() * math.floor(", "return angle - 2 * arb.pi() * round("),
    ("return angle - 2 * arb.pi() * math.floor(", "return angle - arb.pi() * math.floor("),
    ("math.floor(float(angle.mid()) / (2.0 * math.pi))", "math.floor(float(angle.mid()) / math.pi)"),
    # the value wherever |L| = 1
    ("value + multiplier * log_gain + variation", "value - multiplier * log_gain + variation"),
    ("value + multiplier * log_gain + variation", "value + multiplier * log_gain"),
    ("value + multiplier * log_gain + variation", "value + variation"),
    ("phase = [over.log_slope.imag", "phase = [over.log_slope.real"),
    ("*(g.imag for g in over.log_gradient)]\n        lag,", "*(g.real for g in over.log_gradient)]\n        lag,"),
    ("gains = [over.log_slope.real", "gains = [over.log_slope.imag"),
    ("around = at_centre + sum(", "around = -at_centre + sum("),
    (ANGLE_SLOPE + " / frequency", ANGLE_RATE + " / frequency"),
    (ANGLE_SLOPE + " / frequency", ANGLE_SLOPE),
    ("[first, *(p / frequency for p in phase[1:])]", "[first, *(p for p in phase[1:])]"),
    ("enclosed(at_centre / loop.frequency(centre.omega)", "enclosed(at_centre * loop.frequency(centre.omega)"),
    ("return cls(quantity, value, lag, slopes)", "return cls(quantity, lag, value, slopes)"),
    # within the level
    ("self.value <= level if upper else self.value >= level", "self.value >= level if upper else self.value <= level"),
    ("opposite = arb.pi() - self.lag", "opposite = arb.pi() + self.lag"),
    ("opposite = arb.pi() - self.lag", "opposite = 2 * arb.pi() - self.lag"),
    ("opposite = arb.pi() - self.lag", "opposite = self.lag"),
    ("least, most = arb.pi()", "most, least = arb.pi()"),
    ("- opposite.abs_upper(), arb.pi() -", "- opposite.abs_lower(), arb.pi() -"),
    ("arb.pi() - opposite.abs_lower()", "arb.pi() - opposite.abs_upper()"),
    (PHASE, "bool(most <= level if upper else least >= level)"),
    (PHASE, "bool(-least <= level if upper else least >= level)"),
    (PHASE, "bool(most <= level and -least <= level if upper else most >= level)"),
    (PHASE, "bool(most <= level and -least <= level if upper else -least >= level)"),
    (DELAY_UPPER, "bool(self.value <= level)"),
    (DELAY_UPPER, "bool(self.lag >= 0)"),
    (DELAY_UPPER, "bool(self.lag >= 2 * arb.pi() and self.value <= level)"),
    (DELAY_LOWER, "bool(self.value >= level)"),
    (DELAY_LOWER, "bool(self.lag < 2 * arb.pi())"),
    (DELAY_LOWER, "bool(self.lag < 0 and self.value >= level)"),
    # towards the ends of the axis
    ("return bool(over.size < 1)", "return has_no_gain_crossover(over)"),
    ("return bool(over.size < 1)", "return bool(over.size > 1)"),
    (HIGH_TAIL, HIGH_TAIL.replace("high", "low")),
    (HIGH_TAIL, HIGH_TAIL.replace("DELAY", "PHASE")),
    (FAR, "over.low_tail or over.high_tail"),
    (FAR, "(over.high_tail and self._is_far_from_minus_one(over))"),
    (FAR, "(over.low_tail and self._is_far_from_minus_one(over))"),
    (NO_UPPER.format(" or self.upper"), NO_UPPER.format("")),
    (TAIL, "bool(lag >= self.level * self.loop.frequency(over.omega))"),
    (TAIL, "bool(lag < 2 * arb.pi() and lag >= self.level)"),
    (TAIL, "bool(lag < 2 * arb.pi() and lag <= self.level * self.loop.frequency(over.omega))"),
    # a delay margin of 0
    ("or self.level is None or not self.upper or self.level < 0:", "or self.level is None or not self.upper:"),
    ("or self.level is None or not self.upper or self.level < 0:", "or self.level is None or self.level < 0:"),
    ("if self.quantity is not CrossingQuantity.DELAY_MARGIN or self.level is None", "if self.level is None"),
    (LARGE_AT_END.format(">"), LARGE_AT_END.format("<")),
    (FAR_OUT.format("_FAR_OUT, math.inf"), FAR_OUT.format("-math.inf, -_FAR_OUT")),
    ("return BoxVerdict(HIGH_END)", "return BoxVerdict(None)"),
]  # fmt: skip


def test_the_battery_is_answered_without_a_mistake() -> None:
    assert not is_caught(SimpleNamespace(**MODULES))
    answers = [true for _, true in BATTERY]
    assert 15 < sum(answers) < len(answers) - 15


@pytest.mark.thinned(8)
@pytest.mark.parametrize(("old", "new"), thinned(SLIPS))
def test_a_slip_is_caught(old: str, new: str, monkeypatch: pytest.MonkeyPatch) -> None:
    sources = {key: inspect.getsource(module) for key, module in MODULES.items()}
    assert sum(source.count(old) for source in sources.values()) == 1, (
        "this line was rewritten: bring the slip up to date"
    )
    mutants = {key: ModuleType(f"{key}_with_a_slip") for key in MODULES}
    for key, mutant in mutants.items():
        # dataclasses look their module up by name, and each module is to find the slip in those before it
        monkeypatch.setitem(sys.modules, mutant.__name__, mutant)
        source = sources[key].replace(old, new)
        for other, module in MODULES.items():
            source = source.replace(f"from {module.__name__} import", f"from {mutants[other].__name__} import")
        exec(compile(source, mutant.__name__, "exec"), mutant.__dict__)
    assert is_caught(SimpleNamespace(**mutants))
