"""The controllers that are designed:  F(s) (kp + ki s^-alpha + kd s^mu/(Tf s + 1)), and its special cases.

A PID is that with alpha = mu = 1; without the derivative it is kp + ki s^-alpha.  F filters the measurement before all
terms, 1/(1 + sT) or 1/(1 + sT + s^2 T^2/2); without one F = 1.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from typing import TYPE_CHECKING, Any, NamedTuple

from fopi_tune.core.terms.measurement_filter import (
    MeasurementFilter,
    filter_not_available,
    filter_numbers,
    filter_of,
)
from fopi_tune.core.terms.numbers import keep_plain, values_at
from fopi_tune.errors import DomainError

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

ALPHA_MIN = 0.0
ALPHA_MAX = 2.0
#: the order of the derivative up to which |C| stays finite as omega -> infinity
MU_MAX = 1.0
#: names of a derivative's numbers, in documents and specs; that of its order, which a PID does not have
DERIVATIVE_NAMES = ("kd", "derivative_filter_time_constant_s")
ORDER_NAME = "mu"
#: b, where it was designed
WEIGHT_NAME = "setpoint_weight"
#: why a larger order is refused
IMPROPER = (
    "with mu above 1 the controller is improper: behind the filter of first order its gain grows without end with the "
    "frequency"
)


@dataclass(frozen=True, repr=False)
class FoPi:
    """Gains of the fractional PI controller C(s) = F(s) (kp + ki s^-alpha), on the principal branch.

    Args:
        kp: proportional gain, in control per output unit; any sign.
        ki: integral gain, in kp's unit times (rad/s)^alpha; any sign.
        alpha: order of the integral, 0 < alpha < 2; 1 is the ordinary PI.
        measurement_filter: F; None is 1.
        setpoint_weight: b of kp (b r - y), dimensionless; the loop does not depend on it; None is that of the spec.

    Raises:
        DomainError: a gain is not finite, or alpha lies outside (0, 2).
    """

    kp: float
    ki: float
    alpha: float
    measurement_filter: MeasurementFilter | None = field(default=None, kw_only=True)
    setpoint_weight: float | None = field(default=None, kw_only=True)

    def __repr__(self) -> str:
        names = [each.name for each in fields(self) if each.repr]
        # those of FoPi that may be absent come last
        absent = ("measurement_filter", WEIGHT_NAME)
        shown = [name for name in names if name not in absent]
        shown += [name for name in absent if getattr(self, name) is not None]
        return f"{type(self).__name__}({', '.join(f'{name}={getattr(self, name)!r}' for name in shown)})"

    def __post_init__(self) -> None:
        keep_plain(self, "kp", "ki", "alpha")
        if not ALPHA_MIN < self.alpha < ALPHA_MAX:
            raise DomainError(f"alpha = {self.alpha!r} lies outside (0, 2); s^-alpha is an integrator only inside")
        if self.setpoint_weight is not None:
            keep_plain(self, WEIGHT_NAME)
        if not isinstance(self.measurement_filter, MeasurementFilter | None):
            raise DomainError(f"measurement_filter = {self.measurement_filter!r} is none; give a MeasurementFilter")

    @property
    def is_zero(self) -> bool:
        """Whether C = 0: there is no controller."""
        return self.kp == 0.0 and self.ki == 0.0

    def __call__(self, s: complex | NDArray[np.complexfloating]) -> NDArray[np.complex128]:
        """C(s), filter included, at complex numbers of any shape, rad/s; its limits where s is 0 or infinite.

        With an integral C(0) is infinite, with the sign of ki.

        Raises:
            DomainError: s is no number.
        """

        def value(points: NDArray[np.complex128]) -> NDArray[np.complex128]:
            terms = self._terms(points)
            return terms if self.measurement_filter is None else self.measurement_filter(points) * terms

        at_zero = complex(math.copysign(math.inf, self.ki) if self.ki != 0.0 else self.kp)
        return values_at(s, value, at_zero, self._at_infinity() if self.measurement_filter is None else 0.0)

    def _at_infinity(self) -> float:
        """The limit of C(s)/F(s) as |s| grows."""
        return self.kp

    def _terms(self, points: NDArray[np.complex128]) -> NDArray[np.complex128]:
        """C(s)/F(s)."""
        import numpy as np  # the command line reads gains before it needs arrays

        return self.kp + (self.ki * points**-self.alpha if self.ki != 0.0 else np.zeros_like(points))


@dataclass(frozen=True, repr=False)
class FoPid(FoPi):
    """Gains of C(s) = F(s) (kp + ki s^-alpha + kd s^mu/(Tf s + 1)), on the principal branch.

    Args:
        kp: proportional gain, in control per output unit; any sign.
        ki: integral gain, in kp's unit times (rad/s)^alpha; any sign.
        alpha: order of the integral, 0 < alpha < 2.
        kd: derivative gain, in kp's unit times s^mu; any sign.
        mu: order of the derivative, 0 < mu <= 1.
        derivative_filter_time_constant_s: Tf > 0, s; with it |C| stays finite as omega -> infinity, where C -> kp, or
            kp + kd/Tf with mu = 1.
        measurement_filter: F; None is 1.
        setpoint_weight: b, dimensionless; None is that of the spec.

    Raises:
        DomainError: a gain is not finite, alpha or mu lies outside its range, or Tf is not a positive number.
    """

    kd: float
    mu: float
    derivative_filter_time_constant_s: float

    def __post_init__(self) -> None:
        super().__post_init__()
        keep_plain(self, *DERIVATIVE_NAMES, ORDER_NAME)
        if not self.derivative_filter_time_constant_s > 0.0:
            raise DomainError(
                f"derivative_filter_time_constant_s = {self.derivative_filter_time_constant_s!r} must be greater than "
                "0; without a filter the derivative's gain grows without end"
            )
        if not self.mu > 0.0:
            raise DomainError(f"mu = {self.mu!r} must be greater than 0; s^mu is a derivative only then")
        if self.mu > MU_MAX:
            raise DomainError(f"mu = {self.mu!r} must be at most 1; {IMPROPER}")

    @property
    def is_zero(self) -> bool:
        """Whether C = 0: there is no controller."""
        return super().is_zero and self.kd == 0.0

    def _at_infinity(self) -> float:
        return self.kp + (self.kd / self.derivative_filter_time_constant_s if self.mu == 1.0 else 0.0)

    def _terms(self, points: NDArray[np.complex128]) -> NDArray[np.complex128]:
        power = points if self.mu == 1.0 else points**self.mu
        return super()._terms(points) + self.kd * power / (self.derivative_filter_time_constant_s * points + 1.0)


@dataclass(frozen=True, repr=False)
class Pid(FoPid):
    """Gains of C(s) = F(s) (kp + ki/s + kd s/(Tf s + 1)).

    Args:
        kp: proportional gain, in control per output unit; any sign.
        ki: integral gain, in kp's unit times rad/s; any sign.
        alpha: order of the integral, dimensionless: 1.
        kd: derivative gain, in kp's unit times s; any sign.
        mu: order of the derivative, dimensionless: 1.
        derivative_filter_time_constant_s: Tf > 0, s; it keeps |C| finite as omega -> infinity, where C -> kp + kd/Tf.
        measurement_filter: F; None is 1.
        setpoint_weight: b, dimensionless; None is that of the spec.

    Raises:
        DomainError: a gain is not finite, or Tf is not a positive number.
    """

    alpha: float = field(default=1.0, init=False)
    mu: float = field(default=1.0, init=False, repr=False)


def refuse_no_gains(gains: object) -> None:
    """Refuse what is no controller, such as the gains of a design that was not solved.

    Raises:
        DomainError: it is none.
    """
    if gains is None:
        raise DomainError("there are no gains (None); a design that is not solved has none: look at its status first")
    if not isinstance(gains, FoPi):
        raise DomainError(f"{gains!r:.100} is no controller; give a FoPi, Pid or FoPid, such as `gains` of a design")


def refuse_zero_gains(gains: FoPi) -> None:
    """Refuse gains that are all 0, which make no loop.

    Raises:
        DomainError: they are.
    """
    if gains.is_zero:
        raise DomainError("all gains are 0: there is no controller, so there is no loop; give one of them a value")


class Derivative(NamedTuple):
    """The term kd s^mu/(Tf s + 1) of a controller.

    Args:
        kd: its gain; 0 without a derivative.
        mu: its order.
        filter_s: Tf, s.
    """

    kd: float = 0.0
    mu: float = 1.0
    filter_s: float = 1.0

    @property
    def largest(self) -> float:
        """The largest absolute value on the imaginary axis.

        |kd| omega^mu/sqrt(1 + (Tf omega)^2) is largest at (Tf omega)^2 = mu/(1 - mu), with mu = 1 as omega -> infinity.
        """
        mu = self.mu
        return abs(self.kd) * self.filter_s**-mu * mu ** (0.5 * mu) * (1.0 - mu) ** (0.5 * (1.0 - mu))


def derivative_of(controller: FoPi) -> Derivative:
    """The derivative term of a controller; of one without, kd = 0."""
    if isinstance(controller, FoPid):
        return Derivative(controller.kd, controller.mu, controller.derivative_filter_time_constant_s)
    return Derivative()


def structure_of(controller: FoPi) -> str:
    """The word for a controller's structure in specs."""
    return "pid" if isinstance(controller, Pid) else "fopid" if isinstance(controller, FoPid) else "fopi"


