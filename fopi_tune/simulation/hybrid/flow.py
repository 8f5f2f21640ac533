"""The closed loop of one mode between events: linear, propagated exactly, with bounds of its second derivatives.

    y' = -p y + g v,   v = u cut to the limits,   u = kp e + ki sum_k rho_k x_k,   x_k' = p_k x_k + e,   e = r - y,  (1)

with r' = slope.  w = (y, x, r, slope, 1) obeys w' = M w as long as u stays within the limits, at the lower or at the
upper one; w goes ahead by e^{Mh} - 1 for the steps h = H 2^-k, which are tabulated.

Bounds.  Let d_k = x_k' and B the greatest |y''| on [t, t + h].  As d_k' = p_k d_k + e' and 1 - e^{-a} <= min(1, a),

    |d_k(s) - d_k(t)| <= |d_k(t)| min(1, |p_k| h) + (|e'(t)| + h B) min(h, 1/|p_k|),                                (2)

and with y'' = -p y' + G (kp e' + ki sum_k rho_k d_k), G = g or, at a limit, 0, and
c = |G ki| sum_k |rho_k| min(h, 1/|p_k|),

    |y''(s) - y''(t)| <= |G ki| sum_k |rho_k d_k(t)| min(1, |p_k| h) + c (|e'(t)| + h B) + (|p| + |G kp|) h B,       (3)

so that B <= (|y''(t)| + the first term + c |e'(t)|)/(1 - h c - h |p| - h |G kp|).  The same one derivative further
bounds u''.  A fast pole contributes at most what is left of its transient, so that steps are long where the response is
smooth.

A run is a list of nodes, the state and the flow just after each event or step; `interpolate` evaluates it in between.

Source: derived from (1).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum
from functools import cached_property
from typing import NamedTuple

import numpy as np

from fopi_tune.core.bode_form import Array
from fopi_tune.core.controller import FoPi
from fopi_tune.core.zero_order_hold import matrix_expm1
from fopi_tune.digital.oustaloup import ZeroPoleGain
from fopi_tune.errors import DomainError

#: halvings of the longest step: 2^-44 = 6e-14
FINEST = 44
#: h (c + |p| + |G kp|) in (3) for the longest step
_CONTRACTION = 0.5
#: matrix exponentials computed at once
_AT_ONCE = 500
#: 1/s, the exact integral of order 1
PURE_INTEGRAL = ZeroPoleGain((), (0.0,), 1.0)


class Regime(Enum):
    """Saturation of the control: within its limits, or at one of them."""

    WITHIN = 0
    LOW = -1
    HIGH = 1


@dataclass(frozen=True)
class ModeLoop:
    """One mode's loop: a first-order plant gain/(s + pole) and its controller.

    A lag K/(tau s + 1) has gain = K/tau and pole = 1/tau.

    Args:
        gain: output unit per control unit and second; not 0.
        pole_rad_s: p, rad/s; negative for an unstable plant.
        gains: kp, ki and alpha.
        integral: the approximation of s^-alpha: a true integrator and real stable poles, all different; for alpha = 1
            the exact `PURE_INTEGRAL`.
        limits: least and greatest control.  The controller integrates e also while at a limit.

    Raises:
        DomainError: a number that is not finite, empty limits, or an integral not of this form.
    """

    gain: float
    pole_rad_s: float
    gains: FoPi
    integral: ZeroPoleGain = PURE_INTEGRAL
    limits: tuple[float, float] = (-math.inf, math.inf)

    def __post_init__(self) -> None:
        for name in ("gain", "pole_rad_s"):
            if not math.isfinite(getattr(self, name)):
                raise DomainError(f"pedal: {name} = {getattr(self, name)!r} must be a finite number")
        if self.gain == 0.0:
            raise DomainError("pedal: gain = 0 moves nothing; give the plant's gain K/tau")
        low, high = self.limits
        if not low < high or low == math.inf or high == -math.inf:
            raise DomainError(
                f"pedal: limits = {self.limits!r} leave no room for the control; the lower one comes first"
            )
        poles, zeros = self.integral.poles, self.integral.zeros
        if not all(math.isfinite(number) for number in (*poles, *zeros, self.integral.gain)):
            raise DomainError("pedal: the integral has a zero, pole or gain that is not finite; make it by oustaloup()")
        if poles.count(0.0) != 1 or max(poles) > 0.0 or len(set(poles)) < len(poles) or len(zeros) >= len(poles):
            raise DomainError(
                "pedal: the integral needs one pole at 0, the others negative and all different, and fewer zeros than "
                "poles; make it by oustaloup()"
            )

    @cached_property
    def poles(self) -> Array:
        """p_k, the integrator first; empty without ki."""
        return np.sort(np.array(self.integral.poles if self.gains.ki else (), dtype=float))[::-1]

    @cached_property
    def weights(self) -> Array:
        """ki rho_k, in the order of `poles`."""
        if not self.gains.ki:
            return np.zeros(0)
        order = np.argsort(np.array(self.integral.poles))[::-1]
        return self.gains.ki * self.integral.residues[order]

    def demand(self, error: float, memory: Array) -> float:
        """u before the limits."""
        return self.gains.kp * error + float(self.weights @ memory)

    def saturate(self, demand: float) -> float:
        """u within the limits."""
        return min(max(demand, self.limits[0]), self.limits[1])

    def memory_for(self, demand: float, error: float, memory: Array) -> Array:
        """The memory with the integrator's state changed so that u = demand."""
        shifted = memory.copy()
        shifted[0] += (demand - self.demand(error, memory)) / float(self.weights[0])
        return shifted

    def regimes(self) -> list[Regime]:
        """The regimes that this loop can be in."""
        low, high = (math.isfinite(limit) for limit in self.limits)
        return [Regime.WITHIN, *[Regime.LOW] * low, *[Regime.HIGH] * high]

    def bounds(self, regime: Regime) -> list[tuple[int, float]]:
        """(sign, limit) such that sign (u - limit) < 0 within the regime."""
        low, high = self.limits
        if regime is Regime.WITHIN:
            return [(sign, limit) for sign, limit in ((1, high), (-1, low)) if math.isfinite(limit)]
        return [(-1, high)] if regime is Regime.HIGH else [(1, low)]


