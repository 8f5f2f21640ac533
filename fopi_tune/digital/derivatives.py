"""A digital controller with its derivatives by the gains:  spec, gains -> the numbers that run, and d/d(kp, ki, alpha).

With the filter of kp = 0 and ki = 1, direct d, poles p_k and residues r_k, the controller is

    direct = kp + ki d,    poles p_k,    residues ki r_k .                                                           (1)

d, p_k and r_k depend on alpha and, with `prewarp: crossover` or `rule: matched`, on the nominal gain crossover omega,
which moves with every gain theta.  From |L(j omega)| = 1, L = C P,

    d ln omega/d theta = -Re((dC/d theta)/C)/(d ln|L|/d ln omega) .                                                 (2)

The weights and the gain of the anti-windup follow from (1) by the formulas of `digital.runtime`; where those have
branches, the branch of the controller that runs is differentiated.  Sections that are not in the controller that runs
are here with residue 0: all but the integrator at alpha = 1, and all of them at ki = 0.  There the gain of the
anti-windup is proportional to |ki|, and its derivative is that towards the inside of the spec's range of ki.

Source: derived.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fopi_tune.core.bode_form import Array
from fopi_tune.core.controller import FoPi
from fopi_tune.core.crossings import gain_crossovers
from fopi_tune.core.loops import Loops, Plants
from fopi_tune.digital.discretize import Method, sections_of
from fopi_tune.digital.implementation import digital_section_of, runtime_of
from fopi_tune.digital.runtime import Runtime
from fopi_tune.digital.section_derivatives import UnitFilter, unit_filter
from fopi_tune.errors import DomainError
from fopi_tune.spec.model import DesignSpec, DigitalSpec

#: value and derivatives: columns of every array
_COLUMNS = 4
#: d ln|L|/d ln omega this small at a crossover: |L| touches 1, and the crossover jumps as the gains change
_FLAT = 1e-6


@dataclass(frozen=True, eq=False)
class ControllerDerivatives:
    """A controller's numbers; along the last axis the value, d/d kp, d/d ki and d/d alpha.

    Args:
        controller: the one that runs, in float64.
        direct: shape (4,).
        tracking_gain: shape (4,).
        poles: shape (sections, 4), the integrator's first.
        weights: of the anti-windup, shape (sections, 4).
        residues: shape (sections, 4); 0 in a section that the controller that runs has not.
    """

    controller: Runtime
    direct: Array
    tracking_gain: Array
    poles: Array
    weights: Array
    residues: Array


def controller_derivatives(spec: DesignSpec, gains: FoPi) -> ControllerDerivatives:
    """The digital controller of gains, with its derivatives.

    Args:
        spec: with a section `digital`.
        gains: kp, ki and alpha.  For `method: fit` d/d alpha is 0; likewise where an approximation that the gains do
            not need, as alpha is fixed at 1 or ki at 0, cannot be made.

    Raises:
        DomainError: there is no digital section or it cannot be met, `method: fit` has a free alpha, or the nominal
            gain crossover, on which the filter depends, has no derivative; the structure is pid, or there
            is a measurement filter or a weight of the setpoint.
    """
    digital = digital_section_of(spec)
    box = spec.controller
    for refuse in (box.refuse_derivative, box.refuse_measurement_filter, box.refuse_setpoint_weight):
        refuse("a simulation's derivative by the gains")
    if Method(digital.method) is Method.FIT and not spec.controller.alpha.is_fixed:
        raise DomainError(
            "method: fit has no derivative by alpha, as its poles jump when alpha changes; give the controller a fixed "
            "alpha, or take method: oustaloup"
        )
    crossover, rates = _crossover(spec, gains, digital)
    controller = runtime_of(sections_of(gains, digital, crossover), spec)
    unit = _unit_filter(spec, gains, digital, crossover)
    by_gains = _by_gains(gains.ki, rates)
    direct, residues = unit.direct @ by_gains, unit.residues @ by_gains
    poles = unit.poles @ _by_gains(1.0, rates, with_ki=False)
    direct[1] += 1.0
    # (1) is right to rounding; the values are those that run
    count = len(controller.poles)
    direct[0], poles[:count, 0], residues[:, 0] = controller.direct, controller.poles, 0.0
    residues[:count, 0] = controller.residues
    side = 1.0 if spec.controller.ki.max > 0.0 else -1.0
    weights, gain = _anti_windup(controller, direct, poles, residues, side)
    return ControllerDerivatives(controller, direct, gain, poles, weights, residues)


def _by_gains(ki: float, omega_rates: Array, with_ki: bool = True) -> Array:
    """The matrix from x's (value, d/d alpha, d/d omega) to those of ki x or x; shape (3, 4)."""
    rows = np.zeros((3, _COLUMNS))
    rows[0, 0] = rows[1, 3] = ki
    rows[0, 2] = float(with_ki)
    rows[2, 1:] = ki * omega_rates
    return rows


