"""A model's parameters with intervals, from rest or not, and whether the recording tells them.

The initial state is fitted too.  Where the recording is too short before the input moves to tell both, the plant is
taken to be at rest, and a note says so.
"""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass

import numpy as np

from fopi_tune.core.bode_form import Array
from fopi_tune.core.text_tables.words import agreeing, counted
from fopi_tune.errors import DomainError
from fopi_tune.identification.covariance import ROUNDING_SHARE, Spread, spread_of
from fopi_tune.identification.models import FitModel, Signals, Structure
from fopi_tune.identification.recording import MIN_SAMPLES, Marks, Recording
from fopi_tune.identification.scaling import INPUT_NOISE, Scaled
from fopi_tune.identification.solve import initial_guesses, least_squares_fit

#: fewest samples within three time constants after a change arrives that determine the time constant
_MIN_RISE_SAMPLES = 3
#: dead times below this share of the record's length are rounding errors
ZERO_DEAD_TIME = 1e-9
#: an initial state is fitted where no interval is wider than this share of its number because of it
_WIDE = 0.1
#: share of the input's range that it must move within the first dead time to have moved before
_MOVES = 0.05
#: deviations of an initial state from rest that are taken to be one
_NOT_AT_REST = 3.3


@dataclass(frozen=True, eq=False)
class Solution:
    """Parameters of a structure, with intervals, in scaled units.

    Args:
        problem: the recording.
        structure: the model, and whether it starts at rest.
        parameters: shape (structure.size,).
        spread: half widths of their intervals.
        upper: upper end of the dead time, scaled.
        own_notes: what fitting showed, a sentence each.
    """

    problem: Scaled
    structure: Structure
    parameters: Array
    spread: Spread
    upper: float
    own_notes: tuple[str, ...] = ()

    @property
    def modelled(self) -> Array:
        """The model's output, shape (n,), scaled."""
        return self.structure.output(self.problem.signals, self.parameters)

    @property
    def widest(self) -> float:
        """The largest half width of gain and shape over their values; that of a time is that of its logarithm."""
        gain = self.structure.linear - 1
        half = self.spread.half[gain : gain + 1 + self.structure.model.shape_size].copy()
        half[0] /= max(abs(self.parameters[gain]), 1e-300)
        return float(half.max())

    def notes(self, recording: Recording) -> list[str]:
        """What the initial state and the dead time show."""
        found = list(self.own_notes)
        if not self.structure.at_rest:
            # what the plant does by itself between the first output and the last
            alone = self.parameters.copy()
            alone[0] = alone[self.structure.linear - 1] = 0.0
            motion = self.structure.output(self.problem.signals, alone)
            moved = float(motion[np.argmax(np.abs(motion))]) * self.problem.height
            own = slice(1, self.structure.linear - 1)
            clear = np.abs(self.parameters[own]) > _NOT_AT_REST * self.spread.deviations[own]
            if clear.any() and abs(moved) > 0.01 * self.problem.height:
                if self.structure.model is FitModel.INTEGRATOR:
                    found.append(f"with the first input the output drifts by {moved:.3g} over the record: fitted too")
                else:
                    found.append(
                        f"the plant is not at rest at first: the output is {moved:.3g} away from where its first input "
                        "holds it; the initial state is fitted too"
                    )
        return found


def solved(problem: Scaled, model: FitModel) -> Solution:
    """With a fitted initial state; from rest where the recording cannot tell both."""
    free = _attempt(problem, Structure(model, False))
    if isinstance(free, Solution) and free.widest <= _WIDE:
        return free
    late = _late(problem, Structure(model, False)) if isinstance(free, DomainError) else None
    if late is not None:
        return late
    rest = _attempt(problem, Structure(model, True))
    if isinstance(free, DomainError):
        if isinstance(rest, DomainError):
            raise rest
        return dataclasses.replace(rest, own_notes=(*rest.own_notes, *_rest_note(problem, None)))
    if isinstance(rest, DomainError) or rest.widest > 0.7 * free.widest or _refuted(rest, free):
        return free
    return dataclasses.replace(rest, own_notes=(*rest.own_notes, *_rest_note(problem, free)))


