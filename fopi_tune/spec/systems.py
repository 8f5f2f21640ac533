"""The shape of a system file:  two specs whose loops take turns, and their scenarios; the same as JSON Schema."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

from fopi_tune.core.controller import ALPHA_MAX, ALPHA_MIN, FoPi
from fopi_tune.core.families.plant_list import PlantList
from fopi_tune.core.fractional_plants.family import is_fractional
from fopi_tune.core.measured.family import MeasuredFamily
from fopi_tune.core.plant import JointFamily, Uncertain
from fopi_tune.errors import DomainError, SpecError
from fopi_tune.quantities import QUANTITIES
from fopi_tune.spec.language import NAME_PATTERN, NAME_RULE, SCHEMA_VERSION
from fopi_tune.spec.measure_words import measure_as_requirement
from fopi_tune.spec.measures import ACCELERATION, DESIGNED_MEASURES, acceleration_problem, velocity_unit
from fopi_tune.spec.model import DesignSpec, ModeSpec, Objective, Sense, SystemSpec
from fopi_tune.spec.scenarios import (
    QUANTUM,
    PlacedLimit,
    limit_records,
    limits_shape,
    refuse_accelerations,
    refuse_impossible_limits,
    refuse_too_many_samples,
    refuse_unknown_scenarios,
    scenarios_shape,
    with_scenario,
)
from fopi_tune.spec.validation import FileReader, PlacedValidation, resolve_validation, validation_shape
from fopi_tune.spec.yaml.hints import one_of
from fopi_tune.spec.yaml.nodes import MappingNode, Node, Place
from fopi_tune.spec.yaml.problems import quoted
from fopi_tune.spec.yaml.records import Key, OneKeyOf, Record, Values, with_defaults_of
from fopi_tune.spec.yaml.shapes import Choice, ListOf, Number, Pair, Shape, Text, Version

#: the key that distinguishes a system from a spec
SYSTEM = "system"
MODES = ("throttle", "brake")
_INACTIVE = ("held", "tracking", "reset")
_LIMIT = "{acceleration_m_s2: {at_most: 2}}"
_EXAMPLE = "{throttle: {spec: throttle.yaml}, brake: {spec: brake.yaml}, hysteresis: 0.5}"

#: path as it is written in the system file -> the spec there
SpecLoader = Callable[[str], DesignSpec]


def is_system(place: Place) -> bool:
    """Whether a document describes a system."""
    return place.has(SYSTEM)


def system_shape() -> Record:
    """The shape of a whole file; reads to the sections' values."""
    keys = {
        "schema": Key(Version("version of the language", SCHEMA_VERSION)),
        "name": Key(Text("name of the system and of its results' folder", NAME_PATTERN, NAME_RULE)),
        "description": Key(Text("one sentence for people"), required=False),
        SYSTEM: Key(_modes_shape()),
        "scenarios": Key(scenarios_shape()),
        "limits": Key(limits_shape(), required=False),
        "requirements": Key(_requirements_shape(), required=False),
        "objective": Key(_objective_shape(), required=False),
        "tune": Key(ListOf("modes whose gains are designed", Choice("a mode", MODES), 1, 2), required=False),
        "validation": Key(validation_shape(MODES), required=False),
    }
    return Record("two loops that share their output and take turns", keys, lambda values, place: values, _EXAMPLE)


