"""The controllers that are designed:  kp + ki s^-alpha, and kp + ki/s + kd s/(Tf s + 1)."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from fopi_tune.errors import DomainError

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

ALPHA_MIN = 0.0
ALPHA_MAX = 2.0
#: names of a derivative's numbers, in documents and specs
DERIVATIVE_NAMES = ("kd", "derivative_filter_time_constant_s")


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
            check_finite(name, getattr(self, name))
        if not ALPHA_MIN < self.alpha < ALPHA_MAX:
            raise DomainError(f"alpha = {self.alpha!r} lies outside (0, 2); s^-alpha is an integrator only inside")

    @property
    def is_zero(self) -> bool:
        """Whether C = 0: there is no controller."""
        return self.kp == 0.0 and self.ki == 0.0

    def __call__(self, s: complex | NDArray[np.complexfloating]) -> NDArray[np.complex128]:
        """C(s) at complex numbers of any shape, s not 0 where there is an integral."""
        import numpy as np  # the command line reads gains before it needs arrays

        points = np.asarray(s, dtype=complex)
        integral = self.ki * points**-self.alpha if self.ki != 0.0 else np.zeros_like(points)
        return np.asarray(self.kp + integral, dtype=complex)


@dataclass(frozen=True)
class Pid(FoPi):
    """Gains of C(s) = kp + ki/s + kd s/(Tf s + 1).

    Args:
        kp: proportional gain, in control per output unit; any sign.
        ki: integral gain, in kp's unit times rad/s; any sign.
        alpha: order of the integral, dimensionless: 1.
        kd: derivative gain, in kp's unit times s; any sign.
        derivative_filter_time_constant_s: Tf > 0, s; it keeps |C| finite as omega -> infinity, where C -> kp + kd/Tf.

    Raises:
        DomainError: a gain is not finite, or Tf is not a positive number.
    """

    alpha: float = field(default=1.0, init=False)
    kd: float
    derivative_filter_time_constant_s: float

    def __post_init__(self) -> None:
        super().__post_init__()
        for name in DERIVATIVE_NAMES:
            check_finite(name, getattr(self, name))
        if not self.derivative_filter_time_constant_s > 0.0:
            raise DomainError(
                f"derivative_filter_time_constant_s = {self.derivative_filter_time_constant_s!r} must be greater than "
                "0; without a filter the derivative's gain grows without end"
            )

    @property
    def is_zero(self) -> bool:
        """Whether C = 0: there is no controller."""
        return super().is_zero and self.kd == 0.0

    def __call__(self, s: complex | NDArray[np.complexfloating]) -> NDArray[np.complex128]:
        """C(s) at complex numbers of any shape, s not 0 where there is an integral."""
        import numpy as np  # the command line reads gains before it needs arrays

        points = np.asarray(s, dtype=complex)
        return super().__call__(points) + self.kd * points / (self.derivative_filter_time_constant_s * points + 1.0)


def check_finite(name: str, value: float) -> None:
    """Refuse a gain that is no finite number.

    Raises:
        DomainError: it is not.
    """
    if not math.isfinite(value):
        raise DomainError(f"{name} = {value!r} is not a finite number; give a finite gain")


def derivative_of(controller: FoPi) -> tuple[float, float]:
    """kd and Tf of a controller; (0, 1 s) without a derivative."""
    if isinstance(controller, Pid):
        return controller.kd, controller.derivative_filter_time_constant_s
    return 0.0, 1.0


def refuse_derivative_in(controller: FoPi, what: str) -> None:
    """Refuse a computation that knows kp + ki s^-alpha alone.

    Raises:
        DomainError: the controller has a derivative.
    """
    if derivative_of(controller)[0] != 0.0:
        raise DomainError(f"{what} is not available for structure: pid in this version; leave it out")


def controller_of(numbers: Mapping[str, float]) -> FoPi:
    """The controller with these numbers by name, as results hold them: a `Pid` where there is a kd.

    Raises:
        DomainError: as of the controllers themselves; a derivative beside an alpha other than 1.
    """
    kp, ki, alpha = numbers["kp"], numbers["ki"], numbers.get("alpha", 1.0)
    if "kd" not in numbers:
        return FoPi(kp, ki, alpha)
    if alpha != 1.0:
        raise DomainError(f"alpha = {alpha!r} beside a kd; the integral of a controller with a derivative has order 1")
    return Pid(kp, ki, numbers["kd"], numbers["derivative_filter_time_constant_s"])


def numbers_of(controller: FoPi) -> dict[str, float]:
    """The controller's numbers by name, the inverse of `controller_of`."""
    numbers = {"kp": controller.kp, "ki": controller.ki, "alpha": controller.alpha}
    if isinstance(controller, Pid):
        numbers |= {name: getattr(controller, name) for name in DERIVATIVE_NAMES}
    return numbers


