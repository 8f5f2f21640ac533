"""Why a spec has no answer:  reasons in words where the mathematics gives them, else the smallest set that clashes.

The smallest set comes from a deletion filter over elastic solves: a requirement without which the rest still clashes
is not part of the clash.  What each of the set would have to give is found by letting it alone give, all others held.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from fopi_tune.core.logform import Array
from fopi_tune.core.loops import Plants
from fopi_tune.design.integral import branches, forbids_integral, has_negative_gain, low_frequency_control_gain
from fopi_tune.design.result import Candidate, Give, Status
from fopi_tune.design.sides import GUARD, Bound, Side, sides_of
from fopi_tune.design.starts import closed_form_gains
from fopi_tune.quantities.base import Where
from fopi_tune.spec.model import DesignSpec, GainRange, Requirement

if TYPE_CHECKING:
    from fopi_tune.design.search import Search

#: requirements that give less than this (natural units, in sum) meet
MEETS = 2e-6
_UNSTABLE = "no gains within their ranges were found that give every plant of the family a stable loop"


def clash_of(search: Search) -> Candidate:
    """The smallest clashing set, found by deletion, and what each of it would have to give."""
    everything, limits = search.all_requirements, search.limits(0.0)
    nothing = tuple(None for _ in search.spec.requirements)
    relaxed = search.relaxed
    if relaxed is None:
        return _without_any_point(search)
    near = relaxed.solved.gains
    if not search.stable(near) and _none_is_stable(search):
        return Candidate(Status.INFEASIBLE, near, nothing, (), _UNSTABLE, search.exchange.solves, relaxed.rounds)
    if relaxed.solved.gives.sum() <= MEETS:
        message = "the requirements can be met, but Ipopt did not converge on the objective; try narrower gain ranges"
        return Candidate(Status.FAILED, near, nothing, (), message, search.exchange.solves)
    clash = everything
    given = _given(search, relaxed.solved.gives)
    for requirement in sorted(everything, key=lambda r: given.get(r, 0.0)):
        rest = clash - {requirement}
        without = search.elastic(rest, rest, limits)
        if without is not None and without.solved.gives.sum() > MEETS:
            clash = rest
    gives = tuple(_give_alone(search, requirement, limits) for requirement in sorted(clash))
    return Candidate(
        Status.INFEASIBLE, near, nothing, gives, _words(search.spec, clash), search.exchange.solves, relaxed.rounds
    )


def _without_any_point(search: Search) -> Candidate:
    """Even relaxed requirements had no answer: is it stability itself?"""
    nothing = tuple(None for _ in search.spec.requirements)
    box = search.spec.controller
    wrong_sign = has_negative_gain(search.exchange.oracle.plants) and box.kp.min >= 0.0 and box.ki.min >= 0.0
    if wrong_sign or _none_is_stable(search):
        message = _UNSTABLE
        if wrong_sign:
            message += "; the plant's gain is negative, so allow negative kp and ki"
        return Candidate(Status.INFEASIBLE, None, nothing, (), message, search.exchange.solves)
    message = "Ipopt found no point that could be confirmed from any start, even with every requirement relaxed"
    return Candidate(Status.FAILED, None, nothing, (), message, search.exchange.solves)


def _none_is_stable(search: Search) -> bool:
    """Whether all the places where searches begin leave an unstable loop."""
    return not any(search.stable(gains) for gains in (*search.starts, *search.stable_starts()))


def _given(search: Search, gives: Array) -> dict[int, float]:
    totals: dict[int, float] = {}
    for k, side in enumerate(search.exchange.sides):
        totals[side.requirement] = totals.get(side.requirement, 0.0) + float(gives[2 * k] + gives[2 * k + 1])
    return totals


def _give_alone(search: Search, requirement: int, limits: tuple[float, ...]) -> Give:
    """The smallest change of one limit that lets all the others hold."""
    run = search.elastic(search.all_requirements, frozenset({requirement}), limits)
    if run is None:
        return Give(requirement, None, None)
    changes = []
    for k, side in enumerate(search.exchange.sides):
        up, down = float(run.solved.gives[2 * k]), float(run.solved.gives[2 * k + 1])
        if side.requirement != requirement or max(up, down) <= 0.0:
            continue
        # slack = bound (limit - value) scale + up - down; an equality reads limit - value + up - down = 0.
        direction = 1.0 if side.bound is Bound.EQUAL else float(side.bound.value)
        changes.append(
            (abs(up - down), side, side.quantity.from_natural(side.limit + direction * (up - down) / side.scale))
        )
    if not changes:
        return Give(requirement, None, None)
    _, side, new_limit = max(changes, key=lambda change: change[0])
    return Give(requirement, abs(new_limit - side.limit_public), new_limit)


def _words(spec: DesignSpec, clash: frozenset[int]) -> str:
    if not clash:
        return "every point that meets the requirements is unstable for some plant of the family"
    names = " and ".join(describe(spec.requirements[i]) for i in sorted(clash))
    if len(clash) == 1:
        return f"{names} cannot be met within the gains' ranges"
    return f"{names} cannot hold together within the gains' ranges"


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


def explained(search: Search, reason: Reason) -> Candidate:
    """The answer for a spec with such a reason: the gains that come nearest, and what each would have to give."""
    limits, rest = search.limits(0.0), search.all_requirements - reason.hopeless
    search.relaxed = search.elastic(rest, rest, limits)
    gives = tuple(
        Give(r, None, None) if r in reason.hopeless else _give_alone(search, r, limits)
        for r in sorted(reason.requirements)
    )
    gains = search.relaxed.solved.gains if search.relaxed else None
    nothing = tuple(None for _ in search.spec.requirements)
    return Candidate(Status.INFEASIBLE, gains, nothing, gives, reason.message, search.exchange.solves)


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
