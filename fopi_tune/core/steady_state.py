"""The steady-state error of a constant reference:  |S(0)| = 1/|1 + L(0)|."""

from __future__ import annotations

import numpy as np

from fopi_tune.core.bode_form import Array
from fopi_tune.core.controller import FoPi
from fopi_tune.core.loops import Loops, Plants
from fopi_tune.core.plant import PlantFamily


def steady_state_errors(loops: Loops) -> Array:
    """The error that stays after a step of the reference, as a part of the step.

    Args:
        loops: m stable loops, of the fractional controller or on samples.

    Returns:
        Shape (m,); 0 with an integral, of the controller or of the plant, and 1 where L(0) = 0.
    """
    log = loops.log
    finite = np.exp(np.clip(log.scale, -700.0, 700.0)) * np.exp(1j * log.phase0)
    with np.errstate(divide="ignore"):
        error = 1.0 / np.abs(1.0 + finite)
    return np.where(log.slope0 < 0, 0.0, np.where(log.slope0 > 0, 1.0, error))


def largest_steady_state_error(family: PlantFamily, gains: FoPi) -> float:
    """The largest steady-state error over a family whose loops are all stable, as a part of the step.

    1 + L(0) is D(0) + C(0) N(0) over D(0), a ratio of functions that are affine in each uncertain number, without a
    pole or a zero in the family's box: it is largest at a corner.

    Args:
        family: the plants.
        gains: the controller.
    """
    return float(steady_state_errors(Loops.of(gains, Plants.members(family, family.corners(most=1 << 16)))).max())
