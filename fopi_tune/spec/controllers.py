"""The shape of `controller:`, the box of gains to search."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial

from fopi_tune.core.controller import ALPHA_MAX, ALPHA_MIN, DERIVATIVE_NAMES, IMPROPER, MU_MAX, ORDER_NAME
from fopi_tune.core.terms.filter_times import FilterTimes, middle_of
from fopi_tune.core.terms.measurement_filter import FILTER_ORDERS, MeasurementFilter
from fopi_tune.spec.model import ControllerSpec, GainRange
from fopi_tune.spec.yaml.advice import Advised, range_advice
from fopi_tune.spec.yaml.nodes import Place, ScalarNode, kind_of
from fopi_tune.spec.yaml.records import Key, Record, Values
from fopi_tune.spec.yaml.shapes import Choice, Converted, JsonSchema, Number, PlainOrMapping, Shape

_FREE = GainRange()
#: orders that are searched by default; the ends 0 and 2 themselves are not allowed
_ALPHA = GainRange(0.1, 1.9)
_WEIGHTS = GainRange(0.0, 1.0)
#: orders of the derivative that are searched by default
_MU = GainRange(0.1, MU_MAX)
_DERIVATIVE = (
    "write structure: pid, or fopid with an order mu, kd in place of a derivative time (kd = kp Td), and its filter's "
    "time"
)
_FILTER = "write derivative_filter_time_constant_s, Tf of kd s^mu/(Tf s + 1); Tf = Td/N"
_WEIGHT = "write setpoint_weight, b of kp (b r - y)"
_DERIVATIVE_OF_SETPOINT = "the derivative acts on -y, never on the setpoint; remove it"
_MEASUREMENT_FILTER = "write measurement_filter: {order: 1, time_constant_s: T} for 1/(1 + sT) on the measurement"
_INTEGRAL_TIME = "the integral term is ki/s^alpha; write ki; ki = kp/Ti for alpha: 1"
_ORDER = "write alpha, the order of the integral ki/s^alpha"
_DERIVATIVE_ORDER = "write structure: fopid and mu, the order of the derivative kd s^mu/(Tf s + 1)"
_BAND = "write kp; kp = 100/band for a proportional band in %"
#: words of other controllers, and other words for this one's; as they stand, in small and in capital letters
_OTHER_WORDS = {
    "k_d td t_d tau_d td_s derivative derivative_gain derivative_time derivative_time_s": _DERIVATIVE,
    "tf t_f tf_s n derivative_filter": _FILTER,
    "μ delta derivative_order": _DERIVATIVE_ORDER,
    "ti t_i tau_i ti_s integral_time integral_time_s reset_time reset_time_s": _INTEGRAL_TIME,
    "λ integral_order fractional_order": _ORDER,
    "pb proportional_band": _BAND,
    "b beta setpoint_weighting": _WEIGHT,
    "c derivative_setpoint_weight": _DERIVATIVE_OF_SETPOINT,
    "filter measurement_filter_time_constant_s measurement_filter_order filter_time_constant_s input_filter": (
        _MEASUREMENT_FILTER
    ),
}
_ELSEWHERE = {
    written: reason
    for words, reason in _OTHER_WORDS.items()
    for word in words.split()
    for written in (word, word.capitalize(), word.upper())
}
#: structures that are not known here, and what to write
_STRUCTURES = {
    "p": "write fopi, and ki: 0 beside it",
    "i": "write fopi, and kp: 0 and alpha: 1 beside it",
    "pd": "write pid, and ki: 0 beside it",
    "fopd": "write fopid, and ki: 0 beside it",
}
_MEANING = (
    "C(s) = kp + ki s^-alpha; of pi alpha is 1; of fopid C(s) = kp + ki s^-alpha + kd s^mu/(Tf s + 1); of pid that "
    "with alpha = mu = 1"
)
_FILTER_MEANING = (
    "F on the measurement, before all terms, so that C = F (kp + ...); the setpoint is not filtered: 1/(1 + sT) of "
    "order 1, 1/(1 + sT + s^2 T^2/2) of order 2"
)
_PI_ORDER = GainRange(1.0, 1.0)
#: structures whose integral may have another order than 1
_ANY_ORDER = ("fopi", "fopid")
#: the box of a spec without `controller:`
DEFAULT_CONTROLLER = ControllerSpec(_FREE, _FREE, _ALPHA)


def controller_shape() -> Shape:
    """Reads to a `ControllerSpec`."""
    orders = partial(Number, above=ALPHA_MIN, below=ALPHA_MAX)
    keys = {
        "structure": Key(Advised(Choice(_MEANING, ["fopi", "pi", "pid", "fopid"]), _structure_advice), False, "fopi"),
        "kp": Key(_gain_shape("proportional gain, control per output unit", Number, _FREE), required=False),
        "ki": Key(_gain_shape("integral gain, in kp's unit times (rad/s)^alpha", Number, _FREE), required=False),
        "alpha": Key(
            _gain_shape("order of the integral", orders, _ALPHA), False, {"min": _ALPHA.min, "max": _ALPHA.max}
        ),
        "kd": Key(
            _gain_shape("derivative gain of pid and fopid, in kp's unit times s^mu", Number, _FREE), required=False
        ),
        ORDER_NAME: Key(
            _gain_shape("order of the derivative of fopid, at most 1", partial(Number, above=0.0), _MU), required=False
        ),
        "derivative_filter_time_constant_s": Key(
            _time_shape("Tf of the derivative kd s^mu/(Tf s + 1) of pid and fopid, s"), required=False
        ),
        "setpoint_weight": Key(
            _gain_shape("weight b of the setpoint in kp (b r - y), as it runs on samples", Number, _WEIGHTS), False, 1
        ),
        "measurement_filter": Key(_filter_shape(), required=False),
    }
    rules = {"allOf": [_rule("pi", _ORDER_ONE), _rule("pid", _ORDER_ONE), *_derivative_rules()]}
    example = "{kp: {min: 0.0}, ki: {min: 0.0}, alpha: 0.8}"
    return Record("where the gains may lie", keys, _build_controller, example, _ELSEWHERE, rules)


_ORDER_ONE = {"properties": {"alpha": {"enum": [1, {"min": 1, "max": 1}]}}}


def _rule(structure: str, then: JsonSchema) -> JsonSchema:
    return {"if": {"properties": {"structure": {"const": structure}}, "required": ["structure"]}, "then": then}


def _derivative_rules() -> list[JsonSchema]:
    """Of pid and fopid the filter is asked for, and of fopid alone there is an order; others have no derivative."""

    def rule(structures: list[str], then: JsonSchema, names: tuple[str, ...]) -> JsonSchema:
        is_one = {"properties": {"structure": {"enum": structures}}, "required": ["structure"]}
        return {"if": is_one, "then": then, "else": {"not": {"anyOf": [{"required": [name]} for name in names]}}}

    proper = {"properties": {ORDER_NAME: {"maximum": MU_MAX, "properties": {"max": {"maximum": MU_MAX}}}}}
    return [
        rule(["pid", "fopid"], {"required": [DERIVATIVE_NAMES[1]]}, DERIVATIVE_NAMES),
        rule(["fopid"], proper, (ORDER_NAME,)),
    ]


def _filter_shape() -> Shape:
    keys = {
        "order": Key(Number("order of the filter", at_least=FILTER_ORDERS[0], at_most=FILTER_ORDERS[-1], whole=True)),
        "time_constant_s": Key(_time_shape("T, s")),
    }

    def build(values: Values, place: Place) -> tuple[MeasurementFilter, tuple[float, float] | None]:
        time, side = values["time_constant_s"]
        return MeasurementFilter(values["order"], time), side

    return Record(_FILTER_MEANING, keys, build, "{order: 1, time_constant_s: 0.1}")


def _time_shape(meaning: str) -> Shape:
    """A time constant, or the range in which one is designed; reads to the time, or the range's middle, and range."""
    keys = {
        "min": Key(Number(f"smallest {meaning}", above=0.0)),
        "max": Key(Number(f"largest {meaning}", above=0.0)),
    }
    mapping = Record(f"range of {meaning}: the best time is found", keys, _build_time, "{min: 0.01, max: 0.5}")
    fixed = Converted(Number(meaning, above=0.0), lambda time: (time, None))
    return Advised(PlainOrMapping(fixed, mapping), range_advice(nominal=False))


