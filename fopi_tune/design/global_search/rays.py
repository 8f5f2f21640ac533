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

from fopi_tune.design.global_search.compiled import CLOSEST, END, compiled, entry
from fopi_tune.design.global_search.controllers import fill_controller, first_term, rise_at_zero

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


@entry
def fill_ray(third, c, s, table, work):
    """Write L0 = C0 P of all plants and columns into the scratch.

    Args:
        third, c, s: the numbers x of `structures.py`; c and s are kp' and ki', the third alpha or kd'.
        table: the plants.
        work: scratch arrays.
    """
    m, n = table.gain.shape
    fill_controller(third, c, s, table, work)
    for j in range(n):
        log_c, real, imag, angle = (
            work.controller[0, j], work.controller[1, j], work.controller[2, j], work.controller[3, j]
        )  # fmt: skip
        square = real * real + imag * imag
        for i in range(m):
            work.gain[i, j] = log_c + table.gain[i, j]
            work.phase[i, j] = angle + table.phase[i, j]
            work.real[i, j] = real * table.real[i, j] - imag * table.imag[i, j]
            size = table.real[i, j] * table.real[i, j] + table.imag[i, j] * table.imag[i, j]
            work.square[i, j] = square * size
            if j >= table.alias[i]:
                # the dead time turns L many times between columns: the worst phase is among them
                work.real[i, j] = -math.sqrt(work.square[i, j])
    if s == 0.0 and c == 0.0:
        for i in range(m):
            # a derivative alone cancels one pole of the plant at s = 0, or makes up for a part of it
            slope = table.low_slope[i] + rise_at_zero(table.sampling)
            work.gain[i, 0] = work.gain[i, 1] if abs(slope) < 1e-9 else -END * np.sign(slope)


@compiled
def find_passages(third, c, s, table, work):
    """List every plant's passages of the negative real axis: ln|L0| and the signed turns."""
    m, n = table.gain.shape
    lead = first_term(third, c, s, table.sampling)
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
