"""Outliers of a recording:  single outputs far from what a robustly fitted model and their neighbours say."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from fopi_tune.core.bode_form import Array
from fopi_tune.identification.covariance import quantum_of
from fopi_tune.identification.models import FitModel, Structure
from fopi_tune.identification.scaling import Scaled
from fopi_tune.identification.solve import initial_guesses, least_squares_fit

#: residuals around one that say what is usual there; spikes are shorter than half of it
_WINDOW = 15
#: deviations from the neighbours' median, and share of the output's range, beyond which a residual is an outlier
_FAR, _FAR_SHARE = 6.0, 0.02
#: and steps of a coarse sensor
_FAR_QUANTA = 2.5
#: share of the outputs that may be outliers; more are no outliers but what the plant does
_MOST = 0.1
#: 1 / (median of |x| for a standard normal x)
_NORMAL = 1.4826


def without_outliers(problem: Scaled, model: FitModel) -> tuple[Scaled, NDArray[np.int64]]:
    """The recording without its outliers, and their rows in it.

    The model is fitted with the loss soft_l1, which spikes hardly move.  An outlier is far from the model by more than
    its neighbours are.  Fast motions that a lag does not follow look alike; so a second order has to say the same.
    """
    found = _returning(_outliers(problem, model), problem.signals.output)
    if found.any() and model is not FitModel.SECOND_ORDER:
        found &= _outliers(problem, FitModel.SECOND_ORDER)
    if not found.any() or found.mean() > _MOST:
        return problem, np.zeros(0, dtype=np.int64)
    return problem.keep(~found), problem.rows[found]


def _outliers(problem: Scaled, model: FitModel) -> NDArray[np.bool_]:
    structure = Structure(model, False)
    if problem.n < structure.size + 3:
        return np.zeros(problem.n, dtype=bool)
    guess = initial_guesses(problem, structure)[0]
    residuals = problem.signals.output - structure.output(problem.signals, guess)
    # the guess is coarse, but a spike stands out of it already
    least = max(_FAR_SHARE, _FAR_QUANTA * quantum_of(problem.signals.output))
    if not _apart(residuals, least).any():
        return np.zeros(problem.n, dtype=bool)
    scale = max(_NORMAL * float(np.median(np.abs(residuals - np.median(residuals)))), 1e-3)
    parameters = least_squares_fit(problem, structure, [guess], robust_scale=1.5 * scale)
    return _apart(problem.signals.output - structure.output(problem.signals, parameters), least)


def _returning(found: NDArray[np.bool_], output: Array) -> NDArray[np.bool_]:
    """Those beyond both what comes before and what comes after: a plant on its way lies between them."""
    least = max(_FAR_SHARE, _FAR_QUANTA * quantum_of(output))
    spikes = found.copy()
    for k in np.flatnonzero(found).tolist():
        sides = [output[max(k - _WINDOW, 0) : k], output[k + 1 : k + 1 + _WINDOW]]
        middles = [float(np.median(side)) for side in sides if side.size]
        spikes[k] = not min(middles) - least <= output[k] <= max(middles) + least
    return spikes


def _apart(residuals: Array, least: float) -> NDArray[np.bool_]:
    from scipy.ndimage import median_filter

    apart = np.abs(residuals - median_filter(residuals, min(_WINDOW, len(residuals) // 2 * 2 - 1), mode="nearest"))
    usual = _NORMAL * float(np.median(apart))
    return apart > max(_FAR * usual, least)
