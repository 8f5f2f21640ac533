"""One sample of `WIDTH` plants, in stages that the compiled simulation puts together:  rows of scratch -> rows.

The formulas are those of `scenario`, `plants`, `noise` and `fopi_tune.digital.runtime`; the order of the operations of
a controller is that of `runtime`, bit for bit.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numba import njit

from fopi_tune.validation import noise
from fopi_tune.validation.layout import (
    APPLIED,
    ARRIVED,
    BEFORE,
    CHATTER,
    CONTROL,
    DIRECT,
    ERROR,
    EXCESS,
    HIGH,
    IAE,
    INTEGRATES,
    ISE,
    JUMPED,
    LAST,
    LOAD,
    LOGARITHMS,
    LONGEST,
    LOW,
    MODE,
    NOISE,
    OLD_ARRIVED,
    OLD_CONTROL,
    OLD_LOAD,
    OTHER_LAST,
    OUTSIDE,
    OVER,
    PEAK_RATE,
    PEAK_U,
    RECENT,
    RESET,
    RUN,
    SATURATED,
    SECTIONS,
    SEEN,
    START,
    SWITCHES,
    TAILS,
    WIDTH,
)
from fopi_tune.validation.packs import (
    behind,
    bits,
    count,
    lanes,
    load,
    products,
    root,
    size,
    spread,
    squeeze,
    store,
    stretch,
    upper_bits,
    where,
    words,
)

_BIG = float(np.finfo(np.float64).max)
_ALL = 2**WIDTH - 1
#: where no signal is beyond the first, no coefficient beyond the second and no pole beyond 1, a sum of as many samples
#: as there can be is finite
_LARGE, _LARGE_COEFFICIENT = 1e150, 1e100
_M0, _M1 = (np.uint64(word) for word in noise.MULTIPLIERS)
_W0, _W1 = (np.uint64(word) for word in noise.WEYL)
_ROUNDS, _CENTRAL, _FAR = noise.ROUNDS, noise.CENTRAL, noise.FAR
_CENTRE_TOP, _CENTRE_BOTTOM = noise.CENTRE
_MIDDLE_TOP, _MIDDLE_BOTTOM = noise.MIDDLE
_OUTER_TOP, _OUTER_BOTTOM = noise.OUTER

_inlined: Any = njit(forceinline=True, error_model="numpy")
_apart: Any = njit(error_model="numpy")


@_inlined
def fine(x):
    """The lanes that are finite."""
    return size(x) <= spread(_BIG)


@_inlined
def _keep_larger(s, row, value):
    before = load(s, row)
    store(s, row, where(value > before, value, before))


@_inlined
def _philox(seed, plant, counter):
    """Philox4x64-10 for the plants plant, plant + 1, ..."""
    a, b = words(counter, np.uint64(0)), words(np.uint64(0), np.uint64(0))
    c, d = b, b
    k0, k1, step = seed, words(plant, np.uint64(1)), words(_W1, np.uint64(0))
    for _ in range(_ROUNDS):
        upper, lower = products(a, _M0)
        other, least = products(c, _M1)
        a, b, c, d = other ^ b ^ words(k0, np.uint64(0)), least, upper ^ d ^ k1, lower
        k0, k1 = k0 + _W0, k1 + step
    return a, b, c, d


@_inlined
def _quotient(top, bottom, x):
    a, b = spread(top[7]), spread(bottom[7])
    for i in range(1, 8):
        a, b = spread(top[7 - i]) + a * x, spread(bottom[7 - i]) + b * x
    return a / b


@_inlined
def _tails(s, found):
    """The deviates of the numbers q in the first places of TAILS."""
    for place in range(found):
        s[LOGARITHMS + place] = math.log(0.5 - abs(s[TAILS + place]))
    for place in range(0, found, WIDTH):
        q, r = load(s, TAILS + place), root(spread(0.0) - load(s, LOGARITHMS + place))
        value = _quotient(_MIDDLE_TOP, _MIDDLE_BOTTOM, r - spread(1.6))
        far = r > spread(_FAR)
        if bits(far) != 0:
            value = where(far, _quotient(_OUTER_TOP, _OUTER_BOTTOM, r - spread(5.0)), value)
        store(s, TAILS + place, where(q < spread(0.0), spread(0.0) - value, value))


@_apart
def make_noise(s, seed, index, k):
    """Deviates of the samples k to k + 3 of plants index, index + 1, ..."""
    four = _philox(seed, np.uint64(index), np.uint64(1 + k // 4))
    for i in range(4):
        store(s, NOISE + WIDTH * i, (upper_bits(four[i]) + spread(0.5)) * spread(2.0**-52) - spread(0.5))
    # the tails of all four samples at once: they are few
    found = 0
    for i in range(4):
        q = load(s, NOISE + WIDTH * i)
        outer = size(q) > spread(_CENTRAL)
        squeeze(s, TAILS + found, q, outer)
        found += count(bits(outer))
    _tails(s, found)
    found = 0
    for i in range(4):
        q = load(s, NOISE + WIDTH * i)
        outer = size(q) > spread(_CENTRAL)
        central = q * _quotient(_CENTRE_TOP, _CENTRE_BOTTOM, spread(_CENTRAL**2) - q * q)
        store(s, NOISE + WIDTH * i, stretch(s, TAILS + found, outer, central))
        found += count(bits(outer))


@_inlined
def output(s, settings, places):
    """y and dy/dt just before the sample."""
    before = load(s, BEFORE)
    if settings.hybrid:
        y, first = load(s, places.x), load(s, ARRIVED) < spread(0.5)
        p = places.plant
        pole = where(first, load(s, p + 4 * WIDTH), load(s, p + 10 * WIDTH))
        gain = where(first, load(s, p + 5 * WIDTH), load(s, p + 11 * WIDTH))
        return y, pole * y + gain * before
    n = settings.order
    c = places.plant + (n * n + 4 * n) * WIDTH
    y, rate = spread(0.0), spread(0.0)
    for i in range(n):
        x = load(s, places.x + i * WIDTH)
        y, rate = y + load(s, c + i * WIDTH) * x, rate + load(s, c + (n + i) * WIDTH) * x
    return y + load(s, c + 2 * n * WIDTH) * before, rate + load(s, c + (2 * n + 1) * WIDTH) * before


@_inlined
def controllers_of(c, other, second):
    """(c, other) of `of_mode`:  where all lanes have the same mode, as most often, nothing is left to select."""
    word = bits(second)
    if word == _ALL:
        return behind(c, other), 0
    return c, other if word != 0 else 0


@_inlined
def of_mode(c, row, other, second):
    """A controller's number in every lane; `other` is where the second mode's begin, 0 where there is one mode."""
    if other == 0:
        return spread(c[row])
    return where(second, spread(c[other + row]), spread(c[row]))


@_inlined
def _change(s, row, some, value):
    store(s, row, where(some, value, load(s, row)))


@_inlined
def edges(s, measured, reference, half_width):
    """The lanes that meet the edge of the hysteresis: from mode 1 to 2, and from 2 to 1."""
    mode = load(s, MODE)
    up = (mode < spread(0.5)) & (measured >= spread(reference + half_width))
    return up, (mode > spread(0.5)) & (measured <= spread(reference - half_width))


@_inlined
def forget(s, jumps, k, window):
    """The jumps that are no longer within the window."""
    jumps[k] = 0
    if k > window and jumps[k - window - 1] != 0:
        store(s, RECENT, load(s, RECENT) - where(lanes(jumps[k - window - 1]), spread(1.0), spread(0.0)))


@_inlined
def _count(s, k, jumping, most):
    """Jumps, runs of them, and too many of them within the window."""
    now = spread(float(k))
    run = where(load(s, JUMPED) >= now - spread(1.0), load(s, RUN) + spread(1.0), spread(1.0))
    _change(s, RUN, jumping, run)
    _keep_larger(s, LONGEST, load(s, RUN))
    _change(s, JUMPED, jumping, now)
    one = spread(1.0)
    _change(s, SWITCHES, jumping, load(s, SWITCHES) + one)
    _change(s, RECENT, jumping, load(s, RECENT) + one)
    store(s, CHATTER, where(load(s, RECENT) > spread(float(most)), one, load(s, CHATTER)))


@_inlined
def limited(c, other, second, value):
    """A value within the limits."""
    low, high = of_mode(c, LOW, other, second), of_mode(c, HIGH, other, second)
    value = where(value < low, low, value)
    return where(value > high, high, value)


@_inlined
def demand(s, c, other, second, states, sections, e):
    """v = direct e + x_0 + x_1 + ..."""
    v = of_mode(c, DIRECT, other, second) * e
    for i in range(sections):
        v = v + load(s, states + i * WIDTH)
    return v


@_inlined
def _followed(s, c, other, second, state, i, e, d):
    """p (x + w d) + r e."""
    row = SECTIONS + 3 * i
    x = of_mode(c, row, other, second) * (load(s, state) + of_mode(c, row + 1, other, second) * d)
    return x + of_mode(c, row + 2, other, second) * e


@_inlined
def follow(s, c, other, second, states, new, sections):
    """The states after the last sample."""
    e, d = load(s, SEEN), load(s, EXCESS)
    for i in range(sections):
        store(s, new + i * WIDTH, _followed(s, c, other, second, states + i * WIDTH, i, e, d))


@_inlined
def follow_and_demand(s, c, other, second, states, sections, e):
    """`follow` and the next sample's `demand` at once: the sum waits, section by section, for nothing else."""
    before, d = load(s, SEEN), load(s, EXCESS)
    v = of_mode(c, DIRECT, other, second) * e
    for i in range(sections):
        x = _followed(s, c, other, second, states + i * WIDTH, i, before, d)
        store(s, states + i * WIDTH, x)
        v = v + x
    return v