@dataclass(frozen=True)
class LoopDerivatives:
    """Signals of (1) at one instant, with their derivatives.

    Args:
        offset: y - r and its first two derivatives.
        demand: u and its first two derivatives.
        output_rate: y'.
        state_rates: d_k.
        state_curvatures: d_k'.
    """

    offset: tuple[float, float, float]
    demand: tuple[float, float, float]
    output_rate: float
    state_rates: Array
    state_curvatures: Array


class Flow:
    """One mode's loop in one regime."""

    def __init__(self, loop: ModeLoop, regime: Regime) -> None:
        self.loop, self.regime = loop, regime
        gains, n = loop.gains, len(loop.poles)
        self.matrix = np.zeros((n + 4, n + 4))
        self.matrix[0, 0] = -loop.pole_rad_s
        if regime is Regime.WITHIN:
            self.matrix[0, 0] -= loop.gain * gains.kp
            self.matrix[0, 1 : n + 1] = loop.gain * loop.weights
            self.matrix[0, -3] = loop.gain * gains.kp
        else:
            self.matrix[0, -1] = loop.gain * loop.limits[0 if regime is Regime.LOW else 1]
        sections = np.arange(1, n + 1)
        self.matrix[sections, sections] = loop.poles
        self.matrix[1 : n + 1, 0], self.matrix[1 : n + 1, -3] = -1.0, 1.0
        self.matrix[-3, -2] = 1.0
        self.active_gain = abs(loop.gain) if regime is Regime.WITHIN else 0.0
        self.weights = np.abs(loop.weights)
        self.longest_s = self._longest()
        steps = np.asarray(self.longest_s * 0.5 ** np.arange(FINEST + 1), dtype=float)
        self.steps_s = [float(step) for step in steps]
        self.exponential_less_one = _table(self.matrix, steps)
        fast = np.abs(loop.poles)
        #: |ki rho_k| min(h, 1/|p_k|) summed, and |ki rho_k| min(1, |p_k| h), per step
        share = np.minimum(1.0, fast * steps[:, None])
        slow = fast == 0.0
        reach = np.where(slow, steps[:, None], share / np.where(slow, 1.0, fast))
        self.reach = [float(number) for number in reach @ self.weights]
        self.fade = share * self.weights

    def _reach(self, step: float) -> float:
        fast = np.abs(self.loop.poles)
        return float(self.weights @ np.minimum(step, 1.0 / np.maximum(fast, 1.0 / step)))

    def _longest(self) -> float:
        """The longest power of 2 that (3) allows, s; bounded by the loop's own time scale, so that it is finite."""
        own = abs(self.loop.pole_rad_s) + self.active_gain * abs(self.loop.gains.kp)
        slowest = abs(self.loop.pole_rad_s) + abs(self.loop.gain * self.loop.gains.kp)
        slowest += math.sqrt(abs(self.loop.gain) * float(self.weights[0]) if len(self.weights) else 0.0)
        step = 2.0 ** math.floor(math.log2(_CONTRACTION / slowest)) if slowest > 0.0 else 1.0
        while step * (self.active_gain * self._reach(step) + own) > _CONTRACTION:
            step *= 0.5
        return step

    def derivatives(self, w: Array) -> LoopDerivatives:
        """y - r, u and their derivatives at w."""
        loop = self.loop
        error, rate = float(w[-3] - w[0]), float(self.matrix[0] @ w)
        error_rate = float(w[-2]) - rate
        state_rates = loop.poles * w[1:-3] + error
        state_curvatures = loop.poles * state_rates + error_rate
        demand = loop.demand(error, w[1:-3])
        demand_rate = loop.gains.kp * error_rate + float(loop.weights @ state_rates)
        curvature = -loop.pole_rad_s * rate + (loop.gain * demand_rate if self.active_gain else 0.0)
        demand_curvature = -loop.gains.kp * curvature + float(loop.weights @ state_curvatures)
        return LoopDerivatives(
            (-error, -error_rate, curvature),
            (demand, demand_rate, demand_curvature),
            rate,
            state_rates,
            state_curvatures,
        )

    def derivative_changes(self, derivatives: LoopDerivatives, level: int) -> tuple[float, float]:
        """Bounds of the changes of y'' and u'' within the step of this level: (3), and the same for u''."""
        step, reach = self.steps_s[level], self.reach[level]
        kp, pole = abs(self.loop.gains.kp), abs(self.loop.pole_rad_s)
        slope, curvature, direct = abs(derivatives.offset[1]), abs(derivatives.offset[2]), self.active_gain * kp
        fading = self.active_gain * float(self.fade[level] @ np.abs(derivatives.state_rates))
        c = self.active_gain * reach
        most = (curvature + fading + c * slope) / (1.0 - step * (c + pole + direct))
        output = fading + c * (slope + step * most) + (pole + direct) * step * most
        # u'' = -kp y'' + ki sum rho_k d_k',  |y'''| <= |p| B + |G| |u''|
        demand_curvature = abs(derivatives.demand[2])
        demand = kp * step * (pole * most + self.active_gain * demand_curvature)
        demand += float(self.fade[level] @ np.abs(derivatives.state_curvatures)) + reach * most
        return output, demand / (1.0 - direct * step)


