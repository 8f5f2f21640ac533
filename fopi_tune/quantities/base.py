"""The interface of a quantity that a requirement can limit.

Slacks are measured in natural units (neper for gains and frequencies, radian for angles), the units of the real and the
imaginary part of ln L = ln|L| + j arg L, so that slacks of different quantities can be compared.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass
from enum import Enum
from typing import Any, Protocol

import numpy as np

from fopi_tune.core.bode_form import Array, Rows
from fopi_tune.core.loops import Loops
from fopi_tune.core.margins import Crossings

NEPER_PER_DB = math.log(10.0) / 20.0


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
        """arg L, unwrapped."""
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
    def log_omega(self) -> Any:
        """ln(omega / (rad/s))."""
        ...

    @property
    def omega_rad_s(self) -> Any:
        """omega."""
        ...


@dataclass(frozen=True)
class Measured:
    """The values of a quantity for m loops; shapes (m,).

    Args:
        value: in the quantity's public unit; nan where a loop has no gain crossover and so no such quantity; inf for an
            infinite gain margin.
        omega_rad_s: the frequency at which that value occurs; 0, inf or nan where there is none.
    """

    value: Array
    omega_rad_s: Array


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
    def measure(self, loops: Loops, largest: bool, from_rad_s: float, to_rad_s: float) -> Measured:
        """The exact value of every loop; of a frequency function the largest or smallest over the band.

        Args:
            loops: m loops.
            largest: of a frequency function, the largest value instead of the smallest.
            from_rad_s: lower end of the band; 0 is all low frequencies.
            to_rad_s: upper end; infinite is all high frequencies.

        Returns:
            Values and their frequencies, shape (m,).
        """

    def check_limit(self, limit: float) -> str | None:
        """An error message for a limit that is never valid, or None; `limit` is in the public unit."""
        return None


def smallest_by_row(crossings: Crossings, values: Array, rows: int) -> Measured:
    """The smallest value over the crossings of each loop."""
    order = np.lexsort((values, crossings.row))
    return _first_by_row(crossings, values, rows, order)


def highest_by_row(crossings: Crossings, values: Array, rows: int) -> Measured:
    """The value at the highest crossing of each loop."""
    order = np.lexsort((-crossings.omega_rad_s, crossings.row))
    return _first_by_row(crossings, values, rows, order)


def _first_by_row(crossings: Crossings, values: Array, rows: int, order: Rows) -> Measured:
    value, omega = np.full(rows, np.nan), np.full(rows, np.nan)
    found, first = np.unique(crossings.row[order], return_index=True)
    value[found], omega[found] = values[order][first], crossings.omega_rad_s[order][first]
    return Measured(value, omega)
