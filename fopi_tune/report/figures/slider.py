"""The report's slider:  curves for values of one uncertain number, the others nominal, as SVG paths.

All curves are computed here; the script in the report only replaces one path by another.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fopi_tune.core.bode_form import Array, Complex
from fopi_tune.report.figures.forbidden_regions import sensitivity_discs
from fopi_tune.report.figures.members import Members
from fopi_tune.report.figures.step_responses import axis_limits, step_response, times_s
from fopi_tune.report.text.formatting import number
from fopi_tune.report.words import in_words, name_and_unit
from fopi_tune.simulation.fractional.linear import Signal
from fopi_tune.spec.model import Requirement

#: size of a panel's frame, in the units of its view box
WIDTH, HEIGHT = 300.0, 200.0
#: the part of the complex plane that is shown
_NYQUIST = ((-2.2, 1.2), (-1.6, 0.8))
_DB = 20.0 / math.log(10.0)
#: every third frequency of the large figures is enough for a small panel
_EVERY = 3
#: the same for the Nyquist panel
_EVERY_NEAR = 2
#: uncertain numbers on the slider, and the values of each but the first
_MOST, _FEWER = 12, 7
_FREQUENCY = "ω, rad/s"


@dataclass(frozen=True)
class Panel:
    """A small picture with a curve for each position of the slider.

    Args:
        key: its id in the page.
        title: stands above it.
        x, y: labels of the axes.
        x_ticks, y_ticks: positions in the frame and their labels.
        curves: a path for each position of the slider.
        family: the closed path of the band that the whole family fills; empty where it is not drawn.
        limits: paths of the requirements' limits: dashed lines, and circles that L has to stay out of.
    """

    key: str
    title: str
    x: str
    y: str
    x_ticks: tuple[tuple[float, str], ...]
    y_ticks: tuple[tuple[float, str], ...]
    curves: tuple[str, ...]
    family: str = ""
    limits: tuple[str, ...] = ()


@dataclass(frozen=True)
class SliderParameter:
    """An uncertain number and its positions on the slider.

    Args:
        name: of the number.
        first: position of its smallest value.
        last: position of its largest value.
        nominal: position of its nominal value.
    """

    name: str
    first: int
    last: int
    nominal: int


@dataclass(frozen=True)
class Slider:
    """The panels and the slider's positions.

    Args:
        numbers: one or more, each with positions of its own.
        labels: of every position, in words.
        panels: the pictures.
    """

    numbers: tuple[SliderParameter, ...]
    labels: tuple[str, ...]
    panels: tuple[Panel, ...]

    @property
    def nominal(self) -> int:
        """The initial position."""
        return self.numbers[0].nominal


def slider_of(members: Members) -> Slider | None:
    """The slider over the first few uncertain numbers; None without any."""
    family = members.documents.spec.plant
    if not members.numbers:
        return None
    paths = [
        members.parameter_values,
        *(members.values_of(i, _FEWER) for i in range(1, min(len(family.uncertain_names), _MOST))),
    ]
    points = np.concatenate([members.points_along(path, i) for i, path in enumerate(paths)])
    log_loop = members.log_loop(members.loops_at(points))[:, ::_EVERY]
    omega = np.log10(members.omega[::_EVERY])
    near = members.near_unit_gain
    with np.errstate(over="ignore"):
        loop: Complex = np.exp(near.log_loop(near.loops_at(points))[:, ::_EVERY_NEAR])
    requirements = members.documents.spec.requirements
    x = np.broadcast_to(omega, log_loop.shape)
    gain, phase = log_loop.real * _DB, np.degrees(log_loop.imag)
    every = members.family_log_loop[:, ::_EVERY]
    across = (float(omega[0]), float(omega[-1]))
    panels = [
        _panel("gain", "Bode: gain of L", (_FREQUENCY, "|L|, dB"), x, gain, log=True,
               frame=(across, _upper_range(gain, 140.0)), band=every.real * _DB),
        _panel("phase", "Bode: phase of L", (_FREQUENCY, "arg L, deg"), x, phase, log=True,
               frame=(across, _upper_range(phase, 400.0)), band=np.degrees(every.imag),
               limits=_phase_limits(requirements, across)),
        _panel("nyquist", "Nyquist: L, with -1", ("Re L", "Im L"), loop.real, loop.imag, frame=_NYQUIST,
               limits=_discs(requirements)),
    ]  # fmt: skip
    times = times_s(members)
    steps = [step_response(members, tuple(point), Signal.OUTPUT_AFTER_REFERENCE, times) for point in points.tolist()]
    if all(step is not None for step in steps):
        t = np.broadcast_to(times, (len(points), len(times)))
        y = np.array(steps, dtype=float)
        panels.append(_step_panel(t, y, members.stable_in_continuous_time(points)))
    numbers: list[SliderParameter] = []
    labels: list[str] = []
    for name, path, usual in zip(family.uncertain_names, paths, family.nominal_point.tolist(), strict=False):
        first = len(labels)
        labels += [in_words(f"{name} = {number(value, 4)}") for value in path.tolist()]
        numbers.append(
            SliderParameter(
                name_and_unit(name)[0], first, len(labels) - 1, first + int(np.argmin(np.abs(path - usual)))
            )
        )
    return Slider(tuple(numbers), tuple(labels), tuple(panels))


def _step_panel(t: Array, y: Array, stable: NDArray[np.bool_]) -> Panel:
    """Step responses in a frame that fits those of stable loops; of all loops where none is stable."""
    title, labels = "Unit step of the reference", ("time, s", "output")
    if np.all(stable) or not np.any(stable):
        return _panel("step", title, labels, t, y, band=y)
    frame = (float(t.min()), float(t.max())), axis_limits(list(y[stable]), 1.0)
    return _panel("step", "Unit step; unstable loops leave the axis", labels, t, y, frame=frame)


def critical_point_mark() -> str:
    """The path of a cross at -1 in the frame of the panel `nyquist`."""
    (left, right), (bottom, top) = _NYQUIST
    x, y = (-1.0 - left) / (right - left) * WIDTH, top / (top - bottom) * HEIGHT
    return f"M{x - 5:.1f} {y:.1f}h10M{x:.1f} {y - 5:.1f}v10"


def _phase_limits(requirements: Sequence[Requirement], across: tuple[float, float]) -> list[tuple[Array, Array]]:
    """Lines a phase margin's limit above -180 deg, over log10 of omega."""
    ends = np.array(across)
    limits = [limit for r in requirements if r.quantity == "phase_margin_deg" for limit in r.limits]
    return [(ends, np.full(2, limit - 180.0)) for limit in limits]


