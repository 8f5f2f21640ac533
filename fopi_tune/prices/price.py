"""The price of a limit by solving again:  the objective with the limit moved a little, both ways.

With d the distance in neper or radian by which a limit gives (d > 0) or takes (d < 0), and J(d) what the objective
gains, each one-sided derivative comes from two steps,

    J'(0+) ~ (4 J(h) - J(2h)) / 2h ,        J'(0-) ~ -(4 J(-h) - J(-2h)) / 2h ,                                   (1)

exact but for h^2 J'''/3.  J is that of `fopi_tune.proof`, of gains that were solved for anew; the solver's multiplier
has no part in it.  The exchange ends when nothing is violated by more than 2e-7, which moves J by 2e-7 times the price:
4 (2e-7)/h of it in (1), 4e-4 for h = 2e-3.  Where the two sides differ the optimum has a kink: another requirement
comes into play there, and the price of relaxing is not that of tightening.

Source: Taylor's formula with J(0) = 0.
"""

from __future__ import annotations

from fopi_tune.core.controller import FoPi
from fopi_tune.prices.limit import MovableLimit, movable_limits
from fopi_tune.prices.prober import Probe, Prober, is_maximised, is_no_worse
from fopi_tune.results.status import Price
from fopi_tune.spec.model import DesignSpec

#: h in neper or radian, and a second one where a kink may lie nearer than the first
_STEPS = (2e-3, 4e-4)
#: relative; errors of (1) by rounding of the exchange (2e-3 for the smaller step) and by its curvature lie below
_AGREES = 1e-2
#: a multiplier that changes the objective by less than this part of it when its limit is doubled counts as 0
_NO_PRICE = 1e-6


def price_of(spec: DesignSpec, gains: FoPi, number: int, multiplier: float | None) -> Price | None:
    """Check one requirement's multiplier.

    Args:
        spec: what was asked, in continuous time.
        gains: of its design.
        number: of the requirement, from 1 on.
        multiplier: the solver's; None where it has none.

    Returns:
        The price, of a `between` that of its dearer end; None for a requirement that costs nothing.
    """
    if multiplier is None:
        return None
    found: list[Price] = []
    for knob in movable_limits(spec):
        if knob.number != number:
            continue
        prober = Prober.of(knob, gains)
        if abs(multiplier) * (abs(knob.limit) or 1.0) <= _NO_PRICE * abs(prober.base.objective or 0.0):
            continue
        if knob.end and not prober.point(prober.base).binds:
            continue
        found.append(_priced(knob, prober, multiplier))
    return max(found, key=lambda price: max(abs(price.relaxed or 0.0), abs(price.tightened or 0.0)), default=None)


def _priced(knob: MovableLimit, prober: Prober, multiplier: float) -> Price:
    """With ever smaller steps until the prices agree with the multiplier."""
    base = prober.from_neighbour(knob.limit, prober.base)
    if base is None or not base.is_met or not is_no_worse(prober, base, prober.base):
        base = prober.base
    price = Price(knob.limit, None, None, agrees=False)
    for step in _STEPS:
        sides = _by_steps(knob, prober, base, step)
        agrees = all(side is None or abs(side - multiplier) <= _AGREES * abs(multiplier) for side in sides)
        known = any(side is not None for side in sides)
        price = Price(knob.limit, *sides, agrees=agrees and known)
        if price.agrees:
            break
    return price


def _by_steps(knob: MovableLimit, prober: Prober, base: Probe, step: float) -> tuple[float | None, float | None]:
    """Formula (1), relaxing and tightening, in the objective's unit per unit of the limit."""
    quantity, natural = knob.quantity, knob.quantity.to_natural(knob.limit)
    h = step / quantity.natural_scale(knob.limit)
    outward = -knob.tightens or 1
    # d natural / d public, by a central difference as small as rounding lets it be
    small = 1e-6 * abs(h)
    per_public = 2.0 * small / (quantity.from_natural(natural + small) - quantity.from_natural(natural - small))

    def one_sided(way: int) -> float | None:
        near, gained = base, []
        for times in (1, 2):
            probe = prober.from_neighbour(quantity.from_natural(natural + way * times * h), near)
            if probe is None or probe.objective is None or base.objective is None:
                return None
            sign = 1.0 if is_maximised(knob.spec.objective) else -1.0
            gained.append(sign * (probe.objective - base.objective))
            near = probe
        return (4.0 * gained[0] - gained[1]) / (2.0 * h) * per_public

    up, down = one_sided(outward), one_sided(-outward)
    tightened = None if down is None else -down
    if knob.tightens == 0 and (up if up is not None else tightened or 0.0) < 0.0:
        # an equality gives whichever way the objective gains
        return (down, None if up is None else -up)
    return up, tightened