@_inlined
def switch_and_demand(s, jumps, k, c, other, up, down, states, others, settings, behind, e):
    """`follow` where it is due, lanes change their mode, and `demand`."""
    before, jumping = load(s, MODE) > spread(0.5), up | down
    mode = where(up, spread(1.0), where(down, spread(0.0), load(s, MODE)))
    second = mode > spread(0.5)
    own, select = controllers_of(c, other, before)
    new, choose = controllers_of(c, other, second)
    start, last = of_mode(new, START, choose, second), load(s, LAST)
    entered = start if settings.inactive == RESET else load(s, OTHER_LAST)
    store(s, OTHER_LAST, where(jumping, last, load(s, OTHER_LAST)))
    store(s, LAST, where(jumping, entered, last))
    store(s, MODE, mode)
    _change(s, APPLIED, jumping, limited(new, choose, second, load(s, APPLIED)))
    seen, d = load(s, SEEN), load(s, EXCESS)
    v = of_mode(new, DIRECT, choose, second) * e
    for i in range(settings.sections):
        one, two = states + i * WIDTH, others + i * WIDTH
        x, held = load(s, one), load(s, two)
        if behind:
            x = _followed(s, own, select, before, one, i, seen, d)
        # LLVM may make this one a store under a mask, which is slow to be read; the other one is read soon
        store(s, two, where(jumping, x, held))
        if settings.inactive == RESET:
            held = start * of_mode(new, INTEGRATES, choose, second) if i == 0 else spread(0.0)
        x = where(jumping, held, x)
        store(s, one, x)
        v = v + x
    jumps[k] = bits(jumping)
    _count(s, k, jumping, settings.most_switches)
    return v


