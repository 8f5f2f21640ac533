"""Random specs with requirements and objectives of scenarios:  seed -> YAML; time scales from 10 ms to 100 s."""

from __future__ import annotations

import math

import numpy as np


def spec_text(seed: int) -> str:
    """The spec of a seed."""
    rng = np.random.default_rng(seed)

    def sized(low: float, high: float) -> float:
        return float(f"{math.exp(rng.uniform(math.log(low), math.log(high))):.4g}")

    time_s, gain, step = sized(0.01, 100.0), sized(0.2, 20.0), sized(0.5, 20.0)
    kind = int(rng.integers(0, 5))
    dead = f"{time_s * sized(0.05, 0.6):.4g}" if rng.random() < 0.5 else "0"
    plant = _plant(rng, kind, time_s, gain, dead)
    # the control that moves the output by 1: of an integrator in its own time
    unit = 1.0 / gain if kind != 4 else 1.0 / (gain * time_s)
    loop = [f"sensitivity_db: {{at_most: {rng.uniform(2.5, 6.0):.3g}}}"]
    if rng.random() < 0.5:
        loop.append(f"phase_margin_deg: {{at_least: {rng.uniform(35.0, 65.0):.3g}}}")
    measured = {
        0: [f"overshoot: {{at_most: {step * rng.uniform(0.0, 0.15):.3g}}}"],
        1: [f"peak_control: {{at_most: {step * unit * rng.uniform(1.1, 3.0):.3g}}}"],
        2: [f"peak_rate_per_s: {{at_most: {step / time_s * rng.uniform(0.2, 0.8):.3g}}}"],
        3: [
            f"overshoot: {{at_most: {step * rng.uniform(0.02, 0.15):.3g}}}",
            f"settling_time_s: {{at_most: {time_s * rng.uniform(6.0, 15.0):.3g}}}",
        ],
        4: [f"ise: {{at_most: {step * step * time_s * 2.0:.3g}}}"],
        5: [],
    }[int(rng.integers(0, 6))]
    aim = ("iae", "ise", "iae", "peak_rate_per_s", "iae", "overshoot")[int(rng.integers(0, 6))]
    scenario = "push" if aim in ("overshoot", "peak_rate_per_s") or rng.random() < 0.5 else "go"
    limits = (
        f", output_limits: [{-step * unit:.3g}, {step * unit * rng.uniform(1.2, 2.5):.3g}]"
        if rng.random() < 0.3
        else ""
    )
    ramp = f", ramp_s: {time_s * rng.uniform(1.0, 4.0):.3g}" if rng.random() < 0.3 else ""
    lines = [*loop, *(f"{{{each}, scenario: go}}" for each in measured)]
    duration = f"{time_s * rng.uniform(15.0, 30.0):.4g}"
    return "\n".join(
        [
            "schema: 1",
            f"name: random_{seed}",
            f"plant: {plant}",
            f"controller: {{kp: {{min: 0, max: {100.0 * unit:.4g}}}, ki: {{min: 0, max: {100.0 * unit / time_s:.4g}}}, "
            "alpha: {min: 0.4, max: 1.5}}",
            "requirements:",
            *(f"  - {line}" for line in lines),
            f"objective: {{minimize: {aim}, scenario: {scenario}}}",
            f"digital: {{sample_time_s: {time_s * sized(0.03, 0.15):.3g}, band_rad_s: [{1e-3 / time_s:.3g}, "
            f"{1e3 / time_s:.3g}], delay_samples: {int(rng.integers(0, 2))}{limits}}}",
            "scenarios:",
            f"  - {{name: go, duration_s: {duration}, reference: [{{at_s: 0, value: {step}{ramp}}}]}}",
            f"  - {{name: push, duration_s: {duration}, reference: [{{at_s: 0, value: 0}}], "
            f"load: [{{at_s: 0, value: {step * unit:.3g}}}]}}",
            "",
        ]
    )


def _plant(rng: np.random.Generator, kind: int, time_s: float, gain: float, dead: str) -> str:
    wide = float(rng.uniform(1.2, 2.5))
    lag = f"time_constant_s: {{min: {time_s}, max: {time_s * wide:.4g}}}, dead_time_s: {dead}"
    if kind == 0:
        return f"{{model: lag, static_gain: {gain}, {lag}}}"
    if kind == 1:
        return f"{{model: lag, static_gain: {{min: {gain}, max: {gain * rng.uniform(1.1, 1.8):.4g}}}, {lag}}}"
    if kind == 2:
        ends = f"{{min: {0.3 / time_s:.4g}, max: {1.0 / time_s:.4g}}}"
        return f"{{model: pole, gain: {gain / time_s:.4g}, pole_rad_s: {ends}, dead_time_s: {dead}}}"
    damping = f"{{min: {time_s * 0.8:.4g}, max: {time_s * 1.4:.4g}}}"
    bottom = f"[{time_s * time_s * 0.25:.4g}, {damping}, 1]" if kind == 3 else f"[{damping}, 1, 0]"
    return f"{{model: transfer_function, numerator: [{gain}], denominator: {bottom}, dead_time_s: {dead}}}"
