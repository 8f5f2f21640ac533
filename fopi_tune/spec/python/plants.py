"""Plants of a spec as objects:  `ft.Lag(1.0, 2.25).uncertain(time_constant_s=(1.6, 3.1))`.

Numbers may be exact, `ft.Uncertain`, or become ranges by `uncertain`; what stands in the spec is what YAML would have.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any, Self

import numpy as np

from fopi_tune.core.bode_form import Array
from fopi_tune.core.plant import Uncertain
from fopi_tune.core.terms.numbers import plain_number, plain_numbers
from fopi_tune.core.text_tables.words import counted
from fopi_tune.errors import DomainError

#: an exact number, or a range
Number = float | Uncertain
#: (min, max), the nominal value being the one that was there, or (min, nominal, max)
Range = tuple[float, float] | tuple[float, float, float]
_PLACE = re.compile(r"(\w+)(?:\[(\d+)\])?")


@dataclass(frozen=True)
class _PlantModel:
    def uncertain(self, places: Mapping[str, Range] | None = None, /, **ranges: Range) -> Self:
        """The plant with ranges in place of numbers.

        Args:
            places: range by the number's name in results, such as "denominator[0]".
            ranges: the same of names that are words, such as time_constant_s=(1.6, 3.1), each in the number's unit.

        Raises:
            DomainError: a number that the plant has not, or ends that do not enclose the nominal value.
        """
        found = self
        for name, ends in {**(places or {}), **ranges}.items():
            found = found._with_range(name, ends)
        return found

    def _with_range(self, name: str, ends: Range) -> Self:
        match = _PLACE.fullmatch(name)
        known = {field.name for field in fields(self)}
        if match is None or match[1] not in known:
            raise DomainError(f"{name!r} is no number of a {type(self).__name__}; it has {', '.join(sorted(known))}")
        before = getattr(self, match[1])
        if match[2] is None:
            return replace(self, **{match[1]: _range(name, before, ends)})
        index = int(match[2])
        if not isinstance(before, Sequence | np.ndarray) or index >= len(before):
            raise DomainError(f"{name!r} is no number of this {type(self).__name__}")
        listed = list(before)
        listed[index] = _range(name, listed[index], ends)
        return replace(self, **{match[1]: tuple(listed)})


@dataclass(frozen=True)
class Lag(_PlantModel):
    """P(s) = K e^(-L s)/(tau s + 1).

    Args:
        static_gain: K, output unit per control unit.
        time_constant_s: tau, s.
        dead_time_s: L, s.
    """

    static_gain: Number
    time_constant_s: Number
    dead_time_s: Number = 0.0

    def as_mapping(self) -> dict[str, Any]:
        """The entry of a spec."""
        return {"model": "lag", **{field.name: getattr(self, field.name) for field in fields(self)}}


@dataclass(frozen=True)
class TransferFunction(_PlantModel):
    """P(s) = N(s) e^(-L s)/D(s).

    Args:
        numerator: coefficients of N in descending powers of s, shape (n,).
        denominator: the same of D, shape (d,).
        dead_time_s: L, s.
    """

    numerator: Sequence[Number] | Array
    denominator: Sequence[Number] | Array
    dead_time_s: Number = 0.0

    def as_mapping(self) -> dict[str, Any]:
        """The entry of a spec."""
        return {"model": "transfer_function", **{field.name: getattr(self, field.name) for field in fields(self)}}


def _range(name: str, before: Any, ends: Range) -> Uncertain:
    nominal = before.nominal if isinstance(before, Uncertain) else before
    if isinstance(nominal, Sequence | np.ndarray) and not isinstance(nominal, str):
        raise DomainError(f"{name} is a list; name one of its numbers, such as {name}[0]")
    given = plain_numbers(name, ends)
    if len(given) not in (2, 3):
        raise DomainError(f"{name} has {counted(len(given), 'end')}; give (min, max), or (min, nominal, max)")
    middle = float(given[1] if len(given) == 3 else plain_number(name, nominal))
    low, high = float(given[0]), float(given[-1])
    if not low <= middle <= high:
        raise DomainError(f"{name}: {low!r} to {high!r} does not enclose the nominal value {middle!r}")
    return Uncertain(middle, low, high)
