"""Where a controller's numbers may lie:  the box of gains that a spec leaves to the design."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

from fopi_tune.core.controller import (
    DERIVATIVE_NAMES,
    WEIGHT_NAME,
    FoPi,
    FoPid,
    Pid,
    not_available,
    structure_of,
)
from fopi_tune.core.terms.filter_times import FilterTimes
from fopi_tune.core.terms.measurement_filter import MeasurementFilter, filter_not_available
from fopi_tune.errors import DomainError


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
        filter_times: ranges of the filters' times that are designed; the times above are then in their middle.
        setpoint_weight_range: where b is designed; the weight above is then 1, and gains hold their own.
    """

    kp: GainRange
    ki: GainRange
    alpha: GainRange
    kd: GainRange = NO_TERM
    derivative_filter_time_constant_s: float = 0.0
    setpoint_weight: float = 1.0
    mu: GainRange | None = None
    measurement_filter: MeasurementFilter | None = None
    filter_times: FilterTimes | None = None
    setpoint_weight_range: GainRange | None = None

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
        found = {name: getattr(self, name) for name in by_structure.get(self.structure, ("kp", "ki", "alpha"))}
        return found if self.setpoint_weight_range is None else {**found, WEIGHT_NAME: self.setpoint_weight_range}

    @property
    def names(self) -> str:
        """The numbers that may be free, in words: "kp, ki and alpha"."""
        *others, last = self.ranges
        return f"{', '.join(others)} and {last}"

    @property
    def fixed(self) -> FoPi | None:
        """The controller that the box prescribes when it leaves nothing free; else None."""
        if self.filter_times is not None or not all(gain.is_fixed for gain in self.ranges.values()):
            return None
        order = {} if self.mu is None else {"mu": self.mu.min}
        return self.controller(self.kp.min, self.ki.min, self.alpha.min, self.kd.min, **order)

    def has_structure_of(self, controller: FoPi) -> bool:
        """Whether a controller is of this structure: with the same filters, or without a derivative.

        A `Pid` is one of structure fopid too.
        """
        filter_s = controller.derivative_filter_time_constant_s if isinstance(controller, FoPid) else 0.0
        is_of = isinstance(controller, FoPid) if self.has_derivative_order else structure_of(controller) != "fopid"
        if (controller.setpoint_weight is None) != (self.setpoint_weight_range is None):
            return False
        used, times = controller.measurement_filter, self.filter_times
        own_s, own = self.derivative_filter_time_constant_s, self.measurement_filter
        if times is not None and times.hold(filter_s, used):
            own_s = own_s if times.derivative_s is None else filter_s
            if times.measurement_s is not None and own is not None and used is not None:
                own = replace(own, time_constant_s=used.time_constant_s)
        return is_of and filter_s == own_s and used == own

    def with_times_of(self, controller: FoPi) -> ControllerSpec:
        """The box with the filters of a controller of its structure, whose times are then given."""
        filter_s = getattr(controller, DERIVATIVE_NAMES[1], self.derivative_filter_time_constant_s)
        used = controller.measurement_filter
        return replace(self, derivative_filter_time_constant_s=filter_s, measurement_filter=used, filter_times=None)

    @property
    def first_weight(self) -> float | None:
        """b of gains that are found without it: as near to 1 as its range allows; None without a range."""
        side = self.setpoint_weight_range
        return None if side is None else min(max(1.0, side.min), side.max)

    def weight_of(self, controller: FoPi) -> float:
        """b of a controller of this structure: its own, or the box's."""
        return self.setpoint_weight if controller.setpoint_weight is None else controller.setpoint_weight

    def refuse_other_weight(self, controller: FoPi) -> None:
        """Refuse gains without a weight of the setpoint where it has a range, and with one where the box gives it.

        Raises:
            DomainError: they are.
        """
        if controller.setpoint_weight is None and self.setpoint_weight_range is not None:
            raise DomainError(
                "the spec's setpoint_weight has a range; give gains with a setpoint_weight, as a design's have"
            )
        if controller.setpoint_weight is not None and self.setpoint_weight_range is None:
            raise DomainError(
                "the gains have a setpoint_weight of their own, and the spec gives it; leave it out of the gains"
            )

    def refuse_other_structure(self, controller: FoPi) -> None:
        """Refuse gains of another structure than this one, or with other filters.

        Raises:
            DomainError: they are.
        """
        if not self.has_structure_of(controller):
            raise DomainError(
                "the gains are of another structure than the spec's controller; give a Pid, or with structure fopid a "
                "FoPid, with the spec's derivative_filter_time_constant_s, and a FoPi where there is no derivative"
            )

    def refuse_filter_times(self, what: str) -> None:
        """Refuse a stage that needs the filters of one controller.

        Raises:
            DomainError: a filter's time has a range.
        """
        if self.filter_times is not None:
            names = " and ".join(self.filter_times.ranges)
            raise DomainError(f"{what} is not available where {names} has a range in this version; write one number")

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
        if self.setpoint_weight != 1.0 or self.setpoint_weight_range is not None:
            said = "with a range" if self.setpoint_weight_range is not None else f"{self.setpoint_weight:g}"
            raise DomainError(
                f"{what} is not available with setpoint_weight {said} in this version; leave it out, or write "
                "setpoint_weight: 1"
            )

    def controller(
        self, kp: float, ki: float, alpha: float, kd: float = 0.0, mu: float = 1.0,
        setpoint_weight: float | None = None,
    ) -> FoPi:  # fmt: skip
        """The controller with these gains in this box's structure."""
        filter_s, more = self.derivative_filter_time_constant_s, self._beside_gains(setpoint_weight)
        if self.has_derivative_order:
            return FoPid(kp, ki, alpha, kd, mu, filter_s, **more)
        if self.has_derivative:
            return Pid(kp, ki, kd, filter_s, **more)
        return FoPi(kp, ki, alpha, **more)

    def _beside_gains(self, setpoint_weight: float | None) -> dict[str, Any]:
        return {"measurement_filter": self.measurement_filter, WEIGHT_NAME: setpoint_weight}
