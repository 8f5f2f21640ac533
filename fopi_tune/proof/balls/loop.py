"""L = C P over boxes of frequencies and plants, in ball arithmetic:  what holds for the balls holds for every member.

`BallLoop` is the controller with its family; the responses over one box are in `fopi_tune.proof.balls.responses`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property

from flint import acb, arb, ctx

from fopi_tune.core.bode_form import Array
from fopi_tune.core.controller import derivative_of
from fopi_tune.core.fractional_plants.family import fractional_part
from fopi_tune.core.loops import Loops, Plants
from fopi_tune.proof.balls.box import (
    Box,
    Cuts,
    Interval,
    axes_without_width,
    ball_of,
    centre_of,
    is_tail,
    log_interval,
    point_box,
)
from fopi_tune.proof.balls.computed_once import computed_once
from fopi_tune.proof.balls.controllers import ControllerOnInterval, FoPiStructure, LoopParameters, Structure
from fopi_tune.proof.balls.fopid import FoPidStructure
from fopi_tune.proof.balls.fractional_plants.responses import FractionalLoopEnclosure, least_gap
from fopi_tune.proof.balls.pid import PidStructure
from fopi_tune.proof.balls.plant import FractionalEnclosure, PlantEnclosure, assemble, filtered, without_axes
from fopi_tune.proof.balls.responses import LoopEnclosure

#: bits of the balls' centres
PRECISION = 64
#: plants in the cache of a loop, and intervals of u; a plant of order 4 on samples takes some 20 kB
_MOST_KNOWN = 4096


@dataclass
class _Cache:
    """Enclosures of plants by precision and box, of the controller by precision and interval of u.

    Args:
        work: the counted effort of all the plants that were computed.
    """

    known: dict[tuple[int, Box], PlantEnclosure] = field(default_factory=dict)
    controllers: dict[tuple[int, Interval], ControllerOnInterval] = field(default_factory=dict)
    work: int = 0


@dataclass(frozen=True)
class BallLoop(LoopParameters):
    """One controller with a family of plants."""

    @cached_property
    def structure(self) -> Structure:
        """What the structure of the controller is; without a derivative kp + ki s^-alpha."""
        kd, mu, _ = derivative_of(self.gains)
        if kd == 0.0:
            return FoPiStructure(self)
        return PidStructure(self) if self.gains.alpha == 1.0 and mu == 1.0 else FoPidStructure(self)

    def controller(self, u: arb) -> tuple[acb, acb]:
        """C and d ln C/du over a ball of u."""
        return self.structure.value_and_slope(u)

    # -- the frequency axis -------------------------------------------------------------------------------------------

    def u_of(self, log_omega: float) -> float:
        """u at a frequency given by ln omega."""
        return log_omega

    def inner_u_of(self, log_omega: float, upper: bool) -> float:
        """u_of, rounded down for an upper limit and up for a lower one: the strict side of the limit."""
        return log_omega

    def band(self, from_rad_s: float, to_rad_s: float) -> Interval:
        """Interval of u that contains a band of frequencies."""
        return log_interval(from_rad_s, to_rad_s)

    def frequency(self, omega: arb) -> arb:
        """The frequency in rad/s at e^u."""
        return omega

    def stretch(self, omega: arb) -> arb:
        """d ln frequency/du at e^u."""
        return arb(1)

    @property
    def farthest_u(self) -> float:
        """|u| beyond which only the leading terms matter."""
        farthest = self.structure.farthest_u
        family = fractional_part(self.family)
        return farthest if family is None else farthest / least_gap(family.orders)

    def has_upper_limit(self, over: LoopEnclosure) -> bool:
        """Whether L has a limit at the upper end of the axis: not with a dead time."""
        return over.delay is None

    def is_beyond(self, omega_rad_s: float) -> bool:
        """Whether a frequency is the upper end of the axis."""
        return math.isinf(omega_rad_s)

    @cached_property
    def cuts(self) -> Cuts:
        """Where the plants are not continuous in an uncertain number: none in continuous time."""
        return {}

    def plant(self, theta: Sequence[arb]) -> PlantEnclosure:
        """The plants whose uncertain numbers lie in these balls, with the measurement filter.

        Raises:
            DomainError: not proper.
        """
        return filtered(assemble(self.family, theta), self.filter_bottom)

    def loops_at(self, points: Array) -> Loops:
        """The same loops in floating point for these plants, shape (m, p); used only to choose what to examine."""
        return Loops.of(self.gains, Plants.members(self.family, points))

    def plants(self, box: Box) -> PlantEnclosure:
        """The plants whose uncertain numbers lie in a box; cached, since splits along u do not change them."""
        cache, key = self._cache, (ctx.prec, box)
        found = cache.known.get(key)
        if found is None:
            if len(cache.known) >= _MOST_KNOWN:
                cache.known.clear()
            found = cache.known[key] = self.plants_over(box)
            cache.work += self._plant_work
        return found

    def plants_over(self, box: Box) -> PlantEnclosure:
        """The plants of a box, without the cache, with the derivatives along the axes that have a width."""
        return without_axes(self.plant([ball_of(side) for side in box]), axes_without_width(box))

    @property
    def work(self) -> int:
        """Counted effort of all the plants computed so far, in boxes of a bound; see `BoxVerdict`."""
        return self._cache.work

    @cached_property
    def _plant_work(self) -> int:
        """Of one more enclosure of the plants: in continuous time it is part of the box's own."""
        return 0

    @computed_once
    def _cache(self) -> _Cache:
        return _Cache()

    def enclosure(self, u: Interval, plant: PlantEnclosure) -> LoopEnclosure:
        """The loop with these plants over an interval of u."""
        made = FractionalLoopEnclosure if isinstance(plant, FractionalEnclosure) else LoopEnclosure
        return made(self, self.controller_on(u), plant)

    def controller_on(self, u: Interval) -> ControllerOnInterval:
        """C over an interval of u; cached, since splits along the plants do not change it."""
        known, key = self._cache.controllers, (ctx.prec, u)
        found = known.get(key)
        if found is None:
            if len(known) >= _MOST_KNOWN:
                known.clear()
            found = known[key] = self.new_controller_on(u)
        return found

    def new_controller_on(self, u: Interval) -> ControllerOnInterval:
        """C over an interval of u, without the cache."""
        return self.structure.on_interval(u)

    def over(self, box: Box) -> LoopEnclosure:
        """The loop over a box, tails included."""
        return self.enclosure(box[0], self.plants(box[1:]))

    def at_centre(self, box: Box) -> LoopEnclosure:
        """The loop at the centre of a box; in a tail the whole tail with the central plant."""
        u = box[0]
        if not is_tail(u):
            middle = centre_of((u,))[0]
            u = (middle, middle)
        return self.enclosure(u, self.plants(point_box(centre_of(box[1:]))))
