"""The one nonlinear program that serves every spec:  slots with parameters, compiled once a process by CasADi.

Unknown are the numbers of the controller (kp' = u0 z0, ki' = u1 z1, and u2 z2, which is alpha or kd', with orders also
these), the value t of an objective that is a largest or smallest member, and a frequency v of each slot.  A slot is
one plant at one frequency (its parameters: the coefficients of N and D, the dead time, weights), with

    an equation   that keeps v at a peak, at |L| = e^-(level + level_t t), at a phase, at v0, or at the first v
    a row         sign (limit - value) + with_t t + with_reference (angle of the first slot) >= 0  (or = 0) ,

where `value` is a weighted sum of ln|C| with its measurement filter, ln|L|, ln|1 + L|, the angle arg L + offset, that
angle over omega, the slope of arg L, ln omega, and ln|C(infinity)|.  Nothing is compiled for a spec.  The controller
enters through `controllers.py` alone, whose `Kind` says of which structure it is.  On samples v
is the coordinate of `samples.py`, with omega and the delay's phase by (1) and the filter by (2) there: a program for
each number of corners, whose parameters are what the corners and the gain depend on.  A program without a slot at a
peak, or with a slope, leaves these out.

CasADi takes Ctrl-C during a solve for a failure of the solver; `raising_interrupts` raises KeyboardInterrupt
nevertheless.
"""

from __future__ import annotations

import contextlib
import math
import signal
import threading
from collections.abc import Iterator
from functools import lru_cache
from types import FrameType
from typing import Any

import casadi as ca

from fopi_tune.design.global_search.compiled import COEFFICIENTS, DELAY, LAG, LAG_SQUARE, WIDTH, WITH_ORDERS
from fopi_tune.design.global_search.nonlinear.controllers import (
    Kind,
    Made,
    controller_at_infinity,
    controller_at_real,
    controller_parts,
    times,
)

#: names of a slot's parameters after its coefficients; a fractional plant's orders come behind
NAMES = (
    "near", "peak", "gain", "phase", "fixed", "reference", "level", "level_t", "v0",
    "log_c", "log_l", "log_s", "angle", "lag", "slope", "log_omega", "log_end",
    "offset", "sign", "limit", "with_t", "with_reference", "is_first",
)  # fmt: skip
PARAMETERS = COEFFICIENTS + len(NAMES)
PARAMETERS_WITH_ORDERS = PARAMETERS + WITH_ORDERS - COEFFICIENTS
#: points of a measured curve about a slot's frequency, and a slot's parameters with them
KNOTS = 10
MEASURED_PARAMETERS = PARAMETERS + 5 * KNOTS
INDEX = {name: COEFFICIENTS + k for k, name in enumerate(NAMES)}
SIZES = (4, 8, 16, 32)
#: rows for the discounted error
ERRORS = 4
#: parameters of the whole program: weights of ki and t in the cost, ln of ki' -> ki (constant, slope in the order), u0
#: to u2; with orders also ln of kd' -> kd
WHOLE = ("ki", "t", "log_ki", "log_ki_order", "unit_kp", "unit_ki", "unit_third")
WHOLE_WITH_ORDERS = (*WHOLE, "log_kd", "log_kd_order")
_TINY = 1e-200

OPTIONS = {
    "print_time": False,
    "error_on_fail": False,
    "show_eval_warnings": False,
    "calc_lam_p": False,
    # the gradient of the Lagrangian, which nothing asks for
    "no_nlp_grad": True,
    "ipopt.print_level": 0,
    "ipopt.sb": "yes",
    "ipopt.tol": 1e-9,
    "ipopt.constr_viol_tol": 1e-9,
    "ipopt.acceptable_tol": 1e-8,
    "ipopt.compl_inf_tol": 1e-10,
    "ipopt.bound_relax_factor": 0.0,
    "ipopt.max_iter": 80,
    "ipopt.mu_strategy": "monotone",
    "ipopt.mu_init": 1e-3,
    "ipopt.fixed_variable_treatment": "make_parameter",
}


def _polynomial(coefficients: Any, omega: Any) -> tuple[Any, Any]:
    real, imag = ca.SX(0), ca.SX(0)
    for k in range(WIDTH):
        real, imag = coefficients[k] - imag * omega, real * omega
    return real, imag


