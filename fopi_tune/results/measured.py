"""What results say of measured responses:  that they are checked and not proved, where, and how exact the data are."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

from fopi_tune.core.controller import FoPi
from fopi_tune.core.fractional_plants.family import ON_SAMPLES
from fopi_tune.core.measured.family import DIRECTIONS, SIGMAS, MeasuredFamily
from fopi_tune.core.measured.loops import MeasuredLoop
from fopi_tune.quantities import QUANTITIES
from fopi_tune.quantities.base import EvaluatedAt
from fopi_tune.spec.model import DesignSpec

#: why there is no proof
NO_PROOF = "there is no proof of measured data: requirements are checked at the measured frequencies and between them"
_NOT_ON_SAMPLES = (
    "the requirements are those of the loop with the ideal controller in continuous time: {}; put hold and computing "
    "delay into dead_time_s, 1.5 sample times are usual"
)
_UNKNOWN_BEHIND_HOLD = "the loop on samples needs the plant behind its hold, which a measured response does not tell"
#: neper; the interpolation is looked at up to where |L| stays below this
_SMALL_LOOP = math.log(0.1)
#: relative; an end of a band that is this close to the measured one is inside
_SAME = 1e-9


def checked_dict() -> dict[str, Any]:
    """The entry `proof` of a result about measured responses."""
    return {"verdict": "checked", "reason": NO_PROOF}


def measured_notes(spec: DesignSpec, gains: FoPi) -> tuple[str, ...]:
    """What a user should know of the check of measured responses; empty for another plant.

    Args:
        spec: the spec.
        gains: the controller.
    """
    family = spec.plant
    if not isinstance(family, MeasuredFamily):
        return ()
    notes = [*_outside(spec, family), *_deviation(family)]
    if not gains.is_zero:
        notes.append(_interpolation(family, MeasuredLoop(gains, family.members[0].table, family.band_rad_s)))
    return tuple(notes)


def digital_notes(spec: DesignSpec, gains: FoPi) -> tuple[str, ...]:
    """`measured_notes` of a digital controller, and why its loop on samples is not known; arguments as there."""
    if spec.has_loop_on_samples:
        return ()
    why = _UNKNOWN_BEHIND_HOLD if spec.is_measured else ON_SAMPLES
    return _NOT_ON_SAMPLES.format(why), *measured_notes(spec, gains)


def _outside(spec: DesignSpec, family: MeasuredFamily) -> Iterator[str]:
    """Of bands that reach outside of the measured one."""
    low, high = family.band_rad_s
    for place, each in enumerate(spec.requirements, 1):
        takes_band = QUANTITIES[each.quantity].where is EvaluatedAt.BAND
        first, last = each.from_rad_s < low * (1.0 - _SAME), each.to_rad_s > high * (1.0 + _SAME)
        if takes_band and (first or last):
            yield (
                f"requirement {place}, {each.quantity}: it was looked at only inside [{low:.6g}, {high:.6g}] rad/s, "
                "where the plant was measured"
            )
    if any(QUANTITIES[each.quantity].where is not EvaluatedAt.BAND for each in spec.requirements):
        yield f"crossovers and margins were looked for only inside [{low:.6g}, {high:.6g}] rad/s"


def _deviation(family: MeasuredFamily) -> Iterator[str]:
    spread = [member.name for member in family.members if "sigma" in member.name]
    if spread:
        yield (
            f"each measurement with a standard deviation stands for {DIRECTIONS + 1} plants: itself, and {DIRECTIONS} "
            f"that are off by {SIGMAS:g} standard deviations at every frequency at once, in gain, in phase or in both"
        )


def _interpolation(family: MeasuredFamily, loop: MeasuredLoop) -> str:
    """How exact the curve is between its points, up to where the loop no longer matters."""
    points = loop.on_grid
    large = points.omega_rad_s[points.log_gain > _SMALL_LOOP]
    last = float(large[-1]) if len(large) else family.band_rad_s[1]
    errors = [member.table.interpolation_error_up_to(last) for member in family.members]
    gain, phase = max(errors, key=lambda e: e.gain_db), max(errors, key=lambda e: e.phase_deg)
    return (
        f"between the measured frequencies the plant is interpolated: with every second one left out it would differ "
        f"by up to {gain.gain_db:.2g} dB (at {gain.gain_rad_s:.4g} rad/s) and {phase.phase_deg:.2g} deg (at "
        f"{phase.phase_rad_s:.4g} rad/s), up to {last:.4g} rad/s, above which |L| stays below -20 dB"
    )
