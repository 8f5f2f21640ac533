"""Experiments I and II:  bounds that hold for any reference, and simulations with plausible ones."""

from __future__ import annotations

from fopi_tune.montecarlo.systems import SystemEvidence
from fopi_tune.paper.published import (
    COMFORT_M_S2,
    CONTROL_LIMIT,
    MANOEUVRE_KMH,
    TAU_MAX_S,
    TAU_MIN_S,
    TAU_NOMINAL_S,
    THROTTLE_GAIN,
    THROTTLE_POLE_RAD_S,
)
from fopi_tune.paper.table import Row, Verdict, rounded_count, verdict_of
from fopi_tune.paper.variants import system
from fopi_tune.pipeline.systems import simulate_system, validate_system
from fopi_tune.results.simulation import ScenarioResult

EXPERIMENTS = ("experiment_1", "experiment_2")
_KMH = 3.6
_TITLE = {"experiment_1": "Experiment I", "experiment_2": "Experiment II"}


def experiments() -> tuple[Row, ...]:
    """Bounds for any reference, then both experiments."""
    car = system("car_held")
    evidence = validate_system(car).evidence
    rows = [_throttle(), _brake()]
    for name in EXPERIMENTS:
        (driven,) = simulate_system(car, scenario=name).driven
        rows += [_acceleration(name, driven, evidence), _control(driven), _tracking(driven)]
    return tuple(rows)


def _throttle() -> Row:
    """dy/dt = K u - p y with 0 <= u <= 1:  between -p y and K."""
    up, down = THROTTLE_GAIN * CONTROL_LIMIT / _KMH, THROTTLE_POLE_RAD_S * MANOEUVRE_KMH / _KMH
    return Row(
        f"With the throttle |a| <= {COMFORT_M_S2:g} m/s^2",
        f"[-{COMFORT_M_S2:g}, {COMFORT_M_S2:g}] m/s^2",
        f"at most {up:.2f} m/s^2 up from 0 km/h, {down:.2f} m/s^2 down from {MANOEUVRE_KMH:g} km/h",
        verdict_of(max(up, down) <= COMFORT_M_S2),
        "For every controller with a control in [0, 1]: dy/dt = K u - p y.",
    )


def _brake() -> Row:
    """dy/dt = (u - y)/tau with u <= 0:  at most -y/tau."""
    speeds = [COMFORT_M_S2 * _KMH * tau for tau in (TAU_MIN_S, TAU_NOMINAL_S, TAU_MAX_S)]
    return Row(
        f"With the brake |a| <= {COMFORT_M_S2:g} m/s^2, whatever the controller",
        f"[-{COMFORT_M_S2:g}, {COMFORT_M_S2:g}] m/s^2",
        f"only below {speeds[0]:.1f}, {speeds[1]:.1f}, {speeds[2]:.1f} km/h at tau = {TAU_MIN_S:g}, {TAU_NOMINAL_S:g}, "
        f"{TAU_MAX_S:g} s",
        verdict_of(speeds[0] >= MANOEUVRE_KMH),
        f"In the stated plant, with nothing else acting, a control u <= 0 slows the car by y/tau or more. From "
        f"{MANOEUVRE_KMH:g} km/h, or any speed above these, the limit is broken as soon as the brake's mode begins.",
    )


def _acceleration(name: str, driven: ScenarioResult, evidence: SystemEvidence) -> Row:
    judgement = next(s for s in evidence.scenarios if s.scenario == name)
    limit = next(j for j in judgement.limits if j.limit is not None and j.limit.measure == "acceleration_m_s2")
    share = limit.fraction
    return Row(
        f"{_TITLE[name]} keeps |a| <= {COMFORT_M_S2:g} m/s^2",
        f"[-{COMFORT_M_S2:g}, {COMFORT_M_S2:g}] m/s^2; the reference is not printed",
        f"on a plausible reference {driven.measures['acceleration_m_s2']:.2f} m/s^2 with the nominal brake; kept by "
        f"{share.estimate:.0%} of {share.total} brakes, largest {limit.worst[0].value:.2f} m/s^2",
        Verdict.NOT_PRINTED,
        "The reference decides: see the speeds above. The largest |a| is where the brake's mode begins.",
    )


def _control(driven: ScenarioResult) -> Row:
    measures = driven.measures
    return Row(
        f"{_TITLE[driven.scenario.name]} keeps its control in [-1, 1]",
        f"[-{CONTROL_LIMIT:g}, {CONTROL_LIMIT:g}]; the reference is not printed",
        f"limited to it, {measures['saturation_time_s']:.1f} s at a limit; about "
        f"{rounded_count(measures['switch_count'])} changes of the mode in {driven.scenario.duration_s:g} s"
        + (", chattering" if driven.chattering else ""),
        Verdict.NOT_PRINTED,
        "Throttle in [0, 1], brake in [-1, 0], hysteresis 0.5 km/h, memories held.",
    )


def _tracking(driven: ScenarioResult) -> Row:
    measures = driven.measures
    mean = measures["iae"] / driven.scenario.duration_s
    return Row(
        f"{_TITLE[driven.scenario.name]} tracks its reference",
        "a figure; the reference is not printed",
        f"mean |r - y| = {mean:.2f} km/h, {abs(driven.traces.error[0, -1]):.1f} km/h at the end",
        Verdict.NOT_PRINTED,
        "On a plausible reference (systems/car_held.yaml), nominal brake.",
    )