def _rest_note(problem: Scaled, free: Solution | None) -> list[str]:
    before = int(np.count_nonzero(problem.signals.time < problem.first_change))
    wide = f"; if not, a number can differ by {100 * min(free.widest, 9.99):.0f} %" if free is not None else ""
    return [
        f"the {counted(before, 'sample')} before the input moves cannot tell whether the plant was at rest, which is "
        f"assumed{wide}: record longer before"
    ]


def _refuted(rest: Solution, free: Solution) -> bool:
    """Whether the initial state explains more than chance would, by the F statistic at 0.1 %."""
    from scipy.stats import f as fisher

    errors = [float(np.sum((each.modelled - each.problem.signals.output) ** 2)) for each in (rest, free)]
    more, left = free.structure.size - rest.structure.size, free.problem.n - free.structure.size
    floor = ROUNDING_SHARE**2 * free.problem.n
    # correlated residuals are as many as their mean's variance shows
    statistic = (errors[0] - errors[1]) / more / ((errors[1] + floor) / left) / free.spread.inflation
    return statistic > float(fisher.ppf(0.999, more, left))


def _attempt(problem: Scaled, structure: Structure) -> Solution | DomainError:
    if problem.n < max(MIN_SAMPLES, structure.size + 3):
        return DomainError(
            f"has {counted(problem.n, 'sample')}; a fit with intervals needs at least {structure.size + 3}"
        )
    try:
        return _with_intervals(problem, structure, initial_guesses(problem, structure))
    except DomainError as error:
        return error


def _with_intervals(problem: Scaled, structure: Structure, starts: list[Array]) -> Solution:
    """The fit; a dead time below 0 by more than a change between two lines can make of it is fitted within bounds."""
    parameters = least_squares_fit(problem, structure, starts)
    _check_rise(problem, structure, parameters)
    spread = _spread(problem, structure, parameters, structure.size)
    # upper end of the dead time: for a change of the input right after the line with the old value
    upper = float(parameters[-1] + spread.half[-1]) + problem.gap
    notes: list[str] = []
    if parameters[-1] < -problem.gap - ZERO_DEAD_TIME:
        free = float(parameters[-1])
        inside = least_squares_fit(problem, structure, [parameters, *starts], least_dead=-problem.gap)
        parameters = least_squares_fit(problem, structure, [parameters], -problem.gap)
        kept = structure.size - 1
        if structure.squares(problem.signals, inside) < structure.squares(problem.signals, parameters) * (1 - 1e-9):
            parameters, kept = inside, structure.size
            spread = _spread(problem, structure, parameters, kept)
            upper = max(upper, float(parameters[-1] + spread.half[-1]) + problem.gap)
        spread = _spread(problem, structure, parameters, kept)
        if free < -problem.gap - ROUNDING_SHARE:
            taken = "0" if parameters[-1] <= 0 else f"{problem.length_s * float(parameters[-1]):.3g} s"
            below = f"{problem.length_s * free:.3g} s, below 0"
            notes.append(f"the fit's dead time is {below} by more than the time between two lines; {taken} is taken")
        if upper < -ROUNDING_SHARE:
            notes.append("the output moves before the input does: compare the time of both columns")
    upper = upper if upper > ZERO_DEAD_TIME else 0.0
    return Solution(problem, structure, parameters, spread, upper, tuple(notes))


def _spread(problem: Scaled, structure: Structure, parameters: Array, kept: int) -> Spread:
    modelled = structure.output(problem.signals, parameters)
    jacobian = structure.jacobian(problem.signals, parameters)[:, :kept]
    output = problem.signals.output
    found = spread_of(jacobian, output - modelled, output, modelled)
    filled = [np.concatenate([each, np.zeros(structure.size - kept)]) for each in (found.half, found.deviations)]
    return dataclasses.replace(found, half=filled[0], deviations=filled[1])


def without_unknown_past(problem: Scaled, solution: Solution) -> Solution | None:
    """A fit without the first outputs, which answer the input from before the first line, where that was another one.

    It was, where the input moves all the time, and where those outputs are far from a fit of the others: the recording
    begins with the first change of the input, as under a relay.
    """
    if solution.problem.n < problem.n:
        # they are left out already
        return None
    dead = float(solution.parameters[-1])
    times = problem.signals.time
    early = times < dead
    until = problem.signals.changes_at <= dead
    moves = int(np.count_nonzero(until))
    # a measured input's noise is no motion
    reach = float(np.ptp(np.cumsum(problem.signals.changes[until]))) if moves else 0.0
    always = moves >= 3 and moves >= 0.5 * early.sum() and reach >= _MOVES
    if solution.structure.at_rest or not early.any() or not (always or _stand_out(solution, early)):
        return None
    try:
        again = _with_intervals(problem.keep(~early), solution.structure, [solution.parameters])
    except DomainError:
        return None
    if always:
        first = f"the first {counted(int(early.sum()), 'output')}"
        return _noted(again, f"the input moves from the first line on, so that {first} are left out")
    return _if_others(problem, solution.parameters, again, early)


