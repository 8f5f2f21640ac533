"""Why a spec has no answer, where the mathematics says it without solving:  DesignSpec -> Reason or None.

Integral action has its cost as omega -> 0.  With ki != 0 on a plant with a finite P(0) != 0, whatever the gains,

    |C S| -> 1/|P(0)| ,     |T| -> 1 ,     |L| -> infinity ,     |S| -> 0      as omega -> 0 ,

while ki = 0 does not.  The jump at ki = 0 is invisible to a solver: the search looks at both sides of it.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from fopi_tune.core.logform import Array
from fopi_tune.core.loops import Plants
from fopi_tune.design.sides import GUARD, Bound, Side, sides_of
from fopi_tune.design.starts import closed_form_gains
from fopi_tune.quantities.base import Where
from fopi_tune.quantities.objectives import ObjectiveKind
from fopi_tune.spec.model import DesignSpec, GainRange, Requirement

if TYPE_CHECKING:
    pass


def describe(requirement: Requirement) -> str:
    """A requirement as a short phrase: "phase_margin_deg at_least 80 (family)"."""
    limits = " .. ".join(f"{limit:g}" for limit in requirement.limits)
    low, high = requirement.from_rad_s, requirement.to_rad_s
    band = ""
    if low == high:
        band = f" at {low:g} rad/s"
    elif low > 0.0 or high < math.inf:
        band = f" from {low:g} to {high:g} rad/s"
    return f"{requirement.quantity} {requirement.relation.value} {limits}{band} ({requirement.scope.value})"


@dataclass(frozen=True)
class Reason:
    """Infeasibility that a formula shows.

    Args:
        requirements: indices of those that clash.
        message: why, in words.
        hopeless: those that no gains meet, however far their limit is moved by a finite amount.
    """

    requirements: frozenset[int]
    message: str
    hopeless: frozenset[int] = frozenset()


def reason_without_solving(spec: DesignSpec) -> Reason | None:
    """No phase crossover at all, or closed-form gains outside their box; None when no formula decides."""
    sides = sides_of(spec)
    return _no_phase_crossover(spec, sides) or _limit_at_an_end(spec, sides) or _closed_form_outside(spec, sides)


def _no_phase_crossover(spec: DesignSpec, sides: tuple[Side, ...]) -> Reason | None:
    """A gain margin from above on a loop whose phase never reaches -180 deg, whatever the gains.

    For kp, ki >= 0 the controller's phase lies in [-90 deg alpha, 0]; without dead time the plant's has a smallest
    value.
    """
    wanted = [s for s in sides if s.where is Where.PHASE_CROSSOVERS and s.bound is not Bound.LOWER]
    box, family = spec.controller, spec.plant
    if not wanted or box.kp.min < 0 or box.ki.min < 0 or family.parameters["dead_time_s"].max > 0:
        return None
    plants = Plants.members(family, family.corners())
    log = plants.log
    if np.any(plants.unstable_poles > 0) or plants.denominator.shape[1] > 2 or plants.numerator.shape[1] > 1:
        return None
    # First order: the phase falls monotonically from its low-frequency to its high-frequency asymptote.
    lowest = float(np.minimum(log.phase0, log.end()[1]).min())
    if lowest - 0.5 * math.pi * box.alpha.max < -math.pi - 1e-12:
        return None
    first = wanted[0]
    text = describe(spec.requirements[first.requirement])
    message = (
        f"{text} has no solution: with kp, ki >= 0 and alpha <= {box.alpha.max:g} the loop's phase never reaches "
        "-180 deg, so the gain margin is infinite; ask for at_least, which an infinite margin meets, or model the dead "
        "time that makes it finite"
    )
    never = frozenset(s.requirement for s in wanted)
    return Reason(never, message, hopeless=never)


def _limit_at_an_end(spec: DesignSpec, sides: tuple[Side, ...]) -> Reason | None:
    """A bound that no gains can hold where omega tends to 0 or to infinity."""
    plants = Plants.members(spec.plant, spec.plant.corners())
    floor = low_frequency_control_gain(plants)
    ki = spec.controller.ki
    for side in sides:
        text = describe(spec.requirements[side.requirement]) if side.requirement != GUARD else ""
        rolls_off = bool(np.all(plants.log.slope_end() < -1e-9))
        if (
            side.quantity.name == "loop_gain_db"
            and side.bound is Bound.LOWER
            and rolls_off
            and side.to_rad_s == math.inf
        ):
            message = f"{text} has no solution: |L| falls without end as omega grows; say up to where with to_rad_s"
            return Reason(frozenset({side.requirement}), message, frozenset({side.requirement}))
        if side.requirement != GUARD and not ki.min <= 0.0 <= ki.max and forbids_integral(side, floor):
            message = (
                f"{text} has no solution with ki other than 0: integral action decides the response as omega tends "
                "to 0; allow ki = 0, or say from where with from_rad_s"
            )
            return Reason(frozenset({side.requirement}), message, frozenset({side.requirement}))
    return None


def without_integral(spec: DesignSpec) -> str:
    """What to add to a message when the search had to do without integral action; empty when it had not."""
    if branches(spec)[0] is spec:
        return ""
    plants = Plants.members(spec.plant, spec.plant.corners())
    floor = low_frequency_control_gain(plants)
    texts = [
        describe(spec.requirements[side.requirement])
        for side in sides_of(spec)
        if side.requirement != GUARD and forbids_integral(side, floor)
    ]
    cause = " and ".join(texts) if texts else "a zero of the plant at s = 0"
    return f" (ki = 0 was the only choice: {cause} cannot be had with integral action)"


def _closed_form_outside(spec: DesignSpec, sides: tuple[Side, ...]) -> Reason | None:
    """Crossover and phase margin of the nominal plant fix kp and ki for each alpha: is any alpha inside the box?"""
    crossover = next((s for s in sides if s.quantity.name == "crossover_rad_s" and s.bound is Bound.EQUAL), None)
    margin = next((s for s in sides if s.quantity.name == "phase_margin_deg" and s.bound is Bound.EQUAL), None)
    if crossover is None or margin is None or GUARD in (crossover.requirement, margin.requirement):
        return None
    box = spec.controller
    plants = Plants.members(spec.plant, spec.plant.nominal_point[None, :])
    omega = crossover.limit_public
    response = plants.response(np.zeros(1, dtype=np.intp), np.array([omega]))
    response = response * np.exp(-1j * omega * plants.dead_time_s)

    def inside(alpha: Array) -> tuple[Array, NDArray[np.bool_]]:
        n = len(alpha)
        gains = closed_form_gains(np.repeat(response, n), np.full(n, omega), np.full(n, margin.limit), alpha)
        return gains, _in(gains[:, 0], box.kp) & _in(gains[:, 1], box.ki)

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
    nearest = wide[anywhere][np.argmin(_outside(wide[anywhere], box.alpha))]
    need = _edge(inside, nearest, box.alpha)
    word = "alpha >= " if need > box.alpha.max else "alpha <= "
    broken = "kp" if not _in(gains[:, 0], box.kp).any() else "ki" if not _in(gains[:, 1], box.ki).any() else "kp and ki"
    message = (
        f"{start}; {broken} within range needs {word}{need:.4f}, but the spec allows "
        f"{box.alpha.min:g} .. {box.alpha.max:g}"
    )
    return Reason(both, message)


def _in(values: Array, bounds: GainRange) -> NDArray[np.bool_]:
    room = 1e-9 * np.maximum(1.0, np.abs(values))
    return (values >= bounds.min - room) & (values <= bounds.max + room)


def _outside(alpha: Array, bounds: GainRange) -> Array:
    return np.maximum(np.maximum(bounds.min - alpha, alpha - bounds.max), 0.0)


def _edge(inside: Callable[[Array], tuple[Array, NDArray[np.bool_]]], good: float, bounds: GainRange) -> float:
    """The alpha nearest to the allowed range that is still inside, by bisection."""
    bad = bounds.max if good > bounds.max else bounds.min
    for _ in range(60):
        middle = 0.5 * (good + bad)
        if inside(np.array([middle]))[1][0]:
            good = middle
        else:
            bad = middle
    return good


def low_frequency_control_gain(plants: Plants) -> float:
    """The largest of ln 1/|P(0)|; -inf when a plant has a pole or a zero at s = 0."""
    ends = plants.numerator[:, -1], plants.denominator[:, -1]
    if np.any(ends[0] == 0.0) or np.any(ends[1] == 0.0):
        return -math.inf
    return float(np.log(np.abs(ends[1] / ends[0])).max())


def cancels_integral(plants: Plants) -> bool:
    """Whether a zero at s = 0 cancels the controller's integral, which then runs away unseen."""
    return bool(np.any(plants.numerator[:, -1] == 0.0))


