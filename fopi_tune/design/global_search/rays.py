"""One ray C = k C0:  the loop L0 = C0 P on a table, and which k = e^kappa are stable (compiled).

With the signed passages of arg L0 through -180 deg (mod 360), +1 upwards,

    Z(kappa) = P - 2 sum of passages with ln|L0| + kappa > 0                                                        (1)

is the number of right half-plane poles of the closed loop (`core/stability.py`, (1), written for passages instead of
intervals).  So the stable kappa of a ray are a union of intervals whose ends are known.

Source: derived; the argument principle, as in `core/stability.py`.
"""

from __future__ import annotations

import math

import numpy as np

from fopi_tune.design.global_search.compiled import CLOSEST, END, compiled
from fopi_tune.design.global_search.samples import controller_of, filter_at

_PI = math.pi
#: neper; beyond all kappa
BEYOND = 3.0 * END


@compiled
def whole_turns(phase):
    """Whole turns nearest to a phase; half-way on the negative real axis."""
    x = (phase + _PI) / (2.0 * _PI)
    nearest = np.round(x)
    if abs(x - nearest) < 1e-10:
        return nearest - 0.5
    return math.floor(x)


@compiled
def fill_order(alpha, table, work):
    """Write (j omega)^-alpha, on samples the filter F, of all columns into the scratch, unless it is there."""
    if work.order[0] == alpha:
        return
    n = table.gain.shape[1]
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
def fill_ray(alpha, c, s, table, work):
    """Write L0 = (c + s (j omega)^-alpha) P, on samples (c + s F) P, of all plants and columns into the scratch."""
    m, n = table.gain.shape
    fill_order(alpha, table, work)
    sampled = table.sampling.half > 0.0
    negative = s < 0 or (s == 0 and c < 0)
    log_c, real_c, imag_c = work.controller[0], work.controller[1], work.controller[2]
    for j in range(n):
        real, imag = c + s * work.power[0, j], s * work.power[1, j]
        real_c[j], imag_c[j] = real, imag
        square = real * real + imag * imag
        log_c[j] = 0.5 * math.log(square)
        angle = math.atan2(-imag, -real) - _PI if negative else math.atan2(imag, real)
        if sampled and angle > (-0.5 * _PI if negative else 0.5 * _PI):
            # an order close to 2, whose filter turns a little further than -180 deg
            angle -= 2.0 * _PI
        for i in range(m):
            g = log_c[j] + table.gain[i, j]
            work.gain[i, j] = g
            work.phase[i, j] = angle + table.phase[i, j]
            work.real[i, j] = real * table.real[i, j] - imag * table.imag[i, j]
            size = table.real[i, j] * table.real[i, j] + table.imag[i, j] * table.imag[i, j]
            work.square[i, j] = square * size
            if j >= table.alias[i]:
                # the dead time turns L many times between columns: the worst phase is among them
                work.real[i, j] = -math.sqrt(work.square[i, j])


@compiled
def find_passages(alpha, c, s, table, work):
    """List every plant's passages of the negative real axis: ln|L0| and the signed turns."""
    m, n = table.gain.shape
    lead = s if s != 0 else c
    for i in range(m):
        count = 0
        begin = table.start_phase[i] - (_PI if lead < 0 else 0.0)
        before = math.floor((work.phase[i, 1] + _PI) / (2.0 * _PI))
        turn = before - whole_turns(begin)
        if turn != 0:
            work.cross_gain[i, count], work.cross_turn[i, count] = work.gain[i, 0], turn
            count += 1
        stop = min(n - 2, table.alias[i])
        for j in range(1, stop):
            after = math.floor((work.phase[i, j + 1] + _PI) / (2.0 * _PI))
            if after != before:
                step = 1 if after > before else -1
                level = before
                while level != after and count < work.cross_gain.shape[1] - 2:
                    target = 2.0 * _PI * (level + (1 if step > 0 else 0)) - _PI
                    part = (target - work.phase[i, j]) / (work.phase[i, j + 1] - work.phase[i, j])
                    work.cross_gain[i, count] = work.gain[i, j] + part * (work.gain[i, j + 1] - work.gain[i, j])
                    work.cross_turn[i, count] = step
                    count += 1
                    level += step
                before = after
        if table.delay[i] == 0.0:
            turn = whole_turns(work.phase[i, n - 1]) - before
            if turn != 0:
                work.cross_gain[i, count], work.cross_turn[i, count] = work.gain[i, n - 1], turn
                count += 1
        work.cross_count[i] = count


@compiled
def alias_gain(i, table, work):
    """The largest ln|L0| from the column on where the dead time turns too fast for the grid; -inf without."""
    largest = -np.inf
    for j in range(table.alias[i], work.gain.shape[1]):
        largest = max(largest, work.gain[i, j])
    return largest


@compiled
def unstable_poles(i, kappa, table, work):
    """(1) of plant i."""
    count = float(table.unstable[i])
    for r in range(work.cross_count[i]):
        if work.cross_gain[i, r] + kappa > 0:
            count -= 2.0 * work.cross_turn[i, r]
    return count


@compiled
def forbid(work, count, low, high):
    """Append an interval of kappa to the forbidden ones; returns their new number."""
    if high > low and count < len(work.forbidden):
        work.forbidden[count, 0], work.forbidden[count, 1] = low, high
        return count + 1
    return count


@compiled
def forbid_unstable(i, table, work, count):
    """Forbid where (1) is not 0, and a little around every passage."""
    k = work.cross_count[i]
    order = np.argsort(-work.cross_gain[i, :k])
    z, low = float(table.unstable[i]), -BEYOND
    for r in range(k):
        at = -work.cross_gain[i, order[r]]
        if abs(z) > 0.25:
            count = forbid(work, count, low, at)
        z -= 2.0 * work.cross_turn[i, order[r]]
        count = forbid(work, count, at - CLOSEST, at + CLOSEST)
        low = at
    if abs(z) > 0.25:
        count = forbid(work, count, low, BEYOND)
    if table.delay[i] > 0.0:
        count = forbid(work, count, -alias_gain(i, table, work), BEYOND)
    return count
