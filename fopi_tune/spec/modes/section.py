"""The shape of the section `system`, and each mode's spec with what the system says in its place."""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

from fopi_tune.core.controller import ALPHA_MAX, ALPHA_MIN, FoPi
from fopi_tune.core.families.plant_list import PlantList
from fopi_tune.core.fractional_plants.family import is_fractional
from fopi_tune.core.measured.family import MeasuredFamily
from fopi_tune.core.terms.controller_spec import ControllerSpec
from fopi_tune.core.terms.feedforward import FeedForward
from fopi_tune.errors import DomainError, SpecError
from fopi_tune.spec.model import DesignSpec, ModeSpec, SystemSpec
from fopi_tune.spec.modes.names import EXAMPLE, FAMILIAR, MODE_PATTERN, NAME_RULE, foreign_pattern
from fopi_tune.spec.modes.turns import line_keys, line_rules, misnamed_lines, read_turns
from fopi_tune.spec.yaml.nodes import MappingNode, Place
from fopi_tune.spec.yaml.records import Key, Record, Values, with_defaults_of
from fopi_tune.spec.yaml.shapes import Choice, JsonSchema, ListOf, Number, Pair, PlainOrMapping, Shape, Text

_EXAMPLE_GAINS = "{kp: 0.1, ki: 0.1, alpha: 0.8}"
_INACTIVE = ("held", "tracking", "reset")
INVERSE = "inverse_of_nominal_lag"

#: path as it is written in the system file -> the spec there
SpecLoader = Callable[[str], DesignSpec]


@dataclass(frozen=True)
class Unread(Shape):
    """A section that cannot be read, so that others' mistakes are told."""

    meaning: str

    def read(self, place: Place) -> Any:
        return place.path

    def json_schema(self) -> JsonSchema:
        return {"description": self.meaning}


def modes_shape(names: tuple[str, str] | None, written: Collection[str] = ()) -> Record:
    """The shape of the section.

    Args:
        names: of both modes; None: any, for the schema.
        written: keys of the section, for what is told of those that are wrong.
    """
    shown = names or FAMILIAR
    keys = {name: Key(_mode_shape(name), required=names is not None) for name in shown}
    keys |= _turns(names)
    keys = with_defaults_of(SystemSpec, keys)
    rules: JsonSchema = {}
    if names is None:
        named, rules = _mode_shape("mode").json_schema(), line_rules()
        rules["patternProperties"] |= {foreign_pattern(reserved_words()): named}
    build = partial(read_turns, names or FAMILIAR)
    return Record("which loops take turns, and when", keys, build, EXAMPLE, misnamed_lines(names, written), rules)


def reserved_words() -> tuple[str, ...]:
    """Keys of the section that are no modes."""
    return tuple(_turns(None))


def mode_name(names: tuple[str, str] | None, meaning: str) -> Shape:
    """The name of one of the modes."""
    return Text(meaning, MODE_PATTERN, NAME_RULE) if names is None else Choice(meaning, names)


