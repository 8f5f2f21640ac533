"""How two controllers take turns in a sample of `WIDTH` plants, in stages:  rows of the scratch array -> rows.

The lines are those of `core.switching_lines`.  A lane that coasts keeps in MODE the mode that it left last, whose
controller's states stay the active ones.  Arguments that many stages share are those of `controller_stages`; `states`
and `others` are the offsets of the active and of the inactive controller's states, `own` those of the measurements
behind a derivative's lags and of whether the next sample is the first one, of one controller.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit

from fopi_tune.simulation.sampled.controller_stages import (
    coefficient,
    demand,
    derived,
    filter_measurement,
    flushed,
    is_finite,
    next_state,
    on_error,
    resolve_mode,
    saturate,
    settle,
    start_at_rest,
    store_maximum,
    store_where,
    without_memory,
)
from fopi_tune.simulation.sampled.layout import (
    ALL_LANES,
    APPLIED,
    CHATTERING,
    COASTING,
    EXCESS,
    IDLE_IS_NEW,
    INTEGRATES,
    IS_NEW,
    LAST_ERROR,
    LAST_OUTPUT,
    LAST_SWITCH,
    LONGEST_RUN,
    MODE,
    MOST_CHANGE,
    OTHER_LAST_OUTPUT,
    RECENT_SWITCHES,
    RESET,
    RUN,
    SECTIONS,
    START,
    SWITCHES,
    TRACK,
    WIDTH,
)
from fopi_tune.simulation.sampled.vectors import bits, broadcast, load, mask_from_bits, store, where, without

_inlined: Any = njit(forceinline=True, error_model="numpy")


@_inlined
def _first_measured(s, own, settings, y):
    """The measurements behind the lags before the first sample."""
    new = load(s, own[1]) > broadcast(0.5)
    if bits(new) != 0:
        for j in range(settings.derivatives):
            store_where(s, own[0] + j * WIDTH, new, y)


@_inlined
def _keep_measured(s, own, some, offsets, settings):
    """Those after a sample, from the spare rows, in some lanes."""
    for j in range(settings.derivatives):
        store_where(s, own[0] + j * WIDTH, some, load(s, offsets.spare_filtered + j * WIDTH))
    store_where(s, own[1], some, broadcast(0.0))


@_inlined
def _observe(s, c, other, second, own, some, offsets, settings, y, e):
    """`observe` of `digital.inactive` in some lanes."""
    _first_measured(s, own, settings, y)
    filter_measurement(s, c, other, second, own[0], offsets.spare_filtered, settings, y)
    settle(s, offsets.spare_filtered, settings, y)
    good = some & is_finite(e)
    for j in range(settings.derivatives):
        good = good & is_finite(load(s, offsets.spare_filtered + j * WIDTH))
    _keep_measured(s, own, good, offsets, settings)


@_inlined
def observe_while_idle(s, c, other, offsets, settings, y, e):
    """What controllers that do not act remember of the measurement, after a sample of the one that does."""
    first, second = load(s, MODE) < broadcast(0.5), load(s, MODE) > broadcast(0.5)
    idle, select = resolve_mode(c, other, first)
    _observe(s, idle, select, first, (offsets.idle_filtered, IDLE_IS_NEW), first | second, offsets, settings, y, e)
    if settings.coasts:
        left, select = resolve_mode(c, other, second)
        resting = load(s, COASTING) > broadcast(0.5)
        _observe(s, left, select, second, (offsets.filtered, IS_NEW), resting, offsets, settings, y, e)


@_inlined
def _exchange_measured(s, swapping, offsets, settings):
    """Give the controller that begins to act what it remembers of the measurement, in some lanes."""
    if settings.derivatives > 0:
        for j in range(settings.derivatives):
            _exchange(s, offsets.filtered + j * WIDTH, offsets.idle_filtered + j * WIDTH, swapping)
        _exchange(s, IS_NEW, IDLE_IS_NEW, swapping)


@_inlined
def _exchange(s, row, other_row, some):
    """Exchange two rows in some lanes."""
    one, two = load(s, row), load(s, other_row)
    store(s, row, where(some, two, one))
    store(s, other_row, where(some, one, two))


@_inlined
def track_applied(s, c, other, second, old, new, own, some, offsets, settings, y, e, setpoint, applied, held):
    """One sample of a controller that does not act and tracks the applied control; returns its output.

    `setpoint` is r and its change, `held` that output where a number is not finite; the measurements behind its lags
    are kept in some lanes alone.
    """
    sections = settings.sections
    rest = on_error(c, other, second, settings.fed, e, *setpoint)
    if settings.derivatives > 0:
        _first_measured(s, own, settings, y)
    v = demand(s, old, sections, derived(s, c, other, second, own[0], settings, y, rest))
    total = applied + v
    if settings.derivatives > 0:
        filter_measurement(s, c, other, second, own[0], offsets.spare_filtered, settings, y)
        rest = derived(s, c, other, second, offsets.spare_filtered, settings, y, rest)
        settle(s, offsets.spare_filtered, settings, broadcast(0.0))
        for j in range(settings.derivatives):
            total = total + load(s, offsets.spare_filtered + j * WIDTH)
    for i in range(1, sections):
        x = coefficient(c, SECTIONS + 3 * i, other, second) * load(s, old + i * WIDTH)
        store(s, new + i * WIDTH, flushed(x))
        rest, total = rest + x, total + x
    u = saturate(c, other, second, applied)
    if sections > 0:
        x = coefficient(c, SECTIONS, other, second) * load(s, old)
        x = where(coefficient(c, INTEGRATES, other, second) > broadcast(0.5), u - rest, x)
        store(s, new, flushed(x))
        total = total + x
    good = is_finite(total)
    if bits(good) != ALL_LANES:
        good = is_finite(e) & is_finite(v) & is_finite(applied)
        for i in range(sections):
            good = good & is_finite(load(s, new + i * WIDTH))
        for j in range(settings.derivatives):
            good = good & is_finite(load(s, offsets.spare_filtered + j * WIDTH))
        for i in range(sections):
            store(s, new + i * WIDTH, where(good, load(s, new + i * WIDTH), load(s, old + i * WIDTH)))
        u = where(good, u, held)
    if settings.derivatives > 0:
        _keep_measured(s, own, good & some, offsets, settings)
    return u


@_inlined
def track_while_idle(s, c, other, old, new, offsets, settings, y, e, setpoint, applied):
    """`track_applied` of the controllers that do not act."""
    first, second = load(s, MODE) < broadcast(0.5), load(s, MODE) > broadcast(0.5)
    idle, select = resolve_mode(c, other, first)
    own, last = (offsets.idle_filtered, IDLE_IS_NEW), load(s, OTHER_LAST_OUTPUT)
    u = track_applied(
        s, idle, select, first, old, new, own, first | second, offsets, settings, y, e, setpoint, applied, last
    )
    store(s, OTHER_LAST_OUTPUT, u)
    if settings.coasts:
        left, select = resolve_mode(c, other, second)
        resting, last = load(s, COASTING) > broadcast(0.5), load(s, LAST_OUTPUT)
        own, states, spare = (offsets.filtered, IS_NEW), offsets.active, offsets.spare
        u = track_applied(
            s, left, select, second, states, spare, own, resting, offsets, settings, y, e, setpoint, applied, last
        )
        store(s, LAST_OUTPUT, where(resting, u, last))
        for i in range(settings.sections):
            store_where(s, states + i * WIDTH, resting, load(s, spare + i * WIDTH))


@_inlined
def _level(reference, value, is_absolute):
    """The output on a line."""
    return value if is_absolute else reference + value


@_inlined
def _free_lanes(s, k, e, dwell):
    """Where a state may be left: after the minimum dwell, and with a finite error."""
    free = is_finite(e)
    if dwell > 1:
        free = free & (broadcast(float(k)) - load(s, LAST_SWITCH) >= broadcast(float(dwell)))
    return free


@_inlined
def line_crossings(s, k, measured, reference, e, settings):
    """The lanes that cross a line after the minimum dwell: from mode 1 to 2, and from 2 to 1, without coasting."""
    second = load(s, MODE) > broadcast(0.5)
    up = without(measured >= broadcast(_level(reference, settings.up, settings.up_absolute)), second)
    down = second & (measured <= broadcast(_level(reference, settings.down, settings.down_absolute)))
    if bits(up | down) != 0:
        free = _free_lanes(s, k, e, settings.dwell)
        up, down = up & free, down & free
    return up, down


@_inlined
def _coasting_crossings(s, k, measured, reference, e, settings):
    """The lanes that enter mode 2, that enter mode 1, and that leave a mode to coast if they enter none."""
    first, second = load(s, MODE) < broadcast(0.5), load(s, MODE) > broadcast(0.5)
    acting, resting = load(s, COASTING) < broadcast(0.5), load(s, COASTING) > broadcast(0.5)
    above = measured >= broadcast(_level(reference, settings.up, settings.up_absolute))
    below = measured <= broadcast(_level(reference, settings.down, settings.down_absolute))
    leaves_first = measured >= broadcast(_level(reference, settings.coast_above, settings.coast_above_absolute))
    leaves_second = measured <= broadcast(_level(reference, settings.coast_below, settings.coast_below_absolute))
    free = _free_lanes(s, k, e, settings.dwell)
    rest = ((first & leaves_first) | (second & leaves_second)) & acting & free
    return above & (first | resting) & free, below & (second | resting) & free, rest


@_inlined
def coast_or_enter(s, jumps, k, c, other, measured, reference, e, others, offsets, settings):
    """Begin to coast, or enter a mode from there or from the other one, in some lanes; states are those of now."""
    up, down, rest = _coasting_crossings(s, k, measured, reference, e, settings)
    if bits(up | down | rest) != 0:
        entering, before = up | down, load(s, MODE)
        resting = load(s, COASTING) > broadcast(0.5)
        mode = where(up, broadcast(1.0), where(down, broadcast(0.0), before))
        swapping = (mode > before) | (mode < before)
        store(s, MODE, mode)
        store(s, COASTING, where(entering, broadcast(0.0), where(rest, broadcast(1.0), load(s, COASTING))))
        own, last = load(s, LAST_OUTPUT), where(resting, broadcast(0.0), load(s, LAST_OUTPUT))
        store(s, LAST_OUTPUT, where(swapping, load(s, OTHER_LAST_OUTPUT), own))
        store_where(s, OTHER_LAST_OUTPUT, swapping, own)
        for i in range(settings.sections):
            _exchange(s, offsets.active + i * WIDTH, others + i * WIDTH, swapping)
        _exchange_measured(s, swapping, offsets, settings)
        _begin_mode(s, c, other, entering, last, offsets.active, settings)
        jumps[k] = bits(entering | rest)
        _count_switches(s, k, entering | rest, settings.most_switches)


@_inlined
def _begin_mode(s, c, other, entering, last, states, settings):
    """Memory and last output of the controllers that begin to act after an applied output `last`."""
    second = load(s, MODE) > broadcast(0.5)
    new, choose = resolve_mode(c, other, second)
    start = coefficient(new, START, choose, second)
    store_where(s, APPLIED, entering, saturate(new, choose, second, load(s, APPLIED)))
    if settings.inactive == RESET:
        store_where(s, LAST_OUTPUT, entering, start)
        for i in range(settings.sections):
            begin = start * coefficient(new, INTEGRATES, choose, second) if i == 0 else broadcast(0.0)
            store_where(s, states + i * WIDTH, entering, begin)
    if settings.limits_rate and settings.inactive != TRACK:
        limited = coefficient(new, MOST_CHANGE, choose, second) < broadcast(np.inf)
        store_where(s, LAST_OUTPUT, entering & limited, saturate(new, choose, second, last))


@_inlined
def expire_switches(s, jumps, k, window):
    """Take the switches that have left the window out of the count."""
    jumps[k] = 0
    if k > window and jumps[k - window - 1] != 0:
        store(
            s,
            RECENT_SWITCHES,
            load(s, RECENT_SWITCHES) - where(mask_from_bits(jumps[k - window - 1]), broadcast(1.0), broadcast(0.0)),
        )


@_inlined
def switch_and_demand(s, jumps, k, c, other, up, down, others, offsets, settings, update_due, y, e, setpoint):
    """`update_states` where it is due, the change of mode of some lanes, and `demand`."""
    before, jumping = load(s, MODE) > broadcast(0.5), up | down
    mode = where(up, broadcast(1.0), where(down, broadcast(0.0), load(s, MODE)))
    second = mode > broadcast(0.5)
    own, select = resolve_mode(c, other, before)
    new, choose = resolve_mode(c, other, second)
    start, last = coefficient(new, START, choose, second), load(s, LAST_OUTPUT)
    entered = start if settings.inactive == RESET else load(s, OTHER_LAST_OUTPUT)
    if settings.limits_rate and settings.inactive != TRACK:
        # of a mode without a limit of the rate the last output matters only where a sample is held
        limited = coefficient(new, MOST_CHANGE, choose, second) < broadcast(np.inf)
        entered = where(limited, saturate(new, choose, second, last), entered)
    store(s, OTHER_LAST_OUTPUT, where(jumping, last, load(s, OTHER_LAST_OUTPUT)))
    store(s, LAST_OUTPUT, where(jumping, entered, last))
    store(s, MODE, mode)
    if settings.most_change < np.inf:
        store_where(s, APPLIED, jumping, saturate(new, choose, second, load(s, APPLIED)))
    seen, d = load(s, LAST_ERROR), load(s, EXCESS)
    _exchange_measured(s, jumping, offsets, settings)
    if settings.starts_at_first_sample:
        start_at_rest(s, new, choose, second, offsets, settings, y)
    v, limited = (
        without_memory(s, new, choose, second, offsets, settings, *setpoint, y, e),
        bits(d != broadcast(0.0)) != 0,
    )
    for i in range(settings.sections):
        one, two = offsets.active + i * WIDTH, others + i * WIDTH
        x, held = load(s, one), load(s, two)
        if update_due:
            x = next_state(s, own, select, before, one, i, seen, d, limited)
        # LLVM may make this a masked store, which is slow to read back; the other row is read soon
        store(s, two, where(jumping, x, held))
        if settings.inactive == RESET:
            held = start * coefficient(new, INTEGRATES, choose, second) if i == 0 else broadcast(0.0)
        x = where(jumping, held, x)
        store(s, one, x)
        v = v + x
    jumps[k] = bits(jumping)
    _count_switches(s, k, jumping, settings.most_switches)
    return v


@_inlined
def _count_switches(s, k, jumping, most):
    """Count switches, runs of switches at consecutive samples, and too many switches within the window."""
    now = broadcast(float(k))
    run = where(load(s, LAST_SWITCH) >= now - broadcast(1.0), load(s, RUN) + broadcast(1.0), broadcast(1.0))
    store_where(s, RUN, jumping, run)
    store_maximum(s, LONGEST_RUN, load(s, RUN))
    store_where(s, LAST_SWITCH, jumping, now)
    one = broadcast(1.0)
    store_where(s, SWITCHES, jumping, load(s, SWITCHES) + one)
    store_where(s, RECENT_SWITCHES, jumping, load(s, RECENT_SWITCHES) + one)
    store(s, CHATTERING, where(load(s, RECENT_SWITCHES) > broadcast(float(most)), one, load(s, CHATTERING)))
