"""The scan over rays:  the best gain of every ray of a grid over (shape, direction), and a compass search (compiled).

A ray's direction is given by tau in [-1, 1]: with an integral of the order alpha the scaled gains have the ratio
ki'/kp' = e^t with

    t = reach(alpha) tau/sqrt(1 - tau^2),    reach = base + alpha span ,    |t| <= alpha most ,

so that tau = -1 is ki = 0, tau = 1 is ki alone, and the frequency where both terms are equal, t/alpha, runs over the
plants' corners and stays on the grid.  Shapes are those of `structures.py`: orders, or shares of a derivative.
Equalities of the nominal plant: the first fixes kappa on each ray, the second the direction for each shape, and what is
left of a third is the cost.
"""

from __future__ import annotations

import math

import numpy as np

from fopi_tune.design.global_search.compiled import IAE, KI, NOTHING, compiled, entry
from fopi_tune.design.global_search.controllers import fill_order
from fopi_tune.design.global_search.intervals import allowed_on_ray
from fopi_tune.design.global_search.rays import fill_ray, find_passages
from fopi_tune.design.global_search.structures import box_with_orders, kappa_range, ray_of, tau_of, with_orders
from fopi_tune.design.global_search.values import cost, equality_gains, slack

_LEAST_KAPPA, _LARGEST_KAPPA = -25.0, 30.0
#: neper; the part of a long interval that is looked at, from its upper end
_LONGEST = 10.0
_SAMPLES = 6
#: kappa of one ray that meet an equality
_MOST_GAINS = 6
_GOLDEN = 0.381966
#: cost of a neper or radian by which a third equality is missed
_MISSED = 1e3


@compiled
def best_in_interval(code, low, high, deep, third, c, s, table, rows, box, work):
    """(cost, kappa) of the best of an allowed interval: by its ends, or by samples and `deep` golden sections."""
    if low == high or (code == KI and s != 0.0):
        kappa = high if s > 0.0 or low == high else low
        return cost(code, kappa, third, c, s, table, rows, box, work), kappa
    low = max(low, high - _LONGEST)
    count = 2 if code == IAE else _SAMPLES
    best, at = NOTHING, low
    for r in range(count):
        kappa = low + (high - low) * r / (count - 1)
        value = cost(code, kappa, third, c, s, table, rows, box, work)
        if value < best:
            best, at = value, kappa
    if code == IAE or deep == 0:
        return best, at
    step = (high - low) / (count - 1)
    a, b = max(low, at - step), min(high, at + step)
    x, y = a + _GOLDEN * (b - a), b - _GOLDEN * (b - a)
    at_x = cost(code, x, third, c, s, table, rows, box, work)
    at_y = cost(code, y, third, c, s, table, rows, box, work)
    for section in range(deep):
        if min(at_x, at_y) < best:
            best, at = (at_x, x) if at_x < at_y else (at_y, y)
        if section == deep - 1:
            break
        if at_x < at_y:
            b, y, at_y = y, x, at_x
            x = a + _GOLDEN * (b - a)
            at_x = cost(code, x, third, c, s, table, rows, box, work)
        else:
            a, x, at_x = x, y, at_y
            y = b - _GOLDEN * (b - a)
            at_y = cost(code, y, third, c, s, table, rows, box, work)
    return best, at


