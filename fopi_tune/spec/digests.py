"""Digests of a spec's parts, with defaults filled in:  a part that changes invalidates what depends on it, no more.

Comments, descriptions, the order of keys and how numbers are written change no digest.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from enum import Enum
from fractions import Fraction
from typing import Any

from fopi_tune.core.controller import DERIVATIVE_NAMES, ORDER_NAME
from fopi_tune.core.families.plant_list import PlantList, PlantMember
from fopi_tune.spec.default_objective import with_default_objective
from fopi_tune.spec.model import ControllerSpec, DesignSpec, DigitalSpec, Objective, Requirement
from fopi_tune.spec.scenarios import designed_scenarios

#: parts that gains and their proof depend on, and the digital controller besides
DESIGN_PARTS = ("plant", "controller", "requirements", "objective", "loop")
DIGITAL_PARTS = (*DESIGN_PARTS, "digital")
#: parts that evidence from drawn plants depends on; how they were drawn it says itself
EVIDENCE_PARTS = (*DIGITAL_PARTS, "scenarios")
#: fields that say where something is written, or are for people
_LEFT_OUT = ("line", "measurement_unit", "output_unit", "table", "source_files")
#: fields of the section `digital` that the loop of the requirements does not depend on
_BESIDE_LOOP = ("output_limits", "output_rate_per_s", "measurement_unit", "output_unit")


def digests_of(spec: DesignSpec) -> dict[str, str]:
    """SHA-256 of each part of a spec: plant, controller, requirements, objective, loop, digital, scenarios.

    `loop` is the one that the requirements are about: the continuous one, or that on samples with its controller.
    """
    spec = with_default_objective(spec)
    loop: Any = "continuous"
    if spec.sampled_design is not None:
        loop = {name: value for name, value in _plain(spec.sampled_design).items() if name not in _BESIDE_LOOP}
    requirements: Any = spec.requirements
    weight = spec.controller.setpoint_weight
    # as b = 1 is the default, specs without a weight have the digest they always had
    digital = spec.digital if weight == 1.0 else (spec.digital, weight)
    if spec.designs_scenarios:
        # gains that are designed for scenarios depend on these, and on the limits of the control
        requirements, loop = (requirements, spec.scenario_requirements, designed_scenarios(spec)), digital
    parts = {
        "plant": spec.plant,
        "controller": spec.controller,
        "requirements": requirements,
        "objective": spec.objective,
        "loop": loop,
        "digital": digital,
        "scenarios": (spec.scenarios, spec.judged_limits),
    }
    return {name: _digest(part) for name, part in parts.items()}


def content_digest(spec: DesignSpec) -> str:
    """SHA-256 of everything that a spec says, but for what is only for people."""
    said = (spec.name, digests_of(spec), spec.validation)
    if not isinstance(spec.plant, PlantList):
        return _digest(said)
    # weights decide which plants are drawn, and nothing that is designed or proved
    return _digest((*said, [member.weight for member in spec.plant.members]))


def _digest(part: Any) -> str:
    return hashlib.sha256(json.dumps(_plain(part), sort_keys=True).encode()).hexdigest()


def is_of_spec(stamp: object, spec: DesignSpec, parts: tuple[str, ...] = DESIGN_PARTS) -> bool:
    """Whether a stored result depends on nothing that differs in this spec.

    Args:
        stamp: the result's JSON `stamp`; one without digests is of the spec with the same text only.
        spec: the spec.
        parts: those that the result depends on.
    """
    if not isinstance(stamp, Mapping):
        return False
    if stamp.get("spec_sha256") == spec.sha256 and spec.sha256:
        return True
    known, wanted = stamp.get("digests"), digests_of(spec)
    return isinstance(known, Mapping) and all(known.get(part) == wanted[part] for part in parts)


def _plain(value: Any) -> Any:
    """What JSON can hold; equal numbers are equal texts, infinite ones included."""
    if is_dataclass(value):
        names = [f.name for f in fields(value) if f.name not in _LEFT_OUT]
        if isinstance(value, Objective) and value.scenario is None:
            names.remove("scenario")
        if isinstance(value, Requirement) and value.end_limit is None:
            names.remove("end_limit")
        if isinstance(value, DigitalSpec) and value.output_rate_per_s is None:
            names.remove("output_rate_per_s")
        if isinstance(value, ControllerSpec):
            # the loop does not depend on the setpoint's weight: it belongs to the digital controller
            absent = ["setpoint_weight"] if value.has_derivative else ["setpoint_weight", *DERIVATIVE_NAMES]
            absent += [] if value.has_derivative_order else [ORDER_NAME]
            absent += [] if value.measurement_filter is not None else ["measurement_filter"]
            absent += [] if value.filter_times is not None else ["filter_times"]
            absent += [] if value.setpoint_weight_range is not None else ["setpoint_weight_range"]
            names = [name for name in names if name not in absent]
        if isinstance(value, PlantMember):
            names.remove("weight")
        return {name: _plain(getattr(value, name)) for name in names}
    if isinstance(value, Mapping):
        return {str(key): _plain(entry) for key, entry in value.items()}
    if isinstance(value, tuple | list):
        return [_plain(entry) for entry in value]
    if isinstance(value, Enum):
        return value.value
    if isinstance(value, Fraction):
        return str(value)
    return value if value is None or isinstance(value, str | bool) else repr(float(value))