def _unit_filter(spec: DesignSpec, gains: FoPi, digital: DigitalSpec, crossover_rad_s: float | None) -> UnitFilter:
    box = spec.controller
    try:
        return unit_filter(gains.alpha, digital, crossover_rad_s)
    except DomainError:
        # where the gains need no approximation of s^-alpha and are fixed there, nothing is asked of it
        if not ((box.alpha.is_fixed and gains.alpha == 1.0) or (box.ki.is_fixed and gains.ki == 0.0)):
            raise
    return unit_filter(gains.alpha, digital, crossover_rad_s, alone=True)


def _crossover(spec: DesignSpec, gains: FoPi, digital: DigitalSpec) -> tuple[float | None, Array]:
    """The nominal gain crossover on which the filter depends, rad/s, None without; and (2), shape (3,), in rad/s."""
    if not digital.depends_on_crossover or Method(digital.method) is Method.FIT:
        return None, np.zeros(3)
    loops = Loops.of(gains, Plants.of(spec.nominal_family.member(spec.nominal_family.nominal_point)))
    found = gain_crossovers(loops)
    if not len(found.u) or found.omega_rad_s[-1] >= np.pi / digital.sample_time_s:
        return None, np.zeros(3)
    row, last, omega = np.zeros(1, dtype=int), found.u[-1:], float(found.omega_rad_s[-1])
    slope = float(loops.log_response_and_slope(row, last)[1].real[0])
    if abs(slope) < _FLAT:
        what = f"the nominal gain only touches 1 at {omega:.4g} rad/s, where the filter is made to be exact"
        raise DomainError(f"{what}; change the gains, or take rule: tustin without prewarp")
    power = np.exp(-gains.alpha * (np.log(omega) + 0.5j * np.pi))
    by_theta = np.array([1.0, power, -gains.ki * power * (np.log(omega) + 0.5j * np.pi)])
    relative = (by_theta / (gains.kp + gains.ki * power)).real
    return omega, -relative / slope * omega


def _anti_windup(controller: Runtime, direct: Array, poles: Array, residues: Array, side: float) -> tuple[Array, Array]:
    """Weights, shape (sections, 4), and gain, shape (4,), by the branch that `controller` has; `side` is that of ki."""
    count, taking = len(controller.poles), poles[:, 0] > 0.0
    weights, gain = np.zeros(poles.shape), np.zeros(_COLUMNS)
    weights[:count, 0], gain[0] = controller.weights, controller.tracking_gain
    shares = np.where(taking[:, None], residues, 0.0)
    if not count:
        return _without_integral(weights, gain, direct, shares, side)
    if not weights[:, 0].any():
        return weights, gain
    with np.errstate(all="ignore"):
        signed = np.array_equal(shares[:, 0] / shares[:, 0].sum(), weights[:, 0])
    if not signed:
        shares = np.sign(shares[:, :1]) * shares
    total = shares.sum(axis=0)
    weights[:, 1:] = (shares[:, 1:] - weights[:, :1] * total[1:]) / total[0]
    # g = min(1, |total/direct|)
    if abs(total[0]) < abs(direct[0]):
        size = abs(total[0] / direct[0])
        gain[1:] = size * (total[1:] / total[0] - direct[1:] / direct[0])
    return weights, gain


def _without_integral(weights: Array, gain: Array, direct: Array, shares: Array, side: float) -> tuple[Array, Array]:
    """ki = 0: as ki -> 0 the weights are |r_k|/sum |r_j| and g is |ki| sum |r_j|/|kp|; `shares` hold r_k as d/d ki."""
    sizes = np.abs(shares[:, 2])
    total = float(sizes.sum())
    gain[0] = 0.0
    if total > 0.0 and direct[0] != 0.0:
        weights[:, 0] = sizes / total
        gain[2] = side * total / abs(direct[0])
    return weights, gain
