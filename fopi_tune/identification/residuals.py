"""What a fit leaves:  correlation, a trend, a step, a limit of the sensor, each a note with numbers."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass

import numpy as np

from fopi_tune.core.bode_form import Array
from fopi_tune.core.text_tables.words import counted
from fopi_tune.errors import DomainError
from fopi_tune.identification.covariance import ROUNDING_SHARE, Spread, spread_of
from fopi_tune.identification.models import FitModel, Structure
from fopi_tune.identification.recording import Recording
from fopi_tune.identification.scaling import Scaled
from fopi_tune.identification.solve import initial_guesses, least_squares_fit

#: residuals with a larger lag-one correlation are not independent noise
_MAX_CORRELATION = 0.5
#: share of the output's range, and deviations, beyond which a trend or a step in the residuals is one
_SHARE, _DEVIATIONS = 0.03, 4.0
#: equal outputs in a row, at an end of their range, that are a limit where other outputs in a row differ
_LEAST_EQUAL, _FEW_EQUAL = 5, 0.3
#: share of the output's range that residuals of a noisy sensor have
_NOISY_SHARE = 0.002
_PLACES = 60
#: of the model, with a column that explains its residuals
_REFITS = 3
#: share of a lag's residuals from which a second order is worth a note
_MUCH_LESS = 0.8


def residual_notes(
    recording: Recording, problem: Scaled, structure: Structure, parameters: Array, spread: Spread
) -> list[str]:
    """Notes about a fit's residuals, in the recording's units."""
    modelled = structure.output(problem.signals, parameters)
    residuals = problem.signals.output - modelled
    notes = _limits(recording, problem, modelled)
    if float(residuals @ residuals) <= problem.n * ROUNDING_SHARE**2:
        return notes
    if abs(spread.correlation) > _MAX_CORRELATION:
        share = 100 * spread.residual_std
        notes.append(
            f"what the curve leaves, {share:.3g} % of the output's range, is no independent noise (correlation "
            f"{spread.correlation:.2f} from one sample to the next): the plant is not quite of this model, or is "
            "disturbed; the intervals are wider for it"
        )
    if spread.quantum > 0:
        notes.append(
            f"the output is read in steps of {spread.quantum * problem.height:.3g}, "
            f"{100 * spread.quantum:.2g} % of its range; the intervals hold what this hides"
        )
    if notes and notes[0].startswith("the output stays at"):
        return notes
    reasons = [
        reason
        for reason in (
            _second_order(problem, structure, spread),
            _trend(problem, structure, parameters, spread),
            _step(recording, problem, structure, parameters, spread),
        )
        if reason is not None
    ]
    # what explains most of it
    return notes + [reason.text for reason in sorted(reasons, key=lambda each: each.left)[:1]]


@dataclass(frozen=True)
class _Reason:
    """What would explain residuals, in words, and the standard deviation of what it leaves of them."""

    text: str
    left: float


def _second_order(problem: Scaled, structure: Structure, spread: Spread) -> _Reason | None:
    """That a second order leaves much less, where a lag leaves correlated residuals."""
    if structure.model is not FitModel.LAG or spread.correlation <= _MAX_CORRELATION:
        return None
    other = Structure(FitModel.SECOND_ORDER, structure.at_rest)
    parameters = least_squares_fit(problem, other, initial_guesses(problem, other))
    left = math.sqrt(other.squares(problem.signals, parameters) / max(problem.n - other.size, 1))
    if left > _MUCH_LESS * spread.residual_std:
        return None
    return _Reason(f"a second order leaves {100 * left:.3g} % of the output's range: try `model='second_order'`", left)


def _trend(problem: Scaled, structure: Structure, parameters: Array, spread: Spread) -> _Reason | None:
    if structure.model is FitModel.INTEGRATOR:
        # which drifts by itself
        return None
    found = _added(problem, structure, parameters, problem.signals.time, spread.quantum)
    if found is None:
        return None
    size, _, left = found
    text = (
        f"what the curve leaves has a trend of {size * problem.height / problem.length_s:.3g} per s, "
        f"{100 * abs(size):.3g} % of the output's range over the record: the plant drifts, or does not end where this "
        "model does"
    )
    return _Reason(text, left)


def _step(
    recording: Recording, problem: Scaled, structure: Structure, parameters: Array, spread: Spread
) -> _Reason | None:
    """The step in the residuals that explains most of them."""
    n = problem.n
    jacobian = structure.jacobian(problem.signals, parameters)
    residuals = problem.signals.output - structure.output(problem.signals, parameters)
    basis = np.linalg.qr(jacobian)[0]
    explained: list[tuple[float, int]] = []
    for place in np.unique(np.linspace(_LEAST_EQUAL, n - _LEAST_EQUAL, _PLACES).astype(int)).tolist():
        column = (np.arange(n) >= place).astype(float)
        left = column - basis @ (basis.T @ column)
        power = float(left @ left)
        if power > 1e-3 * n:
            explained.append((float(left @ residuals) ** 2 / power, place))
    if not explained:
        return None
    place = max(explained)[1]
    found = _added(problem, structure, parameters, (np.arange(n) >= place).astype(float), spread.quantum)
    # the best of many places is looked at
    if found is None or abs(found[0]) < 1.5 * _DEVIATIONS * found[1]:
        return None
    size, _, remaining = found
    where = recording.where(problem.rows[place : place + 1])
    at = float(recording.time_s[problem.rows[place]])
    text = (
        f"what the curve leaves steps by {size * problem.height:.3g} at about {at:.4g} s ({where}), "
        f"{100 * abs(size):.3g} % of the output's range, without the input: a disturbance? keep what is before or "
        "after (`end_s`, `start_s`)"
    )
    return _Reason(text, remaining)


def _added(
    problem: Scaled, structure: Structure, parameters: Array, column: Array, quantum: float
) -> tuple[float, float, float] | None:
    """How much of a further column explains, its deviation and what it leaves, if it is much and certain; scaled."""
    signals, size, deviation = problem.signals, 0.0, 0.0
    without = problem
    for _ in range(_REFITS):
        jacobian = structure.jacobian(signals, parameters)
        residuals = signals.output - size * column - structure.output(signals, parameters)
        basis = np.linalg.qr(jacobian)[0]
        # a column that the model has nearly itself says nothing
        left = column - basis @ (basis.T @ column)
        if float(left @ left) < 1e-4 * float(np.sum((column - column.mean()) ** 2)):
            return None
        change = float(left @ residuals) / float(left @ left)
        size += change
        try:
            after = residuals - basis @ (basis.T @ residuals) - change * left
            deviation = float(
                spread_of(np.column_stack([jacobian, column]), after, after, signals.output).deviations[-1]
            )
        except DomainError:
            return None
        if abs(size) <= max(_SHARE, quantum, _DEVIATIONS * deviation):
            return None
        without = dataclasses.replace(
            problem, signals=dataclasses.replace(signals, output=signals.output - size * column)
        )
        parameters = least_squares_fit(without, structure, [parameters])
    left_over = structure.squares(without.signals, parameters) / max(problem.n - structure.size - 1, 1)
    return size, deviation, math.sqrt(left_over)


def _limits(recording: Recording, problem: Scaled, modelled: Array) -> list[str]:
    """Outputs that stay at an end of their range where the model moves on, or where a noisy sensor would not."""
    output = recording.output[problem.rows]
    equal = np.diff(output) == 0
    notes: list[str] = []
    for end, word in ((output.max(), "largest"), (output.min(), "smallest")):
        at = output == end
        edges = np.flatnonzero(np.diff(np.concatenate([[0], at.astype(int), [0]])))
        first, last = max(zip(edges[::2].tolist(), (edges[1::2] - 1).tolist(), strict=True), key=lambda e: e[1] - e[0])
        others = equal[~(at[1:] & at[:-1])]
        in_a_row = last - first + 1
        if in_a_row < max(_LEAST_EQUAL, 0.02 * len(output)) or others.mean() > _FEW_EQUAL:
            continue
        run = modelled[first : last + 1]
        moves = float(np.ptp(run)) > _SHARE or abs(float(run.mean() - problem.signals.output[first])) > _SHARE
        # a plant that stands still may have no noise
        starts = float(np.abs(problem.signals.output[first])) < 0.1
        noisy = float(np.std(problem.signals.output[~at] - modelled[~at])) > _NOISY_SHARE
        if (starts and first == 0) or (not moves and (starts or not noisy)):
            continue
        places = problem.rows[[first, last]]
        notes.append(
            f"the output stays at its {word} value, {end:.4g}, {counted(int(at.sum()), 'time')}, "
            f"{in_a_row} of them in a row "
            f"({recording.where(places[:1])} to {recording.lines[places[1]]}): a limit of the sensor or plant, which "
            "the model does not have; leave it out with `start_s` and `end_s`, or record a smaller step"
        )
    return notes
