"""Random specs with `design: sampled` by seed:  those of `random_specs`, with samples and filters of all kinds."""

from __future__ import annotations

import math
import random
import re

import numpy as np
from cases.random_specs import random_spec

import fopi_tune as ft
from fopi_tune.core.loops import Plants


def sampled_spec(seed: int) -> str:
    """A random spec with a section digital: samples from fast to a fifth of Nyquist at the crossover."""
    chance, text = random.Random(seed + 7), random_spec(seed)
    times = [float(word) for word in _times(text)]
    unit = math.exp(sum(map(math.log, times)) / len(times))
    time_s = float(f"{unit * 10.0 ** chance.uniform(-1.6, -0.4):.3g}")
    options = [f"sample_time_s: {time_s}", f"delay_samples: {chance.choice([0, 0, 1, 0.5])}", "design: sampled"]
    options.append(f"band_rad_s: [{1e-3 / unit:.3g}, {1e3 / unit:.3g}]")
    options.append(f"method: {chance.choice(['oustaloup', 'oustaloup', 'modified_oustaloup'])}")
    options.append(f"poles: {chance.choice([5, 7, 7, 9])}")
    if chance.random() < 0.2:
        options.append(chance.choice(["rule: matched", "prewarp: crossover"]))
    if chance.random() < 0.2:
        text = text.replace("alpha: {min", "alpha: 0.9 #", 1) if "alpha: {min" not in text else _fixed_order(text)
    if chance.random() < 0.4:
        limits = (
            f"gain_margin_db: {{at_least: {chance.uniform(5, 9):.2f}}}",
            f"delay_margin_s: {{at_least: {0.3 * unit:.4g}}}",
        )
        text = text.replace("requirements:\n", f"requirements:\n  - {{{chance.choice(limits)}}}\n", 1)
    if chance.random() < 0.15:
        text = _negated(text)
    return f"{text}digital: {{{', '.join(options)}}}\n"


def _times(text: str) -> list[float]:
    """The plant's time constants, roughly: 1/|root| of its nominal member."""
    family = ft.parse_spec(text).plant
    plants = Plants.members(family, family.nominal_point[None, :])
    roots = np.concatenate([plants.poles.ravel(), plants.zeros.ravel()])
    sizes = np.abs(roots[np.isfinite(roots) & (roots != 0)])
    own = [1.0 / size for size in sizes] + [float(d) for d in plants.dead_time_s if d > 0]
    return own or [1.0]


def _fixed_order(text: str) -> str:
    start = text.index("alpha: {min")
    return f"{text[:start]}alpha: 0.9{text[text.index('}', start) + 1 :]}"


def _negated(text: str) -> str:
    """The same spec with a plant and gains of the other sign, where the plant's gain is a plain number or range."""
    if "maximize: ki" in text or "static_gain" not in text:
        return text
    start = text.index("static_gain: ") + len("static_gain: ")
    end = text.index("}", start) + 1 if text[start] == "{" else text.index(",", start)
    part = text[start:end]
    numbers = {k: float(v) for k, v in re.findall(r"(nominal|min|max): ([0-9.e+-]+)", part)}
    new = f"-{part}" if not numbers else (
        f"{{nominal: {-numbers['nominal']}, min: {-numbers['max']}, max: {-numbers['min']}}}"
    )  # fmt: skip
    text = text[:start] + new + text[end:]
    return re.sub(r"(kp|ki): \{min: 0, max: ([0-9.e+-]+)\}", r"\1: {min: -\2, max: 0}", text)