def _turns(names: tuple[str, str] | None) -> dict[str, Key]:
    """What is said beside the modes."""
    start = "mode at the start; the throttle, or the mode that is written first, when left out"
    return {
        **line_keys(names),
        "inactive": Key(Choice("what the inactive controller's memory does", _INACTIVE), required=False),
        "first": Key(mode_name(names, start), required=False),
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


def _mode_shape(name: str) -> Record:
    def order(of: str) -> Key:
        return Key(Number(f"order of the {of}", above=ALPHA_MIN, below=ALPHA_MAX), required=False)

    gains = {
        "kp": Key(Number("proportional gain")),
        "ki": Key(Number("integral gain")),
        "alpha": order("integral; 1 of structure pid"),
        "kd": Key(Number("derivative gain, of structure pid or fopid"), required=False),
        "mu": order("derivative, of structure fopid"),
    }
    keys = {
        "spec": Key(Text(f"path of the {name}'s spec, from this file's folder")),
        "gains": Key(
            Record("its gains; tuned when left out", gains, lambda values, place: values, _EXAMPLE_GAINS), False
        ),
    }
    keys["output_limits"] = Key(Pair("limits of its control, in place of its spec's", Number("limit")), required=False)
    rate = Number("fastest change of its control by the controller, per s, in place of its spec's", above=0)
    keys["output_rate_per_s"] = Key(rate, required=False)
    keys["feedforward"] = Key(_feedforward_shape(), required=False)
    hold = "while its input and the load drive it by less than this, output unit per s, it stays at 0"
    still = {"hold_below_per_s": Key(Number(hold, at_least=0))}
    keys["standstill"] = Key(
        Record(
            "that its plant's output does not go below 0, and is held there", still,
            lambda values, place: float(values["hold_below_per_s"]), "{hold_below_per_s: 0.5}",
        ),
        required=False,
    )  # fmt: skip
    return Record(f"the {name}", keys, lambda values, place: values, f"{{spec: {name}.yaml}}")


def _feedforward_shape() -> Shape:
    gains = {
        "static_gain": Key(Number("times the setpoint, control unit per output unit"), required=False),
        "rate_gain": Key(Number("times the setpoint's rate, control unit per output unit and second"), required=False),
    }
    meaning = "what the setpoint adds to its control before the limits"

    def build(values: Values, place: Place) -> FeedForward | None:
        if values:
            return FeedForward(**{name: float(value) for name, value in values.items()})
        if isinstance(place.node, MappingNode) and not place.node.entries:
            place.refuse("nothing is fed forward; write static_gain, rate_gain, or both")
        return None

    example = "{static_gain: 0.02, rate_gain: 0.1}"
    record = Record(meaning, gains, build, example, rules={"minProperties": 1})
    return PlainOrMapping(Choice(meaning, (INVERSE,), f"the gains as {example}"), record)


def _gains_of(box: ControllerSpec, values: Values, place: Place) -> FoPi | None:
    """The controller of a mode's structure, or None after reporting why its gains are none of it."""
    wanted = tuple(box.ranges)
    for name in ("alpha", "kd", "mu"):
        # the orders of a pid may be written
        if name in wanted and name not in values:
            place.refuse(
                f"the gain {name} is missing; the mode's controller is of structure {box.structure}, whose gains are "
                f"{', '.join(wanted)}"
            )
            return None
        if name in values and name not in wanted and (name == "kd" or not box.has_derivative or values[name] != 1.0):
            place.child(name).refuse(
                f"the mode's controller is of structure {box.structure}, whose gains are {', '.join(wanted)}; leave "
                f"{name} out, or write another structure in its spec"
            )
            return None
    try:
        return box.controller(**{"alpha": 1.0, **{name: float(value) for name, value in values.items()}})
    except DomainError as error:
        place.refuse(str(error))
        return None


def read_mode(name: str, values: Values, place: Place, loader: SpecLoader) -> ModeSpec | None:
    """A mode with its spec, or None after reporting why the spec is none of a mode.

    Args:
        name: of the mode.
        values: of its mapping.
        place: of its mapping.
        loader: reads the spec that it names.
    """
    where = place.child("spec")
    try:
        spec = loader(values["spec"])
    except SpecError as error:
        where.refuse(f"the spec cannot be used: {error.problems[0]}")
        return None
    if (problem := _problem(spec)) is not None:
        where.refuse(problem)
        return None
    assert spec.digital is not None
    own = {key: values[key] for key in ("output_limits", "output_rate_per_s") if key in values}
    if own:
        spec = replace(spec, digital=replace(spec.digital, **own))
    fed = values.get("feedforward")
    if fed == INVERSE and (fed := _inverse_of(spec)) is None:
        place.child("feedforward").refuse(
            f"{INVERSE} is of a lag K/(tau s + 1), which the {name}'s plant is not; write {{static_gain: ..., "
            "rate_gain: ...}"
        )
        return None
    if "standstill" in values and len(spec.plant.assemble({})[1]) != 2:
        place.child("standstill").refuse(f"the {name}'s plant is of higher order, and would move on; write a lag")
        return None
    gains = None
    if "gains" in values and (gains := _gains_of(spec.controller, values["gains"], place.child("gains"))) is None:
        return None
    return ModeSpec(name, spec, gains, fed, values.get("standstill"))


def _inverse_of(spec: DesignSpec) -> FeedForward | None:
    """The inverse of the nominal plant, where that is a lag with a gain."""
    nominal = spec.plant.member(spec.plant.nominal_point)
    if len(nominal.denominator) != 2:
        return None
    (lead, rest), top = nominal.denominator, nominal.numerator[-1]
    return FeedForward.inverse_of_lag(top / rest, lead / rest) if rest / lead > 0.0 and top else None


def _problem(spec: DesignSpec) -> str | None:
    """Why a spec is none of a mode, with what to do; None where it is one."""
    if is_fractional(spec.plant):
        return "a mode's plant has whole orders in this version, and is no fractional one"
    if spec.digital is None:
        return "the spec has no section digital, which says how its controller runs; add one to it"
    if spec.controller.filter_times is not None:
        names = " and ".join(spec.controller.filter_times.ranges)
        return f"a mode's controller has filters of one time in this version; write one number for {names}"
    if spec.controller.measurement_filter is not None:
        return "a mode's controller has no measurement_filter in this version; remove it from its spec"
    if spec.controller.setpoint_weight != 1.0 or spec.controller.setpoint_weight_range is not None:
        return "a mode's controller has setpoint_weight: 1 in this version; remove the weight from its spec"
    if isinstance(spec.plant, PlantList):
        return "a mode's spec has one plant in this version; write plant: in place of plants:"
    if isinstance(spec.plant, MeasuredFamily):
        return "a mode's plant is simulated, which a measured response cannot be; write its transfer function"
    numerator, denominator, _ = spec.plant.assemble({})
    if len(denominator) < 2:
        return "a mode's plant is of first order or higher: its output must not jump; write a lag with a short time"
    if len(numerator) == len(denominator):
        if numerator[0] == 0.0:
            return "its numerator begins with 0, in place of the direct path that a mode has not; leave it out"
        return (
            "a mode's plant has fewer zeros than poles: as many make the output jump with the control, also at a "
            "change of the mode; add the short lag of its actuator or sensor to the denominator"
        )
    return None