@entry
def best_on_ray(code, third, c, s, equal, pick, deep, table, rows, box, work):
    """(cost, kappa, what the second equality misses) of a ray; the cost is NOTHING where nothing is allowed.

    Args:
        code: of the objective.
        third, c, s: the ray.
        equal: indices of equalities of the nominal plant.
        pick: which of the kappa that meet the first equality; -1 takes the best.
        deep: golden sections in an interval.
        table, rows, box, work: as in `allowed_intervals`.
    """
    low, high = kappa_range(third, c, s, _LEAST_KAPPA, _LARGEST_KAPPA, box, table.sampling)
    if high < low - 1e-9:
        return NOTHING, 0.0, 0.0
    fill_ray(third, c, s, table, work)
    find_passages(third, c, s, table, work)
    best, at, missed = NOTHING, 0.0, 0.0
    if len(equal) == 0:
        for r in range(allowed_on_ray(low, high, table, rows, work)):
            value, kappa = best_in_interval(
                code, work.found[r, 0], work.found[r, 1], deep, third, c, s, table, rows, box, work
            )
            if value < best:
                best, at = value, kappa
        return best, at, missed
    gains = np.empty(_MOST_GAINS)
    count = equality_gains(equal[0], table, rows, work, gains)
    for r in range(count):
        kappa = gains[r]
        if (pick >= 0 and r != pick) or kappa < low - 1e-6 or kappa > high + 1e-6:
            continue
        off = slack(equal[1], kappa, 0, table, rows, work) if len(equal) > 1 else 0.0
        if allowed_on_ray(kappa, kappa, table, rows, work) == 0:
            if pick >= 0:
                missed = off
            continue
        value = cost(code, kappa, third, c, s, table, rows, box, work)
        for t in range(2, len(equal)):
            value += _MISSED * abs(slack(equal[t], kappa, 0, table, rows, work))
        if value < best:
            best, at, missed = value, kappa, off
    return best, at, missed


@entry
def missed_on_ray(pick, third, c, s, equal, table, rows, work):
    """(what the second equality misses at the kappa of the first, whether there is one, how many kappa there are)."""
    fill_ray(third, c, s, table, work)
    find_passages(third, c, s, table, work)
    gains = np.empty(_MOST_GAINS)
    count = equality_gains(equal[0], table, rows, work, gains)
    if count <= pick:
        return 0.0, False, count
    value = slack(equal[1], gains[pick], 0, table, rows, work)
    return value, abs(value) < 3.0, count


@compiled
def best_at_margin(code, alpha, signs, equal, most, span, table, rows, box, work):
    """(cost, kappa, tau) of gains with which the nominal plant has its crossover and there its phase margin.

    L(j omega_c) = -e^{+-j phi} gives C(j omega_c), which is linear in the gains: the second equality at the crossover
    of the first one, without a search.
    """
    best, at, where = NOTHING, 0.0, 0.0
    j, phi = rows.first[equal[0]], rows.limit[equal[1]]
    if abs(table.log_omega[j] - rows.limit[equal[0]]) > 1e-9:
        return best, at, where
    fill_order(alpha, table, work)
    real, imag = table.real[0, j], table.imag[0, j]
    size = real * real + imag * imag
    for side in (-1.0, 1.0):
        a, b = -math.cos(phi), -side * math.sin(phi)
        a, b = (a * real + b * imag) / size, (b * real - a * imag) / size
        integral = b / work.power[1, j]
        proportional = a - integral * work.power[0, j]
        kp, ki = signs[0] * proportional, signs[1] * integral
        if kp < 0.0 or ki < 0.0 or kp + ki == 0.0:
            continue
        tau, reached = tau_of(alpha, ki / kp if kp > 0.0 else np.inf, most, span)
        if not reached:
            continue
        third, c, s = ray_of(alpha, tau, signs, most, span, box, table.sampling)
        value, kappa, _ = best_on_ray(code, third, c, s, equal, 0, 0, table, rows, box, work)
        if value < best:
            best, at, where = value, kappa, tau
    return best, at, where


@entry
def best_at_margins(code, alphas, signs, equal, most, span, table, rows, box, work):
    """`best_at_margin` of each alpha, shape (n, 3): to hand over tables takes longer than one of them."""
    found = np.empty((len(alphas), 3))
    for k in range(len(alphas)):
        found[k, 0], found[k, 1], found[k, 2] = best_at_margin(
            code, alphas[k], signs, equal, most, span, table, rows, box, work
        )
    return found


