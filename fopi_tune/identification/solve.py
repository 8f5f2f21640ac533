"""Least squares for a model's parameters:  initial guesses from a grid, then SciPy's `least_squares`.

The sum of squares has several local minima in the dead time.  So the initial guesses come from a grid of shapes and
dead times, on which the other parameters follow in closed form: the response to the input is computed once a shape and
then only shifted.
"""

from __future__ import annotations

import itertools
import math
from typing import Any

import numpy as np

from fopi_tune.core.bode_form import Array
from fopi_tune.identification.models import FitModel, Signals, Structure, forced_response, own_motion
from fopi_tune.identification.scaling import Scaled

#: at most this many samples are used on the grid; the fit uses all
_MAX_SEARCH_SAMPLES = 1000
#: kinks in the dead time are searched one by one up to this many samples
_MAX_KINK_SAMPLES = 1500
#: with few samples, of which the dead time is less certain, further ones are searched too
_FEW_SAMPLES, _FAR_KINKS = 150, 4
_GUESSES = 3
_DAMPINGS = (0.1, 0.25, 0.5, 1.0, 2.0, 5.0)
#: logarithmic limits of time constants over the record's length; of squared ones twice these
_TIMES = (-16.0, 7.0)


def initial_guesses(problem: Scaled, structure: Structure) -> list[Array]:
    """The best points of a grid of shapes and dead times that differ from each other; from the smoothed output."""
    signals = problem.signals
    rows = np.unique(np.linspace(0, problem.n - 1, min(_MAX_SEARCH_SAMPLES, problem.n)).astype(int))
    output, time = problem.smoothed[rows], signals.time[rows]
    fine = np.linspace(0.0, 1.0, 1 + min(max(2000, problem.n), 20000))
    everywhere = Signals(fine, fine, signals.changes_at, signals.changes, fine[1])
    picked = Signals(time, output, signals.changes_at, signals.changes, signals.finest)
    deads = _dead_times(problem)
    shifts = time[:, None] - deads
    found: list[tuple[float, int, int, Array]] = []
    shapes = _shapes(structure.model, signals.finest)
    for at, shape in enumerate(shapes):
        response = forced_response(everywhere, structure.model, shape, 0.0)[0]
        forced = np.interp(shifts, fine, response, left=0.0)
        fixed = [np.ones((len(rows), 1))]
        if not structure.at_rest:
            fixed.append(own_motion(picked, structure.model, shape))
        base = np.linalg.qr(np.concatenate(fixed, axis=1))[0]
        left, bent = output - base @ (base.T @ output), forced - base @ (base.T @ forced)
        power = np.maximum((bent**2).sum(axis=0), 1e-9 * (forced**2).sum(axis=0) + 1e-300)
        # what the best gain leaves:  |y|^2 - (h'y)^2/|h|^2  for what is orthogonal to the other columns
        rest = left @ left - (bent.T @ left) ** 2 / power
        found += [(float(value), at, k, shape) for k, value in enumerate(rest.tolist())]
    found.sort(key=lambda each: each[0])
    chosen: list[tuple[float, int, int, Array]] = []
    for each in found:
        if all(abs(each[2] - other[2]) > 2 or np.abs(each[3] - other[3]).max(initial=0.0) > 1.0 for other in chosen):
            chosen.append(each)
        if len(chosen) == _GUESSES:
            break
    return [_with_linear(picked, output, structure, shape, float(deads[k])) for _, _, k, shape in chosen]


def _dead_times(problem: Scaled) -> Array:
    """From somewhat below 0 to nearly the record's end; close to each other near 0."""
    longest = 0.95 * (1.0 - problem.first_change)
    near = np.linspace(-min(2 * problem.gap, problem.first_change), longest / 8, 24, endpoint=False)
    return np.concatenate([near, np.linspace(longest / 8, longest, 24)])


def _shapes(model: FitModel, finest: float) -> list[Array]:
    times = np.log(np.geomspace(max(finest / 3, 1e-5), 10.0, 24))
    if model is FitModel.LAG:
        return [np.array([each]) for each in times]
    if model is FitModel.SECOND_ORDER:
        # a2 = T^2, a1 = 2 zeta T
        return [np.array([2 * t, math.log(2 * zeta) + t]) for t in times[::2].tolist() for zeta in _DAMPINGS]
    return [np.zeros(0)]


def _with_linear(signals: Signals, output: Array, structure: Structure, shape: Array, dead: float) -> Array:
    linear = np.linalg.lstsq(structure.columns(signals, shape, dead), output, rcond=1e-9)[0]
    return np.concatenate([linear, shape, [dead]])