def has_negative_gain(plants: Plants) -> bool:
    """Whether the first plant's low-frequency gain is negative."""
    log = plants.log
    turns = (log.phase0[0] - 0.5 * np.pi * log.slope0[0]) / np.pi + plants.unstable_poles[0]
    return bool(round(float(turns)) % 2)


def forbids_integral(side: Side, floor: float) -> bool:
    """Whether this side alone cannot hold with ki != 0."""
    if side.from_rad_s > 0.0:
        return False
    if side.bound is Bound.LOWER and math.isfinite(floor):
        return side.quantity.name == "sensitivity_db"
    if side.bound is not Bound.UPPER:
        return False
    limits = {"control_sensitivity_db": floor, "complementary_sensitivity_db": 0.0, "loop_gain_db": math.inf}
    smallest = limits.get(side.quantity.name, -math.inf)
    return math.isfinite(floor) and side.limit < smallest - 1e-9


def branches(spec: DesignSpec) -> tuple[DesignSpec, ...]:
    """The specs to search in place of this one: as it is, with ki = 0, or both."""
    ki = spec.controller.ki
    if ki.is_fixed or not ki.min <= 0.0 <= ki.max:
        return (spec,)
    plants = Plants.members(spec.plant, spec.plant.corners())
    floor = low_frequency_control_gain(plants)
    without = replace(spec, controller=replace(spec.controller, ki=GainRange(0.0, 0.0)))
    if cancels_integral(plants) or any(forbids_integral(side, floor) for side in sides_of(spec)):
        return (without,)
    if spec.objective and spec.objective.quantity == ObjectiveKind.CONTROL_SENSITIVITY_PEAK and math.isfinite(floor):
        return (spec, without)
    return (spec,)
