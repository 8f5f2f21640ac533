"""A plant with named parameters:  what its record has read -> `ParametricFamily`, or all that is wrong with it."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

from fopi_tune.core.parametric.family import ParametricFamily
from fopi_tune.core.parametric.polynomials import ParameterPolynomial
from fopi_tune.core.parametric.ranges import (
    Point,
    UndecidedError,
    cancellation,
    common_zero_inside,
    is_computable,
    negative_inside,
    zero_inside,
)
from fopi_tune.core.plant import Uncertain
from fopi_tune.errors import DomainError
from fopi_tune.spec.parametric.coefficients import Resolver, Written
from fopi_tune.spec.parametric.expressions import NAME_PATTERN, names_in
from fopi_tune.spec.parametric.rational import Rational, cleared, product
from fopi_tune.spec.yaml.nodes import MappingNode, Node, Place, ScalarNode, SequenceNode
from fopi_tune.spec.yaml.problems import key_path

#: eight of floating point's sixteen digits are left
_MOST_CANCELLATION = 1e8
#: keys of a plant that hold no expressions
_WORDS = ("model", "name", "weight", "parameters")


@dataclass(frozen=True)
class ParametricPlant:
    """What a plant's record has read: its parameters and everything that is written in them.

    Args:
        place: of the plant.
        parameters: those with a name.
        written: every coefficient, by the path under which a range of it is a parameter.
    """

    place: Place
    parameters: Mapping[str, Uncertain]
    written: Mapping[str, Written]

    def resolver(self) -> Resolver:
        """What makes rational functions; ranges without a name are parameters too, called by their path."""
        known = dict(self.parameters)
        for path, each in self.written.items():
            if each.number is None:
                continue
            if path in known:
                each.place.refuse(f"{path!r} is the name of a parameter; write it here, or give the parameter another")
            known[path] = each.number
        return Resolver(known)

    def refuse_unused(self) -> None:
        """Report parameters that no expression uses."""
        used = names_below(self.place.node)
        for name in self.parameters:
            if name not in used and re.fullmatch(NAME_PATTERN, name):
                place = self.place.child("parameters")
                assert isinstance(place.node, MappingNode)
                message = "is not used in the plant; use it in a coefficient or remove it"
                place.collector.add(place.node.entries[name][0], key_path(place.path, name), message)

    def rationals(self, resolver: Resolver) -> dict[str, Rational | None]:
        """Every coefficient, None where something is wrong with it."""
        return {
            path: resolver.parameter(path) if each.number is not None else resolver.rational(each)
            for path, each in self.written.items()
        }


def written_in(values: Mapping[str, Any]) -> dict[str, Written]:
    """Everything that is written, by its path in the plant."""
    return {path: each for name, value in values.items() for path, each in _entries(name, value)}


def _entries(path: str, value: Any) -> Iterator[tuple[str, Written]]:
    if isinstance(value, Written):
        yield path, value
    elif isinstance(value, Mapping):
        for key, each in value.items():
            yield from _entries(f"{path}.{key}", each)
    elif isinstance(value, list):
        for index, each in enumerate(value):
            yield from _entries(f"{path}[{index}]", each)


def _is_whole(value: Any) -> bool:
    """Whether nothing in it could not be read."""
    if isinstance(value, Mapping):
        return all(_is_whole(each) for each in value.values())
    return all(_is_whole(each) for each in value) if isinstance(value, list) else value is not None


def names_below(node: Node) -> set[str]:
    """The parameters that a plant or a part of it uses, or may use where it could not be read."""
    if isinstance(node, ScalarNode):
        return names_in(node.text)
    below = (
        [each for key, (_, each) in node.entries.items() if key not in _WORDS] if isinstance(node, MappingNode) else []
    )
    below += node.nodes if isinstance(node, SequenceNode) else []
    return set[str]().union(*(names_below(each) for each in below))


def family_of(
    place: Place,
    values: Mapping[str, Any],
    sides: Callable[[Mapping[str, Rational]], tuple[Any, Any]],
    positive: Sequence[str] = (),
) -> ParametricFamily | None:
    """The family, or None after reporting all that is wrong.

    Args:
        place: of the plant.
        values: as its record has read them.
        sides: the coefficients' rational functions by path to those of N and D in descending powers of s.
        positive: paths of numbers that must be greater than 0.
    """
    before = len(place.collector.problems)
    parameters = values.get("parameters") or {}
    plant = ParametricPlant(place, parameters, written_in({k: v for k, v in values.items() if k != "parameters"}))
    if place.has("parameters") and "parameters" in values:
        plant.refuse_unused()
    resolver = plant.resolver()
    rationals = plant.rationals(resolver)
    read = {path: each for path, each in rationals.items() if each is not None}
    delay = _dead_time(plant, resolver, read)
    for path in positive:
        if path in read and not _is_positive(read[path], resolver):
            plant.written[path].place.refuse("must be greater than 0 in all of the parameters' ranges")
    if len(place.collector.problems) > before or not _is_whole(values) or len(read) < len(rationals):
        return None
    try:
        top, bottom = cleared(*sides(read))
        return _checked(place, resolver, top, bottom, delay)
    except DomainError as error:
        place.refuse(f"a coefficient of the whole plant {error}" if str(error).startswith("has ") else str(error))
        return None


def _dead_time(plant: ParametricPlant, resolver: Resolver, read: Mapping[str, Rational]) -> ParameterPolynomial:
    zero = ParameterPolynomial.constant(len(resolver.axes), 0)
    found = read.get("dead_time_s")
    if found is None:
        return zero
    where, value = plant.written["dead_time_s"].place, found.numerator
    if found.divisors or (value.value is None and value.axis is None):
        where.refuse("must be a number, a range or one parameter; make the dead time a parameter of its own")
    elif negative_inside(value, resolver.box) is not None:
        where.refuse("must be at least 0; a plant cannot answer before it is asked")
    return value


def _is_positive(value: Rational, resolver: Resolver) -> bool:
    middle = [(low + high) / 2 for low, high in resolver.box]
    top, bottom = (each.at(middle, Fraction) for each in (value.numerator, product(value.divisors, value.axes)))
    try:
        return top * bottom > 0 and zero_inside(value.numerator, resolver.box) is None
    except UndecidedError:
        return False


def _checked(
    place: Place,
    resolver: Resolver,
    top: Sequence[ParameterPolynomial],
    bottom: Sequence[ParameterPolynomial],
    delay: ParameterPolynomial,
) -> ParametricFamily | None:
    def holds(question: Callable[[], Point | None], what: str, advice: str) -> bool:
        try:
            point = question()
        except UndecidedError:
            place.refuse(f"{what} may be 0 in the parameters' ranges; narrow them: {advice}")
            return False
        if point is not None:
            at = f", or changes its sign, with {resolver.named(point)}" if point else ""
            place.refuse(f"{what} is 0{at}; {advice}")
        return point is None

    box, known = resolver.box, {name: resolver.parameters[name] for name in resolver.parameters}
    family = ParametricFamily.of(known, top, bottom, delay)
    if not all(is_computable(each, box) for each in (*family.numerator, *family.denominator)):
        place.refuse("has coefficients that are too large to compute with; measure its parameters in other units")
        return None
    worst = max(cancellation(each, box) for each in (*family.numerator, *family.denominator))
    if worst > _MOST_CANCELLATION:
        place.refuse(
            f"has a coefficient whose terms, multiplied out, are {worst:.0e} times as large as it is: floating point "
            "loses it; measure a parameter from the middle of its range, so that the differences are small numbers"
        )
        return None
    leading = family.denominator[0]
    if not holds(lambda: zero_inside(leading, box), "the denominator's first coefficient", "its degree must be known"):
        return None
    advice = "no plant is left there; keep one coefficient away from 0"
    if not holds(lambda: common_zero_inside(family.numerator, box), "the whole numerator", advice):
        return None
    family.member(family.nominal_point)
    return family
