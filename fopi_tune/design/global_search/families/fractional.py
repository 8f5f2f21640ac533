"""Fractional plants in the numbers of the search:  coefficients as of other plants, and behind them their orders.

With s = omega_s s' a term c s^e is c omega_s^e s'^e.  A measurement filter F is counted to the plant: 1/F, a
polynomial, multiplies each term of D.
"""

from __future__ import annotations

import numpy as np

from fopi_tune.core.bode_form import Array
from fopi_tune.core.fractional_plants.family import ON_SAMPLES, FractionalFamily
from fopi_tune.core.fractional_plants.orders import refuse_fractional
from fopi_tune.design.constraints import Scale
from fopi_tune.design.global_search.compiled import COEFFICIENTS, WIDTH, WITH_ORDERS, Family
from fopi_tune.errors import DomainError


def fractional_terms(family: FractionalFamily, scale: Scale, on_samples: bool) -> Family:
    """The coefficients over the box, affine in the uncertain numbers.

    Args:
        family: the plants.
        scale: of frequency and gain, and the filter.
        on_samples: whether the loop is.

    Raises:
        DomainError: a loop on samples, or more terms than the search has room for.
    """
    if on_samples:
        refuse_fractional("design: sampled", ON_SAMPLES)
    low, high = family.low, family.high
    corners = np.vstack([low, low + np.diag(high - low)]) if len(low) else np.zeros((1, 0))
    top, bottom, dead_time = family.tables(corners)
    top_orders, bottom_orders = (np.array(side) for side in (family.orders.numerator, family.orders.denominator))
    used = scale.measurement_filter
    if used is not None:
        factor = np.array(used.coefficients)
        bottom = (bottom[:, :, None] * factor).reshape(len(bottom), -1)
        bottom_orders = (bottom_orders[:, None] + np.arange(len(factor) - 1, -1, -1.0)).ravel()
        if len(bottom_orders) > WIDTH:
            raise DomainError(
                f"the denominator has more than {WIDTH} terms beside a measurement filter of order {used.order}; leave "
                "the filter or a term out"
            )
    rows = np.zeros((len(corners), WITH_ORDERS))
    omega = scale.omega_rad_s
    for first, side, orders, gain in ((0, top, top_orders, scale.gain), (WIDTH, bottom, bottom_orders, 1.0)):
        end = first + WIDTH
        rows[:, end - len(orders) : end] = side * omega**orders / gain
        at = COEFFICIENTS + first
        rows[:, at + WIDTH - len(orders) : at + WIDTH] = orders
    rows[:, : 2 * WIDTH] /= np.abs(rows[:, WIDTH : 2 * WIDTH]).max()
    rows[:, 2 * WIDTH] = dead_time * omega
    rows[:, 2 * WIDTH + 1 : COEFFICIENTS] = scale.lag_and_square
    slopes = (rows[1:] - rows[0]) / (high - low)[:, None] if len(low) else np.zeros((0, WITH_ORDERS))
    # orders are the same for all members, without rounding
    slopes[:, COEFFICIENTS:] = 0.0
    terms = np.vstack([rows[0] - low @ slopes, slopes])
    return Family(terms, 0.0, 0.0, np.zeros((0, len(low)), dtype=np.int64))


def numbers_of_terms(plants: Family) -> tuple[int, int]:
    """Of fractional plants the numbers of terms of N and D, else (0, 0)."""
    if plants.terms.shape[1] == COEFFICIENTS:
        return 0, 0
    # a term is there if its coefficient is not 0 all over the box
    used = np.any(plants.terms != 0.0, axis=0)
    top, bottom = (WIDTH - int(np.argmax(used[first : first + WIDTH])) for first in (0, WIDTH))
    return top, bottom


def sides_at_real(plants: Array, s: float) -> tuple[Array, Array]:
    """N and D of plants at a real s > 0, shape (m,) each, without the dead time; of one plant a number each.

    Args:
        plants: in the numbers of the search, shape (m, 21) or (m, 39), or one of them.
        s: scaled, dimensionless.
    """
    top, bottom = plants[..., :WIDTH], plants[..., WIDTH : 2 * WIDTH]
    if plants.shape[-1] == COEFFICIENTS:
        powers = s ** np.arange(WIDTH - 1, -1, -1.0)
        return top @ powers, bottom @ powers
    orders = np.atleast_2d(plants)[0, COEFFICIENTS:]
    return top @ s ** orders[:WIDTH], bottom @ s ** orders[WIDTH:]