def read_system(place: Place, sha256: str, loader: SpecLoader, read: FileReader) -> SystemSpec | None:
    """The system that a document describes, or None after reporting its problems.

    Args:
        place: the document.
        sha256: of its bytes.
        loader: reads the specs that it names.
        read: reads the file of samples that it names.
    """
    assert isinstance(place.node, MappingNode)
    values = system_shape().read_partial(place)
    if values is None:
        return None
    requirements: list[PlacedLimit] = values.get("requirements") or []
    limits = [*requirements, *(values.get("limits") or [])]
    refuse_impossible_limits([each for each in requirements if each is not None])
    refuse_unknown_scenarios(values.get("scenarios") or [], limits, place)
    objective = _checked_objective(values, requirements, place)
    modes_section = values.get(SYSTEM)
    if modes_section is None or place.collector.problems:
        return None
    modes = [_read_mode(name, modes_section[name], place.child(SYSTEM).child(name), loader) for name in MODES]
    throttle, brake = modes
    if throttle is None or brake is None or not _check_same_timing(throttle, brake, values, place):
        return None
    placed: PlacedValidation | None = values.get("validation")
    _refuse_what_is_not_shared(throttle, brake, modes_section, place.child(SYSTEM))
    if place.collector.problems:
        return None
    shared = tuple(dict.fromkeys(modes_section.get("shared") or ()))
    family = JointFamily.of({mode.name: mode.spec.plant for mode in (throttle, brake)}, shared)
    validation = None if placed is None else resolve_validation(placed, family, read)
    plain = {key: value for key, value in modes_section.items() if key not in (*MODES, "shared")}
    system = SystemSpec(
        name=values["name"],
        modes=(throttle, brake),
        **plain,
        shared=shared,
        scenarios=tuple(values["scenarios"]),
        limits=tuple(each.limit for each in values.get("limits") or ()),
        validation=validation,
        description=values.get("description", ""),
        sha256=_digest(sha256, throttle, brake),
        schema=values["schema"],
        requirements=tuple(each.limit for each in requirements),
        objective=objective,
        tuned=tuple(dict.fromkeys(values.get("tune") or ())),
    )
    for mode in system.modes:
        if mode.gains is not None and mode.name in system.tuned:
            where = place.child(SYSTEM).child(mode.name).child("gains")
            where.refuse(f"the {mode.name} is under tune: its gains are designed; remove one of the two")
    _refuse_short_window(system, place.child(SYSTEM))
    _refuse_long_dwell(system, place.child(SYSTEM))
    _refuse_accelerations(system, limits)
    if objective is not None and objective.quantity == ACCELERATION and velocity_unit(system.measurement_unit) is None:
        place.child("objective").child("minimize").refuse(acceleration_problem(system.measurement_unit))
    return None if place.collector.problems else system


def _requirements_shape() -> ListOf:
    records = limit_records(DESIGNED_MEASURES)
    one = OneKeyOf("one measure of a simulation with its limit", "measure", records, _LIMIT, _no_requirement)
    return ListOf("what every pair of plants must do in the scenarios", one, 0, 500)


def _no_requirement(key: str, value: Node) -> str | None:
    """Where a key belongs that is no requirement of a system; None where that is not known."""
    if key in QUANTITIES:
        return f"{key} is about the frequency response of one loop; write it under requirements of that mode's own spec"
    return measure_as_requirement(key, value)


def _objective_shape() -> Record:
    keys = {
        "minimize": Key(Choice("a measure of a scenario", DESIGNED_MEASURES)),
        "scenario": Key(Text("whose measure it is; of the only scenario where left out"), required=False),
    }
    return Record(
        "what is minimised, of the worst pair of plants", keys,
        lambda values, place: Objective(Sense.MINIMIZE, values["minimize"], scenario=values.get("scenario")),
        "{minimize: iae, scenario: stop}",
    )  # fmt: skip


def _checked_objective(values: Values, requirements: list[PlacedLimit], place: Place) -> Objective | None:
    """The objective with its scenario, after reporting what is missing for a design."""
    objective: Objective | None = values.get("objective")
    if place.has("tune") and objective is None and not place.has("objective"):
        place.child("tune").refuse("what is the best? add objective: {minimize: iae, scenario: ...}")
    if objective is None:
        return None
    if not place.has("tune"):
        place.child("objective").refuse("whose gains? add tune: [brake], [throttle] or both")
    objective = with_scenario(objective, values.get("scenarios") or [], place.child("objective"))
    names = {objective.scenario, *(each.limit.scenario for each in requirements)}
    for index, scenario in enumerate(values.get("scenarios") or []):
        if scenario.quantum and (None in names or scenario.name in names):
            place.child("scenarios").item(index).child("quantum").refuse(QUANTUM)
    return objective


