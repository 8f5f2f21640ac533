"""What a distribution of an uncertain number is:  u in (0, 1), Uncertain -> value.

A value is the inverse of the distribution function at u.  Only elementwise functions are used, so that a value does not
depend on its neighbours in the array.  SciPy is imported when values are drawn; reading a spec does not need it.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass

from fopi_tune.core.bode_form import Array
from fopi_tune.core.plant import Uncertain
from fopi_tune.errors import DomainError

#: a distribution in a spec: a word, or a word with its numbers
Words = str | Mapping[str, Mapping[str, float | str | list[float]]]


class Distribution(ABC):
    """A distribution of one uncertain number."""

    @abstractmethod
    def values(self, u: Array, number: Uncertain) -> Array:
        """Quantiles: the values whose distribution function is u.

        Args:
            u: any shape, in (0, 1).
            number: the range and nominal value.

        Raises:
            DomainError: this range has no such distribution.
        """

    @abstractmethod
    def limits(self, number: Uncertain) -> tuple[float, float]:
        """The least and the greatest possible value, infinite where there is none."""

    @abstractmethod
    def words(self) -> Words:
        """The distribution as a spec writes it."""

    def reach(self, number: Uncertain) -> tuple[float, float]:
        """Finite bounds that no draw exceeds, because a random number u has 53 bits."""
        return self.limits(number)

    def problem(self, number: Uncertain) -> str | None:
        """Why nothing can be drawn for this number and what to do, or None."""
        if all(map(math.isfinite, self.reach(number))):
            return None
        return "has values that are too large for a floating-point number; write smaller numbers"


@dataclass(frozen=True)
class MeanAndStd(Distribution):
    """A distribution that two numbers fix, both in the unit of the uncertain number.

    Args:
        mean: of what the distribution says.
        std: standard deviation, > 0.
    """

    mean: float
    std: float

    def __post_init__(self) -> None:
        check_finite(self, self.mean, self.std)
        check_positive(self, "std", self.std)


def check_finite(distribution: Distribution, *numbers: float) -> None:
    """Refuse numbers that are not finite.

    Raises:
        DomainError: there is one.
    """
    if not all(math.isfinite(v) for v in numbers):
        raise DomainError(f"{distribution} has a number that is not finite")


def check_positive(distribution: Distribution, name: str, value: float) -> None:
    """Refuse a number that is not positive.

    Raises:
        DomainError: value <= 0.
    """
    if value <= 0:
        raise DomainError(f"{distribution}: {name} must be greater than 0")
