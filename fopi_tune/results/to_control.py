"""Results as objects of python-control, in modal state space:  no polynomial is expanded (`modal_form`)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from fopi_tune.core.controller import FoPi, Pid, refuse_derivative_order_in
from fopi_tune.core.fractional_plants.family import refuse_fractional_family
from fopi_tune.core.loops import Plants
from fopi_tune.core.parallel_form import Sections
from fopi_tune.core.plant import Plant, PlantFamily
from fopi_tune.core.sampled_loops import SampledPlants
from fopi_tune.core.terms.measurement_filter import MeasurementFilter
from fopi_tune.digital.oustaloup import ZeroPoleGain, oustaloup
from fopi_tune.errors import DomainError
from fopi_tune.results.modal_form import ModalForm, in_series

#: the filter's band in decades below and above the crossover, and its poles a decade: within 1e-4 of the step response
#: to the horizon, of which a thousandth of the slowest pole's time has then passed
_DECADES_BELOW, _DECADES_ABOVE, _POLES_PER_DECADE = 7, 6, 4
#: the stated band and horizon reach this many decades from the crossover
_DECADES = 3
_PADE_ORDER = 5


@dataclass(frozen=True)
class ControlObjects:
    """`control.StateSpace`s of a design, nominal plant, in modal form: real and block-diagonal.

    The closed loop's step response is within 1e-4 of the exact fractional loop's, relative to the largest value, from
    t = 0.001/crossover to the horizon, for stable loops without dead time whose |S| stays below 6 dB.  With dead time
    the Pade approximation adds an error at the size of the jumps that reach the output, up to a few dead times.

    Args:
        controller: kp + ki s^-1 R(s), R an Oustaloup approximation of s^(1 - alpha) that reaches beyond `band_rad_s`;
            exact for alpha = 1.
        plant: the nominal plant; its dead time a Pade approximation of order 5, good up to omega = 3/dead time.
        loop: controller times plant.
        band_rad_s: where the controller's gain and phase (rad) are exact to 1e-3.
        horizon_s: 1000/crossover.
    """

    controller: Any
    plant: Any
    loop: Any
    band_rad_s: tuple[float, float]
    horizon_s: float


def to_control(gains: FoPi | None, family: PlantFamily) -> ControlObjects:
    """Controller, nominal plant and loop as state-space systems of python-control.

    Raises:
        DomainError: there are no gains, or their derivative may have any order.
    """
    if gains is None:
        raise DomainError("there are no gains to convert; the design has no answer")
    refuse_derivative_order_in(gains, "an object of python-control")
    refuse_fractional_family(family, "an object of python-control", "it has rational functions of s alone")
    from fopi_tune.core.margins import margins

    plant = family.member(family.nominal_point)
    centre = margins(gains, plant).crossover_rad_s or _fastest(plant)
    controller, moving = _controller(gains, centre), _with_pade(plant, centre)
    if (used := gains.measurement_filter) is not None:
        controller = in_series(ModalForm.of_polynomials((1.0,), used.coefficients, centre), controller, centre)
    reach = 10.0**_DECADES
    loop = in_series(controller, moving, centre)
    band = (centre / reach, centre * reach)
    return ControlObjects(_object(controller), _object(moving), _object(loop), band, reach / centre)


@dataclass(frozen=True)
class SampledObjects:
    """Discrete `control.StateSpace`s of a digital controller's loop, nominal plant, with dt = the sample time.

    All are in modal form, real and block-diagonal, but for the whole samples of delay, a line before plant and loop.

    Args:
        controller: the sum of first-order sections, exact; all of them act on the error here, a derivative too, and a
            setpoint's weight is not in it.
        plant: behind the zero-order hold, with its dead time and the computing delay, exact at the samples.
        loop: controller times plant.
    """

    controller: Any
    plant: Any
    loop: Any


def to_sampled(
    sections: Sections, family: PlantFamily, delay_samples: float, crossover_rad_s: float | None = None,
    measurement_filter: MeasurementFilter | None = None,
) -> SampledObjects:  # fmt: skip
    """Controller, nominal plant and loop on samples as state-space systems of python-control.

    Args:
        sections: the controller.
        family: whose nominal member is the plant.
        delay_samples: computing delay.
        crossover_rad_s: of the loop; None where there is none.
        measurement_filter: F, a part of the controller by Tustin's rule; None is 1.
    """
    step, plant = sections.sample_time_s, family.member(family.nominal_point)
    rate = crossover_rad_s or 0.0
    late = int(SampledPlants.behind_hold(Plants.of(plant), step, delay_samples * step).late[0])
    part = max(0.0, plant.dead_time_s / step + delay_samples - (late - 1))
    moving = ModalForm.of_polynomials(plant.numerator, plant.denominator, rate).behind_hold(step, part)
    # without a part of a sample and a direct path the measurement is the plant's state, which moves a sample later
    delay = late - 1 if part == 0.0 and moving.direct == 0.0 else late
    controller = ModalForm.of_residues(sections.poles, sections.residues, sections.direct)
    if measurement_filter is not None:
        filtered = ModalForm.of_polynomials(*measurement_filter.polynomials_in_z(step), rate * step)
        controller = in_series(filtered, controller, rate * step, origin=1.0)
    loop = in_series(controller, moving, rate * step, origin=1.0)
    return SampledObjects(_object(controller, step), _object(moving, step, delay), _object(loop, step, delay))


def _object(form: ModalForm, step: float = 0.0, delay: int = 0) -> Any:
    """The form as a `control.StateSpace`, behind a line of `delay` samples; `step` 0 is continuous time."""
    import control

    found = control.ss(form.a, form.b[:, None], form.c[None, :], [[form.direct]], step)
    if delay == 0:
        return found
    line = control.ss(np.eye(delay, k=-1), np.eye(delay, 1), np.eye(delay)[-1:, :], [[0.0]], step)
    return found * line


def _controller(gains: FoPi, centre: float) -> ModalForm:
    """kp + ki s^-alpha, its filter's band about `centre` (rad/s).

    Below alpha = 1 the integrator's residue and those of the filter have one sign.  Above it they are differences of
    large numbers: there the integrator follows the rest in series, coupled with the poles that are slow.
    """
    if isinstance(gains, Pid):
        # kd s/(Tf s + 1) = kd/Tf - (kd/Tf^2)/(s + 1/Tf)
        rate = 1.0 / gains.derivative_filter_time_constant_s
        return ModalForm.of_residues((0.0, -rate), (gains.ki, -gains.kd * rate**2), gains.kp + gains.kd * rate)
    band = (centre * 10.0**-_DECADES_BELOW, centre * 10.0**_DECADES_ABOVE)
    power = oustaloup(gains.alpha, (_DECADES_BELOW + _DECADES_ABOVE) * _POLES_PER_DECADE, band)
    if gains.alpha <= 1.0:
        return ModalForm.of_residues(power.poles, (gains.ki * power.residues).tolist(), gains.kp)
    rest = ZeroPoleGain(power.zeros, power.poles[1:], power.gain)
    filtered = ModalForm.of_residues(rest.poles, (gains.ki * rest.residues).tolist(), gains.ki * rest.gain)
    return in_series(filtered, ModalForm.of_residues((0.0,), (1.0,), 0.0), centre).plus(gains.kp)


def _with_pade(plant: Plant, centre: float) -> ModalForm:
    """The plant, its dead time replaced by  Q(-Ls)/Q(Ls),  Q(x) = sum_k (2n - k)!/(k! (n - k)!) x^k."""
    moving = ModalForm.of_polynomials(plant.numerator, plant.denominator, centre)
    if plant.dead_time_s == 0.0:
        return moving
    import control

    numerator, denominator = control.pade(1.0, _PADE_ORDER)
    return in_series(ModalForm.of_polynomials(numerator, denominator).in_units_of(plant.dead_time_s), moving, centre)


def _fastest(plant: Plant) -> float:
    """The largest |pole|, rad/s; 1 for a plant without poles off the origin."""
    return float(np.abs(np.roots(plant.denominator)).max(initial=0.0)) or 1.0
