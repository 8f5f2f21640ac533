"""The plants of a certificate as JSON:  PlantFamily <-> dictionary.

Of a family by parameters the coefficients are lists of terms, each a rational number and the parameters' powers; of a
fractional family the orders are said beside them.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from fractions import Fraction
from typing import Any

from fopi_tune.core.fractional_plants.family import FRACTIONAL, FractionalFamily
from fopi_tune.core.parametric.family import EXPRESSIONS, ParametricFamily
from fopi_tune.core.parametric.polynomials import MOST_DEGREE, ParameterPolynomial
from fopi_tune.core.parametric.ranges import UndecidedError, box_of, common_zero_inside, zero_inside
from fopi_tune.core.plant import PLANT_MODELS, PlantFamily, Uncertain
from fopi_tune.errors import CertificateError, DomainError
from fopi_tune.proof.strict_json import JsonObject

#: of a numerator or denominator in digits; the spec language allows fewer
_RATIONAL = re.compile(r"-?[0-9]{1,2500}(?:/[1-9][0-9]{0,2499})?")
_SIDES = ("numerator", "denominator")


def plant_entry(family: PlantFamily) -> dict[str, Any]:
    """The family's JSON."""
    entry: dict[str, Any] = {
        "model": family.model,
        "parameters": [{"name": name, **asdict(value)} for name, value in family.parameters.items()],
    }
    if isinstance(family, FractionalFamily):
        entry |= {"numerator_orders": list(family.numerator_orders)}
        entry |= {"denominator_orders": list(family.denominator_orders)}
    if isinstance(family, ParametricFamily):
        sides = {"numerator": family.numerator, "denominator": family.denominator}
        entry |= {name: [{"terms": _terms(each)} for each in side] for name, side in sides.items()}
        entry["dead_time_s"] = {"terms": _terms(family.dead_time_s)}
    return entry


def _terms(polynomial: ParameterPolynomial) -> list[dict[str, Any]]:
    return [{"coefficient": str(value), "powers": list(powers)} for powers, value in polynomial.terms]


def read_family(plant: JsonObject) -> PlantFamily:
    """The family of an entry.

    Raises:
        CertificateError: it is none.
        DomainError: a number of it is out of its range.
    """
    name = plant.text("model")
    if name == EXPRESSIONS:
        return _parametric(plant)
    if name == FRACTIONAL:
        return _fractional(plant)
    model = PLANT_MODELS.get(name)
    if model is None:
        raise CertificateError(f"{plant.place}.model is none of {', '.join((*PLANT_MODELS, EXPRESSIONS, FRACTIONAL))}")
    parameters = _parameters(plant)
    for k, (key, number) in enumerate(parameters.items()):
        if (wrong := model.check(key, number)) is not None:
            raise CertificateError(f"{plant.at('parameters')}[{k}]: {key} {wrong}")
    lists = {name: [key for key in parameters if key.partition("[")[0] == name] for name in model.lists}
    expected = [f"{name}[{k}]" for name, keys in lists.items() for k in range(len(keys))] + list(model.scalars)
    if list(parameters) != expected or not all(lists.values()):
        raise CertificateError(f"{plant.place}.parameters are not those of model {model.name}")
    family = PlantFamily(model.name, parameters)
    family.member(family.nominal_point)
    return family


def _parameters(plant: JsonObject) -> dict[str, Uncertain]:
    found: dict[str, Uncertain] = {}
    for entry in plant.children("parameters"):
        name = entry.text("name")
        if name in found:
            raise CertificateError(f"{entry.place}: {name} appears twice")
        found[name] = Uncertain(entry.number("nominal"), entry.number("min"), entry.number("max"))
    return found


def _fractional(plant: JsonObject) -> FractionalFamily:
    orders = [tuple(plant.numbers(f"{name}_orders")) for name in _SIDES]
    try:
        family = FractionalFamily(FRACTIONAL, _parameters(plant), *orders)
    except DomainError as error:
        raise CertificateError(f"{plant.place} is no fractional family: {error}") from None
    for k, (key, number) in enumerate(family.parameters.items()):
        if (wrong := family.problem(key, number)) is not None:
            raise CertificateError(f"{plant.at('parameters')}[{k}]: {key} {wrong}")
    family.member(family.nominal_point)
    return family


def _parametric(plant: JsonObject) -> ParametricFamily:
    parameters = _parameters(plant)
    axes = sum(not number.is_exact for number in parameters.values())
    top, bottom = ([_polynomial(each, axes) for each in plant.children(name)] for name in _SIDES)
    family = ParametricFamily(
        EXPRESSIONS, parameters, tuple(top), tuple(bottom), _polynomial(plant.child("dead_time_s"), axes)
    )
    box = box_of(family.low.tolist(), family.high.tolist())
    try:
        wrong = zero_inside(family.denominator[0], box) or common_zero_inside(family.numerator, box)
    except UndecidedError:
        wrong = ()
    if wrong is not None or family.dead_time.min < 0.0:
        raise CertificateError(f"{plant.place} is not one family: its degree, its gain or its dead time may be lost")
    family.member(family.nominal_point)
    return family


def _polynomial(entry: JsonObject, axes: int) -> ParameterPolynomial:
    terms: dict[tuple[int, ...], Fraction] = {}
    for term in entry.children("terms"):
        text, powers = term.text("coefficient"), term.numbers("powers")
        whole = all(power == int(power) and 0 <= power <= MOST_DEGREE for power in powers)
        if _RATIONAL.fullmatch(text) is None or len(powers) != axes or not whole:
            raise CertificateError(f"{term.place} is no term of a polynomial in {axes} parameters")
        key = tuple(int(power) for power in powers)
        if key in terms:
            raise CertificateError(f"{term.place}: the same powers appear twice")
        terms[key] = Fraction(text)
    return ParameterPolynomial.of(axes, terms)


def same_plants(one: PlantFamily, other: PlantFamily) -> bool:
    """Whether two families are the same, name by name."""
    if one.model != other.model or dict(one.parameters) != dict(other.parameters):
        return False
    if isinstance(one, FractionalFamily) and isinstance(other, FractionalFamily) and not _same_orders(one, other):
        return False
    return one.uncertain_names == other.uncertain_names and _sides(one) == _sides(other)


def _same_orders(one: FractionalFamily, other: FractionalFamily) -> bool:
    return (one.numerator_orders, one.denominator_orders) == (other.numerator_orders, other.denominator_orders)


def _sides(family: PlantFamily) -> Mapping[str, Sequence[ParameterPolynomial]]:
    if not isinstance(family, ParametricFamily):
        return {}
    return {"top": family.numerator, "bottom": family.denominator, "late": (family.dead_time_s,)}
