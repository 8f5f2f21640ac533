"""The spec language: the shape of a whole file, the rules between its sections, and the language as JSON Schema."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import lru_cache
from typing import Any

from fopi_tune.core.plant import PLANT_MODELS, PlantModel
from fopi_tune.spec.controllers import DEFAULT_CONTROLLER, controller_shape
from fopi_tune.spec.digital import digital_shape
from fopi_tune.spec.fractional_plants.refusals import refuse_for_fractional
from fopi_tune.spec.frequency_response.plants import resolve_responses, sha256_with_data
from fopi_tune.spec.frequency_response.refusals import refuse_for_measured
from fopi_tune.spec.lists.parameters import PARAMETERS, shared_parameters_shape, with_shared_parameters
from fopi_tune.spec.lists.plants import plants_shape, refuse_both_words, refuse_for_lists
from fopi_tune.spec.model import ControllerSpec, DesignSpec, GainRange, Sense
from fopi_tune.spec.plants import plant_shape
from fopi_tune.spec.requirements import (
    PlacedRequirement,
    objective_shape,
    refuse_bands_above_nyquist,
    refuse_contradictions,
    refuse_equalities_over_families,
    requirements_shape,
)
from fopi_tune.spec.scenarios import (
    PlacedLimit,
    check_scenario_design,
    limits_shape,
    refuse_accelerations,
    refuse_impossible_limits,
    refuse_too_many_samples,
    refuse_unknown_scenarios,
    scenarios_shape,
)
from fopi_tune.spec.validation import FileReader, PlacedValidation, resolve_validation, validation_shape
from fopi_tune.spec.yaml.hints import closest
from fopi_tune.spec.yaml.nodes import MappingNode, Place
from fopi_tune.spec.yaml.records import Key, Record, Values, refuse_foreign
from fopi_tune.spec.yaml.shapes import Text, Version

SCHEMA_VERSION = 1
NAME_PATTERN = "[A-Za-z0-9][A-Za-z0-9._-]{0,63}"
NAME_RULE = "a name becomes a folder's: write 1 to 64 letters, digits, '.', '_' or '-', the first a letter or digit"
_START = "`fopi init` writes one to start from"


def spec_shape() -> Record:
    """The shape of a whole file; reads to the sections' values."""
    return _shape_with(tuple(PLANT_MODELS.values()))


@lru_cache(2)
def _shape_with(_: tuple[PlantModel, ...]) -> Record:
    """The shape with these plant models, made once: a study reads thousands of specs."""
    keys = {
        "schema": Key(Version("version of the spec language", SCHEMA_VERSION)),
        "name": Key(Text("name of the design and of its results' folder", NAME_PATTERN, NAME_RULE)),
        "description": Key(Text("one sentence for people"), required=False),
        "plant": Key(plant_shape(), required=False),
        "plants": Key(plants_shape(), required=False),
        PARAMETERS: Key(shared_parameters_shape(), required=False),
        "controller": Key(controller_shape(), required=False),
        "requirements": Key(requirements_shape(), required=False),
        "objective": Key(objective_shape(), required=False),
        "digital": Key(digital_shape(), required=False),
        "validation": Key(validation_shape(), required=False),
        "scenarios": Key(scenarios_shape(), required=False),
        "limits": Key(limits_shape(), required=False),
    }
    something_to_do = {"required": ["requirements"], "properties": {"requirements": {"minItems": 1}}}
    rules = {
        "anyOf": [{"required": ["objective"]}, something_to_do],
        "oneOf": [{"required": ["plant"]}, {"required": ["plants"]}],
        "dependentRequired": {PARAMETERS: ["plants"]},
    }
    return Record("a design problem for fopi-tune", keys, lambda values, place: values, _START, rules=rules)


