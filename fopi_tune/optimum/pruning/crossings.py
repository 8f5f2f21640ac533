"""Where the gain crossovers of every controller of a box can be, with one plant."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

from flint import arb

from fopi_tune.core.peaks import Response
from fopi_tune.optimum.parametrization import ControllerBox
from fopi_tune.optimum.problem import Problem
from fopi_tune.optimum.pruning.loop_gain_bounds import LoopGainBounds
from fopi_tune.optimum.pruning.response_bounds import lower_bound, quadratic
from fopi_tune.proof.balls.box import Interval

#: steps in u by which a bracket is widened where |L| decreases
_STEPS = (3.0, 1.0, 0.3, 0.1, 0.03, 0.01, 0.003)
#: in u; more than logarithms are rounded
_ROUNDING = 1e-12


@dataclass(frozen=True)
class GainCrossovers:
    """Gain crossovers of one plant.

    Args:
        problem: gives the plant's responses.
        controllers: the box.
        point: the plant.
        bounds: of |L|, for the controllers of the box that are in question.
    """

    problem: Problem
    controllers: ControllerBox
    point: tuple[float, ...]
    bounds: LoopGainBounds

    @classmethod
    def of(
        cls, problem: Problem, controllers: ControllerBox, point: tuple[float, ...], whole: bool = False
    ) -> GainCrossovers:
        """Of the controllers that the spec's ranges allow; with `whole`, of all controllers of the box."""
        return cls(problem, controllers, point, LoopGainBounds.of(problem, controllers, point, whole))

    def sign_of_log_gain(self, omega: float) -> int:
        """1 where |L| > 1 for every controller, -1 where |L| < 1, else 0."""
        log_s, p = self.problem.response(self.point, omega)
        taylor_model, half = self.controllers.taylor_model(log_s), self.controllers.half
        if lower_bound(quadratic(Response.LOOP_GAIN, p, arb(1), True), taylor_model, half) > 0:
            return 1
        return -1 if lower_bound(quadratic(Response.LOOP_GAIN, p, arb(1), False), taylor_model, half) > 0 else 0

    @property
    def _known(self) -> float | None:
        """The frequency that is a crossover of every controller."""
        return self.problem.crossover_rad_s if self.point == self.problem.nominal else None

    def has_one_in(self, bracket: Interval) -> bool:
        """Whether every controller has one between two frequencies."""
        low, high = bracket
        if self._known is not None and low <= self._known <= high:
            return True
        return low < high and self.sign_of_log_gain(low) * self.sign_of_log_gain(high) < 0

    def are_in(self, brackets: Sequence[Interval], falls: bool = False) -> bool:
        """Whether no controller has one outside some brackets of frequencies; without any, whether none has any.

        Args:
            brackets: in ascending order, apart from each other.
            falls: whether also |L| < 1 above the last.
        """
        ends = [self._widened(bracket) for bracket in brackets]
        edges = [-math.inf, *(u for each in ends for u in each), math.inf]
        if not all(low < high for low, high in brackets) or not all(a[1] < b[0] for a, b in pairwise(brackets)):
            return False
        gaps = list(zip(edges[::2], edges[1::2], strict=True))
        # a gap that both of its brackets were widened over is empty
        return all(
            low >= high or self.bounds.has_no_crossover(low, high, only_below=falls and math.isinf(high))
            for low, high in gaps
        )

    def highest_is_in(self, bracket: Interval) -> bool:
        """Whether the highest one of every controller is between two frequencies."""
        return self.has_one_in(bracket) and self.bounds.has_no_crossover(self._widened(bracket)[1], math.inf)

    def are_below_unless_at(self, omega: float) -> bool:
        """Whether a controller has crossovers above a frequency only if |L| > 1 there: |L| falls from there on."""
        u = self.problem.u_interval((omega, omega))[0] - _ROUNDING
        # next to the frequency |L| only falls, farther it stays below 1
        reach = next((step for step in (1.0, *_STEPS) if self.bounds.is_decreasing((u, u + step))), None)
        return reach is not None and self.bounds.has_no_crossover(u + reach, math.inf, only_below=True)

    def _widened(self, bracket: Interval) -> Interval:
        """ln of a bracket's ends, moved outwards over where |L| cannot be 1.

        Next to the bracket values do not settle the cells, but where |L| decreases it cannot return to 1.
        """
        inner = [self.problem.u_interval((omega, omega)) for omega in bracket]
        low, high = inner[0][1] + _ROUNDING, inner[1][0] - _ROUNDING
        decreases = self.bounds.is_decreasing
        if self._sign_at_end(bracket, 0) > 0:
            low -= next((step for step in _STEPS if decreases((low - step, low + 2.0 * _ROUNDING))), 0.0)
        if self._sign_at_end(bracket, 1) < 0:
            high += next((step for step in _STEPS if decreases((high - 2.0 * _ROUNDING, high + step))), 0.0)
        return low, high

    def _sign_at_end(self, bracket: Interval, end: int) -> int:
        """The sign of ln|L| at an end of a bracket, for every controller; 0 where it is not known."""
        if self._known is not None and bracket[0] < self._known < bracket[1]:
            # |L| = 1 at the fixed crossover, and |L| decreases from there
            u, far = (self.problem.u_interval((omega, omega)) for omega in (self._known, bracket[end]))
            span = (far[0] - _ROUNDING, u[1] + _ROUNDING) if end == 0 else (u[0] - _ROUNDING, far[1] + _ROUNDING)
            if self.bounds.is_decreasing(span):
                return -1 if end else 1
        return self.sign_of_log_gain(bracket[end])
