"""The compiled simulation with derivatives:  one plant after the other, four numbers at a time.

The four numbers of a signal are its value and its derivatives by kp, ki and alpha.  The values are computed by the
operations of `sampled.reference`, in their order.  A coefficient c of the controller is stored as c and the four
numbers c' = (0, dc/dkp, dc/dki, dc/dalpha), so that the product with a signal x is c x_j + c'_j x_0 for j = 0 to 3:
adding 0 leaves the value as it is.

This module imports Numba: import it where it is needed.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numba import njit

from fopi_tune.core.compiled.kept import kept, sources

_BIG = float(np.finfo(np.float64).max)
#: of the controller's rows: direct, gain of the anti-windup, then pole, weight and residue of every section
_DIRECT, _GAIN, _SECTIONS = range(3)
#: of the five signals
_OUTPUT, _RATE, _RATE_AFTER, _DEMANDED, _APPLIED = range(5)

_inlined: Any = njit(forceinline=True, error_model="numpy")


@_inlined
def _control_at(found, i, place, past, into):
    """The applied control of a sample; before the first one, the plant's input until then."""
    if place >= 0:
        for j in range(4):
            into[j] = found[_APPLIED, i, place, j]
    else:
        into[0] = past
        into[1] = into[2] = into[3] = 0.0


@_inlined
def _load_at(signal, place):
    return signal[place] if place >= 0 and signal.shape[0] > 0 else 0.0


@_inlined
def _flushed(value, flush):
    """0 in place of what would end as a subnormal number, which some processors are slow with."""
    return 0.0 if abs(value) < flush else value


@_inlined
def _control_sample(c, low, high, most, flush, z, new, e, v, u, d):
    """One sample of the controller, `digital.runtime`, (1) and (4): z to the next states, u to the output.

    An output that is moving on its way, by `most` a sample, has the derivatives of the last one; else it has a `share`
    of those of v, 0 at a limit.

    Where a number is not finite, states and output are held.
    """
    sections = z.shape[0]
    for j in range(4):
        v[j] = c[_DIRECT, 0] * e[j] + c[_DIRECT, 1 + j] * e[0]
    for i in range(sections):
        for j in range(4):
            v[j] += z[i, j]
    good = abs(e[0]) <= _BIG and abs(v[0]) <= _BIG
    limited = v[0] < low or v[0] > high
    at = v[0]
    if limited:
        at = low if v[0] < low else high
    share, change = 0.0 if limited else 1.0, at - u[0]
    moving = change > most or change < -most
    if moving:
        at = u[0] + most if change > most else u[0] - most
    excess = at - v[0]
    for j in range(4):
        own = u[j] if moving else share * v[j]
        d[j] = c[_GAIN, 0] * (own - v[j]) + c[_GAIN, 1 + j] * excess
    d[0] = c[_GAIN, 0] * excess
    for i in range(sections):
        row = _SECTIONS + 3 * i
        pole, weight, residue = c[row, 0], c[row + 1, 0], c[row + 2, 0]
        shifted = z[i, 0] + weight * d[0]
        for j in range(4):
            moved = z[i, j] + (weight * d[j] + c[row + 1, 1 + j] * d[0])
            new[i, j] = (pole * moved + c[row, 1 + j] * shifted) + (residue * e[j] + c[row + 2, 1 + j] * e[0])
        good = good and abs(new[i, 0]) <= _BIG
    if not good:
        return
    resting = abs(e[0]) < flush
    for i in range(sections):
        z[i, 0] = 0.0 if resting and abs(new[i, 0]) < flush else new[i, 0]
        for j in range(1, 4):
            z[i, j] = _flushed(new[i, j], flush)
    if not moving:
        for j in range(4):
            u[j] = share * v[j]
    u[0] = at


@_inlined
def _actuate(most, u, last):
    """`simulation.scenario`, (4)."""
    change = u[0] - last[0]
    if abs(change) <= most:
        for j in range(4):
            last[j] = u[j]
    else:
        last[0] += most if change > 0.0 else -most


