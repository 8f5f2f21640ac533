"""The oracle's worst margins against dense NumPy responses of plants drawn from the box."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from fopi_tune.core.controller import FoPi
from fopi_tune.design.constraints import STABILITY_GUARD, constraints_of, scale_of
from fopi_tune.design.oracle import Oracle
from fopi_tune.quantities.objectives import ObjectiveKind
from fopi_tune.spec import parse_spec
from fopi_tune.spec.model import DesignSpec

RESONANT = (
    "{model: transfer_function, numerator: [0.1], denominator: [1, 0.04, {min: 0.95, max: 1.05}], dead_time_s: 4.7}"
)
LEADING = "{model: transfer_function, numerator: [{min: 5, max: 20}, 0, 0], denominator: [1, 2, 1]}"
DELAYED = "{model: lag, static_gain: {min: 0.5, max: 2}, time_constant_s: {min: 1, max: 2}, dead_time_s: 0.3}"
TOO_SMALL = "{model: lag, static_gain: {min: 0.5, max: 0.9}, time_constant_s: 2}"
TOO_LARGE = "{model: transfer_function, numerator: [1, {min: 2, max: 3}], denominator: [1, 1]}"


def spec_of(plant: str, *requirements: str) -> DesignSpec:
    asked = "".join(f"  - {{{each}}}\n" for each in requirements)
    return parse_spec(f"schema: 1\nname: x\nplant: {plant}\nrequirements:\n{asked}")


def slacks(spec: DesignSpec, gains: FoPi, objective: ObjectiveKind = ObjectiveKind.DEPTH) -> list[float]:
    """The smallest slack of each requirement, then minus the objective's largest member, if it has any."""
    constraints = constraints_of(spec)
    found = Oracle(spec.plant, scale_of(spec), constraints, objective, 1.0).worst(gains)
    asked = [k for k, c in enumerate(constraints) if c.requirement != STABILITY_GUARD]
    kinds = [*asked, *([None] if any(f.constraint is None for f in found) else [])]
    return [min(f.slack for f in found if f.constraint == k) for k in kinds]


def dense_margins(spec: DesignSpec, gains: FoPi, low: float, high: float) -> tuple[float, float, float]:
    """Smallest phase margin (rad) and delay margin (s) of stable plants of the box, and the largest phase margin."""
    w = np.geomspace(low, high, 200_001)
    s = 1j * w
    phase, delay = [], []
    axes = np.linspace(spec.plant.low, spec.plant.high, 41 if len(spec.plant.low) == 1 else 7).T
    for theta in itertools.product(*axes):
        (top,), (bottom,), (late,) = spec.plant.coefficients(np.array([theta]))
        controller = gains.kp + gains.ki * s**-gains.alpha
        loop = controller * np.polyval(top, s) / np.polyval(bottom, s) * np.exp(-late * s)
        at = np.flatnonzero(np.diff(np.abs(loop) > 1.0))
        turned = np.angle(-loop[at])
        phase.append(np.abs(turned).min())
        delay.append((np.mod(turned, 2 * np.pi) / w[at]).min())
    return min(phase), min(delay), max(phase)


@pytest.mark.parametrize(
    ("plant", "gains"),
    [(RESONANT, FoPi(1.0, 0.02, 1.0)), (LEADING, FoPi(1.0, 0.0, 1.0)), (DELAYED, FoPi(1.5, 0.8, 1.1))],
)
def test_margins_are_those_of_dense_responses(plant: str, gains: FoPi) -> None:
    spec = spec_of(plant, "phase_margin_deg: {at_least: 60}")
    phase, _, _ = dense_margins(spec, gains, 1e-3, 1e2)
    # the scan's steps in omega are 6e-5 of it, in which the phase turns by up to 2e-3 rad at the resonance
    assert slacks(spec, gains) == pytest.approx([phase - np.radians(60.0)], abs=3e-3)


@pytest.mark.parametrize(("plant", "gains"), [(RESONANT, FoPi(1.0, 0.02, 1.0)), (DELAYED, FoPi(1.5, 0.8, 1.1))])
def test_delay_margins_are_those_of_dense_responses(plant: str, gains: FoPi) -> None:
    spec = spec_of(plant, "delay_margin_s: {at_least: 0.5}")
    _, delay, _ = dense_margins(spec, gains, 1e-3, 1e2)
    assert slacks(spec, gains) == pytest.approx([delay / 0.5 - 1.0], abs=5e-3)


