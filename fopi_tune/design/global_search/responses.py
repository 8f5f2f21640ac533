"""The loop of one plant at any frequency, and its peaks and crossings by Newton's method (compiled).

A plant is its 21 scaled coefficients, a measurement filter among them, and its orders where it is fractional; gains are
x, the numbers of `structures.py`, as `controller_of` completes them.
Derivatives in v are central differences: of a peak only the place suffers, whose error enters its value squared.
"""

from __future__ import annotations

import math

import numpy as np

from fopi_tune.design.global_search.compiled import (
    COEFFICIENTS,
    CROSSOVER,
    CS,
    DELAY,
    DELAY_MARGIN,
    DISCOUNTED_ERROR,
    GAIN_AT_REFERENCE,
    GAIN_MARGIN,
    LAG,
    LAG_SQUARE,
    LOOP_GAIN,
    PHASE_MARGIN,
    PS,
    WIDTH,
    S,
    T,
    compiled,
    entry,
)
from fopi_tune.design.global_search.controllers import (
    controller_at,
    controller_at_infinity,
    controller_at_real,
    half_of,
)
from fopi_tune.design.global_search.samples import delayed_at_real, log_omega_of, stretch_of, turn_of, turn_rate

_PI = math.pi
_STEP = 1e-4
#: how a frequency is determined, as in the program's slots
AT_PEAK, AT_FIXED, AT_GAIN, AT_PHASE, AT_REFERENCE, AT_HORIZON, AT_INFINITY = range(7)


@compiled
def power_sum_at(plant, first, v):
    """Real and imaginary part of a fractional plant's side at j e^v; `first` is where its coefficients begin."""
    a = b = 0.0
    for k in range(first, first + WIDTH):
        if plant[k] != 0.0:
            order = plant[COEFFICIENTS + k]
            size, angle = plant[k] * math.exp(order * v), 0.5 * _PI * order
            a, b = a + size * math.cos(angle), b + size * math.sin(angle)
    return a, b


@entry
def loop_at(x, plant, v, near):
    """ln|L|, arg L on the branch closest to `near` (delay-free) and ln|C/F| at omega_s e^v."""
    omega = math.exp(v)
    real, imag = controller_at(x, v)
    a = b = c = d = 0.0
    if len(plant) > COEFFICIENTS:
        a, b = power_sum_at(plant, 0, v)
        c, d = power_sum_at(plant, WIDTH, v)
    else:
        for k in range(WIDTH):
            a, b = plant[k] - b * omega, a * omega
            c, d = plant[WIDTH + k] - d * omega, c * omega
    log_c = 0.5 * math.log(real * real + imag * imag)
    gain = log_c + 0.5 * math.log((a * a + b * b) / (c * c + d * d))
    phase = math.atan2(imag, real) + math.atan2(b * c - a * d, a * c + b * d)
    phase += 2.0 * _PI * round((near - phase) / (2.0 * _PI))
    return gain, phase - turn_of(v, plant[DELAY], half_of(x)), log_c


@compiled
def undelayed_phase(i, j, table, work):
    """arg L at a column without the dead time or the whole samples of delay."""
    turned = turn_of(table.v[j], table.late[i], table.sampling.half)
    return work.phase[i, j] + math.exp(table.v[j]) * table.delay[i] + turned


@compiled
def log_filter_at(plant, v):
    """ln|F| at omega_s e^v."""
    lag = plant[LAG]
    if lag == 0.0:
        return 0.0
    omega = math.exp(v)
    real, imag = 1.0 - plant[LAG_SQUARE] * omega * omega, lag * omega
    return -0.5 * math.log(real * real + imag * imag)


@compiled
def copy_into(source, target):
    """Copy an array into one of the same size; a loop, since array expressions take long to compile."""
    for k in range(len(source)):
        target[k] = source[k]


@compiled
def value_at(kind, x, plant, v, near):
    """A quantity's natural value at a frequency; margins are angles and lags to -1."""
    gain, phase, log_c = loop_at(x, plant, v, near)
    if kind in (LOOP_GAIN, GAIN_AT_REFERENCE):
        return gain
    if kind == GAIN_MARGIN:
        return -gain
    if kind == CROSSOVER:
        return log_omega_of(v, half_of(x))
    if kind in (PHASE_MARGIN, DELAY_MARGIN):
        lag = (phase + _PI) % (2.0 * _PI)
        return min(lag, 2.0 * _PI - lag) if kind == PHASE_MARGIN else lag * math.exp(-log_omega_of(v, half_of(x)))
    if kind in (S, T, CS, PS):
        linear = math.exp(gain)
        log_s = -0.5 * math.log(max(1.0 + linear * (linear + 2.0 * math.cos(phase)), 1e-300))
        if kind in (S, T):
            return log_s + (gain if kind == T else 0.0)
        log_c += log_filter_at(plant, v)
        return log_s + (log_c if kind == CS else gain - log_c)
    above, below = loop_at(x, plant, v + _STEP, near)[1], loop_at(x, plant, v - _STEP, near)[1]
    return (above - below) / (2.0 * _STEP) * math.log(10.0) / stretch_of(v, half_of(x))