def _build_time(values: Values, place: Place) -> tuple[float, tuple[float, float] | None] | None:
    low, high = values["min"], values["max"]
    if low > high:
        place.child("min").refuse(f"min {low} is greater than max {high}; swap them")
        return None
    return (low, None) if low == high else (middle_of((low, high)), (low, high))


def _build_controller(values: Values, place: Place) -> ControllerSpec | None:
    found = _build_box(values, place)
    if found is None:
        return None
    weight = values.get("setpoint_weight", GainRange(1.0, 1.0))
    designed = None if weight.is_fixed else weight
    filtered, measurement_s = values.get("measurement_filter", (None, None))
    _, derivative_s = values.get(DERIVATIVE_NAMES[1], (0.0, None))
    times = FilterTimes(derivative_s, measurement_s) if derivative_s or measurement_s else None
    if times is not None and found.fixed is not None:
        place.refuse("every gain is fixed, so that nothing is designed; write the filter's time as a number too")
        return None
    return replace(
        found, setpoint_weight=weight.min if designed is None else 1.0, setpoint_weight_range=designed,
        measurement_filter=filtered, filter_times=times,
    )  # fmt: skip


def _build_box(values: Values, place: Place) -> ControllerSpec | None:
    structure = values.get("structure", "fopi")
    alpha = values.get("alpha", _ALPHA if structure in _ANY_ORDER else _PI_ORDER)
    if structure not in _ANY_ORDER and alpha != _PI_ORDER:
        place.child("alpha").refuse(
            f"the integral of structure {structure} has the order 1; remove alpha, or write structure: "
            f"{'fopid' if structure == 'pid' else 'fopi'}"
        )
        return None
    kp, ki, kd = (values.get(name, _FREE) for name in ("kp", "ki", "kd"))
    filter_s, _ = values.get(DERIVATIVE_NAMES[1], (None, None))
    if ORDER_NAME in values and structure != "fopid":
        place.child(ORDER_NAME).refuse("only structure: fopid has an order mu; write structure: fopid, or remove it")
        return None
    if structure in ("pid", "fopid"):
        mu = values.get(ORDER_NAME, _MU) if structure == "fopid" else None
        if mu is not None and mu.max > MU_MAX:
            place.child(ORDER_NAME).refuse(f"{IMPROPER}; write an order, or a max, of at most 1")
            return None
        if filter_s is not None:
            return ControllerSpec(kp, ki, alpha, kd, filter_s, mu=mu)
        place.refuse(
            f"structure {structure} needs derivative_filter_time_constant_s, Tf of kd "
            f"{'s^mu' if structure == 'fopid' else 's'}/(Tf s + 1): without it the controller's "
            "gain grows without end with the frequency; write a time of a tenth of the derivative time kd/kp or less"
        )
        return None
    for name in DERIVATIVE_NAMES:
        if name in values:
            place.child(name).refuse(
                "only structure: pid or fopid has a derivative; write structure: pid, or remove it"
            )
            return None
    return ControllerSpec(kp, ki, alpha)


