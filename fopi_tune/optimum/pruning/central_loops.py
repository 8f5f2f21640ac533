"""The controllers at the centres of boxes with some plants, and how their crossings vary over the boxes.

Where |L| = 1 the angle b = 180 deg + arg L varies with the coordinates as

    db/dg = Im(C_g/C) - (arg L)_u/(ln|L|)_u Re(C_g/C) ,                                                            (1)

and the crossover moves by -Re(C_g/C)/(ln|L|)_u.  All in floating point.

Source: derived by the implicit function theorem from ln|L| = 0.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from fopi_tune.core.bode_form import Array, Complex, Rows
from fopi_tune.core.crossings import Crossings
from fopi_tune.core.loops import Loops
from fopi_tune.optimum.problem import Problem
from fopi_tune.optimum.pruning.exclusion import Reason
from fopi_tune.optimum.pruning.screen import Boxes, gains_at, taylor_models

_LEAST_WIDTH, _FLATTEST = 1e-9, 1e-9


@dataclass(frozen=True)
class Suggestion:
    """One reason for one box.

    Args:
        row: the box.
        ratio: as in `fopi_tune.optimum.pruning.screen`.
        axis: along which the condition varies most; -1 where that is not known.
        reason: to be tested.
        excess: violation of the condition at the centre, neper or radian; negative where it is met.
        slopes: derivatives of the violation along the coordinates, times the half-widths; empty where not known.
        rest: about what these slopes leave of the violation.
    """

    row: int
    ratio: float
    axis: int
    reason: Reason
    excess: float = 1.0
    slopes: tuple[float, ...] = ()
    rest: float = 0.0


@dataclass(frozen=True)
class CentralLoops:
    """Every box's central controller with every plant; row = box * plants + plant."""

    boxes: Boxes
    points: list[tuple[float, ...]]
    loops: Loops
    problem: Problem

    @classmethod
    def of(cls, problem: Problem, boxes: Boxes, points: list[tuple[float, ...]]) -> CentralLoops:
        """Of n boxes and these plants."""
        places = np.array(points, dtype=float).reshape(len(points), -1)
        loops = gains_at(problem.parametrization, boxes.middle).loops(problem, places)
        return cls(boxes, points, loops, problem)

    def movements(self, found: Crossings) -> Movements:
        """Of crossings of these loops."""
        box, plant = np.divmod(found.row, len(self.points))
        log_s: Complex = np.asarray(found.u[:, None] + 0.5j * np.pi, dtype=complex)
        at = taylor_models(self.problem.parametrization, self.boxes.take(box), log_s)
        half = self.boxes.half[box]
        slopes = np.stack([s[:, 0] / at.value[:, 0] * half[:, k] for k, s in enumerate(at.slopes)], axis=1)
        along = self.loops.log_response_and_slope(found.row, found.u)[1]
        return Movements(found, slopes, along, box, plant)


@dataclass(frozen=True)
class Movements:
    """How n crossings vary over their boxes.

    Args:
        found: the crossings at the centres.
        slopes: d ln L along each of k coordinates times the half-widths, shape (n, k).
        along: d ln L/du, shape (n,).
        box: of each crossing, shape (n,).
        plant: the same.
    """

    found: Crossings
    slopes: Complex
    along: Complex
    box: Rows
    plant: Rows

    @cached_property
    def steep(self) -> Array:
        """d ln|L|/du, kept away from 0, shape (n,)."""
        return _away_from_zero(self.along.real)

    def angle(self, rate: float = 0.0) -> Array:
        """Changes of b less rate omega at gain crossovers, by (1), shape (n, k)."""
        turns = self.along.imag - rate * self.found.omega_rad_s
        return self.slopes.imag - (turns / self.steep)[:, None] * self.slopes.real

    @property
    def log_gain(self) -> Array:
        """Changes of ln|L| at phase crossovers, shape (n, k)."""
        return self.slopes.real - (self.along.real / _away_from_zero(self.along.imag))[:, None] * self.slopes.imag

    @cached_property
    def of_gain_crossovers(self) -> Array:
        """How far gain crossovers move in u, shape (n,)."""
        return self._moves(self.slopes.real, self.steep)

    @property
    def of_phase_crossovers(self) -> Array:
        """How far phase crossovers move in u, shape (n,)."""
        return self._moves(self.slopes.imag, _away_from_zero(self.along.imag))

    @cached_property
    def size(self) -> Array:
        """Change of |ln L|, shape (n,)."""
        return np.abs(self.slopes).sum(axis=1)

    @property
    def rest(self) -> Array:
        """About what first derivatives leave of these changes."""
        return 0.5 * np.minimum(self.size, 1.0) ** 2

    def _moves(self, parts: Array, steep: Array) -> Array:
        """To first order, and something for the second."""
        return (np.abs(parts).sum(axis=1) + self.rest) / np.abs(steep) + _LEAST_WIDTH


def _away_from_zero(slope: Array) -> Array:
    return np.where(np.abs(slope) > _FLATTEST, slope, _FLATTEST)