def _discs(requirements: Sequence[Requirement]) -> list[tuple[Array, Array]]:
    """Circles around -1 that a limit of |S| at every frequency keeps L out of, and the unit circle."""
    angle = np.linspace(0.0, 2.0 * math.pi, 73)
    circles = [(np.cos(angle), np.sin(angle))]
    for radius, _ in sensitivity_discs(requirements):
        circles.append((radius * np.cos(angle) - 1.0, radius * np.sin(angle)))
    return circles


def _panel(
    key: str, title: str, labels: tuple[str, str], x: Array, y: Array, *,
    log: bool = False, frame: tuple[tuple[float, float], tuple[float, float]] | None = None,
    band: Array | None = None, limits: Sequence[tuple[Array, Array]] = (),
) -> Panel:  # fmt: skip
    """Curves in a frame that fits all of them, unless a frame is given; with the band of the family's own curves."""
    across, up = frame or ((float(x.min()), float(x.max())), _padded(float(y.min()), float(y.max())))

    def path(h: Array, v: Array) -> str:
        places = (h - across[0]) / (across[1] - across[0]) * WIDTH, (up[1] - v) / (up[1] - up[0]) * HEIGHT
        # what lies far outside is cut off by the frame; clipping keeps the numbers short
        return _path(*(np.clip(place, -2.0 * WIDTH, 3.0 * WIDTH) for place in places))

    curves = tuple(path(a, b) for a, b in zip(x, y, strict=True))
    h_ticks = tuple(((t - across[0]) / (across[1] - across[0]) * WIDTH, _tick(t, log)) for t in _ticks(*across, log))
    v_ticks = tuple(((up[1] - t) / (up[1] - up[0]) * HEIGHT, _tick(t, False)) for t in _ticks(*up, False))
    family = ""
    if band is not None and len(band) > 1:
        there = np.concatenate([x[0], x[0][::-1]])
        family = path(there, np.concatenate([band.min(axis=0), band.max(axis=0)[::-1]])) + "Z"
    drawn = tuple(path(*limit) for limit in limits)
    return Panel(key, title, *labels, h_ticks, v_ticks, curves, family, drawn)


def _path(x: Array, y: Array) -> str:
    return "M" + "L".join(f"{a:.1f} {b:.1f}" for a, b in zip(x.tolist(), y.tolist(), strict=True))


def _upper_range(values: Array, most: float) -> tuple[float, float]:
    """Limits of an axis for the upper part of values: with a dead time the phase falls without bound."""
    high = float(values.max())
    return _padded(max(float(values.min()), high - most), high)


def _padded(low: float, high: float) -> tuple[float, float]:
    margin = 0.05 * (high - low) or 1.0
    return low - margin, high + margin


def _ticks(low: float, high: float, log: bool) -> list[float]:
    """Round numbers between two ends; whole powers of ten where the axis is their logarithm."""
    if log:
        return [float(k) for k in range(math.ceil(low), math.floor(high) + 1)]
    raw = (high - low) / 5.0
    power = 10.0 ** math.floor(math.log10(raw))
    step = next(factor * power for factor in (1.0, 2.0, 5.0, 10.0) if factor * power >= raw)
    return [k * step for k in range(math.ceil(low / step), math.floor(high / step) + 1)]


def _tick(value: float, log: bool) -> str:
    return number(10.0**value if log else value, 4)
