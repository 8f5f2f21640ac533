"""What a quantity is: one thing a requirement can limit.

Slacks are measured in natural units (neper for gains and frequencies, radian for angles), so that slacks of different
quantities can be compared: ln L = ln|L| + j arg L weighs both alike.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass
from enum import Enum
from typing import Any, Protocol

import numpy as np

from fopi_tune.core.logform import Array, Rows
from fopi_tune.core.loops import Loops
from fopi_tune.core.margins import Crossings

NEPER_PER_DB = math.log(10.0) / 20.0


class Where(Enum):
    """At which frequencies of a loop a quantity is read."""

    BAND = "every frequency of a band"
    GAIN_CROSSOVERS = "every gain crossover"
    HIGHEST_GAIN_CROSSOVER = "the highest gain crossover"
    PHASE_CROSSOVERS = "every phase crossover with |L| < 1"


class LoopSymbols(Protocol):
    """A loop at one frequency, in a solver's symbols or in arrays; all of them take + - * /."""

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
    """A quantity of m loops; shapes (m,).

    Args:
        value: in the quantity's public unit; nan where a loop has no gain crossover and so no such quantity; inf for a
            gain margin that does not end.
        omega_rad_s: the frequency that decides it; 0, inf or nan where there is none.
    """

    value: Array
    omega_rad_s: Array


class Quantity(ABC):
    """One thing a requirement can limit.

    Attributes:
        name: the word in the spec, unit included.
        where: at which frequencies it is read.
        meaning: one sentence for people; for a sensitivity, from which signal to which.
    """

    name: str
    where: Where
    meaning: str

    @property
    def takes_band(self) -> bool:
        """Whether it is a function of frequency (from_rad_s, to_rad_s, at_rad_s) or one number a loop."""
        return self.where is Where.BAND

    @abstractmethod
    def to_natural(self, value: float) -> float:
        """The value in neper or radian, increasing in `value`, which is in the public unit."""

    @abstractmethod
    def from_natural(self, value: float) -> float:
        """The inverse of `to_natural`: `value` in neper or radian to the public unit."""

    def natural_scale(self, limit: float) -> float:
        """What a slack against `limit`, in the public unit, is multiplied with to be dimensionless."""
        return 1.0

    @abstractmethod
    def natural(self, loop: LoopSymbols) -> Any:
        """The value in the unit of `to_natural`, in a solver's symbols, at one frequency."""

    @abstractmethod
    def measure(self, loops: Loops, largest: bool, from_rad_s: float, to_rad_s: float) -> Measured:
        """The exact value of every loop; of a frequency function the largest or smallest over the band.

        Args:
            loops: m loops.
            largest: of a frequency function, the largest value instead of the smallest.
            from_rad_s: lower end of the band; 0 is all low frequencies.
            to_rad_s: upper end; infinite is all high frequencies.

        Returns:
            Values and where, shape (m,).
        """

    def check_limit(self, limit: float) -> str | None:
        """What is wrong with `limit`, in the public unit, by itself, or None."""
        return None


def smallest_by_row(crossings: Crossings, values: Array, rows: int) -> Measured:
    """Of each loop the smallest of its crossings' values."""
    order = np.lexsort((values, crossings.row))
    return _first_by_row(crossings, values, rows, order)


def highest_by_row(crossings: Crossings, values: Array, rows: int) -> Measured:
    """Of each loop the value at its highest crossing."""
    order = np.lexsort((-crossings.omega_rad_s, crossings.row))
    return _first_by_row(crossings, values, rows, order)


def _first_by_row(crossings: Crossings, values: Array, rows: int, order: Rows) -> Measured:
    value, omega = np.full(rows, np.nan), np.full(rows, np.nan)
    found, first = np.unique(crossings.row[order], return_index=True)
    value[found], omega[found] = values[order][first], crossings.omega_rad_s[order][first]
    return Measured(value, omega)
