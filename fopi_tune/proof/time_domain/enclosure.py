"""The trajectories of every plant of a box, with the pattern of limited samples that fits them.

A pattern is guessed and then confirmed: under it v is enclosed at every sample, and v at a sample depends on earlier
samples only.  So if v keeps everywhere to what the pattern assumes, then by induction, sample after sample, the pattern
is that of every plant of the box.  A guess comes from simulations of a few plants, the next one from the enclosure
under the guess before.  The actuator's rate limit must not be reached.
"""

from __future__ import annotations

import itertools

import numpy as np

from fopi_tune.core.bode_form import Array
from fopi_tune.core.loops import Plants
from fopi_tune.proof.balls.box import Box, centre_of
from fopi_tune.proof.time_domain.case import TimeDomainCase
from fopi_tune.proof.time_domain.loop import Loop, Trajectory
from fopi_tune.proof.time_domain.models import Model
from fopi_tune.proof.time_domain.patterns import free_pattern, pattern_of
from fopi_tune.simulation.sampled.simulate import simulate
from fopi_tune.simulation.scenario import Mode

#: guesses of a pattern
_GUESSES = 5
#: axes of whose box all corners are simulated for a guess
_MOST_CORNERS = 4
#: a guessed range of v is made wider by this share of itself, and by this share of the limits
_WIDER, _LEAST = 0.05, 1e-9


class Enclosure:
    """Trajectories of boxes of a case."""

    def __init__(self, case: TimeDomainCase) -> None:
        self.case, self.loop, self._free = case, Loop(case), free_pattern(case)
        self._limited = False
        #: why the last box had no trajectory
        self.reason = ""

    def trajectory(self, box: Box) -> Trajectory | None:
        """The trajectories of a box; None where it must be split."""
        plants = self.loop.plants(box)
        if plants is None:
            self.reason = "the delay reaches across a whole number of samples"
            return None
        pattern = self._free
        if self._limited:
            pattern = self._guess(box)
        for _ in range(_GUESSES):
            found = self.loop.trajectory(plants, pattern)
            if found is None or not np.all(np.isfinite(found.demanded.high)):
                self.reason = "the loops of a box are too different"
                if pattern is self._free and not self._limited and self._has_limits:
                    self._limited, pattern = True, self._guess(box)
                    continue
                return None
            if pattern.is_confirmed(found.demanded):
                return found if self._within_rate(found) else None
            if pattern is self._free:
                # most boxes of a family are limited if one is
                self._limited, pattern = True, self._guess(box)
                continue
            low, high = found.demanded.low, found.demanded.high
            wider = _WIDER * (high - low) + _LEAST * (np.abs(low) + np.abs(high))
            pattern = pattern_of(self.case, low - wider, high + wider)
        self.reason = "the samples at which the output is limited are not known"
        return None

    @property
    def _has_limits(self) -> bool:
        return bool(np.isfinite(self.case.output_limits).any())

    def _guess(self, box: Box) -> object:
        """From the centre and the corners."""
        ends = [sorted(set(interval)) for interval in box]
        corners = list(itertools.product(*ends)) if len(box) <= _MOST_CORNERS else [tuple(e[0] for e in ends)]
        points = np.array([centre_of(box), *corners], dtype=float).reshape(1 + len(corners), len(box))
        low, high = self._simulated(points)
        wider = _LEAST * (np.abs(low) + np.abs(high)) + _WIDER * (high - low)
        return pattern_of(self.case, low - wider, high + wider)

    def _simulated(self, points: Array) -> tuple[Array, Array]:
        """The range of v over some plants, before the limits; shape (K,) each."""
        case = self.case
        plants = Plants.members(case.family, points)
        traces = simulate([Mode(case.controller, plants)], case.run)
        v = unlimited(case, traces.error, traces.applied)
        return v.min(axis=0), v.max(axis=0)

    def _within_rate(self, found: Trajectory) -> bool:
        """Whether the actuator follows the controller everywhere."""
        most = self.case.run.actuator.rate_per_s * self.case.sample_time_s
        if not np.isfinite(most):
            return True
        change = found.applied - _before(found.applied)
        self.reason = "the actuator's rate limit may be reached"
        return bool(np.all(change.high <= most * (1.0 - 1e-12)) and np.all(change.low >= -most * (1.0 - 1e-12)))


def _before(applied: Model) -> Model:
    """The signal one sample earlier; before the first it is the input at rest, from which it is a deviation."""
    from fopi_tune.proof.time_domain.models import delayed

    return delayed(applied, 1)


def unlimited(case: TimeDomainCase, error: Array, applied: Array) -> Array:
    """v before the limits, from the signals of simulations; shape (m, K)."""
    controller, (m, count) = case.controller, error.shape
    states = np.zeros((m, len(controller.poles)))
    found = np.empty_like(error)
    poles, residues, weights = (np.array(row) for row in (controller.poles, controller.residues, controller.weights))
    start = case.first_output
    if controller.has_integrator:
        states[:, 0] = start
        if case.run.start.bumpless:
            states[:, 0] = applied[:, 0] - controller.direct * error[:, 0]
    for k in range(count):
        found[:, k] = controller.direct * error[:, k] + states.sum(axis=1)
        correction = controller.tracking_gain * (applied[:, k] - found[:, k])
        states = poles * (states + weights * correction[:, None]) + residues * error[:, k : k + 1]
    return found
