"""The shape of `controller:`, the box of gains to search."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

from fopi_tune.core.controller import ALPHA_MAX, ALPHA_MIN
from fopi_tune.spec.model import ControllerSpec, GainRange
from fopi_tune.spec.yaml.nodes import Place
from fopi_tune.spec.yaml.records import Key, Record, Values
from fopi_tune.spec.yaml.shapes import Choice, Converted, Number, PlainOrMapping, Shape

_FREE = GainRange()
#: orders that are searched by default; the ends 0 and 2 themselves are not allowed
_ALPHA = GainRange(0.1, 1.9)
#: the box of a spec without `controller:`
DEFAULT_CONTROLLER = ControllerSpec(_FREE, _FREE, _ALPHA)


def controller_shape() -> Shape:
    """Reads to a `ControllerSpec`."""
    orders = partial(Number, above=ALPHA_MIN, below=ALPHA_MAX)
    keys = {
        "structure": Key(Choice("C(s) = kp + ki s^-alpha", ["fopi"]), required=False, default="fopi"),
        "kp": Key(_gain_shape("proportional gain, control per output unit", Number, _FREE), required=False),
        "ki": Key(_gain_shape("integral gain, in kp's unit times (rad/s)^alpha", Number, _FREE), required=False),
        "alpha": Key(
            _gain_shape("order of the integral", orders, _ALPHA), False, {"min": _ALPHA.min, "max": _ALPHA.max}
        ),
    }

    def build(values: Values, place: Place) -> ControllerSpec:
        return ControllerSpec(values.get("kp", _FREE), values.get("ki", _FREE), values.get("alpha", _ALPHA))

    return Record("where the gains may lie", keys, build, "{kp: {min: 0.0}, ki: {min: 0.0}, alpha: 0.8}")


def _gain_shape(meaning: str, number: Callable[[str], Number], default: GainRange) -> Shape:
    keys = {
        "min": Key(number(f"smallest {meaning}"), required=False),
        "max": Key(number(f"largest {meaning}"), required=False),
    }
    mapping = Record(f"range of the {meaning}", keys, partial(_build_gain, default), "{min: 0.0, max: 10.0}")
    return PlainOrMapping(Converted(number(f"the {meaning}, fixed"), lambda gain: GainRange(gain, gain)), mapping)


def _build_gain(default: GainRange, values: Values, place: Place) -> GainRange | None:
    low, high = values.get("min", default.min), values.get("max", default.max)
    if low <= high:
        return GainRange(low, high)
    wrong = "min" if "min" in values else "max"
    supplied = {"min", "max"} - set(values)
    note = f" (the default; write {supplied.pop()} as well)" if supplied else "; swap them"
    place.child(wrong).refuse(f"min {low} is greater than max {high}{note}")
    return None
