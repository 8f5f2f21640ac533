"""The switched loop written down once more, in floating point for many lanes, with a brake that varies."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fopi_tune.core.bode_form import Array
from fopi_tune.digital.runtime import Runtime
from fopi_tune.proof.switched.model import Memory, SwitchedModel


@dataclass(frozen=True, eq=False)
class Run:
    """Outputs and active modes, shape (samples, lanes)."""

    y: Array
    mode: np.ndarray


def run(
    model: SwitchedModel, setpoint: Array, output: Array, mode: np.ndarray, memories: list[Array],
    throttle: tuple[float, float], brake: tuple[Array, float], waits: np.ndarray | None = None, delay: float = 0.0,
    control: Array | None = None,
) -> Run:  # fmt: skip
    """Simulate; `memories` have shape (sections, lanes), `throttle` is (m, K), `brake` is m (samples, lanes) and K.

    `waits` is how many samples of the minimum dwell are left at the start, of each lane; none where left out.  With a
    `delay`, in samples, a mode arrives with its control; before the start it was `control`, or 0.
    """
    y, x, mode = output.copy(), [each.copy() for each in memories], mode.copy()
    loops = [_Columns.of(loop.controller) for loop in model.loops]
    left = np.zeros(len(y), dtype=np.int64) if waits is None else waits.copy()
    last, arrived = np.zeros(len(y)) if control is None else control.copy(), mode.copy()
    outputs, modes = [], []
    for share in brake[0]:
        to_brake = (mode == 0) & (y >= setpoint + model.upper) & (left == 0)
        to_throttle = (mode == 1) & (y <= setpoint + model.lower) & (left == 0)
        left = np.where(to_brake | to_throttle, max(model.min_dwell_samples, 1), left)
        left = np.maximum(left - 1, 0)
        for index, begins in ((1, to_brake), (0, to_throttle)):
            mode[begins] = index
            if model.memory is Memory.RESET:
                x[index][:, begins] = 0.0
        e = setpoint - y
        results = [_step(loop, x[k], e) for k, loop in enumerate(loops)]
        u = np.where(mode == 0, results[0][0], results[1][0])
        for k, loop in enumerate(loops):
            idle = _track(loop, x[k], e, u) if model.memory is Memory.TRACKING else x[k]
            x[k] = np.where(mode == k, results[k][1], idle)
        outputs.append(y)
        modes.append(mode.copy())
        for acting, by, time in ((last, arrived, delay), (u, mode, 1.0 - delay)):
            if time == 0.0:
                continue
            m = -np.expm1(time * np.log1p(-np.where(by == 0, throttle[0], share)))
            y = y + m * (np.where(by == 0, throttle[1], brake[1]) * acting - y)
        last, arrived = u, mode.copy()
    return Run(np.array(outputs), np.array(modes))


@dataclass(frozen=True, eq=False)
class _Columns:
    """A controller's numbers of each section, as columns beside the lanes."""

    poles: Array
    residues: Array
    corrections: Array
    direct: float
    limits: tuple[float, float]

    @classmethod
    def of(cls, c: Runtime) -> _Columns:
        p, r, w = (np.array(row)[:, None] for row in (c.poles, c.residues, c.weights))
        return cls(p, r, w * c.tracking_gain, c.direct, c.limits)

    def limited(self, v: Array) -> Array:
        return np.minimum(np.maximum(v, self.limits[0]), self.limits[1])


def _step(c: _Columns, x: Array, e: Array) -> tuple[Array, Array]:
    v = c.direct * e + x.sum(axis=0)
    u = c.limited(v)
    return u, c.poles * (x + c.corrections * (u - v)) + c.residues * e


def _track(c: _Columns, x: Array, e: Array, applied: Array) -> Array:
    following = c.poles * x
    following[0] = c.limited(applied) - c.direct * e - following[1:].sum(axis=0)
    return following


def run_any(
    model: SwitchedModel, setpoint: Array, output: Array, mode: np.ndarray, memories: list[Array],
    lags: list[tuple[Array, Array]],
) -> tuple[Array, list[Array]]:  # fmt: skip
    """Outputs, and the largest of each section's and of their sum's size, where somebody else switches.

    `setpoint` and `mode` have shape (samples, lanes); `lags` are m and K of both plants, of that shape too.
    """
    y, x = output.copy(), [each.copy() for each in memories]
    loops = [_Columns.of(loop.controller) for loop in model.loops]
    outputs, largest = [], [np.zeros(len(each) + 1) for each in memories]
    for k, active in enumerate(mode):
        if model.memory is Memory.RESET and k:
            for index, loop in enumerate(model.loops):
                low, high = loop.controller.limits
                begins = (active == index) & (mode[k - 1] != index)
                x[index][:, begins] = 0.0
                x[index][0, begins] = min(max(0.0, low), high)
        for index, each in enumerate(x):
            sizes = np.vstack([np.abs(each.sum(axis=0)), np.abs(each)])
            if model.memory is Memory.RESET:
                # what waits for its reset counts for nothing, but it is what the last phase left
                sizes = np.where(active == index, sizes, 0.0)
            largest[index] = np.maximum(largest[index], sizes.max(axis=1))
        e = setpoint[k] - y
        results = [_step(loop, x[i], e) for i, loop in enumerate(loops)]
        u = np.where(active == 0, results[0][0], results[1][0])
        for i, loop in enumerate(loops):
            idle = _track(loop, x[i], e, u) if model.memory is Memory.TRACKING else x[i]
            x[i] = np.where(active == i, results[i][1], idle)
        outputs.append(y)
        m, gain = (np.where(active == 0, lags[0][part][k], lags[1][part][k]) for part in (0, 1))
        y = y + m * (gain * u - y)
    return np.array(outputs), largest
