"""Two modes that take turns, written down once more in plain NumPy from the words of a system's file, one lane.

Nothing of the package is used but the coefficients of the digital filters, which are tested elsewhere:  with
e = r - y a controller gives v = d e + sum x_k and u = v within its limits and the rate, and goes on with
x_k <- p_k (x_k + w_k g (u - v)) + r_k e.  A derivative is a textbook's,
(2 Tf + Ts) d <- (2 Tf - Ts) d - 2 kd (y - y'), of the measurement y after y', and is added to v.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass, field

import numpy as np
from scipy.linalg import expm


@dataclass
class Part:
    """One mode: its plant (c_(n-1) s^(n-1) + ... + c_0)/(d_n s^n + ... + d_0), and its controller.

    Coefficients are given from the highest power on.
    """

    numerator: tuple[float, ...]
    denominator: tuple[float, ...]
    filter: dict[str, object]
    limits: tuple[float, float]
    rate_per_s: float = np.inf
    static_gain: float = 0.0
    rate_gain: float = 0.0
    #: output unit per s: at 0 the output stays while it is driven by less
    hold_below: float = -np.inf
    dead_time_s: float = 0.0
    kd: float = 0.0
    derivative_filter_s: float = 1.0
    derivative: float = 0.0
    #: what was made of a time, for times that come again
    steps: dict[float, np.ndarray] = field(default_factory=dict)
    x: np.ndarray = field(default_factory=lambda: np.zeros(0))
    last: float = 0.0

    @property
    def gain(self) -> float:
        """What moves a plant of first order, output unit per s and unit of its input."""
        return self.numerator[-1] / self.denominator[0]

    def resting(self, output: float, order: int) -> tuple[float, np.ndarray]:
        """The input that holds an output, 0 of an integrator, and y, y', ... without it, filled up to an order."""
        if not (output and self.denominator[-1]):
            return 0.0, np.zeros(order)
        held, found = output * self.denominator[-1] / self.numerator[-1], np.zeros(order)
        # every z_k rests: 0 = z_(k+1) + h_k u
        found[1 : len(self.denominator) - 1] = -held * np.array(self.shares()[:-1])
        return held, found

    def shares(self) -> list[float]:
        """h_k of N/D = h_1/s + h_2/s^2 + ..., by long division: an impulse adds it to the derivative k - 1."""
        n = len(self.denominator) - 1
        rest, found = np.append(np.zeros(n - len(self.numerator)), self.numerator), []
        for _ in range(n):
            found.append(float(rest[0] / self.denominator[0]))
            rest = np.append(rest[1:], 0.0) - found[-1] * np.array(self.denominator[1:])
        return found

    def moved(self, derivatives: np.ndarray, u: float, time_s: float) -> np.ndarray:
        """y, y', ... without an input, after a time of one input; those that this plant does not have are 0."""
        n, key = len(self.denominator) - 1, round(time_s, 12)
        if key not in self.steps:
            a = np.zeros((n + 1, n + 1))
            a[: n - 1, 1:n] = np.eye(n - 1)
            a[n - 1, :n] = -np.array(self.denominator[:0:-1]) / self.denominator[0]
            a[:n, n] = self.shares()
            self.steps[key] = expm(a * time_s)
        after = self.steps[key] @ np.append(derivatives[:n], u)
        return np.append(after[:n], np.zeros(len(derivatives) - n))

    def begin(self) -> None:
        """At an output of 0, or the limit next to it."""
        self.x = np.zeros(len(self.filter["poles"]))  # pyright: ignore[reportArgumentType]
        self.last = min(max(0.0, self.limits[0]), self.limits[1])
        if self.filter["integrates"]:
            self.x[0] = self.last

    def fed(self, r: float, rate: float) -> float:
        """What the setpoint adds."""
        return self.static_gain * r + self.rate_gain * rate

    def differentiate(self, change: float, sample_time_s: float) -> None:
        """One sample of the derivative, whether the controller acts or not."""
        twice = 2.0 * self.derivative_filter_s
        self.derivative = (twice - sample_time_s) * self.derivative - 2.0 * self.kd * change
        self.derivative /= twice + sample_time_s

    def step(self, e: float, added: float, sample_time_s: float) -> float:
        """One sample of the controller that acts."""
        p, r, w = (np.array(self.filter[name]) for name in ("poles", "residues", "weights"))
        v = self.filter["direct"] * e + added + self.derivative  # pyright: ignore[reportOperatorIssue]
        for each in self.x:
            v = v + each
        u = min(max(v, self.limits[0]), self.limits[1])
        u = min(max(u, self.last - self.rate_per_s * sample_time_s), self.last + self.rate_per_s * sample_time_s)
        self.x = p * (self.x + w * (self.filter["tracking_gain"] * (u - v))) + r * e  # pyright: ignore
        self.last = u
        return u

    def follow(self, e: float, added: float, applied: float, sample_time_s: float) -> None:
        """One sample of a controller that tracks what is applied: a sample like this one would give just that."""
        u, twice = min(max(applied, self.limits[0]), self.limits[1]), 2.0 * self.derivative_filter_s
        rest = self.filter["direct"] * e + added  # pyright: ignore[reportOperatorIssue]
        rest = rest + (twice - sample_time_s) / (twice + sample_time_s) * self.derivative
        for k in range(1, len(self.x)):
            self.x[k] = self.filter["poles"][k] * self.x[k]  # pyright: ignore
            rest = rest + self.x[k]
        if self.filter["integrates"]:
            self.x[0] = u - rest
        self.last = u


