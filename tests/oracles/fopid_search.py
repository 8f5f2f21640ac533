"""A reference optimiser of kp + ki s^-alpha + kd s^mu/(Tf s + 1), as `pid_search` is one of PIDs:  five numbers.

On samples s is (2/Ts) (z - 1)/(z + 1), and both powers are Oustaloup's filters in s:  s^-1 s^(1 - alpha), s s^(mu - 1).
"""

from __future__ import annotations

import numpy as np
from oracles.brute_loops import NEPER_PER_DB
from oracles.pid_search import PidLoops, merit_of, polished
from oracles.sampled_loops import sample

from fopi_tune.spec.model import DesignSpec


class FopidLoops(PidLoops):
    """The loops of a spec with many numbers (kp, ki, kd, alpha, mu) on a grid."""

    def controllers(self, x, s):
        if self.time_s:
            integral = x[:, 1:2] * self._power(1.0 - x[:, 3], s) / s
            derivative = x[:, 2:3] * self._power(x[:, 4] - 1.0, s) * s / (self.filter_s * s + 1.0)
            return x[:, :1] + integral + derivative
        log_s = np.log(np.asarray(s, dtype=complex))
        integral = x[:, 1:2] * np.exp(-x[:, 3:4] * log_s)
        derivative = x[:, 2:3] * np.exp(x[:, 4:5] * log_s) / (self.filter_s * np.exp(log_s) + 1.0)
        found = x[:, :1] + integral + derivative
        return found if np.iscomplexobj(s) else found.real

    def _plants(self, points):
        if not self.time_s:
            return super()._plants(points)
        assert self.spec.digital is not None
        late = self.spec.digital.delay_samples
        plants = [sample(self.spec.plant.member(point), self.time_s, late) for point in points]
        return np.array([plant.response(self.omega) for plant in plants])

    def _power(self, beta, s):
        """s^beta of many beta (n,) by Oustaloup's filter, Tustin's rule and no prewarping: (n, w)."""
        digital = self.spec.digital
        assert digital is not None
        assert (digital.method, digital.rule, digital.prewarp) == ("oustaloup", "tustin", "none")
        low, high = digital.band_rad_s
        places = (np.arange(digital.poles) + 0.5) / digital.poles
        tilt = 0.5 * beta[:, None] / digital.poles
        zeros, poles = (low * (high / low) ** (places + sign * tilt) for sign in (-1.0, 1.0))
        middle, found = np.sqrt(low * high), np.ones((len(beta), len(s)), dtype=complex)
        for k in range(digital.poles):
            zero, pole = zeros[:, k : k + 1], poles[:, k : k + 1]
            found = found * (s + zero) / (s + pole) * np.abs((1j * middle + pole) / (1j * middle + zero))
        return found * middle ** beta[:, None]

    def ends(self, x):
        # with mu < 1 the derivative vanishes
        return x[:, 0] + np.where(x[:, 4] == 1.0, x[:, 2] / self.filter_s, 0.0) + 1e-300

    def _objective(self, x, c, log, excess, end):
        found = super()._objective(x, c, log, excess, end)
        if self.spec.objective is None or "control_sensitivity" not in self.spec.objective.quantity:
            return found
        # the limit omega -> 0 behind an integral, 1/|P(0)|, which a slow one approaches below the grid
        with np.errstate(all="ignore"):
            at_zero = max(abs(b[-1] / t[-1]) for t, b in zip(self.top, self.bottom, strict=True))
        return np.where(x[:, 1] != 0.0, np.maximum(found, np.log(at_zero) / NEPER_PER_DB), found)

    def orders(self, x):
        if self.time_s:
            return super().orders(x)
        return np.where(x[:, 1:2] != 0.0, x[:, 3:4], 0.0)


def search(spec: DesignSpec, seed: int = 0, population: int = 40, generations: int = 90, starts: int = 2):
    """The best numbers (5,) found and their objective, to be minimised; None where none meet the spec."""
    box = spec.controller
    assert box.mu is not None
    low = np.array([0.0, 0.0, 0.0, box.alpha.min, box.mu.min])
    high = np.array([box.kp.max, box.ki.max, box.kd.max, box.alpha.max, box.mu.max])
    coarse, fine = FopidLoops(spec, 2, 16), FopidLoops(spec, {1: 5}.get(len(spec.plant.low), 3), 60)

    def numbers(y):
        # gains from 1e-6 of the range's end, in its logarithm; the lowest part is 0
        gains = np.where(y[:, :3] < 0.02, 0.0, high[:3] * 10.0 ** (6.0 * (y[:, :3] - 1.0)))
        return np.hstack([gains, low[3:] + y[:, 3:] * (high[3:] - low[3:])])

    best = []
    for start in range(starts):
        chance = np.random.default_rng(seed + 100 * start)
        y = chance.random((population, 5))
        merit = merit_of(coarse, numbers(y))
        for _ in range(generations):
            a, b, c = (chance.permutation(population) for _ in range(3))
            factor = chance.uniform(0.4, 0.9, (population, 1))
            other = np.where(chance.random((population, 1)) < 0.5, y[a], y[np.argmin(merit)])
            mutant = np.clip(other + factor * (y[b] - y[c]), 0.0, 1.0)
            trial = np.where(chance.random(y.shape) < 0.9, mutant, y)
            value = merit_of(coarse, numbers(trial))
            y, merit = np.where((value < merit)[:, None], trial, y), np.minimum(value, merit)
        best.append(numbers(y[np.argmin(merit)][None, :])[0])
    found = [polished(fine, polished(coarse, x, low, high)[0], low, high) for x in best]
    met = [triple for triple in found if triple[2] <= 1e-6]
    return min(((x, value) for x, value, _ in met), key=lambda pair: pair[1]) if met else None
