"""Responses of the controllers of `structures.py`, and those of a ray on a table (compiled).

With (2a) C = x0 + x1 s^-alpha + x2 s^mu/(Tf s + 1) the phase is followed from column to column: next to a zero of C, in
steps between them.

Source: derived.
"""

from __future__ import annotations

import math

import numpy as np

from fopi_tune.design.global_search.compiled import END, compiled
from fopi_tune.design.global_search.samples import (
    ALPHA,
    FILTER,
    GAIN,
    MU,
    controller_of,
    filter_at,
    integral_at_real,
)

_PI = math.pi
#: |C|^2 that stands for 0
_TINY = 1e-60
#: rad; a turn of C between columns that is followed in steps, and the least step in v
_FAR_TURN, _LEAST_STEP = 1.2, 1e-7


@compiled
def order_of(third, sampling):
    """The order of the integral, which turns scaled ki into the user's."""
    return third if sampling.derivative == 0.0 else sampling.order


@compiled
def has_orders(x):
    """Whether integral and derivative of what `controller_of` makes of the numbers have other orders than 1."""
    return len(x) > 3 and (x[ALPHA] != 1.0 or x[MU] != 1.0)


@compiled
def derivative_at(mu, filter_time, v):
    """s^mu/(Tf s + 1) at s = j e^v, as s^(mu - 1)/(Tf + 1/s)."""
    lag, rest = math.exp(-v), mu - 1.0
    size = math.exp(rest * v) / (filter_time * filter_time + lag * lag)
    cosine, sine = size * math.cos(0.5 * _PI * rest), size * math.sin(0.5 * _PI * rest)
    return cosine * filter_time - sine * lag, sine * filter_time + cosine * lag


@compiled
def controller_at(x, v):
    """Real and imaginary part of C at j e^v; x is what `controller_of` makes of the numbers."""
    if len(x) == 3:
        power = x[1] * math.exp(-x[2] * v)
        return x[0] + power * math.cos(0.5 * _PI * x[2]), -power * math.sin(0.5 * _PI * x[2])
    if has_orders(x):
        power, angle = x[1] * math.exp(-x[ALPHA] * v), 0.5 * _PI * x[ALPHA]
        real, imag = derivative_at(x[MU], x[FILTER], v)
        return x[0] + power * math.cos(angle) + x[2] * real, -power * math.sin(angle) + x[2] * imag
    omega = math.exp(v)
    real, imag = filter_at(x, omega)
    real, imag = x[0] + x[1] * real, x[1] * imag
    if x[FILTER] > 0.0:
        #  D = j omega/(1 + j omega Tf)
        part = x[2] * omega / (1.0 + (omega * x[FILTER]) ** 2)
        real, imag = real + part * omega * x[FILTER], imag + part
    return real, imag


@compiled
def controller_at_real(x, log_s):
    """C at a real s; x is what `controller_of` makes of the numbers."""
    if has_orders(x):
        derivative = math.exp(x[MU] * log_s) / (x[FILTER] * math.exp(log_s) + 1.0)
        return x[0] + x[1] * math.exp(-x[ALPHA] * log_s) + x[2] * derivative
    value = x[0] + x[1] * integral_at_real(x, log_s)
    if len(x) > 3 and x[FILTER] > 0.0:
        s = math.exp(log_s)
        value += x[2] * s / (x[FILTER] * s + 1.0)
    return value


@compiled
def controller_at_infinity(x):
    """C as s tends to infinity; x is what `controller_of` makes of the numbers."""
    return x[0] + x[2] / x[FILTER] if len(x) > 3 and x[FILTER] > 0.0 and x[MU] == 1.0 else x[0]


@compiled
def first_term(third, c, s, sampling):
    """The gain of the term that dominates as omega -> 0."""
    if s != 0.0:
        return s
    return third if c == 0.0 and sampling.derivative > 0.0 else c


@compiled
def fill_controller(third, c, s, table, work):
    """Write ln|C0|, C0 and arg C0 of all columns into the scratch.

    The phase is that from the real axis as omega -> 0: -90 deg times the order, less 180 deg where the first term is
    negative.
    """
    sampling = table.sampling
    if sampling.derivative > 0.0:
        x, lead = controller_of(np.array((c, s, third)), sampling), first_term(third, c, s, sampling)
        if has_orders(x):
            _fill_with_orders(x, lead, table, work)
        else:
            _fill_with_derivative(x, lead, table, work)
    else:
        _fill_fractional(third, c, s, table, work)


@compiled
def fill_order(alpha, table, work):
    """Write (j omega)^-alpha, on samples the filter F, of all columns into the scratch, unless it is there."""
    if work.order[0] == alpha:
        return
    n = len(table.v)
    cosine, sine = math.cos(0.5 * _PI * alpha), math.sin(0.5 * _PI * alpha)
    sampled = table.sampling.half > 0.0
    controller = controller_of(np.array((0.0, 1.0, alpha)), table.sampling)
    if sampled:
        # at both ends of the axis the filter is an integrator
        cosine, sine = 0.0, 1.0
    for j in range(n):
        x = math.exp(-alpha * table.v[j])
        if j == 0:
            x = math.exp(END)
        elif j == n - 1:
            x = math.exp(-END)
        real, imag = x * cosine, -x * sine
        if sampled and 0 < j < n - 1:
            real, imag = filter_at(controller, math.exp(table.v[j]))
        work.power[0, j], work.power[1, j] = real, imag
    work.order[0] = alpha


