"""The loop of the controller at a box's centre:  the proof's own loop, with balls in place of the gains.

More dead time may be added to its plants: a delay margin is the dead time up to which a loop stays stable.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from flint import arb

from fopi_tune.core.controller import FoPi
from fopi_tune.core.plant import PlantFamily
from fopi_tune.core.terms.measurement_filter import MeasurementFilter
from fopi_tune.optimum.parametrization import ControllerBox
from fopi_tune.optimum.samples.filter_of_order import FilterOfOrder
from fopi_tune.optimum.samples.gains import BoxOnSamples
from fopi_tune.proof.balls.loop import BallLoop
from fopi_tune.proof.balls.plant import Dual, PlantEnclosure
from fopi_tune.proof.balls.sampled import SampledBallLoop
from fopi_tune.proof.balls.sampled_controllers import Sections

_ZERO = arb(0)


@dataclass(frozen=True)
class SampledBoxLoop(SampledBallLoop):
    """The same on samples, without more dead time; `implementation` tells only the sample time and the delay.

    Args:
        filter: of s^-alpha.
        centre: kp, ki and alpha.
    """

    filter: FilterOfOrder
    centre: tuple[arb, arb, arb]

    @classmethod
    def of(cls, controllers: BoxOnSamples, unit_loop: BallLoop) -> SampledBoxLoop | None:
        """The loop of the controller at a box's centre; None where its gains are not told from 0."""
        kp, ki, alpha = controllers.centre
        gains = [0.0 if ball.is_zero() else float(ball.mid()) for ball in (kp, ki)]
        if not isinstance(unit_loop, SampledBallLoop) or (ki.contains(0) and not ki.is_zero()) or gains == [0.0, 0.0]:
            return None
        used = unit_loop.gains.measurement_filter
        controller = FoPi(gains[0], gains[1], float(alpha.mid()), measurement_filter=used)
        return cls(
            controller, unit_loop.family, unit_loop.implementation, controllers.filters.filter, controllers.centre
        )

    def compute_sections(self) -> Sections:
        kp, ki, alpha = self.centre
        return self.filter.at_order(alpha).sections(kp, ki)


@dataclass(frozen=True)
class BoxLoop(BallLoop):
    """A controller with gains in balls, and a family of plants behind more dead time.

    `gains` are floating-point gains: they only tell which gains are exactly 0.

    Args:
        delay_s: the additional dead time, s.
    """

    delay_s: arb = _ZERO

    @classmethod
    def of(
        cls, controllers: ControllerBox, family: PlantFamily, delay_s: arb = _ZERO,
        measurement_filter: MeasurementFilter | None = None,
    ) -> BoxLoop | None:  # fmt: skip
        """The loop of the controller at a box's centre; None where its gains are not told from 0."""
        pid = controllers.pid
        if pid is not None:
            return None if pid.is_zero else cls(replace(pid, measurement_filter=measurement_filter), family, delay_s)
        balls = controllers.centre
        kp, ki, alpha = (float(ball.mid()) for ball in balls)
        if (ki == 0.0 and not balls[1].is_zero()) or (balls[1].contains(0) and ki != 0.0) or kp == ki == 0.0:
            return None
        if kp == 0.0 and not balls[0].is_zero():
            kp = float(balls[0].upper())
        loop = cls(FoPi(kp, ki, alpha, measurement_filter=measurement_filter), family, delay_s)
        loop.__dict__.update(kp=balls[0], ki=balls[1], alpha=balls[2])
        return loop

    def plant(self, theta: Sequence[arb]) -> PlantEnclosure:
        found = super().plant(theta)
        dead_time = found.dead_time
        return replace(found, dead_time=Dual(dead_time.value + self.delay_s, dead_time.gradient))
