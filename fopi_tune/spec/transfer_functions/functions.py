"""The functions that a transfer function is written with:  tf, zpk, conv, exp."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

from fopi_tune.errors import DomainError
from fopi_tune.spec.transfer_functions.rational import (
    ONE,
    ZERO,
    Exact,
    Polynomial,
    RationalFunction,
    multiplied,
    polynomial,
)
from fopi_tune.spec.yaml.problems import quoted


@dataclass(frozen=True)
class Vector:
    """A list, [1 0.1746]."""

    entries: tuple[RationalFunction, ...]

    def numbers(self, what: str) -> tuple[Exact, ...]:
        """Its entries.

        Raises:
            DomainError: one of them is no number.
        """
        found = tuple(entry.value for entry in self.entries)
        if any(value is None for value in found):
            raise DomainError(f"{what} has an entry with s; a list has numbers alone")
        return tuple(value for value in found if value is not None)


@dataclass(frozen=True)
class Text:
    """A word in quotes."""

    text: str


Value = RationalFunction | Vector | Text


@dataclass(frozen=True)
class Argument:
    """What a function is given.

    Args:
        name: of an option, "" of none.
        value: of any kind.
        at: where it begins.
    """

    name: str
    value: Value
    at: int

    def list(self, what: str) -> tuple[Exact, ...]:
        """The numbers of a list; a number alone is a list of one."""
        if isinstance(self.value, Text):
            raise DomainError(f"{what} is the text {quoted(self.value.text)}; write a list, such as [1 0.1746]")
        return (Vector((self.value,)) if isinstance(self.value, RationalFunction) else self.value).numbers(what)

    def number(self, what: str) -> Exact:
        """A number."""
        found = self.list(what)
        if len(found) != 1:
            raise DomainError(f"{what} must be one number, not {len(found)}")
        return found[0]

    def as_delay(self) -> RationalFunction:
        """e^{-Ls}, L this number of s."""
        value = self.number(self.name)
        if value.im or value.re < 0:
            raise DomainError(f"{self.name} must be a number of s, at least 0")
        return RationalFunction((ONE,), (ONE,), value.re)


#: options of tf, zpk and of what is assigned, in small letters
DELAYS = ("inputdelay", "outputdelay", "iodelay")
_DISCRETE = "a sample time makes it discrete; give the plant in continuous time (d2c)"


def exponential(exponent: RationalFunction) -> RationalFunction:
    """e to a power, which is -L s.

    Raises:
        DomainError: of another form.
    """
    top, bottom = exponent.numerator, exponent.denominator
    if not top:
        return RationalFunction.constant(ONE)
    if len(top) != 2 or top[1] or len(bottom) != 1 or exponent.delay:
        raise DomainError("the exponent of e must be a number times s; write exp(-L*s), or e^(-L*s) in parentheses")
    rate = top[0] * bottom[0].inverse()
    if rate.im:
        raise DomainError("the exponent of e must be a real number times s")
    return RationalFunction((ONE,), (ONE,), -rate.re)


def _exp(arguments: Sequence[Argument]) -> Value:
    if len(arguments) != 1 or not isinstance(arguments[0].value, RationalFunction):
        raise DomainError("takes one exponent; write exp(-L*s)")
    return exponential(arguments[0].value)


def _conv(arguments: Sequence[Argument]) -> Value:
    if len(arguments) != 2:
        raise DomainError("takes two lists; write conv([1 1], [1 2])")
    first, second = (each.list("a factor") for each in arguments)
    if not any(first) or not any(second):
        return Vector((RationalFunction(()),))
    found = multiplied(polynomial(first), polynomial(second))
    return Vector(tuple(RationalFunction.constant(value) for value in found))


def _tf(arguments: Sequence[Argument]) -> Value:
    given, delay = _split(arguments, most=2)
    if len(given) == 1 and isinstance(given[0].value, Text):
        return _variable(given[0].value.text)
    if len(given) == 1 and isinstance(given[0].value, RationalFunction):
        return given[0].value * delay
    if len(given) != 2:
        raise DomainError("takes a numerator and a denominator; write tf([4.39], [1 0.1746])")
    top, bottom = (
        polynomial(each.list(w)) for each, w in zip(given, ("the numerator", "the denominator"), strict=True)
    )
    return _ratio(top, bottom, delay)


def _zpk(arguments: Sequence[Argument]) -> Value:
    given, delay = _split(arguments, most=3)
    if len(given) == 1 and isinstance(given[0].value, Text):
        return _variable(given[0].value.text)
    if len(given) != 3:
        raise DomainError("takes zeros, poles and a gain; write zpk([], [-0.1746], 4.39)")
    zeros, poles = (_product(each.list(w)) for each, w in zip(given, ("zeros", "poles"), strict=False))
    gain = polynomial([given[2].number("the gain")])
    return _ratio(multiplied(gain, zeros), poles, delay)


def _variable(name: str) -> RationalFunction:
    if name not in ("s", "p"):
        raise DomainError(f"{quoted(name)} is not s; {_DISCRETE if name in ('z', 'q', 'z^-1') else 'write tf(…) of s'}")
    return RationalFunction((ONE, ZERO))


def _split(arguments: Sequence[Argument], most: int) -> tuple[list[Argument], RationalFunction]:
    """Arguments without a name, and the dead time of the others; one more than `most` is a sample time."""
    delay, given = RationalFunction.constant(ONE), [each for each in arguments if not each.name]
    for each in arguments:
        if each.name.lower() in DELAYS:
            delay = delay * each.as_delay()
        elif each.name.lower() in ("ts", "dt"):
            _refuse_sample_time(each)
        elif each.name:
            raise DomainError(f"{quoted(each.name)} is no option that is understood; InputDelay and IODelay are")
    if len(given) == most + 1:
        _refuse_sample_time(given.pop())
    return given, delay


def _refuse_sample_time(given: Argument) -> None:
    if given.number("the sample time"):
        raise DomainError(_DISCRETE)


def _ratio(top: Polynomial, bottom: Polynomial, delay: RationalFunction) -> RationalFunction:
    if not bottom:
        raise DomainError("the denominator is 0")
    return RationalFunction(top) * RationalFunction(bottom).inverse() * delay


def _product(roots: Sequence[Exact]) -> Polynomial:
    """(s - r1)(s - r2)…"""
    found: Polynomial = (ONE,)
    for root in roots:
        found = multiplied(found, (ONE, -root))
    for value in found:
        if value.im:
            raise DomainError("complex zeros or poles must come in conjugate pairs, such as -1+2i with -1-2i")
    return found


#: name -> value of its arguments
FUNCTIONS: Mapping[str, Callable[[Sequence[Argument]], Value]] = {
    "tf": _tf,
    "TransferFunction": _tf,
    "zpk": _zpk,
    "conv": _conv,
    "exp": _exp,
}