def _refuse_what_is_not_shared(throttle: ModeSpec, brake: ModeSpec, values: Values, place: Place) -> None:
    """Reports names under `shared` that are not the same uncertain number in both plants."""
    for index, name in enumerate(values.get("shared") or ()):
        where = place.child("shared").item(index)
        one, other = (mode.spec.plant.parameters.get(name) for mode in (throttle, brake))
        if one is None or other is None:
            mode = throttle if one is None else brake
            known = sorted({*throttle.spec.plant.uncertain_names} & {*brake.spec.plant.uncertain_names})
            advice = f"write {one_of(known)}" if known else "both plants have to have an uncertain number of this name"
            where.refuse(f"the {mode.name}'s plant has no number called {quoted(name)}; {advice}")
        elif one != other:
            where.refuse(
                f"{name} is {_range_of(one)} in the throttle's spec and {_range_of(other)} in the brake's; one number "
                "has one range and one nominal value"
            )
        elif one.is_exact:
            where.refuse(f"{name} is exactly {one.min:g} in both specs, which shares nothing; leave it out")


def _range_of(number: Uncertain) -> str:
    return f"[{number.min!r}, {number.max!r}] with nominal {number.nominal!r}"


def _refuse_short_window(system: SystemSpec, place: Place) -> None:
    """Reports a window in which more than `most_switches` jumps, one a sample, cannot happen."""
    shortest = system.most_switches * system.sample_time_s
    if system.chattering_window_s < shortest * (1.0 - 1e-9):
        place.child("window_s").refuse(
            f"{system.window_s:g} s cannot hold {system.most_switches + 1} samples of {system.sample_time_s:g} s, so "
            f"that nothing would chatter; write at least {shortest:g}, or leave it out for {2 * shortest:g}"
        )


def _refuse_long_dwell(system: SystemSpec, place: Place) -> None:
    """Reports a dwell that no scenario would see the end of."""
    longest = max((scenario.duration_s for scenario in system.scenarios), default=math.inf)
    if system.min_dwell_s > longest:
        place.child("min_dwell_s").refuse(
            f"{system.min_dwell_s:g} s is longer than every scenario, so that no mode would be left after a switch; "
            f"write it in s, at most {longest:g}, or lengthen a scenario"
        )


def _refuse_accelerations(system: SystemSpec, limits: list[PlacedLimit]) -> None:
    """Reports limits of the acceleration where the output is no velocity, or two different ones."""
    one, two = (mode.spec.digital.measurement_unit.strip() if mode.spec.digital else "" for mode in system.modes)
    if not one or not two or one == two:
        refuse_accelerations(limits, system.measurement_unit)
        return
    for each in limits:
        if each.limit.measure == ACCELERATION:
            said = f"measurement_unit is {one} in the throttle's spec and {two} in the brake's"
            each.place.child(ACCELERATION).refuse(f"{said}; they share one output: make them equal")


def _modes_shape() -> Shape:
    keys = {name: Key(_mode_shape(name)) for name in MODES}
    keys |= {
        "hysteresis": Key(Number("half-width of the hysteresis around the setpoint, output unit", at_least=0)),
        "inactive": Key(Choice("what the inactive controller's memory does", _INACTIVE), required=False),
        "first": Key(Choice("mode at the start", MODES), required=False),
        "most_switches": Key(Number("more jumps than this within window_s chatter", at_least=1, whole=True), False),
        "window_s": Key(
            Number("of chattering, s; 2 most_switches samples when left out", above=0, at_most=1e9), required=False
        ),
        "min_dwell_s": Key(
            Number("a mode stays at least so long after a switch, s; rounded up to samples", at_least=0, at_most=1e9),
            required=False,
        ),
        "shared": Key(
            ListOf("numbers of both plants that are one number", Text("a number's name in both specs"), 0, 64),
            required=False,
        ),
    }
    keys = with_defaults_of(SystemSpec, keys)
    return Record("which loops take turns, and when", keys, lambda values, place: values, _EXAMPLE)