def _table(matrix: Array, steps: Array) -> Array:
    """e^{Mh} - 1 for the steps h, each half the one before; by series where short, by doubling where long."""
    norm = float(np.abs(matrix).sum(axis=1).max())
    short = min(int(np.searchsorted(-steps * norm, -0.5)), FINEST)
    table = np.zeros((len(steps), *matrix.shape))
    table[short:] = matrix_expm1(matrix * steps[short:, None, None])
    for level in range(short - 1, -1, -1):
        table[level] = 2.0 * table[level + 1] + np.einsum("ij,jk->ik", table[level + 1], table[level + 1])
    return table


class Node(NamedTuple):
    """The state just after `time_s`, and the flow that goes on from it."""

    time_s: float
    mode: int
    flow: Flow
    w: Array


class Samples(NamedTuple):
    """Arrays of shape (m,): y, y', u within its limits, r - y, and the mode."""

    output: Array
    rate: Array
    control: Array
    error: Array
    mode: np.ndarray


def interpolate(nodes: Sequence[Node], times: Array) -> Samples:
    """Evaluate a run at these times, by the exact flow from the last node before each.

    Args:
        nodes: in the order of time; where several share one, the last is used.
        times: shape (m,), s, not before the first node.
    """
    output, rate, control, error = np.zeros((4, len(times)))
    last = np.searchsorted(np.array([node.time_s for node in nodes]), times, side="right") - 1
    rows_of: dict[int, list[int]] = {}
    for row, node in enumerate(last):
        rows_of.setdefault(id(nodes[node].flow), []).append(row)
    for same in rows_of.values():
        flow = nodes[last[same[0]]].flow
        for rows in (same[i : i + _AT_ONCE] for i in range(0, len(same), _AT_ONCE)):
            w = np.array([nodes[last[i]].w for i in rows])
            since = times[rows] - np.array([nodes[last[i]].time_s for i in rows])
            w = w + np.einsum("mij,mj->mi", matrix_expm1(flow.matrix * since[:, None, None]), w)
            output[rows], error[rows], rate[rows] = w[:, 0], w[:, -3] - w[:, 0], w @ flow.matrix[0]
            demand = flow.loop.gains.kp * error[rows] + w[:, 1:-3] @ flow.loop.weights
            control[rows] = np.clip(demand, *flow.loop.limits)
    return Samples(output, rate, control, error, np.array([nodes[i].mode for i in last], dtype=int))
