"""A plant model fitted to a recording by least squares, each number with its interval.

The model is simulated with the recorded input (`models.py`), and its initial state is fitted too, so that the input may
be anything and the plant need not be at rest.  Where the recording cannot tell whether it was, it is taken to be.

A change of the input is known only to lie in the gap between two lines: the last with the old value and the first with
the new one.  The fit takes it at the latter.  If it came earlier by d, the dead time is longer by d, while the other
numbers are unchanged.  So the upper end of the interval of the dead time is raised by the gap, and a fitted dead time
may be negative by up to the gap.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from fopi_tune.core.bode_form import Array
from fopi_tune.errors import DomainError
from fopi_tune.identification.covariance import ROUNDING_SHARE, Spread, spread_of
from fopi_tune.identification.models import FitModel, Structure
from fopi_tune.identification.outliers import without_outliers
from fopi_tune.identification.recording import MIN_SAMPLES, Recording
from fopi_tune.identification.residuals import residual_notes
from fopi_tune.identification.scaling import Scaled, scaled
from fopi_tune.identification.solve import initial_guesses, least_squares_fit
from fopi_tune.identification.table import counted

#: fewest samples within three time constants after a change arrives that determine the time constant
_MIN_RISE_SAMPLES = 3
#: dead times below this share of the record's length are rounding errors
_ZERO_DEAD_TIME = 1e-9
#: an initial state is fitted where no interval is wider than this share of its number because of it
_WIDE = 0.1
#: deviations of an initial state from rest that are taken to be one
_NOT_AT_REST = 3.3
_WORDS = {
    "static_gain": "static gain",
    "time_constant_s": "time constant",
    "dead_time_s": "dead time",
    "numerator[0]": "static gain",
    "denominator[0]": "coefficient of s^2",
    "denominator[1]": "of s",
    "gain": "gain",
}
_MODELS = (FitModel.LAG, FitModel.SECOND_ORDER, FitModel.INTEGRATOR)


@dataclass(frozen=True)
class Interval:
    """A fitted number and the interval of 95 % around it, low <= value <= high.

    Args:
        value: the fitted one, in the number's unit.
        low: lower end, in the number's unit.
        high: upper end, in the number's unit.
    """

    value: float
    low: float
    high: float


@dataclass(frozen=True, eq=False)
class Fit:
    """A fitted plant.

    Args:
        name: the recording's.
        model: what was fitted; with AUTO, what was chosen.
        numbers: the plant's numbers by their names in a spec: `static_gain`, `time_constant_s`, `dead_time_s` of a lag;
            `numerator[0]`, `denominator[0]`, `denominator[1]`, `dead_time_s` of a second order, whose last coefficient
            is 1; `gain`, `dead_time_s` of an integrator.  A dead time's value is that of a change of the input at the
            first line with the new value, its upper end that of one right after the line before.
        residual_std: standard deviation of the residuals, in the output's unit.
        aicc: Akaike's criterion, corrected for the number of samples; dimensionless, less is better.
        modelled: shape (n,), the model's output at the times of the outputs that were used, in its unit.
        rows: shape (n,), the rows of these outputs in the recording.
        notes: what the recording and the residuals show, a sentence each.
    """

    name: str
    model: FitModel
    numbers: Mapping[str, Interval]
    residual_std: float
    aicc: float
    modelled: Array
    rows: Array
    notes: tuple[str, ...]

    def __getitem__(self, number: str) -> Interval:
        """One of the numbers, by its name in a spec; `number` is a key of `numbers`."""
        return self.numbers[number]

    def summary(self) -> list[str]:
        """The numbers with their intervals, and the notes: lines of text."""

        def shown(name: str, unit: str = "") -> str:
            number = self.numbers[name]
            return f"{_WORDS[name]} {number.value:.5g} ({number.low:.5g} ... {number.high:.5g}){unit}"

        units = {"time_constant_s": " s", "dead_time_s": " s", "denominator[0]": " s^2", "denominator[1]": " s"}
        numbers = ", ".join(shown(name, units.get(name, "")) for name in self.numbers)
        told = [f"{self.name}: {numbers}, noise {self.residual_std:.3g}"]
        return told + [f"{self.name}: {note}" for note in self.notes]


def fit_plant(recording: Recording, model: FitModel = FitModel.LAG) -> Fit:
    """The plant that a recording shows, with intervals.

    Each interval is value +- t sqrt(c), with c from the covariance of the residuals, correlated or not, and the
    quantile t of Student's distribution (`covariance.py`); a coarse sensor's rounding is added.  The upper end of the
    dead time is raised by the gap between the lines around a change of the input.  A fitted dead time below 0 becomes
    0.  If it is below 0 by more than the gap, it is fixed at minus the gap and the other numbers are fitted again.
    Outliers are left out and named in a note, as is what the residuals show.

    Args:
        recording: of any input that moves.
        model: AUTO takes the one with the least AICc.

    Raises:
        DomainError: the recording cannot tell the numbers; the message says which and what to record instead.
    """
    try:
        if model is FitModel.AUTO:
            return _best(recording)
        return _fit(recording, model)
    except DomainError as error:
        raise DomainError(f"{recording.name}: {error}") from None


def _best(recording: Recording) -> Fit:
    """The fit of least AICc, and a note that says so."""
    fits: list[Fit] = []
    failed: list[str] = []
    for model in _MODELS:
        try:
            fits.append(_fit(recording, model))
        except DomainError as error:
            failed.append(f"{model.value}: {error}")
    if not fits:
        raise DomainError("no model can be fitted; " + "; ".join(failed))
    fits.sort(key=lambda each: each.aicc)
    others = [f"{each.model.value} {each.aicc - fits[0].aicc:.3g} more" for each in fits[1:]]
    others += [f"{each.partition(':')[0]} cannot be told" for each in failed]
    note = f"the model is {fits[0].model.value}, which has the least AICc: {', '.join(others)}"
    return dataclasses.replace(fits[0], notes=(note, *fits[0].notes))


def _fit(recording: Recording, model: FitModel) -> Fit:
    problem = scaled(recording)
    problem, outliers = without_outliers(problem, model)
    notes = list(recording.notes)
    if outliers.size:
        values = ", ".join(f"{value:g}" for value in recording.output[outliers[:4]].tolist())
        notes.append(f"{recording.where(outliers)}: far from the others ({values}), left out")
    solution = _solved(problem, model)
    solution = _without_unknown_past(problem, solution) or solution
    problem = solution.problem
    notes += solution.notes(recording)
    _check(solution)
    residuals = problem.signals.output - solution.modelled
    notes += residual_notes(recording, problem, solution.structure, solution.parameters, solution.spread)
    modelled = solution.modelled * problem.height + problem.level
    k = solution.structure.size + 1
    # of Gaussian residuals:  n log(RSS/n) + 2 k + 2 k (k + 1)/(n - k - 1)
    rounding = problem.n * ROUNDING_SHARE**2 * 1e-6
    aicc = problem.n * math.log((float(residuals @ residuals) + rounding) / problem.n)
    aicc += 2 * k + 2 * k * (k + 1) / max(problem.n - k - 1, 1)
    return Fit(
        recording.name,
        model,
        _numbers(solution),
        solution.spread.residual_std * problem.height,
        aicc,
        modelled,
        problem.rows,
        tuple(notes),
    )


# -- at rest or not ----------------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class _Solution:
    """Parameters of a structure, with intervals; `upper` is the upper end of the dead time, scaled."""

    problem: Scaled
    structure: Structure
    parameters: Array
    spread: Spread
    upper: float
    own_notes: tuple[str, ...] = ()

    @property
    def modelled(self) -> Array:
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


def _solved(problem: Scaled, model: FitModel) -> _Solution:
    """With a fitted initial state; from rest where the recording cannot tell both."""
    free = _attempt(problem, Structure(model, False))
    if isinstance(free, _Solution) and free.widest <= _WIDE:
        return free
    rest = _attempt(problem, Structure(model, True))
    if isinstance(free, DomainError):
        if isinstance(rest, DomainError):
            raise rest
        return dataclasses.replace(rest, own_notes=(*rest.own_notes, *_rest_note(problem, None)))
    if isinstance(rest, DomainError) or rest.widest > 0.7 * free.widest or _refuted(rest, free):
        return free
    return dataclasses.replace(rest, own_notes=(*rest.own_notes, *_rest_note(problem, free)))


def _rest_note(problem: Scaled, free: _Solution | None) -> list[str]:
    before = int(np.count_nonzero(problem.signals.time < problem.first_change))
    wide = f"; if not, a number can differ by {100 * min(free.widest, 9.99):.0f} %" if free is not None else ""
    return [
        f"the {counted(before, 'sample')} before the input moves cannot tell whether the plant was at rest, which is "
        f"assumed{wide}: record longer before"
    ]


def _refuted(rest: _Solution, free: _Solution) -> bool:
    """Whether the initial state explains more than chance would, by the F statistic at 0.1 %."""
    from scipy.stats import f as fisher

    errors = [float(np.sum((each.modelled - each.problem.signals.output) ** 2)) for each in (rest, free)]
    more, left = free.structure.size - rest.structure.size, free.problem.n - free.structure.size
    floor = ROUNDING_SHARE**2 * free.problem.n
    # correlated residuals are as many as their mean's variance shows
    statistic = (errors[0] - errors[1]) / more / ((errors[1] + floor) / left) / free.spread.inflation
    return statistic > float(fisher.ppf(0.999, more, left))


def _attempt(problem: Scaled, structure: Structure) -> _Solution | DomainError:
    if problem.n < max(MIN_SAMPLES, structure.size + 3):
        return DomainError(
            f"has {counted(problem.n, 'sample')}; a fit with intervals needs at least {structure.size + 3}"
        )
    try:
        return _with_intervals(problem, structure, initial_guesses(problem, structure))
    except DomainError as error:
        return error


def _with_intervals(problem: Scaled, structure: Structure, starts: list[Array]) -> _Solution:
    """The fit; a dead time below 0 by more than a change between two lines can make of it is fitted within bounds."""
    parameters = least_squares_fit(problem, structure, starts)
    _check_rise(problem, structure, parameters)
    spread = _spread(problem, structure, parameters, structure.size)
    # upper end of the dead time: for a change of the input right after the line with the old value
    upper = float(parameters[-1] + spread.half[-1]) + problem.gap
    notes: list[str] = []
    if parameters[-1] < -problem.gap - _ZERO_DEAD_TIME:
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
    upper = upper if upper > _ZERO_DEAD_TIME else 0.0
    return _Solution(problem, structure, parameters, spread, upper, tuple(notes))


def _spread(problem: Scaled, structure: Structure, parameters: Array, kept: int) -> Spread:
    modelled = structure.output(problem.signals, parameters)
    jacobian = structure.jacobian(problem.signals, parameters)[:, :kept]
    output = problem.signals.output
    found = spread_of(jacobian, output - modelled, output, modelled)
    filled = [np.concatenate([each, np.zeros(structure.size - kept)]) for each in (found.half, found.deviations)]
    return dataclasses.replace(found, half=filled[0], deviations=filled[1])


def _without_unknown_past(problem: Scaled, solution: _Solution) -> _Solution | None:
    """A fit without the first outputs, where the input moved all the time already: what it was before is not known."""
    dead = float(solution.parameters[-1])
    times = problem.signals.time
    early = times < dead
    moves = int(np.count_nonzero(problem.signals.changes_at <= dead))
    if solution.structure.at_rest or moves < 3 or moves < 0.5 * early.sum():
        return None
    rest = problem.keep(~early)
    try:
        again = _with_intervals(rest, solution.structure, [solution.parameters])
    except DomainError:
        return None
    note = (
        f"the input moves from the first line on, so that the first {counted(int(early.sum()), 'output')} are left out"
    )
    return dataclasses.replace(again, own_notes=(*again.own_notes, note))


# -- recordings that do not suffice, and the numbers -------------------------------------------------------------------


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
            f"({left * seconds:.3g} s): record at least three time constants, or fit an integrator (--model integrator)"
        )
    changes = problem.signals.changes_at[np.abs(problem.signals.changes) > 0.02]
    since = problem.signals.time[:, None] - changes[-200:] - dead
    on_rise = int(np.count_nonzero(((since > 0) & (since < 3 * tau)).any(axis=1)))
    if on_rise < _MIN_RISE_SAMPLES:
        raise DomainError(
            f"only {counted(on_rise, 'sample')} {'lies' if on_rise == 1 else 'lie'} on the rise, which takes about "
            f"{3 * tau * seconds:.3g} s: too few to tell "
            "the time constant; sample faster"
        )


def _check(solution: _Solution) -> None:
    gain = solution.structure.linear - 1
    half, value = solution.spread.half, solution.parameters
    if half[gain] >= abs(value[gain]):
        raise DomainError(
            "the output does not move beyond its noise: the static gain may be 0; record a larger step or less noise"
        )
    for name, number in _numbers(solution).items():
        if name != "dead_time_s" and not (number.low > 0 or number.high < 0):
            what = {"time_constant_s": "the time constant", "denominator[0]": "the coefficient of s^2"}.get(name, name)
            unit = " s^2" if name == "denominator[0]" else " s"
            around = max(number.high - number.value, number.value - number.low)
            hint = ", or a larger step" if name == "time_constant_s" else ", or fit a lag"
            raise DomainError(
                f"{what} is {number.value:.3g} +- {around:.3g}{unit}, which may be 0; record more samples on the "
                f"rise{hint}"
            )


def _numbers(solution: _Solution) -> dict[str, Interval]:
    """The plant's numbers in its units, by their names in a spec."""
    problem, structure = solution.problem, solution.structure
    value, half = solution.parameters, solution.spread.half
    seconds, gain = problem.length_s, structure.linear - 1
    unit = problem.height / problem.input_height
    if structure.model is FitModel.INTEGRATOR:
        unit /= seconds
    low, high = sorted((value[gain] + sign * half[gain]) * unit for sign in (-1.0, 1.0))
    size = Interval(float(value[gain] * unit), float(low), float(high))
    ends = (float(value[-1]), float(value[-1] - half[-1]), max(solution.upper, float(value[-1])))
    dead = Interval(*(max(0.0, end) * seconds for end in ends))
    if structure.model is FitModel.INTEGRATOR:
        return {"gain": size, "dead_time_s": dead}
    if structure.model is FitModel.LAG:
        tau = math.exp(value[gain + 1]) * seconds
        # half is that of log tau, so that of tau is tau times it
        return {"static_gain": size, "time_constant_s": _around(tau, tau * half[gain + 1]), "dead_time_s": dead}
    square, twice = np.exp(value[gain + 1 : -1]) * np.array([seconds**2, seconds])
    return {
        "numerator[0]": size,
        "denominator[0]": _around(square, square * half[gain + 1]),
        "denominator[1]": _around(twice, twice * half[gain + 2]),
        "dead_time_s": dead,
    }


def _around(value: float, half: float) -> Interval:
    return Interval(float(value), float(value - half), float(value + half))
