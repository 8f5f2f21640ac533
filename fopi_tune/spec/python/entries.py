"""A spec that was changed in Python to the entries of its text:  what was changed is written anew, the rest as it was.

Sections are those of YAML.  Comments of what is written anew are not kept, as they may be about what was there before.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, fields
from typing import Any

from fopi_tune.core.plant import PLANT_MODELS, PlantFamily, Uncertain
from fopi_tune.core.terms.controller_spec import ControllerSpec, GainRange
from fopi_tune.errors import DomainError
from fopi_tune.quantities.requirement import Relation, Requirement, Scope
from fopi_tune.spec.python.mapping import read_entries, yaml_of

#: fields of a spec, and the section that has them
_SECTIONS: Mapping[str, tuple[str, ...]] = {
    "name": ("name",),
    "description": ("description",),
    "plant": ("plant",),
    "controller": ("controller",),
    "requirements": ("requirements", "scenario_requirements"),
    "objective": ("objective",),
    "digital": ("digital",),
    "validation": ("validation",),
    "scenarios": ("scenarios",),
    "limits": ("limits",),
}
_REFUSED = "{} was changed in Python, and there are no words for it here; write the spec with ft.spec(...)"


def text_of_changed(spec: Any, before: Any) -> str:
    """The text of a spec, in YAML.

    Args:
        spec: a `DesignSpec`.
        before: as it was read; None where it was not, and everything is written anew.

    Raises:
        DomainError: as `entries_of`.
    """
    return yaml_of(entries_of(spec, before, {} if before is None else read_entries(before.source)))


def entries_of(spec: Any, before: Any, text: Mapping[str, Any]) -> dict[str, Any]:
    """The entries of a spec.

    Args:
        spec: a `DesignSpec`.
        before: as it was read; None where it was not, and everything is written anew.
        text: the entries that were read.

    Raises:
        DomainError: what was changed has no words here, such as measured plants; says which section.
    """
    found: dict[str, Any] = {}
    for section, names in _SECTIONS.items():
        if before is not None and all(getattr(spec, name) == getattr(before, name) for name in names):
            # a list of plants stands in a section of its own
            found |= {key: text[key] for key in (section, "plants" if section == "plant" else section) if key in text}
            continue
        written = _WRITERS[section](spec)
        if written not in (None, "", []):
            found[section] = written
    return found


def _plant(spec: Any) -> dict[str, Any]:
    family = spec.plant
    if type(family) is not PlantFamily or family.model not in PLANT_MODELS:
        raise DomainError(_REFUSED.format(f"the plant, of model {family.model},"))
    found: dict[str, Any] = {"model": family.model}
    for name, number in family.parameters.items():
        key, is_entry, _ = name.partition("[")
        if is_entry:
            found.setdefault(key, []).append(_number(number))
        else:
            found[key] = _number(number)
    return found


def _number(number: Uncertain) -> float | dict[str, float]:
    return number.nominal if number.is_exact else asdict(number)


def _range(gain: GainRange) -> float | dict[str, float]:
    if gain.is_fixed:
        return gain.min
    return {name: end for name, end in (("min", gain.min), ("max", gain.max)) if math.isfinite(end)}


def _controller(spec: Any) -> dict[str, Any]:
    box: ControllerSpec = spec.controller
    if box.filter_times is not None:
        raise DomainError(_REFUSED.format("the controller, whose filters' times are ranges,"))
    found: dict[str, Any] = {"structure": box.structure}
    found |= {name: _range(gain) for name, gain in box.ranges.items()}
    if box.has_derivative:
        found["derivative_filter_time_constant_s"] = box.derivative_filter_time_constant_s
    if box.measurement_filter is not None:
        used = box.measurement_filter
        found["measurement_filter"] = {"order": used.order, "time_constant_s": used.time_constant_s}
    if box.setpoint_weight != 1.0:
        found["setpoint_weight"] = box.setpoint_weight
    return found


def _requirements(spec: Any) -> list[dict[str, Any]]:
    return [*_of_responses(spec.requirements), *(_limit(each) for each in spec.scenario_requirements)]


def _of_responses(requirements: Sequence[Requirement]) -> Iterator[dict[str, Any]]:
    for each in requirements:
        limit: Any = list(each.limits) if each.relation is Relation.BETWEEN else each.limits[0]
        band: dict[str, float] = {}
        if each.end_limit is not None:
            limit = {"by_frequency": [[each.from_rad_s, each.limits[0]], [each.to_rad_s, each.end_limit]]}
        elif each.from_rad_s == each.to_rad_s:
            band = {"at_rad_s": each.from_rad_s}
        else:
            band = {"from_rad_s": each.from_rad_s} if each.from_rad_s else {}
            band |= {"to_rad_s": each.to_rad_s} if math.isfinite(each.to_rad_s) else {}
        scope = {} if each.scope is Scope.FAMILY else {"on": each.scope.value}
        yield {each.quantity: {each.relation.value: limit}, **scope, **band}


def _limit(limit: Any) -> dict[str, Any]:
    scenario = {} if limit.scenario is None else {"scenario": limit.scenario}
    return {limit.measure: {limit.relation.value: limit.limit}, **scenario}


def _objective(spec: Any) -> dict[str, Any] | None:
    aim = spec.objective
    if aim is None:
        return None
    more = {name: value for name in ("horizon_s", "scenario") if (value := getattr(aim, name)) is not None}
    return {aim.sense.value: aim.quantity, **more}


def _given(record: Any) -> dict[str, Any]:
    """The fields of a record that are not at their defaults, as entries."""
    return {
        each.name: getattr(record, each.name) for each in fields(record) if getattr(record, each.name) != each.default
    }


def _digital(spec: Any) -> dict[str, Any] | None:
    return None if spec.digital is None else _given(spec.digital)


def _validation(spec: Any) -> dict[str, Any] | None:
    found = spec.validation
    if found is None:
        return None
    if found.samples_file is not None:
        raise DomainError(_REFUSED.format("validation, whose plants are in a file,"))
    entries: dict[str, Any] = {name: getattr(found, name) for name in ("samples", "seed", "design", "confidence")}
    if found.distributions:
        entries["distributions"] = {name: each.words() for name, each in found.distributions.items()}
    if found.correlations:
        entries["correlations"] = [
            {"numbers": list(each.numbers), "coefficient": each.coefficient} for each in found.correlations
        ]
    return entries


def _scenarios(spec: Any) -> list[dict[str, Any]]:
    return [_scenario(each) for each in spec.scenarios]


def _scenario(scenario: Any) -> dict[str, Any]:
    found = _given(scenario)
    for name in ("reference", "load"):
        if name in found:
            found[name] = [_given(knot) for knot in found[name]]
    if "bumpless" in found:
        found["bumpless"] = "yes"
    return found


_WRITERS = {
    "name": lambda spec: spec.name,
    "description": lambda spec: spec.description,
    "plant": _plant,
    "controller": _controller,
    "requirements": _requirements,
    "objective": _objective,
    "digital": _digital,
    "validation": _validation,
    "scenarios": _scenarios,
    "limits": lambda spec: [_limit(each) for each in spec.limits],
}
