"""Random specs with `structure: pid` by seed:  those of `random_specs`, in continuous time and on samples."""

from __future__ import annotations

import math
import random
import re

from cases.random_specs import random_spec


def pid_spec(seed: int) -> str:
    """A random spec of a PID whose noise gain is limited, a third of them with `design: sampled`."""
    chance, text, tried = random.Random(seed + 31), "spread", 0
    while "spread" in text:
        text, tried = random_spec(1000 * seed + tried), tried + 1
    found = re.search(r"controller: \{kp: \{min: 0, max: ([0-9.e+-]+)\}, ki: \{min: 0, max: ([0-9.e+-]+)\}.*\n", text)
    assert found is not None
    gain = 50.0 / float(found[1])
    unit = (50.0 / gain / float(found[2])) ** (2.0 / 3.0)
    filter_s = unit * chance.uniform(0.02, 0.1)
    most = 50.0 / gain
    controller = (
        f"controller: {{structure: pid, kp: {{min: 0, max: {most:.6g}}}, ki: {{min: 0, max: {most / unit:.6g}}}, "
        f"kd: {{min: 0, max: {most * unit:.6g}}}, derivative_filter_time_constant_s: {filter_s:.6g}}}\n"
    )
    text = text.replace(found[0], controller)
    if "control_sensitivity" not in text:
        effort = f"control_sensitivity_db: {{at_most: {20.0 * math.log10(chance.uniform(4.0, 14.0) / gain):.4g}}}"
        text = text.replace("requirements:\n", f"requirements:\n  - {{{effort}}}\n", 1)
    if chance.random() < 0.35:
        time_s, delay = filter_s * chance.uniform(0.4, 1.8), chance.choice([0, 0, 1, 0.5])
        band = f"band_rad_s: [{1e-3 / unit:.3g}, {1.0 / unit:.3g}]"
        text += f"digital: {{sample_time_s: {time_s:.6g}, delay_samples: {delay}, design: sampled, {band}}}\n"
    return text
