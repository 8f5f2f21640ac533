"""The whole language: the shape of a spec file, and the rules between its sections."""

from __future__ import annotations

import math

from fopi_tune.spec.controllers import DEFAULT_CONTROLLER, controller_shape
from fopi_tune.spec.draws import PlacedValidation, Reader, resolved, validation_shape
from fopi_tune.spec.model import DesignSpec, DigitalSpec, GainRange, Sense
from fopi_tune.spec.plants import plant_shape
from fopi_tune.spec.requirements import (
    PlacedRequirement,
    objective_shape,
    refuse_bands_beyond,
    refuse_contradictions,
    refuse_equalities_over_families,
    requirements_shape,
)
from fopi_tune.spec.scenarios import limits_shape, refuse_too_many_samples, refuse_unknown_scenarios, scenarios_shape
from fopi_tune.spec.yaml.nodes import Table
from fopi_tune.spec.yaml.places import Place
from fopi_tune.spec.yaml.records import Key, Record, Values, defaulting_to
from fopi_tune.spec.yaml.shapes import Choice, Number, Pair, Shape, Text, Version

SCHEMA_VERSION = 1
NAME_PATTERN = "[A-Za-z0-9][A-Za-z0-9._-]{0,63}"
NAME_RULE = "a name becomes a folder's: write 1 to 64 letters, digits, '.', '_' or '-', the first a letter or digit"
_METHODS = ("oustaloup", "modified_oustaloup", "fit")
_RULES = ("tustin", "matched")
_PREWARPS = ("none", "crossover")
_DESIGNS = ("continuous", "sampled")
_START = "`fopi init` writes one to start from"


def spec_shape() -> Record:
    """The shape of a whole file; reads to the sections' values."""
    keys = {
        "schema": Key(Version("version of the spec language", SCHEMA_VERSION)),
        "name": Key(Text("name of the design and of its results' folder", NAME_PATTERN, NAME_RULE)),
        "description": Key(Text("one sentence for people"), required=False),
        "plant": Key(plant_shape()),
        "controller": Key(controller_shape(), required=False),
        "requirements": Key(requirements_shape(), required=False),
        "objective": Key(objective_shape(), required=False),
        "digital": Key(_digital_shape(), required=False),
        "validation": Key(validation_shape(), required=False),
        "scenarios": Key(scenarios_shape(), required=False),
        "limits": Key(limits_shape(), required=False),
    }
    something_to_do = {"required": ["requirements"], "properties": {"requirements": {"minItems": 1}}}
    rules = {"anyOf": [{"required": ["objective"]}, something_to_do]}
    return Record("a design problem for fopi-tune", keys, lambda values, place: values, _START, rules=rules)


def read_spec(place: Place, sha256: str, read: Reader) -> DesignSpec | None:
    """The spec a document says, or None after reporting why there is none; `read` gives the files that it names."""
    if not isinstance(place.node, Table):
        place.refuse(f"the file is no spec; {_START}")
        return None
    if place.has("system"):
        message = "the file describes a system; `fopi simulate` and `fopi validate` take it, the others its two specs"
        place.child("system").refuse(message)
        return None
    values = spec_shape().readable(place)
    if values is None:
        return None
    placed = [each for each in values.get("requirements") or [] if each is not None]
    _check_between_sections(values, placed, place)
    drawn: PlacedValidation | None = values.get("validation")
    validation = None if drawn is None else resolved(drawn, values.get("plant"), read)
    if place.report.problems:
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
        description=values.get("description", ""),
        sha256=sha256,
        schema=values["schema"],
    )


def _check_between_sections(values: Values, placed: list[PlacedRequirement], place: Place) -> None:
    if not place.has("objective") and values.get("requirements", []) == []:
        where = place.child("requirements") if place.has("requirements") else place
        where.refuse("there is nothing to design for; write at least one requirement or an objective")
    if values.get("plant") is not None:
        refuse_equalities_over_families(placed, values["plant"])
    refuse_contradictions(placed)
    _check_scenarios(values, place)
    digital = values.get("digital")
    if digital is not None and digital.designs_sampled:
        refuse_bands_beyond(placed, math.pi / digital.sample_time_s)
    objective, controller = values.get("objective"), values.get("controller")
    if objective is None or controller is None or objective.sense is not Sense.MAXIMIZE:
        return
    gain = getattr(controller, objective.quantity, None)
    if isinstance(gain, GainRange) and gain.is_fixed:
        line = place.child("controller").child(objective.quantity).mark.line
        message = f"{objective.quantity} is fixed on line {line}; give it a range there or choose another objective"
        place.child("objective").child("maximize").refuse(message)


def _check_scenarios(values: Values, place: Place) -> None:
    scenarios, limits, digital = values.get("scenarios"), values.get("limits"), values.get("digital")
    if (scenarios is None and place.has("scenarios")) or (limits is None and place.has("limits")):
        return  # reported already
    refuse_unknown_scenarios(scenarios or [], limits or [], place)
    if not scenarios:
        return
    if not place.has("digital"):
        message = "scenarios are simulated with the digital controller; add digital: {sample_time_s: 0.2}"
        place.child("scenarios").refuse(message)
    elif digital is not None:
        refuse_too_many_samples(scenarios, digital.sample_time_s, place)


def _digital_shape() -> Shape:
    said = "band of the approximation, rad/s: the gain crossover and two decades below it should lie inside"
    band = Pair(f"{said}; the default suits crossovers from 0.1 to 1000 rad/s", Number("rad/s", above=0))
    keys = {
        "sample_time_s": Key(Number("sampling period, s", above=0)),
        "method": Key(Choice("approximation of s^(1-alpha)", _METHODS), required=False),
        "poles": Key(Number("number of its poles", at_least=1, at_most=50, whole=True), required=False),
        "band_rad_s": Key(band, required=False),
        "rule": Key(Choice("from s to z", _RULES), required=False),
        "delay_samples": Key(Number("computing delay in samples", at_least=0), required=False),
        "prewarp": Key(Choice("where Tustin's rule is exact", _PREWARPS), required=False),
        "design": Key(Choice("which loop the requirements are about", _DESIGNS), required=False),
        "output_limits": Key(Pair("limits of the control, in its unit", Number("limit")), required=False),
        "measurement_unit": Key(Text("unit of setpoint and measurement, for people"), required=False),
        "output_unit": Key(Text("unit of the control, for people"), required=False),
    }
    prewarps = {"properties": {"prewarp": {"const": "crossover"}}, "required": ["prewarp"]}
    by_tustin = {"properties": {"rule": {"const": "tustin"}, "method": {"enum": [m for m in _METHODS if m != "fit"]}}}
    rules = {"if": prewarps, "then": by_tustin}
    keys = defaulting_to(DigitalSpec, keys)
    return Record("how the gains become a filter", keys, _build_digital, "{sample_time_s: 0.2}", rules=rules)


def _build_digital(values: Values, place: Place) -> DigitalSpec | None:
    found = DigitalSpec(**values)
    if found.prewarp != "none" and (found.rule != "tustin" or found.method == "fit"):
        used = f"method {found.method}" if found.method == "fit" else f"rule {found.rule}"
        place.child("prewarp").refuse(f"prewarping belongs to rule tustin, and {used} does not use it; leave it out")
        return None
    return found
