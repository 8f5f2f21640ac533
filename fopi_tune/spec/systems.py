"""The shape of a system file:  two specs whose loops take turns, and their scenarios; the same as JSON Schema."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Collection
from dataclasses import replace
from typing import Any

from fopi_tune.core.plant import JointFamily, Uncertain
from fopi_tune.quantities import QUANTITIES
from fopi_tune.spec.language import NAME_PATTERN, NAME_RULE, SCHEMA_VERSION
from fopi_tune.spec.measure_words import measure_as_requirement
from fopi_tune.spec.measures import ACCELERATION, DESIGNED_MEASURES, acceleration_problem, velocity_unit
from fopi_tune.spec.model import ModeSpec, Objective, Sense, SystemSpec
from fopi_tune.spec.modes.names import EXAMPLE, FAMILIAR, MODE_PATTERN, written_names
from fopi_tune.spec.modes.section import SpecLoader, Unread, mode_name, modes_shape, read_mode, reserved_words
from fopi_tune.spec.modes.turns import refuse_crossed_lines, refuse_limits_without_rest
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
from fopi_tune.spec.yaml.records import Key, OneKeyOf, Record, Values
from fopi_tune.spec.yaml.shapes import Choice, ListOf, Text, Version

#: the key that distinguishes a system from a spec
SYSTEM = "system"
_LIMIT = "{acceleration_m_s2: {at_most: 2}}"


def is_system(place: Place) -> bool:
    """Whether a document describes a system."""
    return place.has(SYSTEM)


def system_shape(names: tuple[str, str] | None = None, written: Collection[str] = ()) -> Record:
    """The shape of a whole file; reads to the sections' values.

    Args:
        names: of both modes; None: any, for the schema.
        written: keys of the section `system`, for what is told of those that are wrong.
    """
    keys = {
        "schema": Key(Version("version of the language", SCHEMA_VERSION)),
        "name": Key(Text("name of the system and of its results' folder", NAME_PATTERN, NAME_RULE)),
        "description": Key(Text("one sentence for people"), required=False),
        SYSTEM: Key(modes_shape(names, written)),
        "scenarios": Key(scenarios_shape()),
        "limits": Key(limits_shape(), required=False),
        "requirements": Key(_requirements_shape(), required=False),
        "objective": Key(_objective_shape(), required=False),
        "tune": Key(ListOf("modes whose gains are designed", mode_name(names, "a mode"), 1, 2), required=False),
        "validation": Key(validation_shape(names or (MODE_PATTERN,)), required=False),
    }
    return Record("two loops that share their output and take turns", keys, lambda values, place: values, EXAMPLE)


def read_system(place: Place, sha256: str, loader: SpecLoader, read: FileReader) -> SystemSpec | None:
    """The system that a document describes, or None after reporting its problems.

    Args:
        place: the document.
        sha256: of its bytes.
        loader: reads the specs that it names.
        read: reads the file of samples that it names.
    """
    assert isinstance(place.node, MappingNode)
    section = place.child(SYSTEM)
    names = written_names(section, reserved_words())
    if names is None and isinstance(section.node, MappingNode):
        # the other sections' mistakes are told too
        _without_modes().read_partial(place)
        return None
    written = section.node.entries if isinstance(section.node, MappingNode) else ()
    values = system_shape(names or FAMILIAR, written).read_partial(place)
    if values is None:
        return None
    requirements: list[PlacedLimit] = values.get("requirements") or []
    limits = [*requirements, *(values.get("limits") or [])]
    refuse_impossible_limits([each for each in requirements if each is not None])
    if values.get("scenarios") is not None:  # else reported already
        refuse_unknown_scenarios(values["scenarios"], limits, place)
    objective = _checked_objective(values, requirements, place, names or FAMILIAR)
    modes_section = values.get(SYSTEM)
    if modes_section is None or names is None or place.collector.problems:
        return None
    raising, lowering = (read_mode(name, modes_section[name], section.child(name), loader) for name in names)
    if raising is None or lowering is None or not _check_same_timing(raising, lowering, values, place):
        return None
    placed: PlacedValidation | None = values.get("validation")
    _refuse_what_is_not_shared(raising, lowering, modes_section, section)
    if place.collector.problems:
        return None
    shared = tuple(dict.fromkeys(modes_section.get("shared") or ()))
    family = JointFamily.of({mode.name: mode.spec.plant for mode in (raising, lowering)}, shared)
    validation = None if placed is None else resolve_validation(placed, family, read)
    plain = {key: value for key, value in modes_section.items() if key not in (*names, "shared")}
    system = SystemSpec(
        name=values["name"],
        modes=(raising, lowering),
        **plain,
        shared=shared,
        scenarios=tuple(values["scenarios"]),
        limits=tuple(each.limit for each in values.get("limits") or ()),
        validation=validation,
        description=values.get("description", ""),
        sha256=_digest(sha256, raising, lowering),
        schema=values["schema"],
        requirements=tuple(each.limit for each in requirements),
        objective=objective,
        tuned=tuple(dict.fromkeys(values.get("tune") or ())),
    )
    for mode in system.modes:
        if mode.gains is not None and mode.name in system.tuned:
            where = section.child(mode.name).child("gains")
            where.refuse(f"the {mode.name} is under tune: its gains are designed; remove one of the two")
    refuse_crossed_lines(system, section)
    refuse_limits_without_rest(system, section)
    _refuse_bumpless(system, place)
    _refuse_start_below_standstill(system, place)
    _refuse_short_window(system, section)
    _refuse_long_dwell(system, section)
    _refuse_accelerations(system, limits)
    if objective is not None and objective.quantity == ACCELERATION and velocity_unit(system.measurement_unit) is None:
        place.child("objective").child("minimize").refuse(acceleration_problem(system.measurement_unit))
    return None if place.collector.problems else system


def _without_modes() -> Record:
    """The shape of a file of which the section `system` is not read."""
    whole = system_shape()
    return replace(whole, keys={**whole.keys, SYSTEM: Key(Unread("the modes"))})


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


def _checked_objective(
    values: Values, requirements: list[PlacedLimit], place: Place, names: tuple[str, str]
) -> Objective | None:
    """The objective with its scenario, after reporting what is missing for a design."""
    objective: Objective | None = values.get("objective")
    if place.has("tune") and objective is None and not place.has("objective"):
        place.child("tune").refuse("what is the best? add objective: {minimize: iae, scenario: ...}")
    if objective is None:
        return None
    if not place.has("tune"):
        advice = f"whose gains? add tune: with the names of one mode or both, such as [{names[1]}]"
        place.child("objective").refuse(advice)
    if (scenarios := values.get("scenarios")) is None:
        return None  # reported already
    objective = with_scenario(objective, scenarios, place.child("objective"))
    judged = {objective.scenario, *(each.limit.scenario for each in requirements)}
    for index, scenario in enumerate(scenarios):
        if scenario.quantum and (None in judged or scenario.name in judged):
            place.child("scenarios").item(index).child("quantum").refuse(QUANTUM)
    return objective


def _refuse_what_is_not_shared(raising: ModeSpec, lowering: ModeSpec, values: Values, place: Place) -> None:
    """Reports names under `shared` that are not the same uncertain number in both plants."""
    for index, name in enumerate(values.get("shared") or ()):
        where = place.child("shared").item(index)
        one, other = (mode.spec.plant.parameters.get(name) for mode in (raising, lowering))
        if one is None or other is None:
            mode = raising if one is None else lowering
            known = sorted({*raising.spec.plant.uncertain_names} & {*lowering.spec.plant.uncertain_names})
            advice = f"write {one_of(known)}" if known else "both plants have to have an uncertain number of this name"
            where.refuse(f"the {mode.name}'s plant has no number called {quoted(name)}; {advice}")
        elif one != other:
            where.refuse(
                f"{name} is {_range_of(one)} in the {raising.name}'s spec and {_range_of(other)} in the "
                f"{lowering.name}'s; one number has one range and one nominal value"
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


def _refuse_bumpless(system: SystemSpec, place: Place) -> None:
    """Reports a bumpless start with a feed-forward, which would add to it."""
    fed = [mode.name for mode in system.modes if mode.feedforward is not None]
    for index, scenario in enumerate(system.scenarios):
        if fed and scenario.bumpless:
            place.child("scenarios").item(index).child("bumpless").refuse(
                f"the {fed[0]}'s feedforward would come on top of the input that held the plant; remove one of the two"
            )


def _refuse_start_below_standstill(system: SystemSpec, place: Place) -> None:
    """Reports an initial output below 0 in a system with a standstill."""
    still = [mode.name for mode in system.modes if mode.hold_below_per_s is not None]
    for index, scenario in enumerate(system.scenarios):
        if still and scenario.initial_output < 0.0:
            place.child("scenarios").item(index).child("initial_output").refuse(
                f"the {still[0]}'s standstill keeps the output at 0 or above; start there, or remove standstill"
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
            first, second = (mode.name for mode in system.modes)
            said = f"measurement_unit is {one} in the {first}'s spec and {two} in the {second}'s"
            each.place.child(ACCELERATION).refuse(f"{said}; they share one output: make them equal")


def _check_same_timing(raising: ModeSpec, lowering: ModeSpec, values: Values, place: Place) -> bool:
    """Whether both loops can run on one computer, with delays that are the same or whole samples; reports if not."""
    one, other = raising.spec.digital, lowering.spec.digital
    assert one is not None
    assert other is not None
    where = place.child(SYSTEM).child(lowering.name).child("spec")
    if one.sample_time_s != other.sample_time_s:
        said = f"its sample_time_s is {other.sample_time_s}, the {raising.name}'s {one.sample_time_s}; make them equal"
        where.refuse(said)
        return False
    delays = other.delay_samples, one.delay_samples
    if delays[0] != delays[1] and not all(float(each).is_integer() for each in delays):
        where.refuse(
            f"its delay_samples is {delays[0]}, the {raising.name}'s {delays[1]}; those that differ are whole samples: "
            "round both up, or make them equal"
        )
        return False
    refuse_too_many_samples(values["scenarios"], one.sample_time_s, place)
    return not place.collector.problems


def _digest(sha256: str, *modes: ModeSpec) -> str:
    """SHA-256 of the system file and its specs."""
    return hashlib.sha256("\n".join([sha256, *(mode.spec.text_sha256 for mode in modes)]).encode()).hexdigest()


def system_json_schema() -> dict[str, Any]:
    """The language of systems, generated like `json_schema`."""
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": f"fopi-tune system, schema {SCHEMA_VERSION}",
    } | system_shape().json_schema()
