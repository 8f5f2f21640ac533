"""One sample of `WIDTH` pairs of plants of two modes with dead times, from arrival to arrival:  rows -> rows.

The segments are those of `mode_plants.Segments`, of each plant its own.  Their rows follow the other coefficients of
the plants: of each segment, for mode 1 and then mode 2, transition, weight, and whether it begins with an arrival.
"""

from __future__ import annotations

from typing import Any

from numba import njit

from fopi_tune.simulation.sampled.controller_stages import flushed
from fopi_tune.simulation.sampled.layout import (
    ARRIVED_MODE,
    CONTROL,
    LOAD,
    MODE,
    PREVIOUS_INPUT,
    SENT,
    WIDTH,
)
from fopi_tune.simulation.sampled.plant_stages import selected, standing, stands_still
from fopi_tune.simulation.sampled.vectors import absolute, broadcast, load, store, where

_inlined: Any = njit(forceinline=True, error_model="numpy")


@_inlined
def advance_segments(s, c, other, history, modes, block, k, applied, signal, ages, settings, offsets):
    """The control is sent, and the states advance to the next sample.

    Returns the largest dy/dt just after an arrival.
    """
    now = k % settings.ring * WIDTH
    store(history, now, applied)
    store(modes, now, load(s, MODE))
    n, found = settings.order, broadcast(0.0)
    rates, size = 2 * (n * n + n), n * n + n + 1
    for segment in range(settings.segments):
        _arrive(s, history, modes, block, k, signal, ages, segment, settings)
        first, drive = load(s, ARRIVED_MODE) < broadcast(0.5), load(s, CONTROL) + load(s, LOAD)
        gain = selected(s, settings, offsets, rates + n, first) * drive
        rate, begun = gain, load(s, offsets.x)
        for i in range(n):
            rate = rate + selected(s, settings, offsets, rates + i, first) * load(s, offsets.x + i * WIDTH)
        if settings.stands:
            rate = where(stands_still(c, other, begun, gain, first), broadcast(0.0), rate)
        row = offsets.plant + 2 * (rates + n + 1) * WIDTH + 2 * segment * size * WIDTH
        later = row + size * WIDTH
        flag = where(first, load(s, row + (n * n + n) * WIDTH), load(s, later + (n * n + n) * WIDTH))
        found = where((flag > broadcast(0.5)) & (absolute(rate) > absolute(found)), rate, found)
        for i in range(n):
            place = (n * n + i) * WIDTH
            x = where(first, load(s, row + place), load(s, later + place)) * drive
            for j in range(n):
                place = (i * n + j) * WIDTH
                x = x + where(first, load(s, row + place), load(s, later + place)) * load(s, offsets.x + j * WIDTH)
            store(s, offsets.following + i * WIDTH, x)
        for i in range(n):
            store(s, offsets.x + i * WIDTH, load(s, offsets.following + i * WIDTH))
        if settings.stands:
            store(s, offsets.x, standing(c, other, begun, load(s, offsets.x), gain, first))
    for i in range(n):
        store(s, offsets.x + i * WIDTH, flushed(load(s, offsets.x + i * WIDTH)))
    store(s, PREVIOUS_INPUT, load(s, CONTROL) + load(s, LOAD))
    return found


@_inlined
def _arrive(s, history, modes, block, k, signal, ages, segment, settings):
    """Control, with its mode, and load from the segment's beginning on."""
    row, now = 4 * segment * settings.width + block * WIDTH, k % settings.ring
    for lane in range(WIDTH):
        for mode in range(2):
            age = ages[row + mode * settings.width + lane]
            sent = k - age
            place = now - age
            place = (place if place >= 0 else place + settings.ring) * WIDTH + lane
            if sent >= 0 and sent > s[SENT + lane] and modes[place] == mode:
                s[CONTROL + lane], s[ARRIVED_MODE + lane], s[SENT + lane] = history[place], mode, sent
        if settings.loaded:
            sent = k - ages[row + (2 + int(s[ARRIVED_MODE + lane])) * settings.width + lane]
            s[LOAD + lane] = signal[sent] if sent >= 0 else 0.0
