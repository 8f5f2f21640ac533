"""When two modes take turns:  the words of the section `system` beside its modes -> a hysteresis, or lines.

For the modes `heater` and `fan`, of which the first raises the output, `hysteresis: eps` is

    to_fan_above: eps,      to_heater_below: -eps

Each is a number that is added to the setpoint, `{relative: x}`, or an output itself, `{absolute: x}`.  With
`coast: true` both outputs rest from `coast_above`, or `coast_below`, on until the line of the other mode.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from typing import Any

from fopi_tune.core.switching_lines import SwitchingLines, Threshold
from fopi_tune.spec.model import SystemSpec
from fopi_tune.spec.modes.names import FAMILIAR, THRESHOLD_PATTERN
from fopi_tune.spec.yaml.nodes import MappingNode, Place, scalar_of
from fopi_tune.spec.yaml.records import Key, OneKeyOf, Record, Values
from fopi_tune.spec.yaml.shapes import Converted, JsonSchema, Number, PlainOrMapping, Shape

HYSTERESIS, COAST, COAST_ABOVE, COAST_BELOW = "hysteresis", "coast", "coast_above", "coast_below"


@dataclass(frozen=True)
class Flag(Shape):
    """true or false."""

    meaning: str

    def read(self, place: Place) -> bool | None:
        scalar = scalar_of(place, "true or false")
        if scalar is None:
            return None
        if scalar.plain and scalar.text in ("true", "false"):
            return scalar.text == "true"
        place.refuse(f"{scalar.text!r} is neither true nor false; write one of them")
        return None

    def json_schema(self) -> JsonSchema:
        return {"type": "boolean", "description": self.meaning}


def line_keys(names: tuple[str, str] | None) -> dict[str, Key]:
    """The keys that say where the modes take turns.

    Args:
        names: of both modes, the raising one first; None: any, for the schema.
    """
    raising, lowering = names or FAMILIAR
    return {
        HYSTERESIS: Key(
            Number("half-width of the hysteresis around the setpoint, output unit", at_least=0), required=False
        ),
        f"to_{lowering}_above": Key(_threshold(f"the {lowering}'s mode is entered at this output or above"), False),
        f"to_{raising}_below": Key(_threshold(f"the {raising}'s mode is entered at this output or below"), False),
        COAST: Key(Flag("whether both outputs rest between the lines of the modes"), required=False),
        COAST_ABOVE: Key(_threshold(f"the {raising}'s mode is left to coast at this output or above"), False),
        COAST_BELOW: Key(_threshold(f"the {lowering}'s mode is left to coast at this output or below"), False),
    }


def misnamed_lines(names: tuple[str, str] | None, written: Collection[str] = ()) -> dict[str, str]:
    """Words that name the wrong one of the modes, or another one, each with what to write.

    Args:
        names: of both modes, the raising one first.
        written: keys of the section.
    """
    if names is None:
        return {}
    raising, lowering = names
    found = {}
    for key in written:
        line = re.fullmatch("to_(.*)_(above|below)", key)
        if line is not None and line[1] not in names:
            right = f"to_{lowering}_above" if line[2] == "above" else f"to_{raising}_below"
            found[key] = f"the modes are called {raising} and {lowering}; did you mean {right}?"
    return {
        **found,
        f"to_{raising}_above": f"the {raising} raises the output and is entered below; write to_{raising}_below",
        f"to_{lowering}_below": f"the {lowering} lowers the output and is entered above; write to_{lowering}_above",
    }


def line_rules() -> JsonSchema:
    """JSON Schema keywords: lines of modes of any names, one of each kind at least where there is no hysteresis."""
    pattern = f"^{THRESHOLD_PATTERN}$"
    has_line = [{"not": {"propertyNames": {"not": {"pattern": f"^to_.*_{side}$"}}}} for side in ("above", "below")]
    return {
        "patternProperties": {pattern: _threshold("where a mode is entered").json_schema()},
        "anyOf": [{"required": [HYSTERESIS]}, {"allOf": has_line}],
    }


def read_turns(names: tuple[str, str], values: Values, place: Place) -> Values | None:
    """The section's values with the lines under `hysteresis`, or None after reporting why there are none.

    Args:
        names: of both modes, the raising one first.
        values: of the section.
        place: of the section.
    """
    raising, lowering = names
    words = {"up": f"to_{lowering}_above", "down": f"to_{raising}_below", COAST_ABOVE: COAST_ABOVE}
    words[COAST_BELOW] = COAST_BELOW
    found = {field: values[word] for field, word in words.items() if word in values}
    written = place.node.entries if isinstance(place.node, MappingNode) else ()
    if not _has_both(values, words, misnamed_lines(names, written), place):
        return None
    if HYSTERESIS in values:
        eps = float(values[HYSTERESIS])
        found |= {"up": Threshold(eps), "down": Threshold(-eps)}
    if values.get(COAST):
        found = {COAST_ABOVE: Threshold(0.0), COAST_BELOW: Threshold(0.0)} | found
    elif beside := [word for word in (COAST_ABOVE, COAST_BELOW) if word in values]:
        place.child(beside[0]).refuse("nothing coasts; add coast: true beside it, or leave it out")
        return None
    if (wrong := misplaced_of(found)) is not None:
        _refuse_order(wrong, found, values, words, place)
        return None
    lines = SwitchingLines(**found)
    turns = lines if lines.half_width is None else lines.half_width
    kept = {key: value for key, value in values.items() if key not in (*words.values(), COAST)}
    return {**kept, HYSTERESIS: values.get(HYSTERESIS, turns) if turns is not lines else lines}


def _has_both(values: Values, words: Mapping[str, str], misnamed: Collection[str], place: Place) -> bool:
    """Whether there is a hysteresis or both lines of the modes; reports if not."""
    own = [words["up"], words["down"]]
    written = [word for word in own if word in values]
    if HYSTERESIS in values and written:
        place.child(written[0]).refuse(f"{HYSTERESIS} says where the modes take turns; remove one of the two")
        return False
    if HYSTERESIS in values or len(written) == 2:
        return True
    if any(place.has(word) for word in misnamed):
        return False
    missing = next(word for word in own if word not in values) if written else HYSTERESIS
    instead = f"; {' and '.join(own)} may be written in its place" if not written else ""
    place.child(missing).refuse(f"the key is missing; add it{instead}")
    return False


def misplaced_of(found: Mapping[str, Threshold]) -> tuple[str, str] | None:
    """Two of the lines, by their fields, of which the first must lie below the other; None where all do."""
    rest = Threshold(0.0)
    up, down = found.get("up", rest), found.get("down", rest)
    return SwitchingLines.misplaced_among(up, down, found.get(COAST_ABOVE), found.get(COAST_BELOW))


def _refuse_order(
    wrong: tuple[str, str], found: Mapping[str, Threshold], values: Values, words: Mapping[str, str], place: Place
) -> None:
    low, high = wrong
    if HYSTERESIS in values and wrong == ("down", "up"):
        place.child(HYSTERESIS).refuse("between its two lines nothing can coast; write one greater than 0")
        return
    written = [words[each] for each in (high, low) if words[each] in values] or [COAST]
    names = words if HYSTERESIS not in values else {**words, "up": "the upper line", "down": "the lower line"}
    one, other = (f"{names[each]} ({said(found[each])})" for each in (high, low))
    useless = wrong in (("coast_above", "up"), ("down", "coast_below"))
    why = "that mode would never coast" if useless else "what is between would be left as soon as it is entered"
    place.child(written[0]).refuse(f"{one} must {'not lie below' if useless else 'lie above'} {other}: {why}")


def said(line: Threshold) -> str:
    """A line's number as it may be written."""
    return f"{{absolute: {line.value:g}}}" if line.is_absolute else f"{line.value:g}"


