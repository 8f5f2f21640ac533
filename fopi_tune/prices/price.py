"""The price of a limit by solving again:  the objective with the limit moved a little, both ways.

With d the distance in neper or radian by which a limit is relaxed (d > 0) or tightened (d < 0), and J(d) the
improvement of the objective, each one-sided derivative comes from two steps of size h and 2h,

    J'(0+) ~ (4 J(h) - J(2h)) / 2h ,        J'(0-) ~ -(4 J(-h) - J(-2h)) / 2h ,                                   (1)

with an error of h^2 J'''/3.  J is computed by `fopi_tune.proof` from gains that were solved for again, without the
solver's multiplier.  The exchange ends when nothing is violated by more than 2e-7, which changes J by 2e-7 times the
price; in (1) that is a relative error of 4 (2e-7)/h, 4e-4 for h = 2e-3.  Where the two derivatives differ the optimum
has a kink: another requirement becomes active, and the price of relaxing is not that of tightening.

Source: Taylor's formula with J(0) = 0.
"""

from __future__ import annotations

from dataclasses import replace

from fopi_tune.core.controller import FoPi
from fopi_tune.prices.limit import MovableLimit, movable_limits
from fopi_tune.prices.prober import Probe, Prober, is_maximised, is_no_worse
from fopi_tune.results.status import Price
from fopi_tune.spec.model import DesignSpec

#: h in neper or radian, and a smaller one in case there is a kink within the first
_STEPS = (2e-3, 4e-4)
#: relative; above the errors of (1) by the tolerance of the exchange (2e-3 for the smaller step) and by J'''
_AGREES = 1e-2
#: relative change of the objective when the limit doubles; a multiplier with a smaller one counts as 0
_NO_PRICE = 1e-6


def price_of(spec: DesignSpec, gains: FoPi, number: int, multiplier: float | None) -> Price | None:
    """Check one requirement's multiplier.

    Args:
        spec: the user's.
        gains: its designed gains.
        number: of the requirement from 1 on, those of scenarios last.
        multiplier: the solver's; None where it has none.

    Returns:
        The price (of a `between` the larger one of its two limits); None for a requirement that costs nothing.
    """
    if multiplier is None:
        return None
    found: list[Price] = []
    # to first order the best times of filters stay where they are
    spec = replace(spec, controller=spec.controller.with_times_of(gains))
    for movable in movable_limits(spec):
        if movable.index + 1 != number:
            continue
        prober = Prober.of(movable, gains)
        if abs(multiplier) * (abs(movable.limit) or 1.0) <= _NO_PRICE * abs(prober.base.objective or 0.0):
            continue
        if movable.end and not prober.point(prober.base).binds:
            continue
        found.append(_priced(movable, prober, multiplier))
    return max(found, key=lambda price: max(abs(price.relaxed or 0.0), abs(price.tightened or 0.0)), default=None)


def _priced(movable: MovableLimit, prober: Prober, multiplier: float) -> Price:
    """The price by (1), with smaller steps until it agrees with the multiplier."""
    base = prober.from_neighbour(movable.limit, prober.base)
    if base is None or not base.is_met or not is_no_worse(prober, base, prober.base):
        base = prober.base
    price = Price(movable.limit, None, None, agrees=False)
    for step in _STEPS:
        sides = _by_steps(movable, prober, base, step)
        agrees = all(side is None or abs(side - multiplier) <= _AGREES * abs(multiplier) for side in sides)
        known = any(side is not None for side in sides)
        price = Price(movable.limit, *sides, agrees=agrees and known)
        if price.agrees:
            break
    return price


def _by_steps(movable: MovableLimit, prober: Prober, base: Probe, step: float) -> tuple[float | None, float | None]:
    """Formula (1) for relaxing and for tightening, in the objective's unit per unit of the limit."""
    quantity, natural = movable.quantity, movable.quantity.to_natural(movable.limit)
    h = step / quantity.natural_scale(movable.limit)
    outward = -movable.tightens or 1
    # d natural / d public, by a central difference as small as rounding lets it be
    small = 1e-6 * abs(h)
    per_public = 2.0 * small / (quantity.from_natural(natural + small) - quantity.from_natural(natural - small))

    def one_sided(way: int) -> float | None:
        near, gained = base, []
        for times in (1, 2):
            probe = prober.from_neighbour(quantity.from_natural(natural + way * times * h), near)
            if probe is None or probe.objective is None or base.objective is None:
                return None
            sign = 1.0 if is_maximised(movable.spec.objective) else -1.0
            gained.append(sign * (probe.objective - base.objective))
            near = probe
        return (4.0 * gained[0] - gained[1]) / (2.0 * h) * per_public

    up, down = one_sided(outward), one_sided(-outward)
    tightened = None if down is None else -down
    if movable.tightens == 0 and (up if up is not None else tightened or 0.0) < 0.0:
        # the direction that relaxes an equality is the one that improves the objective
        return (down, None if up is None else -up)
    return up, tightened
