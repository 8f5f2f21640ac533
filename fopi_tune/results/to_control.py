"""Results as objects of python-control."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from fopi_tune.core.controller import FoPi
from fopi_tune.core.loops import Plants
from fopi_tune.core.parallel_form import Sections
from fopi_tune.core.plant import PlantFamily
from fopi_tune.core.sampled_loops import SampledPlants
from fopi_tune.errors import DomainError

#: two poles a decade of the filter's own band
_POLES = 20
_PADE_ORDER = 5
#: the stated band is this many decades to each side of the crossover ...
_DECADES = 3.0
#: ... and the filter's own band reaches further, since its error is largest at the ends
_RESERVE_DECADES = 2.0


@dataclass(frozen=True)
class ControlObjects:
    """`control.TransferFunction`s of a design, nominal plant.

    Args:
        controller: kp + ki s^-1 R(s), R an Oustaloup approximation of s^(1 - alpha) over `band_rad_s`; exact for
            alpha = 1.
        plant: the nominal plant; its dead time a Pade approximation of order 5, good up to omega = 3/dead time.
        loop: controller times plant.
        band_rad_s: where the controller's gain and phase (rad) are exact to 1 %.
    """

    controller: Any
    plant: Any
    loop: Any
    band_rad_s: tuple[float, float]


def to_control(gains: FoPi | None, family: PlantFamily) -> ControlObjects:
    """Controller, nominal plant and loop as transfer functions of python-control.

    Raises:
        DomainError: there are no gains.
    """
    if gains is None:
        raise DomainError("there are no gains to convert; the design has no answer")
    import control

    from fopi_tune.core.margins import margins

    plant = family.member(family.nominal_point)
    p = control.TransferFunction(list(plant.numerator), list(plant.denominator))
    if plant.dead_time_s > 0:
        numerator, denominator = control.pade(plant.dead_time_s, _PADE_ORDER)
        p = p * control.TransferFunction(numerator, denominator)
    centre = margins(gains, plant).crossover_rad_s or 1.0
    band = (centre * 10.0**-_DECADES, centre * 10.0**_DECADES)
    integrator = control.TransferFunction([1.0], [1.0, 0.0])
    reserve = 10.0**_RESERVE_DECADES
    c = gains.kp + gains.ki * integrator * _oustaloup(1.0 - gains.alpha, (band[0] / reserve, band[1] * reserve))
    return ControlObjects(c, p, c * p, band)


@dataclass(frozen=True)
class SampledObjects:
    """Discrete `control.StateSpace`s of a digital controller's loop, nominal plant, with dt = the sample time.

    Args:
        controller: the sum of first-order sections, exact.
        plant: behind the zero-order hold, with its dead time and the computing delay, exact at the samples.
        loop: controller times plant.
    """

    controller: Any
    plant: Any
    loop: Any


def to_sampled(sections: Sections, family: PlantFamily, delay_samples: float) -> SampledObjects:
    """Controller, nominal plant and loop on samples as state-space systems of python-control.

    Args:
        sections: the controller.
        family: whose nominal member is the plant.
        delay_samples: computing delay.
    """
    import control

    step = sections.sample_time_s
    n = len(sections.poles)
    diagonal = np.diag(sections.poles) if n else np.zeros((0, 0))
    residues = np.array(sections.residues).reshape(n, 1)
    controller = control.ss(diagonal, residues, np.ones((1, n)), [[sections.direct]], step)
    plants = Plants.of(family.member(family.nominal_point))
    plant = _behind_hold(SampledPlants.behind_hold(plants, step, delay_samples * step), step)
    return SampledObjects(controller, plant, controller * plant)


def _behind_hold(plants: SampledPlants, step: float) -> Any:
    """z^-late Q/R as a state space: the companion form of R in delta = z - 1, and a line of delays behind it."""
    import control

    q, r, late = plants.numerator[0], plants.denominator[0], int(plants.late[0])
    n = len(r) - 1
    companion = np.eye(n, k=-1)
    companion[:1, :] -= r[1:]
    start = np.zeros((n, 1))
    start[:1] = 1.0
    moving = control.ss(np.eye(n) + companion, start, (q[1:] - q[0] * r[1:])[None, :], [[q[0]]], step)
    delays = control.ss(np.eye(late, k=-1), np.eye(late, 1), np.eye(late)[-1:, :], [[0.0]], step)
    return delays * moving


def _oustaloup(order: float, band_rad_s: tuple[float, float]) -> Any:
    """Oustaloup's filter for s^order:  N poles and zeros spread geometrically, the gain exact in the band's middle.

    w_z,k = w_b (w_h/w_b)^((k + (1 - r)/2)/N),  w_p,k = w_b (w_h/w_b)^((k + (1 + r)/2)/N),  k = 0 .. N-1
    """
    import control

    if order == 0.0:
        return control.TransferFunction([1.0], [1.0])
    low, high = band_rad_s
    k = np.arange(_POLES)
    zeros = low * (high / low) ** ((k + 0.5 * (1.0 - order)) / _POLES)
    poles = low * (high / low) ** ((k + 0.5 * (1.0 + order)) / _POLES)
    middle = math.sqrt(low * high)
    gain = middle**order / np.abs(np.prod((1j * middle + zeros) / (1j * middle + poles)))
    return control.zpk(-zeros, -poles, gain)
