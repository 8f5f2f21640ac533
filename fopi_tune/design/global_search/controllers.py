"""Responses of the controllers of `structures.py`, and those of a ray on a table (compiled).

On samples s^-alpha and s^mu/(Tf s + 1) are (2) and (3) of `samples.py`, filters whose numbers `controller_of` makes.
With (2a) C = x0 + x1 s^-alpha + x2 s^mu/(Tf s + 1), or with its filters, the phase is followed from column to column:
next to a zero of C, in steps between them.

Source: derived.
"""

from __future__ import annotations

import math

import numpy as np

from fopi_tune.design.global_search.compiled import END, compiled, entry

_PI = math.pi
#: where a controller's numbers are in what `controller_of` returns: h, Tf omega_s, e^g, the orders of an integral and a
#: derivative beside each other, e^g of the derivative's filter, the place of its first corner and, from the last on,
#: corners
HALF, FILTER, GAIN, ALPHA, MU, RISE_GAIN, FIRST_RISE, CORNERS = range(3, 11)
#: |C|^2 that stands for 0
_TINY = 1e-60
#: rad; a turn of C between columns that is followed in steps, and the least step in v
_FAR_TURN, _LEAST_STEP = 1.2, 1e-7


@entry
def controller_of(x, sampling):
    """The gains x and, unless C is kp' + ki' s^-alpha, h, Tf omega_s, e^g, orders, and corners z_1, p_1, ... at alpha.

    The third of x is alpha, or kd' where there is a derivative; the orders are then those of `sampling`.
    """
    if sampling.half == 0.0 and sampling.derivative == 0.0:
        return x
    alpha, corners = (x[2] if sampling.derivative == 0.0 else sampling.order), sampling.corners
    rise = CORNERS + len(corners)
    found = np.empty(rise + len(sampling.rise_corners))
    found[0], found[1], found[2], found[HALF], found[FILTER] = x[0], x[1], x[2], sampling.half, sampling.derivative
    found[ALPHA], found[MU], found[FIRST_RISE] = sampling.order, sampling.rise, rise
    middle, last, here, there = sampling.gain[0], sampling.gain[1], sampling.gain[2], sampling.gain[3]
    at = (middle, last, here, there)
    found[GAIN] = fill_corners(corners, alpha, at, sampling.matched, sampling.half, found, CORNERS)
    at = (middle, middle, middle, middle)
    found[RISE_GAIN] = fill_corners(sampling.rise_corners, 2.0 - sampling.rise, at, 0, sampling.half, found, rise)
    return found


@compiled
def fill_corners(corners, alpha, at, matched, h, found, first):
    """Write the corners of a filter at an order into `found` from a place on, and give e^g.

    Args:
        corners, at, matched: of `Sampling`; `at` is its `gain`.
        alpha: the order.
        h: omega_s Ts/2.
        found, first: where the corners are written.
    """
    middle, last, here, there = at
    g, sign = last - here + there - alpha * middle, 1.0
    for k in range(len(corners)):
        corner = math.exp(corners[k, 0] + corners[k, 1] * alpha + corners[k, 2] * math.log(alpha))
        if matched:
            square = corner * corner
            g += 0.5 * sign * (math.log(math.exp(2.0 * here) + square) - math.log(math.exp(2.0 * last) + square))
            corner = math.tanh(h * corner) / h
        g -= 0.5 * sign * math.log(math.exp(2.0 * there) + corner * corner)
        found[first + k] = corner
        sign = -sign
    return math.exp(g)


@compiled
def _times_corners(real, imag, controller, first, end, omega):
    """A complex number times the zeros and poles from a place to another, at s = j omega."""
    square = omega * omega
    for k in range(first, end, 2):
        zero, pole = controller[k], controller[k + 1]
        size = pole * pole + square
        a, b = (zero * pole + square) / size, omega * (pole - zero) / size
        real, imag = real * a - imag * b, real * b + imag * a
    return real, imag


@compiled
def filter_at(controller, omega):
    """The filter of s^-alpha at s = j omega: real and imaginary part."""
    return _times_corners(0.0, -controller[GAIN] / omega, controller, CORNERS, int(controller[FIRST_RISE]), omega)


@compiled
def rise_at(controller, omega):
    """The filter of s^mu/(Tf s + 1) at s = j omega: real and imaginary part."""
    #  j omega/(1 + j omega Tf), times s F_(2 - mu)
    part = controller[RISE_GAIN] * omega / (1.0 + (omega * controller[FILTER]) ** 2)
    real, imag = part * omega * controller[FILTER], part
    return _times_corners(real, imag, controller, int(controller[FIRST_RISE]), len(controller), omega)


