"""What a loop is made of, in ball arithmetic:  the controller's numbers, and the box of its plants."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

from flint import acb, arb

from fopi_tune.core.controller import FoPi
from fopi_tune.core.plant import PlantFamily
from fopi_tune.proof.balls.box import Interval


@dataclass(frozen=True)
class LoopParameters:
    """One controller and a family of plants.

    Args:
        gains: the controller.
        family: the plants.
    """

    gains: FoPi
    family: PlantFamily

    @cached_property
    def axes(self) -> int:
        """Axes of a box: u and the uncertain numbers."""
        return 1 + len(self.family.uncertain_names)

    @property
    def family_box(self) -> tuple[Interval, ...]:
        """The box of the uncertain numbers."""
        return tuple(zip(self.family.low.tolist(), self.family.high.tolist(), strict=True))

    @cached_property
    def kp(self) -> arb:
        """Proportional gain."""
        return arb(self.gains.kp)

    @cached_property
    def ki(self) -> arb:
        """Integral gain."""
        return arb(self.gains.ki)

    @cached_property
    def alpha(self) -> arb:
        """Order of the integral."""
        return arb(self.gains.alpha)

    @cached_property
    def turn(self) -> acb:
        """j^alpha."""
        angle = self.alpha * arb.pi() / 2
        return acb(angle.cos(), angle.sin())

    @cached_property
    def integral(self) -> acb:
        """ki j^-alpha."""
        return self.ki / self.turn