def _threshold(meaning: str) -> Shape:
    number = Number(f"{meaning}: added to the setpoint, output unit")
    kinds = {
        kind: Record(
            f"{meaning}, {words}", {kind: Key(Number("output unit"))},
            lambda values, place, kind=kind: Threshold(float(values[kind]), kind == "absolute"), f"{{{kind}: 1}}",
        )
        for kind, words in (("relative", "added to the setpoint"), ("absolute", "as it is"))
    }  # fmt: skip
    either: Shape = OneKeyOf(meaning, "kind of threshold", kinds, "{absolute: 20}")
    return PlainOrMapping(Converted(number, lambda value: Threshold(float(value))), either)


def refuse_crossed_lines(system: SystemSpec, place: Place) -> None:
    """Reports lines of two kinds that are in the wrong order at a setpoint of a scenario.

    Args:
        system: whose scenarios have the setpoints.
        place: of the section `system`.
    """
    raising, lowering = (mode.name for mode in system.modes)
    names: dict[str, Any] = {"up": f"to_{lowering}_above", "down": f"to_{raising}_below"}
    for scenario in system.scenarios:
        knots = scenario.reference
        at_once = bool(knots) and knots[0].at_s == 0.0 and knots[0].ramp_s == 0.0
        for setpoint in (*(() if at_once else (scenario.initial_output,)), *(knot.value for knot in knots)):
            if (wrong := system.lines.misplaced_at(setpoint)) is None:
                continue
            low, high = (names.get(each, each) for each in wrong)
            at = [f"{getattr(system.lines, each).level(setpoint):g}" for each in wrong]
            where = next((each for each in (high, low) if place.has(each)), HYSTERESIS)
            place.child(where).refuse(
                f"at the setpoint {setpoint:g} of scenario {scenario.name} {high} is {at[1]} and {low} {at[0]}: "
                "between them a mode is left as soon as it is entered; move one of them, or the setpoint"
            )
            return


def refuse_limits_without_rest(system: SystemSpec, place: Place) -> None:
    """Reports limits of a control without 0 in a system that coasts.

    Args:
        system: with its modes' limits.
        place: of the section `system`.
    """
    for mode in system.modes if system.lines.coasts else ():
        limits = mode.spec.digital.output_limits if mode.spec.digital is not None else None
        if limits is not None and not limits[0] <= 0.0 <= limits[1]:
            place.child(mode.name).refuse(
                f"while coasting the {mode.name}'s control rests at 0, which its limits {list(limits)} do not have; "
                "widen them to 0, or remove coast"
            )