@compiled
def integral_at_real(controller, log_s):
    """s^-alpha, or its filter, at a real s."""
    if len(controller) == 3:
        return math.exp(-controller[2] * log_s)
    s = math.exp(log_s)
    value = controller[GAIN] / s
    for k in range(CORNERS, int(controller[FIRST_RISE]), 2):
        value *= (s + controller[k]) / (s + controller[k + 1])
    return value


@compiled
def rise_at_real(controller, log_s):
    """The filter of s^mu/(Tf s + 1) at a real s."""
    s = math.exp(log_s)
    value = controller[RISE_GAIN] * s / (controller[FILTER] * s + 1.0)
    for k in range(int(controller[FIRST_RISE]), len(controller), 2):
        value *= (s + controller[k]) / (s + controller[k + 1])
    return value


@compiled
def half_of(controller):
    """h; 0 for the continuous loop."""
    return controller[HALF] if len(controller) > 3 else 0.0


@compiled
def order_of(third, sampling):
    """The order of the integral, which turns scaled ki into the user's."""
    return third if sampling.derivative == 0.0 else sampling.order


@compiled
def rise_at_zero(sampling):
    """The order of the derivative as omega -> 0; on samples it is a difference there."""
    return 1.0 if sampling.half > 0.0 else sampling.rise


@compiled
def has_powers(x):
    """Whether what `controller_of` makes of the numbers has powers of s of other orders than 1, in continuous time."""
    return len(x) > 3 and x[HALF] == 0.0 and (x[ALPHA] != 1.0 or x[MU] != 1.0)


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
    if has_powers(x):
        power, angle = x[1] * math.exp(-x[ALPHA] * v), 0.5 * _PI * x[ALPHA]
        real, imag = derivative_at(x[MU], x[FILTER], v)
        return x[0] + power * math.cos(angle) + x[2] * real, -power * math.sin(angle) + x[2] * imag
    omega = math.exp(v)
    real, imag = filter_at(x, omega)
    real, imag = x[0] + x[1] * real, x[1] * imag
    if x[FILTER] > 0.0:
        rise = rise_at(x, omega)
        real, imag = real + x[2] * rise[0], imag + x[2] * rise[1]
    return real, imag


@entry
def controller_at_real(x, log_s):
    """C at a real s; x is what `controller_of` makes of the numbers."""
    if has_powers(x):
        derivative = math.exp(x[MU] * log_s) / (x[FILTER] * math.exp(log_s) + 1.0)
        return x[0] + x[1] * math.exp(-x[ALPHA] * log_s) + x[2] * derivative
    value = x[0] + x[1] * integral_at_real(x, log_s)
    if len(x) > 3 and x[FILTER] > 0.0:
        value += x[2] * rise_at_real(x, log_s)
    return value


@entry
def controller_at_infinity(x):
    """C as s tends to infinity; x is what `controller_of` makes of the numbers."""
    if len(x) == 3 or x[FILTER] == 0.0 or (x[HALF] == 0.0 and x[MU] != 1.0):
        return x[0]
    return x[0] + x[2] * x[RISE_GAIN] / x[FILTER]


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
        if has_powers(x) or len(sampling.rise_corners) > 0:
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
    """Write s^mu/(Tf s + 1), or its filter, of all columns into the scratch, unless it is there."""
    if work.rise_order[0] == x[MU]:
        return
    n, sampled = len(table.v), x[HALF] > 0.0
    for j in range(n):
        if sampled:
            work.rise[0, j], work.rise[1, j] = rise_at(x, math.exp(table.v[j]))
        else:
            work.rise[0, j], work.rise[1, j] = derivative_at(x[MU], x[FILTER], table.v[j])
    # as omega -> 0 it tends to 0, as omega -> inf to a number or to 0, each on its ray
    order = 1.0 if sampled else x[MU]
    angle, size = 0.5 * _PI * order, math.exp(-END)
    work.rise[0, 0], work.rise[1, 0] = size * math.cos(angle), size * math.sin(angle)
    angle -= 0.5 * _PI
    size = (x[RISE_GAIN] if order == 1.0 else math.exp(-END)) / x[FILTER]
    work.rise[0, n - 1], work.rise[1, n - 1] = size * math.cos(angle), size * math.sin(angle)
    work.rise_order[0] = x[MU]


@compiled
def _fill_with_orders(x, lead, table, work):
    """`fill_controller` of (2a)."""
    fill_order(x[ALPHA], table, work)
    fill_rise(x, table, work)
    last, sampled = (0.0 if lead > 0.0 else -_PI), x[HALF] > 0.0
    if x[1] != 0.0:
        last -= 0.5 * _PI * (1.0 if sampled else x[ALPHA])
    elif x[0] == 0.0:
        last += 0.5 * _PI * (1.0 if sampled else x[MU])
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
