"""What a spec with a fractional plant cannot ask for:  what runs on samples."""

from __future__ import annotations

from fopi_tune.core.fractional_plants.family import ON_SAMPLES, is_fractional
from fopi_tune.core.fractional_plants.orders import not_for_fractional
from fopi_tune.spec.yaml.nodes import Place
from fopi_tune.spec.yaml.records import Values


def refuse_for_fractional(values: Values, place: Place) -> None:
    """Report what is about the loop on samples, in a spec whose plant has an order that is not whole."""
    plant, digital = values.get("plant"), values.get("digital")
    if plant is None or not is_fractional(plant):
        return
    if digital is not None and digital.designs_sampled:
        place.child("digital").child("design").refuse(
            f"{not_for_fractional('design: sampled', ON_SAMPLES)}; write design: continuous"
        )
    for key, what in (
        ("scenarios", "a scenario"),
        ("limits", "a limit of scenarios"),
        ("validation", "Monte Carlo"),
    ):
        if place.has(key):
            place.child(key).refuse(
                f"{not_for_fractional(what, ON_SAMPLES)}; leave {key} out, the loop in continuous time is simulated "
                "without"
            )
