"""Infeasibility that a formula shows, without solving:  DesignSpec -> Reason or None.

Three conditions are tested: an upper limit of a gain margin that is always infinite, a limit that no gains can meet as
omega -> 0 or infinity, and a crossover with a phase margin whose closed-form gains lie outside their ranges.  Of a loop
on samples the second as omega -> 0 alone, and a crossover above Nyquist's frequency.

The limits as omega -> 0 depend on integral action.  With ki != 0 on a plant with a finite P(0) != 0, for all gains,

    |C S| -> 1/|P(0)| ,     |T| -> 1 ,     |L| -> infinity ,     |S| -> 0      as omega -> 0 ,

but not with ki = 0.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fopi_tune.core.bode_form import Array, BodeForm, Complex
from fopi_tune.core.loops import Plants
from fopi_tune.design.constraints import STABILITY_GUARD, Bound, Constraint, constraints_of
from fopi_tune.quantities.base import EvaluatedAt
from fopi_tune.spec.model import DesignSpec, GainRange, Requirement


@dataclass(frozen=True)
class Reason:
    """Infeasibility that a formula shows.

    Args:
        requirements: indices of those that clash.
        message: why, in words.
        unattainable: those that no gains meet, whatever finite limit they have.
    """

    requirements: frozenset[int]
    message: str
    unattainable: frozenset[int] = frozenset()


def reason_without_solving(spec: DesignSpec) -> Reason | None:
    """The first reason found for infeasibility; None when no formula decides."""
    constraints = constraints_of(spec)
    if spec.sampled_design is not None:
        # the others are formulas of the continuous loop
        nyquist = math.pi / spec.sampled_design.sample_time_s
        return _crossover_above_nyquist(spec, constraints, nyquist) or _limit_at_zero_or_infinity(spec, constraints)
    return (
        _no_phase_crossover(spec, constraints)
        or _limit_at_zero_or_infinity(spec, constraints)
        # crossover and margin leave the gains of a PID one degree of freedom
        or (None if spec.controller.has_derivative else _closed_form_out_of_range(spec, constraints))
    )


def _crossover_above_nyquist(spec: DesignSpec, constraints: tuple[Constraint, ...], nyquist: float) -> Reason | None:
    """A crossover that has to lie where a loop on samples has no response."""
    for constraint in constraints:
        is_crossover = constraint.quantity.name == "crossover_rad_s" and constraint.bound is not Bound.UPPER
        if is_crossover and constraint.limit_public >= nyquist:
            text, alone = describe(spec.requirements[constraint.requirement]), frozenset({constraint.requirement})
            message = f"{text} has no solution: Nyquist's frequency is {nyquist:.6g} rad/s; sample faster, or lower it"
            return Reason(alone, message, alone)
    return None


def _no_phase_crossover(spec: DesignSpec, constraints: tuple[Constraint, ...]) -> Reason | None:
    """An upper limit (or equality) of the gain margin on a loop whose phase never reaches -180 deg.

    For kp, ki >= 0 the controller's phase lies in [-90 deg alpha, 0], with a derivative kd >= 0 in [-90, 90] deg, with
    orders above the lower one of -90 deg alpha and -90 deg (1 - mu), and without dead time the plant's phase is bounded
    from below.
    """
    wanted = [s for s in constraints if s.where is EvaluatedAt.PHASE_CROSSOVERS and s.bound is not Bound.LOWER]
    box, family = spec.controller, spec.plant
    if not wanted or min(box.kp.min, box.ki.min, box.kd.min) < 0 or family.dead_time.max > 0:
        return None
    plants = Plants.members(family, family.corners())
    log = _log_with_filter(spec, plants)
    if np.any(plants.unstable_poles > 0) or not plants.has_falling_phase:
        return None
    # First order: the phase falls monotonically from its low-frequency to its high-frequency asymptote.
    lowest = float(np.minimum(log.phase0, log.end()[1]).min())
    # so does that of a filter
    order = box.alpha.max if box.mu is None else max(box.alpha.max, 1.0 - box.mu.min)
    if lowest - 0.5 * math.pi * order < -math.pi - 1e-12:
        return None
    first, gains = (
        wanted[0],
        "kp, ki and kd >= 0" if box.has_derivative else f"kp, ki >= 0 and alpha <= {box.alpha.max:g}",
    )
    text = describe(spec.requirements[first.requirement])
    message = (
        f"{text} has no solution: with {gains} the loop's phase never reaches "
        "-180 deg, so the gain margin is infinite; ask for at_least, which an infinite margin meets, or model the dead "
        "time that makes it finite"
    )
    never = frozenset(s.requirement for s in wanted)
    return Reason(never, message, unattainable=never)


def _limit_at_zero_or_infinity(spec: DesignSpec, constraints: tuple[Constraint, ...]) -> Reason | None:
    """A limit that no gains can meet as omega tends to 0 or to infinity."""
    plants = Plants.members(spec.plant, spec.plant.corners())
    floor = low_frequency_control_gain(plants)
    ki, sampled = spec.controller.ki, spec.sampled_design is not None
    for constraint in constraints:
        text = describe(spec.requirements[constraint.requirement]) if constraint.requirement != STABILITY_GUARD else ""
        rolls_off = not sampled and bool(np.all(_log_with_filter(spec, plants).slope_end() < -1e-9))
        if (
            constraint.quantity.name == "loop_gain_db"
            and constraint.bound is Bound.LOWER
            and rolls_off
            and constraint.to_rad_s == math.inf
        ):
            message = f"{text} has no solution: |L| falls without end as omega grows; say up to where with to_rad_s"
            return Reason(frozenset({constraint.requirement}), message, frozenset({constraint.requirement}))
        if (
            constraint.requirement != STABILITY_GUARD
            and not ki.min <= 0.0 <= ki.max
            and forbids_integral(constraint, floor)
        ):
            message = (
                f"{text} has no solution with ki other than 0: integral action decides the response as omega tends "
                "to 0; allow ki = 0, or say from where with from_rad_s"
            )
            return Reason(frozenset({constraint.requirement}), message, frozenset({constraint.requirement}))
    return None


def _log_with_filter(spec: DesignSpec, plants: Plants) -> BodeForm:
    """ln(F P): a measurement filter acts on the loop as a part of the plant."""
    filtered = spec.controller.measurement_filter
    return plants.log if filtered is None else plants.log + filtered.log(len(plants))


def closed_form_gains(plant_response: Complex, omega_rad_s: Array, phase_margin_rad: Array, alpha: Array) -> Array:
    """(kp, ki) that give this crossover and margin; all arguments of shape (n,), result (n, 2).

    Args:
        plant_response: P(j omega), dead time included.
        omega_rad_s: the crossover.
        phase_margin_rad: the margin there.
        alpha: the order, in (0, 2).
    """
    x = np.exp(1j * (phase_margin_rad - np.pi)) / plant_response
    ki = -x.imag * omega_rad_s**alpha / np.sin(0.5 * np.pi * alpha)
    kp = x.real - ki * omega_rad_s**-alpha * np.cos(0.5 * np.pi * alpha)
    return np.stack([kp, ki], axis=1)


def _closed_form_out_of_range(spec: DesignSpec, constraints: tuple[Constraint, ...]) -> Reason | None:
    """Crossover and phase margin of the nominal plant determine kp and ki for each alpha: are both ever in range?

    Where |L| may have several crossovers the margin can be that of a lower one: at the highest the angle from -1 is
    then anything from the margin to the lead of that size.
    """
    crossover = next((s for s in constraints if s.quantity.name == "crossover_rad_s" and s.bound is Bound.EQUAL), None)
    margin = next((s for s in constraints if s.quantity.name == "phase_margin_deg" and s.bound is Bound.EQUAL), None)
    if crossover is None or margin is None or STABILITY_GUARD in (crossover.requirement, margin.requirement):
        return None
    box = spec.controller
    plants = Plants.members(spec.plant, spec.plant.nominal_point[None, :])
    omega = crossover.limit_public
    response = plants.response(np.zeros(1, dtype=np.intp), np.array([omega]))
    response = response * np.exp(-1j * omega * plants.dead_time_s)
    if box.measurement_filter is not None:
        response = response * box.measurement_filter(1j * omega)

    angles = np.linspace(margin.limit, 2.0 * np.pi - margin.limit, 2 if _has_one_crossover(spec, plants) else 361)

    def inside(alpha: Array) -> tuple[Array, NDArray[np.bool_]]:
        """Gains with the margin by lag, and whether those with any of the angles are in their ranges."""
        n, good = len(alpha), np.zeros(len(alpha), dtype=bool)
        every = [
            closed_form_gains(np.repeat(response, n), np.full(n, omega), np.full(n, angle), alpha) for angle in angles
        ]
        for gains in every:
            good |= _in_range(gains[:, 0], box.kp) & _in_range(gains[:, 1], box.ki)
        return every[0], good

    allowed = np.linspace(box.alpha.min, box.alpha.max, 1 if box.alpha.is_fixed else 801)
    gains, good = inside(allowed)
    if good.any():
        return None
    both = frozenset((crossover.requirement, margin.requirement))
    start = (
        f"{describe(spec.requirements[margin.requirement])} and {describe(spec.requirements[crossover.requirement])} "
        "fix kp and ki for each alpha"
    )
    wide = np.linspace(1e-3, 2.0 - 1e-3, 4001)
    _, anywhere = inside(wide)
    if not anywhere.any():
        return Reason(both, f"{start}; no alpha in (0, 2) brings both into their ranges")
    nearest = wide[anywhere][np.argmin(_distance_from_range(wide[anywhere], box.alpha))]
    need = _nearest_alpha(inside, nearest, box.alpha)
    word = "alpha >= " if need > box.alpha.max else "alpha <= "
    broken = (
        "kp"
        if not _in_range(gains[:, 0], box.kp).any()
        else "ki"
        if not _in_range(gains[:, 1], box.ki).any()
        else "kp and ki"
    )
    message = (
        f"{start}; {broken} within range needs {word}{need:.4f}, but the spec allows "
        f"{box.alpha.min:g} .. {box.alpha.max:g}"
    )
    return Reason(both, message)


def _has_one_crossover(spec: DesignSpec, plants: Plants) -> bool:
    """Whether |L| of these plants falls monotonically, whatever the gains are: |C| does, and no pole is resonant."""
    box = spec.controller
    falls = box.kp.min >= 0.0 and box.ki.min >= 0.0 and box.alpha.max <= 1.0
    return falls and plants.has_falling_gain


def _in_range(values: Array, bounds: GainRange) -> NDArray[np.bool_]:
    room = 1e-9 * np.maximum(1.0, np.abs(values))
    return (values >= bounds.min - room) & (values <= bounds.max + room)


def _distance_from_range(alpha: Array, bounds: GainRange) -> Array:
    return np.maximum(np.maximum(bounds.min - alpha, alpha - bounds.max), 0.0)


def _nearest_alpha(inside: Callable[[Array], tuple[Array, NDArray[np.bool_]]], good: float, bounds: GainRange) -> float:
    """The alpha nearest to the allowed range with kp and ki in range, by bisection from the alpha `good`."""
    bad = bounds.max if good > bounds.max else bounds.min
    for _ in range(60):
        middle = 0.5 * (good + bad)
        if inside(np.array([middle]))[1][0]:
            good = middle
        else:
            bad = middle
    return good


def forbids_integral(constraint: Constraint, floor: float) -> bool:
    """Whether this constraint alone is infeasible with ki != 0; `floor` is `low_frequency_control_gain`."""
    if constraint.from_rad_s > 0.0:
        return False
    if constraint.bound is Bound.LOWER and math.isfinite(floor):
        return constraint.quantity.name == "sensitivity_db"
    if constraint.bound is not Bound.UPPER:
        return False
    limits = {"control_sensitivity_db": floor, "complementary_sensitivity_db": 0.0, "loop_gain_db": math.inf}
    smallest = limits.get(constraint.quantity.name, -math.inf)
    return math.isfinite(floor) and constraint.limit < smallest - 1e-9


def low_frequency_control_gain(plants: Plants) -> float:
    """The largest ln(1/|P(0)|), the limit of ln|C S| with ki != 0; -inf if some P(0) is 0 or infinite."""
    ends = plants.ends_at_zero
    if np.any(ends[0] == 0.0) or np.any(ends[1] == 0.0):
        return -math.inf
    return float(np.log(np.abs(ends[1] / ends[0])).max())


def has_negative_gain(plants: Plants) -> bool:
    """Whether the first plant's low-frequency gain is negative."""
    log = plants.log
    turns = (log.phase0[0] - 0.5 * np.pi * log.slope0[0]) / np.pi + plants.unstable_poles[0]
    return bool(round(float(turns)) % 2)


def describe(requirement: Requirement) -> str:
    """A requirement as a short phrase: "phase_margin_deg at_least 80 (family)"."""
    limits = " .. ".join(f"{limit:g}" for limit in requirement.every_limit)
    low, high = requirement.from_rad_s, requirement.to_rad_s
    band = ""
    if low == high:
        band = f" at {low:g} rad/s"
    elif low > 0.0 or high < math.inf:
        band = f" from {low:g} to {high:g} rad/s"
    return f"{requirement.quantity} {requirement.relation.value} {limits}{band} ({requirement.scope.value})"
