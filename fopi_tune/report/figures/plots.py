"""Figures of the digital controller and of simulations; equal results give equal bytes.

`controller_bode_svg` and `simulation_svg` are files of their own; `digital_picture` is part of the report.
"""

from __future__ import annotations

import io
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from fopi_tune.report.documents import ResultDocuments
from fopi_tune.report.figures.picture import (
    BLACK,
    BLUE,
    ORANGE,
    TWO_PANELS,
    Picture,
    label_axes,
    legend_below,
    log_axes,
    plain_text,
)
from fopi_tune.report.text.formatting import number
from fopi_tune.spec.model import SystemSpec

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from fopi_tune.results.design import Discretized
    from fopi_tune.results.simulation import ScenarioResult, Simulated
    from fopi_tune.results.system import SimulatedSystem

_POINTS = 500
#: blue and orange of the Okabe-Ito palette; the dashes differ too
_IDEAL, _DIGITAL = "#0072b2", "#d55e00"


def controller_bode_svg(result: Discretized) -> str:
    """Gain and phase of the ideal controller and of the digital one, up to Nyquist's frequency, and their distance."""
    # loaded here: plotting costs half a second
    import matplotlib
    from matplotlib.backends.backend_svg import FigureCanvasSVG
    from matplotlib.figure import Figure

    controller = result.controller
    gains, sections, digital = controller.gains, controller.sections, controller.digital
    nyquist = np.pi / digital.sample_time_s
    omega = np.geomspace(min(digital.band_rad_s[0], nyquist / 100.0), nyquist, _POINTS)
    ideal = gains(1j * omega)
    filtered = sections.response(omega, gains.measurement_filter)
    with matplotlib.rc_context({"svg.hashsalt": "fopi-tune", "font.size": 9.0, "svg.fonttype": "none"}):
        figure = Figure(figsize=(6.4, 6.0), layout="constrained")
        canvas = FigureCanvasSVG(figure)
        gain, phase, error = figure.subplots(3, 1, sharex=True)
        gain.semilogx(omega, _decibel(ideal), color=_IDEAL, label="ideal")
        gain.semilogx(omega, _decibel(filtered), "--", color=_DIGITAL, label="digital")
        phase.semilogx(omega, _phase_deg(ideal), color=_IDEAL)
        phase.semilogx(omega, _phase_deg(filtered), "--", color=_DIGITAL)
        error.loglog(omega, np.maximum(np.abs(filtered / ideal - 1.0), 1e-9), color="black")
        gain.set_ylabel("|C|, dB")
        phase.set_ylabel("arg C, deg")
        error.set_ylabel("|C digital/C ideal - 1|")
        error.set_xlabel("ω, rad/s")
        gain.legend(loc="upper right")
        for axes in (gain, phase, error):
            axes.grid(True, which="both", linewidth=0.3)
            axes.axvline(nyquist, color="grey", linewidth=0.8)
        title = f"{result.spec.name}: controller, ideal and at {digital.sample_time_s:g} s"
        gain.set_title(plain_text(title))
        buffer = io.StringIO()
        canvas.print_svg(buffer, metadata={"Date": None, "Title": title, "Creator": "fopi-tune"})
    return buffer.getvalue()


