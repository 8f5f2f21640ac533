"""A reference optimiser of PIDs:  spec -> best gains, by differential evolution and linear programs on dense grids.

It shares nothing with the search but the spec's types and, on samples, the plants behind their hold:  C by its formula,
peaks as largest values of a dense grid, crossings by interpolation between its points, stability by the turn of 1 + L
along the upper half of Nyquist's contour, all of them for many gains at once.
"""

from __future__ import annotations

import itertools

import numpy as np
from oracles.brute_loops import NEPER_PER_DB, member_coefficients, natural
from scipy.optimize import linprog

from fopi_tune.core.loops import Plants
from fopi_tune.core.sampled_loops import SampledPlants
from fopi_tune.quantities.objectives import default_horizon_s
from fopi_tune.spec.model import DesignSpec, Relation, Requirement

#: natural units: a requirement without a value is missed by this much
FAR = 10.0
#: columns of a part of a band whose largest value is a row of its own
PART = 12


class PidLoops:
    """The loops of a spec with many gains (kp, ki, kd) on a grid.

    Args:
        spec: with `structure: pid` and no equalities.
        per_axis: members along each axis of the family's box, besides the nominal one.
        density: frequencies a decade.
    """

    def __init__(self, spec: DesignSpec, per_axis: int, density: int):
        self.spec, family = spec, spec.plant
        axes = [np.linspace(a, b, per_axis) for a, b in zip(family.low, family.high, strict=True)]
        box = np.array(list(itertools.product(*axes))).reshape(-1, len(axes)) if axes else np.zeros((0, 0))
        points = np.vstack([family.nominal_point[None, :], box])
        self.top, self.bottom, self.delay = member_coefficients(spec, points)
        poles = [np.roots(b) for b in self.bottom]
        roots = np.abs(np.concatenate([*poles, *(np.roots(t) for t in self.top)]))
        box_c, asked = spec.controller, [w for r in spec.requirements for w in (r.from_rad_s, r.to_rad_s)]
        self.filter_s = box_c.derivative_filter_time_constant_s
        own = np.array([*roots[roots > 0], *(1 / d for d in self.delay if d > 0), 1 / self.filter_s])
        low, high = np.log10(own.min()) - 2.5, np.log10(own.max()) + 1.5
        omega = 10 ** np.arange(low, high, 1 / density)
        light = np.concatenate([p[(np.abs(p.real) < 0.5 * np.abs(p)) & (p.imag > 0)] for p in poles])
        narrow = [p.imag + np.abs(p.real) * np.tan(np.linspace(-1.5, 1.5, density)) for p in light]
        sparse = 10 ** np.concatenate([np.arange(low - 5, low, 0.25), np.arange(high, high + 5, 0.25)])
        omega = np.concatenate([omega, sparse, *narrow, [w for w in asked if 0 < w < np.inf]])
        self.time_s = 0.0
        if spec.digital is not None and spec.digital.designs_sampled:
            self.time_s = spec.digital.sample_time_s
            omega = np.append(omega, np.pi / self.time_s * (1.0 - 10.0 ** -np.arange(0.1, 6, 0.1)))
            omega = omega[omega < np.pi / self.time_s * (1 - 1e-9)]
        omega = np.unique(omega[omega > 0])
        self.omega = omega[np.append(True, np.diff(omega) > 1e-7 * omega[1:])]
        self.s = 1j * self.omega
        if self.time_s:
            self.s = 2j / self.time_s * np.tan(0.5 * self.omega * self.time_s)
        self.p = self._plants(points)
        self.right = np.array([np.sum(p.real > 1e-9 * np.abs(p).max(initial=0.0)) for p in poles])
        self.at_zero = np.array([np.sum(p == 0) for p in poles])
        s = 1.0 / ((spec.objective.horizon_s if spec.objective else None) or default_horizon_s(family))
        self.p_at_horizon, self.s_at_horizon, self.unit = self._at_horizon(s)

    def _plants(self, points):
        if self.time_s:
            assert self.spec.digital is not None
            late = self.spec.digital.delay_samples * self.time_s
            plants = SampledPlants.behind_hold(Plants.members(self.spec.plant, points), self.time_s, late)
            rows, u = np.arange(len(points)), np.log(np.tan(0.5 * self.omega * self.time_s))
            return plants.at(np.repeat(rows, len(u)), np.tile(u, len(points))).reshape(len(points), -1)
        p = [np.polyval(t, self.s) / np.polyval(b, self.s) for t, b in zip(self.top, self.bottom, strict=True)]
        return np.array(p) * np.exp(-self.s * self.delay[:, None])

    def _at_horizon(self, s):
        """P and s at the horizon, and the error's unit; on samples none of the specs here asks for it."""
        p = [np.polyval(t, s) / np.polyval(b, s) for t, b in zip(self.top, self.bottom, strict=True)]
        return np.array(p) * np.exp(-s * self.delay), s, 1.0 / s

    def controllers(self, x, s):
        """C of gains (n, 3) at s (w,): (n, w)."""
        return x[:, :1] + x[:, 1:2] / s + x[:, 2:3] * (s / (self.filter_s * s + 1.0))

    def ends(self, x):
        """C of gains (n, 3) as omega -> inf: (n,)."""
        return x[:, 0] + x[:, 2] / self.filter_s

    def orders(self, x):
        """The order of the integral of gains (n, 3): (n, 1)."""
        return (x[:, 1:2] != 0.0) * 1.0

    def evaluate(self, x):
        """Of gains (n, 3): the objective to be minimised (n,), rows that must be <= 0 (n, k), unstable members (n,)."""
        c = self.controllers(x, self.s)
        loop = c[:, None, :] * self.p
        one = 1.0 + loop
        log = {"one": np.log(np.abs(one)), "loop": np.log(np.abs(loop)), "c": np.log(np.abs(c))[:, None, :]}
        end = np.log(np.abs(self.ends(x)))[:, None]
        rows = [self._row(r, limit, sign, x, loop, log, end) for r in self.spec.requirements
                for limit, sign in ((r.lower, -1.0), (r.upper, 1.0)) if np.isfinite(limit)]  # fmt: skip
        excess = np.concatenate([r.reshape(len(x), -1) for r in rows], axis=1)
        return self._objective(x, c, log, excess, end), excess, self._unstable(x, one)

    def _unstable(self, x, one):
        angle = np.angle(one)
        turn = (np.diff(angle, axis=2) + np.pi) % (2 * np.pi) - np.pi
        order = self.at_zero + self.orders(x)
        z = self.right - (turn.sum(axis=2) - 0.5 * np.pi * order) / np.pi
        return np.sum(np.abs(z) > 0.3, axis=1)

    def _log(self, name, log):
        return {"sensitivity_db": -log["one"], "complementary_sensitivity_db": log["loop"] - log["one"],
                "control_sensitivity_db": log["c"] - log["one"], "loop_gain_db": log["loop"]}[name]  # fmt: skip

    def _row(self, r: Requirement, limit, sign, x, loop, log, end):
        assert r.relation is not Relation.EQUALS
        level = natural(r.quantity, limit)
        if r.quantity in ("sensitivity_db", "complementary_sensitivity_db", "control_sensitivity_db", "loop_gain_db"):
            inside = (self.omega >= r.from_rad_s) & (self.omega <= r.to_rad_s)
            value = peaks(sign * (self._log(r.quantity, log)[:, :, inside] - level), np.log(self.omega[inside]))
            starts = np.arange(0, value.shape[2], PART)
            value = np.maximum.reduceat(value, starts, axis=2)
            if r.quantity == "control_sensitivity_db" and r.to_rad_s == np.inf and not self.time_s:
                at_end = np.broadcast_to(sign * (end - level)[:, :, None], (*value.shape[:2], 1))
                value = np.concatenate([value, at_end], axis=2)
            return value
        angle, omega = np.unwrap(np.angle(loop), axis=2), self.omega
        if r.quantity == "gain_margin_db":
            side = np.floor((angle + np.pi) / (2 * np.pi))
            part = np.abs(((angle[:, :, :-1] + np.pi) / (2 * np.pi) - np.maximum(side[:, :, :-1], side[:, :, 1:]))
                          * 2 * np.pi / np.where(np.diff(angle, axis=2) == 0, 1, np.diff(angle, axis=2)))  # fmt: skip
            at = -(log["loop"][:, :, :-1] + part * np.diff(log["loop"], axis=2))
            crossing = (np.diff(side, axis=2) != 0) & (at > 0)
            return sign * (np.where(crossing, at, FAR).min(axis=2) - level)
        gain = log["loop"]
        crossing = (gain[:, :, 1:] > 0) != (gain[:, :, :-1] > 0)
        part = np.where(crossing, gain[:, :, :-1] / np.where(crossing, gain[:, :, :-1] - gain[:, :, 1:], 1.0), 0.0)
        at = angle[:, :, :-1] + part * np.diff(angle, axis=2)
        if r.quantity == "phase_margin_deg":
            value = np.abs((at + np.pi + np.pi) % (2 * np.pi) - np.pi)
            return sign * (np.where(crossing, value, FAR).min(axis=2) - level)
        assert r.quantity == "delay_margin_s"
        where = np.exp(np.log(omega[:-1]) + part * np.diff(np.log(omega)))
        value = np.where(crossing, ((at + np.pi) % (2 * np.pi)) / where, FAR * limit).min(axis=2)
        return sign * (value / limit - 1.0)

    def _objective(self, x, c, log, excess, end):
        if self.spec.objective is None:
            return excess.max(axis=1)
        name = self.spec.objective.quantity
        if name == "ki":
            return -x[:, 1]
        if name == "iae_disturbance":
            at = self.controllers(x, np.array([self.s_at_horizon]))
            return self.unit * np.abs(self.p_at_horizon / (1.0 + at * self.p_at_horizon)).max(axis=1)
        value = peaks(self._log(name.replace("_peak", ""), log), np.log(self.omega)).max(axis=(1, 2))
        if "control" in name and not self.time_s:
            value = np.maximum(value, end[:, 0])
        return value / NEPER_PER_DB


