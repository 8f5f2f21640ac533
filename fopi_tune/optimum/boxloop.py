"""The loop of every controller of a box at once: the proof's own loop, with balls in place of the gains."""

from __future__ import annotations

import math

from flint import arb

from fopi_tune.core.controller import FoPi
from fopi_tune.core.plant import PlantFamily
from fopi_tune.optimum.charts import Patch
from fopi_tune.proof.balls.box import Interval
from fopi_tune.proof.balls.crossings import is_off
from fopi_tune.proof.balls.loop import BallLoop
from fopi_tune.proof.balls.plant import PlantBalls

#: cells of a walk along the frequency axis, and where a tail begins
_MOST_CELLS = 400
_NARROWEST = 1e-6
_STEP = 3.0


class BoxLoop(BallLoop):
    """Controllers with gains in balls, and a family of plants.

    `gains` are some floating-point gains of the box: they say only which gains are 0, so neither ball may hold 0 unless
    it is exactly 0.
    """

    @classmethod
    def of(cls, patch: Patch, family: PlantFamily, whole: bool = True) -> BoxLoop | None:
        """The loop of a patch, or of its centre; None where a gain may be 0 or not."""
        balls = (patch.kp, patch.ki, patch.alpha) if whole else patch.centre
        if any(ball.contains(0) and not ball.is_zero() for ball in balls[:2]) or all(b.is_zero() for b in balls[:2]):
            return None
        kp, ki, alpha = (float(ball.mid()) for ball in balls)
        loop = cls(FoPi(kp, ki, alpha), family)
        loop.__dict__.update(kp=balls[0], ki=balls[1], alpha=balls[2])
        return loop


def crosses_nowhere(loop: BallLoop, plant: PlantBalls, low: float, high: float, only_below: bool = False) -> bool:
    """Whether no controller makes |L| = 1 anywhere in an interval of u, which may be a tail or the whole axis.

    Args:
        loop: the controllers.
        plant: the plants.
        low: lower end.
        high: upper end.
        only_below: ask for |L| < 1, not only for |L| != 1.
    """
    pending: list[Interval] = [(low, high)]
    cells = 0
    while pending:
        cells += 1
        u = pending.pop()
        first, last = u
        if not (math.isinf(first) and math.isinf(last)):
            over = loop.balls(u, plant)
            if is_off(over) and (not only_below or bool(over.size < 1)):
                continue
        if cells > _MOST_CELLS or (last - first) < _NARROWEST or abs(first if math.isinf(last) else last) > 100.0:
            return False
        if math.isinf(first):
            middle = 0.0 if math.isinf(last) else last - _STEP
        else:
            middle = first + _STEP if math.isinf(last) else 0.5 * (first + last)
        pending += [(first, middle), (middle, last)]
    return True


def is_the_only_crossing(loop: BallLoop, plant: PlantBalls, u: float) -> bool:
    """Whether |L| = 1 at a place (which is known) and nowhere below it, for every controller.

    |L| falls strictly on cells that follow each other downwards from the place, so that it is larger than 1 there; from
    then on it stays larger.
    """
    first, width = u, 0.25
    for _ in range(_MOST_CELLS):
        slope = loop.balls((first - width, first), plant).log_slope.real
        if slope < 0:
            first, width = first - width, 2.0 * width
            below = loop.balls((first, first), plant).gain
            if below.abs_lower() > 1 and crosses_nowhere(loop, plant, -math.inf, first):
                return True
            continue
        width /= 4.0
        if width < _NARROWEST:
            return False
    return False
