"""The compiled simulation:  blocks of `WIDTH` plants side by side through all samples.

A switch exchanges the states of the two controllers in a lane; the lane selects their coefficients by its mode.  Lanes
are independent: blocks can be computed in any order, by any number of threads.

This module imports Numba: import it where it is needed.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numba import njit

from fopi_tune.core.compiled.kept import kept, sources
from fopi_tune.simulation.sampled import (
    controller_stages,
    noise_vectors,
    plant_stages,
    segment_stages,
    switching_stages,
)
from fopi_tune.simulation.sampled.layout import (
    APPLIED,
    ARRIVED_MODE,
    BEGUN,
    COASTING,
    CONTROL,
    EXCESS,
    FINITE,
    GAIN,
    HIGH,
    IDLE_IS_NEW,
    INTEGRATES,
    IS_NEW,
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
    SENT,
    START,
    TRACES,
    TRACK,
    WIDTH,
)
from fopi_tune.simulation.sampled.vectors import absolute, bits, broadcast, load, pointer, rounded, store, where

_RESULTS, _TRACES = len(RESULTS), len(TRACES)
_inlined: Any = njit(forceinline=True, error_model="numpy")
_compiled: Any = njit(error_model="numpy")


@_compiled
def _initialise(s, block, table, controllers, settings, offsets):
    """The scratch array of a block before its first sample."""
    for place in range(offsets.size):
        s[place] = 0.0
    rows, column = pointer(table), block * WIDTH
    past, mode = load(rows, column), broadcast(float(settings.first_mode))
    for row in range(1, table.shape[0]):
        store(s, offsets.x + (row - 1) * WIDTH, load(rows, row * settings.width + column))
    store(s, OVERSHOOT, broadcast(-np.inf))
    store(s, OUTSIDE, broadcast(settings.judged - 1.0))
    store(s, FINITE, broadcast(1.0))
    store(s, BEGUN, broadcast(float(settings.judged)))
    store(s, APPLIED, past)
    store(s, PREVIOUS_INPUT, past)
    store(s, CONTROL, past)
    store(s, MODE, mode)
    store(s, ARRIVED_MODE, mode)
    store(s, LAST_SWITCH, broadcast(-np.inf))
    store(s, SENT, broadcast(-1.0))
    for row in (IS_NEW, IDLE_IS_NEW):
        store(s, row, broadcast(float(settings.starts_at_first_sample)))
    for which in range(1 + settings.hybrid):
        own = controllers[(settings.first_mode + which) % 2]
        begin = broadcast(own[START])
        if which == 0 and settings.bumpless:
            low, high = broadcast(own[LOW]), broadcast(own[HIGH])
            begin = where(past < low, low, past)
            begin = where(begin > high, high, begin)
        store(s, LAST_OUTPUT if which == 0 else OTHER_LAST_OUTPUT, begin)
        if settings.sections > 0:
            store(s, offsets.active if which == 0 else offsets.inactive_0, begin * broadcast(own[INTEGRATES]))


@_inlined
def _output(s, c, other, jumps, k, settings, offsets, other_old, setpoint, rate, measured, check_finite):
    """Error and output of the active controller, and whether the block must check numbers for overflow from here on.

    The error is that behind a measurement filter.
    """
    r, change = setpoint
    second, e = load(s, MODE) > broadcast(0.5), broadcast(r) - measured
    own, select = controller_stages.resolve_mode(c, other, second)
    # with checks the states were updated at the end of the last sample
    update_due = k > 0 and not check_finite
    switching_stages.expire_switches(s, jumps, k, settings.window)
    # a loop alone crosses no line
    up, down, crossing = second, second, False
    if settings.hybrid:
        up, down = switching_stages.line_crossings(s, k, measured, r, e, settings)
        crossing = bits(up | down) != 0
    if settings.coasts:
        switching_stages.coast_or_enter(s, jumps, k, c, other, measured, r, e, other_old, offsets, settings)
        second = load(s, MODE) > broadcast(0.5)
        own, select = controller_stages.resolve_mode(c, other, second)
    if settings.coasts == 0 and crossing:
        v = switching_stages.switch_and_demand(
            s, jumps, k, c, other, up, down, other_old, offsets, settings, update_due, measured, e, setpoint
        )  # fmt: skip
        second = load(s, MODE) > broadcast(0.5)
        own, select = controller_stages.resolve_mode(c, other, second)
    else:
        if settings.starts_at_first_sample:
            controller_stages.start_at_rest(s, own, select, second, offsets, settings, measured)
        if settings.filter_order > 0:
            measured = controller_stages.filtered(s, own, select, second, offsets, settings, measured)
            e = broadcast(r) - measured
        first = controller_stages.without_memory(s, own, select, second, offsets, settings, r, change, measured, e)
        if update_due:
            v = controller_stages.update_and_demand(s, own, select, second, offsets.active, settings.sections, first)
        else:
            v = controller_stages.demand(s, offsets.active, settings.sections, first)
    u = controller_stages.saturate(own, select, second, v)
    if settings.limits_rate:
        u = controller_stages.followed(own, select, second, u, load(s, LAST_OUTPUT))
    d = controller_stages.coefficient(own, GAIN, select, second) * (u - v)
    store(s, LAST_ERROR, e)
    store(s, EXCESS, d)
    check_finite = check_finite or not controller_stages.all_small(e, d, u, rate)
    if check_finite:
        u = controller_stages.update_checked(s, own, select, second, offsets, settings, measured, v, u)
    else:
        controller_stages.update_measured(s, own, select, second, offsets, settings, measured)
    store(s, LAST_OUTPUT, u)
    if settings.coasts:
        u = where(load(s, COASTING) > broadcast(0.5), broadcast(0.0), u)
    return e, u, check_finite


@_inlined
def _sample(
    s,
    history,
    modes,
    c,
    other,
    block,
    k,
    settings,
    offsets,
    jumps,
    delay,
    reference,
    signal,
    steps,
    traces,
    check_finite,
):
    """Sample k and the plant's step to the next one."""
    r, track = reference[k], settings.hybrid and settings.inactive == TRACK
    # only a tracking controller alternates between two buffers of states
    other_old = offsets.inactive_1 if track and k % 2 == 1 else offsets.inactive_0
    other_new = offsets.inactive_1 if k % 2 == 0 else offsets.inactive_0
    y, rate = plant_stages.output(s, c, other, settings, offsets)
    measured = y
    if settings.noise_std != 0.0:
        if k % 4 == 0:
            noise_vectors.make_noise(s, settings.seed, settings.first_index + block * WIDTH, k)
        measured = measured + broadcast(settings.noise_std) * load(s, NOISE + (k % 4) * WIDTH)
    if settings.quantum != 0.0:
        measured = broadcast(settings.quantum) * rounded(measured / broadcast(settings.quantum))
    # without a sample before there is no change
    setpoint = r, r - reference[max(k - 1, 0)]
    e, u, check_finite = _output(
        s, c, other, jumps, k, settings, offsets, other_old, setpoint, rate, measured, check_finite
    )
    if check_finite:
        store(
            s,
            FINITE,
            where(controller_stages.is_finite(y) & controller_stages.is_finite(rate), load(s, FINITE), broadcast(0.0)),
        )
    applied = plant_stages.rate_limited(s, u, settings.most_change)
    if track:
        switching_stages.track_while_idle(
            s, c, other, other_old, other_new, offsets, settings, measured, e, setpoint, applied
        )
    elif settings.hybrid and settings.derivatives > 0:
        switching_stages.observe_while_idle(s, c, other, offsets, settings, measured, e)
    if k >= settings.horizon:
        plant_stages.accumulate_measures(s, k, y, rate, r, u, applied, settings, c, other, steps)
    if settings.keep:
        state = where(load(s, COASTING) > broadcast(0.5), broadcast(-1.0), load(s, MODE))
        for row, value in enumerate((y, rate, measured, broadcast(r) - measured, u, applied, state)):
            store(traces, (row * settings.steps + k) * settings.width + block * WIDTH, value)
    if settings.segments:
        after = segment_stages.advance_segments(
            s, c, other, history, modes, block, k, applied, signal, delay, settings, offsets
        )  # fmt: skip
    else:
        plant_stages.update_inputs(s, history, modes, block, k, applied, signal, delay, settings)
        if settings.hybrid:
            after = plant_stages.advance_hybrid_states(s, c, other, settings, offsets)
        else:
            after = plant_stages.rate_after(s, settings, offsets, rate)
            if settings.acts_at_samples == 0:
                after = plant_stages.rate_on_arrival(s, settings, offsets, after)
            plant_stages.advance_states(s, settings, offsets)
    if k >= settings.horizon and k < settings.steps - 1:
        controller_stages.store_maximum(s, PEAK_RATE, absolute(after))
    if settings.keep:
        store(traces, (7 * settings.steps + k) * settings.width + block * WIDTH, after)
    return check_finite