def peaks(value, u):
    """Values (n, m, w) on a grid u, of which local maxima are those of the parabola through three points."""
    if value.shape[2] < 3:
        return value
    h, k = np.diff(u)[:-1], np.diff(u)[1:]
    left, right = np.diff(value, axis=2)[:, :, :-1] / h, np.diff(value, axis=2)[:, :, 1:] / k
    with np.errstate(all="ignore"):
        bend = (left - right) / (h + k)
        slope = left - bend * h
        rise = 0.25 * slope**2 / bend
    # where the grid is even the vertex lies a quarter of a step's fall above the middle at most
    top = (left > 0) & (right < 0) & (np.maximum(h / k, k / h) < 3.0)
    found = value.copy()
    found[:, :, 1:-1] += np.where(top, np.nan_to_num(rise), 0.0)
    return found


def search(spec: DesignSpec, seed: int = 0, population: int = 48, generations: int = 120):
    """The best gains (3,) found and their objective, to be minimised; None where none meet the spec."""
    box = spec.controller
    high = np.array([box.kp.max, box.ki.max, box.kd.max])
    coarse, fine = PidLoops(spec, 2, 24), PidLoops(spec, {1: 9, 2: 5}.get(len(spec.plant.low), 4), 110)

    def gains(y):
        # from 1e-6 of the range's end, in its logarithm; the lowest part is 0
        return np.where(y < 0.02, 0.0, high * 10.0 ** (6.0 * (y - 1.0)))

    best = []
    for start in range(2):
        chance = np.random.default_rng(seed + 100 * start)
        y = chance.random((population, 3))
        merit = merit_of(coarse, gains(y))
        for _ in range(generations):
            a, b, c = (chance.permutation(population) for _ in range(3))
            factor = chance.uniform(0.4, 0.9, (population, 1))
            other = np.where(chance.random((population, 1)) < 0.5, y[a], y[np.argmin(merit)])
            mutant = np.clip(other + factor * (y[b] - y[c]), 0.0, 1.0)
            trial = np.where(chance.random(y.shape) < 0.9, mutant, y)
            value = merit_of(coarse, gains(trial))
            y, merit = np.where((value < merit)[:, None], trial, y), np.minimum(value, merit)
        order = np.argsort(merit)
        best += [gains(y[order[0]]), gains(y[order[len(order) // 2]])]
    low = np.zeros(3)
    found = [polished(fine, polished(coarse, x, low, high)[0], low, high) for x in best]
    met = [pair for pair in found if pair is not None and pair[2] <= 1e-6]
    return min(((x, value) for x, value, _ in met), key=lambda pair: pair[1]) if met else None


def merit_of(loops: PidLoops, x):
    """What differential evolution minimises, for numbers (n, k)."""
    with np.errstate(all="ignore"):
        value, excess, unstable = loops.evaluate(np.maximum(x, 1e-12))
    missed = np.maximum(excess, 0.0).max(axis=1)
    if loops.spec.objective:
        value = np.where(missed > 0.0, 1e12 * (1.0 + missed), value)
    return np.where(np.isfinite(value), value, 1e15) + 1e16 * unstable


def polished(loops: PidLoops, x, low, high):
    """Linear programs in a region that shrinks: (numbers, objective, the largest miss).

    Args:
        loops: evaluate numbers, of which the first three are gains.
        x, low, high: numbers and their ranges, shape (k,).
    """
    radius, x = 0.15, x.astype(float)

    def of(x):
        with np.errstate(all="ignore"):
            value, excess, unstable = loops.evaluate(x)
        return value, np.nan_to_num(excess, nan=FAR), np.maximum(excess, 0.0).max(axis=1) + FAR * unstable

    value, excess, missed = (part[0] for part in of(x[None, :]))
    weight = 30.0 * (abs(value) + 1e-12)
    for _ in range(60):
        if radius < 1e-6:
            break
        unit, k = np.maximum(x, 0.02 * high * np.max(x[:3] / high[:3]) + 1e-15), len(x)
        unit[3:] = 1.0
        steps = 1e-5 * np.diag(unit)
        around = np.clip(np.vstack([x + steps, x - steps]), low, high)
        values, rows, _ = of(around)
        width = np.diag(around[:k] - around[k:]) / unit
        slope, slopes = (values[:k] - values[k:]) / width, (rows[:k] - rows[k:]) / width[:, None]
        near = excess > -0.5
        if not loops.spec.objective:
            slope = np.zeros(k)
        cost = np.append(slope, weight) if loops.spec.objective else np.append(slope, 1.0)
        table = np.column_stack([slopes[:, near].T, -np.ones(near.sum())])
        free = (0.0, None) if loops.spec.objective else (None, None)
        limits = [
            (max(-radius, (low[k] - x[k]) / unit[k]), min(radius, (high[k] - x[k]) / unit[k])) for k in range(len(x))
        ]
        found = linprog(cost, A_ub=table, b_ub=-excess[near], bounds=[*limits, free])
        if found.x is None:
            radius *= 0.3
            continue
        trial = np.clip(x + found.x[: len(x)] * unit, low, high)
        new = [part[0] for part in of(trial[None, :])]
        merit = [(v if loops.spec.objective else 0.0) + weight * m for v, m in ((value, missed), (new[0], new[2]))]
        if not loops.spec.objective:
            merit = [float(np.max(excess)), float(np.max(new[1])) + FAR * (new[2] >= FAR)]
        if merit[1] < merit[0] - 1e-12 * abs(merit[0]):
            x, (value, excess, missed), radius = trial, new, min(0.3, 2.0 * radius)
        else:
            radius *= 0.35
    return x, float(value), float(missed)
