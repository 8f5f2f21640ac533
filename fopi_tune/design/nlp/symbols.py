"""The loop in CasADi's symbols, written from the definitions independently of `core/`; a test compares the two.

With s = j omega, omega = omega_s e^v, and gains scaled as in `fopi_tune.design.constraints`:

    C g_s = kp' + ki' e^{-alpha v} (cos(alpha pi/2) - j sin(alpha pi/2)),
    L     = (C g_s) (N(s)/D(s)/g_s) e^{-j omega L} .
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import casadi as ca

from fopi_tune.core.plant import PlantFamily
from fopi_tune.design.constraints import Scale

#: outputs of `loop_function`, in order; the attributes of `fopi_tune.quantities.base.LoopSymbols`
OUTPUTS = (
    "log_gain",
    "phase_rad",
    "phase_margin_rad",
    "lag_to_minus_one_rad",
    "phase_slope_rad",
    "log_return_difference",
    "log_controller",
    "log_omega",
    "omega_rad_s",
)


@dataclass(frozen=True)
class SymbolicLoop:
    """A loop at one plant and one frequency; see `LoopSymbols`."""

    log_gain: Any
    phase_rad: Any
    phase_margin_rad: Any
    lag_to_minus_one_rad: Any
    phase_slope_rad: Any
    log_return_difference: Any
    log_controller: Any
    log_omega: Any
    omega_rad_s: Any


def _polynomial(coefficients: list[Any], omega: Any) -> tuple[Any, Any]:
    """Real and imaginary part at s = j omega, by Horner's rule."""
    real, imag = ca.SX(0), ca.SX(0)
    for coefficient in coefficients:
        real, imag = coefficient - imag * omega, real * omega
    return real, imag


def _times(a: tuple[Any, Any], b: tuple[Any, Any]) -> tuple[Any, Any]:
    return a[0] * b[0] - a[1] * b[1], a[0] * b[1] + a[1] * b[0]


def _log_size(a: tuple[Any, Any]) -> Any:
    return 0.5 * ca.log(a[0] ** 2 + a[1] ** 2)


def loop_function(family: PlantFamily, scale: Scale) -> ca.Function:
    """(gains (3,), theta (p,), v, phase_near, side) -> `OUTPUTS`.

    `phase_near` is the phase (rad) of the delay-free loop near the point.  It selects the branch of the phase, which is
    smooth as long as the phase stays within half a turn of it.  Of a gain crossover 180 deg + that branch is the angle
    from -1 of `fopi_tune.design.margin_sides`, and `side` the side on which it must stay.
    """
    gains, v, near, side = ca.SX.sym("gains", 3), ca.SX.sym("v"), ca.SX.sym("near"), ca.SX.sym("side")
    theta = ca.SX.sym("theta", len(family.uncertain_names))
    kp, ki, alpha = gains[0], gains[1], gains[2]
    omega = scale.omega_rad_s * ca.exp(v)
    values = {name: theta[i] for i, name in enumerate(family.uncertain_names)}
    numerator, denominator, dead_time = family.assemble(values)

    power = ki * ca.exp(-alpha * v)
    angle = alpha * (ca.pi / 2)
    controller = (kp + power * ca.cos(angle), -power * ca.sin(angle))
    top, bottom = _polynomial(numerator, omega), _polynomial(denominator, omega)
    # C N conj(D) has the phase of C P; the gain is computed from the factors.
    direction = _times(_times(controller, top), (bottom[0], -bottom[1]))
    log_controller = _log_size(controller)
    log_gain = log_controller + _log_size(top) - _log_size(bottom) - ca.log(scale.gain)
    turned = _times(direction, (ca.cos(near), -ca.sin(near)))
    phase = ca.atan2(turned[1], turned[0]) + near - omega * dead_time
    gain = ca.exp(log_gain)
    log_return_difference = _log_size((1.0 + gain * ca.cos(phase), gain * ca.sin(phase)))
    outputs = [
        log_gain,
        phase,
        side * (phase + ca.pi),
        phase + ca.pi + ca.pi * (1.0 - side),
        ca.gradient(phase, v),
        log_return_difference,
        log_controller - ca.log(scale.gain),
        v + ca.log(scale.omega_rad_s),
        omega,
    ]
    inputs = {"gains": gains, "theta": theta, "v": v, "near": near, "side": side}
    return ca.Function("loop", list(inputs.values()), outputs, list(inputs), list(OUTPUTS))
