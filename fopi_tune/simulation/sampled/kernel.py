"""The simulation compiled:  blocks of `WIDTH` plants side by side through all samples.

A jump exchanges a lane's states of the two controllers, whose numbers a lane selects by its mode.  No lane knows of
another one: blocks can be computed in any order, by any number of threads.

Importing this takes Numba with it: import it where it is needed.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from typing import Any

import numpy as np
from numba import njit

from fopi_tune.simulation.sampled import controller_stages as controlled
from fopi_tune.simulation.sampled import layout, noise
from fopi_tune.simulation.sampled import noise_vectors as noise_packs
from fopi_tune.simulation.sampled import plant_stages as stages
from fopi_tune.simulation.sampled import vectors as packs
from fopi_tune.simulation.sampled.layout import (
    APPLIED,
    ARRIVED_MODE,
    CONTROL,
    EXCESS,
    FINITE,
    GAIN,
    HIGH,
    INTEGRATES,
    LAST_ERROR,
    LAST_OUTPUT,
    LAST_SWITCH,
    LOW,
    MODE,
    NOISE,
    OTHER_LAST_OUTPUT,
    OUTSIDE,
    OVERSHOOT,
    PEAK_RATE,
    PREVIOUS_INPUT,
    RESULTS,
    START,
    TRACES,
    TRACK,
    WIDTH,
)
from fopi_tune.simulation.sampled.vectors import absolute, bits, broadcast, load, pointer, rounded, store, where

_RESULTS, _TRACES = len(RESULTS), len(TRACES)
_inlined: Any = njit(forceinline=True, error_model="numpy")
_apart: Any = njit(error_model="numpy")


@_apart
def _begin(s, block, table, controllers, settings, places):
    """The scratch of a block before its first sample."""
    for place in range(places.size):
        s[place] = 0.0
    for lane in range(WIDTH):
        plant = block * WIDTH + lane
        past = table[0, plant]
        for row in range(1, table.shape[0]):
            s[places.x + (row - 1) * WIDTH + lane] = table[row, plant]
        s[OVERSHOOT + lane], s[OUTSIDE + lane], s[FINITE + lane] = -np.inf, settings.horizon - 1.0, 1.0
        s[APPLIED + lane] = s[PREVIOUS_INPUT + lane] = s[CONTROL + lane] = past
        s[MODE + lane] = s[ARRIVED_MODE + lane] = settings.first_mode
        s[LAST_SWITCH + lane] = -np.inf
        for which in range(1 + settings.hybrid):
            mode = (settings.first_mode + which) % 2
            begin = controllers[mode, START]
            if which == 0 and settings.bumpless:
                begin = min(max(past, controllers[mode, LOW]), controllers[mode, HIGH])
            s[(LAST_OUTPUT if which == 0 else OTHER_LAST_OUTPUT) + lane] = begin
            states = places.active if which == 0 else places.inactive_0
            if settings.sections > 0:
                s[states + lane] = begin * controllers[mode, INTEGRATES]


@_inlined
def _output(s, c, other, jumps, k, settings, places, other_old, r, rate, measured, careful):
    """The active controller's output, and whether the block has to look at every number from here on."""
    second, e = load(s, MODE) > broadcast(0.5), broadcast(r) - measured
    own, select = controlled.resolve_mode(c, other, second)
    up, down = controlled.hysteresis_crossings(s, measured, r, settings.half_width)
    # careful ones have followed
    behind = k > 0 and not careful
    controlled.expire_switches(s, jumps, k, settings.window)
    if settings.hybrid and bits(up | down) != 0:
        v = controlled.switch_and_demand(
            s, jumps, k, c, other, up, down, places.active, other_old, settings, behind, e
        )  # fmt: skip
        second = load(s, MODE) > broadcast(0.5)
        own, select = controlled.resolve_mode(c, other, second)
    elif behind:
        v = controlled.update_and_demand(s, own, select, second, places.active, settings.sections, e)
    else:
        v = controlled.demand(s, own, select, second, places.active, settings.sections, e)
    u = controlled.saturate(own, select, second, v)
    d = controlled.coefficient(own, GAIN, select, second) * (u - v)
    store(s, LAST_ERROR, e)
    store(s, EXCESS, d)
    careful = careful or not controlled.all_small(e, d, u, rate)
    if careful:
        u = controlled.update_checked(
            s, own, select, second, places.active, places.spare, settings.sections, v, u
        )  # fmt: skip
    store(s, LAST_OUTPUT, u)
    return e, u, careful


