"""Specs by seed for `benchmarks/design.py`:  every kind of plant, objective and mix, microseconds to hours.

Run:  python benchmarks/specs/generate.py SEED     prints one

Kinds of plant take turns with the seed, so that any range of seeds holds all of them.
"""

from __future__ import annotations

import random
import sys

KINDS = ("delayed_lag", "overdamped", "integrating", "resonant", "unstable", "reversed", "inverse_response", "two_lags")
OBJECTIVES = (
    "maximize: ki",
    "minimize: iae_disturbance",
    "maximize: ki",
    "minimize: sensitivity_peak_db",
    "minimize: control_sensitivity_peak_db",
    "minimize: phase_margin_spread_deg",
    "minimize: crossover_spread_db",
)
COUNT = 64
#: seconds; the plants' time scales
_SCALES = (1e-6, 1e-3, 0.1, 1.0, 10.0, 300.0, 5000.0)


class _Draws:
    """Random numbers, at most so many of them uncertain."""

    def __init__(self, seed: int) -> None:
        self.chance = random.Random(1000 + seed)
        self.left = self.chance.choice((0, 1, 1, 2, 2, 3))

    def number(self, value: float, spread: float = 0.25) -> str:
        """A fixed or an uncertain number."""
        if self.left == 0:
            return f"{value:.5g}"
        self.left -= 1
        ends = sorted(
            (value * (1.0 - spread * self.chance.uniform(0.4, 1.0)), value * (1.0 + spread * self.chance.random()))
        )
        return f"{{nominal: {value:.5g}, min: {ends[0]:.5g}, max: {ends[1]:.5g}}}"


def spec_text(seed: int) -> str:
    """The spec of a seed."""
    draws = _Draws(seed)
    chance, kind = draws.chance, KINDS[seed % len(KINDS)]
    t, g = chance.choice(_SCALES) * chance.uniform(0.5, 2.0), chance.uniform(0.3, 5.0)
    objective = OBJECTIVES[(seed // len(KINDS) + seed) % len(OBJECTIVES)]
    plant = _plant(kind, draws, g, t)
    kp, ki = f"{{min: 0, max: {40 / g:.5g}}}", f"{{min: 0, max: {40 / g / t**1.5:.5g}}}"
    if kind == "reversed":
        kp, ki = f"{{min: {-40 / g:.5g}, max: 0}}", f"{{min: {-40 / g / t**1.5:.5g}, max: 0}}"
        objective = objective if "ki" not in objective else "minimize: iae_disturbance"
    order = chance.choice(("1", f"{chance.uniform(0.6, 1.2):.3f}")) if chance.random() < 0.2 else None
    alpha = order or f"{{min: {chance.uniform(0.4, 0.8):.3f}, max: {chance.uniform(1.1, 1.6):.3f}}}"
    lines = [f"schema: 1\nname: bench{seed}\nplant: {plant}", f"controller: {{kp: {kp}, ki: {ki}, alpha: {alpha}}}"]
    asked = _requirements(chance, objective, kind, g, t)
    return (
        "\n".join([*lines, "requirements:", *(f"  - {{{each}}}" for each in asked), f"objective: {{{objective}}}"])
        + "\n"
    )


def _plant(kind: str, draws: _Draws, g: float, t: float) -> str:
    number, chance = draws.number, draws.chance
    if kind in ("delayed_lag", "reversed"):
        gain = number(-g if kind == "reversed" else g)
        return (
            f"{{model: lag, static_gain: {gain}, time_constant_s: {number(t)}, "
            f"dead_time_s: {number(chance.uniform(0.05, 0.8) * t)}}}"
        )
    if kind == "integrating":
        gain, late = number(g / t), number(chance.uniform(0.03, 0.3) * t)
        return f"{{model: pole, gain: {gain}, pole_rad_s: 0, dead_time_s: {late}}}"
    if kind == "unstable":
        gain, pole = number(2.0 * g / t, 0.1), number(-chance.uniform(0.2, 0.6) / t, 0.1)
        return f"{{model: pole, gain: {gain}, pole_rad_s: {pole}, dead_time_s: {0.05 * t:.5g}}}"
    delay = f"{chance.choice((0.0, 0.05, 0.15)) * t:.5g}"
    if kind == "overdamped":
        top, bottom = [number(g)], [number(0.2 * t * t), number(1.2 * t, 0.15), "1"]
    elif kind == "resonant":
        top, bottom = (
            [number(g, 0.2)],
            [f"{t * t:.5g}", number(2.0 * chance.uniform(0.08, 0.4) * t, 0.2), number(1.0, 0.15)],
        )
    elif kind == "inverse_response":
        top, bottom = (
            [f"{-chance.uniform(0.05, 0.3) * g * t:.5g}", f"{g:.5g}"],
            [f"{t * t:.5g}", number(2.1 * t, 0.15), number(1.0, 0.1)],
        )
        delay = "0"
    else:
        top = [f"{chance.uniform(0.1, 0.4) * g * t:.5g}", f"{g:.5g}"]
        bottom = [f"{0.05 * t**3:.5g}", number(0.6 * t * t, 0.2), number(1.6 * t, 0.1), "1"]
    polynomials = f"numerator: [{', '.join(top)}], denominator: [{', '.join(bottom)}]"
    return f"{{model: transfer_function, {polynomials}, dead_time_s: {delay}}}"


def _requirements(chance: random.Random, objective: str, kind: str, g: float, t: float) -> list[str]:
    slow, peak = f"to_rad_s: {0.04 / t:.5g}", f"sensitivity_db: {{at_most: {chance.uniform(3.5, 6.5):.4g}}}"
    low = f"sensitivity_db: {{at_most: {-chance.uniform(4.0, 9.0):.4g}}}, {slow}"
    if "peak" in objective:
        effort = f"control_sensitivity_db: {{at_most: {chance.uniform(14.0, 20.0):.4g}}}"
        return [
            low,
            f"phase_margin_deg: {{at_least: {chance.uniform(25.0, 40.0):.4g}}}",
            *([effort] if "_sensitivity" not in objective and kind != "unstable" else []),
        ]
    if "spread" in objective:
        relation = chance.choice(("equals", "at_least"))
        crossover = f"crossover_rad_s: {{{relation}: {chance.uniform(0.15, 0.4) / t:.5g}}}, on: nominal"
        return [crossover, f"phase_margin_deg: {{at_least: {chance.uniform(25.0, 45.0):.4g}}}"]
    more = (
        [],
        [f"phase_margin_deg: {{at_least: {chance.uniform(35.0, 60.0):.4g}}}"],
        [f"gain_margin_db: {{at_least: {chance.uniform(5.0, 10.0):.4g}}}"],
        [f"complementary_sensitivity_db: {{at_most: {chance.uniform(1.0, 4.0):.4g}}}"],
        [f"delay_margin_s: {{at_least: {chance.uniform(0.05, 0.15) * t:.5g}}}"],
        [f"crossover_rad_s: {{at_most: {chance.uniform(0.4, 1.5) / t:.5g}}}"],
        [f"control_sensitivity_db: {{at_most: {chance.uniform(6.0, 14.0) - 1.2 * g:.4g}}}, from_rad_s: {10.0 / t:.5g}"],
    )
    return [peak, *chance.choice(more[:-2] if kind == "unstable" else more)]


if __name__ == "__main__":
    sys.stdout.write(spec_text(int(sys.argv[1]) if len(sys.argv) > 1 else 0))