def _mode_shape(name: str) -> Record:
    order = Number("order of the integral", above=ALPHA_MIN, below=ALPHA_MAX)
    gains = {"kp": Key(Number("proportional gain")), "ki": Key(Number("integral gain")), "alpha": Key(order)}
    keys = {
        "spec": Key(Text(f"path of the {name}'s spec, from this file's folder")),
        "gains": Key(
            Record("its gains; tuned when left out", gains, _build_gains, "{kp: 0.1, ki: 0.1, alpha: 0.8}"), False
        ),
    }
    keys["output_limits"] = Key(Pair("limits of its control, in place of its spec's", Number("limit")), required=False)
    rate = Number("fastest change of its control by the controller, per s, in place of its spec's", above=0)
    keys["output_rate_per_s"] = Key(rate, required=False)
    return Record(f"the {name}", keys, lambda values, place: values, f"{{spec: {name}.yaml}}")


def _build_gains(values: Values, place: Place) -> FoPi | None:
    try:
        return FoPi(float(values["kp"]), float(values["ki"]), float(values["alpha"]))
    except DomainError as error:
        place.refuse(str(error))
        return None


def _read_mode(name: str, modes_section: dict[str, Any], place: Place, loader: SpecLoader) -> ModeSpec | None:
    where = place.child("spec")
    try:
        spec = loader(modes_section["spec"])
    except SpecError as error:
        where.refuse(f"the spec cannot be used: {error.problems[0]}")
        return None
    if is_fractional(spec.plant):
        where.refuse("a mode's plant is of first order in this version, not a fractional one")
        return None
    if spec.digital is None:
        where.refuse("the spec has no section digital, which says how its controller runs; add one to it")
        return None
    if spec.controller.has_derivative:
        where.refuse(
            "a mode's controller is of structure fopi or pi in this version: two that take turns know no "
            f"{spec.controller.structure}"
        )
        return None
    if spec.controller.measurement_filter is not None:
        where.refuse("a mode's controller has no measurement_filter in this version; remove it from its spec")
        return None
    if spec.controller.setpoint_weight != 1.0:
        where.refuse("a mode's controller has setpoint_weight: 1 in this version; remove the weight from its spec")
        return None
    if isinstance(spec.plant, PlantList):
        where.refuse("a mode's spec has one plant in this version; write plant: in place of plants:")
        return None
    if isinstance(spec.plant, MeasuredFamily):
        where.refuse("a mode's plant is simulated, which a measured response cannot be; write its transfer function")
        return None
    numerator, denominator, dead_time = spec.plant.assemble({})
    if len(denominator) != 2 or len(numerator) != 1 or dead_time != 0.0:
        message = "a mode's plant is of first order, without direct path or dead time; give the time as delay_samples"
        where.refuse(message)
        return None
    own = {key: modes_section[key] for key in ("output_limits", "output_rate_per_s") if key in modes_section}
    if own:
        spec = replace(spec, digital=replace(spec.digital, **own))
    return ModeSpec(name, spec, modes_section.get("gains"))


def _check_same_timing(throttle: ModeSpec, brake: ModeSpec, values: Values, place: Place) -> bool:
    """Whether both loops have the same timing, so that they can run on one computer; reports if not."""
    one, other = throttle.spec.digital, brake.spec.digital
    assert one is not None
    assert other is not None
    where = place.child(SYSTEM).child("brake").child("spec")
    for key in ("sample_time_s", "delay_samples"):
        if getattr(one, key) != getattr(other, key):
            where.refuse(f"its {key} is {getattr(other, key)}, the throttle's {getattr(one, key)}; make them equal")
            return False
    refuse_too_many_samples(values["scenarios"], one.sample_time_s, place)
    return not place.collector.problems


def _digest(sha256: str, *modes: ModeSpec) -> str:
    """SHA-256 of the system file and its specs."""
    return hashlib.sha256("\n".join([sha256, *(mode.spec.sha256 for mode in modes)]).encode()).hexdigest()


def system_json_schema() -> dict[str, Any]:
    """The language of systems, generated like `json_schema`."""
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": f"fopi-tune system, schema {SCHEMA_VERSION}",
    } | system_shape().json_schema()
