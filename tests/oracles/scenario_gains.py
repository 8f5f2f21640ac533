"""Requirements and objectives of scenarios at given gains, by simulation of plants of the box and the verification.

Nothing of the search is used: a plant's measures are those of the compiled simulation, the frequency response is the
verification's.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from fopi_tune.core.bode_form import Array
from fopi_tune.core.controller import FoPi
from fopi_tune.core.loops import Plants
from fopi_tune.core.sampled_loops import SampledLoops
from fopi_tune.digital.implementation import implementation_of, runtime_of
from fopi_tune.errors import DomainError
from fopi_tune.proof import verify
from fopi_tune.simulation.measures import horizon_of, measure_values, scenario_of
from fopi_tune.simulation.sampled.simulate import measure
from fopi_tune.simulation.scenario import Mode
from fopi_tune.spec.model import DesignSpec, Relation
from fopi_tune.spec.scenarios import frequency_part

#: by which limits may be missed: relative, of overshoots to the size of a step
ALLOWED = 1e-6


def grid(spec: DesignSpec, per_axis: int) -> Array:
    """Plants of the box, shape (m, p)."""
    low, high = spec.plant.low, spec.plant.high
    shares = np.array(list(itertools.product(np.linspace(0.0, 1.0, per_axis), repeat=len(low)))).reshape(-1, len(low))
    return np.asarray(low + shares * (high - low))


def drawn(spec: DesignSpec, count: int, seed: int) -> Array:
    """Plants of the box, evenly, shape (count, p)."""
    low, high = spec.plant.low, spec.plant.high
    return np.asarray(low + np.random.default_rng(seed).random((count, len(low))) * (high - low))


def measured(spec: DesignSpec, gains: FoPi, scenario: str, name: str, points: Array) -> Array:
    """A measure of plants at points of the box, shape (m,); inf where it has no value.

    Raises:
        DomainError: there is no digital controller with these gains.
    """
    assert spec.digital is not None
    implementation = implementation_of(spec, gains)
    about = next(each for each in spec.scenarios if each.name == scenario)
    run = scenario_of(replace(about, noise_std=0.0, quantum=0.0), implementation, 0)
    runtime = runtime_of(implementation.sections, spec)
    found = measure([Mode(runtime, Plants.members(spec.plant, points))], run, horizon_of(about, run), threads=1)
    values = measure_values(found, name, spec.digital.measurement_unit)
    return np.where(np.isfinite(values), values, np.inf)


def missed(spec: DesignSpec, gains: FoPi, points: Array) -> list[float]:
    """By how much each requirement on a scenario is missed, in the measure's unit; negative inside."""
    found = []
    for limit in spec.scenario_requirements:
        side = 1.0 if limit.relation is Relation.AT_MOST else -1.0
        names = [limit.scenario] if limit.scenario is not None else [each.name for each in spec.scenarios]
        values = [measured(spec, gains, name, limit.measure, points) for name in names]
        found.append(max(float((side * (each - limit.limit)).max()) for each in values))
    return found


def objective(spec: DesignSpec, gains: FoPi, points: Array) -> float:
    """The worst plant's measure that is minimised, or minus the gain that is maximised."""
    aim = spec.objective
    assert aim is not None
    if aim.scenario is None:
        assert aim.quantity in ("ki", "integral_gain")
        return -gains.ki
    return float(measured(spec, gains, aim.scenario, aim.quantity, points).max())


def is_met(spec: DesignSpec, gains: FoPi, points: Array) -> bool:
    """Whether every requirement holds, of scenarios for these plants."""
    sizes = [
        max(abs(knot.value - scenario.initial_output) for scenario in spec.scenarios for knot in scenario.reference)
        if limit.measure in ("overshoot", "undershoot")
        else abs(limit.limit)
        for limit in spec.scenario_requirements
    ]
    both = zip(missed(spec, gains, points), sizes, strict=True)
    if any(by > ALLOWED * size for by, size in both) or is_refused_at_once(spec, gains, points):
        return False
    return verify(frequency_part(spec), gains, implementation=implementation_of(spec, gains)).all_met


def is_refused_at_once(spec: DesignSpec, gains: FoPi, points: Array) -> bool:
    """Whether limits of |S| and of the phase margin are missed clearly; the verification says the rest, and slower."""
    implementation = implementation_of(spec, gains)
    loops = SampledLoops.implemented(gains, implementation, Plants.members(spec.plant, points))
    omega = np.geomspace(1e-3, 0.999 * implementation.nyquist_rad_s, 300)
    rows = np.repeat(np.arange(len(points)), len(omega))
    response = loops.response(rows, np.tile(omega, len(points))).reshape(len(points), -1)
    for each in spec.requirements:
        band = (omega >= each.from_rad_s) & (omega <= each.to_rad_s)
        if each.quantity == "sensitivity_db" and each.relation is Relation.AT_MOST:
            least = 10.0 ** (-(each.limits[0] + 1e-3) / 20.0)
            if np.any(np.abs(1.0 + response[:, band]) < least):
                return True
        if each.quantity == "phase_margin_deg" and each.relation is Relation.AT_LEAST:
            # |1 + L| = 2 sin(margin/2) at |L| = 1, less next to it
            least = 2.0 * math.sin(math.radians(each.limits[0]) / 2.0)
            size = np.abs(response)
            crossed = (size[:, 1:] < 1.0) != (size[:, :-1] < 1.0)
            near_there = np.maximum(np.abs(1.0 + response[:, 1:]), np.abs(1.0 + response[:, :-1]))
            if np.any(crossed & (near_there < 0.97 * least)):
                return True
    return False


def best_of(
    spec: DesignSpec, candidates: Iterable[FoPi], points: Array, better_than: float
) -> tuple[float, FoPi | None]:
    """The best gains that meet everything with these plants, and their objective; None where none beat a value."""
    best, found = better_than, None
    for gains in candidates:
        try:
            value = objective(spec, gains, points)
            if value < best and is_met(spec, gains, points):
                best, found = value, gains
        except DomainError:
            continue
    return best, found


def near(spec: DesignSpec, gains: FoPi, count: int, seed: int) -> Iterable[FoPi]:
    """Gains about others, from a thousandth of them away to a half, within their ranges."""
    rng = np.random.default_rng(seed)
    ranges = spec.controller.ranges
    for _ in range(count):
        size, moved = 10.0 ** rng.uniform(-3.0, -0.3), {}
        for (name, ends), by in zip(ranges.items(), rng.normal(size=len(ranges)), strict=True):
            here = getattr(gains, name)
            there = here + 0.3 * size * by if name in ("alpha", "mu", "setpoint_weight") else here * math.exp(size * by)
            moved[name] = float(np.clip(there, ends.min, ends.max))
        yield replace(gains, **moved)