@compiled
def tilted_at(kind, x, plant, v, near, tilt):
    """A quantity's value less tilt ln(omega/omega_s)."""
    value = value_at(kind, x, plant, v, near)
    return value - tilt * log_omega_of(v, half_of(x)) if tilt != 0.0 else value


@compiled
def peak_near(kind, side, x, plant, v, near, low, high, tilt):
    """The frequency of the largest (side 1) or smallest (-1) value near v, inside [low, high]; less its tilt."""
    longest = 0.15
    turn = turn_rate(v, plant[DELAY], half_of(x))
    if turn > 3.0:
        longest = 0.5 / turn
    h = min(_STEP, 0.02 * longest)
    best, base, step = -np.inf, v, 0.0
    for _ in range(16):
        at = tilted_at(kind, x, plant, v, near, tilt)
        if side * at < best:
            # beyond a peak that is narrower than the step
            step *= 0.25
        else:
            best, base = side * at, v
            above, below = tilted_at(kind, x, plant, v + h, near, tilt), tilted_at(kind, x, plant, v - h, near, tilt)
            slope, bend = (above - below) / (2.0 * h), (above - 2.0 * at + below) / (h * h)
            step = -slope / bend if side * bend < -1e-6 else 0.1 * side * (1.0 if slope > 0.0 else -1.0)
            step = min(max(step, -longest), longest)
        v = min(max(base + step, low), high)
        if abs(v - base) < 1e-9:
            break
    return base


@compiled
def crossing_near(which, target, x, plant, v, near):
    """The frequency near v with ln|L| = target (which 0) or arg L = target (which 1)."""
    for _ in range(20):
        here, there = loop_at(x, plant, v, near), loop_at(x, plant, v + 1e-6, near)
        slope = (there[which] - here[which]) * 1e6
        if slope == 0.0:
            return v
        longest = 0.3
        if which == 1 and plant[DELAY] > 0.0:
            longest = min(0.3, 1.0 / (turn_rate(v, plant[DELAY], half_of(x)) + 1.0))
        step = min(max((target - here[which]) / slope, -longest), longest)
        v += step
        if abs(step) < 1e-13:
            return v
    return v


@compiled
def ripple_near(kind, side, x, plant, v, near, target, tilt):
    """The frequency of the largest ripple behind a dead time, from the phase crossover at v over its neighbours."""
    v = crossing_near(1, target, x, plant, v, near)
    best = side * tilted_at(kind, x, plant, v, near, tilt)
    for way in (1.0, -1.0):
        for step in range(1, 60):
            there = crossing_near(1, target + way * 2.0 * _PI * step, x, plant, v, near)
            value = side * tilted_at(kind, x, plant, there, near, tilt)
            if value <= best:
                break
            best, v = value, there
    return v


@compiled
def discounted_error(x, plant, log_horizon):
    """ln |F P/(1 + C P)| at the horizon's s = e^-log_horizon, scaled; F is a number there."""
    s, a, b = math.exp(-log_horizon), 0.0, 0.0
    if len(plant) > COEFFICIENTS:
        for k in range(WIDTH):
            a += plant[k] * s ** plant[COEFFICIENTS + k]
            b += plant[WIDTH + k] * s ** plant[COEFFICIENTS + WIDTH + k]
    else:
        for k in range(WIDTH):
            a, b = a * s + plant[k], b * s + plant[WIDTH + k]
    p = a / b * delayed_at_real(plant[DELAY], s, half_of(x))
    return math.log(abs(p / (1.0 + controller_at_real(x, -log_horizon) * p)))


@entry
def settle(kind, side, mode, x, plant, v, near, target, low, high, log_horizon, tilt):
    """(value, v) of a quantity less its tilt at a plant, the frequency following its peak or crossing."""
    if kind == DISCOUNTED_ERROR:
        return discounted_error(x, plant, log_horizon), v
    if mode == AT_INFINITY:
        return math.log(abs(controller_at_infinity(x)) + 1e-300), v
    if mode == AT_PEAK:
        v = peak_near(kind, side, x, plant, v, near, low, high, tilt)
    elif mode == AT_GAIN:
        v = crossing_near(0, 0.0, x, plant, v, near)
    elif mode == AT_PHASE:
        v = crossing_near(1, target, x, plant, v, near)
    return tilted_at(kind, x, plant, v, near, tilt), v
