"""The gain margin:  an equality without a solution, and a misprinted formula."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from fopi_tune.core.controller import FoPi
from fopi_tune.core.margins import margins
from fopi_tune.paper.claims.brake import PLANT_GAIN
from fopi_tune.paper.published import BRAKE, SPECIFIED_GAIN_MARGIN, TAU_NOMINAL_S, THROTTLE, THROTTLE_PLANT
from fopi_tune.paper.table import Row, verdict_of
from fopi_tune.paper.variants import brake_plant, nominal_requirements, spec, with_alpha, with_requirements
from fopi_tune.pipeline.tune import tune
from fopi_tune.results.status import Status
from fopi_tune.spec.model import Relation, Requirement, Scope

#: s; that of specs/brake_delay.yaml
_DEAD_TIME_S = 0.3
#: dB; a residual that counts as 0
_ZERO_DB = 1e-6
_MARGIN_DB = 20.0 * math.log10(SPECIFIED_GAIN_MARGIN.value)


def gain_margin() -> tuple[Row, ...]:
    """The claims about Mg = 4."""
    return (_published(), _equality(), _with_dead_time(), _formula(), _crossover_terms())


def _published() -> Row:
    found = margins(BRAKE.gains, brake_plant())
    omega = np.geomspace(1e-6, 1e6, 2401)
    controller = BRAKE.gains.kp + BRAKE.gains.ki * (1j * omega) ** -BRAKE.gains.alpha
    least = float(np.degrees(np.angle(controller) - np.arctan(TAU_NOMINAL_S * omega)).min())
    assert found.gain_margin_db is not None
    margin = "infinite" if math.isinf(found.gain_margin_db) else f"{found.gain_margin_db:.2f} dB"
    return Row(
        f"The brake's gain margin is {SPECIFIED_GAIN_MARGIN.text}",
        f"Mg = {SPECIFIED_GAIN_MARGIN.text}",
        f"gain margin {margin}; the phase stays above {math.floor(least):d} deg",
        verdict_of(SPECIFIED_GAIN_MARGIN.agrees(10.0 ** (found.gain_margin_db / 20.0))),
        "Without dead time a first-order plant with kp, ki >= 0 and alpha <= 1 never turns the phase to -180 deg.",
    )


def _equality() -> Row:
    """As an equality, with and without the other two specifications."""
    wanted = spec("brake")
    equality = Requirement("gain_margin_db", Relation.EQUALS, (_MARGIN_DB,), Scope.NOMINAL)
    alone = tune(with_alpha(with_requirements(wanted, equality), 0.3, 1.0), proof=False, bracket=False)
    three = tune(with_requirements(wanted, *nominal_requirements(wanted), equality), proof=False, bracket=False)
    return Row(
        f"PM = 90 deg, 0.3 rad/s and Mg = {SPECIFIED_GAIN_MARGIN.text} can hold together, as equalities",
        "fmincon, with the equalities as constraints",
        f"Mg alone, alpha <= 1: {alone.status.value}; all three, alpha <= 1.5: {three.status.value}",
        verdict_of(three.status is Status.SOLVED),
        "With the other two the gain margin is infinite for every alpha; alone, alpha > 1 makes it finite. It must be "
        "an inequality, which an infinite margin meets.",
    )


def _with_dead_time() -> Row:
    gains = BRAKE.gains
    found = margins(gains, brake_plant(PLANT_GAIN, dead_time_s=_DEAD_TIME_S))
    assert found.gain_margin_db is not None
    return Row(
        "The brake's gain margin is finite and large enough",
        f"Mg = {SPECIFIED_GAIN_MARGIN.text} (12.04 dB)",
        f"{found.gain_margin_db:.2f} dB = {10 ** (found.gain_margin_db / 20.0):.2f} with a static gain of "
        f"{PLANT_GAIN:g} and {_DEAD_TIME_S:g} s of dead time",
        verdict_of(_MARGIN_DB <= found.gain_margin_db < math.inf, on_condition=True),
        "With a plant gain and a dead time (actuator, sampling) that are not printed, and as an inequality.",
    )


def _formula() -> Row:
    """Equation N4, evaluated for a loop whose gain margin is exactly 4."""
    plant = brake_plant(PLANT_GAIN, dead_time_s=_DEAD_TIME_S)
    first = margins(BRAKE.gains, plant)
    assert first.gain_margin_rad_s is not None
    assert first.gain_margin_db is not None
    factor = 10.0 ** ((first.gain_margin_db - _MARGIN_DB) / 20.0)
    gains = replace(BRAKE.gains, kp=factor * BRAKE.gains.kp, ki=factor * BRAKE.gains.ki)
    gain_db = 20.0 * math.log10(_loop_gain(gains, PLANT_GAIN, first.gain_margin_rad_s))
    printed, mended = gain_db - 1.0 / SPECIFIED_GAIN_MARGIN.value, gain_db + _MARGIN_DB
    return Row(
        "Equation N4 says that the gain margin is Mg: 20 log |L| - 1/Mg = 0",
        "20 log |L| - 1/Mg",
        f"{printed:.2f} dB at a loop with Mg = {SPECIFIED_GAIN_MARGIN.text}; 20 log10 |L| + 20 log10 Mg is "
        f"{'0' if abs(mended) < _ZERO_DB else f'{mended:.2g}'} there",
        verdict_of(abs(printed) < _ZERO_DB),
        f"A misprint: decibels less an absolute number. 0 means below {_ZERO_DB:g} dB.",
    )


def _loop_gain(gains: FoPi, static_gain: float, omega: float) -> float:
    controller = gains.kp + gains.ki * (1j * omega) ** -gains.alpha
    return abs(controller) * static_gain / math.hypot(1.0, TAU_NOMINAL_S * omega)


def _crossover_terms() -> Row:
    (angle_deg,) = margins(THROTTLE.gains, THROTTLE_PLANT).angles_from_minus_one_deg
    return Row(
        "omega_cp is the phase crossover, omega_cg the gain crossover",
        "omega_cp: phase crossover; omega_cg: gain crossover",
        f"at the throttle's omega_cp |L| = 1 and arg L = {angle_deg - 180.0:.1f} deg",
        verdict_of(math.isclose(angle_deg, 0.0, abs_tol=1e-6)),
        "The words are swapped where the gain margin is defined: at a phase crossover arg L is -180 deg.",
    )
