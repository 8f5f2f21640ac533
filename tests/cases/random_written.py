"""Random transfer functions as people write them: stable, integrating, unstable, resonant, with zeros and dead time."""

from __future__ import annotations

import random


def random_written(count: int, seed: int) -> list[str]:
    """Texts of `fopi init --from-tf`, each with its own time scale, gain and sign."""
    rng = random.Random(seed)
    return [_plant(rng) for _ in range(count)]


def _plant(rng: random.Random) -> str:
    def text(value: float) -> str:
        return f"{float(f'{value:.3g}'):g}"

    scale, order = 10 ** rng.uniform(-2, 2), rng.choice([1, 1, 2, 2, 3, 4])
    gain, kind, left = rng.choice([1, 1, 1, -1]) * 10 ** rng.uniform(-2, 2), rng.random(), order
    factors: list[str] = []
    if kind < 0.25:
        factors.append("s" if kind < 0.15 else f"(s-{text(10 ** rng.uniform(-0.5, 0.5) / scale)})")
        left -= 1
    while left > 0:
        if left >= 2 and rng.random() < 0.35:
            rate, damping = 10 ** rng.uniform(-0.5, 0.5) / scale, rng.choice([0.1, 0.3, 0.5, 0.7])
            factors.append(f"(s^2+{text(2 * damping * rate)}*s+{text(rate * rate)})")
            left -= 2
        else:
            factors.append(f"({text(scale * 10 ** rng.uniform(-0.7, 0.7))}*s+1)")
            left -= 1
    top = text(gain)
    if order >= 2 and rng.random() < 0.3:
        top += f"*({rng.choice(['', '-'])}{text(scale / 10 ** rng.uniform(-0.5, 0.7))}*s+1)"
    delay = f"exp(-{text(scale * 10 ** rng.uniform(-1.5, 0.3))}*s)*" if rng.random() < 0.4 else ""
    return f"{delay}{top}/({'*'.join(factors)})"
