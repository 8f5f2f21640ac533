"""Numbers that people give in Python:  NumPy's, fractions and others become Python's own, all else is refused by name.

Results, documents and hashes then hold plain numbers, whatever a controller or a plant was made of.
"""

from __future__ import annotations

import math
import operator
from collections.abc import Callable, Iterable
from numbers import Real
from typing import TYPE_CHECKING, Any

from fopi_tune.errors import DomainError

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

#: sizes beyond which a power of a number may leave the floats' range
_NEAR_ZERO, _NEAR_INFINITY = 1e-100, 1e100


def plain_number(name: str, value: Any) -> float:
    """A number as Python's float, or int where it was one.

    Args:
        name: what messages call it.
        value: a real number, or an array without dimensions that holds one; its unit is kept.

    Raises:
        DomainError: it is none.
    """
    if type(value) is float:
        return value
    held = value.item() if getattr(value, "ndim", None) == 0 else value
    # yes and no are numbers to Python, and never meant as ones here
    if isinstance(held, bool) or not isinstance(held, Real):
        raise DomainError(f"{name} = {value!r} is not a number; give a number")
    try:
        return value if type(value) is int and math.isfinite(value) else float(held)
    except OverflowError:  # not quoted, as Python refuses to write out whole numbers of many digits
        raise DomainError(f"{name} is not a number that can be computed with; give at most 1e100") from None


def plain_numbers(name: str, values: Any) -> tuple[float, ...]:
    """The same of a sequence of numbers, or an array of one dimension.

    Raises:
        DomainError: it is no sequence, or one of its entries is no number.
    """
    if isinstance(values, str | bytes) or not isinstance(values, Iterable) or getattr(values, "ndim", 1) != 1:
        raise DomainError(f"{name} = {values!r} is not a list of numbers; give a list, such as [1.0]")
    return tuple(plain_number(f"{name}[{index}]", value) for index, value in enumerate(values))


def keep_plain(record: Any, *names: str) -> None:
    """Replace fields of a frozen dataclass, in its `__post_init__`, by plain numbers that are finite.

    Raises:
        DomainError: one of them is no finite number.
    """
    for name in names:
        value = plain_number(name, getattr(record, name))
        if not math.isfinite(value):
            raise DomainError(f"{name} = {getattr(record, name)!r} is not a finite number; give a finite number")
        object.__setattr__(record, name, value)


def refuse_no_flag(name: str, value: Any) -> None:
    """Refuse what is neither True nor False: gains that stand where a flag belongs would count as yes.

    Raises:
        DomainError: it is neither.
    """
    if not isinstance(getattr(value, "item", lambda: value)(), bool):
        raise DomainError(f"{name} = {value!r} is neither True nor False; give one of them")


def whole_number(name: str, value: Any, least: int = 0) -> int:
    """A whole number as Python's int.

    Raises:
        DomainError: it is none, or below `least`.
    """
    try:
        whole = operator.index(value)
    except TypeError:
        raise DomainError(f"{name} = {value!r} is no whole number; give one, such as {max(least, 1)}") from None
    if whole < least:
        raise DomainError(f"{name} = {value!r} must be at least {least}")
    return whole


def values_at(
    s: Any,
    value: Callable[[NDArray[np.complex128]], NDArray[np.complexfloating]],
    at_zero: complex,
    at_infinity: complex,
) -> NDArray[np.complex128]:
    """A function of s at complex numbers, and its limits where these are 0 or infinite.

    Args:
        s: complex numbers of any shape, rad/s; where one is nan, so is the value.
        value: of the function at finite numbers that are not 0.  At a pole, where it divides by 0, it is infinite.
        at_zero: limit at 0, from the right.
        at_infinity: limit as |s| grows.

    Raises:
        DomainError: s is no number, nor an array of numbers.
    """
    import numpy as np

    try:
        given = np.asarray(s)
        # NumPy makes nan of None, and a number of its text
        kind = given.dtype.kind
        if kind not in "biufcO" or (kind == "O" and any(isinstance(each, str | None) for each in given.flat)):
            raise TypeError
        points = given.astype(complex)
    except (TypeError, ValueError, OverflowError):
        raise DomainError(f"s = {s!r:.100} is no complex number; give one, such as 0.3j, or an array of them") from None
    with np.errstate(all="ignore"):
        found = np.asarray(value(points), dtype=complex)
    if np.isfinite(found).all() and np.isfinite(points).all() and (points != 0.0).all():
        return found[()]
    size = np.abs(points)
    # a power of a number near the ends of the floats' range may leave it
    ends = [(size == 0.0) | (~np.isfinite(found) & (size < _NEAR_ZERO)), np.isnan(points)]
    ends += [np.isinf(size) | (~np.isfinite(found) & (size > _NEAR_INFINITY)), ~np.isfinite(found)]
    return np.select(ends, [at_zero, complex(np.nan, np.nan), at_infinity, complex(np.inf, 0.0)], found)[()]