def read_spec(place: Place, sha256: str, read: FileReader) -> DesignSpec | None:
    """The spec that a document describes, or None after reporting its problems; `read` reads files that it names."""
    shape = spec_shape()
    if refuse_foreign(place, (*shape.keys, "system"), f"the file is no spec; {_START}"):
        return None
    if place.has("system"):
        takes = "`fopi tune`, `prove`, `discretize`, `simulate`, `validate` and `report` take systems"
        place.child("system").refuse(f"the file describes a system, where a spec is needed; {takes}")
        return None
    values = _read_sections(shape, place)
    if values is None:
        return None
    values["plant"] = resolve_responses(values.get("plant"), read)
    read_in = (each if isinstance(each, list) else [each] for each in values.get("requirements") or [])
    every = [each for some in read_in for each in some if each is not None]
    placed = [each for each in every if isinstance(each, PlacedRequirement)]
    measured = [each for each in every if isinstance(each, PlacedLimit)]
    _check_between_sections(values, placed, place)
    _check_scenarios(values, measured, place)
    values |= check_scenario_design(values, measured, place)
    _refuse_times_for_designed_scenarios(values, measured, place)
    _refuse_weight_that_nothing_decides(values, measured, place)
    if place.has("plants"):
        refuse_for_lists(values, measured, place)
    refuse_for_fractional(values, place)
    refuse_for_measured(values, placed, place)
    placed_validation: PlacedValidation | None = values.get("validation")
    # what is checked against the plant is refused beside a list of plants
    family = None if place.has("plants") else values.get("plant")
    validation = None if placed_validation is None else resolve_validation(placed_validation, family, read)
    if place.collector.problems:
        return None
    return DesignSpec(
        name=values["name"],
        plant=values["plant"],
        controller=values.get("controller", DEFAULT_CONTROLLER),
        requirements=tuple(each.requirement for each in placed),
        objective=values.get("objective"),
        digital=values.get("digital"),
        validation=validation,
        scenarios=tuple(values.get("scenarios") or ()),
        limits=tuple(each.limit for each in values.get("limits") or ()),
        scenario_requirements=tuple(each.limit for each in measured),
        description=values.get("description", ""),
        text_sha256=sha256_with_data(sha256, values["plant"]),
        schema=values["schema"],
    )


def _read_sections(shape: Record, place: Place) -> Values | None:
    """The sections' values, a list of plants in place of a plant; None where there is no mapping."""
    place = with_shared_parameters(place)
    both, keys = refuse_both_words(place), dict(shape.keys)
    del keys[PARAMETERS]
    if place.has("plant") and not place.has("plants"):
        del keys["plants"]
    elif place.has("plants") and not place.has("plant"):
        del keys["plant"]
    elif not both and not _means_plants(shape, place):
        # one of the two is needed, and the one without an s is what most specs have
        keys["plant"] = replace(keys["plant"], required=True)
    shape = replace(shape, keys=keys)
    values = shape.read_partial(place)
    if values is None or "plants" not in values:
        return values
    listed = values.pop("plants")
    return values | {"plant": None if both else listed}


def _means_plants(shape: Record, place: Place) -> bool:
    """Whether a misspelt key is probably `plants`."""
    entries = place.node.entries if isinstance(place.node, MappingNode) else {}
    return any(closest(key, tuple(shape.keys)) == "plants" for key in entries if key not in shape.keys)


def _check_between_sections(values: Values, placed: list[PlacedRequirement], place: Place) -> None:
    if not place.has("objective") and values.get("requirements", []) == []:
        where = place.child("requirements") if place.has("requirements") else place
        where.refuse("there is nothing to design for; write at least one requirement or an objective")
    if values.get("plant") is not None:
        refuse_equalities_over_families(placed, values["plant"])
    refuse_contradictions(placed)
    digital, controller = values.get("digital"), values.get("controller")
    if digital is not None and digital.designs_sampled:
        refuse_bands_above_nyquist(placed, math.pi / digital.sample_time_s)
        _refuse_times_below_half_a_sample(controller, digital.sample_time_s, place)
    objective = values.get("objective")
    if objective is None or controller is None or objective.sense is not Sense.MAXIMIZE:
        return
    gain = getattr(controller, objective.quantity, None)
    if isinstance(gain, GainRange) and gain.is_fixed:
        line = place.child("controller").child(objective.quantity).mark.line
        message = f"{objective.quantity} is fixed on line {line}; give it a range there or choose another objective"
        place.child("objective").child("maximize").refuse(message)