@_inlined
def small(e, d, u, rate):
    """Whether all signals of the sample are far from overflowing (y is in e, and v in d or u)."""
    return bits(size(e) + size(d) + size(u) + size(rate) <= spread(_LARGE)) == _ALL


@_apart
def large(table, controllers, block):
    """Whether a block has to look at every number: its controllers' are large, or its first inputs."""
    found = False
    for mode in range(controllers.shape[0]):
        for row in range(controllers.shape[1]):
            most = 1.0 if row >= SECTIONS and (row - SECTIONS) % 3 == 0 else _LARGE_COEFFICIENT
            found |= row != LOW and row != HIGH and abs(controllers[mode, row]) > most
    for lane in range(WIDTH):
        found |= not abs(table[0, block * WIDTH + lane]) <= _LARGE
    return found


@_inlined
def follow_carefully(s, c, other, second, states, spare, sections, v, u):
    """`follow`, and the output; where a number is not finite the states as they were, and the last output."""
    good = fine(load(s, SEEN)) & fine(v)
    follow(s, c, other, second, states, spare, sections)
    for i in range(sections):
        good = good & fine(load(s, spare + i * WIDTH))
    for i in range(sections):
        store(s, states + i * WIDTH, where(good, load(s, spare + i * WIDTH), load(s, states + i * WIDTH)))
    return where(good, u, load(s, LAST))


@_inlined
def follow_applied(s, c, other, second, old, new, sections, e, applied):
    """One sample of the other controller."""
    v = demand(s, c, other, second, old, sections, e)
    rest, total = of_mode(c, DIRECT, other, second) * e, applied + v
    for i in range(1, sections):
        x = of_mode(c, SECTIONS + 3 * i, other, second) * load(s, old + i * WIDTH)
        store(s, new + i * WIDTH, x)
        rest, total = rest + x, total + x
    u = limited(c, other, second, applied)
    if sections > 0:
        x = of_mode(c, SECTIONS, other, second) * load(s, old)
        x = where(of_mode(c, INTEGRATES, other, second) > spread(0.5), u - rest, x)
        store(s, new, x)
        total = total + x
    if bits(fine(total)) != _ALL:
        good = fine(e) & fine(v) & fine(applied)
        for i in range(sections):
            good = good & fine(load(s, new + i * WIDTH))
        for i in range(sections):
            store(s, new + i * WIDTH, where(good, load(s, new + i * WIDTH), load(s, old + i * WIDTH)))
        u = where(good, u, load(s, OTHER_LAST))
    store(s, OTHER_LAST, u)