def signal(knots: list[dict[str, float]], before: float, time_s: np.ndarray) -> np.ndarray:
    """Steps and ramps as they are written; a billionth of a sample later, so that rounding moves no step."""
    values, start = np.full(len(time_s), before), before
    for knot in knots:
        ramp = knot.get("ramp_s", 0.0)
        since = time_s - knot["at_s"] + 1e-9 * time_s[1]
        share = np.minimum(since / ramp, 1.0) if ramp else np.ones(len(time_s))
        values = np.where(since >= 0.0, start + share * (knot["value"] - start), values)
        start = knot["value"]
    return values


def line(written: object, setpoint: float) -> float:
    """The output on a line: a number, {relative: x} or {absolute: x}."""
    if isinstance(written, dict):
        return written["absolute"] if "absolute" in written else setpoint + written["relative"]
    return setpoint + float(written)  # pyright: ignore[reportArgumentType]


def next_state(words: dict[str, object], names: tuple[str, str], state: int, y: float, r: float) -> int:
    """The state that the lines ask for; 1 and 2 are the modes, 0 the band in which both rest."""
    eps = words.get("hysteresis")
    up = words.get(f"to_{names[1]}_above", eps)
    down = words.get(f"to_{names[0]}_below", None if eps is None else -eps)  # pyright: ignore
    if state != 2 and y >= line(up, r):
        return 2
    if state != 1 and y <= line(down, r):
        return 1
    if words.get("coast") and state == 1 and y >= line(words.get("coast_above", 0.0), r):
        return 0
    if words.get("coast") and state == 2 and y <= line(words.get("coast_below", 0.0), r):
        return 0
    return state


def drive(
    words: dict[str, object], parts: tuple[Part, Part], names: tuple[str, str], scenario: dict[str, object],
    sample_time_s: float, delays: tuple[float, float] = (0, 0),
) -> tuple[np.ndarray, np.ndarray]:  # fmt: skip
    """Output and state at the samples.

    Args:
        words: of the section `system`, as they are written.
        parts: of the raising mode, then of the lowering one.
        names: of both.
        scenario: as it is written; before it there was no input but the one that held the plant.
        sample_time_s: Ts.
        delays: of each mode, samples from a measurement to the new control, with which its plant arrives after the
            plant's own dead time; of those that have arrived the one that was sent last acts.
    """
    count = round(scenario["duration_s"] / sample_time_s) + 1  # pyright: ignore
    time_s = sample_time_s * np.arange(count)
    y = float(scenario.get("initial_output", 0.0))  # pyright: ignore[reportArgumentType]
    reference = signal(scenario["reference"], y, time_s)  # pyright: ignore[reportArgumentType]
    load = signal(scenario.get("load", []), 0.0, time_s)  # pyright: ignore[reportArgumentType]
    dwell = int(np.ceil(words.get("min_dwell_s", 0.0) / sample_time_s - 1e-9))  # pyright: ignore
    for part in parts:
        part.begin()
    order = max(len(part.denominator) for part in parts) - 1
    held, derivatives = parts[0].resting(y if scenario.get("before", "rest") == "rest" else 0.0, order)
    derivatives[0] = y
    state, plant, since, outputs, states, sent = 1, 0, 10**9, [], [], []
    rates = np.diff(reference, prepend=reference[0]) / sample_time_s
    for r, rate in zip(reference, rates, strict=True):
        before, since, applied = state, since + 1, 0.0 if state == 0 else parts[state - 1].last
        if since >= dwell:
            state = next_state(words, names, state, y, r)
        if state != before:
            since = 0
            if state:
                part = parts[state - 1]
                if words.get("inactive") == "reset":
                    part.begin()
                if part.rate_per_s < np.inf and words.get("inactive") != "tracking":
                    part.last = min(max(applied, part.limits[0]), part.limits[1])
        for part in parts:
            part.differentiate(y - (outputs[-1] if outputs else y), sample_time_s)
        plant = plant if state == 0 else state - 1
        u = parts[plant].step(r - y, parts[plant].fed(r, rate), sample_time_s) if state else 0.0
        if words.get("inactive") == "tracking":
            for k, part in enumerate(parts):
                if k != state - 1:
                    part.follow(r - y, part.fed(r, rate), u, sample_time_s)
        outputs.append(y)
        states.append(state)
        sent.append((u, plant))
        now = (len(sent) - 1) * sample_time_s
        waits = [delay * sample_time_s + part.dead_time_s for delay, part in zip(delays, parts, strict=True)]
        dead = [part.dead_time_s for part in parts]
        # when something may arrive; a time that is none for rounding lasts nothing
        cuts = sorted({0.0, sample_time_s, *(each % sample_time_s for each in (*waits, *dead))})
        for begin, end in itertools.pairwise(cuts):
            if end - begin < 1e-9 * sample_time_s:
                continue
            middle, arrived, acting = now + 0.5 * (begin + end), 0, held
            for k in range(len(sent) - 1, -1, -1):
                if k * sample_time_s + waits[sent[k][1]] <= middle:
                    acting, arrived = sent[k]
                    break
            own, place = parts[arrived], int(np.floor((middle - dead[arrived]) / sample_time_s))
            drive = acting + (load[place] if place >= 0 else 0.0)
            stands = own.hold_below > -np.inf
            if not (stands and derivatives[0] <= 0.0 and own.gain * drive < own.hold_below):
                derivatives = own.moved(derivatives, drive, end - begin)
                if stands:
                    derivatives = np.maximum(derivatives, 0.0)
        y = float(derivatives[0])
    return np.array(outputs), np.array(states)