def _power_sum(coefficients: Any, orders: Any, terms: int, v: Any) -> tuple[Any, Any]:
    """A fractional plant's side at j e^v: its last terms, the others are 0."""
    real, imag = ca.SX(0), ca.SX(0)
    for k in range(WIDTH - terms, WIDTH):
        size, angle = coefficients[k] * ca.exp(orders[k] * v), orders[k] * (math.pi / 2)
        real, imag = real + size * ca.cos(angle), imag + size * ca.sin(angle)
    return real, imag


def _polynomials(p: Any, omega: Any) -> tuple[tuple[Any, Any], tuple[Any, Any], Any]:
    """N, D and ln|N| of a slot's plant."""
    top, bottom = _polynomial(p[:WIDTH], omega), _polynomial(p[WIDTH : 2 * WIDTH], omega)
    return top, bottom, _log_size(top)


def _power_sums(p: Any, terms: tuple[int, int], v: Any) -> tuple[tuple[Any, Any], tuple[Any, Any], Any]:
    """N, D and ln|N| of a slot's fractional plant."""
    orders = p[PARAMETERS:]
    top = _power_sum(p[:WIDTH], orders[:WIDTH], terms[0], v)
    return top, _power_sum(p[WIDTH : 2 * WIDTH], orders[WIDTH:], terms[1], v), _log_size(top)


def measured_plant(p: Any, v: Any) -> tuple[tuple[Any, Any], tuple[Any, Any], Any]:
    """A numerator with the phase of a slot's measured plant, the denominator of F, and ln|P|.

    Behind the other parameters are `KNOTS` points about the slot's frequency: v, ln|P| and its slopes, the phase and
    its slopes.  Between them the curve is cubic, as in `core/measured/curve.py`, and beyond them it goes on straight.

    Args:
        p: the slot's parameters.
        v: its frequency.
    """
    at, *columns = (p[PARAMETERS + KNOTS * k : PARAMETERS + KNOTS * (k + 1)] for k in range(5))
    values = []
    for y, slope in (columns[:2], columns[2:]):
        value = y[0] + slope[0] * ca.fmin(v - at[0], 0.0) + slope[KNOTS - 1] * ca.fmax(v - at[KNOTS - 1], 0.0)
        for k in range(KNOTS - 1):
            length = at[k + 1] - at[k]
            part = ca.fmin(ca.fmax((v - at[k]) / length, 0.0), 1.0)
            rise, a, b = y[k + 1] - y[k], slope[k] * length, slope[k + 1] * length
            value += part * (a + part * (3.0 * rise - 2.0 * a - b + part * (a + b - 2.0 * rise)))
        values.append(value)
    omega = ca.exp(v)
    bottom = 1.0 - p[LAG_SQUARE] * omega**2, p[LAG] * omega
    return (ca.cos(values[1]), ca.sin(values[1])), bottom, values[0]


def _log_size(a: tuple[Any, Any]) -> Any:
    return 0.5 * ca.log(a[0] ** 2 + a[1] ** 2)


def _slot(
    kp: Any, ki: Any, third: Any, t: Any, v: Any, first_v: Any, reference: Any, p: Any, kind: Kind,
    made: Made = None,
) -> tuple[Any, Any, Any]:  # fmt: skip
    """Equation, row and angle of a slot.

    What slots of this kind of program never ask for is left out: the derivatives of a peak are most of the work.
    """

    def of(name: str) -> Any:
        return p[INDEX[name]]

    omega = ca.exp(v)
    if kind.measured:
        top, bottom, log_top = measured_plant(p, v)
    elif kind.terms != (0, 0):
        top, bottom, log_top = _power_sums(p, kind.terms, v)
    else:
        top, bottom, log_top = _polynomials(p, omega)
    controller, half = controller_parts(kp, ki, third, v, made), None if made is None else made.half
    log_c = _log_size(controller)
    log_l = log_c + log_top - _log_size(bottom)
    # C N conj(D) has the phase of C P; `near` selects the branch
    product = times(times(controller, top), (bottom[0], -bottom[1]))
    turned = times(product, (ca.cos(of("near")), -ca.sin(of("near"))))
    angle_of_omega = omega if half is None else 2.0 * ca.atan(half * omega)
    phase = ca.atan2(turned[1], turned[0]) + of("near") - angle_of_omega * p[DELAY]
    log_omega, log_noise = v, log_c
    if kind.filtered:
        # |C S| has the measurement filter, which the plant's D holds as well
        log_noise = log_c - _log_size((1.0 - p[LAG_SQUARE] * omega**2, p[LAG] * omega))
    if half is not None:
        omega = 0.5 * angle_of_omega / half
        log_omega = ca.log(omega)
    gain = ca.exp(log_l)
    log_s = -_log_size((1.0 + gain * ca.cos(phase), gain * ca.sin(phase)))
    angle = phase + of("offset")
    band = of("log_c") * log_noise + of("log_l") * log_l + of("log_s") * log_s + of("log_omega") * log_omega
    log_end = 0.5 * ca.log(controller_at_infinity(kp, third, made, of("is_first")) ** 2 + _TINY)
    value = (
        band + of("angle") * angle + of("lag") * angle / omega + of("log_end") * log_end
    )  # fmt: skip
    equation = (
        of("gain") * (log_l + of("level") + of("level_t") * t)
        + of("phase") * angle + of("fixed") * (v - of("v0")) + of("reference") * (v - first_v)
    )  # fmt: skip
    if kind.slopes:
        slope = ca.gradient(phase, v) if half is None else ca.gradient(phase, v) / ca.gradient(log_omega, v)
        value += of("slope") * slope * math.log(10.0)
    if kind.peaks:
        equation += of("peak") * ca.gradient(band, v)
    row = of("sign") * (of("limit") - value) + of("with_t") * t + of("with_reference") * reference
    return equation, row, of("angle") * angle


