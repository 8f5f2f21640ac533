"""The branch and bound against brute force:  what is true by a hair is shown, what is false by a hair never is."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import pytest
from cases.plants import lag, pole, transfer_function
from flint import ctx
from numpy.typing import NDArray

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
from fopi_tune.proof.claims.lag import closed_form

Array = NDArray[np.float64]
#: neper, or relative: how far beyond the worst value a claim is made, and how far short of it
GAP = 1e-5
#: boxes for a claim that is true; the hardest of these tests takes half of it
BUDGET = 20_000
#: boxes after which a claim that is false has been tried hard enough; those of existence take longer each
FALSE_BUDGET, FALSE_BUDGET_OF_SOME = 3000, 200
EVERYWHERE: Interval = (-math.inf, math.inf)
#: u that stands for the limits
FAR = 80.0


@pytest.fixture(autouse=True)
def precision() -> Iterator[None]:
    with ctx.workprec(64):
        yield


# --- designs and brute force ---------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Design:
    """A controller with a family of stable plants of positive gain and degree 1 or 2."""

    gains: FoPi
    family: PlantFamily

    @cached_property
    def loop(self) -> BallLoop:
        return BallLoop(self.gains, self.family)

    def polynomials(self, theta: Array) -> tuple[Array, Array, Array]:
        """Gain, denominator in descending powers and dead time; rows are plants."""
        columns = dict(zip(self.family.uncertain_names, theta.T, strict=True))
        p = {n: columns.get(n, np.full(len(theta), v.nominal)) for n, v in self.family.parameters.items()}
        one = np.ones(len(theta))
        if self.family.model == "lag":
            return p["static_gain"], np.stack([p["time_constant_s"], one], 1), p["dead_time_s"]
        if self.family.model == "pole":
            return p["gain"], np.stack([one, p["pole_rad_s"]], 1), p["dead_time_s"]
        bottom = [value for name, value in p.items() if name.startswith("denominator")]
        return p["numerator[0]"], np.stack(bottom, 1), p["dead_time_s"]

    def parts(self, u: Array, theta: Array) -> tuple[NDArray[np.complex128], NDArray[np.complex128], Array, Array]:
        """C, the denominator, the plant's gain and its turn by the dead time, row by row."""
        gain, bottom, delay = self.polynomials(theta)
        s = 1j * np.exp(u)
        d = sum(bottom[:, k] * s**power for k, power in enumerate(range(bottom.shape[1] - 1, -1, -1)))
        return self.gains.kp + self.gains.ki * s**-self.gains.alpha, np.asarray(d), gain, np.exp(u) * delay

    def log_response(self, response: Response, u: Array, theta: Array) -> Array:
        c, d, gain, turn = self.parts(u, theta)
        loop = c * gain * np.exp(-1j * turn) / d
        top = {Response.LOOP_GAIN: loop * (1.0 + loop), Response.SENSITIVITY: np.ones_like(loop)}
        top |= {
            Response.COMPLEMENTARY_SENSITIVITY: loop,
            Response.CONTROL_SENSITIVITY: c,
            Response.LOAD_SENSITIVITY: loop / c,
        }
        return np.log(np.abs(top[response] / (1.0 + loop)))

    def phase(self, u: Array, theta: Array) -> Array:
        """Unwrapped: with kp, ki > 0 and a stable plant every principal value is continuous from omega = 0."""
        c, d, _, turn = self.parts(u, theta)
        return np.angle(c) - np.angle(d) - turn

    def slope(self, u: Array, theta: Array) -> Array:
        return (self.phase(u + 1e-5, theta) - self.phase(u - 1e-5, theta)) / 2e-5

    def crossings(self, function: Callable[[Array, Array], Array], theta: Array) -> tuple[NDArray[np.intp], Array]:
        """Plant and u of every change of sign on a dense grid, bisected."""
        u = np.linspace(-7.0, 4.0, 500)
        rows = np.repeat(np.arange(len(theta)), len(u))
        positive = (function(np.tile(u, len(theta)), theta[rows]) > 0).reshape(len(theta), len(u))
        row, k = np.nonzero(positive[:, 1:] != positive[:, :-1])
        low, high, first = u[k], u[k + 1], positive[row, k]
        for _ in range(45):
            middle = 0.5 * (low + high)
            same = (function(middle, theta[row]) > 0) == first
            low, high = np.where(same, middle, low), np.where(same, high, middle)
        return row, 0.5 * (low + high)

    def at_crossovers(self, quantity: CrossingQuantity, largest: bool, theta: Array) -> Array:
        """The largest or smallest value over the gain crossovers of each plant."""
        row, u = self.crossings(lambda u, t: self.log_response(Response.LOOP_GAIN, u, t), theta)
        margin = math.pi + self.phase(u, theta[row])
        values = {
            CrossingQuantity.PHASE_MARGIN: margin,
            CrossingQuantity.DELAY_MARGIN: margin / np.exp(u),
            CrossingQuantity.CROSSOVER: u,
        }
        value = values[quantity] if quantity in values else self.slope(u, theta[row])
        return extreme_by_row(row, value, len(theta), largest)

    def gain_margin(self, theta: Array) -> Array:
        """Neper; the largest |L| < 1 where the phase passes -180 - 360 k deg."""
        margins = []
        for k in range(4):
            row, u = self.crossings(lambda u, t, k=k: self.phase(u, t) + (2 * k + 1) * math.pi, theta)
            value = -self.log_response(Response.LOOP_GAIN, u, theta[row])
            margins.append(extreme_by_row(row[value > 0], value[value > 0], len(theta), largest=False))
        return np.min(margins, axis=0)


