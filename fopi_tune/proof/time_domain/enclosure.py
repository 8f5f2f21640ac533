"""The trajectories of every plant of a box, with the pattern of limited samples that fits them.

A pattern is guessed and then confirmed: under it v is enclosed at every sample, and v at a sample depends on earlier
samples only.  So if v keeps everywhere to what the pattern assumes, then by induction, sample after sample, the pattern
is that of every plant of the box.  A guess comes from simulations of a few plants, the next one from the enclosure
under the guess before.  The actuator's rate limit must not be reached.
"""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np

from fopi_tune.core.bode_form import Array
from fopi_tune.core.loops import Plants
from fopi_tune.proof.balls.box import Box, centre_of
from fopi_tune.proof.time_domain.case import TimeDomainCase
from fopi_tune.proof.time_domain.loop import Loop
from fopi_tune.proof.time_domain.models import delayed
from fopi_tune.proof.time_domain.patterns import Pattern, free_pattern, pattern_of
from fopi_tune.proof.time_domain.solution import Trajectory
from fopi_tune.simulation.sampled.simulate import simulate
from fopi_tune.simulation.scenario import Mode, Sensor

#: guesses of a pattern
_GUESSES = 5
#: axes of whose box all corners are simulated for a guess
_MOST_CORNERS = 4
#: a guessed range of v is made wider by this share of itself, and by this share of v
_WIDER, _LEAST = 0.05, 1e-9
#: relative; above the rounding of the largest change of the control
_RATE_ROUNDING = 1e-12


class Enclosure:
    """Trajectories of boxes of a case."""

    def __init__(self, case: TimeDomainCase) -> None:
        self.case, self.loop, self._free = case, Loop(case), free_pattern(case)
        #: why the last box had no trajectory
        self.reason = ""

    def trajectory(self, box: Box) -> Trajectory | None:
        """The trajectories of a box; None where it must be split."""
        plants = self.loop.plants(box)
        if plants is None:
            self.reason = "its delay reaches across a whole number of samples"
            return None
        # what is found depends on the box alone: a recheck must find the same
        pattern = self._guess(box) if self._has_limits else self._free
        for _ in range(_GUESSES):
            found = self.loop.trajectory(plants, pattern)
            if found is not None and pattern.is_confirmed(found.demanded):
                return found if self._follows(found) else None
            if found is None or not np.all(np.isfinite(found.demanded.high)):
                self.reason = "its loops are too different"
                return None
            pattern = _around(self.case, found.demanded.low, found.demanded.high)
        self.reason = "the samples at which its output is limited are not known"
        return None

    @property
    def _has_limits(self) -> bool:
        return bool(np.isfinite(self.case.output_limits).any())

    def _guess(self, box: Box) -> Pattern:
        """From the centre and the corners."""
        ends = [sorted(set(interval)) for interval in box]
        corners = list(itertools.product(*ends)) if len(box) <= _MOST_CORNERS else list(zip(*box, strict=True))
        points = np.array([centre_of(box), *corners], dtype=float).reshape(1 + len(corners), len(box))
        run = replace(self.case.run, sensor=Sensor())
        with np.errstate(all="ignore"):
            traces = simulate([Mode(self.case.controller, Plants.members(self.case.family, points))], run)
            v = _demanded(self.case, traces.error, traces.applied)
            v = np.where(np.isfinite(v), v, 0.0)
            return _around(self.case, v.min(axis=0), v.max(axis=0))

    def _follows(self, found: Trajectory) -> bool:
        """Whether the actuator follows the controller everywhere."""
        most = self.case.run.actuator.rate_per_s * self.case.sample_time_s
        if not np.isfinite(most):
            return True
        # before the first sample the control is 0 as a deviation from what it is at rest
        change = found.applied - delayed(found.applied, 1)
        self.reason = "the actuator's rate limit may be reached"
        within = most * (1.0 - _RATE_ROUNDING)
        return bool(np.all(change.high <= within) and np.all(change.low >= -within))


def _around(case: TimeDomainCase, low: Array, high: Array) -> Pattern:
    """The pattern of a little more than this range of v."""
    wider = _WIDER * (high - low) + _LEAST * (np.abs(low) + np.abs(high))
    return pattern_of(case, low - wider, high + wider)


def _demanded(case: TimeDomainCase, error: Array, applied: Array) -> Array:
    """v before the limits, from the signals of simulations; shape (m, K)."""
    controller, (m, count) = case.controller, error.shape
    poles, residues, weights = (np.array(row) for row in (controller.poles, controller.residues, controller.weights))
    states, found = np.zeros((m, len(poles))), np.empty_like(error)
    if controller.has_integrator:
        bumpless = case.run.start.bumpless
        # a controller without bumps starts at the input before: v at the first sample is what was applied, or limited
        states[:, 0] = applied[:, 0] - controller.direct * error[:, 0] if bumpless else case.first_output
    for k in range(count):
        found[:, k] = controller.direct * error[:, k] + states.sum(axis=1)
        correction = controller.tracking_gain * (applied[:, k] - found[:, k])
        states = poles * (states + weights * correction[:, None]) + residues * error[:, k : k + 1]
    return found