def least_squares_fit(
    problem: Scaled,
    structure: Structure,
    starts: list[Array],
    dead: float | None = None,
    least_dead: float = -math.inf,
    robust_scale: float = 0.0,
) -> Array:
    """The parameters with the least sum of squares, from several initial guesses.

    Args:
        problem: the scaled recording.
        structure: the model.
        starts: initial guesses, each of shape (structure.size,).
        dead: fixes the dead time, scaled.
        least_dead: the dead time's lower limit, scaled.
        robust_scale: with the loss soft_l1, which residuals beyond this size (scaled) hardly move; 0 for squares.
    """
    lowest = max(-max(problem.first_change, problem.gap), least_dead)
    anywhere = (lowest, 1.0) if dead is None else (dead, dead)
    rough = min((_solve_from(problem, structure, start, anywhere, 1e-4, robust_scale) for start in starts), key=_cost)
    if dead is not None or robust_scale > 0:
        return _solve_from(problem, structure, rough[1], anywhere, 1e-12, robust_scale)[1]
    found = [rough]
    # The sum of squares has a kink where the dead time passes a sample, and a solver may stop there.  So the intervals
    # between neighbouring samples are searched one by one.  With many samples a single kink does not matter.
    if problem.n <= _MAX_KINK_SAMPLES:
        few = problem.n <= _FEW_SAMPLES
        edges = _kinks(problem, rough[1][-1], _FAR_KINKS if few else 2)
        gaps = itertools.pairwise([edge for edge in edges if anywhere[0] <= edge <= anywhere[1]])
        found += [_solve_from(problem, structure, rough[1], gap, 1e-6) for gap in gaps if gap[1] - gap[0] > 1e-9]
    best = min(found, key=_cost)
    return min(best, _solve_from(problem, structure, best[1], anywhere), key=_cost)[1]


def _cost(found: tuple[float, Array]) -> float:
    return found[0]


def _kinks(problem: Scaled, dead: float, around: int) -> list[float]:
    """Dead times at which a large change of the input arrives at a sample: the next ones below and above one."""
    signals = problem.signals
    largest = np.argsort(-np.abs(signals.changes), kind="stable")[:8]
    arrivals = np.unique((signals.time[:, None] - signals.changes_at[largest]).round(12))
    at = int(np.searchsorted(arrivals, dead))
    return arrivals[max(at - around, 0) : at + around].tolist()


def _solve_from(
    problem: Scaled,
    structure: Structure,
    start: Array,
    dead: tuple[float, float],
    tolerance: float = 1e-12,
    robust_scale: float = 0.0,
) -> tuple[float, Array]:
    """Half the least sum of squares from one guess with the dead time in a range, and the parameters there."""
    from scipy.optimize import least_squares

    signals = problem.signals
    kept = structure.size if dead[0] < dead[1] else structure.size - 1
    fixed = np.array(dead[:1])[: structure.size - kept]
    squared = (2 * _TIMES[0], 2 * _TIMES[1])
    shapes = {FitModel.LAG: [_TIMES], FitModel.SECOND_ORDER: [squared, _TIMES]}.get(structure.model, [])
    ends = [(-np.inf, np.inf)] * structure.linear + shapes + [dead]
    low, high = np.array(ends[:kept]).T
    inside = 1e-3 * np.minimum(1e-4, high - low)

    def full(p: Array) -> Array:
        return np.concatenate([p, fixed])

    # derivatives are asked for where the residuals were computed last
    last: list[tuple[bytes, tuple[Array, Array]]] = []

    def responses(p: Array) -> tuple[Array, Array]:
        if not last or last[0][0] != p.tobytes():
            last[:] = [(p.tobytes(), structure.responses(signals, full(p)))]
        return last[0][1]

    solution: Any = least_squares(
        lambda p: responses(p)[0] @ full(p)[: structure.linear] - signals.output,
        np.clip(start[:kept], low + inside, high - inside),
        jac=lambda p: structure.jacobian(signals, full(p), responses(p))[:, :kept],  # pyright: ignore[reportArgumentType]
        bounds=(low, high),
        x_scale="jac",
        ftol=tolerance,
        xtol=tolerance,
        gtol=tolerance,
        max_nfev=150,
        loss="soft_l1" if robust_scale > 0 else "linear",
        f_scale=robust_scale or 1.0,
    )
    return float(solution.cost), full(solution.x)