@_inlined
def _on_arrival(row, n, x, now, old, load, old_load, into):
    """dy/dt just after an input arrives between samples, by a row of `DiscretePlants.arrivals`."""
    for j in range(4):
        value = 0.0
        for i in range(n):
            value += row[i] * x[i, j]
        into[j] = value + row[n] * now[j] + row[n + 1] * old[j]
    into[0] = into[0] + row[n + 2] * load + row[n + 3] * old_load


def _run_plants(
    c, limits, flush, start, integrates, states, past, control, load, output, acts_at_samples, arrivals, reference,
    signal, found,
):  # fmt: skip
    m, steps, n, sections = found.shape[1], found.shape[2], states.shape[1], (c.shape[0] - _SECTIONS) // 3
    low, high, own_most, most = limits
    delay, transition, new_weight, old_weight = control
    load_delay, new_load_weight, old_load_weight = load
    c_output, direct, rate_state, rate_input = output
    z, z_new, x, x_new = np.empty((sections, 4)), np.empty((sections, 4)), np.empty((n, 4)), np.empty((n, 4))
    e, v, u, d, last, before = (
        np.empty(4), np.empty(4), np.empty(4), np.empty(4), np.empty(4), np.empty(4),
    )  # fmt: skip
    now, old, after, other = np.empty(4), np.empty(4), np.empty(4), np.empty(4)
    for i in range(m):
        z[:], x[:], u[:], last[:] = 0.0, 0.0, 0.0, 0.0
        for a in range(n):
            x[a, 0] = states[i, a]
        if sections > 0:
            z[0, 0] = start[i] * integrates
        u[0], last[0] = start[i], past[i]
        before[:] = last
        for k in range(steps):
            for j in range(4):
                y, rate = 0.0, 0.0
                for a in range(n):
                    y += c_output[i, a] * x[a, j]
                    rate += rate_state[i, a] * x[a, j]
                y, rate = y + direct[i] * before[j], rate + rate_input[i] * before[j]
                found[_OUTPUT, i, k, j], found[_RATE, i, k, j] = y, rate
                e[j] = -y
            e[0] += reference[k]
            _control_sample(c, low, high, own_most, flush, z, z_new, e, v, u, d)
            _actuate(most, u, last)
            for j in range(4):
                found[_DEMANDED, i, k, j], found[_APPLIED, i, k, j] = u[j], last[j]
            _control_at(found, i, k - delay[i], past[i], now)
            _control_at(found, i, k - delay[i] - 1, past[i], old)
            w, w_old = _load_at(signal, k - load_delay[i]), _load_at(signal, k - load_delay[i] - 1)
            if acts_at_samples[i]:
                for j in range(4):
                    jump = now[j] + (w if j == 0 else 0.0) - before[j]
                    after[j] = found[_RATE, i, k, j] + rate_input[i] * jump
            else:
                _on_arrival(arrivals[i, 0], n, x, now, old, w, w_old, after)
                if signal.shape[0] > 0:
                    _on_arrival(arrivals[i, 1], n, x, now, old, w, w_old, other)
                    if abs(other[0]) > abs(after[0]):
                        after[:] = other
            for j in range(4):
                found[_RATE_AFTER, i, k, j] = after[j]
            for a in range(n):
                for j in range(4):
                    value = 0.0
                    for b in range(n):
                        value += transition[i, a, b] * x[b, j]
                    x_new[a, j] = value + new_weight[i, a] * now[j] + old_weight[i, a] * old[j]
                x_new[a, 0] = x_new[a, 0] + new_load_weight[i, a] * w + old_load_weight[i, a] * w_old
            for a in range(n):
                for j in range(4):
                    x[a, j] = _flushed(x_new[a, j], flush)
            for j in range(4):
                before[j] = now[j]
            before[0] = now[0] + w
    return m


#: simulates every plant and fills `found`, shape (5, m, steps, 4), with its signals
run_plants = kept(_run_plants, sources([Path(__file__)]), nogil=True, error_model="numpy")
