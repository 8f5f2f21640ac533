"""The record of `model: fractional`:  lists of terms, each a coefficient and an exact order."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from fopi_tune.core.fractional_plants.family import FRACTIONAL, FractionalFamily
from fopi_tune.core.fractional_plants.orders import LEAST_DIFFERENCE, MOST_ORDER, MOST_TERMS
from fopi_tune.core.plant import Uncertain
from fopi_tune.errors import DomainError
from fopi_tune.spec.yaml.nodes import Place
from fopi_tune.spec.yaml.records import Key, Record, Values
from fopi_tune.spec.yaml.shapes import Constant, ListOf, Number, Shape

_EXAMPLE = (
    "{model: fractional, numerator: [{coefficient: 2, order: 0}], "
    "denominator: [{coefficient: 3, order: 0.5}, {coefficient: 1, order: 0}]}"
)
#: the coefficient and the order of a term
Term = tuple[Uncertain, float]
_SIDES = ("numerator", "denominator")


def fractional_record(dead_time: Shape, coefficient: Shape) -> Record:
    """The record of fractional plants.

    Args:
        dead_time: the shape of its number or range.
        coefficient: the same, of a term's coefficient.
    """
    order = Number("the power of s, exact; terms come in any order", at_least=0, at_most=MOST_ORDER)
    term = Record(
        "a term coefficient s^order",
        {"coefficient": Key(coefficient), "order": Key(order)},
        lambda values, place: (values["coefficient"], float(values["order"])),
        "{coefficient: 12.7, order: 0.5}",
    )
    keys: dict[str, Key] = {"model": Key(fractional_tag())}
    for name in _SIDES:
        keys[name] = Key(ListOf(f"terms of the {name}", term, 1, MOST_TERMS))
    keys["dead_time_s"] = Key(dead_time, False, 0.0)
    elsewhere = {
        "parameters": "coefficients of a fractional plant are numbers or ranges of their own in this version; leave "
        "parameters out"
    }
    return Record("the fractional plant model", keys, _build, _EXAMPLE, elsewhere)


def fractional_tag() -> Constant:
    """The shape of its word after `model:`."""
    return Constant("how the plant is written down", FRACTIONAL)


def _build(values: Values, place: Place) -> FractionalFamily | None:
    sides: dict[str, Sequence[Term]] = {name: values[name] for name in _SIDES}
    dead_time = values.get("dead_time_s", Uncertain.exactly(0.0))
    before = len(place.collector.problems)
    for name, side in sides.items():
        _refuse_equal_orders(side, place.child(name))
    _refuse_improper(sides, place)
    if dead_time.min < 0:
        place.child("dead_time_s").refuse("must be at least 0; a plant cannot answer before it is asked")
    if len(place.collector.problems) > before:
        return None
    family = FractionalFamily.of(sides["numerator"], sides["denominator"], dead_time)
    try:
        family.member(family.nominal_point)
    except DomainError as error:
        place.refuse(str(error))
        return None
    return family


def _refuse_equal_orders(side: Sequence[Term], place: Place) -> None:
    for k, (_, order) in enumerate(side):
        near = [i for i in range(k) if abs(side[i][1] - order) < LEAST_DIFFERENCE]
        if not near:
            continue
        other = place.item(near[0]).child("order")
        same = "is" if side[near[0]][1] == order else f"is within {LEAST_DIFFERENCE:g} of"
        message = f"order {order:g} {same} that of the term on line {other.mark.line}; write one term for the two"
        place.item(k).child("order").refuse(message)


def _refuse_improper(sides: Mapping[str, Sequence[Term]], place: Place) -> None:
    top, bottom = (max(range(len(side)), key=lambda k: side[k][1]) for side in sides.values())
    highest = sides["numerator"][top][1], sides["denominator"][bottom][1]
    if highest[0] > highest[1]:
        place.child("numerator").item(top).child("order").refuse(
            f"order {highest[0]:g} exceeds the denominator's highest, {highest[1]:g}; a plant must be proper"
        )
    leading = sides["denominator"][bottom][0]
    if leading.min <= 0.0 <= leading.max:
        place.child("denominator").item(bottom).child("coefficient").refuse(
            "must not be or contain 0: it is that of the highest order; the family's sign must be known"
        )
    lowest = min(min(order for _, order in side) for side in sides.values())
    if all(min(order for _, order in side) > 0.0 for side in sides.values()):
        place.child("numerator").refuse(
            f"every term of numerator and denominator has the factor s^{lowest:g}; leave it out of all of them"
        )
    if all(number.min <= 0.0 <= number.max for number, _ in sides["numerator"]):
        place.child("numerator").refuse("can be 0 altogether, and no plant is left; keep one coefficient away from 0")


def refuse_in_list(record: Record) -> Record:
    """The record in a list of plants, which refuses it."""

    def build(values: Values, place: Place) -> Any:
        place.child("model").refuse(
            "fractional plants in a list of plants are not available in this version: they have no common polynomials "
            "with the other plants; write plant: with one of them"
        )

    return Record(record.meaning, record.keys, build, record.example, record.elsewhere, record.rules)
