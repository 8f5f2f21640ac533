"""Cases of time-domain requirements: three known designs, random ones, and the worst value that simulations find."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from cases.plants import lag, pole, transfer_function

import fopi_tune as ft
from fopi_tune.core.bode_form import Array
from fopi_tune.core.loops import Plants
from fopi_tune.core.parallel_form import Sections
from fopi_tune.core.plant import PlantFamily
from fopi_tune.digital.oustaloup import oustaloup
from fopi_tune.digital.realise import Precision
from fopi_tune.digital.runtime import Runtime
from fopi_tune.digital.transforms import tustin
from fopi_tune.proof.time_domain import TimeDomainCase
from fopi_tune.simulation.measures import measure_values
from fopi_tune.simulation.sampled.simulate import measure
from fopi_tune.simulation.scenario import Mode
from fopi_tune.spec.model import Knot, Limit, Relation, ScenarioSpec

Limits = tuple[float, float] | None


def filter_of(
    gains: ft.FoPi, sample_time_s: float, poles: int = 7, band: tuple[float, float] = (1e-3, 1e3)
) -> Sections:
    """The digital filter of the specs."""
    return tustin(gains, oustaloup(gains.alpha, poles, band), sample_time_s)


def at_most(case: TimeDomainCase, limit: float, measure_name: str | None = None) -> TimeDomainCase:
    """The case with another limit."""
    return replace(case, limit=Limit(measure_name or case.limit.measure, Relation.AT_MOST, float(limit)))


def case_of(
    family: PlantFamily, gains: ft.FoPi, sample_time_s: float, scenario: ScenarioSpec, limits: Limits = None,
    delay_samples: float = 0.0,
) -> TimeDomainCase:  # fmt: skip
    """A case about the overshoot."""
    runtime = Runtime.of(filter_of(gains, sample_time_s), Precision.FLOAT64, limits)
    limit = Limit("overshoot", Relation.AT_MOST, 1.0)
    return TimeDomainCase(family, runtime, sample_time_s, delay_samples, scenario, limit, "km/h")


def brake_ramp() -> TimeDomainCase:
    """The brake from 30 km/h with the pedal held, designed so that the largest acceleration is 2 m/s^2."""
    scenario = ScenarioSpec("ramp", 60.0, (Knot(0.0, 0.0, 4.5),), (Knot(0.0, 3.0),), initial_output=30.0)
    case = case_of(lag(10.0, (2.25, 1.6, 3.1)), ft.FoPi(0.3295032, 0.17540204, 0.96365415), 0.2, scenario)
    return at_most(case, 2.0, "acceleration_m_s2")


def saturated_throttle() -> TimeDomainCase:
    """The throttle to 20 km/h, which it can hardly reach: limited for seconds."""
    scenario = ScenarioSpec("town", 60.0, (Knot(0.0, 20.0),))
    return case_of(pole(4.39, (0.1746, 0.15, 0.2)), ft.FoPi(0.6, 0.25, 0.9), 0.2, scenario, (0.0, 1.0))


def three_numbers() -> TimeDomainCase:
    """Uncertain gain, time constant and dead time."""
    family = lag((1.0, 0.8, 1.25), (2.25, 1.6, 3.1), (0.3, 0.2, 0.4))
    gains = ft.FoPi(1.21134292, 0.63267927, 0.99976539)
    return case_of(family, gains, 0.1, ScenarioSpec("step", 40.0, (Knot(0.0, 1.0),)), delay_samples=1.0)


def points(family: PlantFamily, rng: np.random.Generator, count: int) -> Array:
    """Random plants, corners, and plants on faces; shape (m, p)."""
    axes = len(family.uncertain_names)
    if not axes:
        return np.zeros((1, 0))
    inside, faces = rng.random((count, axes)), rng.random((count // 2, axes))
    faces = np.where(rng.random(faces.shape) < 0.5, np.round(faces), faces)
    corners = np.array(np.meshgrid(*[[0.0, 1.0]] * axes, indexing="ij")).reshape(axes, -1).T
    return family.low + np.vstack([inside, faces, corners]) * (family.high - family.low)


def simulated(case: TimeDomainCase, plants: Array) -> Array:
    """The measure of plants by simulation; infinite where a loop is lost."""
    found = measure([Mode(case.controller, Plants.members(case.family, plants))], case.run, case.horizon)
    if case.limit.measure == "undershoot":
        raise ValueError("simulations do not measure it")
    values = measure_values(found, case.limit.measure, case.measurement_unit)
    return np.where(np.isnan(values), np.inf, values)


def sampled_worst(case: TimeDomainCase, rng: np.random.Generator, count: int = 2000, rounds: int = 10) -> float:
    """The largest measure of many plants, refined about the worst."""
    family, width = case.family, 1.0
    plants = points(family, rng, count)
    values = simulated(case, plants)
    for _ in range(rounds if len(family.uncertain_names) else 0):
        worst, reached, width = plants[values.argmax()], values.max(), 0.4 * width
        near = worst + (2.0 * rng.random((300, len(worst))) - 1.0) * width * (family.high - family.low)
        plants = np.vstack([np.clip(near, family.low, family.high), worst[None, :]])
        values = np.append(simulated(case, plants[:-1]), reached)
    return float(values.max())


def _family(rng: np.random.Generator, kind: str) -> PlantFamily:
    def about(value: float, share: float) -> float | tuple[float, float, float]:
        if rng.random() >= share:
            return value
        ends = sorted(value * (1.0 + sign * rng.uniform(0.03, 0.25)) for sign in (-1.0, 1.0))
        return value, ends[0], ends[1]

    dead: float | tuple[float, float, float] = 0.0
    if rng.random() > 0.6:
        late = round(rng.uniform(0.05, 0.6), 2)
        dead = late if rng.random() < 0.5 else (late, max(0.0, late - 0.1), late + 0.1)
    gain = float(rng.choice([1.0, 10.0, 0.5, -2.0]))
    if kind == "lag":
        return lag(about(gain, 0.3), about(rng.uniform(0.8, 4.0), 0.8), dead)
    if kind == "integrator":
        return pole(about(gain, 0.6), 0.0 if rng.random() < 0.5 else (0.0, -0.05, 0.1), dead)
    if kind == "unstable":
        return pole(about(gain, 0.4), (-0.15, -0.2, -0.1), dead)
    omega, damping = rng.uniform(0.7, 2.0), rng.uniform(0.4, 1.5)
    last = 0.0 if rng.random() < 0.2 else about(omega**2, 0.5)
    top = [about(gain * omega**2, 0.4)]
    if rng.random() < 0.3:
        top.insert(0, gain * rng.uniform(-0.3, 0.5))
    return transfer_function(top, [about(1.0, 0.2), about(2.0 * damping * omega, 0.5), last], dead)


def random_case(seed: int) -> TimeDomainCase:
    """A loop, a scenario and a measure: steps, ramps and loads, starts of all kinds, fractional delays, limits."""
    rng = np.random.default_rng(seed)
    kind = str(rng.choice(["lag", "lag", "integrator", "unstable", "second", "second"]))
    family, step = _family(rng, kind), float(rng.choice([0.1, 0.2]))
    top, bottom, _ = family.coefficients(family.nominal_point[None, :])
    first_order = kind != "second"
    gain, decay = (top[0, -1] / bottom[0, k] for k in ((0, 0) if first_order else (1, 1)))
    decay = bottom[0, 1 if first_order else 2] / bottom[0, 0 if first_order else 1]
    speed = rng.uniform(0.4, 1.2) * (1.0 if first_order else 0.5)
    kp = max(speed - decay, 0.05) / gain
    ki = rng.uniform(0.3, 0.9) * speed * max(decay, 0.3) / gain
    gains = ft.FoPi(abs(kp), abs(ki), float(rng.uniform(0.7, 1.2)))
    sections = filter_of(gains, step, int(rng.integers(3, 6)), (1e-2, 1e2))
    if gain < 0:
        sections = replace(sections, direct=-sections.direct, residues=tuple(-r for r in sections.residues))
    size = float(rng.choice([1.0, 15.0, 0.1]))
    start = float(rng.choice([0.0, 0.0, 2.0 * size, -size]))
    reference = [Knot(0.0, size, float(rng.choice([0.0, 0.0, 3.0])))]
    if rng.random() < 0.3:
        reference.append(Knot(8.0, 1.5 * size, float(rng.choice([0.0, 2.0]))))
    held = abs(size / gain) * max(decay, 0.2)
    load = [Knot(float(rng.choice([0.0, 5.0])), held * float(rng.uniform(-0.5, 0.5)))] if rng.random() < 0.4 else []
    scenario = ScenarioSpec(
        "s", float(rng.choice([12.0, 18.0])), tuple(reference), tuple(load), start,
        "free" if start and first_order and rng.random() < 0.4 else "rest", bool(rng.random() < 0.3),
        judged_from_s=float(rng.choice([0.0, 0.0, 4.0])), rate_per_s=1e5 if rng.random() < 0.1 else math.inf,
    )  # fmt: skip
    names = ["overshoot", "peak_control", "final_error", "settling_time_s", "iae", "ise"]
    name = str(rng.choice([*names, "peak_rate_per_s", "acceleration_m_s2"] if first_order else names))
    runtime = Runtime.of(sections, Precision.FLOAT64)
    delay = float(rng.choice([0.0, 0.0, 1.0, 0.3]))
    if load and delay == 1.0 and name.startswith(("peak_rate", "acceleration")):
        # where control and load arrive together between samples, the rounding of a simulation tells them apart
        delay = 0.0
    case = TimeDomainCase(family, runtime, step, delay, scenario, Limit(name, Relation.AT_MOST, 1.0), "km/h")
    if rng.random() < 0.35:
        most = simulated(at_most(case, 1.0, "peak_control"), points(family, rng, 50)).max()
        if math.isfinite(most):
            end = float(most * rng.uniform(0.6, 1.02))
            case = replace(case, controller=Runtime.of(sections, Precision.FLOAT64, (-end, end)))
    return case