def refuse_derivative_in(controller: FoPi, what: str) -> None:
    """Refuse a computation that knows kp + ki s^-alpha alone.

    Raises:
        DomainError: the controller has a derivative.
    """
    if derivative_of(controller).kd != 0.0:
        raise DomainError(not_available(what, structure_of(controller)))


def refuse_derivative_order_in(controller: FoPi, what: str) -> None:
    """Refuse a computation that knows no derivative, or that of a PID alone.

    Raises:
        DomainError: the controller is of structure fopid.
    """
    if structure_of(controller) == "fopid":
        raise DomainError(not_available(what, "fopid"))


def refuse_measurement_filter_in(controller: FoPi, what: str) -> None:
    """Refuse a computation that knows the terms of a controller alone.

    Raises:
        DomainError: the controller filters its measurement.
    """
    if controller.measurement_filter is not None:
        raise DomainError(filter_not_available(what))


def not_available(what: str, structure: str) -> str:
    """What is said where a stage does not know a structure."""
    return f"{what} is not available for structure: {structure} in this version; leave it out"


def controller_of(numbers: Mapping[str, float]) -> FoPi:
    """The controller with these numbers by name, as results hold them: a `FoPid` where there is a mu, a `Pid` with kd.

    Raises:
        DomainError: as of the controllers themselves; kd without mu beside an alpha other than 1.
    """
    kp, ki, alpha = numbers["kp"], numbers["ki"], numbers.get("alpha", 1.0)
    more: Any = {"measurement_filter": filter_of(numbers), WEIGHT_NAME: numbers.get(WEIGHT_NAME)}
    if "kd" not in numbers:
        return FoPi(kp, ki, alpha, **more)
    kd, filter_s = (numbers[name] for name in DERIVATIVE_NAMES)
    if ORDER_NAME in numbers:
        return FoPid(kp, ki, alpha, kd, numbers[ORDER_NAME], filter_s, **more)
    if alpha != 1.0:
        raise DomainError(f"alpha = {alpha!r} beside a kd without mu; the integral of a PID has order 1")
    return Pid(kp, ki, kd, filter_s, **more)


def numbers_of(controller: FoPi) -> dict[str, float]:
    """The controller's numbers by name, the inverse of `controller_of`."""
    numbers = {"kp": controller.kp, "ki": controller.ki, "alpha": controller.alpha}
    if isinstance(controller, FoPid):
        numbers |= {name: getattr(controller, name) for name in DERIVATIVE_NAMES}
        numbers |= {} if isinstance(controller, Pid) else {ORDER_NAME: controller.mu}
    if controller.setpoint_weight is not None:
        numbers[WEIGHT_NAME] = controller.setpoint_weight
    filtered = controller.measurement_filter
    return numbers if filtered is None else numbers | filter_numbers(filtered)