def simulation_svg(result: Simulated | SimulatedSystem, driven: ScenarioResult) -> str:
    """Output with its setpoint, its rate, and the control, over time; the second mode of a system is shaded."""
    import matplotlib
    from matplotlib.backends.backend_svg import FigureCanvasSVG
    from matplotlib.figure import Figure

    t = driven.traces
    numbers = [f"{name} = {value:g}" for name, value in result.plant.items()]
    named = ", ".join([result.member, *numbers] if result.member else numbers)
    title = f"{result.spec.name}, {driven.scenario.name}" + (f": {named}" if named else "")
    with matplotlib.rc_context({"svg.hashsalt": "fopi-tune", "font.size": 9.0, "svg.fonttype": "none"}):
        figure = Figure(figsize=(6.4, 6.0), layout="constrained")
        canvas = FigureCanvasSVG(figure)
        output, rate, control = figure.subplots(3, 1, sharex=True)
        output.step(t.time_s, driven.reference, "--", where="post", color="grey", label="setpoint")
        output.plot(t.time_s, t.output[0], color=_IDEAL, label="output")
        rate.plot(t.time_s, t.rate[0], color=_IDEAL)
        control.step(t.time_s, t.applied[0], where="post", color=_DIGITAL)
        if isinstance(result.spec, SystemSpec):
            shade_second_mode((output, rate, control), t.time_s, t.mode[0], result.spec.modes[1].name)
        for axes, label in ((output, "output"), (rate, "output's rate, 1/s"), (control, "control")):
            axes.set_ylabel(label)
            axes.grid(True, linewidth=0.3)
        control.set_xlabel("time, s")
        output.legend(loc="best")
        output.set_title(plain_text(title))
        buffer = io.StringIO()
        canvas.print_svg(buffer, metadata={"Date": None, "Title": title, "Creator": "fopi-tune"})
    return buffer.getvalue()


def shade_second_mode(every: Sequence[Axes], time_s: np.ndarray, mode: np.ndarray, name: str) -> None:
    """Grey where mode 2 acts, with one entry in the legend that has its name."""
    edges = np.flatnonzero(np.diff((mode == 2).astype(int), prepend=0, append=0))
    for k, (begin, end) in enumerate(zip(edges[::2], edges[1::2], strict=True)):
        for place, axes in enumerate(every):
            label = plain_text(f"{name} acts") if k == 0 and place == 0 else None
            axes.axvspan(
                float(time_s[begin]), float(time_s[min(end, len(time_s) - 1)]), color="0.85", linewidth=0, label=label
            )


def _decibel(values: np.ndarray) -> np.ndarray:
    return 20.0 * np.log10(np.maximum(np.abs(values), 1e-300))


def _phase_deg(values: np.ndarray) -> np.ndarray:
    return np.degrees(np.unwrap(np.angle(values)))


_REPORT_POINTS = 240
_SMALLEST_ERROR = 1e-9


def digital_picture(documents: ResultDocuments) -> Picture | None:
    """Gain and phase of the ideal and the digital controller, and their distance; None without a digital controller."""
    gains, implementation, digital = documents.gains, documents.digital_implementation, documents.spec.digital
    if gains is None or implementation is None or digital is None:
        return None
    nyquist = implementation.nyquist_rad_s
    omega = np.geomspace(min(digital.band_rad_s[0], nyquist / 100.0), nyquist, _REPORT_POINTS)
    ideal = gains(1j * omega)
    filtered = implementation.sections.response(np.asarray(omega, dtype=float), gains.measurement_filter)
    error = np.maximum(np.abs(filtered / ideal - 1.0), _SMALLEST_ERROR)

    def draw(figure: Figure) -> None:
        gain, phase, distance = figure.subplots(3, 1, sharex=True)
        for response, colour, dashes, label in ((ideal, BLUE, "-", "ideal"), (filtered, ORANGE, "--", "digital")):
            gain.plot(omega, 20.0 * np.log10(np.abs(response)), color=colour, linestyle=dashes, label=label)
            phase.plot(omega, np.degrees(np.unwrap(np.angle(response))), color=colour, linestyle=dashes)
        distance.plot(omega, error, color=BLACK)
        for axes in (gain, phase, distance):
            log_axes(axes, both=axes is distance)
            axes.set_xlim(float(omega[0]), float(omega[-1]))
        label_axes(gain, "|C|, dB")
        label_axes(phase, "arg C, deg")
        label_axes(distance, "relative error", "ω, rad/s")
        legend_below(figure, gain)

    below = error[omega <= 0.3 * nyquist]
    title = f"{documents.spec.name}: controller, ideal and digital at {number(digital.sample_time_s)} s"
    said = (
        "Gain and phase of the ideal controller and of the digital one up to Nyquist's frequency, "
        f"{number(nyquist)} rad/s, and the relative error: at most {number(100.0 * float(below.max()), 3)} % in the "
        "part of the figure below 0.3 of that frequency."
    )
    return Picture(title, said, draw, TWO_PANELS)