def _run_blocks(
    begin, stop, settings, offsets, table, delay, controllers, reference, signal, steps, results, traces, scratch,
    jumps,
):  # fmt: skip
    s, rings = pointer(scratch), max(settings.ring, 1) * WIDTH
    history, modes = pointer(scratch[offsets.size :]), pointer(scratch[offsets.size + rings :])
    c, other = pointer(controllers), controllers.shape[1] if settings.hybrid else 0
    inputs = pointer(jumps), pointer(delay), pointer(reference), pointer(signal)
    inputs = *inputs, pointer(steps), pointer(traces)
    found, large = pointer(results), controller_stages.any_large_coefficient(controllers, settings.sections)
    for block in range(begin, stop):
        _initialise(s, block, table, controllers, settings, offsets)
        for place in range(rings):
            history[place] = s[APPLIED + place % WIDTH]
            modes[place] = settings.first_mode
        # where the modes coast, states are updated at the end of each sample
        check_finite = large or settings.coasts != 0 or controller_stages.any_large_input(s)
        for k in range(settings.steps):
            check_finite = _sample(
                s, history, modes, c, other, block, k, settings, offsets, *inputs, check_finite
            )  # fmt: skip
        for row in range(_RESULTS):
            store(found, row * settings.width + block * WIDTH, load(s, row * WIDTH))


#: simulates the blocks begin to stop - 1 and fills their columns of `results` and, unless it is empty, of `traces`
run_blocks = kept(_run_blocks, sources(Path(__file__).parent.glob("*.py")), nogil=True, error_model="numpy")
