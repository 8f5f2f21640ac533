"""Time stepping of the exact fractional loop: saturation, any reference, loads, any initial state.

u = kp e + ki (I0 + I^alpha e), v = u within the actuator's limits, w = (v + load)(t - L), x' = Ax + Bw, y = Cx + gw.
Over one step e is a line between its values just after and just before the nodes, and its integral with full memory
is exact (product trapezoidal rule; Diethelm, The Analysis of Fractional Differential Equations, 2010, appendix C):

    I^alpha e(t_n) = sum_{j < n} (l_{n-j} e(t_j+) + r_{n-j} e(t_{j+1}-)),                                            (1)
    r_k = h^alpha/Gamma(alpha) int_0^1 (k - v)^{alpha-1} v dv,   l_k the same with 1 - v for v.                      (2)

A jump E_j of e makes u start as ki E_j (t - t_j)^alpha/Gamma(1 + alpha), which is not linear over a step.  That part,

    q(t) = c sum_j E_j (t - t_j)^alpha/Gamma(1 + alpha),   c = ki/(1 + kp g) without dead time, else ki,             (3)

is applied to the plant exactly while the actuator is within its limits; only v - q is taken as linear over a step:

    x_{n+1} = e^{Ah} x_n + int_0^h e^{A(h-v)} B (line of w - q, plus q) dv.                                          (4)

The error falls as h^2; for alpha < 1 as h^{1+alpha} in a loop with a direct path g, or with a lag far shorter than h,
where e too continues after a jump with a power of t.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import gamma

from fopi_tune.core.bode_form import Array
from fopi_tune.core.controller import FoPi
from fopi_tune.core.plant import Plant
from fopi_tune.core.text_tables.words import counted
from fopi_tune.errors import DomainError
from fopi_tune.simulation.fractional.quadrature import (
    StateSpace,
    integral_weights,
    linear_input_weights,
    power_input_weights,
    state_space,
)

#: an external signal: a number (a step at t = 0), values held from node to node, a continuous function of time, or the
#: values just before and just after each node
TimeSignal = float | Sequence[float] | Array | Callable[[Array], Array] | tuple[Array, Array]

#: tolerance within which the dead time has to be a whole number of steps
_WHOLE = 1e-9


class StepTooLongError(DomainError):
    """A step in which the control cannot follow: a shorter one may do."""


@dataclass(frozen=True)
class InitialState:
    """The loop's state at t = 0.

    Args:
        state: the plant's state in the form of `state_space`, whose first entry is the output; None: zeros.
        integral: I0, in the error's unit times s^alpha.
        past_control: the control for t < 0, still on its way through the dead time.
    """

    state: tuple[float, ...] | None = None
    integral: float = 0.0
    past_control: float = 0.0


@dataclass(frozen=True)
class TimeResponse:
    """One simulation; arrays of shape (n + 1,), values just after the nodes.

    Args:
        time_s: the nodes, s.
        output: the plant's output, in the reference's unit.
        control: the control within the actuator's limits, in its unit.
        demand: the controller's output before the limits.
        error: reference less output.
        rate: dy/dt, per s; with a direct path the quotient of differences over the step before.
    """

    time_s: Array
    output: Array
    control: Array
    demand: Array
    error: Array
    rate: Array


def simulate_fractional(
    gains: FoPi, plant: Plant, reference: TimeSignal, step_s: float, steps: int, *,
    limits: tuple[float, float] = (-math.inf, math.inf), load: TimeSignal = 0.0, start: InitialState | None = None,
) -> TimeResponse:  # fmt: skip
    """Simulate the loop over n equal steps; the cost grows as n^2.

    Args:
        gains: the controller, without anti-windup: it integrates also while the actuator is at a limit.
        plant: the plant; its dead time must be a whole number of steps.
        reference: a number, an array of n + 1 values held from node to node, or a continuous function of time.
        step_s: h, s, > 0.
        steps: n, >= 1.
        limits: least and greatest control, in the control's unit; they need not be symmetric.
        load: added to the control at the plant's input, after the limits; it is delayed by the dead time too.
        start: the state, integral and past control at t = 0; None: at rest.

    Returns:
        The response; its error falls as h^2, or as h^(1 + alpha) with a direct path and alpha < 1.

    Raises:
        DomainError: an invalid step, number of steps, limits, signal or start; a dead time that is no whole number of
            steps; a direct path for which the loop has no solution.
    """
    if not (step_s > 0.0 and math.isfinite(step_s) and steps >= 1):
        raise DomainError(f"step_s = {step_s!r} and steps = {steps!r} must be greater than 0")
    if not limits[0] < limits[1]:
        raise DomainError(f"limits = {limits!r} leave no room for the control; the lower one comes first")
    model = state_space(plant)
    simulation = _Simulation(
        gains, model, step_s, steps, limits, _lag(plant.dead_time_s, step_s), start or InitialState()
    )
    arriving = _delayed_sides(_sides(load, step_s, steps, "load"), simulation.lag)
    sides = _sides(reference, step_s, steps, "reference")
    simulation.run(sides, arriving)
    rate = simulation.rate
    if model.direct != 0.0:
        # within each step, from just after its start to just before its end
        rate = np.concatenate(
            [rate[:1], (sides[0] - simulation.error_before - np.roll(simulation.output, 1))[1:] / step_s]
        )
    return TimeResponse(
        np.asarray(step_s * np.arange(steps + 1.0), dtype=float),
        simulation.output,
        simulation.control,
        simulation.demand,
        simulation.error,
        rate,
    )


def _lag(dead_time: float, step: float) -> int:
    lag = round(dead_time / step)
    if abs(dead_time - lag * step) > _WHOLE * max(step, dead_time):
        near = dead_time / math.ceil(dead_time / step)
        raise DomainError(f"the dead time {dead_time!r} s is no whole number of steps; step_s = {near!r} would do")
    return lag


def _sides(signal: TimeSignal, step: float, steps: int, name: str) -> tuple[Array, Array]:
    """Values just before and just after the nodes."""
    if isinstance(signal, tuple) and len(signal) == 2 and np.ndim(signal[0]) == 1:
        before, after = (np.asarray(side, dtype=float) for side in signal)
    elif callable(signal):
        after = np.array(signal(np.asarray(step * np.arange(steps + 1.0), dtype=float)), dtype=float)
        before = after.copy()
    else:
        held = np.asarray(signal, dtype=float)
        after = np.full(steps + 1, float(held)) if held.ndim == 0 else held.copy()
        before = np.concatenate([after[:1], after[:-1]])
    if after.shape != (steps + 1,) or before.shape != after.shape or not np.all(np.isfinite(after + before)):
        raise DomainError(f"the {name} needs {steps + 1} finite values, one a node; it has shape {after.shape}")
    return before, after


def _delayed_sides(sides: tuple[Array, Array], lag: int) -> tuple[Array, Array]:
    """The same signal `lag` nodes later, and 0 until then."""
    before, after = sides
    if lag == 0:
        return sides
    kept, rest = max(len(after) - lag, 0), np.zeros(min(lag, len(after)))
    before = np.concatenate([rest, [0.0], before[1:kept]])[: len(after)]
    return before, np.concatenate([rest, after[:kept]])


class _Simulation:
    """One pass through time, node by node."""

    def __init__(
        self, gains: FoPi, model: StateSpace, step: float, steps: int, limits: tuple[float, float], lag: int,
        start: InitialState,
    ) -> None:  # fmt: skip
        self.gains, self.model, self.limits, self.lag, self.start = gains, model, limits, lag, start
        if lag == 0 and not 1.0 + gains.kp * model.direct > 0.0:
            raise DomainError("1 + kp P(inf) <= 0 without dead time: the loop has no answer to a jump; change kp")
        state = np.zeros(len(model.a)) if start.state is None else np.asarray(start.state, dtype=float)
        if state.shape != (len(model.a),) or not np.all(np.isfinite(state)):
            raise DomainError(f"start.state has shape {state.shape}; the plant has {counted(len(model.a), 'state')}")
        self.x = state
        left, right = integral_weights(gains.alpha, step, steps)
        # reversed, so that the sum over the history is a dot product with a slice
        self.left, self.right = left[::-1].copy(), right[::-1].copy()
        self.transition, self.begin, self.end, nodes = linear_input_weights(model, step)
        self.through = power_input_weights(nodes, gains.alpha, step, steps)
        self.power = (step * np.arange(steps + 1)) ** gains.alpha / gamma(1.0 + gains.alpha)
        self.factor = gains.ki / (1.0 + (gains.kp * model.direct if lag == 0 else 0.0))
        self.steps = steps
        self.output, self.control, self.demand, self.error, self.rate = np.zeros((5, steps + 1))
        self.error_before, self.control_before, self.demand_before, self.singular = np.zeros((4, steps + 1))
        self.at_limit, self.at_jump = np.zeros((2, steps + 1), dtype=bool)
        self.jump_nodes: list[int] = []
        self.jumps: list[float] = []

    def run(self, reference: tuple[Array, Array], load: tuple[Array, Array]) -> None:
        """All nodes in turn."""
        self._after(0, self.start.integral, reference, load)
        for n in range(1, self.steps + 1):
            integral = self._before(n, reference[0][n], load[0][n], load[1][n - 1])
            self._after(n, integral, reference, load)

    def _saturate(self, demand: float) -> float:
        return min(max(demand, self.limits[0]), self.limits[1])

    def _solve(self, constant: float, slope: float) -> float:
        """u = constant - slope cut(u): the only solution for slope > -1."""
        if not slope > -1.0:
            raise StepTooLongError(
                "the step is too long for this loop's gain: no control solves it; take a smaller step_s"
            )
        demand = constant / (1.0 + slope)
        cut = self._saturate(demand)
        return demand if cut == demand else constant - slope * cut

    def _delayed(self, n: int, values: Array) -> float:
        return float(values[n - self.lag]) if n >= self.lag else self.start.past_control

    def _before(self, n: int, reference: float, load: float, load_begin: float) -> float:
        """Step (4) to node n and the values just before it; returns the integral there."""
        model, kp, ki = self.model, self.gains.kp, self.gains.ki
        at, jumps = np.array(self.jump_nodes), np.array(self.jumps)
        self.singular[n] = self.factor * float(jumps @ self.power[n - at])
        cell = n - 1 - self.lag
        within = cell >= 0 and not self.at_limit[cell]
        line_begin = self._delayed(n - 1, self.control) + load_begin
        line_end = load
        self.x = self.transition @ self.x
        if within:
            line_begin -= self.singular[cell]
            line_end -= self.singular[cell + 1]
            begun = at <= cell
            self.x = self.x + self.factor * (jumps[begun] @ self.through[cell - at[begun]])
        # without dead time the control at the step's end is not yet known
        known = self.lag > 0
        own = 0.0 if not known else (self.control_before[n - self.lag] if n > self.lag else self.start.past_control)
        self.x = self.x + self.begin * line_begin + self.end * (line_end + own)
        history = self.left[self.steps - n :] @ self.error[:n]
        history += self.right[self.steps - n : -1] @ self.error_before[1:n]
        weight = self.right[-1]
        gain = kp + ki * weight
        through = 0.0 if known else float(model.c @ self.end) + model.direct
        rest = reference - float(model.c @ self.x) - model.direct * (load + own)
        demand = self._solve(gain * rest + ki * (self.start.integral + history), gain * through)
        cut = self._saturate(demand)
        if not known:
            self.x = self.x + self.end * cut
        self.control_before[n], self.demand_before[n] = cut, demand
        self.error_before[n] = rest - through * cut
        return self.start.integral + float(history + weight * self.error_before[n])

    def _after(self, n: int, integral: float, reference: tuple[Array, Array], load: tuple[Array, Array]) -> None:
        """The values just after node n, and the jump of the error there."""
        model, kp, ki = self.model, self.gains.kp, self.gains.ki
        outside = reference[1][n] != reference[0][n] or load[1][n] != load[0][n]
        arriving = model.direct != 0.0 and n >= self.lag > 0 and self.at_jump[n - self.lag]
        self.at_jump[n] = n == 0 or outside or arriving
        if not self.at_jump[n]:
            self.demand[n], self.control[n] = self.demand_before[n], self.control_before[n]
            self.error[n] = self.error_before[n]
        else:
            late = self._delayed(n, self.control) if self.lag else 0.0
            rest = reference[1][n] - float(model.c @ self.x) - model.direct * (load[1][n] + late)
            own = model.direct if self.lag == 0 else 0.0
            self.demand[n] = self._solve(kp * rest + ki * integral, kp * own)
            self.control[n] = self._saturate(self.demand[n])
            self.error[n] = rest - own * self.control[n]
            # the error is 0 before t = 0, so that its first value is a jump
            self.jump_nodes.append(n)
            self.jumps.append(float(self.error[n] - self.error_before[n]))
        self.at_limit[n] = self.control[n] != self.demand[n]
        self.output[n] = reference[1][n] - self.error[n]
        # y' = C (A x + B w), without a direct path
        acting = self._delayed(n, self.control) + load[1][n]
        self.rate[n] = float(model.c @ (model.a @ self.x + model.b * acting))
