"""The interface of a quantity that a requirement can limit.

Slacks are measured in natural units (neper for gains and frequencies, radian for angles), the units of the real and the
imaginary part of ln L = ln|L| + j arg L, so that slacks of different quantities can be compared.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import replace
from enum import Enum
from typing import Any, Protocol

from fopi_tune.core.crossings import Crossings, gain_crossovers, phase_crossovers
from fopi_tune.core.loops import Loops
from fopi_tune.core.margins import Measured
from fopi_tune.core.peaks import Tilt
from fopi_tune.core.stability import is_stable

NEPER_PER_DB = math.log(10.0) / 20.0
#: measured: finding one crossing takes about as long as this many cells of a search for peaks
_CELLS_A_CROSSING = 10


class EvaluatedAt(Enum):
    """At which frequencies of a loop a quantity is evaluated."""

    BAND = "every frequency of a band"
    GAIN_CROSSOVERS = "every gain crossover"
    HIGHEST_GAIN_CROSSOVER = "the highest gain crossover"
    PHASE_CROSSOVERS = "every phase crossover with |L| < 1"


class LoopSymbols(Protocol):
    """A loop at one frequency, in a solver's symbols or in arrays; both support + - * /."""

    @property
    def log_gain(self) -> Any:
        """ln|L|."""
        ...

    @property
    def phase_rad(self) -> Any:
        """arg L; modulo a turn."""
        ...

    @property
    def phase_margin_rad(self) -> Any:
        """The angle between L and -1, on the side of -1 on which the loop is stable; negative on the other."""
        ...

    @property
    def lag_to_minus_one_rad(self) -> Any:
        """The lag that brings L to -1, less than a turn; negative where `phase_margin_rad` is, on that side."""
        ...

    @property
    def phase_slope_rad(self) -> Any:
        """d arg L / d ln omega."""
        ...

    @property
    def log_return_difference(self) -> Any:
        """ln|1 + L|."""
        ...

    @property
    def log_controller(self) -> Any:
        """ln|C|."""
        ...

    @property
    def log_plant(self) -> Any:
        """ln|P|."""
        ...

    @property
    def log_omega(self) -> Any:
        """ln(omega / (rad/s))."""
        ...

    @property
    def omega_rad_s(self) -> Any:
        """omega."""
        ...


class Quantity(ABC):
    """One thing a requirement can limit.

    Attributes:
        name: the word in the spec, unit included.
        where: at which frequencies it is evaluated.
        meaning: a short definition for people; for a sensitivity, from which signal to which.
    """

    name: str
    where: EvaluatedAt
    meaning: str

    #: whether it is a distance to -1, which an unstable loop has not
    is_margin = False

    @property
    def takes_band(self) -> bool:
        """Whether it is a function of frequency (from_rad_s, to_rad_s, at_rad_s) or one number a loop."""
        return self.where is EvaluatedAt.BAND

    @abstractmethod
    def to_natural(self, value: float) -> float:
        """`value` from the public unit to neper or radian; increasing."""

    @abstractmethod
    def from_natural(self, value: float) -> float:
        """`value` from neper or radian to the public unit."""

    def natural_scale(self, limit: float) -> float:
        """The factor that makes a slack in natural units dimensionless; `limit` is in the public unit."""
        return 1.0

    @abstractmethod
    def natural(self, loop: LoopSymbols) -> Any:
        """The value in natural units at one frequency, in a solver's symbols or in arrays."""

    @abstractmethod
    def measure(
        self, loops: Loops, largest: bool, from_rad_s: float, to_rad_s: float, tilt: Tilt | None = None
    ) -> Measured:
        """The exact value of every loop; of a frequency function the largest or smallest over the band.

        Args:
            loops: m loops.
            largest: of a frequency function, the largest value instead of the smallest.
            from_rad_s: lower end of the band; 0 is all low frequencies.
            to_rad_s: upper end; infinite is all high frequencies.
            tilt: of a frequency function, how it is looked at over a band with two ends.

        Returns:
            Values and their frequencies, shape (m,).
        """

    def check_limit(self, limit: float) -> str | None:
        """An error message for a limit that is never valid, or None; `limit` is in the public unit."""
        return None


class QuantityAtCrossings(Quantity):
    """A quantity that is read at gain crossovers or phase crossovers."""

    def measure(
        self, loops: Loops, largest: bool, from_rad_s: float, to_rad_s: float, tilt: Tilt | None = None
    ) -> Measured:
        crossovers = gain_crossovers(loops)
        crossings = phase_crossovers(loops) if self.where is EvaluatedAt.PHASE_CROSSOVERS else crossovers
        found = replace(self.at_crossings(loops, crossings), work=_CELLS_A_CROSSING * len(crossings.row))
        return found.where(is_stable(loops)) if self.is_margin else found

    @abstractmethod
    def at_crossings(self, loops: Loops, crossings: Crossings) -> Measured:
        """The value of every loop, public unit; of a margin, were the loop stable.

        Args:
            loops: m loops.
            crossings: all of their gain crossovers or, of a quantity at these, phase crossovers.

        Returns:
            Values and their frequencies, shape (m,).
        """
