"""The shapes of `controller:`, the box of gains to search, and of `digital:`, the controller on a computer."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

from fopi_tune.core.controller import ALPHA_MAX, ALPHA_MIN
from fopi_tune.spec.model import ControllerSpec, DigitalSpec, GainRange
from fopi_tune.spec.yaml.nodes import Place
from fopi_tune.spec.yaml.records import Key, Record, Values, with_defaults_of
from fopi_tune.spec.yaml.shapes import Choice, Converted, Number, Pair, PlainOrMapping, Shape, Text

_FREE = GainRange()
#: orders that are searched by default; the ends 0 and 2 themselves are not allowed
_ALPHA = GainRange(0.1, 1.9)
_METHODS = ("oustaloup", "modified_oustaloup", "fit")
_RULES = ("tustin", "matched")
_PREWARPS = ("none", "crossover")
_DESIGNS = ("continuous", "sampled")
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


def digital_shape() -> Shape:
    """Reads to a `DigitalSpec`."""
    meaning_of_band = "band of the approximation, rad/s: the gain crossover and two decades below it should lie inside"
    band = Pair(f"{meaning_of_band}; the default suits crossovers from 0.1 to 1000 rad/s", Number("rad/s", above=0))
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
    keys = with_defaults_of(DigitalSpec, keys)
    return Record("how the gains become a filter", keys, _build_digital, "{sample_time_s: 0.2}", rules=rules)


def _build_digital(values: Values, place: Place) -> DigitalSpec | None:
    found = DigitalSpec(**values)
    if found.prewarp != "none" and (found.rule != "tustin" or found.method == "fit"):
        used = f"method {found.method}" if found.method == "fit" else f"rule {found.rule}"
        place.child("prewarp").refuse(f"prewarping belongs to rule tustin, and {used} does not use it; leave it out")
        return None
    return found
