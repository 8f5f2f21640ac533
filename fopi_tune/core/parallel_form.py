"""Digital controllers in parallel form, a sum of first-order sections:  C(z) = direct + sum_k r_k/(z - p_k).

The sum is what a loop sees.  Which part of it acts on which signal, `DirectParts` has.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from fopi_tune.core.bode_form import Array
from fopi_tune.core.terms.measurement_filter import MeasurementFilter

#: relative; frequencies this close to Nyquist's count as equal to it: tan(omega Ts/2) has no accurate digits there
_NYQUIST_ROUNDING = 1e-12


@dataclass(frozen=True)
class DirectParts:
    """The direct feedthrough by the terms of C, which act on different signals: b r - y, r - y and -y.

    Args:
        proportional: kp.
        integral: of the integral's sections.
        derivative: of each of the derivative's sections; empty where there are none.
        equal_at_rad_s: of orders other than 1 the frequency at which integral and derivative are equally large and of
            one sign; None without.
        setpoint_weight: b, where the gains hold their own; None is the spec's.
    """

    proportional: float
    integral: float = 0.0
    derivative: tuple[float, ...] = ()
    equal_at_rad_s: float | None = None
    setpoint_weight: float | None = None

    @property
    def on_error(self) -> float:
        """Of the terms that act on r - y where b = 1."""
        return self.proportional + self.integral


@dataclass(frozen=True)
class Sections:
    """C(z) = direct + sum_k residue_k/(z - pole_k).

    Args:
        sample_time_s: Ts.
        direct: the direct feedthrough.
        poles: real, inside the unit circle except the integrator's, which is exactly 1 and comes first; empty
            without integral and derivative.
        residues: of the same length.
        parts: of `direct`, for the controller's arithmetic; where they have a derivative, its sections are the last
            ones.  None of a sum of which only the loop is asked, where all terms act alike; equality is that of the
            sums.
    """

    sample_time_s: float
    direct: float
    poles: tuple[float, ...]
    residues: tuple[float, ...]
    parts: DirectParts | None = field(default=None, compare=False)

    @property
    def has_derivative(self) -> bool:
        """Whether the last sections are the derivative's."""
        return self.parts is not None and len(self.parts.derivative) > 0

    @property
    def without_weight(self) -> Sections:
        """The same where the gains hold no weight of the setpoint."""
        return replace(self, parts=None if self.parts is None else replace(self.parts, setpoint_weight=None))

    @property
    def integral_sections(self) -> int:
        """The number of sections before the derivative's."""
        return len(self.poles) - (len(self.parts.derivative) if self.parts is not None else 0)

    def response(
        self, omega_rad_s: Array, measurement_filter: MeasurementFilter | None = None
    ) -> NDArray[np.complex128]:
        """C(e^{j omega Ts}), shape (n,); with a measurement filter, which comes before the sum, F C."""
        half = 0.5 * omega_rad_s * self.sample_time_s
        terms = self.at(2j * np.sin(half) * np.exp(1j * half))
        if measurement_filter is None:
            return terms
        return terms * measurement_filter.on_samples(omega_rad_s, self.sample_time_s)

    def at(self, shifted: NDArray[np.complex128]) -> NDArray[np.complex128]:
        """C(z) at z = 1 + shifted, shape (n,); taking z - 1 avoids cancellation at poles close to 1."""
        total = np.full(len(shifted), self.direct, dtype=complex)
        with np.errstate(divide="ignore", invalid="ignore"):
            for pole, residue in zip(self.poles, self.residues, strict=True):
                total += residue / (shifted - (pole - 1.0))
        return total


@dataclass(frozen=True)
class Implementation:
    """A controller as it runs on a computer.

    Args:
        sections: the filter that is computed at every sample.
        delay_samples: time from the measurement to the new control, in samples; whole or not, >= 0.
    """

    sections: Sections
    delay_samples: float = 0.0

    @property
    def sample_time_s(self) -> float:
        """Ts."""
        return self.sections.sample_time_s

    @property
    def delay_s(self) -> float:
        """The computing delay in s."""
        return self.delay_samples * self.sections.sample_time_s

    @property
    def nyquist_rad_s(self) -> float:
        """The highest frequency of sampled signals, pi/Ts."""
        return float(np.pi / self.sections.sample_time_s)

    def is_beyond_nyquist(self, omega_rad_s: float) -> bool:
        """Whether a frequency is at or above Nyquist's, up to rounding."""
        return omega_rad_s >= self.nyquist_rad_s * (1.0 - _NYQUIST_ROUNDING)