def _structure_advice(place: Place) -> str | None:
    word = place.node.text.lower() if isinstance(place.node, ScalarNode) else ""
    advice = _STRUCTURES.get(word)
    return None if advice is None else f"{kind_of(place.node)} is not known here; {advice}"


def _gain_shape(meaning: str, number: Callable[[str], Number], default: GainRange) -> Shape:
    keys = {
        "min": Key(number(f"smallest {meaning}"), required=False),
        "max": Key(number(f"largest {meaning}"), required=False),
    }
    mapping = Record(f"range of the {meaning}", keys, partial(_build_gain, default), "{min: 0.0, max: 10.0}")
    fixed = Converted(number(f"the {meaning}, fixed"), lambda gain: GainRange(gain, gain))
    return Advised(PlainOrMapping(fixed, mapping), range_advice(nominal=False))


def _build_gain(default: GainRange, values: Values, place: Place) -> GainRange | None:
    low, high = values.get("min", default.min), values.get("max", default.max)
    if low <= high:
        return GainRange(low, high)
    wrong = "min" if "min" in values else "max"
    supplied = {"min", "max"} - set(values)
    note = f" (the default; write {supplied.pop()} as well)" if supplied else "; swap them"
    place.child(wrong).refuse(f"min {low} is greater than max {high}{note}")
    return None
