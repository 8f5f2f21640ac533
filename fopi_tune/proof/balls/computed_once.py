"""A property that is computed on first use and kept:  `functools.cached_property` without its lock and its checks.

A box in ball arithmetic has a dozen of them and a proof a hundred thousand boxes, so that the lock that Python 3.11
takes for each (0.5 us) costs as much as the arithmetic.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Generic, Self, TypeVar, overload

Value = TypeVar("Value")


class computed_once(Generic[Value]):  # noqa: N801  # in lower case, as the decorator that it stands for
    """A method without arguments as an attribute that is computed once; for classes with a `__dict__`.

    Args:
        method: computes the value.
    """

    def __init__(self, method: Callable[[Any], Value]) -> None:
        self._method, self._name, self.__doc__ = method, method.__name__, method.__doc__
        self.__isabstractmethod__ = getattr(method, "__isabstractmethod__", False)

    @overload
    def __get__(self, instance: None, owner: type | None = None) -> Self: ...

    @overload
    def __get__(self, instance: object, owner: type | None = None) -> Value: ...

    def __get__(self, instance: object | None, owner: type | None = None) -> Any:
        if instance is None:
            return self
        # found before this descriptor from now on, since it has no __set__
        value = instance.__dict__[self._name] = self._method(instance)
        return value
