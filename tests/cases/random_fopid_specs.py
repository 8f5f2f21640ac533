"""Random specs with `structure: fopid` by seed:  those of `random_pid_specs`, with orders."""

from __future__ import annotations

import random
import re

from cases.random_pid_specs import pid_spec


def fopid_spec(seed: int, sampled: bool = False) -> str:
    """A random spec whose noise gain is limited; alpha and mu are free.

    Args:
        seed: of the spec.
        sampled: whether it is about the loop on samples, with a filter of a few poles; else in continuous time.
    """
    chance = random.Random(seed + 77)
    alpha, mu = (chance.uniform(0.4, 0.7), chance.uniform(1.1, 1.5)), chance.uniform(0.3, 0.6)
    orders = f"alpha: {{min: {alpha[0]:.3g}, max: {alpha[1]:.3g}}}, mu: {{min: {mu:.3g}, max: 1}}"
    lines = [line for line in pid_spec(seed).splitlines() if not line.startswith("digital:")]
    if sampled:
        filter_s = float(re.findall(r"derivative_filter_time_constant_s: ([0-9.e+-]+)", "\n".join(lines))[0])
        band = f"[{1e-4 / filter_s:.3g}, {10.0 / filter_s:.3g}], poles: {chance.randint(4, 8)}"
        time_s, delay = filter_s * chance.uniform(0.4, 1.8), chance.choice([0, 0, 1, 0.5])
        lines += [
            f"digital: {{sample_time_s: {time_s:.6g}, delay_samples: {delay}, design: sampled, band_rad_s: {band}}}"
        ]
    return "\n".join(lines).replace("structure: pid,", f"structure: fopid, {orders},") + "\n"
