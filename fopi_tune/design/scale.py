"""The plant's own time and gain, in which every design problem looks alike, be it in microseconds or in hours.

With omega_s and g_s the loop is scaled by

    v = ln(omega/omega_s),   kp' = kp g_s,   ki' = ki g_s omega_s^-alpha ,
    so that   C g_s = kp' + ki' e^{-alpha (v + j pi/2)} .
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from fopi_tune.core.controller import FoPi
from fopi_tune.core.logform import Array
from fopi_tune.core.loops import Plants
from fopi_tune.spec.model import DesignSpec

_POINTS_PER_DECADE = 16
#: decades searched beyond the slowest and the fastest thing the spec names; with gains left open more
_DECADES_BEYOND = 3.0
_DECADES_BEYOND_OPEN = 5.0


@dataclass(frozen=True)
class Scale:
    """The scale of a spec.

    Args:
        omega_rad_s: omega_s.
        gain: g_s = |P(j omega_s)| of the nominal plant.
        omega_grid: shape (n,), rad/s, where violations are looked for.
    """

    omega_rad_s: float
    gain: float
    omega_grid: Array

    def scaled(self, controller: FoPi) -> Array:
        """(kp', ki', alpha), shape (3,)."""
        ki = controller.ki * self.gain * self.omega_rad_s**-controller.alpha
        return np.array([controller.kp * self.gain, ki, controller.alpha])

    def controller(self, scaled: Array) -> FoPi:
        """The gains in the user's units."""
        kp, ki, alpha = (float(x) for x in scaled[:3])
        return FoPi(kp / self.gain, ki / self.gain * self.omega_rad_s**alpha, alpha)


def scale_of(spec: DesignSpec) -> Scale:
    """Scale and frequency grid of a spec: from its plants' corners and dead times, and the frequencies it names."""
    family = spec.plant
    plants = Plants.members(family, family.corners())
    roots = np.concatenate([plants.zeros.ravel(), plants.poles.ravel()])
    roots = roots[np.isfinite(roots) & (roots != 0)]
    own = np.concatenate([np.abs(roots), 1.0 / plants.dead_time_s[plants.dead_time_s > 0]])
    named = _named_frequencies(spec)
    everything = np.concatenate([own, named]) if len(own) + len(named) else np.array([1.0])
    omega_s = _characteristic(spec, own, named)
    box = spec.controller
    is_open = any(math.isinf(v) for gain in (box.kp, box.ki) for v in (gain.min, gain.max))
    span = 10.0 ** (_DECADES_BEYOND_OPEN if is_open else _DECADES_BEYOND)
    low, high = everything.min() / span, everything.max() * span
    count = int(_POINTS_PER_DECADE * math.log10(high / low)) + 2
    grid = np.geomspace(low, high, count)
    damped = roots[np.abs(roots.real) < 0.5 * np.abs(roots.imag)]
    resonances = [abs(r.imag) * (1.0 + k * abs(r.real) / abs(r)) for r in damped for k in (-4.0, -1.0, 0.0, 1.0, 4.0)]
    grid = np.unique(np.concatenate([grid, np.array(resonances), named]))
    nominal = plants.take(np.array([0]))
    gain = float(np.abs(nominal.response(np.array([0]), np.array([omega_s])))[0])
    return Scale(omega_s, gain if math.isfinite(gain) and gain > 0 else 1.0, grid[grid > 0])


def _named_frequencies(spec: DesignSpec) -> Array:
    named = []
    for requirement in spec.requirements:
        named += [w for w in (requirement.from_rad_s, requirement.to_rad_s) if 0.0 < w < math.inf]
        if requirement.quantity == "crossover_rad_s":
            named += list(requirement.limits)
    return np.array(named)


def _characteristic(spec: DesignSpec, own: Array, named: Array) -> float:
    """The crossover where the spec fixes one, else the geometric middle of the plant's corners."""
    for requirement in spec.requirements:
        if requirement.quantity == "crossover_rad_s":
            return requirement.limits[0]
    values = own if len(own) else named
    return float(np.exp(np.mean(np.log(values)))) if len(values) else 1.0
