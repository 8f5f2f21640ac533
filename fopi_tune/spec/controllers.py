"""The shape of `controller:`, the box of gains to search."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

from fopi_tune.core.controller import ALPHA_MAX, ALPHA_MIN
from fopi_tune.spec.model import ControllerSpec, GainRange
from fopi_tune.spec.yaml.advice import Advised, range_advice
from fopi_tune.spec.yaml.nodes import Place, ScalarNode, kind_of
from fopi_tune.spec.yaml.records import Key, Record, Values
from fopi_tune.spec.yaml.shapes import Choice, Converted, Number, PlainOrMapping, Shape

_FREE = GainRange()
#: orders that are searched by default; the ends 0 and 2 themselves are not allowed
_ALPHA = GainRange(0.1, 1.9)
_DESIGNED = "this version designs kp + ki/s^alpha"
_DERIVATIVE = f"there is no derivative term: {_DESIGNED}; remove it"
_ERROR_ALONE = f"{_DESIGNED} of the control error, r - y as it is measured; remove it"
#: what other controllers have
_ELSEWHERE = {
    **dict.fromkeys(("kd", "Kd", "mu", "td", "Td", "tf", "Tf", "n", "N"), _DERIVATIVE),
    **dict.fromkeys(("td_s", "tf_s", "derivative_filter_time_constant_s"), _DERIVATIVE),
    **dict.fromkeys(("ti", "Ti", "ti_s"), "the integral term is ki/s^alpha; write ki, which is kp/Ti for alpha: 1"),
    **dict.fromkeys(("setpoint_weight", "b", "measurement_filter"), _ERROR_ALONE),
}
#: the box of a spec without `controller:`
DEFAULT_CONTROLLER = ControllerSpec(_FREE, _FREE, _ALPHA)


def controller_shape() -> Shape:
    """Reads to a `ControllerSpec`."""
    orders = partial(Number, above=ALPHA_MIN, below=ALPHA_MAX)
    keys = {
        "structure": Key(
            Advised(Choice("C(s) = kp + ki s^-alpha", ["fopi"]), _structure_advice), required=False, default="fopi"
        ),
        "kp": Key(_gain_shape("proportional gain, control per output unit", Number, _FREE), required=False),
        "ki": Key(_gain_shape("integral gain, in kp's unit times (rad/s)^alpha", Number, _FREE), required=False),
        "alpha": Key(
            _gain_shape("order of the integral", orders, _ALPHA), False, {"min": _ALPHA.min, "max": _ALPHA.max}
        ),
    }

    def build(values: Values, place: Place) -> ControllerSpec:
        return ControllerSpec(values.get("kp", _FREE), values.get("ki", _FREE), values.get("alpha", _ALPHA))

    return Record("where the gains may lie", keys, build, "{kp: {min: 0.0}, ki: {min: 0.0}, alpha: 0.8}", _ELSEWHERE)


def _structure_advice(place: Place) -> str | None:
    word = place.node.text.lower() if isinstance(place.node, ScalarNode) else ""
    rest = {"pi": "alpha: 1", "p": "ki: 0", "i": "kp: 0 and alpha: 1"}.get(word)
    return None if rest is None else f"{kind_of(place.node)} is not known here; write fopi, and {rest} beside it"


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