def test_the_spread_is_of_the_smallest_margins() -> None:
    # a lag of kp = 2.5 crosses where the plants' own gains put it; the nominal plant is in the middle of the box
    spec = spec_of("{model: lag, static_gain: {min: 1, max: 3}, time_constant_s: 1}", "sensitivity_db: {at_most: 9}")
    gains = FoPi(2.5, 0.0, 1.0)
    # |L| = 1 at omega = sqrt((kp K)^2 - 1), the margin is 180 deg - atan(omega)
    margin = {k: np.pi - np.arctan(np.sqrt((2.5 * k) ** 2 - 1.0)) for k in (1.0, 2.0, 3.0)}
    spread = max(abs(margin[k] - margin[2.0]) for k in (1.0, 3.0))
    assert slacks(spec, gains, ObjectiveKind.PHASE_MARGIN_SPREAD)[-1] == pytest.approx(-spread, abs=1e-9)


@pytest.mark.parametrize(
    ("plant", "requirement", "met"),
    [
        # |L| < 1 everywhere: both margins are infinite
        (TOO_SMALL, "phase_margin_deg: {at_least: 60}", True),
        (TOO_SMALL, "delay_margin_s: {at_least: 1}", True),
        (TOO_SMALL, "phase_margin_deg: {at_most: 60}", False),
        (TOO_SMALL, "delay_margin_s: {equals: 1}, on: nominal", False),
        # |L| > 1 everywhere: the phase margin is infinite, any dead time makes the loop unstable
        (TOO_LARGE, "phase_margin_deg: {at_least: 60}", True),
        (TOO_LARGE, "delay_margin_s: {at_least: 1}", False),
        (TOO_LARGE, "delay_margin_s: {at_most: 1}", True),
        (TOO_LARGE, "phase_margin_deg: {equals: 60}, on: nominal", False),
        # a crossover that does not exist is neither above nor below anything
        (TOO_SMALL, "crossover_rad_s: {at_most: 1}", False),
        (TOO_SMALL, "crossover_rad_s: {at_least: 1}", False),
    ],
)
def test_loops_without_a_gain_crossover(plant: str, requirement: str, met: bool) -> None:
    (slack,) = slacks(spec_of(plant, requirement), FoPi(1.05, 0.0, 1.0))
    assert (slack == np.inf) is met
    assert (slack < -1.0) is not met


def test_without_a_crossover_an_unstable_loop_has_no_margin() -> None:
    # kp K > 1 of K (1 - s)/(1 + s): |L| > 1 everywhere, and the pole (kp K + 1)/(kp K - 1) is on the right
    spec = spec_of(
        "{model: transfer_function, numerator: [-1, 1], denominator: [1, 1]}", "phase_margin_deg: {at_least: 60}"
    )
    (slack,) = slacks(spec, FoPi(1.05, 0.0, 1.0))
    assert slack < -1.0
    (slack,) = slacks(spec, FoPi(0.95, 0.0, 1.0))
    assert slack == np.inf


def dense_worst(spec: DesignSpec, gains: FoPi, per_axis: int, low: float, high: float, count: int) -> dict[str, float]:
    """The largest |S|, |T| and |C S| over a grid of plants and frequencies, neper."""
    w = np.geomspace(low, high, count)
    s = 1j * w
    found = {"sensitivity_db": -np.inf, "complementary_sensitivity_db": -np.inf, "control_sensitivity_db": -np.inf}
    controller = gains.kp + gains.ki * s**-gains.alpha
    axes = [np.geomspace(a, b, per_axis) for a, b in zip(spec.plant.low, spec.plant.high, strict=True)]
    for theta in itertools.product(*axes):
        (top,), (bottom,), (late,) = spec.plant.coefficients(np.array([theta]))
        loop = controller * np.polyval(top, s) / np.polyval(bottom, s) * np.exp(-late * s)
        sizes = (1.0 / (1.0 + loop), loop / (1.0 + loop), controller / (1.0 + loop))
        for name, value in zip(found, sizes, strict=True):
            found[name] = max(found[name], float(np.log(np.abs(value)).max()))
    return found


