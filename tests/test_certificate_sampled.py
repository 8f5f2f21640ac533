"""Loops on samples: never a wrong proof, never a wrong refutation, and no certificate that was changed.

The true worst value comes from `sampled_oracle`: state space, dense scans of the frequencies and of the box, and local
refinement.  A limit 1e-5 beyond it (in natural units, or relative) must be proved, one 1e-5 short of it refuted.
"""

from __future__ import annotations

import copy
import itertools
import json
import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
import sampled_oracle as oracle
from plants import brake, lag, pole, spec_of, transfer_function
from scipy.optimize import minimize

import fopi_tune as ft
from fopi_tune.core.plant import PlantFamily
from fopi_tune.core.sections import Implementation, Sections
from fopi_tune.digital.integrator import modified_oustaloup, oustaloup
from fopi_tune.digital.sections import matched, tustin
from fopi_tune.proof import certify, recheck, verify
from fopi_tune.proof.documents import digest, to_document
from fopi_tune.quantities import QUANTITIES
from fopi_tune.spec.model import DesignSpec, Relation, Requirement, Scope

OFFSET = 1e-5
REFERENCE = ft.FoPi(0.24027, 0.39344, 0.9)
Document = dict[str, Any]
#: what the oracle can measure, and on which side
ASKED = (
    *((name, upper) for name in ("sensitivity_db", "complementary_sensitivity_db") for upper in (True, True, False)),
    *((name, upper) for name in ("control_sensitivity_db", "loop_gain_db") for upper in (True, False)),
    *((name, False) for name in ("phase_margin_deg", "gain_margin_db", "delay_margin_s")),
    *(("crossover_rad_s", upper) for upper in (True, False)),
)


def filter_of(gains: ft.FoPi, sample_time_s: float, kind: int) -> Sections:
    """Some way to approximate s^-alpha on samples."""
    band = (1e-2 / sample_time_s / 30.0, 3.0 / sample_time_s)
    if kind == 0:
        return tustin(gains, oustaloup(gains.alpha, 4, band), sample_time_s)
    if kind == 1:
        return tustin(gains, modified_oustaloup(gains.alpha, 4, band), sample_time_s)
    return matched(gains, oustaloup(gains.alpha, 3, band), sample_time_s, 0.1 / sample_time_s)


def family(rng: np.random.Generator, sample_time_s: float) -> PlantFamily:
    """Lags, poles and second order with one to three uncertain numbers and any dead time."""

    def about(value: float, share: float) -> tuple[float, float, float] | float:
        if rng.random() >= share:
            return value
        width = float(rng.uniform(1.05, 1.4))
        ends = sorted((value / width, value * width))
        return value, ends[0], ends[1]

    u = rng.uniform
    dead_time = float(rng.choice([0.0, sample_time_s, float(u(0.1, 2.5)) * sample_time_s]))
    kind = rng.integers(0, 4)
    if kind <= 1:
        late = about(dead_time, 0.4) if dead_time > 0.0 else 0.0
        return lag(about(u(0.4, 3.0), 0.3), about(u(0.5, 4.0), 1.0), late)
    if kind == 2:
        slow = float(rng.choice([u(0.05, 1.0), 0.0, -u(0.02, 0.1)]))
        return pole(about(u(0.3, 1.5), 1.0), about(slow, 0.5) if slow != 0.0 else 0.0, dead_time)
    numerator = [u(-0.3, 0.3), u(0.5, 2.0)] if rng.random() < 0.5 else [u(0.5, 2.0)]
    denominator = [1.0, about(u(0.6, 2.0), 1.0), about(u(0.4, 2.0), 0.4)]
    return transfer_function(numerator, denominator, dead_time)


def design(seed: int) -> tuple[DesignSpec, ft.FoPi, Implementation, bool]:
    """A random spec with one limit that is not set yet, gains, and a filter; and the limit's side."""
    rng = np.random.default_rng(seed)
    sample_time_s = float(10.0 ** rng.uniform(-1.3, 0.0))
    plants = family(rng, sample_time_s)
    name, upper = ASKED[rng.integers(len(ASKED))]
    low, high = 0.0, math.inf
    nyquist = math.pi / sample_time_s
    if QUANTITIES[name].takes_band:
        low = float(nyquist * 10.0 ** rng.uniform(-2.0, -0.5)) if rng.random() < 0.6 or name == "loop_gain_db" else 0.0
        low = low if upper else float(max(low, 0.02 * nyquist))
        high = math.inf if rng.random() < 0.5 else float(max(low, 0.05 * nyquist) * rng.uniform(1.0, 3.0))
    gains = ft.FoPi(
        float(rng.choice([0.0, 1.0, 1.0, 1.0]) * 10.0 ** rng.uniform(-1.3, 0.1)),
        float(10.0 ** rng.uniform(-1.3, -0.1)),
        float(rng.uniform(0.4, 1.3)),
    )
    delay = float(rng.choice([0.0, 0.0, 0.5, 1.0, rng.uniform(0.0, 3.0)]))
    implementation = Implementation(filter_of(gains, sample_time_s, int(rng.integers(3))), delay)
    relation = Relation.AT_MOST if upper else Relation.AT_LEAST
    asked = Requirement(name, relation, (1.0,), Scope.FAMILY, low, high)
    return spec_of(plants, asked, name=f"seed_{seed}"), gains, implementation, upper


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
    margins = [loop.phase_margin(x) / (x if asked.quantity == "delay_margin_s" else 1.0) for x in crossovers]
    return sign * min(margins)


