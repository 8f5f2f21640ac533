"""Which samples of a trajectory are limited, over a box of plants, and the loop's filter under such a pattern.

    u = (1 - share) v + share limit + shift + symbol,      |symbol| <= reach                                         (1)

holds at a free sample with share 0, at a limited one with share 1.  Where v reaches from a to b about a limit,
a < 0 < b, the excess s = max(v - limit, 0) is enclosed by the chord,

    s = c (v - limit) + from 0 to -c a,      c = b/(b - a) ,                                                         (2)

so that such a sample has the share c and a symbol of its own.  With L = diag(share) and the anti-windup H,

    v = (I + H L)^-1 (C e + start + H (L limit + shift + symbols)) .                                                 (3)

Source: derived here from (1) of `fopi_tune.digital.runtime`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from fopi_tune.core.bode_form import Array
from fopi_tune.proof.time_domain.bounded import Causal
from fopi_tune.proof.time_domain.case import TimeDomainCase
from fopi_tune.proof.time_domain.models import Model

#: by how much a chord's ends are moved outwards, relative to their distance and to the limit: above rounding
_MARGIN, _ROUNDING = 1e-9, 1e-15


@dataclass(frozen=True, eq=False)
class Pattern:
    """(1); arrays of shape (K,).

    Args:
        share: in [0, 1].
        limited: share times the limit, plus the shift.
        reach: of the symbols; 0 at a sample without one.
        low, high: what (1) assumes of v: its range where there is a symbol, the limits where it is free, and beyond
            a limit where it is limited.
    """

    share: Array
    limited: Array
    reach: Array
    low: Array
    high: Array

    @property
    def is_free(self) -> bool:
        """Whether no sample is limited."""
        return not self.share.any()

    @cached_property
    def symbols(self) -> NDArray[np.intp]:
        """The samples with a symbol."""
        return np.flatnonzero(self.reach)

    @property
    def key(self) -> bytes:
        """Of the filter under this pattern."""
        return self.share.tobytes()

    def is_confirmed(self, demanded: Model) -> bool:
        """Whether v keeps to what (1) assumes; then, sample by sample, the pattern is that of every plant."""
        return bool(np.all((demanded.low >= self.low) & (demanded.high <= self.high)))


def free_pattern(case: TimeDomainCase) -> Pattern:
    """No sample is limited."""
    zeros, (low, high) = np.zeros(case.samples), case.output_limits
    return Pattern(zeros, zeros, zeros, zeros + low, zeros + high)


def pattern_of(case: TimeDomainCase, low: Array, high: Array) -> Pattern:
    """The pattern where v lies between `low` and `high`, shape (K,), as (1) then assumes of it."""
    bottom, top = case.output_limits
    share, limited, reach = np.zeros((3, case.samples))
    assumed_low, assumed_high = np.full(case.samples, bottom), np.full(case.samples, top)
    for k in np.flatnonzero((high > top) | (low < bottom)):
        above, below = low[k] >= top, high[k] <= bottom
        if above or below:
            share[k], limited[k] = 1.0, top if above else bottom
            assumed_low[k], assumed_high[k] = (top, math.inf) if above else (-math.inf, bottom)
            continue
        # about the upper limit, or, with all signs changed, about the lower one; about both a symbol is all of u
        if high[k] > top and low[k] < bottom:
            share[k], limited[k], reach[k] = 1.0, 0.5 * (bottom + top), 0.5 * (top - bottom) * (1.0 + _MARGIN)
            assumed_low[k], assumed_high[k] = -math.inf, math.inf
            continue
        upper = high[k] > top
        limit, sign = (top, 1.0) if upper else (bottom, -1.0)
        a, b = sorted((sign * (low[k] - limit), sign * (high[k] - limit)))
        share[k] = b / (b - a)
        # s - share (v - limit) lies between 0 and -share a, up to rounding
        most = -share[k] * a
        limited[k] = share[k] * limit - sign * 0.5 * most
        reach[k] = 0.5 * most * (1.0 + _MARGIN) + _ROUNDING * (abs(limit) + b - a)
        assumed_low[k], assumed_high[k] = low[k], high[k]
    return Pattern(share, limited, reach, assumed_low, assumed_high)


@dataclass(frozen=True, eq=False)
class Filter:
    """The controller under a pattern:  v = own(C (r - y) + start + H limited) and u by (1) of this module.

    Args:
        own: (I + H L)^-1; None for the identity.
        path: own C, from the error to v.
        control: from the error to u.
    """

    own: Causal | None
    path: Causal
    control: Causal


def filter_under(case: TimeDomainCase, pattern: Pattern) -> Filter | None:
    """(3); None where the inverse is not shown to be one."""
    if pattern.is_free:
        return Filter(None, case.path, case.path)
    count = case.samples
    weighted = case.correction.matrix * pattern.share[None, :]
    own = Causal(np.eye(count) + weighted, case.correction.error + 4e-16 * (1.0 + case.correction.norm)).inverse()
    if own is None:
        return None
    path = own.after(case.path)
    return Filter(own, path, path.scaled(1.0 - pattern.share))