@pytest.mark.parametrize("name", ["complementary_sensitivity_db", "control_sensitivity_db"])
def test_ripples_behind_a_dead_time_are_not_missed(name: str) -> None:
    # |L| = 0.55 and the phase turns 3 times between frequencies of the grid: |T| and |C S| reach |L|/(1 - |L|)
    plant = "{model: transfer_function, numerator: [0.5, 1.0], denominator: [1, 1], dead_time_s: {min: 2, max: 4}}"
    spec = spec_of(plant, f"{name}: {{at_most: 0}}, from_rad_s: 30, to_rad_s: 90")
    gains = FoPi(1.1, 0.2, 1.0)
    found = dense_worst(spec, gains, 61, 30.0, 90.0, 200_001)
    assert slacks(spec, gains) == pytest.approx([-found[name]], abs=1e-5)


def test_a_worst_plant_inside_of_a_wide_range_is_found() -> None:
    spec = spec_of(
        "{model: transfer_function, numerator: [{min: 1, max: 10}], "
        "denominator: [1, {min: 21, max: 35}, {min: 20, max: 40}]}",
        "complementary_sensitivity_db: {at_most: 0}",
    )
    gains = FoPi(36.0, 69.8, 1.0)
    # one axis at a time is dense enough: the worst denominator is a corner, its numerator near 1.1 (a scan of all)
    s = 1j * np.geomspace(0.5, 3.0, 20_001)
    values = []
    for gain in np.linspace(1.0, 1.5, 101):
        loop = (gains.kp + gains.ki / s) * gain / (s**2 + 35.0 * s + 20.0)
        values.append(np.log(np.abs(loop / (1.0 + loop))).max())
    assert 0 < int(np.argmax(values)) < 100
    (slack,) = slacks(spec, gains)
    assert slack == pytest.approx(-max(values), abs=1e-6)


def test_what_is_reached_only_in_a_limit_is_found_there() -> None:
    # |C S| rises to kp as omega -> inf, where alpha > 1, and |T| falls from 1 as omega -> 0
    spec = spec_of(
        "{model: lag, static_gain: {min: 1.79, max: 2.33}, time_constant_s: {min: 1.82, max: 2.72}}",
        "control_sensitivity_db: {at_most: 8.16}",
        "complementary_sensitivity_db: {at_most: -1}",
    )
    constraints = constraints_of(spec)
    found = Oracle(spec.plant, scale_of(spec), constraints, ObjectiveKind.KI, 1.0).worst(FoPi(2.55878, 3.00395, 1.4))
    control = min((f for f in found if f.constraint == 0), key=lambda f: f.slack)
    assert control.omega_rad_s == np.inf
    assert control.slack == pytest.approx(np.log(10.0) * 8.16 / 20.0 - np.log(2.55878), abs=1e-12)
    tracking = min((f for f in found if f.constraint == 1 and f.omega_rad_s == 0.0), key=lambda f: f.slack)
    assert tracking.slack == pytest.approx(-np.log(10.0) / 20.0, abs=1e-12)


def test_a_direct_path_of_more_than_one_leaves_no_delay_margin() -> None:
    # |L| = 2 at 0, passes 1 and rises to 1.2: there are gain crossovers, and any dead time makes the loop unstable
    plant = "{model: transfer_function, numerator: [1.2, 0.2, 2], denominator: [1, 2, 1]}"
    spec = spec_of(plant, "delay_margin_s: {at_least: 0.01}")
    assert slacks(spec, FoPi(1.0, 0.0, 1.0))[0] < 0.0
    assert slacks(spec, FoPi(0.5, 0.0, 1.0))[0] > 0.0


def test_a_gain_margin_is_also_where_the_loop_tends_to_a_negative_number() -> None:
    # positive feedback around a lag: L(0) = -0.4, and the phase never meets -180 deg at a frequency of its own
    spec = spec_of("{model: lag, static_gain: -0.4, time_constant_s: 1}", "gain_margin_db: {at_least: 6}")
    assert slacks(spec, FoPi(1.0, 0.0, 1.0)) == pytest.approx([-np.log(0.4) - np.log(10.0) * 6.0 / 20.0])