def worst_of(spec: DesignSpec, implementation: Implementation) -> tuple[float, float]:
    """The worst value over the box in natural units, and the largest |z| of a closed-loop pole that was met."""
    low, high = spec.plant.low, spec.plant.high
    per_axis = {1: 33, 2: 8, 3: 5}[len(low)]
    shares = np.array(list(itertools.product(np.linspace(0.0, 1.0, per_axis), repeat=len(low))))
    points = low + shares * (high - low)
    sections = implementation.sections
    radius = max(
        oracle.sizes(oracle.sample(spec.plant.member(p), sections.sample_time_s, implementation.delay_samples), sections).max()
        for p in points
    )  # fmt: skip
    values = np.array([badness(spec, implementation, p, fine=False) for p in points])
    if np.isnan(values).any() or radius >= 1.0 - 1e-9:
        return math.nan, float(radius)
    best = -math.inf
    for k in np.argsort(-values)[:2]:
        here = shares[k]
        best = max(best, badness(spec, implementation, points[k], fine=True))
        step = 0.5 / (per_axis - 1)
        found = minimize(
            lambda x: -badness(spec, implementation, low + np.clip(x, 0.0, 1.0) * (high - low), fine=True),
            here,
            method="Nelder-Mead",
            bounds=[(0.0, 1.0)] * len(low),
            options={
                "xatol": 1e-7,
                "fatol": 1e-9,
                "maxfev": 120 * len(low),
                "initial_simplex": np.clip([here, *(here + np.where(here > 0.5, -step, step) * e for e in np.eye(len(low)))], 0, 1),
            },
        )  # fmt: skip
        best = max(best, -float(found.fun))
    return (best if spec.requirements[0].relation is Relation.AT_MOST else -best), float(radius)


def verdict_at(spec: DesignSpec, gains: ft.FoPi, implementation: Implementation, natural: float) -> ft.Certificate:
    """The certificate of the spec with its limit at this value; it must also stand on its own."""
    asked = spec.requirements[0]
    limit = QUANTITIES[asked.quantity].from_natural(natural)
    moved = Requirement(asked.quantity, asked.relation, (limit,), asked.scope, asked.from_rad_s, asked.to_rad_s)
    with_limit = spec_of(spec.plant, moved, name=spec.name)
    certificate = certify(with_limit, verify(with_limit, gains, implementation=implementation), {}, implementation)
    document = json.loads(json.dumps(to_document(certificate), allow_nan=False))
    assert recheck(document, with_limit).problems == ()
    return certificate


def check_honesty(seed: int) -> str:
    """What was looked at: a bound, an unstable loop, or a quantity that a plant does not have."""
    spec, gains, implementation, upper = design(seed)
    worst, radius = worst_of(spec, implementation)
    if abs(radius - 1.0) < 1e-4:
        return "marginal"
    if radius > 1.0:
        certificate = certify(spec, verify(spec, gains, implementation=implementation), {}, implementation)
        assert certificate.stability.verdict is ft.Verdict.REFUTED
        assert recheck(to_document(certificate), spec).problems == ()
        return "unstable"
    if math.isnan(worst) or abs(worst) > 20.0:  # |L| passes 0 at Nyquist's frequency somewhere in the family
        return "none"
    if spec.requirements[0].quantity == "delay_margin_s" and worst <= 0.0:
        return "none"
    relative = spec.requirements[0].quantity in ("phase_margin_deg", "delay_margin_s")
    step = OFFSET * (max(abs(worst), 0.2) if relative else 1.0) * (1.0 if upper else -1.0)
    beyond = verdict_at(spec, gains, implementation, worst + step)
    assert beyond.stability.verdict is ft.Verdict.PROVED, spec
    assert beyond.requirements[0].verdict is ft.Verdict.PROVED, (
        spec,
        implementation,
        worst,
        beyond.requirements[0].reason,
    )
    short = verdict_at(spec, gains, implementation, worst - step)
    assert short.requirements[0].verdict is ft.Verdict.REFUTED, (
        spec,
        implementation,
        worst,
        short.requirements[0].bounds,
    )
    return "bound"