def _refuse_times_for_designed_scenarios(values: Values, measured: list[PlacedLimit], place: Place) -> None:
    """A filter whose time has a range beside a requirement or an objective about a scenario."""
    controller, objective = values.get("controller"), values.get("objective")
    times = None if controller is None else controller.filter_times
    if times is None or not (measured or (objective is not None and objective.scenario is not None)):
        return
    for name in times.ranges:
        _place_of_time(place, name).refuse(
            "a filter's time with a range is designed for requirements and objectives of the loop's frequencies; write "
            "one number, or write what scenarios have to meet under `limits:`, which is judged and not designed for"
        )


def _refuse_weight_that_nothing_decides(values: Values, measured: list[PlacedLimit], place: Place) -> None:
    """A range of the setpoint's weight where no requirement or objective is about a step of the setpoint."""
    controller, objective = values.get("controller"), values.get("objective")
    if controller is None or controller.setpoint_weight_range is None:
        return
    names = {each.limit.scenario for each in measured}
    names |= {objective.scenario} if objective is not None and objective.scenario is not None else set()
    asked = [each for each in values.get("scenarios") or () if names and (None in names or each.name in names)]
    if not any(knot.value != each.initial_output for each in asked for knot in each.reference):
        place.child("controller").child("setpoint_weight").refuse(
            "only what a scenario with a step or ramp of the setpoint measures decides it; add a requirement or an "
            "objective about one, or write one number"
        )


def _refuse_times_below_half_a_sample(controller: ControllerSpec | None, sample_time_s: float, place: Place) -> None:
    """Ranges of filters' times in which some have no filter on samples."""
    times = None if controller is None else controller.filter_times
    for name, (low, _) in ({} if times is None else times.ranges).items():
        if low < 0.5 * sample_time_s:
            _place_of_time(place, name).child("min").refuse(
                f"{low:g} s is below half the sample time, and such a filter rings on samples; write "
                f"{0.5 * sample_time_s:g} or more, or a shorter sample_time_s"
            )


def _place_of_time(place: Place, name: str) -> Place:
    """Where a filter's time is written."""
    where = place.child("controller")
    for key in name.split("."):
        where = where.child(key)
    return where


def _check_scenarios(values: Values, measured: list[PlacedLimit], place: Place) -> None:
    scenarios, limits, digital = values.get("scenarios"), values.get("limits"), values.get("digital")
    if (scenarios is None and place.has("scenarios")) or (limits is None and place.has("limits")):
        return  # reported already
    refuse_impossible_limits(measured)
    limits = [*measured, *(limits or [])]
    refuse_unknown_scenarios(scenarios or [], limits, place)
    if not scenarios:
        return
    if not place.has("digital"):
        message = "scenarios are simulated with the digital controller; add digital: {sample_time_s: 0.2}"
        place.child("scenarios").refuse(message)
    elif digital is not None:
        refuse_accelerations(limits, digital.measurement_unit)
        refuse_too_many_samples(scenarios, digital.sample_time_s, place)


def json_schema() -> dict[str, Any]:
    """The language as JSON Schema, draft 2020-12.

    It is generated from the shapes that read a spec and from the registries of plant models, quantities and objectives.
    Rules between several values or about the plant (min > max, contradictions, `equals` over a family) are not in the
    schema; only the tool checks them.
    """
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": f"fopi-tune spec, schema {SCHEMA_VERSION}",
    } | spec_shape().json_schema()