@entry
def best_of_shape(code, shape, signs, taus, equal, most, span, table, rows, box, work, nominal, nominal_work):
    """(cost, kappa, tau) of the best ray of a shape on which two equalities hold; `nominal` has one plant."""
    best, at, where = NOTHING, 0.0, 0.0
    for pick in range(_MOST_GAINS):
        last, known, kappas = 0.0, False, 0
        for j in range(len(taus)):
            third, c, s = ray_of(shape, taus[j], signs, most, span, box, table.sampling)
            off, there, count = missed_on_ray(pick, third, c, s, equal, nominal, rows, nominal_work)
            kappas = max(kappas, count)
            if there and known and (off > 0.0) != (last > 0.0) and abs(off - last) < 2.0:
                a, b, at_a = taus[j - 1], taus[j], last
                for _ in range(40):
                    middle = 0.5 * (a + b)
                    third, c, s = ray_of(shape, middle, signs, most, span, box, table.sampling)
                    value, _, _ = missed_on_ray(pick, third, c, s, equal, nominal, rows, nominal_work)
                    if (value > 0.0) == (at_a > 0.0):
                        a = middle
                    else:
                        b = middle
                third, c, s = ray_of(shape, a, signs, most, span, box, table.sampling)
                value, kappa, _ = best_on_ray(code, third, c, s, equal, pick, 0, table, rows, box, work)
                if value < best:
                    best, at, where = value, kappa, a
            last, known = off, there
        if kappas <= pick + 1:
            # no ray has another kappa
            break
    return best, at, where


@entry
def scan_rays(code, shapes, taus, quadrants, equal, most, span, table, rows, box, work):
    """Costs and kappas, of shape (quadrants, shapes, taus), NOTHING where a ray has nothing that meets everything."""
    size = (len(quadrants), len(shapes), len(taus))
    costs, kappas = np.full(size, NOTHING), np.zeros(size)
    for z in range(size[0]):
        for i in range(size[1]):
            for j in range(size[2]):
                third, c, s = ray_of(shapes[i], taus[j], quadrants[z], most, span, box, table.sampling)
                costs[z, i, j], kappas[z, i, j], _ = best_on_ray(
                    code, third, c, s, equal, -1, 0, table, rows, box, work
                )
    return costs, kappas


@entry
def compass(code, start, steps, fixed, signs, equal, most, span, least, rounds, table, rows, box, work):
    """Compass search on (shape, tau) from a ray: (shape, tau, cost, kappa).

    Args:
        start: shape, tau and the cost there.
        steps: the first steps in shape and tau.
        fixed: whether tau stays.
        signs: of the gains.
        least: steps smaller than this end the search.
        rounds: at most so many.
        code, equal, most, span, table, rows, box, work: as in `best_on_ray` and `ray_of`.
    """
    shape, tau, best, kappa = start[0], start[1], start[2], 0.0
    da, dt, pa, pt = steps[0], steps[1], 0.0, 0.0
    ways = np.array(
        ((1.0, 0.0), (-1.0, 0.0), (0.0, 1.0), (0.0, -1.0), (1.0, 1.0), (-1.0, -1.0), (1.0, -1.0), (-1.0, 1.0))
    )
    for _ in range(rounds):
        moved = False
        for d in range(-1, 8):
            if d < 0:
                if pa == 0.0 and pt == 0.0:
                    continue
                x, y = shape + 2.0 * pa, tau + 2.0 * pt
            else:
                x, y = shape + da * ways[d, 0], tau + dt * ways[d, 1]
            x = min(max(x, box.shape_low), box.shape_high)
            y = tau if fixed else min(max(y, -1.0), 1.0)
            if x == shape and y == tau:
                continue
            third, c, s = ray_of(x, y, signs, most, span, box, table.sampling)
            value, at, _ = best_on_ray(code, third, c, s, equal, -1, 8, table, rows, box, work)
            if value < best:
                pa, pt = (2.0 * pa, 2.0 * pt) if d < 0 else (x - shape, y - tau)
                best, shape, tau, kappa, moved = value, x, y, at, True
                break
        if not moved:
            pa = pt = 0.0
            da, dt = 0.5 * da, 0.5 * dt
            if max(da, dt) < least:
                break
    return shape, tau, best, kappa