@dataclass(frozen=True)
class GainRange:
    """Where a gain may lie; an end the spec leaves open is infinite, min == max fixes the gain."""

    min: float = -math.inf
    max: float = math.inf

    @property
    def is_fixed(self) -> bool:
        """Whether the spec prescribes the gain."""
        return self.min == self.max


#: of a term that a structure does not have
NO_TERM = GainRange(0.0, 0.0)


@dataclass(frozen=True)
class ControllerSpec:
    """The box of gains to search.

    Args:
        kp: proportional gain.
        ki: integral gain.
        alpha: order of the integral.
        kd: derivative gain; fixed at 0 where there is no derivative.
        derivative_filter_time_constant_s: Tf of kd s/(Tf s + 1); 0 where there is no derivative.
        setpoint_weight: b of kp (b r - y), any finite number; the loop does not depend on it.
    """

    kp: GainRange
    ki: GainRange
    alpha: GainRange
    kd: GainRange = NO_TERM
    derivative_filter_time_constant_s: float = 0.0
    setpoint_weight: float = 1.0

    @property
    def has_derivative(self) -> bool:
        """Whether the structure is pid."""
        return self.derivative_filter_time_constant_s > 0.0

    @property
    def ranges(self) -> dict[str, GainRange]:
        """The range of each number that may be free, by name."""
        names = ("kp", "ki", "kd") if self.has_derivative else ("kp", "ki", "alpha")
        return {name: getattr(self, name) for name in names}

    @property
    def names(self) -> str:
        """The numbers that may be free, in words: "kp, ki and alpha"."""
        *others, last = self.ranges
        return f"{', '.join(others)} and {last}"

    @property
    def fixed(self) -> FoPi | None:
        """The controller that the box prescribes when it leaves nothing free; else None."""
        if not all(gain.is_fixed for gain in self.ranges.values()):
            return None
        return self.controller(self.kp.min, self.ki.min, self.alpha.min, self.kd.min)

    def has_structure_of(self, controller: FoPi) -> bool:
        """Whether a controller is of this structure: with the same filter of a derivative, or without a derivative."""
        filter_s = controller.derivative_filter_time_constant_s if isinstance(controller, Pid) else 0.0
        return filter_s == self.derivative_filter_time_constant_s

    def refuse_derivative(self, what: str) -> None:
        """Refuse a stage that does not know the derivative.

        Raises:
            DomainError: the structure is pid.
        """
        if self.has_derivative:
            raise DomainError(f"{what} is not available for structure: pid in this version; leave it out")

    def refuse_setpoint_weight(self, what: str) -> None:
        """Refuse a stage that knows the control error alone.

        Raises:
            DomainError: the setpoint has a weight other than 1.
        """
        if self.setpoint_weight != 1.0:
            raise DomainError(
                f"{what} is not available with setpoint_weight {self.setpoint_weight:g} in this version; leave it out, "
                "or write setpoint_weight: 1"
            )

    def controller(self, kp: float, ki: float, alpha: float, kd: float = 0.0) -> FoPi:
        """The controller with these gains in this box's structure."""
        if self.has_derivative:
            return Pid(kp, ki, kd, self.derivative_filter_time_constant_s)
        return FoPi(kp, ki, alpha)
