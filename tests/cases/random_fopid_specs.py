"""Random specs with `structure: fopid` by seed:  those of `random_pid_specs` in continuous time, with orders."""

from __future__ import annotations

import random

from cases.random_pid_specs import pid_spec


def fopid_spec(seed: int) -> str:
    """A random spec whose noise gain is limited; alpha and mu are free."""
    chance = random.Random(seed + 77)
    alpha, mu = (chance.uniform(0.4, 0.7), chance.uniform(1.1, 1.5)), chance.uniform(0.3, 0.6)
    orders = f"alpha: {{min: {alpha[0]:.3g}, max: {alpha[1]:.3g}}}, mu: {{min: {mu:.3g}, max: 1}}"
    lines = [line for line in pid_spec(seed).splitlines() if not line.startswith("digital:")]
    return "\n".join(lines).replace("structure: pid,", f"structure: fopid, {orders},") + "\n"