@compiled
def _fill_fractional(alpha, c, s, table, work):
    """`fill_controller` of (1)."""
    fill_order(alpha, table, work)
    sampled = table.sampling.half > 0.0
    negative = s < 0 or (s == 0 and c < 0)
    for j in range(len(table.v)):
        real, imag = c + s * work.power[0, j], s * work.power[1, j]
        angle = math.atan2(-imag, -real) - _PI if negative else math.atan2(imag, real)
        if sampled and angle > (-0.5 * _PI if negative else 0.5 * _PI):
            # an order close to 2, whose filter turns a little further than -180 deg
            angle -= 2.0 * _PI
        work.controller[0, j] = 0.5 * math.log(real * real + imag * imag)
        work.controller[1, j], work.controller[2, j], work.controller[3, j] = real, imag, angle


@compiled
def _fill_with_derivative(x, lead, table, work):
    """`fill_controller` of (2).

    Where Im C changes its sign, once, Re C is kp + Tf ki e^g: its sign says on which side of 0 the locus passes.
    """
    n, sign = len(table.v), (-1.0 if lead < 0.0 else 1.0)
    by_left = x[1] != 0.0 and sign * (x[0] + x[FILTER] * x[1] * x[GAIN]) < 0.0
    for j in range(n):
        real, imag = controller_at(x, -END if j == 0 else (END if j == n - 1 else table.v[j]))
        angle = math.atan2(sign * imag, sign * real)
        if by_left and angle > 0.0:
            angle -= 2.0 * _PI
        work.controller[0, j] = 0.5 * math.log(max(real * real + imag * imag, _TINY))
        work.controller[1, j], work.controller[2, j] = real, imag
        work.controller[3, j] = angle if lead > 0.0 else angle - _PI


@compiled
def fill_rise(x, table, work):
    """Write s^mu/(Tf s + 1) of all columns into the scratch, unless it is there."""
    if work.rise_order[0] == x[MU]:
        return
    n = len(table.v)
    for j in range(n):
        work.rise[0, j], work.rise[1, j] = derivative_at(x[MU], x[FILTER], table.v[j])
    # as omega -> 0 it tends to 0, as omega -> inf to 1/Tf or to 0, each on its ray
    angle, size = 0.5 * _PI * x[MU], math.exp(-END)
    work.rise[0, 0], work.rise[1, 0] = size * math.cos(angle), size * math.sin(angle)
    angle -= 0.5 * _PI
    size = (1.0 if x[MU] == 1.0 else math.exp(-END)) / x[FILTER]
    work.rise[0, n - 1], work.rise[1, n - 1] = size * math.cos(angle), size * math.sin(angle)
    work.rise_order[0] = x[MU]


@compiled
def _fill_with_orders(x, lead, table, work):
    """`fill_controller` of (2a)."""
    fill_order(x[ALPHA], table, work)
    fill_rise(x, table, work)
    last = 0.0 if lead > 0.0 else -_PI
    if x[1] != 0.0:
        last -= 0.5 * _PI * x[ALPHA]
    elif x[0] == 0.0:
        last += 0.5 * _PI * x[MU]
    n = len(table.v)
    for j in range(n):
        real = x[0] + x[1] * work.power[0, j] + x[2] * work.rise[0, j]
        imag = x[1] * work.power[1, j] + x[2] * work.rise[1, j]
        turn = math.atan2(imag, real) - last
        turn -= 2.0 * _PI * np.round(turn / (2.0 * _PI))
        if abs(turn) > _FAR_TURN and 1 < j < n - 1:
            turn = turn_between(x, table.v[j - 1], table.v[j])
        last += turn
        work.controller[0, j] = 0.5 * math.log(max(real * real + imag * imag, _TINY))
        work.controller[1, j], work.controller[2, j], work.controller[3, j] = real, imag, last


@compiled
def turn_between(x, low, high):
    """The change of arg C between two v, followed in steps: next to a zero of C it turns fast."""
    real, imag = controller_at(x, low)
    total, last, step = 0.0, math.atan2(imag, real), 0.5 * (high - low)
    while low < high:
        step = min(step, high - low)
        real, imag = controller_at(x, low + step)
        turn = math.atan2(imag, real) - last
        turn -= 2.0 * _PI * np.round(turn / (2.0 * _PI))
        if abs(turn) > 0.5 * _FAR_TURN and step > _LEAST_STEP:
            step *= 0.5
            continue
        total, last, low = total + turn, last + turn, low + step
        step *= 2.0
        if high - low < _LEAST_STEP:
            break
    return total
