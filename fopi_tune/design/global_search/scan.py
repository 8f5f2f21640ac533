"""The scan over rays:  the best gain of every ray of a grid over (alpha, direction), and a compass search (compiled).

A ray's direction is given by tau in [-1, 1]: the scaled gains have the ratio ki'/kp' = e^t with

    t = reach(alpha) tau/sqrt(1 - tau^2),    reach = base + alpha span ,    |t| <= alpha most ,

so that tau = -1 is ki = 0, tau = 1 is kp = 0, and the frequency where both terms are equal, t/alpha, runs over the
plants' corners and stays on the grid.  Equalities of the nominal plant: the first fixes kappa on each ray, the second
the direction for each order, and what is left of a third is the cost.
"""

from __future__ import annotations

import math

import numpy as np

from fopi_tune.design.global_search.compiled import IAE, KI, NOTHING, compiled
from fopi_tune.design.global_search.intervals import allowed_on_ray
from fopi_tune.design.global_search.rays import fill_order, fill_ray, find_passages
from fopi_tune.design.global_search.values import cost, equality_gains, slack

_LEAST_KAPPA, _LARGEST_KAPPA = -25.0, 30.0
#: neper; the part of a long interval that is looked at, from its upper end
_LONGEST = 10.0
_SAMPLES = 6
#: kappa of one ray that meet an equality
_MOST_GAINS = 6
_GOLDEN = 0.381966
#: neper: the part of the reach that does not depend on the order
_BASE = 2.5
#: cost of a neper or radian by which a third equality is missed
_MISSED = 1e3


@compiled
def direction(alpha, tau, most, span):
    """(c, s) in the first quadrant."""
    if tau <= -1.0:
        return 1.0, 0.0
    if tau >= 1.0:
        return 0.0, 1.0
    t = (_BASE + alpha * span) * tau / math.sqrt(1.0 - tau * tau)
    ratio = math.exp(min(max(t, -alpha * most), alpha * most))
    size = math.sqrt(1.0 + ratio * ratio)
    return 1.0 / size, ratio / size


@compiled
def kappa_range(alpha, c, s, box):
    """The kappa that the ranges of kp and ki allow: (low, high)."""
    low, high = 0.0, math.exp(_LARGEST_KAPPA)
    factor = s * math.exp(alpha * box.log_omega - box.log_gain)
    for part in range(2):
        x = c if part == 0 else factor
        a, b = (box.kp_low, box.kp_high) if part == 0 else (box.ki_low, box.ki_high)
        if x == 0.0:
            if a > 0.0 or b < 0.0:
                return 1.0, 0.0
        elif x > 0.0:
            low, high = max(low, a / x), min(high, b / x)
        else:
            low, high = max(low, b / x), min(high, a / x)
    lowest = math.log(low) if low > math.exp(_LEAST_KAPPA) else _LEAST_KAPPA
    return lowest, (math.log(high) if high > 1e-300 else 2.0 * _LEAST_KAPPA)


@compiled
def best_in_interval(code, low, high, deep, alpha, c, s, table, rows, box, work):
    """(cost, kappa) of the best of an allowed interval: by its ends, or by samples and `deep` golden sections."""
    if low == high or (code == KI and s != 0.0):
        kappa = high if s > 0.0 or low == high else low
        return cost(code, kappa, alpha, c, s, table, rows, box, work), kappa
    low = max(low, high - _LONGEST)
    count = 2 if code == IAE else _SAMPLES
    best, at = NOTHING, low
    for r in range(count):
        kappa = low + (high - low) * r / (count - 1)
        value = cost(code, kappa, alpha, c, s, table, rows, box, work)
        if value < best:
            best, at = value, kappa
    if code == IAE or deep == 0:
        return best, at
    step = (high - low) / (count - 1)
    a, b = max(low, at - step), min(high, at + step)
    for _ in range(deep):
        x, y = a + _GOLDEN * (b - a), b - _GOLDEN * (b - a)
        at_x = cost(code, x, alpha, c, s, table, rows, box, work)
        at_y = cost(code, y, alpha, c, s, table, rows, box, work)
        if at_x < at_y:
            b = y
        else:
            a = x
        if min(at_x, at_y) < best:
            best, at = (at_x, x) if at_x < at_y else (at_y, y)
    return best, at