@_inlined
def _sample(s, history, modes, c, other, block, k, settings, places, jumps, late, reference, signal, traces, careful):
    """Sample k and the way to the next one."""
    r, track = reference[k], settings.hybrid and settings.inactive == TRACK
    # only a controller that tracks moves from one buffer of states to the other
    other_old = places.inactive_1 if track and k % 2 == 1 else places.inactive_0
    other_new = places.inactive_1 if k % 2 == 0 else places.inactive_0
    y, rate = stages.output(s, settings, places)
    measured = y
    if settings.noise_std != 0.0:
        if k % 4 == 0:
            noise_packs.make_noise(s, settings.seed, settings.first_index + block * WIDTH, k)
        measured = measured + broadcast(settings.noise_std) * load(s, NOISE + (k % 4) * WIDTH)
    if settings.quantum != 0.0:
        measured = broadcast(settings.quantum) * rounded(measured / broadcast(settings.quantum))
    e, u, careful = _output(s, c, other, jumps, k, settings, places, other_old, r, rate, measured, careful)
    if careful:
        store(s, FINITE, where(controlled.is_finite(y) & controlled.is_finite(rate), load(s, FINITE), broadcast(0.0)))
    applied = stages.rate_limited(s, u, settings.most_change)
    if track:
        first = load(s, MODE) < broadcast(0.5)
        idle, either = controlled.resolve_mode(c, other, first)
        controlled.track_applied(s, idle, either, first, other_old, other_new, settings.sections, e, applied)
    if k >= settings.horizon:
        stages.accumulate_measures(s, k, y, rate, r, u, applied, settings, c, other)
    if settings.keep:
        for row, value in enumerate((y, rate, measured, e, u, applied, load(s, MODE))):
            store(traces, (row * settings.steps + k) * settings.width + block * WIDTH, value)
    stages.update_inputs(s, history, modes, block, k, applied, signal, late, settings)
    if settings.hybrid:
        after = stages.advance_hybrid_states(s, settings, places)
    else:
        after = stages.rate_after(s, settings, places, rate)
        stages.advance_states(s, settings, places)
        if settings.order == 1 and settings.prompt == 0:
            after = stages.rate_on_arrival(s, places, after)
    if k >= settings.horizon and k < settings.steps - 1:
        controlled.store_maximum(s, PEAK_RATE, absolute(after))
    if settings.keep:
        store(traces, (7 * settings.steps + k) * settings.width + block * WIDTH, after)
    return careful


def _stamp() -> tuple[int, ...]:
    """Changes when the code below this file does: part of the compiled function, and so of its key on disk."""
    found = (os.stat(str(module.__file__)) for module in (controlled, layout, noise, noise_packs, packs, stages))
    return tuple(number for status in found for number in (status.st_mtime_ns, status.st_size))


def _made(stamp: tuple[int, ...]) -> Callable[..., int]:
    def run_blocks(
        begin, stop, settings, places, table, late, controllers, reference, signal, results, traces, scratch, jumps
    ):  # fmt: skip
        s, rings = pointer(scratch), max(settings.ring, 1) * WIDTH
        history, modes = pointer(scratch[places.size :]), pointer(scratch[places.size + rings :])
        c, other = pointer(controllers), controllers.shape[1] if settings.hybrid else 0
        inputs = pointer(jumps), pointer(late), pointer(reference), pointer(signal), pointer(traces)
        for block in range(begin, stop):
            _begin(s, block, table, controllers, settings, places)
            for place in range(rings):
                history[place] = s[APPLIED + place % WIDTH]
                modes[place] = settings.first_mode
            careful = controlled.any_large(table, controllers, block)
            for k in range(settings.steps):
                careful = _sample(
                    s, history, modes, c, other, block, k, settings, places, *inputs, careful
                )  # fmt: skip
            for row in range(_RESULTS):
                for lane in range(WIDTH):
                    results[row, block * WIDTH + lane] = s[row * WIDTH + lane]
        return len(stamp)

    try:
        return njit(nogil=True, error_model="numpy", cache=True)(run_blocks)
    except RuntimeError:
        # nowhere to keep what was compiled
        return njit(nogil=True, error_model="numpy")(run_blocks)


#: simulates the blocks begin to stop - 1 and fills in their columns of `results` and, unless it is empty, `traces`
run_blocks = _made(_stamp())
