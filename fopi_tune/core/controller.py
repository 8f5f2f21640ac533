"""The controllers that are designed:  F(s) (kp + ki s^-alpha + kd s^mu/(Tf s + 1)), and its special cases.

A PID is that with alpha = mu = 1; without the derivative it is kp + ki s^-alpha.  F filters the measurement before all
terms, 1/(1 + sT) or 1/(1 + sT + s^2 T^2/2); without one F = 1.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from typing import TYPE_CHECKING, NamedTuple

from fopi_tune.core.terms.measurement_filter import (
    MeasurementFilter,
    check_finite,
    filter_not_available,
    filter_numbers,
    filter_of,
)
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

    Raises:
        DomainError: a gain is not finite, or alpha lies outside (0, 2).
    """

    kp: float
    ki: float
    alpha: float
    measurement_filter: MeasurementFilter | None = field(default=None, kw_only=True)

    def __repr__(self) -> str:
        numbers = [each.name for each in fields(self) if each.repr and each.name != "measurement_filter"]
        shown = [*numbers, "measurement_filter"] if self.measurement_filter is not None else numbers
        return f"{type(self).__name__}({', '.join(f'{name}={getattr(self, name)!r}' for name in shown)})"

    def __post_init__(self) -> None:
        for name in ("kp", "ki", "alpha"):
            check_finite(name, getattr(self, name))
        if not ALPHA_MIN < self.alpha < ALPHA_MAX:
            raise DomainError(f"alpha = {self.alpha!r} lies outside (0, 2); s^-alpha is an integrator only inside")
        if not isinstance(self.measurement_filter, MeasurementFilter | None):
            raise DomainError(f"measurement_filter = {self.measurement_filter!r} is none; give a MeasurementFilter")

    @property
    def is_zero(self) -> bool:
        """Whether C = 0: there is no controller."""
        return self.kp == 0.0 and self.ki == 0.0

    def __call__(self, s: complex | NDArray[np.complexfloating]) -> NDArray[np.complex128]:
        """C(s), filter included, at complex numbers of any shape, s not 0 where there is an integral."""
        import numpy as np  # the command line reads gains before it needs arrays

        points = np.asarray(s, dtype=complex)
        terms = self._terms(points)
        return terms if self.measurement_filter is None else self.measurement_filter(points) * terms

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

    Raises:
        DomainError: a gain is not finite, alpha or mu lies outside its range, or Tf is not a positive number.
    """

    kd: float
    mu: float
    derivative_filter_time_constant_s: float

    def __post_init__(self) -> None:
        super().__post_init__()
        for name in (*DERIVATIVE_NAMES, ORDER_NAME):
            check_finite(name, getattr(self, name))
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

    Raises:
        DomainError: a gain is not finite, or Tf is not a positive number.
    """

    alpha: float = field(default=1.0, init=False)
    mu: float = field(default=1.0, init=False, repr=False)


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
    filtered = filter_of(numbers)
    if "kd" not in numbers:
        return FoPi(kp, ki, alpha, measurement_filter=filtered)
    kd, filter_s = (numbers[name] for name in DERIVATIVE_NAMES)
    if ORDER_NAME in numbers:
        return FoPid(kp, ki, alpha, kd, numbers[ORDER_NAME], filter_s, measurement_filter=filtered)
    if alpha != 1.0:
        raise DomainError(f"alpha = {alpha!r} beside a kd without mu; the integral of a PID has order 1")
    return Pid(kp, ki, kd, filter_s, measurement_filter=filtered)


def numbers_of(controller: FoPi) -> dict[str, float]:
    """The controller's numbers by name, the inverse of `controller_of`."""
    numbers = {"kp": controller.kp, "ki": controller.ki, "alpha": controller.alpha}
    if isinstance(controller, FoPid):
        numbers |= {name: getattr(controller, name) for name in DERIVATIVE_NAMES}
        numbers |= {} if isinstance(controller, Pid) else {ORDER_NAME: controller.mu}
    filtered = controller.measurement_filter
    return numbers if filtered is None else numbers | filter_numbers(filtered)


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
        derivative_filter_time_constant_s: Tf of kd s^mu/(Tf s + 1); 0 where there is no derivative.
        setpoint_weight: b of kp (b r - y), any finite number; the loop does not depend on it.
        mu: order of the derivative, of structure fopid alone; else None.
        measurement_filter: F, of the measurement before all terms; None is 1.
    """

    kp: GainRange
    ki: GainRange
    alpha: GainRange
    kd: GainRange = NO_TERM
    derivative_filter_time_constant_s: float = 0.0
    setpoint_weight: float = 1.0
    mu: GainRange | None = None
    measurement_filter: MeasurementFilter | None = None

    @property
    def has_derivative(self) -> bool:
        """Whether the structure is pid or fopid."""
        return self.derivative_filter_time_constant_s > 0.0

    @property
    def has_derivative_order(self) -> bool:
        """Whether the structure is fopid."""
        return self.mu is not None

    @property
    def structure(self) -> str:
        """Its word in a spec; "fopi" also of a pi."""
        return "fopid" if self.has_derivative_order else "pid" if self.has_derivative else "fopi"

    @property
    def ranges(self) -> dict[str, GainRange]:
        """The range of each number that may be free, by name."""
        by_structure = {"fopid": ("kp", "ki", "alpha", "kd", "mu"), "pid": ("kp", "ki", "kd")}
        return {name: getattr(self, name) for name in by_structure.get(self.structure, ("kp", "ki", "alpha"))}

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
        order = {} if self.mu is None else {"mu": self.mu.min}
        return self.controller(self.kp.min, self.ki.min, self.alpha.min, self.kd.min, **order)

    def has_structure_of(self, controller: FoPi) -> bool:
        """Whether a controller is of this structure: with the same filters, or without a derivative.

        A `Pid` is one of structure fopid too.
        """
        filter_s = controller.derivative_filter_time_constant_s if isinstance(controller, FoPid) else 0.0
        is_of = isinstance(controller, FoPid) if self.has_derivative_order else structure_of(controller) != "fopid"
        same = controller.measurement_filter == self.measurement_filter
        return is_of and same and filter_s == self.derivative_filter_time_constant_s

    def refuse_derivative(self, what: str) -> None:
        """Refuse a stage that does not know the derivative.

        Raises:
            DomainError: the structure is pid or fopid.
        """
        if self.has_derivative:
            raise DomainError(not_available(what, self.structure))

    def refuse_derivative_order(self, what: str) -> None:
        """Refuse a stage that knows no derivative, or that of a PID alone.

        Raises:
            DomainError: the structure is fopid.
        """
        if self.has_derivative_order:
            raise DomainError(not_available(what, self.structure))

    def refuse_measurement_filter(self, what: str) -> None:
        """Refuse a stage that does not know the measurement filter.

        Raises:
            DomainError: the measurement is filtered.
        """
        if self.measurement_filter is not None:
            raise DomainError(filter_not_available(what))

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

    def controller(self, kp: float, ki: float, alpha: float, kd: float = 0.0, mu: float = 1.0) -> FoPi:
        """The controller with these gains in this box's structure."""
        filter_s, filtered = self.derivative_filter_time_constant_s, self.measurement_filter
        if self.has_derivative_order:
            return FoPid(kp, ki, alpha, kd, mu, filter_s, measurement_filter=filtered)
        if self.has_derivative:
            return Pid(kp, ki, kd, filter_s, measurement_filter=filtered)
        return FoPi(kp, ki, alpha, measurement_filter=filtered)
