"""The search for settling proofs, in floating point:  which setpoints, how many samples, which level set.

All conditions of `settling` are convex in the setpoint, since entries are affine in it: the setpoints that can be
proved are an interval.  Its ends are found from the responses to the constant part and to the setpoint's part of each
corner.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from flint import arb, ctx

from fopi_tune.core.bode_form import Array
from fopi_tune.proof.switched.definite import lower_triangle, midpoints
from fopi_tune.proof.switched.entries import (
    dwell_margin,
    entry_corners,
    lowering_top,
    raising_lag,
    starts_above_low,
    why_no_entries,
)
from fopi_tune.proof.switched.model import SwitchedModel, loop_matrices
from fopi_tune.proof.switched.settling import MOST_SAMPLES, SettlingProof, verify_settling

#: bits of the matrices; samples between trials of the level set
_PRECISION, _EVERY = 128, 50
#: relative distance kept to what the search says is the end
_MARGIN = 1e-3
_BISECTIONS = 40
#: parts of the range at which a setpoint that can be proved is looked for
_TRIED = (0.5, 0.25, 0.75, 0.1, 0.9, 0.03, 0.01, 1e-3, 1e-4, 1e-5, 1e-6)
#: output unit; what is above is where a control has no limits
_LARGEST = 1e90
#: the range of setpoints where nothing ends it and none are asked for, in distances of the upper line
_WITHOUT_END = 1000.0
#: behind the point; a power of ten below would be no double
_MOST_DIGITS = 300


@dataclass(frozen=True)
class SettlingSearch:
    """What was found.

    Args:
        proof: verified; None where there is none.
        reason: why not; empty with a proof for all setpoints that were asked for.
    """

    proof: SettlingProof | None
    reason: str


def prove_settling(model: SwitchedModel, setpoints: tuple[float, float] | None) -> SettlingSearch:
    """The widest range of setpoints for which settling can be proved, within those asked for.

    Args:
        model: with `obstacle == ""`.
        setpoints: least and largest r asked for, output unit; None: as many as can be proved.
    """
    if reason := why_no_entries(model):
        return SettlingSearch(None, reason)
    responses = _responses(model)
    if responses is None:
        return SettlingSearch(None, f"the {model.loops[0].name}'s loop is not stable without its limits")
    wide = responses.range(setpoints)
    if wide is None:
        return SettlingSearch(None, responses.why_none(setpoints))
    asked = setpoints or wide
    low, high = max(asked[0], wide[0]), min(asked[1], wide[1])
    if not low <= high:
        return SettlingSearch(None, responses.why_none(setpoints))
    rounded = _rounded(low, high)
    low, high = (end if end in asked and setpoints else near for end, near in zip((low, high), rounded, strict=True))
    samples = responses.samples_until_level(low, high)
    found = SettlingProof((low, high), samples, responses.level.matrix, responses.level.decay, 0.0, 0.0)
    excursions = verify_settling(model, found)
    if excursions is None:
        return SettlingSearch(None, "what the search found could not be verified in balls")
    found = replace(found, undershoot=excursions.undershoot, overshoot=excursions.overshoot)
    part = setpoints is not None and (low, high) != setpoints
    return SettlingSearch(found, responses.why_none(setpoints) if part else "")


@dataclass(frozen=True)
class _Level:
    """P and rho of the level set, as in a proof, and as an array."""

    matrix: tuple[tuple[float, ...], ...]
    decay: float
    full: Array


@dataclass(frozen=True)
class _Responses:
    """Outputs of all corners as constant + r slope.

    `limits` are (constant, slope, bound, name) of inequalities constant + r slope <= bound, arrays of shape (samples,
    corners); `states` the pairs of columns at every `_EVERY`-th sample; `level` the level set with its gains.
    """

    limits: tuple[tuple[Array, Array, float, str], ...]
    states: tuple[tuple[Array, Array], ...]
    level: _Level
    gains: tuple[float, float]
    upper: float
    rest: float
    control: tuple[float, float]
    least: float
    least_name: str
    raising: str

    @property
    def bounds(self) -> list[tuple[float, float, str]]:
        """The setpoints that each kind of inequality allows, with what ends them."""
        found = [(self.least, math.inf, self.least_name)]
        found.append((self.control[0] / self.rest, self.control[1] / self.rest, f"the {self.raising}'s limits at rest"))
        for constant, slope, bound, name in self.limits:
            with np.errstate(over="ignore", divide="ignore", invalid="ignore"):
                edge = (bound - constant) / slope
            lower = float(np.max(edge, where=slope < 0.0, initial=-math.inf))
            upper = float(np.min(edge, where=slope > 0.0, initial=math.inf))
            if np.any((slope == 0.0) & (constant > bound)):
                lower, upper = math.inf, -math.inf
            found.append((lower, upper, name))
        return found

    def range(self, asked: tuple[float, float] | None) -> tuple[float, float] | None:
        """The setpoints that can be proved; None without any.

        Args:
            asked: least and largest setpoint; where nothing ends the range, it holds these.
        """
        low, high = max(each[0] for each in self.bounds), min(each[1] for each in self.bounds)
        if high > _LARGEST:
            reach = 0.0 if asked is None else 2.0 * (asked[1] - low)
            high = low + (reach if reach > 0.0 else _WITHOUT_END * self.upper)
        if not (low < high and math.isfinite(high - low)):
            return None
        # a wide range does not cost small setpoints
        width, near = high - low, min(high - low, self.upper)
        low, high = low + _MARGIN * near, high - _MARGIN * width
        last = len(self.states) - 1
        tries = [low + part * (high - low) for part in _TRIED]
        if asked is not None:
            tries.append(0.5 * (max(low, asked[0]) + min(high, asked[1])))
        inside = next((each for each in tries if low <= each <= high and self.in_level(each, last)), None)
        if inside is None:
            return None
        return self._end(inside, low, last), self._end(inside, high, last)

    def _end(self, inside: float, outside: float, last: int) -> float:
        if self.in_level(outside, last):
            return outside
        for _ in range(_BISECTIONS):
            middle = 0.5 * (inside + outside)
            inside, outside = (middle, outside) if self.in_level(middle, last) else (inside, middle)
        return inside

    def in_level(self, setpoint: float, place: int) -> bool:
        """(2) of `settling` at one setpoint, with a margin."""
        constant, slope = self.states[place]
        z = constant + setpoint * slope
        level = math.sqrt(float(np.max(np.einsum("ij,ik,kj->j", z, self.level.full, z))))
        rest = setpoint * self.rest
        room = min(rest - self.control[0], self.control[1] - rest)
        within = 1.0 - _MARGIN
        return level * self.gains[0] < within * self.upper and level * self.gains[1] < within * room

    def samples_until_level(self, low: float, high: float) -> int:
        """The first of the stored samples from which (2) holds at both ends."""
        places = range(1, len(self.states))
        found = next((k for k in places if self.in_level(low, k) and self.in_level(high, k)), len(self.states) - 1)
        return found * _EVERY

    def why_none(self, setpoints: tuple[float, float] | None) -> str:
        """What is in the way, in words."""
        low = max(self.bounds, key=lambda each: each[0])
        high = min(self.bounds, key=lambda each: each[1])
        if not low[0] < high[1]:
            return f"no setpoint: {'; '.join(dict.fromkeys((low[2], high[2])))}"
        told = []
        if setpoints is not None and self.range(setpoints) is not None:
            told += [f"below {low[0]:.4g}: {low[2]}"] if setpoints[0] <= low[0] else []
            told += [f"above {high[1]:.4g}: {high[2]}"] if setpoints[1] >= high[1] else []
        return "; ".join(told) or "the level set is not reached within the samples that are followed"


def _responses(model: SwitchedModel) -> _Responses | None:
    """Follow all corners; None where the loop is unstable."""
    with ctx.workprec(_PRECISION):
        lag = raising_lag(model)
        a, _, c = (midpoints(each) for each in loop_matrices(model.loops[0].controller, lag))
        constant = midpoints(entry_corners(model, arb(0)))
        slope = midpoints(entry_corners(model, arb(1))) - constant
        rest, margin = 1.0 / float(lag.gain), float(dwell_margin(model))
        least = float(lowering_top(model)) - model.lower + margin
    level = _level_set(a, c)
    if level is None:
        return None
    count, corners = MOST_SAMPLES, constant.shape[1]
    z, outputs, states = np.hstack([constant, slope]), np.zeros((count, 2, 2 * corners)), []
    rows = np.vstack([np.eye(1, len(a)), c])
    for k in range(count):
        if k % _EVERY == 0:
            states.append((z[:, :corners], z[:, corners:]))
        outputs[k] = rows @ z
        z = a @ z
    states.append((z[:, :corners], z[:, corners:]))
    (y, v), (y_slope, v_slope) = (outputs[:, :, part].transpose(1, 0, 2) for part in (np.s_[:corners], np.s_[corners:]))
    (low, high), raising = model.loops[0].controller.limits, model.loops[0].name
    v_slope = v_slope + rest
    # where the first control is known to be within the lower limit, rounding must not say otherwise
    first = int(starts_above_low(model))
    around = model.lines.half_width is not None
    limits = (
        (y, y_slope, model.upper, f"the output overshoots {'by' if around else 'to'} {model.upper_line}"),
        (v, v_slope, high, f"the {raising}'s upper limit is reached"),
        (-v[first:], -v_slope[first:], -low, f"the {raising}'s lower limit is reached"),
    )
    inverse = np.linalg.inv(level.full)
    gains = math.sqrt(inverse[0, 0]), math.sqrt(float((c @ inverse @ c.T)[0, 0]))
    lowering = model.loops[1].name
    name = f"the {lowering}'s largest control holds the output above {model.lower_line}"
    if margin > 0.0:
        name = f"within min_dwell_s the output may fall below what the {lowering}'s largest control holds"
    return _Responses(limits, tuple(states), level, gains, model.upper, rest, (low, high), least, name, raising)


def _level_set(a: Array, c: Array) -> _Level | None:
    """P and rho whose level sets are as thin as possible along y and v; None where A is not stable."""
    from scipy.linalg import solve_discrete_lyapunov

    radius = float(np.abs(np.linalg.eigvals(a)).max())
    if not radius < 1.0:
        return None
    decay = 1.0 - 0.5 * (1.0 - radius)
    size = len(a)
    # the weights of the states keep P definite; those of y and v make P^-1 small along them
    lengths = np.diag(solve_discrete_lyapunov(a.T / decay, np.eye(size)))
    weights = np.outer(np.eye(size)[0], np.eye(size)[0]) + 10.0 * c.T @ c + 1e-4 * np.diag(lengths / lengths.max())
    matrix = lower_triangle(solve_discrete_lyapunov(a.T / decay, weights))
    full = np.array([[matrix[max(i, j)][min(i, j)] for j in range(size)] for i in range(size)])
    return _Level(matrix, decay, full)


def _rounded(low: float, high: float) -> tuple[float, float]:
    """Ends with three digits of the range's width, inwards; a range too narrow for that stays."""
    digits = min(2 - math.floor(math.log10(high - low)), _MOST_DIGITS) if high > low else 0
    step = 10.0**-digits
    ends = round(math.ceil(low / step) * step, digits), round(math.floor(high / step) * step, digits)
    return ends if ends[0] < ends[1] else (low, high)