@compiled
def best_on_ray(code, alpha, c, s, equal, pick, deep, table, rows, box, work):
    """(cost, kappa, what the second equality misses) of a ray; the cost is NOTHING where nothing is allowed.

    Args:
        code: of the objective.
        alpha, c, s: the ray.
        equal: indices of equalities of the nominal plant.
        pick: which of the kappa that meet the first equality; -1 takes the best.
        deep: golden sections in an interval.
        table, rows, box, work: as in `allowed_intervals`.
    """
    low, high = kappa_range(alpha, c, s, box)
    if high < low - 1e-9:
        return NOTHING, 0.0, 0.0
    fill_ray(alpha, c, s, table, work)
    find_passages(alpha, c, s, table, work)
    best, at, missed = NOTHING, 0.0, 0.0
    if len(equal) == 0:
        for r in range(allowed_on_ray(low, high, table, rows, work)):
            value, kappa = best_in_interval(
                code, work.found[r, 0], work.found[r, 1], deep, alpha, c, s, table, rows, box, work
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
        value = cost(code, kappa, alpha, c, s, table, rows, box, work)
        for t in range(2, len(equal)):
            value += _MISSED * abs(slack(equal[t], kappa, 0, table, rows, work))
        if value < best:
            best, at, missed = value, kappa, off
    return best, at, missed


@compiled
def missed_on_ray(pick, alpha, c, s, equal, table, rows, work):
    """(what the second equality misses at the kappa of the first, whether there is one, how many kappa there are)."""
    fill_ray(alpha, c, s, table, work)
    find_passages(alpha, c, s, table, work)
    gains = np.empty(_MOST_GAINS)
    count = equality_gains(equal[0], table, rows, work, gains)
    if count <= pick:
        return 0.0, False, count
    value = slack(equal[1], gains[pick], 0, table, rows, work)
    return value, abs(value) < 3.0, count


@compiled
def tau_of(ratio, alpha, most, span):
    """The inverse of `direction`: tau of ki'/kp' >= 0, and whether `direction` reaches it."""
    if ratio == 0.0:
        return -1.0, True
    if ratio == np.inf:
        return 1.0, True
    t = math.log(ratio)
    x = t / (_BASE + alpha * span)
    return x / math.sqrt(1.0 + x * x), abs(t) <= alpha * most


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
        tau, reached = tau_of(ki / kp if kp > 0.0 else np.inf, alpha, most, span)
        if not reached:
            continue
        c, s = direction(alpha, tau, most, span)
        value, kappa, _ = best_on_ray(code, alpha, c * signs[0], s * signs[1], equal, 0, 0, table, rows, box, work)
        if value < best:
            best, at, where = value, kappa, tau
    return best, at, where


@compiled
def best_of_order(code, alpha, signs, taus, equal, most, span, table, rows, box, work, nominal, nominal_work):
    """(cost, kappa, tau) of the best ray of an order on which two equalities hold; `nominal` has one plant."""
    best, at, where = NOTHING, 0.0, 0.0
    for pick in range(_MOST_GAINS):
        last, known, kappas = 0.0, False, 0
        for j in range(len(taus)):
            c, s = direction(alpha, taus[j], most, span)
            off, there, count = missed_on_ray(
                pick, alpha, c * signs[0], s * signs[1], equal, nominal, rows, nominal_work
            )
            kappas = max(kappas, count)
            if there and known and (off > 0.0) != (last > 0.0) and abs(off - last) < 2.0:
                a, b, at_a = taus[j - 1], taus[j], last
                for _ in range(40):
                    middle = 0.5 * (a + b)
                    c, s = direction(alpha, middle, most, span)
                    value, _, _ = missed_on_ray(
                        pick, alpha, c * signs[0], s * signs[1], equal, nominal, rows, nominal_work
                    )
                    if (value > 0.0) == (at_a > 0.0):
                        a = middle
                    else:
                        b = middle
                c, s = direction(alpha, a, most, span)
                value, kappa, _ = best_on_ray(
                    code, alpha, c * signs[0], s * signs[1], equal, pick, 0, table, rows, box, work
                )
                if value < best:
                    best, at, where = value, kappa, a
            last, known = off, there
        if kappas <= pick + 1:
            # no ray has another kappa
            break
    return best, at, where


@compiled
def scan_rays(code, alphas, taus, quadrants, equal, most, span, table, rows, box, work):
    """Costs and kappas, shapes (quadrants, alphas, taus), NOTHING where a ray has nothing that meets everything."""
    shape = (len(quadrants), len(alphas), len(taus))
    costs, kappas = np.full(shape, NOTHING), np.zeros(shape)
    for z in range(shape[0]):
        for i in range(shape[1]):
            for j in range(shape[2]):
                c, s = direction(alphas[i], taus[j], most, span)
                c, s = c * quadrants[z, 0], s * quadrants[z, 1]
                costs[z, i, j], kappas[z, i, j], _ = best_on_ray(
                    code, alphas[i], c, s, equal, -1, 0, table, rows, box, work
                )
    return costs, kappas


@compiled
def compass(code, start, steps, fixed, signs, equal, most, span, least, rounds, table, rows, box, work):
    """Compass search on (alpha, tau) from a ray: (alpha, tau, cost, kappa).

    Args:
        start: alpha, tau and the cost there.
        steps: the first steps in alpha and tau.
        fixed: whether tau stays.
        signs: of kp and ki.
        least: steps smaller than this end the search.
        rounds: at most so many.
        code, equal, most, span, table, rows, box, work: as in `best_on_ray` and `direction`.
    """
    alpha, tau, best, kappa = start[0], start[1], start[2], 0.0
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
                x, y = alpha + 2.0 * pa, tau + 2.0 * pt
            else:
                x, y = alpha + da * ways[d, 0], tau + dt * ways[d, 1]
            x = min(max(x, box.alpha_low), box.alpha_high)
            y = tau if fixed else min(max(y, -1.0), 1.0)
            if x == alpha and y == tau:
                continue
            c, s = direction(x, y, most, span)
            value, at, _ = best_on_ray(code, x, c * signs[0], s * signs[1], equal, -1, 8, table, rows, box, work)
            if value < best:
                pa, pt = (2.0 * pa, 2.0 * pt) if d < 0 else (x - alpha, y - tau)
                best, alpha, tau, kappa, moved = value, x, y, at, True
                break
        if not moved:
            pa = pt = 0.0
            da, dt = 0.5 * da, 0.5 * dt
            if max(da, dt) < least:
                break
    return alpha, tau, best, kappa
