"""Words for what simulations measure, where people write them: among the requirements, as an objective, misnamed."""

from __future__ import annotations

import re

from fopi_tune.quantities import QUANTITIES
from fopi_tune.spec.measures import DESIGNED_MEASURES, MEASURES
from fopi_tune.spec.yaml.advice import limit_as_written
from fopi_tune.spec.yaml.nodes import Node

#: part of a word, and the measure that is meant; None where there is no such measure
_WORDS: dict[str, str | None] = {
    **{name: name for name in MEASURES},
    "overshoot": "overshoot",
    "settling": "settling_time_s",
    "rise": "rise_time_s",
    "risetime": "rise_time_s",
    "steady_state": "final_error",
    "final": "final_error",
    "offset": "final_error",
    "itae": "iae",
    "acceleration": "acceleration_m_s2",
    "jerk": "peak_jerk_per_s2",
    "saturation": "saturation_time_s",
    "max_control": "peak_control",
    "control_max": "peak_control",
    "decay_ratio": None,
    "damping": None,
}
#: shorter ones count only as a whole word between underscores: "rise" holds "ise"
_SHORTEST_PART = 5
_OTHER_UNIT = re.compile(r"(?:^|_)(?:percent|pct|rel|ratio|ms|min)(?:_|$)")


def measure_meant(word: str) -> tuple[bool, str | None]:
    """Whether a word is about what simulations measure, and the measure, None where there is none of that kind."""
    lower = word.lower()
    for part, measure in _WORDS.items():
        if (
            part == lower
            or re.search(rf"(?:^|_){part}(?:_|$)", lower)
            or (len(part) >= _SHORTEST_PART and part in lower)
        ):
            return True, measure
    return False, None


def measure_as_requirement(key: str, value: Node) -> str | None:
    """Where a key belongs that is no requirement but a measure of simulations; None for any other key."""
    if key in ("scenario", "limits"):
        return f"{key} belongs to a measure of simulations; write it beside one, such as overshoot: {{at_most: 0.1}}"
    if "bandwidth" in key.lower():
        return "the bandwidth of a loop lies near its gain crossover; write crossover_rad_s (rad/s)"
    found, measure = measure_meant(key)
    if not found or key in QUANTITIES:
        return None
    if measure is None:
        return (
            "neither a requirement nor a measure of simulations is called so; phase_margin_deg and crossover_rad_s "
            "here, overshoot and settling_time_s in the section limits say how well damped and how fast a loop is"
        )
    limit = "{at_most: ...}" if _OTHER_UNIT.search(key.lower()) else limit_as_written(value, "{at_most: ...}")
    if measure in DESIGNED_MEASURES:
        return (
            f"the key is not known here; write {{{measure}: {limit}}} ({MEASURES[measure].unit}), and what to simulate "
            "under scenarios"
        )
    return (
        f"{measure} ({MEASURES[measure].unit}) changes with the gains in jumps only and is not designed for; write "
        f"limits: [{{{measure}: {limit}}}] beside requirements, and gains are judged by it"
    )


def requirement_as_measure(key: str, value: Node) -> str | None:
    """The same for the section limits: a requirement, or a measure by another name."""
    if key in QUANTITIES:
        return f"{key} is a requirement; write it under requirements"
    found, measure = measure_meant(key)
    if not found or key in MEASURES:
        return None
    if measure is None:
        return "no measure of simulations is called so; overshoot and settling_time_s are close to it"
    return f"the key is not known here; write {measure} ({MEASURES[measure].unit})"
