"""The loop of every controller of a box at once: the proof's own loop, with balls in place of the gains."""

from __future__ import annotations

from fopi_tune.core.controller import FoPi
from fopi_tune.core.plant import PlantFamily
from fopi_tune.optimum.charts import Patch
from fopi_tune.proof.balls.loop import BallLoop


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
