"""The figure of the digital controller against the ideal one."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from fopi_tune.report.figures.canvas import (
    BLACK,
    BLUE,
    ORANGE,
    TWO_PANELS,
    Picture,
    labelled,
    legend_below,
    logarithmic,
)
from fopi_tune.report.findings import Findings
from fopi_tune.report.text.phrases import number

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_POINTS = 240
_SMALLEST = 1e-9


def filter_picture(findings: Findings) -> Picture | None:
    """Gain and phase of both up to Nyquist's frequency, and their distance; None without a digital controller."""
    gains, implementation, digital = findings.gains, findings.digital_implementation, findings.spec.digital
    if gains is None or implementation is None or digital is None:
        return None
    nyquist = implementation.nyquist_rad_s
    omega = np.geomspace(min(digital.band_rad_s[0], nyquist / 100.0), nyquist, _POINTS)
    ideal = gains.kp + gains.ki * (1j * omega) ** -gains.alpha
    filtered = implementation.sections.response(np.asarray(omega, dtype=float))
    error = np.maximum(np.abs(filtered / ideal - 1.0), _SMALLEST)

    def draw(figure: Figure) -> None:
        gain, phase, distance = figure.subplots(3, 1, sharex=True)
        for response, colour, dashes, label in ((ideal, BLUE, "-", "ideal"), (filtered, ORANGE, "--", "digital")):
            gain.plot(omega, 20.0 * np.log10(np.abs(response)), color=colour, linestyle=dashes, label=label)
            phase.plot(omega, np.degrees(np.unwrap(np.angle(response))), color=colour, linestyle=dashes)
        distance.plot(omega, error, color=BLACK)
        for axes in (gain, phase, distance):
            logarithmic(axes, both=axes is distance)
            axes.set_xlim(float(omega[0]), float(omega[-1]))
        labelled(gain, "|C|, dB")
        labelled(phase, "arg C, deg")
        labelled(distance, "relative error", "omega, rad/s")
        legend_below(figure, gain)

    below = error[omega <= 0.3 * nyquist]
    title = f"{findings.spec.name}: controller, ideal and digital at {number(digital.sample_time_s)} s"
    said = (
        "Gain and phase of the ideal fractional controller and of the digital one up to Nyquist's frequency, "
        f"{number(nyquist)} rad/s, and the relative error: at most {number(100.0 * float(below.max()), 3)} % in the "
        "part of the figure below 0.3 of that frequency."
    )
    return Picture(title, said, draw, TWO_PANELS)
