"""Limits of responses over a box of controllers, at one frequency of one plant.

Such a limit says that C stays outside a disc, or inside, or on one side of a line:

    q(C) = a |C|^2 + 2 Re(b C) + c <= 0 ,      P the plant, M the limit

    |S|   <= M    -|P|^2 |C|^2 - 2 Re(P C) - 1 + 1/M^2
    |T|   <= M    (1 - M^2) |P|^2 |C|^2 - 2 M^2 Re(P C) - M^2
    |C S| <= M    (1 - M^2 |P|^2) |C|^2 - 2 M^2 Re(P C) - M^2
    |L|   <= M    |P|^2 |C|^2 - M^2                                                                                (1)

and the opposite for >=.  With the Taylor model of `fopi_tune.optimum.parametrization` and w = a conj(C_c) + b,

    q >= q(C_c) - 2 sum |Re(w C_i)| h_i - 2 |w| r - max(-a, 0) (sum |C_i| h_i + r)^2 .                       (2)

Source: derived; (1) is each response's limit squared and written out, (2) a lower bound over the Taylor model.
"""

from __future__ import annotations

from flint import acb, arb

from fopi_tune.core.peaks import Response
from fopi_tune.optimum.parametrization import TaylorModel


def quadratic(response: Response, p: acb, limit: arb, upper: bool) -> tuple[arb, acb, arb]:
    """a, b and c of (1), from M^2."""
    size = abs(p) ** 2
    if response is Response.SENSITIVITY:
        found = -size, -p, 1 / limit - 1
    elif response is Response.LOOP_GAIN:
        found = size, acb(0), -limit
    else:
        first = size if response is Response.COMPLEMENTARY_SENSITIVITY else arb(1)
        found = first - limit * size, -limit * p, -limit
    return found if upper else (-found[0], -found[1], -found[2])


def lower_bound(q: tuple[arb, acb, arb], taylor_model: TaylorModel, half: tuple[arb, ...]) -> arb:
    """The bound (2)."""
    a, b, c = q
    middle = taylor_model.middle
    w = a * middle.conjugate() + b
    value = a * abs(middle) ** 2 + 2 * (b * middle).real + c
    pairs = list(zip(taylor_model.slopes, half, strict=True))
    value = value - 2 * sum((abs((w * slope).real) * h for slope, h in pairs), abs(w) * taylor_model.remainder)
    if not a >= 0:
        reach = sum((abs(slope) * h for slope, h in pairs), taylor_model.remainder)
        value = value - abs(a) * reach**2
    return value
