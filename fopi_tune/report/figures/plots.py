"""Figures of the digital controller and of simulations; equal results give equal bytes.

`controller_bode_svg` and `simulation_svg` are files of their own; `digital_picture` is part of the report.
"""

from __future__ import annotations

import io
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from fopi_tune.core.controller import FoPi
from fopi_tune.core.parallel_form import Sections
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
    svg_of,
)
from fopi_tune.report.text.formatting import number
from fopi_tune.spec.model import DigitalSpec, SystemSpec

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from fopi_tune.results.design import Discretized
    from fopi_tune.results.simulation import ScenarioResult, Simulated
    from fopi_tune.results.system import SimulatedSystem


def controller_bode_svg(result: Discretized) -> str:
    """Gain and phase of the ideal controller and of the digital one, up to Nyquist's frequency, and their distance."""
    controller = result.controller
    return svg_of(_controller_picture(result.spec.name, controller.gains, controller.sections, controller.digital))


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
        output.plot(t.time_s, t.output[0], color=BLUE, label="output")
        rate.plot(t.time_s, t.rate[0], color=BLUE)
        control.step(t.time_s, t.applied[0], where="post", color=ORANGE)
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


_REPORT_POINTS = 240
_SMALLEST_ERROR = 1e-9


def digital_picture(documents: ResultDocuments) -> Picture | None:
    """The same of a result's documents; None without a digital controller."""
    gains, implementation, digital = documents.gains, documents.digital_implementation, documents.spec.digital
    if gains is None or implementation is None or digital is None:
        return None
    return _controller_picture(documents.spec.name, gains, implementation.sections, digital)


def _controller_picture(name: str, gains: FoPi, sections: Sections, digital: DigitalSpec) -> Picture:
    nyquist = np.pi / digital.sample_time_s
    omega = np.geomspace(min(digital.band_rad_s[0], nyquist / 100.0), nyquist, _REPORT_POINTS)
    ideal = gains(1j * omega)
    filtered = sections.response(np.asarray(omega, dtype=float), gains.measurement_filter)
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
    title = f"{name}: controller, ideal and digital at {number(digital.sample_time_s)} s"
    said = (
        "Gain and phase of the ideal controller and of the digital one up to Nyquist's frequency, "
        f"{number(nyquist)} rad/s, and the relative error: at most {number(100.0 * float(below.max()), 3)} % in the "
        "part of the figure below 0.3 of that frequency."
    )
    return Picture(title, said, draw, TWO_PANELS)