def _parameters_of(kind: Kind) -> int:
    """How many parameters a slot has."""
    if kind.measured:
        return MEASURED_PARAMETERS
    return PARAMETERS if kind.terms == (0, 0) else PARAMETERS_WITH_ORDERS


@lru_cache
def solver_of(size: int, kind: Kind) -> Any:
    """Ipopt for at most `size` slots and a kind of controller.

    Unknown: z0, z1, ..., t, v of each slot.  Parameters: those of each slot in turn, (P(1/T), ln(1/T omega_s), on) of
    each error row, `WHOLE` or `WHOLE_WITH_ORDERS`, and the numbers of `Kind.of`.  Constraints: ki over its unit, with
    orders also kd, the slots' rows, the error rows, the slots' equations.
    """
    z, v = ca.SX.sym("z", kind.unknowns + 1), ca.SX.sym("v", size)
    p, errors = ca.SX.sym("p", _parameters_of(kind), size), ca.SX.sym("errors", 3, ERRORS)
    whole = ca.SX.sym("whole", len(WHOLE_WITH_ORDERS if kind.orders else WHOLE))
    kp, ki, third, t = z[0] * whole[4], z[1] * whole[5], z[2] * whole[6], z[kind.unknowns]
    numbers = ca.SX.sym("numbers", kind.parameters)
    made = kind.made(z, third, numbers)
    order = z[3] if kind.orders else 1.0 if kind.derivative else third
    public_ki = ki * ca.exp(whole[2] + whole[3] * order)
    public_kd = [third * ca.exp(whole[7] + whole[8] * z[4])] if kind.orders else []
    rows, equations, reference = [], [], ca.SX(0)
    for k in range(size):
        equation, row, angle = _slot(kp, ki, third, t, v[k], v[0], 0 if k == 0 else reference, p[:, k], kind, made)
        reference = angle if k == 0 else reference
        equations.append(equation)
        rows.append(row)
    for k in range(ERRORS):
        plant = errors[0, k]
        loop = plant * controller_at_real(kp, ki, third, errors[1, k], made)
        rows.append(errors[2, k] * (t - 0.5 * ca.log(plant**2) + 0.5 * ca.log((1.0 + loop) ** 2)))
    cost = -whole[0] * public_ki + whole[1] * t
    program = {
        "x": ca.vertcat(z, v),
        "p": ca.vertcat(ca.vec(p), ca.vec(errors), whole, numbers),
        "f": cost,
        "g": ca.vertcat(public_ki, *public_kd, *rows, *equations),
    }
    return ca.nlpsol(f"global_{size}_{kind.corners}", "ipopt", program, OPTIONS)


@contextlib.contextmanager
def raising_interrupts() -> Iterator[None]:
    """Raise KeyboardInterrupt at the end of the block if Ctrl-C came inside it and was swallowed.

    Nothing is changed where the handler is not Python's own, or outside the main thread, which alone gets signals.
    """
    usual = signal.default_int_handler
    is_main = threading.current_thread() is threading.main_thread()
    if not is_main or signal.getsignal(signal.SIGINT) is not usual:
        yield
        return
    received: list[int] = []

    def on_interrupt(number: int, frame: FrameType | None) -> None:
        received.append(number)
        usual(number, frame)

    signal.signal(signal.SIGINT, on_interrupt)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, usual)
    if received:
        raise KeyboardInterrupt
