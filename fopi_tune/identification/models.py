"""Plant models and their exact response to a held input:  shape, dead time, input -> output at the samples.

The input is constant between its changes, so that the response is exact between any two times.  With u the input's
deviation from its first value, delayed by the dead time L, the response to it from rest is y_f with gain 1:

    lag            tau y' + y = u                       shape: (log tau)
    second order   a2 y'' + a1 y' + y = u               shape: (log a2, log a1)
    integrator     y' = u                               shape: ()

The output is  y = c + h H(t) + gain y_f(t),  with a level c, and what a plant does by itself, H, that does not start at
rest: e^{-t/tau}; both solutions of the homogeneous equation; a ramp.  Everything here is in scaled units.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import Enum

import numpy as np

from fopi_tune.core.bode_form import Array

#: step of the central differences in the logarithmic shape
_STEP = 1e-5


class FitModel(Enum):
    """Models of a plant that can be fitted; AUTO is the one with the least AICc."""

    LAG = "lag"
    SECOND_ORDER = "second_order"
    INTEGRATOR = "integrator"
    AUTO = "auto"

    @property
    def shape_size(self) -> int:
        """How many numbers besides gain and dead time the model has."""
        return {FitModel.LAG: 1, FitModel.SECOND_ORDER: 2}.get(self, 0)

    @property
    def rest_size(self) -> int:
        """How many numbers say that the plant does not start at rest."""
        return {FitModel.SECOND_ORDER: 2}.get(self, 1)


@dataclass(frozen=True, eq=False)
class Signals:
    """Times of the outputs, and changes of the input; scaled.

    Args:
        time: shape (n,), of the outputs, from 0 (the first line) to at most 1.
        output: shape (n,).
        changes_at: shape (m,), times of the input's changes.
        changes: shape (m,), their heights.
        finest: shortest time between two outputs.
    """

    time: Array
    output: Array
    changes_at: Array
    changes: Array
    finest: float


def forced_response(signals: Signals, model: FitModel, shape: Array, dead: float) -> tuple[Array, Array]:
    """y_f and its derivative at the outputs' times, from rest, each of shape (n,).

    Outputs and delayed changes of the input are put in one order, and the state goes exactly from each to the next.
    """
    events = np.concatenate([signals.time, signals.changes_at + dead])
    order = np.argsort(events, kind="stable")  # an output at the time of a change comes before it
    steps = np.diff(events[order])
    held = np.cumsum(np.concatenate([np.zeros(len(signals.time)), signals.changes])[order])
    state, slope = _states(model, shape, steps, held)
    place = np.empty(len(events), dtype=np.int64)
    place[order] = np.arange(len(events))
    at = place[: len(signals.time)]
    return state[at], slope[at]


def _states(model: FitModel, shape: Array, steps: Array, held: Array) -> tuple[Array, Array]:
    """Output and slope at every event, from rest; `held` is the input after each."""
    if model is FitModel.INTEGRATOR:
        return np.concatenate([[0.0], np.cumsum(steps * held[:-1])]), held
    if model is FitModel.LAG:
        tau = math.exp(shape[0])
        # x(t + h) = e^{-h/tau} x(t) + (1 - e^{-h/tau}) u
        kept = np.exp(-steps / tau)
        state = _recursion([[kept]], [-np.expm1(-steps / tau) * held[:-1]])[0]
        return state, (held - state) / tau
    period, (e11, e12, e21, e22) = math.exp(0.5 * shape[0]), _second_order_steps(shape, steps)
    # x = (y, T y');  x(t + h) = E x(t) + (I - E) (u, 0)
    state, slope = _recursion([[e11, e12], [e21, e22]], [(1.0 - e11) * held[:-1], -e21 * held[:-1]])
    return state, slope / period


def _second_order_steps(shape: Array, steps: Array) -> tuple[Array, Array, Array, Array]:
    """E = e^{A h/T} with A = (0, 1; -1, -2 zeta), T^2 = a2, 2 zeta T = a1:  c I + s (A + zeta I)."""
    period = math.exp(0.5 * shape[0])
    zeta, h = 0.5 * math.exp(shape[1]) / period, steps / period
    square = zeta**2 - 1.0
    if abs(square) < 1e-10:
        decay = np.exp(-zeta * h)
        c, s = decay, decay * h
    elif square < 0:
        omega, decay = math.sqrt(-square), np.exp(-zeta * h)
        c, s = decay * np.cos(omega * h), decay * np.sin(omega * h) / omega
    else:
        delta = math.sqrt(square)
        slow = np.exp(-h / (zeta + delta))  # zeta - delta = 1/(zeta + delta)
        fast = -np.expm1(-2.0 * delta * h)
        c, s = slow * (1.0 - 0.5 * fast), slow * fast / (2.0 * delta)
    return c + zeta * s, s, -s, c - zeta * s


def _recursion(factors: list[list[Array]], added: list[Array]) -> list[Array]:
    """x[k+1] = F[k] x[k] + a[k] from x[0] = 0, for states of one or two numbers: a banded triangular system."""
    from scipy.linalg import solve_banded

    order, count = len(factors), len(added[0]) + 1
    right = np.zeros((count, order))
    right[1:] = np.stack(added, axis=1)
    width = 2 * order - 1
    bands = np.zeros((width + 1, count * order))
    bands[0] = 1.0
    for row in range(order):
        for column in range(order):
            # entry (order (k+1) + row, order k + column)
            bands[order + row - column, column::order][: count - 1] = -factors[row][column]
    solved = solve_banded((width, 0), bands, right.ravel(), check_finite=False).reshape(count, order)
    return [solved[:, k] for k in range(order)]


def own_motion(signals: Signals, model: FitModel, shape: Array) -> Array:
    """H, what the plant does without input, from the first output on: shape (n, 1) or (n, 2)."""
    late = signals.time - signals.time[0]
    if model is FitModel.INTEGRATOR:
        return late[:, None]
    if model is FitModel.LAG:
        return np.exp(-late / math.exp(shape[0]))[:, None]
    e11, e12, _, _ = _second_order_steps(shape, late)
    return np.column_stack([e11, e12])


@dataclass(frozen=True)
class Structure:
    """A model, and whether it starts at rest.

    The parameters are, in this order: c, h (one or two, unless at rest), gain, shape (none to two), dead time.
    """

    model: FitModel
    at_rest: bool

    @property
    def linear(self) -> int:
        """How many parameters the output is linear in; the last of them is the gain."""
        return 2 + (0 if self.at_rest else self.model.rest_size)

    @property
    def size(self) -> int:
        """How many parameters there are."""
        return self.linear + self.model.shape_size + 1

    def columns(self, signals: Signals, shape: Array, dead: float) -> Array:
        """What the linear parameters multiply, shape (n, linear)."""
        return self._columns_and_slope(signals, shape, dead)[0]

    def _columns_and_slope(self, signals: Signals, shape: Array, dead: float) -> tuple[Array, Array]:
        """These columns, and the derivative of the last one with respect to time, shape (n,)."""
        parts = [np.ones((len(signals.time), 1))]
        if not self.at_rest:
            parts.append(own_motion(signals, self.model, shape))
        forced, slope = forced_response(signals, self.model, shape, dead)
        return np.concatenate([*parts, forced[:, None]], axis=1), slope

    def responses(self, signals: Signals, parameters: Array) -> tuple[Array, Array]:
        """What output and jacobian at parameters both need: columns (n, linear), and the last one's slope (n,)."""
        return self._columns_and_slope(signals, parameters[self.linear : -1], parameters[-1])

    def output(self, signals: Signals, parameters: Array) -> Array:
        """The model's output, shape (n,)."""
        return self.responses(signals, parameters)[0] @ parameters[: self.linear]

    def squares(self, signals: Signals, parameters: Array) -> float:
        """Sum of the squared residuals."""
        return float(np.sum((self.output(signals, parameters) - signals.output) ** 2))

    def jacobian(self, signals: Signals, parameters: Array, responses: tuple[Array, Array] | None = None) -> Array:
        """Derivatives of the output with respect to the parameters, shape (n, size)."""
        linear, shape, dead = parameters[: self.linear], parameters[self.linear : -1], parameters[-1]
        by_shape: list[Array] = []
        for k in range(len(shape)):
            ends = [
                self.columns(signals, shape + sign * _STEP * (np.arange(len(shape)) == k), dead) for sign in (1, -1)
            ]
            by_shape.append((ends[0] - ends[1]) @ linear / (2 * _STEP))
        columns, slope = responses or self.responses(signals, parameters)
        # y_f(t; L) = y_f(t - L; 0)
        return np.column_stack([columns, *by_shape, -linear[-1] * slope])
