"""The worst value over a family of loops on samples by `oracles.sampled_loops`:  a grid of members, then a search."""

from __future__ import annotations

import itertools
import math

import numpy as np
from oracles import sampled_loops as oracle
from scipy.optimize import minimize

from fopi_tune.core.parallel_form import Implementation
from fopi_tune.quantities import QUANTITIES
from fopi_tune.spec.model import DesignSpec, Relation


def badness(spec: DesignSpec, implementation: Implementation, point: np.ndarray, fine: bool) -> float:
    """sign times the requirement's value of one plant in natural units; nan where it has none."""
    asked = spec.requirements[0]
    loop = oracle.Loop.of(spec.plant.member(point), implementation)
    sign = 1.0 if asked.relation is Relation.AT_MOST else -1.0
    if QUANTITIES[asked.quantity].takes_band:
        return loop.extreme(asked.quantity, asked.from_rad_s, asked.to_rad_s, sign, fine)
    if asked.quantity == "gain_margin_db":
        useful = [value for value in loop.phase_crossovers() if value < 1.0]
        return sign * -math.log(max(useful)) if useful else math.nan
    crossovers = loop.gain_crossovers()
    if not crossovers:
        return math.nan
    if asked.quantity == "crossover_rad_s":
        return sign * math.log(crossovers[-1])
    if asked.quantity == "phase_slope_deg_per_decade":
        return sign * loop.phase_slope(crossovers[-1]) * math.log(10.0)
    angles = [loop.angle_from_minus_one(x) for x in crossovers]
    if asked.quantity == "phase_margin_deg":
        return sign * min(abs(angle) for angle in angles)
    if abs(loop.gain(np.array([loop.nyquist]))[0]) >= 1.0:
        return 0.0
    return sign * min(angle % (2.0 * math.pi) / x for angle, x in zip(angles, crossovers, strict=True))


def radius_of(spec: DesignSpec, implementation: Implementation, point: np.ndarray) -> float:
    """The largest |z| of a plant's closed-loop poles."""
    sections, delay = implementation.sections, implementation.delay_samples
    return float(oracle.sizes(oracle.sample(spec.plant.member(point), sections.sample_time_s, delay), sections).max())


def worst_of(spec: DesignSpec, implementation: Implementation) -> tuple[float, float]:
    """The worst value over the box in natural units, and the largest |z| of a closed-loop pole that was met."""
    low, high = spec.plant.low, spec.plant.high
    per_axis = {1: 33, 2: 8, 3: 5}[len(low)]
    shares = np.array(list(itertools.product(np.linspace(0.0, 1.0, per_axis), repeat=len(low))))
    points = low + shares * (high - low)
    radius = max(radius_of(spec, implementation, point) for point in points)
    values = np.array([badness(spec, implementation, p, fine=False) for p in points])
    if np.isnan(values).any() or radius >= 1.0 - 1e-9:
        return math.nan, float(radius)
    best = -math.inf
    for k in np.argsort(-values)[:2]:
        here = shares[k]
        best = max(best, badness(spec, implementation, points[k], fine=True))
        step = 0.5 / (per_axis - 1)
        towards = np.where(here > 0.5, -step, step)
        simplex = np.clip([here, *(here + towards * axis for axis in np.eye(len(low)))], 0.0, 1.0)
        found = minimize(
            lambda x: -badness(spec, implementation, low + np.clip(x, 0.0, 1.0) * (high - low), fine=True),
            here,
            method="Nelder-Mead",
            bounds=[(0.0, 1.0)] * len(low),
            options={"xatol": 1e-7, "fatol": 1e-9, "maxfev": 120 * len(low), "initial_simplex": simplex},
        )
        best = max(best, -float(found.fun))
    return (best if spec.requirements[0].relation is Relation.AT_MOST else -best), float(radius)
