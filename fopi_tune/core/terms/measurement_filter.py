"""The filter of the measurement before all terms of a controller:  F(s) = 1/(1 + sT), or 1/(1 + sT + s^2 T^2/2).

The loop is L = C P with C = F (kp + ki s^-alpha + ...); the setpoint is not filtered.  On samples F is made by Tustin's
rule, s -> (2/Ts) (z - 1)/(z + 1), as the derivative's filter is.  In w = (z - 1)/(z + 1) it has then the same form with
T 2/Ts in the place of T,

    F = 1/(1 + w a),    or    1/(1 + w a + w^2 a^2/2),      a = 2 T/Ts ,                                            (1)

so that at omega it is F at (2/Ts) tan(omega Ts/2) instead of at omega: exact as omega -> 0, 0 at Nyquist's frequency,
and in between off by d ln F/d ln omega (omega Ts)^2/12 to first order.

Source: derived; tan x = x + x^3/3 + ...
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

from fopi_tune.core.terms.numbers import keep_plain, values_at
from fopi_tune.errors import DomainError

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from fopi_tune.core.bode_form import Array, BodeForm

#: names of a measurement filter's numbers in documents
FILTER_NAMES = ("measurement_filter_order", "measurement_filter_time_constant_s")
#: orders of a measurement filter
FILTER_ORDERS = (1, 2)
#: s; of what can be computed with
_SMALLEST, _LARGEST = 1e-100, 1e100


@dataclass(frozen=True)
class MeasurementFilter:
    """F(s) = 1/(1 + sT) of order 1, 1/(1 + sT + s^2 T^2/2) of order 2; F(0) = 1, and F falls without end.

    Args:
        order: 1 or 2; of order 2 |F| is that of Butterworth's filter with the corner sqrt(2)/T.
        time_constant_s: T > 0, s.

    Raises:
        DomainError: another order, or T is not a positive number that can be computed with.
    """

    order: int
    time_constant_s: float

    def __post_init__(self) -> None:
        if isinstance(self.order, bool) or self.order not in FILTER_ORDERS:
            raise DomainError(f"a measurement filter of order {self.order!r} is not known; take 1 or 2")
        keep_plain(self, "time_constant_s")
        if not self.time_constant_s > 0.0:
            raise DomainError(f"time_constant_s = {self.time_constant_s!r} of a measurement filter must be above 0")
        if not _SMALLEST <= self.time_constant_s <= _LARGEST:
            raise DomainError(
                f"time_constant_s = {self.time_constant_s!r} of a measurement filter cannot be computed with; "
                f"take {_SMALLEST:g} to {_LARGEST:g}"
            )
        object.__setattr__(self, "order", int(self.order))

    @property
    def coefficients(self) -> tuple[float, ...]:
        """Of 1/F, descending powers of s."""
        time = self.time_constant_s
        return (time, 1.0) if self.order == 1 else (0.5 * time * time, time, 1.0)

    def slower(self, factor: float) -> MeasurementFilter:
        """The same filter with time in another unit.

        Args:
            factor: of T, the new units in a second.
        """
        return MeasurementFilter(self.order, self.time_constant_s * factor)

    def log(self, count: int) -> BodeForm:
        """ln F of `count` equal loops, by u = ln omega; of (1) by ln|w| with T = a.

        A root r of 1/F, -1/T or (-1 +- j)/T, gives the factor 1 - s/r.
        """
        import numpy as np

        from fopi_tune.core.bode_form import BodeForm

        roots = np.array([-1.0 + 0j] if self.order == 1 else [-1.0 + 1j, -1.0 - 1j])
        ones, none = np.ones((count, self.order)), np.zeros(count)
        corner = np.log(np.abs(roots)) - math.log(self.time_constant_s)
        return BodeForm(none, none, none, -ones, ones, corner * ones, np.angle(-1j / roots) * ones, none)

    def polynomials_in_z(self, sample_time_s: float) -> tuple[tuple[float, ...], tuple[float, ...]]:
        """Numerator and denominator of (1), descending powers of z.

        Args:
            sample_time_s: Ts, s.
        """
        a = 2.0 * self.time_constant_s / sample_time_s
        if self.order == 1:
            return (1.0, 1.0), (1.0 + a, 1.0 - a)
        square = 0.5 * a * a
        return (1.0, 2.0, 1.0), (1.0 + a + square, 2.0 - 2.0 * square, 1.0 - a + square)

    def on_samples(self, omega_rad_s: Array, sample_time_s: float) -> NDArray[np.complex128]:
        """F(e^{j omega Ts}) by Tustin's rule, shape (n,); 0, but for rounding, at Nyquist's frequency.

        Args:
            omega_rad_s: shape (n,), rad/s, up to Nyquist's frequency.
            sample_time_s: Ts, s.
        """
        import numpy as np

        half = 0.5 * np.minimum(omega_rad_s * sample_time_s, np.pi)
        return self(2j / sample_time_s * np.tan(half))

    def __call__(self, s: complex | NDArray[np.complexfloating]) -> NDArray[np.complex128]:
        """F(s) at complex numbers of any shape, rad/s; its limits where s is 0 or infinite.

        Raises:
            DomainError: s is no number.
        """
        import numpy as np  # the command line reads gains before it needs arrays

        return values_at(s, lambda points: 1.0 / np.polyval(np.array(self.coefficients), points), 1.0, 0.0)


def filter_not_available(what: str) -> str:
    """What is said where a stage does not know a measurement filter."""
    return f"{what} is not available with a measurement_filter in this version; leave it out, or the filter"


def filter_numbers(measurement_filter: MeasurementFilter) -> dict[str, float]:
    """A measurement filter's numbers by name, as in documents."""
    return dict(zip(FILTER_NAMES, (measurement_filter.order, measurement_filter.time_constant_s), strict=True))


def filter_of(numbers: Mapping[str, float]) -> MeasurementFilter | None:
    """The inverse of `filter_numbers`; None where the numbers have no filter.

    Raises:
        DomainError: as of `MeasurementFilter`; one of the two numbers without the other.
    """
    given = [numbers.get(name) for name in FILTER_NAMES]
    if given == [None, None]:
        return None
    order, time_constant_s = given
    if order is None or time_constant_s is None:
        raise DomainError(f"a measurement filter has {FILTER_NAMES[0]} and {FILTER_NAMES[1]}; one of them is missing")
    if order not in FILTER_ORDERS:
        raise DomainError(f"a measurement filter of order {order:g} is not known; take 1 or 2")
    return MeasurementFilter(int(order), time_constant_s)
