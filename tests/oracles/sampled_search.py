"""A reference optimiser of the loop on samples:  spec -> best gains, by differential evolution on dense grids.

It shares no tables and no solver with the search: responses of the filter's sections and of the sampled plants from
`core/`, crossings and peaks by scan and interpolation, stability by `core/` where everything else is met.  Nominal
equalities of crossover and phase margin are eliminated: kp + ki F(e^{j omega Ts}) = X is linear in kp and ki.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np
from scipy.optimize import differential_evolution, minimize

from fopi_tune.core.controller import FoPi
from fopi_tune.core.loops import Plants
from fopi_tune.core.parallel_form import Implementation
from fopi_tune.core.sampled_loops import SampledLoops, SampledPlants, shifted
from fopi_tune.core.stability import is_stable
from fopi_tune.digital import sections_of
from fopi_tune.digital.implementation import implementation_of, nominal_crossover
from fopi_tune.errors import DomainError
from fopi_tune.proof import Verification, verify
from fopi_tune.quantities import QUANTITIES
from fopi_tune.quantities.objectives import default_horizon_s
from fopi_tune.spec.model import DesignSpec, GainRange, Relation, Requirement, Scope

#: natural units; inequalities are kept by this much
ROOM = 3e-7
FAR = 10.0
#: decades of gains below the end of their range
DECADES = 4.0


@dataclass(frozen=True)
class Grid:
    """Members of the family, the nominal one first, on frequencies up to Nyquist's."""

    plants: SampledPlants
    u: np.ndarray
    omega: np.ndarray
    response: np.ndarray

    @classmethod
    def of(cls, spec: DesignSpec, points: int) -> Grid:
        assert spec.digital is not None
        family, time_s = spec.plant, spec.digital.sample_time_s
        count = {1: 9, 2: 5, 3: 3}.get(len(family.low), 2)
        axes = [np.linspace(a, b, count) for a, b in zip(family.low, family.high, strict=True)]
        box = np.array(list(itertools.product(*axes))).reshape(-1 if axes else 1, len(axes))
        continuous = Plants.members(family, np.vstack([family.nominal_point, box]))
        plants = SampledPlants.behind_hold(continuous, time_s, spec.digital.delay_samples * time_s)
        nyquist = np.pi / time_s
        roots = np.concatenate([continuous.poles.ravel(), continuous.zeros.ravel()])
        roots = roots[np.isfinite(roots) & (roots != 0)]
        low = min([spec.digital.band_rad_s[0], *np.abs(roots)]) / 100.0
        asked = [w for r in spec.requirements for w in (r.from_rad_s, r.to_rad_s) if 0.0 < w < nyquist]
        asked += [w for r in spec.requirements if r.quantity == "crossover_rad_s" for w in r.limits]
        light = roots[(np.abs(roots.real) < 0.3 * np.abs(roots)) & (roots.imag > 0)]
        narrow = [r.imag + abs(r.real) * np.tan(np.linspace(-1.5, 1.5, 25)) for r in light]
        grids = [np.geomspace(low, 0.9999999 * nyquist, points), np.linspace(0, nyquist, points // 2 + 2)[1:-1]]
        omega = np.concatenate([*grids, np.array(asked), *narrow])
        omega = np.unique(omega[(omega > 0) & (omega < nyquist)])
        u = np.log(np.tan(0.5 * omega * time_s))
        m, n = len(plants), len(u)
        response = plants.at(np.repeat(np.arange(m), n), np.tile(u, m)).reshape(m, n)
        return cls(plants, u, omega, response)


class Reference:
    """The problem of one spec on a grid."""

    def __init__(self, spec: DesignSpec, points: int = 500):
        assert spec.digital is not None
        self.spec, self.digital, self.grid = spec, spec.digital, Grid.of(spec, points)
        self.needs_crossover = spec.digital.prewarp == "crossover" or spec.digital.rule == "matched"
        nominal = [r for r in spec.requirements if r.relation is Relation.EQUALS and r.scope is Scope.NOMINAL]
        fixed = {r.quantity: r.limits[0] for r in nominal}
        self.crossover = fixed.get("crossover_rad_s")
        self.margin = fixed.get("phase_margin_deg") if self.crossover is not None else None
        horizon = spec.objective.horizon_s if spec.objective else None
        self.horizon_s = horizon or default_horizon_s(spec.plant)

    # --- unknowns -------------------------------------------------------------------------------------------------

    @property
    def bounds(self) -> list[tuple[float, float]]:
        box = self.spec.controller
        if self.crossover is None:
            return [(-1.0 if g.min < 0 else 0.0, 1.0 if g.max > 0 else 0.0) for g in (box.kp, box.ki)] + [
                (box.alpha.min, box.alpha.max)
            ]
        angle = [] if self.margin is not None else [(0.05, np.pi)]
        return [*angle, (box.alpha.min, box.alpha.max)]

    def gains(self, x: np.ndarray, side: float = 1.0) -> FoPi:
        box = self.spec.controller
        if self.crossover is None:
            return FoPi(_from_unit(x[0], box.kp), _from_unit(x[1], box.ki), float(x[2]))
        phi = np.radians(self.margin) if self.margin is not None else x[0]
        alpha, omega = float(x[-1]), np.array([self.crossover])
        wanted = np.exp(1j * (side * phi - np.pi)) / self._nominal(omega)[0]
        f = sections_of(FoPi(0.0, 1.0, alpha), self.digital, self.crossover).response(omega)[0]
        ki = wanted.imag / f.imag
        return FoPi(float(wanted.real - ki * f.real), float(ki), alpha)

    def _nominal(self, omega: np.ndarray) -> np.ndarray:
        u = np.log(np.tan(0.5 * omega * self.digital.sample_time_s))
        return self.grid.plants.at(np.zeros(len(u), dtype=int), u)

    # --- one controller -------------------------------------------------------------------------------------------

    def merit(self, gains: FoPi, bar: float = np.inf) -> float:
        """Cost, plus a penalty of what is missed; stability is only looked at where the rest is below `bar`."""
        if (gains.kp, gains.ki) == (0.0, 0.0):
            return 100.0
        at = nominal_crossover(self.spec, gains) if self.needs_crossover else None
        try:
            sections = sections_of(gains, self.digital, at)
        except DomainError:
            return 100.0
        grid, box = self.grid, self.spec.controller
        loop = sections.at(shifted(grid.u)) * grid.response
        excess = [max(_outside(gains.kp, box.kp), _outside(gains.ki, box.ki), _outside(gains.alpha, box.alpha))]
        log, angle = np.log(np.abs(loop)), np.unwrap(np.angle(loop), axis=1)
        crossings, depth = self._crossings(log, angle), [FAR]
        for r in self.spec.requirements:
            for limit, sign in ((r.lower, -1.0), (r.upper, 1.0)):
                if not np.isfinite(limit) or (r.quantity == "crossover_rad_s" and self.crossover is not None
                                              and r.relation is Relation.EQUALS):  # fmt: skip
                    continue
                value = self._value(r, loop, log, angle, crossings, sections, sign > 0)
                quantity = QUANTITIES[r.quantity]
                distance = sign * (value - quantity.to_natural(limit)) * quantity.natural_scale(limit)
                distance = float(np.nan_to_num(distance, nan=FAR, posinf=FAR, neginf=-FAR).max())
                if r.relation is not Relation.EQUALS:
                    depth.append(-distance)
                    distance += ROOM
                excess.append(min(distance, FAR))
        missed = sum(max(e, 0.0) for e in excess)
        value = self._cost(gains, loop, log, crossings, sections, min(depth)) + 30.0 * missed
        if not np.isfinite(value) or value >= bar:
            return min(value, 90.0) if np.isfinite(value) else 90.0
        loops = SampledLoops.implemented(gains, Implementation(sections, self.digital.delay_samples), self._continuous)
        return value if is_stable(loops).all() else 50.0

    @property
    def _continuous(self) -> Plants:
        family = self.spec.plant
        return Plants.members(family, np.unique(np.vstack([family.nominal_point, family.corners()]), axis=0))

    def _crossings(self, log: np.ndarray, angle: np.ndarray):
        """(row, omega, angle) of every gain crossover, by linear interpolation in u."""
        row, k = np.nonzero((log[:, 1:] > 0) != (log[:, :-1] > 0))
        part = log[row, k] / (log[row, k] - log[row, k + 1])
        u = self.grid.u[k] + part * (self.grid.u[k + 1] - self.grid.u[k])
        omega = 2.0 / self.digital.sample_time_s * np.arctan(np.exp(u))
        return row, omega, angle[row, k] + part * (angle[row, k + 1] - angle[row, k])

    def _value(self, r: Requirement, loop, log, angle, crossings, sections, largest: bool) -> np.ndarray:
        """A quantity of every member, natural units."""
        row, omega, phase = crossings
        m, name = len(loop), r.quantity
        lag = np.mod(np.pi + phase, 2.0 * np.pi)
        if name == "phase_margin_deg":
            value = _least(row, np.minimum(lag, 2.0 * np.pi - lag), m)
        elif name == "delay_margin_s":
            value = np.where(log[:, -1] > 0, 0.0, _least(row, lag / omega, m))
        elif name == "gain_margin_db":
            value = self._gain_margins(loop)
        elif name in ("crossover_rad_s", "phase_slope_deg_per_decade"):
            highest = -_least(row, -omega, m)
            value = np.where(np.isfinite(highest), np.log(np.abs(highest)), np.nan)
            if name != "crossover_rad_s":
                slopes = np.gradient(angle, np.log10(self.grid.omega), axis=1)
                there = np.where(np.isfinite(highest), highest, 1.0)
                value = np.array([np.interp(w, self.grid.omega, s) for w, s in zip(there, slopes, strict=True)])
        else:
            inside = (self.grid.omega >= r.from_rad_s * (1 - 1e-12)) & (self.grid.omega <= r.to_rad_s * (1 + 1e-12))
            value = self._extreme(name, loop, sections, inside, largest)
        return value[:1] if r.scope is Scope.NOMINAL else value

    def _gain_margins(self, loop: np.ndarray) -> np.ndarray:
        imag, real = np.imag(loop), np.real(loop)
        row, k = np.nonzero(np.sign(imag[:, 1:]) != np.sign(imag[:, :-1]))
        part = imag[row, k] / (imag[row, k] - imag[row, k + 1])
        at = real[row, k] + part * (real[row, k + 1] - real[row, k])
        # and Nyquist's frequency itself
        row, at = np.append(row, np.arange(len(loop))), np.append(at, real[:, -1])
        inside = (at < 0) & (at > -1)
        return _least(row[inside], -np.log(-at[inside]), len(loop))

    def _extreme(self, name: str, loop, sections, inside, largest: bool) -> np.ndarray:
        loop = loop[:, inside]
        if name == "loop_gain_db":
            value = np.log(np.abs(loop))
        else:
            top = {"sensitivity_db": 1.0, "complementary_sensitivity_db": loop}.get(name)
            top = sections.at(shifted(self.grid.u[inside])) if top is None else top
            value = np.log(np.abs(top / (1.0 + loop)))
        sign, u = 1.0 if largest else -1.0, self.grid.u[inside]
        value = sign * value
        best = value.max(axis=1)
        if value.shape[1] > 2:
            h, k = np.diff(u), np.diff(value, axis=1) / np.diff(u)
            row, at = np.nonzero((k[:, :-1] > 0) & (k[:, 1:] < 0))
            left, right, a, b = k[row, at], k[row, at + 1], h[at], h[at + 1]
            curve = (right - left) / (a + b)
            slope = (left * b + right * a) / (a + b)
            np.maximum.at(best, row, value[row, at + 1] - 0.25 * slope**2 / curve)
        return sign * best

    def _cost(self, gains: FoPi, loop, log, crossings, sections, depth: float) -> float:
        objective, (row, omega, phase), m = self.spec.objective, crossings, len(loop)
        if objective is None:
            return -depth
        if objective.quantity == "ki":
            return -float(np.log(max(abs(gains.ki), 1e-300))) * np.sign(gains.ki)
        everywhere = np.ones(len(self.grid.u), dtype=bool)
        if objective.quantity == "iae_disturbance":
            step = self.digital.sample_time_s / self.horizon_s
            delta = np.expm1(step)
            powers = delta ** np.arange(self.grid.plants.numerator.shape[1] - 1, -1, -1.0)
            p = self.grid.plants.numerator @ powers / (self.grid.plants.denominator @ powers)
            p = p * np.exp(-step * self.grid.plants.late)
            c = sections.at(np.array([delta + 0j])).real
            early = np.exp(step * (1.0 + self.digital.delay_samples)) * self.digital.sample_time_s / delta
            return float(np.log(np.abs(early * p / (1.0 + c * p)).max()))
        if objective.quantity.endswith("peak_db"):
            name = objective.quantity.replace("_peak", "")
            return float(self._extreme(name, loop, sections, everywhere, True).max())
        lag = np.mod(np.pi + phase, 2.0 * np.pi)
        if objective.quantity == "phase_margin_spread_deg":
            margin = _least(row, np.minimum(lag, 2.0 * np.pi - lag), m)
            return float(np.abs(margin - margin[0]).max())
        if not np.any(row == 0):
            return FAR
        at = np.log(omega[row == 0].max())
        return max(abs(float(np.interp(at, np.log(self.grid.omega), g))) for g in log)

    # --- the search -----------------------------------------------------------------------------------------------

    def search(self, seed: int = 0, generations: int = 120, population: int = 14) -> tuple[FoPi, float]:
        """The best gains found, and their merit."""
        best: tuple[float, FoPi] = (np.inf, FoPi(0.0, 0.0, 1.0))
        for side in (1.0,) if self.crossover is None else (1.0, -1.0):

            def merit(x: np.ndarray, side: float = side) -> float:
                return self.merit(self.gains(x, side), 45.0)

            # a fixed unknown has no width to spread over
            bounds = [(a, b if b > a else a + 1e-12) for a, b in self.bounds]
            found = differential_evolution(
                merit, bounds, rng=seed, maxiter=generations, popsize=population, tol=1e-10, polish=False
            )
            x = found.x
            for size in (1e-2, 1e-4):
                around = np.vstack([x, x + size * np.diag([b - a for a, b in bounds])])
                options = {"initial_simplex": np.clip(around, *np.array(bounds).T), "xatol": 1e-11, "fatol": 1e-11}
                x = minimize(merit, x, method="Nelder-Mead", bounds=bounds, options=options).x
            value = merit(x)
            if value < best[0]:
                best = value, self.gains(x, side)
        return best[1], best[0]


def checked(spec: DesignSpec, gains: FoPi) -> Verification:
    """The package's own verification of the loop on samples."""
    return verify(spec, gains, implementation=implementation_of(spec, gains))


def _from_unit(x: float, gain: GainRange) -> float:
    """u in [-1, 1] as a gain, logarithmic below the end of its range."""
    end = min(abs(gain.max if x >= 0 else gain.min), 1e6)
    least = 10.0**-DECADES
    return float(np.sign(x) * end * (10.0 ** (DECADES * (abs(x) - 1.0)) - least) / (1.0 - least))


def _outside(value: float, gain: GainRange) -> float:
    size = max(abs(value), 1e-12)
    return max((gain.min - value) / size, (value - gain.max) / size)


def _least(row: np.ndarray, value: np.ndarray, m: int) -> np.ndarray:
    found = np.full(m, np.inf)
    np.minimum.at(found, row, value)
    return found
