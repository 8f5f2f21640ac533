"""The loop of every controller of a box at once: the proof's own loop, with balls in place of the gains."""

from __future__ import annotations

from fopi_tune.core.controller import FoPi
from fopi_tune.core.plant import PlantFamily
from fopi_tune.optimum.charts import Patch
from fopi_tune.proof.balls.loop import BallLoop


class BoxLoop(BallLoop):
    """Controllers with gains in balls, and a family of plants.

    `gains` are some floating-point gains of the box: they say only which gains are exactly 0.  ki may not be 0 or not:
    without it there is no integral, and the number of poles is another.
    """

    @classmethod
    def of(cls, patch: Patch, family: PlantFamily, whole: bool = True) -> BoxLoop | None:
        """The loop of a patch, or of its centre; None where ki may be 0 or not."""
        balls = (patch.kp, patch.ki, patch.alpha) if whole else patch.centre
        kp, ki, alpha = (float(ball.mid()) for ball in balls)
        if (ki == 0.0 and not balls[1].is_zero()) or (balls[1].contains(0) and ki != 0.0) or kp == ki == 0.0:
            return None
        if kp == 0.0 and not balls[0].is_zero():
            kp = float(balls[0].upper())
        loop = cls(FoPi(kp, ki, alpha), family)
        loop.__dict__.update(kp=balls[0], ki=balls[1], alpha=balls[2])
        return loop
