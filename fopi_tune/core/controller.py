"""The controller that is designed:  C(s) = kp + ki s^-alpha."""

from __future__ import annotations

import math
from dataclasses import dataclass

from fopi_tune.errors import DomainError

ALPHA_MIN = 0.0
ALPHA_MAX = 2.0


@dataclass(frozen=True)
class FoPi:
    """Gains of the fractional PI controller C(s) = kp + ki s^-alpha, on the principal branch.

    Args:
        kp: proportional gain, in control per output unit; any sign.
        ki: integral gain, in kp's unit times (rad/s)^alpha; any sign.
        alpha: order of the integral, 0 < alpha < 2; 1 is the ordinary PI.

    Raises:
        DomainError: a gain is not finite, or alpha lies outside (0, 2).
    """

    kp: float
    ki: float
    alpha: float

    def __post_init__(self) -> None:
        for name in ("kp", "ki", "alpha"):
            value = getattr(self, name)
            if not math.isfinite(value):
                raise DomainError(f"{name} = {value!r} is not a finite number; give a finite gain")
        if not ALPHA_MIN < self.alpha < ALPHA_MAX:
            raise DomainError(f"alpha = {self.alpha!r} lies outside (0, 2); s^-alpha is an integrator only inside")