def _late(problem: Scaled, structure: Structure) -> Solution | None:
    """The fit without the outputs before the first dead time, where that of all is no plant but nearly as good."""
    parameters = least_squares_fit(problem, structure, initial_guesses(problem, structure))
    early = problem.signals.time < parameters[-1]
    if not early.any():
        return None
    kept = problem.keep(~early)
    again = _attempt(kept, structure)
    if isinstance(again, DomainError) or again.widest > _WIDE:
        return None
    return _if_others(problem, parameters, again, early)


def _if_others(problem: Scaled, parameters: Array, again: Solution, early: Marks) -> Solution | None:
    """The fit of the other outputs, if those before it miss it by more than chance: the F statistic at 0.1 %."""
    from scipy.stats import f as fisher

    first, left = int(early.sum()), again.problem.n - again.structure.size
    errors = (
        again.structure.squares(problem.signals, parameters),
        again.structure.squares(again.problem.signals, again.parameters),
    )
    per_output = errors[1] / left + ROUNDING_SHARE**2
    # correlated residuals are as many as their mean's variance shows
    statistic = (errors[0] - errors[1]) / first / per_output / again.spread.inflation
    if statistic <= float(fisher.ppf(0.999, first, left)):
        return None
    return _noted(
        again, f"the first {counted(first, 'output')} answer another input, from before the first line: left out"
    )


def _noted(solution: Solution, note: str) -> Solution:
    return dataclasses.replace(solution, own_notes=(*solution.own_notes, note))


def _stand_out(solution: Solution, early: Marks) -> bool:
    """Whether the early residuals are larger than the others, so that another fit is worth its time."""
    squares = (solution.modelled - solution.problem.signals.output) ** 2
    floor = ROUNDING_SHARE**2
    return float(squares[early].mean()) > 2.0 * float(squares[~early].mean()) + floor


def _check_rise(problem: Scaled, structure: Structure, parameters: Array) -> None:
    if structure.model is FitModel.INTEGRATOR:
        return
    # of a second order, how long its step response takes: the sum of its time constants, or that of its envelope
    times = np.exp(parameters[structure.linear : -1])
    tau = float(times[-1] if len(times) == 1 else max(times[1], math.sqrt(times[0])))
    dead, seconds, left = float(parameters[-1]), problem.length_s, 1.0 - problem.first_change
    if tau + dead > left:
        # a ramp: the response depends only on the ratio of gain and time constant
        longer = f"about {tau * seconds:.3g} s" if tau < 100 else "far longer"
        raise DomainError(
            f"the time constant ({longer}) with the dead time is longer than the record after the step "
            f"({left * seconds:.3g} s): record at least three time constants, or fit an integrator "
            "(`model='integrator'`)"
        )
    # only the last motion that has arrived can be within three time constants
    moves = np.concatenate([[-math.inf], _moves(problem.signals)])
    since = problem.signals.time - dead
    since -= moves[np.searchsorted(moves, since) - 1]
    on_rise = int(np.count_nonzero(since < 3 * tau))
    if on_rise < _MIN_RISE_SAMPLES:
        raise DomainError(
            f"only {counted(on_rise, 'sample')} {agreeing(on_rise, 'lies', 'lie')} on the rise, which takes about "
            f"{3 * tau * seconds:.3g} s: too few to tell the time constant; sample faster"
        )


def _moves(signals: Signals) -> Array:
    """Times at which the input has moved by another 2 % of its range: at a step, and now and then on a ramp."""
    held = np.cumsum(signals.changes)
    at: list[float] = []
    last = 0.0
    for time, value in zip(signals.changes_at.tolist(), held.tolist(), strict=True):
        if abs(value - last) > INPUT_NOISE:
            at.append(time)
            last = value
    return np.array(at)
