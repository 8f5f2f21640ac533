"""One convex step against the whole problem, written down at once and solved by other means."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest
from scipy.optimize import linprog

from fopi_tune.core.controller import FoPi
from fopi_tune.design.time_domain.model import Model, Sum
from fopi_tune.design.time_domain.quadratic import Step, lagrangian_slope, solve_step

SIZES = np.array([0.8, 0.3, 1.0])
LOW, HIGH = np.array([0.0, 0.0, 0.3]), np.array([5.0, 5.0, 1.5])
NONE, NO_SLOPES = np.zeros(0), np.zeros((0, 3))
#: of the improvement that the step promises: rows that are missed by less are not added
EXACT = 3e-3


@dataclass(frozen=True)
class Question:
    """Arguments of `solve_step`."""

    model: Model
    hessian: np.ndarray
    radius: float = 0.3
    scale: float = 2.0
    penalty: float = 10.0

    def step(self) -> Step:
        found = solve_step(self.model, self.hessian, SIZES, self.radius, self.room, self.scale, self.penalty)
        assert found is not None
        return found

    @property
    def room(self) -> tuple[np.ndarray, np.ndarray]:
        """From the gains to the ends of their ranges."""
        gains = np.array([self.model.gains.kp, self.model.gains.ki, self.model.gains.alpha])
        return LOW - gains, HIGH - gains

    @property
    def ends(self) -> tuple[np.ndarray, np.ndarray]:
        """Of d."""
        low, high = self.room
        return np.maximum(-self.radius * SIZES, low), np.minimum(self.radius * SIZES, high)

    def cost(self, d: np.ndarray) -> float:
        """What is minimised, by its definition."""
        aims = [*(self.model.aims + self.model.aim_slopes @ d)]
        rows = [0.0, *(self.model.values + self.model.slopes @ d)]
        for each in self.model.sums:
            (aims if each.row < 0 else rows).append(
                each.weight * np.abs(each.errors + each.slopes @ d).sum() + each.offset
            )
        x = d / SIZES
        return max(aims, default=0.0) / self.scale + self.penalty * max(rows) + 0.5 * x @ self.hessian @ x


def question(seed: int, aims: int, rows: int, sums: int, curved: bool) -> Question:
    """A random model; gains at the end of a range every third time."""
    rng = np.random.default_rng(seed)
    gains = FoPi(0.0 if seed % 3 == 0 else 1.1, 0.6, 1.5 if seed % 3 == 1 else 0.9)
    added = []
    for k in range(sums):
        n = int(rng.integers(5, 60))
        of_row = k % 2 == 1
        offset = -float(rng.uniform(0.0, 3.0)) if of_row else float(rng.normal())
        added.append(
            Sum(rng.normal(size=n), rng.normal(size=(n, 3)), float(rng.uniform(0.05, 0.3)), offset, k if of_row else -1)
        )
    half = rng.normal(size=(3, 3))
    model = Model(
        gains, rng.normal(size=rows) - 1.0, rng.normal(size=(rows, 3)), np.zeros(rows, dtype=np.int64),
        rng.normal(size=aims), rng.normal(size=(aims, 3)), tuple(added), 0.0,
    )  # fmt: skip
    return Question(model, half @ half.T if curved else np.zeros((3, 3)))


#: counts of aims, rows and sums
SHAPES = [(30, 40, 0), (0, 25, 1), (3, 200, 4), (1, 0, 0), (0, 50, 0), (400, 3000, 2), (0, 30, 3)]


def least_linear(asked: Question) -> float:
    """Without curvature: a linear program in d, t, s and one number for each absolute value."""
    model, n = asked.model, 5 + sum(len(each.errors) for each in asked.model.sums)
    left, right = [], []

    def less(d: np.ndarray, t: float, s: float, constant: float, others: dict[int, float] | None = None) -> None:
        row = np.zeros(n)
        row[:3], row[3], row[4] = d, t, s
        for k, value in (others or {}).items():
            row[k] = value
        left.append(row)
        right.append(-constant)

    for value, slope in zip(model.aims, model.aim_slopes, strict=True):
        less(slope, -1.0, 0.0, value)
    for value, slope in zip(model.values, model.slopes, strict=True):
        less(slope, 0.0, -1.0, value)
    first = 5
    for each in model.sums:
        own = range(first, first + len(each.errors))
        for k, error, slope in zip(own, each.errors, each.slopes, strict=True):
            less(slope, 0.0, 0.0, error, {k: -1.0})
            less(-slope, 0.0, 0.0, -error, {k: -1.0})
        of_aim = each.row < 0
        less(
            np.zeros(3), -1.0 if of_aim else 0.0, 0.0 if of_aim else -1.0, each.offset, dict.fromkeys(own, each.weight)
        )
        first += len(each.errors)
    has_aim = len(model.aims) > 0 or any(each.row < 0 for each in model.sums)
    low, high = asked.ends
    bounds = [*zip(low, high, strict=True), (None, None) if has_aim else (0.0, 0.0), (0.0, None)]
    cost = np.zeros(n)
    cost[3], cost[4] = 1.0 / asked.scale if has_aim else 0.0, asked.penalty
    found = linprog(cost, np.array(left), np.array(right), bounds=[*bounds, *[(0.0, None)] * (n - 5)], method="highs")
    assert found.status == 0
    return float(found.fun)


def least_curved(asked: Question) -> float:
    """By many small steps of a pattern search with random directions; the cost is convex."""
    rng, (low, high) = np.random.default_rng(1), asked.ends
    best, value, reach = np.clip(np.zeros(3), low, high), np.inf, 1.0
    value = asked.cost(best)
    while reach > 1e-7:
        directions = rng.normal(size=(300, 3)) * (high - low)
        tried = np.clip(best + reach * directions, low, high)
        costs = np.array([asked.cost(d) for d in tried])
        k = int(costs.argmin())
        if costs[k] < value:
            best, value = tried[k], float(costs[k])
        else:
            reach *= 0.6
    return value


@pytest.mark.parametrize("shape", SHAPES, ids=str)
@pytest.mark.parametrize("seed", range(3))
def test_a_step_of_linear_pieces_is_the_linear_programs(seed: int, shape: tuple[int, int, int]) -> None:
    asked = question(seed, *shape, curved=False)
    step, least = asked.step(), least_linear(asked)
    promised = asked.cost(np.zeros(3)) - least
    assert least - 1e-8 <= asked.cost(step.d) <= least + EXACT * promised + 1e-8
    low, high = asked.ends
    assert np.all((step.d >= low - 1e-9) & (step.d <= high + 1e-9))
    # what it says of itself
    assert step.expected == pytest.approx(least, abs=EXACT * promised + 1e-7)


@pytest.mark.thinned(4)
@pytest.mark.parametrize("shape", [(30, 40, 0), (3, 20, 2), (0, 30, 3)], ids=str)
@pytest.mark.parametrize("seed", range(2))
def test_a_curved_step_is_found_by_no_search_to_be_worse(seed: int, shape: tuple[int, int, int]) -> None:
    asked = question(seed, *shape, curved=True)
    step, least = asked.step(), least_curved(asked)
    promised = asked.cost(np.zeros(3)) - least
    assert asked.cost(step.d) <= least + EXACT * promised + 1e-8
    x = step.d / SIZES
    assert step.expected + 0.5 * x @ asked.hessian @ x == pytest.approx(least, abs=EXACT * promised + 1e-5)


@pytest.mark.parametrize("curved", [False, True])
@pytest.mark.parametrize("shape", SHAPES, ids=str)
@pytest.mark.parametrize("seed", range(3))
def test_multipliers_make_the_step_stationary(seed: int, shape: tuple[int, int, int], curved: bool) -> None:
    asked = question(seed, *shape, curved=curved)
    step, model = asked.step(), asked.model
    of_aims = step.aim_prices.sum() + sum(p for p, s in zip(step.sum_prices, model.sums, strict=True) if s.row < 0)
    of_rows = step.row_prices.sum() + sum(p for p, s in zip(step.sum_prices, model.sums, strict=True) if s.row >= 0)
    has_aim = len(model.aims) > 0 or any(each.row < 0 for each in model.sums)
    assert of_aims == pytest.approx(1.0 if has_aim else 0.0, abs=1e-6)
    assert of_rows <= asked.penalty * (1.0 + 1e-6)
    if step.slack > 1e-5:
        assert of_rows == pytest.approx(asked.penalty, rel=1e-5)
    assert min([*step.aim_prices, *step.row_prices, *step.sum_prices], default=0.0) >= -1e-9
    gradient = lagrangian_slope(model, step, asked.scale) * SIZES + asked.hessian @ (step.d / SIZES)
    low, high = asked.ends
    for k in range(3):
        at_low, at_high = step.d[k] <= low[k] + 1e-6, step.d[k] >= high[k] - 1e-6
        # towards the inside nothing is gained to first order
        assert gradient[k] >= -1e-5 or at_high
        assert gradient[k] <= 1e-5 or at_low


def test_a_fixed_gain_does_not_move() -> None:
    asked = question(2, 30, 40, 1, curved=True)
    low, high = asked.room
    low[1] = high[1] = 0.0
    found = solve_step(asked.model, asked.hessian, SIZES, 0.3, (low, high), 2.0, 10.0)
    assert found is not None
    assert abs(found.d[1]) < 1e-9


def test_the_shortest_way_back_to_limits() -> None:
    """One row and the distance for curvature: the step is the row's normal."""
    slope = np.array([1.0, 2.0, -0.5])
    row = Model(
        FoPi(1.0, 0.6, 0.9), np.array([0.05]), slope[None, :], np.zeros(1, dtype=np.int64), NONE, NO_SLOPES, (), 0.0
    )
    step = Question(row, np.eye(3), penalty=1e5).step()
    scaled = slope * SIZES
    np.testing.assert_allclose(step.d / SIZES, -0.05 * scaled / (scaled @ scaled), atol=1e-6)
    assert step.slack == pytest.approx(0.0, abs=1e-6)


def test_a_models_own_numbers() -> None:
    asked = question(1, 4, 6, 2, curved=False)
    at_0 = asked.cost(np.zeros(3))
    model = asked.model
    assert model.objective / asked.scale + asked.penalty * model.violation == pytest.approx(at_0)
    # limits of the loop over the family count beside the rows
    assert replace(model, loop_violation=7.0).violation == 7.0
    nothing = Model(model.gains, NONE, NO_SLOPES, np.zeros(0, dtype=np.int64), NONE, NO_SLOPES, (), 0.0)
    assert (nothing.objective, nothing.violation) == (-np.inf, 0.0)
