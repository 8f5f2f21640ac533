"""A start -> the local optimum for the plants that are known:  sequential convex steps within a trust region.

The merit is objective/scale + penalty violation.  A step that lowers it by less than a small part of what the convex
problem promises is refused and its region made smaller.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from fopi_tune.core.bode_form import Array
from fopi_tune.core.controller import FoPi
from fopi_tune.design.time_domain.model import Model, Modeller
from fopi_tune.design.time_domain.quadratic import Step, lagrangian_slope, solve_step

_FIRST_RADIUS, _LARGEST_RADIUS, _SMALLEST_RADIUS = 0.3, 1.0, 1e-8
_FIRST_PENALTY, _LARGEST_PENALTY = 10.0, 1e5
#: parts of what was promised: below the first a step is refused, below the second the region shrinks
_ACCEPTED, _POOR, _GOOD = 1e-4, 0.25, 0.7
#: of the merit; what promises less has converged
_CONVERGED = 1e-9
#: relative step of the differences that make the Hessian
_DIFFERENCE = 1e-4
_HESSIAN_RANGE = (1e-8, 1e5)
#: of the objective's unit
_LEAST_SCALE = 1e-6
#: of limits that are missed at the end
_RESTORATIONS = 4


@dataclass(frozen=True, eq=False)
class Local:
    """Where a search ended.

    Args:
        model: there.
        step: the last convex problem's solution, with its prices; None where none was solved.
        scale: of the objective in that problem.
        steps: convex problems.
    """

    model: Model
    step: Step | None
    scale: float
    steps: int

    @property
    def gains(self) -> FoPi:
        """There."""
        return self.model.gains


def local_search(modeller: Modeller, start: FoPi, most: int, met: float = 1e-7) -> Local | None:
    """Search from gains; None where these are no start: a loop is unstable or has no controller.

    Args:
        modeller: of the problem, with the plants that are known.
        start: the gains.
        most: convex problems.
        met: a violation that counts as none.
    """
    numbers = modeller.problem.numbers
    n, (low, high) = numbers.count, numbers.box
    # a start may be without the weight of the setpoint
    model = modeller.at(numbers.controller(numbers.of(start)))
    if model is None:
        return None
    radius, penalty, step, hessian, count, scale = _FIRST_RADIUS, _FIRST_PENALTY, None, np.zeros((n, n)), 0, 1.0
    fresh, least = True, least_scale(model.objective)
    while count < most and radius > _SMALLEST_RADIUS:
        count += 1
        scale = scale_of(model.objective, least)
        x = numbers.of(model.gains)
        sizes, room = numbers.sizes(x), (low - x, high - x)
        if fresh:
            # worst cases of the loop may have been learnt since
            here = modeller.at(model.gains, learn=False)
            if here is not None:
                model = replace(here, loop_violation=model.loop_violation)
            first = solve_step(model, hessian, sizes, radius, room, scale, penalty)
            if first is None:
                break
            hessian = _hessian(modeller, model, first, sizes, scale)
            fresh = False
        step = solve_step(model, hessian, sizes, radius, room, scale, penalty)
        if step is None:
            break
        if step.slack > met and penalty < _LARGEST_PENALTY:
            # an exact penalty: raised until more of it does not lower the violation
            more = solve_step(model, hessian, sizes, radius, room, scale, 10.0 * penalty)
            if more is not None and more.slack < 0.9 * step.slack:
                penalty, step, fresh = 10.0 * penalty, more, True
        merit = merit_of(model, scale, penalty)
        relative = step.d / sizes
        promised = merit - step.expected - 0.5 * float(relative @ hessian @ relative)
        if promised < _CONVERGED * max(1.0, abs(merit)):
            break
        trial = modeller.at(numbers.inside(x + step.d))
        ratio = -np.inf if trial is None else (merit - merit_of(trial, scale, penalty)) / promised
        if trial is not None and ratio < _POOR and trial.violation > model.violation:
            # curved limits: back to them, the shortest way
            back = _restored(modeller, trial)
            if back is not None and merit_of(back, scale, penalty) < merit_of(trial, scale, penalty):
                trial, ratio = back, (merit - merit_of(back, scale, penalty)) / promised
        if trial is None or ratio < _ACCEPTED:
            # worst cases of the loop may have been learnt at the trial
            again = modeller.at(model.gains, learn=False)
            model = model if again is None else replace(again, loop_violation=model.loop_violation)
            radius *= 0.3
            continue
        model, fresh = trial, True
        if ratio > _GOOD and np.abs(relative).max() > 0.9 * radius:
            radius = min(2.0 * radius, _LARGEST_RADIUS)
        elif ratio < _POOR:
            radius *= 0.4
    for _ in range(_RESTORATIONS):
        if model.violation <= met:
            break
        back = _restored(modeller, model)
        if back is None or back.violation >= model.violation:
            break
        model = back
    return Local(model, step, scale, count)


def _restored(modeller: Modeller, model: Model) -> Model | None:
    """The model at the closest gains that meet the linearised limits; None where there is none."""
    numbers = modeller.problem.numbers
    n, x, (low, high) = numbers.count, numbers.of(model.gains), numbers.box
    limits = replace(
        model, aims=np.zeros(0), aim_slopes=np.zeros((0, n)), sums=tuple(each for each in model.sums if each.row >= 0)
    )
    step = solve_step(
        limits, np.eye(n), numbers.sizes(x), _FIRST_RADIUS, (low - x, high - x), 1.0, _LARGEST_PENALTY
    )  # fmt: skip
    return None if step is None else modeller.at(numbers.inside(x + step.d))


def scale_of(objective: float, least: float) -> float:
    """The unit of an objective: its size, or the least one."""
    return max(abs(objective), least) if np.isfinite(objective) else 1.0


def least_scale(first: float) -> float:
    """The least unit of an objective that is `first` at the start: in small units of time a measure is small."""
    return _LEAST_SCALE * min(1.0, abs(first)) if first != 0.0 and np.isfinite(first) else _LEAST_SCALE


def merit_of(model: Model, scale: float, penalty: float) -> float:
    """Objective and violation as one number."""
    objective = model.objective / scale if np.isfinite(model.objective) else 0.0
    return objective + penalty * model.violation


def _hessian(modeller: Modeller, model: Model, step: Step, sizes: Array, scale: float) -> Array:
    """Second derivatives of the Lagrangian by d/sizes, made positive semidefinite; shape (n, n)."""
    numbers = modeller.problem.numbers
    low, high = numbers.box
    x, found = numbers.of(model.gains), np.zeros((numbers.count, numbers.count))
    gradient = lagrangian_slope(model, step, scale)
    for j in range(numbers.count):
        if low[j] == high[j]:
            continue
        moved = x.copy()
        moved[j] += _DIFFERENCE * sizes[j] * (1.0 if x[j] + _DIFFERENCE * sizes[j] <= high[j] else -1.0)
        there = modeller.at(numbers.controller(moved), learn=False)
        if there is None or there.shape != model.shape:
            return np.zeros_like(found)
        found[j] = (lagrangian_slope(there, step, scale) - gradient) / (moved[j] - x[j])
    found = 0.5 * (found + found.T) * np.outer(sizes, sizes)
    if not np.isfinite(found).all():
        return np.zeros_like(found)
    values, vectors = np.linalg.eigh(found)
    return np.asarray((vectors * np.clip(values, *_HESSIAN_RANGE)) @ vectors.T)
