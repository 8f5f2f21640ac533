"""Random controllers with orders of integral and derivative, as `random_pids` makes them."""

from __future__ import annotations

import numpy as np
from cases.random_pids import pid_for, sized

from fopi_tune.core.controller import FoPid
from fopi_tune.core.plant import PlantFamily, Uncertain


def orders(rng: np.random.Generator) -> tuple[float, float]:
    """alpha in (0.2, 1.8) and mu in (0.15, 1], either of them 1 at times."""
    alpha = 1.0 if rng.random() < 0.12 else float(rng.uniform(0.2, 1.8))
    mu = 1.0 if rng.random() < 0.12 else float(rng.uniform(0.15, 1.0))
    return alpha, mu


def fopid_for(rng: np.random.Generator, plants: PlantFamily) -> FoPid:
    """Gains for a crossover somewhere; a term is missing at times, of the other sign, or the derivative dominates."""
    pid = pid_for(rng, plants)
    alpha, mu = orders(rng)
    # terms keep their size where those of the PID are equal to kp, about
    omega = 1.0 / max(pid.derivative_filter_time_constant_s * sized(rng, 2.0, 20.0), 1e-6)
    ki, kd = pid.ki * omega ** (alpha - 1.0), pid.kd * omega ** (1.0 - mu)
    return FoPid(pid.kp, ki, alpha, kd, mu, pid.derivative_filter_time_constant_s)


def mirrored(plants: PlantFamily, found: FoPid) -> tuple[PlantFamily, FoPid]:
    """The same loop by a negative plant and negative gains."""
    numbers = {
        name: Uncertain(-n.nominal, -n.max, -n.min) if name in ("static_gain", "gain") or name.startswith("num") else n
        for name, n in plants.parameters.items()
    }
    other = FoPid(-found.kp, -found.ki, found.alpha, -found.kd, found.mu, found.derivative_filter_time_constant_s)
    return PlantFamily(plants.model, numbers), other