def extreme_by_row(row: NDArray[np.intp], value: Array, rows: int, largest: bool) -> Array:
    found = np.full(rows, -np.inf if largest else np.inf)
    (np.maximum if largest else np.minimum).at(found, row, value)
    return found


def maximum(function: Callable[[Array], Array], axes: list[Array]) -> float:
    """The largest value over a box: on a grid, then on ever smaller ones around its best place, down to 1e-7 of it."""
    grid = np.array(list(itertools.product(*axes)))
    low, high = np.array([axis[0] for axis in axes]), np.array([axis[-1] for axis in axes])
    values = function(grid)
    best, place = float(values.max()), grid[np.argmax(values)]
    width = np.array([np.diff(axis).max() if len(axis) > 1 else 0.0 for axis in axes])
    pattern = np.array(list(itertools.product((-1.0, 0.0, 1.0), repeat=len(axes))))
    for _ in range(24):
        near = np.unique(np.clip(place + width * pattern, low, high), axis=0)
        values = function(near)
        if values.max() > best:
            best, place = float(values.max()), near[np.argmax(values)]
        width = 0.5 * width
    return best


def plants_grid(design: Design, per_axis: int) -> list[Array]:
    return [np.linspace(a, b, per_axis) for a, b in design.loop.family_box]


def worst_response(design: Design, response: Response, upper: bool, band: Interval) -> float:
    sign = 1.0 if upper else -1.0

    def function(x: Array) -> Array:
        return sign * design.log_response(response, x[:, 0], x[:, 1:])

    low, high = max(band[0], -FAR), min(band[1], FAR)
    inner = np.linspace(max(low, -9.0), min(high, 7.0), 500)
    found = [maximum(function, [inner, *plants_grid(design, 5)])]
    found += [maximum(function, [np.array([end]), *plants_grid(design, 9)]) for end in (low, high)]
    return sign * max(found)


def worst_at_crossovers(design: Design, quantity: CrossingQuantity, of_largest: bool, upper: bool) -> float:
    sign = 1.0 if upper else -1.0
    return sign * maximum(lambda x: sign * design.at_crossovers(quantity, of_largest, x), plants_grid(design, 5))


# --- random designs ------------------------------------------------------------------------------------------------

FAMILIES: dict[str, Callable[[np.random.Generator], PlantFamily]] = {
    "lag": lambda rng: lag(rng.uniform(0.5, 2.0), around(rng, 1.0), rng.choice([0.0, 0.3])),
    "pole": lambda rng: pole(around(rng, 2.0), around(rng, 0.5), rng.choice([0.0, 0.2])),
    "delayed lag": lambda rng: lag(1.0, around(rng, 2.0), 0.5),
    "delayed pole": lambda rng: pole(2.0, around(rng, 0.5), around(rng, 0.3)),
    "second order": lambda rng: transfer_function([1.5], [1.0, around(rng, 1.2), around(rng, 1.0)], 0.1),
    "gain, lag and delay": lambda rng: lag(around(rng, 1.0, 0.15), around(rng, 2.0, 0.2), around(rng, 0.4, 0.2)),
}


def around(rng: np.random.Generator, value: float, most: float = 0.3) -> tuple[float, float]:
    low, high = rng.uniform(0.05, most, 2)
    return value * (1.0 - low), value * (1.0 + high)


def random_design(name: str, seed: int) -> Design:
    """kp, ki > 0 by the closed form, for a random crossover and phase margin of the middle of the box."""
    rng = np.random.default_rng([401, seed])
    family = FAMILIES[name](rng)
    while True:
        alpha, u, margin = rng.uniform(0.4, 1.3), rng.uniform(-1.2, 0.4), math.radians(rng.uniform(45.0, 80.0))
        unit = Design(FoPi(1.0, 0.0, 1.0), family)
        _, d, gain, turn = unit.parts(np.array([u]), family.nominal_point[None, :])
        x = complex((np.exp(1j * (margin - math.pi + turn)) * d / gain)[0])
        ki = -x.imag * math.exp(alpha * u) / math.sin(0.5 * math.pi * alpha)
        kp = x.real - ki * math.exp(-alpha * u) * math.cos(0.5 * math.pi * alpha)
        design = Design(FoPi(float(kp), float(ki), float(alpha)), family) if kp > 0.0 and ki > 0.0 else None
        # a family that comes close to instability has levels that are no design's
        if design is not None and worst_response(design, Response.SENSITIVITY, True, EVERYWHERE) < 1.2:
            return design


def shown(claim: Claim, budget: int) -> bool:
    """Whether it is shown, and then its record is accepted."""
    found = search(claim, budget)
    assert not found.shown or check_record(claim, found.record) is None
    assert not found.shown or found.counterexample is None
    return found.shown


