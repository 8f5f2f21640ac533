"""What a spec with a fractional plant cannot ask for:  what runs on samples."""

from __future__ import annotations

from fopi_tune.core.fractional_plants.family import ON_SAMPLES, is_fractional
from fopi_tune.core.fractional_plants.orders import not_for_fractional
from fopi_tune.spec.yaml.nodes import Place
from fopi_tune.spec.yaml.records import Values

_DESIGN = (
    "write design: continuous, with the hold and the delay of the computer in dead_time_s (1.5 sample times are usual)"
)
_LEFT_OUT = "leave {} out; `fopi run` draws the exact unit steps of the loop in continuous time"
#: sections, what they are, and what to do
_SECTIONS = (
    ("scenarios", "a scenario", _LEFT_OUT.format("scenarios")),
    ("limits", "a limit of scenarios", _LEFT_OUT.format("limits")),
    ("validation", "Monte Carlo", "leave validation out; requirements are proved for every plant"),
)


def refuse_for_fractional(values: Values, place: Place) -> None:
    """Report what is about the loop on samples, in a spec whose plant has an order that is not whole."""
    plant = values.get("plant")
    if plant is None or not is_fractional(plant):
        return
    digital = values.get("digital")
    if digital is not None and digital.designs_sampled:
        said = not_for_fractional("the loop on samples", ON_SAMPLES)
        place.child("digital").child("design").refuse(f"{said}; {_DESIGN}")
    for key, what, advice in _SECTIONS:
        if place.has(key):
            place.child(key).refuse(f"{not_for_fractional(what, ON_SAMPLES)}; {advice}")
