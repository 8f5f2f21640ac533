"""The hybrid model:  its closed loops, its states, and the switching between modes."""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction

import numpy as np

from fopi_tune.paper.published import BRAKE, TAU_NOMINAL_S, THROTTLE, THROTTLE_GAIN, THROTTLE_PLANT, THROTTLE_POLE_RAD_S
from fopi_tune.paper.table import Row, Verdict, rounded_count, verdict_of
from fopi_tune.paper.variants import brake_plant, system
from fopi_tune.pipeline.systems import simulate_system
from fopi_tune.results.simulation import ScenarioResult

#: relative; two formulas of the same thing, in floating point
_SAME = 1e-9
#: of two numerical inversions that are each exact to 1e-8
_SAME_RESPONSE = 1e-7
_TIMES_S = (1.0, 5.0, 20.0)
#: changes of the mode that a clean switching figure may have: two a change of the setpoint
_CLEAN_SWITCHES = 4
#: km/h; a car that stays this close to its setpoint at the end is tracking
_TRACKS_KMH = 1.0


def hybrid() -> tuple[Row, ...]:
    """The claims: models, then switching."""
    sampled = simulate_system(system("switching")).driven[0]
    exact = simulate_system(system("switching"), exact=True).driven[0]
    return (_closed_loop(), _model(), _states(), _no_hysteresis(exact), _stays_bounded(sampled), _memories())


def _closed_loop() -> Row:
    """Y/R = (a s^alpha + b)/(s^(alpha+1) + (tau_i + a) s^alpha + b) against C P/(1 + C P)."""
    s = 1j * np.geomspace(1e-3, 1e3, 61)
    largest = 0.0
    pairs = ((THROTTLE.gains, THROTTLE_GAIN, THROTTLE_POLE_RAD_S), (BRAKE.gains, 1 / TAU_NOMINAL_S, 1 / TAU_NOMINAL_S))
    for gains, gain, pole in pairs:
        a, b, power = gain * gains.kp, gain * gains.ki, s**gains.alpha
        stated = (a * power + b) / (power * s + (pole + a) * power + b)
        loop = (gains.kp + gains.ki / power) * gain / (s + pole)
        largest = max(largest, float(np.abs(stated * (1.0 + loop) / loop - 1.0).max()))
    return Row(
        "Y/R = (a s^alpha + b)/(s^(alpha + 1) + (tau_i + a) s^alpha + b)",
        "a = K kp, b = K ki",
        "equal to C G/(1 + C G) in both modes" if largest < _SAME else f"off by {largest:.1e}",
        verdict_of(largest < _SAME),
        f"To {_SAME:g} (relative) from 1e-3 to 1e3 rad/s.",
    )


def _model() -> Row:
    # loaded here: the inversion brings SciPy
    from fopi_tune.simulation.fractional.commensurate import commensurate_model, step_response
    from fopi_tune.simulation.fractional.linear import Signal, exact_response

    gains = THROTTLE.gains
    model = commensurate_model(gains.kp, gains.ki, Fraction(THROTTLE.alpha.text), THROTTLE_GAIN, THROTTLE_POLE_RAD_S)
    found = step_response(model, _TIMES_S).value
    exact = exact_response(gains, THROTTLE_PLANT, Signal.OUTPUT_AFTER_REFERENCE, _TIMES_S)
    same = bool(np.abs(found - exact).max() < _SAME_RESPONSE)
    return Row(
        "The pseudo-state model D^(1/q) x = A x + B r, y = C x has this response",
        "A, B, C",
        "throttle, unit step: " + ", ".join(f"y({t:g}) = {y:.4f}" for t, y in zip(_TIMES_S, found, strict=True)),
        verdict_of(same),
        f"Equal to the inverted transform to {_SAME_RESPONSE:g}.",
    )


def _states() -> Row:
    from fopi_tune.simulation.fractional.commensurate import commensurate_model

    sizes = []
    for printed, plant in ((THROTTLE, THROTTLE_PLANT), (BRAKE, brake_plant())):
        lead, rest = plant.denominator
        gain, pole, gains = plant.numerator[0] / lead, rest / lead, printed.gains
        sizes.append(len(commensurate_model(gains.kp, gains.ki, Fraction(printed.alpha.text), gain, pole).b))
    return Row(
        "x does not change during a jump",
        "x+ = x, x in R^(alpha_i + 1)",
        f"x has p + q = {sizes[0]} components with the throttle (4/5) and {sizes[1]} with the brake (9/20)",
        verdict_of(sizes[0] == sizes[1]),
        "The two states are not in one space. It has a meaning for the velocity alone, with a memory of its own for "
        "each controller, held, tracking or reset.",
    )


def _no_hysteresis(exact: ScenarioResult) -> Row:
    slides = exact.chattering and "sliding" in exact.outcome
    return Row(
        "With eps = 0 the modes switch a few times (the switching figure)",
        "a figure",
        f"in continuous time both modes head for the line y = r: sliding from {exact.switch_times_s[-1]:.2f} s on"
        if slides
        else exact.outcome,
        verdict_of(not slides),
        "With setpoints of 30, 15 and 25 km/h; the printed flow and jump sets have no solution beyond that time.",
    )


def _stays_bounded(sampled: ScenarioResult) -> Row:
    switches = sampled.measures["switch_count"]
    error = abs(float(sampled.traces.error[0, -1]))
    return Row(
        "The system is stable during switching",
        "eps = 0",
        f"on samples of 0.2 s the modes change about {rounded_count(switches)} times in "
        f"{sampled.scenario.duration_s:g} s; {error:.1f} km/h off the setpoint at the end",
        verdict_of(error < _TRACKS_KMH, on_condition=switches > _CLEAN_SWITCHES),
        f"With sampling, which the model leaves out; stable: within {_TRACKS_KMH:g} km/h at the end. The actuators "
        "chatter.",
    )


def _memories() -> Row:
    car = system("car_held")
    counts: dict[str, float] = {}
    for inactive in ("held", "tracking", "reset"):
        driven = simulate_system(replace(car, inactive=inactive), scenario="experiment_1").driven[0]
        counts[inactive] = driven.measures["switch_count"]
    return Row(
        "The inactive controller keeps its memory",
        "x+ = x, and nothing else",
        f"changes of the mode in 150 s of town driving, eps = 0.5 km/h: about {rounded_count(counts['held'])} held, "
        f"{rounded_count(counts['tracking'])} tracking, {rounded_count(counts['reset'])} reset",
        Verdict.NOT_PRINTED,
        "systems/car_held.yaml, experiment 1. Held is what x+ = x comes nearest to.",
    )