@_inlined
def actuated(s, u, most):
    """The control after the rate limit."""
    if most < np.inf:
        last, most = load(s, APPLIED), spread(most)
        change = u - last
        moved = where(change > spread(0.0), last + most, last - most)
        u = where(size(change) <= most, u, moved)
    store(s, APPLIED, u)
    return u


@_inlined
def judge(s, k, y, rate, reference, u, applied, settings, c, other):
    """What one sample adds to the measures."""
    second = load(s, MODE) > spread(0.5)
    own, select = controllers_of(c, other, second)
    _keep_larger(s, PEAK_RATE, size(rate))
    _keep_larger(s, PEAK_U, size(applied))
    beyond = y - spread(settings.final)
    off = size(beyond)
    if settings.direction == 0.0:
        _keep_larger(s, OVER, off)
    else:
        _keep_larger(s, OVER, spread(settings.direction) * beyond)
    store(s, OUTSIDE, where(off <= spread(settings.band), load(s, OUTSIDE), spread(float(k))))
    error = spread(reference) - y
    store(s, ERROR, error)
    store(s, IAE, load(s, IAE) + size(error))
    store(s, ISE, load(s, ISE) + error * error)
    inside = (u > of_mode(own, LOW, select, second)) & (u < of_mode(own, HIGH, select, second))
    store(s, SATURATED, load(s, SATURATED) + where(inside, spread(0.0), spread(1.0)))


@_inlined
def arrive(s, history, modes, block, k, applied, signal, late, settings):
    """What reaches the plants in this sample: the control (and its mode) and the load, and what was there before."""
    if settings.delayed:
        store(s, OLD_CONTROL, load(s, CONTROL))
        store(s, OLD_ARRIVED, load(s, ARRIVED))
    if settings.ring == 0:
        store(s, CONTROL, applied)
        store(s, ARRIVED, load(s, MODE))
    else:
        now = k % settings.ring
        store(history, now * WIDTH, applied)
        store(modes, now * WIDTH, load(s, MODE))
        if settings.same_late:
            place = (k - late[0]) % settings.ring * WIDTH
            store(s, CONTROL, load(history, place))
            store(s, ARRIVED, load(modes, place))
        else:
            for lane in range(WIDTH):
                row = now - late[block * WIDTH + lane]
                place = (row if row >= 0 else row + settings.ring) * WIDTH + lane
                s[CONTROL + lane] = history[place]
                s[ARRIVED + lane] = modes[place]
    if settings.loaded:
        store(s, OLD_LOAD, load(s, LOAD))
        if settings.load_delayed:
            for lane in range(WIDTH):
                place = k - late[settings.width + block * WIDTH + lane]
                s[LOAD + lane] = signal[place] if place >= 0 else 0.0
        else:
            store(s, LOAD, spread(signal[k]))


@_inlined
def flow(s, settings, places):
    """(1) of `plants` to the next sample."""
    n, p = settings.order, places.plant
    control, old, w, old_w = load(s, CONTROL), load(s, OLD_CONTROL), load(s, LOAD), load(s, OLD_LOAD)
    for i in range(n):
        x = load(s, p + i * n * WIDTH) * load(s, places.x)
        for j in range(1, n):
            x = x + load(s, p + (i * n + j) * WIDTH) * load(s, places.x + j * WIDTH)
        row = p + (n * n + i) * WIDTH
        x = x + load(s, row) * control
        if settings.delayed:
            x = x + load(s, row + n * WIDTH) * old
        if settings.loaded:
            x = x + load(s, row + 2 * n * WIDTH) * w + load(s, row + 3 * n * WIDTH) * old_w
        store(s, places.following + i * WIDTH, x)
    for i in range(n):
        store(s, places.x + i * WIDTH, load(s, places.following + i * WIDTH))
    store(s, BEFORE, control + w)


@_inlined
def flow_hybrid(s, settings, places):
    """The same of two modes: the old one until its control is followed by the next, the new one from there."""
    p, x, w = places.plant, load(s, places.x), load(s, LOAD)
    if settings.delayed:
        first = load(s, OLD_ARRIVED) < spread(0.5)
        x = where(first, load(s, p), load(s, p + 6 * WIDTH)) * x
        weight = where(first, load(s, p + WIDTH), load(s, p + 7 * WIDTH))
        x = x + weight * (load(s, OLD_CONTROL) + w)
    first, before = load(s, ARRIVED) < spread(0.5), load(s, CONTROL) + w
    x = where(first, load(s, p + 2 * WIDTH), load(s, p + 8 * WIDTH)) * x
    store(s, places.x, x + where(first, load(s, p + 3 * WIDTH), load(s, p + 9 * WIDTH)) * before)
    store(s, BEFORE, before)