def assert_sharp(claim_at: Callable[[float], Claim], worst: float, upper: bool, gap: float = GAP) -> None:
    """Shown a gap beyond the worst value, never shown a gap short of it; by the closed form alike."""
    outward = gap if upper else -gap
    beyond, short = claim_at(worst + outward), claim_at(worst - outward)
    for form in (lambda claim: claim, closed_form):
        if form is closed_form and closed_form(beyond) is beyond:
            continue
        assert shown(form(beyond), BUDGET), form(beyond)
        some = isinstance(short, SomeCrossover | SomePhaseCrossover)
        assert not shown(form(short), FALSE_BUDGET_OF_SOME if some else FALSE_BUDGET), form(short)


LOW, MIDDLE, HIGH = (-math.inf, -3.0), (-1.5, 0.5), (2.0, math.inf)
BOUNDS = [
    (Response.SENSITIVITY, True, EVERYWHERE),
    (Response.COMPLEMENTARY_SENSITIVITY, True, EVERYWHERE),
    (Response.CONTROL_SENSITIVITY, True, EVERYWHERE),
    (Response.LOOP_GAIN, False, LOW),
    (Response.LOOP_GAIN, True, HIGH),
    (Response.SENSITIVITY, True, LOW),
    (Response.COMPLEMENTARY_SENSITIVITY, True, HIGH),
    (Response.SENSITIVITY, False, MIDDLE),
    (Response.COMPLEMENTARY_SENSITIVITY, False, MIDDLE),
    (Response.CONTROL_SENSITIVITY, False, MIDDLE),
    (Response.LOOP_GAIN, True, (0.3, 0.3)),
    (Response.LOAD_SENSITIVITY, True, EVERYWHERE),
    (Response.LOAD_SENSITIVITY, False, MIDDLE),
]


@pytest.mark.thinned(3)
@pytest.mark.parametrize("name", FAMILIES)
def test_a_bound_of_a_response_is_shown_exactly_from_its_worst_value_on(name: str) -> None:
    design = random_design(name, 1)
    for response, upper, band in BOUNDS:
        domain: Box = (band, *design.loop.family_box)

        def claim(level: float, r: Response = response, up: bool = upper, domain: Box = domain) -> Claim:
            return Bound(design.loop, r, level, up, domain, -0.3)

        assert_sharp(claim, worst_response(design, response, upper, band), upper)


@pytest.mark.thinned(5)
@pytest.mark.parametrize("name", ["lag", "pole", "second order", "gain, lag and delay"])
@pytest.mark.parametrize(
    "quantity", [CrossingQuantity.PHASE_MARGIN, CrossingQuantity.DELAY_MARGIN, CrossingQuantity.PHASE_SLOPE]
)
def test_a_reading_at_every_crossover_is_shown_exactly_from_its_worst_value_on(
    name: str, quantity: CrossingQuantity
) -> None:
    design = random_design(name, 2)
    domain: Box = (EVERYWHERE, *design.loop.family_box)
    for upper in (False, True):
        worst = worst_at_crossovers(design, quantity, upper, upper)

        def claim(level: float, upper: bool = upper) -> Claim:
            return EveryCrossover(design.loop, quantity, level, upper, domain, -0.3, CrossingEvaluator(design.loop))

        assert_sharp(claim, worst, upper, GAP * abs(worst))


@pytest.mark.thinned(5)
@pytest.mark.parametrize("name", ["lag", "pole", "second order", "gain, lag and delay"])
@pytest.mark.parametrize(
    "quantity", [CrossingQuantity.PHASE_MARGIN, CrossingQuantity.DELAY_MARGIN, CrossingQuantity.CROSSOVER]
)
def test_a_reading_at_some_crossover_is_shown_exactly_from_its_worst_value_on(
    name: str, quantity: CrossingQuantity
) -> None:
    design = random_design(name, 3)
    domain: Box = (EVERYWHERE, *design.loop.family_box)
    for upper in (False, True):
        worst = worst_at_crossovers(design, quantity, not upper, upper)

        def claim(level: float, upper: bool = upper) -> Claim:
            return SomeCrossover(design.loop, quantity, level, upper, domain, -0.3, CrossingEvaluator(design.loop))

        assert_sharp(claim, worst, upper, GAP * abs(worst))


@pytest.mark.thinned(5)
@pytest.mark.parametrize("name", ["gain, lag and delay", "delayed lag", "delayed pole"])
@pytest.mark.parametrize("upper", [False, True])
def test_a_gain_margin_is_shown_exactly_from_its_worst_value_on(name: str, upper: bool) -> None:
    design = random_design(name, 4)
    domain: Box = (EVERYWHERE, *design.loop.family_box)
    sign = 1.0 if upper else -1.0
    worst = sign * maximum(lambda x: sign * design.gain_margin(x), plants_grid(design, 5))

    def claim(level: float) -> Claim:
        kind = SomePhaseCrossover if upper else EveryPhaseCrossover
        return kind(design.loop, level, domain, -0.3)

    assert_sharp(claim, worst, upper)