@entry
def best_with_orders(code, y, deep, signs, equal, most, span, table, rows, box, work):
    """(cost, kappa) of the ray with y = (tau, shape, alpha, mu)."""
    at, inside = with_orders(y[2], y[3], table), box_with_orders(y[3], box)
    third, c, s = ray_of(y[1], y[0], signs, most, span, inside, at.sampling)
    value, kappa, _ = best_on_ray(code, third, c, s, equal, -1, deep, at, rows, inside, work)
    return value, kappa


@entry
def scan_orders(code, grids, sizes, quadrants, equal, most, span, table, rows, box, work):
    """Costs and kappas, of shape (quadrants, alphas, mus, shapes, taus), as of `scan_rays`.

    Args:
        grids: shape (4, n), taus, shapes, alphas and mus, of which the first `sizes` count.
        code, quadrants, equal, most, span, table, rows, box, work: as of `scan_rays`.
    """
    size = (len(quadrants), sizes[2], sizes[3], sizes[1], sizes[0])
    costs, kappas, y = np.full(size, NOTHING), np.zeros(size), np.empty(4)
    for z in range(size[0]):
        for a in range(size[1]):
            for m in range(size[2]):
                for i in range(size[3]):
                    for j in range(size[4]):
                        y[0], y[1], y[2], y[3] = grids[0, j], grids[1, i], grids[2, a], grids[3, m]
                        costs[z, a, m, i, j], kappas[z, a, m, i, j] = best_with_orders(
                            code, y, 0, quadrants[z], equal, most, span, table, rows, box, work
                        )
    return costs, kappas


@entry
def pattern_search(code, start, steps, low, high, signs, equal, most, span, least, evaluations, table, rows, box, work):
    """Search on y = (tau, shape, alpha, mu) from a ray: (tau, shape, alpha, mu, cost, kappa), shape (6,).

    Every step along an axis or two is tried, and after one that leads down twice as much again, along curved valleys.

    Args:
        start: y and the cost there, shape (5,).
        steps: the first steps, 0 of what stays; shape (4,).
        low, high: of y.
        signs: of the gains.
        least: steps smaller than this part of the first ones end the search.
        evaluations: at most so many.
        code, equal, most, span, table, rows, box, work: as in `best_on_ray` and `ray_of`.
    """
    found = np.zeros(6)
    for k in range(5):
        found[k] = start[k]
    y, step, moved_by, size, count = np.empty(4), np.zeros(4), np.zeros(4), 1.0, 0
    while size > least and count < evaluations:
        moved = False
        # a way is no step yet, one axis, or two of them, with signs
        for way in range(-1, 32):
            for k in range(4):
                step[k] = 0.0
            if way < 0:
                for k in range(4):
                    step[k] = 2.0 * moved_by[k]
            elif way < 8:
                step[way // 2] = size * steps[way // 2] * (1.0 - 2.0 * (way % 2))
            else:
                pair, first = (way - 8) // 4, 0
                while pair >= 3 - first:
                    pair -= 3 - first
                    first += 1
                second = first + 1 + pair
                step[first] = size * steps[first] * (1.0 - 2.0 * (way % 2))
                step[second] = size * steps[second] * (1.0 - 2.0 * (way // 2 % 2))
                if step[first] == 0.0 or step[second] == 0.0:
                    continue
            change = 0.0
            for k in range(4):
                y[k] = min(max(found[k] + step[k], low[k]), high[k])
                change = max(change, abs(y[k] - found[k]))
            if change == 0.0:
                continue
            value, kappa = best_with_orders(code, y, 8, signs, equal, most, span, table, rows, box, work)
            count += 1
            if value < found[4]:
                for k in range(4):
                    moved_by[k] = y[k] - found[k]
                    found[k] = y[k]
                found[4], found[5], moved = value, kappa, True
                break
        if not moved:
            size *= 0.5
            for k in range(4):
                moved_by[k] = 0.0
    return found
