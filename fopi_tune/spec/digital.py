"""The shape of `digital:`, the controller on a computer."""

from __future__ import annotations

from fopi_tune.spec.model import DigitalSpec
from fopi_tune.spec.yaml.nodes import Place
from fopi_tune.spec.yaml.records import Key, Record, Values, with_defaults_of
from fopi_tune.spec.yaml.shapes import Choice, Number, Pair, Shape, Text

METHODS = ("oustaloup", "modified_oustaloup", "fit")
_RULES = ("tustin", "matched")
_PREWARPS = ("none", "crossover")
_DESIGNS = ("continuous", "sampled")


def digital_shape() -> Shape:
    """Reads to a `DigitalSpec`."""
    meaning_of_band = "band of the approximation, rad/s: the gain crossover and two decades below it should lie inside"
    band = Pair(f"{meaning_of_band}; the default suits crossovers from 0.1 to 1000 rad/s", Number("rad/s", above=0))
    keys = {
        "sample_time_s": Key(Number("sampling period, s", above=0)),
        "method": Key(Choice("approximation of s^(1-alpha)", METHODS), required=False),
        "poles": Key(Number("number of its poles", at_least=1, at_most=50, whole=True), required=False),
        "band_rad_s": Key(band, required=False),
        "rule": Key(Choice("from s to z", _RULES), required=False),
        "delay_samples": Key(Number("computing delay in samples", at_least=0), required=False),
        "prewarp": Key(Choice("where Tustin's rule is exact", _PREWARPS), required=False),
        "design": Key(Choice("which loop the requirements are about", _DESIGNS), required=False),
        "output_limits": Key(Pair("limits of the control, in its unit", Number("limit")), required=False),
        "output_rate_per_s": Key(
            Number("fastest change of the control by the controller, in its unit per s", above=0), required=False
        ),
        "measurement_unit": Key(Text("unit of the output; km/h, m/s and mph have an acceleration"), required=False),
        "output_unit": Key(Text("unit of the control, for people"), required=False),
    }
    prewarps = {"properties": {"prewarp": {"const": "crossover"}}, "required": ["prewarp"]}
    by_tustin = {"properties": {"rule": {"const": "tustin"}, "method": {"enum": [m for m in METHODS if m != "fit"]}}}
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
