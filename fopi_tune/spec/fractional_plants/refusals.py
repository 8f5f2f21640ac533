"""What a spec with a fractional plant cannot ask for:  what runs on samples."""

from __future__ import annotations

from fopi_tune.core.fractional_plants.family import ON_SAMPLES, is_fractional
from fopi_tune.core.fractional_plants.orders import not_for_fractional
from fopi_tune.spec.yaml.nodes import Place
from fopi_tune.spec.yaml.records import Values

_DIGITAL = (
    "leave digital out; `fopi discretize` makes the filter of the gains from a spec whose plant is a transfer function "
    "that is close to this one"
)
_LEFT_OUT = "leave {} out; `fopi run` draws the exact unit steps of the loop in continuous time"
#: sections, what they are, and what to do
_SECTIONS = (
    ("digital", "the loop on samples", _DIGITAL),
    ("scenarios", "a scenario", _LEFT_OUT.format("scenarios")),
    ("limits", "a limit of scenarios", _LEFT_OUT.format("limits")),
    ("validation", "Monte Carlo", "leave validation out; requirements are proved for every plant"),
)


def refuse_for_fractional(values: Values, place: Place) -> None:
    """Report what is about the loop on samples, in a spec whose plant has an order that is not whole."""
    plant = values.get("plant")
    if plant is None or not is_fractional(plant):
        return
    for key, what, advice in _SECTIONS:
        if place.has(key):
            place.child(key).refuse(f"{not_for_fractional(what, ON_SAMPLES)}; {advice}")
