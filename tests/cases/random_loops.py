"""Random loops:  plants of order up to 5 with resonances, integrators and zeros and poles on the right."""

from __future__ import annotations

import math

import numpy as np
from oracles.nyquist import Loop

from fopi_tune.core.controller import FoPi
from fopi_tune.core.parallel_form import Sections
from fopi_tune.core.plant import Plant


def random_roots(rng: np.random.Generator, number: int, right: float, integrators: float) -> list[complex]:
    """Roots over two decades, half of them in pairs with a damping down to 0.003; `right` is the share on the right."""
    found: list[complex] = []
    while len(found) < number:
        side, size = (1.0 if rng.random() < right else -1.0), 10.0 ** rng.uniform(-1, 1)
        if number - len(found) >= 2 and rng.random() < 0.5:
            zeta = 10.0 ** rng.uniform(-2.5, 0.0)
            root = size * (side * zeta + 1j * math.sqrt(1.0 - zeta**2))
            found += [root, root.conjugate()]
        else:
            found.append(0.0 if rng.random() < integrators else side * size)
    return found


def random_plant(rng: np.random.Generator, order: int, dead_time_s: float = 0.0, proper: bool = True) -> Plant:
    """A plant whose |P| is near 1 somewhere among its corners, where crossovers are many."""
    zeros = random_roots(rng, int(rng.integers(0, order + (1 if proper else 0))), 0.2, 0.0)
    poles = random_roots(rng, order, 0.15, 0.2)
    numerator, denominator = np.atleast_1d(np.real(np.poly(zeros))), np.real(np.poly(poles))
    at = 1j * 10.0 ** rng.uniform(-1, 1)
    gain = rng.choice([-1.0, 1.0], p=[0.15, 0.85]) * 10.0 ** rng.uniform(-1, 0.7)
    numerator *= gain / abs(np.polyval(numerator, at) / np.polyval(denominator, at))
    return Plant(tuple(numerator.tolist()), tuple(denominator.tolist()), dead_time_s)


def random_loop(rng: np.random.Generator, alpha: float, dead_time_s: float = 0.0) -> Loop:
    """A continuous loop; one of the gains is 0 at times, or negative."""
    kp, ki = (float(rng.choice([0.0, 1.0, -1.0], p=[0.2, 0.7, 0.1])) * 10.0 ** rng.uniform(-1.5, 0.5) for _ in "pi")
    controller = FoPi(kp if kp or ki else 1.0, ki, alpha)
    return Loop(controller, random_plant(rng, int(rng.integers(1, 6)), dead_time_s))


def random_sampled(rng: np.random.Generator, proper: bool) -> tuple[Plant, Sections, float]:
    """A plant, a digital controller and its computing delay in samples, up to 3; `proper` allows a direct path."""
    plant = random_plant(rng, int(rng.integers(1, 5)), proper=proper)
    inner = sorted(rng.uniform(-0.9, 0.99, size=int(rng.integers(0, 3))).tolist(), reverse=True)
    poles = (1.0, *inner) if rng.random() < 0.7 else tuple(inner)
    residues = 0.4 * rng.normal(size=len(poles)) * (1.02 - np.array(poles))
    if poles and poles[0] == 1.0:
        residues[0] = abs(residues[0])
    sections = Sections(10.0 ** rng.uniform(-1.5, -0.2), 0.6 * float(rng.normal()), poles, tuple(residues.tolist()))
    return plant, sections, float(rng.integers(0, 4))
