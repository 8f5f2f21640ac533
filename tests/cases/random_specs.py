"""Random specs by seed:  every kind of plant, objective and time scale, with limits that can often be met."""

from __future__ import annotations

import random

KINDS = ("lag", "second", "resonant", "third", "integrator", "unstable", "zero")
OBJECTIVES = (
    "maximize: ki",
    "minimize: iae_disturbance",
    "minimize: sensitivity_peak_db",
    "minimize: control_sensitivity_peak_db",
    "minimize: phase_margin_spread_deg",
    "minimize: crossover_spread_db",
    "",
)


def random_spec(seed: int) -> str:
    """The text of the spec of a seed."""
    chance = random.Random(seed)
    scale = 10.0 ** chance.choice((-5.0, -2.0, 0.0, 0.0, 0.0, 2.0, 4.0))
    kind, objective = chance.choice(KINDS), chance.choice(OBJECTIVES + OBJECTIVES[:2])
    plant, gain, unit = _plant(kind, chance, scale)
    slow = round(chance.uniform(0.3, 0.8), 2)
    controller = (
        f"{{kp: {{min: 0, max: {50 / gain:.6g}}}, ki: {{min: 0, max: {50 / gain / unit**1.5:.6g}}}, "
        f"alpha: {{min: {slow}, max: {chance.uniform(1.1, 1.6):.2f}}}}}"
    )
    requirements = _requirements(objective, chance, gain, unit)
    lines = [f"schema: 1\nname: random{seed}\nplant: {plant}\ncontroller: {controller}\nrequirements:"]
    lines += [f"  - {{{requirement}}}" for requirement in requirements]
    if objective:
        lines.append(f"objective: {{{objective}}}")
    return "\n".join(lines) + "\n"


def _plant(kind: str, chance: random.Random, scale: float) -> tuple[str, float, float]:
    """A plant, its rough gain at its rough time."""

    def about(value: float, spread: float) -> str:
        if chance.random() < 0.4:
            return f"{value:.6g}"
        low, high = value * (1 - spread * chance.uniform(0.4, 1)), value * (1 + spread * chance.uniform(0.4, 1))
        return f"{{nominal: {value:.6g}, min: {min(low, high):.6g}, max: {max(low, high):.6g}}}"

    gain, time = chance.uniform(0.4, 3.0), chance.uniform(0.5, 3.0) * scale
    delay = chance.uniform(0.05, 0.6) * time
    if kind == "lag":
        return (
            f"{{model: lag, static_gain: {about(gain, 0.3)}, time_constant_s: {about(time, 0.4)}, "
            f"dead_time_s: {about(delay, 0.3)}}}", gain, time,
        )  # fmt: skip
    if kind == "integrator":
        return (
            f"{{model: pole, gain: {about(gain / time, 0.3)}, pole_rad_s: 0, dead_time_s: {about(0.3 * delay, 0.2)}}}",
            gain, time,
        )  # fmt: skip
    if kind == "unstable":
        return (
            f"{{model: pole, gain: {about(gain / time, 0.15)}, pole_rad_s: {about(-0.5 / time, 0.15)}, "
            f"dead_time_s: {0.08 * time:.6g}}}", gain, time,
        )  # fmt: skip
    if kind == "second":
        lines = [about(gain, 0.3)], [about(0.25 * time**2, 0.3), about(1.3 * time, 0.2), "1"], 0.1 * delay
    elif kind == "resonant":
        damping = 2.0 * chance.uniform(0.06, 0.3) * time
        lines = [about(1.0, 0.2)], [f"{time**2:.6g}", f"{damping:.6g}", about(1.0, 0.15)], 0.02 * time
        gain = 1.0
    elif kind == "third":
        lines = [about(gain, 0.3)], [f"{0.1 * time**3:.6g}", about(0.9 * time**2, 0.15), f"{1.9 * time:.6g}", "1"], 0.0
    else:
        lines = [f"{-0.2 * gain * time:.6g}", f"{gain:.6g}"], [about(time**2, 0.2), about(2.2 * time, 0.2), "1"], 0.0
    numerator, denominator, dead_time = lines
    return (
        f"{{model: transfer_function, numerator: [{', '.join(numerator)}], denominator: [{', '.join(denominator)}], "
        f"dead_time_s: {dead_time:.6g}}}", gain, time,
    )  # fmt: skip


def _requirements(objective: str, chance: random.Random, gain: float, time: float) -> list[str]:
    slow = f"to_rad_s: {0.05 / time:.6g}"
    if "control" in objective:
        peak = f"sensitivity_db: {{at_most: {chance.uniform(4, 6):.4g}}}"
        return [f"sensitivity_db: {{at_most: {-chance.uniform(5, 10):.4g}}}, {slow}", peak]
    if "sensitivity" in objective:
        effort = f"control_sensitivity_db: {{at_most: {16 - 6 * gain:.4g}}}"
        return [f"sensitivity_db: {{at_most: {-chance.uniform(6, 11):.4g}}}, {slow}", effort]
    if "spread" in objective:
        margin = f"phase_margin_deg: {{at_least: {chance.uniform(30, 45):.4g}}}"
        crossover = f"crossover_rad_s: {{at_least: {chance.uniform(0.2, 0.4) / time:.6g}}}, on: nominal"
        return [margin, crossover, f"sensitivity_db: {{at_most: {-chance.uniform(4, 8):.4g}}}, {slow}"]
    peak = f"sensitivity_db: {{at_most: {chance.uniform(3.5, 6):.4g}}}"
    if not objective:
        return [
            peak,
            "phase_margin_deg: {at_least: 35}",
            f"sensitivity_db: {{at_most: {-chance.uniform(4, 8):.4g}}}, {slow}",
        ]
    more = [
        [],
        [f"phase_margin_deg: {{at_least: {chance.uniform(30, 60):.4g}}}"],
        [f"gain_margin_db: {{at_least: {chance.uniform(6, 10):.4g}}}"],
        [f"complementary_sensitivity_db: {{at_most: {chance.uniform(1.5, 4):.4g}}}"],
        ["phase_margin_deg: {at_least: 40}", f"delay_margin_s: {{at_least: {0.1 * time:.6g}}}"],
    ]
    return [peak, *chance.choice(more)]
