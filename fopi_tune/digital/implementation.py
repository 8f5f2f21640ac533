"""The digital controller that a spec's section `digital` makes of gains:  DesignSpec, FoPi -> Implementation."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from fopi_tune.core.controller import FoPi
from fopi_tune.core.crossings import gain_crossovers
from fopi_tune.core.loops import Loops, Plants
from fopi_tune.core.measured.family import MeasuredFamily
from fopi_tune.core.measured.loops import MeasuredLoop
from fopi_tune.core.parallel_form import Implementation, Sections
from fopi_tune.digital.discretize import sections_of
from fopi_tune.digital.realise import Precision
from fopi_tune.digital.runtime import Runtime
from fopi_tune.errors import DomainError
from fopi_tune.spec.model import DesignSpec, DigitalSpec

#: relative difference below which two responses count as equal
_SAME = 1e-6


@dataclass(frozen=True)
class StepCost:
    """What a sample of the exported code costs, but for comparisons and for the first one.

    Args:
        multiplications: of numbers of the precision.
        additions: and subtractions; the most that a sample takes.
        state_bytes_float64: of the state in double precision.
        state_bytes_float32: of the state in single precision.
        coefficients: the numbers that the code stores, each as long as one of its states.
    """

    multiplications: int
    additions: int
    state_bytes_float64: int
    state_bytes_float32: int
    coefficients: int


def step_cost(runtime: Runtime) -> StepCost:
    """The cost of (1), (5) and (7) of `runtime`."""
    sections = len(runtime.poles)
    derivatives = len(runtime.derivative.gains) if runtime.derivative else 0
    used, weighted = runtime.measurement_filter, int(runtime.proportional != 0.0)
    lags = 0 if used is None else 1 if used.damping is None else 2
    each, limit = 3 * sections + (1 if sections else 0), 2 * int(runtime.limits_rate)
    multiplications = 1 + 2 * weighted + 2 * derivatives + lags + each
    additions = 1 + 2 * weighted + 4 * derivatives + 3 * lags + each + limit
    # the flag of the first sample takes the place of a number
    numbers = sections + derivatives + lags + 1 + int(runtime.starts_at_first_sample)
    # direct, the limits, and what each part has; the gain of the anti-windup; what counts as 0
    coefficients = 3 + 2 * weighted + 2 * derivatives + lags + int(runtime.limits_rate) + 3 * sections
    coefficients += int(sections > 0) + int(sections + derivatives + lags > 0)
    return StepCost(multiplications, additions, 8 * numbers, 4 * numbers, coefficients)


def implementation_of(spec: DesignSpec, gains: FoPi) -> Implementation:
    """The digital controller that the spec's section `digital` makes of gains.

    Raises:
        DomainError: there is no such section, or it cannot be met (band, sample time).
    """
    digital = digital_section_of(spec)
    crossover = nominal_crossover(spec, gains) if digital.depends_on_crossover else None
    return Implementation(sections_of(gains, digital, crossover), digital.delay_samples)


def runtime_of(sections: Sections, spec: DesignSpec) -> Runtime:
    """The controller in the arithmetic of the exported double-precision code, with the limits of its output.

    Args:
        sections: the digital controller.
        spec: gives the limits, if any, the setpoint's weight, and the measurement's filter.

    Raises:
        DomainError: the limits are empty, or a coefficient is out of range.
    """
    digital, parts, weight = spec.digital, sections.parts, spec.controller.setpoint_weight
    if parts is not None and parts.setpoint_weight is not None:
        weight = parts.setpoint_weight
    limits, rate = (digital.output_limits, digital.output_rate_per_s) if digital is not None else (None, None)
    return Runtime.of(sections, Precision.FLOAT64, limits, rate, weight, spec.controller.measurement_filter)


def designed_implementation(spec: DesignSpec, gains: FoPi) -> Implementation | None:
    """The digital controller whose loop the requirements are about: None unless the spec has `design: sampled`.

    Raises:
        DomainError: it cannot be made.
    """
    return None if spec.sampled_design is None else implementation_of(spec, gains)


def is_implementation_of(spec: DesignSpec, gains: FoPi, implementation: Implementation) -> bool:
    """Whether a digital controller equals `implementation_of`, up to the tolerance of a fit's solver."""
    try:
        ours = implementation_of(spec, gains)
    except DomainError:
        return False
    if (ours.sample_time_s, ours.delay_samples) != (implementation.sample_time_s, implementation.delay_samples):
        return False
    omega = np.geomspace(1e-6, 1.0, 200) * ours.nyquist_rad_s
    wanted = ours.sections.response(omega)
    return bool(np.all(np.abs(implementation.sections.response(omega) - wanted) <= _SAME * np.abs(wanted)))


def digital_section_of(spec: DesignSpec) -> DigitalSpec:
    """The spec's section `digital`.

    Raises:
        DomainError: there is none.
    """
    if spec.digital is None:
        raise DomainError(
            "the spec has no section digital; add digital: {sample_time_s: 0.2} with your sampling period"
        )
    return spec.digital


def nominal_crossover(spec: DesignSpec, gains: FoPi) -> float | None:
    """The highest nominal gain crossover of the ideal controller, rad/s; None without one."""
    family = spec.nominal_family
    if isinstance(family, MeasuredFamily):
        crossovers = MeasuredLoop(gains, family.members[0].table, family.band_rad_s).gain_crossovers
        return math.exp(crossovers[-1]) if len(crossovers) else None
    plant = Plants.of(spec.nominal_family.member(spec.nominal_family.nominal_point))
    found = gain_crossovers(Loops.of(gains, plant)).omega_rad_s
    return float(found[-1]) if len(found) else None
