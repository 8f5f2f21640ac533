"""The numbers of a certificate against floating point:  the search of `verify`, and responses at one frequency.

No ball, no record and no claim is used.  A statement that is off by more than rounding is named.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from fopi_tune.core.controller import FoPi
from fopi_tune.core.loops import Loops, Plants
from fopi_tune.core.parallel_form import Implementation, Sections
from fopi_tune.core.plant import PlantFamily, Uncertain
from fopi_tune.core.sampled_loops import SampledLoops
from fopi_tune.core.stability import unstable_closed_loop_poles
from fopi_tune.proof import verify
from fopi_tune.quantities import QUANTITIES
from fopi_tune.quantities.base import NEPER_PER_DB
from fopi_tune.spec.model import DesignSpec

#: natural units; the search in floating point ends within this of the worst value (seen: 1e-12)
ROUNDING = 1e-9
#: relative; a crossing's frequency in the file and one that is found again
_FREQUENCY = 1e-7


def false_statements(document: dict[str, Any], spec: DesignSpec) -> list[str]:
    """Statements of a certificate about a spec that floating point finds to be false."""
    gains = FoPi(**document["gains"])
    implementation = _implementation(document.get("implementation"))
    found = verify(spec, gains, document["tolerance"], implementation)
    family = _family(document["plant"])
    wrong = []
    stability = document["stability"]
    loop = _loops(family, gains, implementation, stability["point"])
    if stability["unstable_poles"] != int(unstable_closed_loop_poles(loop)[0]):
        wrong.append("unstable poles")
    level = stability["sensitivity_at_most_neper"]
    if (stability["verdict"] == "proved") != found.stability.stable:
        wrong.append("stability")
    if level is not None and found.stability.peak_sensitivity_db * NEPER_PER_DB > level + ROUNDING:
        wrong.append("bound of |S|")
    for entry, result in zip(document["requirements"], found.requirements, strict=True):
        wanted = {"proved": True, "refuted": False}.get(entry["verdict"])
        if wanted is not None and wanted != result.is_met:
            wrong.append(f"verdict of {entry['name']}")
        for side, extreme in zip(entry["sides"], result.extremes, strict=False):
            loop = _loops(family, gains, implementation, side["point"])
            wrong += [f"{what} of {entry['name']}" for what in _side(entry, side, extreme.achieved, loop)]
    return wrong


def _side(entry: dict[str, Any], side: dict[str, Any], achieved: float | None, loop: Loops) -> list[str]:
    """What is false about one limit."""
    quantity, upper = QUANTITIES[entry["name"]], side["side"] == "at_most"
    sign = 1.0 if upper else -1.0
    high = math.inf if entry["to_rad_s"] is None else entry["to_rad_s"]
    omega = math.inf if side["omega_tends_to_infinity"] else side["omega_rad_s"]
    wrong = []
    level, witness = side["level_natural"], side["witness_natural"]
    worst = -sign * math.inf if achieved is None or math.isinf(achieved) else quantity.to_natural(achieved)
    if level is not None and sign * (worst - level) > ROUNDING:
        wrong.append("level")
    measured = quantity.measure(loop, upper, entry["from_rad_s"], high)
    value, where = float(measured.value[0]), float(measured.omega_rad_s[0])
    if witness is not None and math.isfinite(value) and sign * (witness - quantity.to_natural(value)) > ROUNDING:
        wrong.append("witness")
    if witness is not None and quantity.takes_band:
        inside = entry["from_rad_s"] * (1.0 - 1e-12) <= omega <= high * (1.0 + 1e-12)
        if not inside or sign * (witness - _response(entry["name"], loop, omega)) > ROUNDING:
            wrong.append("frequency")
    elif not quantity.takes_band and not _is_same_frequency(omega, where):
        wrong.append("frequency")
    return wrong


def _is_same_frequency(stated: float | None, measured: float) -> bool:
    if stated is None:
        return math.isnan(measured)
    return math.isclose(stated, measured, rel_tol=_FREQUENCY)


def _response(name: str, loop: Loops, omega: float) -> float:
    """ln|R(j omega)|, R named by the spec; omega inside the axis."""
    row, at = np.array([0]), np.array([omega])
    value = complex(loop.response(row, at)[0])
    c = loop.sections.response(at) if isinstance(loop, SampledLoops) else loop.controller_response(row, at)
    top = {"loop_gain_db": value * (1.0 + value), "complementary_sensitivity_db": value, "sensitivity_db": 1.0}
    return math.log(abs(top.get(name, complex(c[0])) / (1.0 + value)))


def _loops(family: PlantFamily, gains: FoPi, implementation: Implementation | None, point: list[float]) -> Loops:
    plants = Plants.members(family, np.array([point], dtype=float))
    return (
        Loops.of(gains, plants) if implementation is None else SampledLoops.implemented(gains, implementation, plants)
    )


def _family(plant: dict[str, Any]) -> PlantFamily:
    numbers = {entry["name"]: Uncertain(entry["nominal"], entry["min"], entry["max"]) for entry in plant["parameters"]}
    return PlantFamily(plant["model"], numbers)


def _implementation(entry: dict[str, Any] | None) -> Implementation | None:
    if entry is None:
        return None
    sections = Sections(entry["sample_time_s"], entry["direct"], tuple(entry["poles"]), tuple(entry["residues"]))
    return Implementation(sections, entry["delay_samples"])
