"""The figure of FOPI against PI:  what the robust brake gains in margin, and what that costs in time."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from fopi_tune.core.margins import margins
from fopi_tune.paper.claims.fopi_vs_pi import pair
from fopi_tune.paper.printed import TAU_MAX_S, TAU_MIN_S, TAU_NOMINAL_S
from fopi_tune.paper.responses import step_of
from fopi_tune.paper.sources import brake_plant, spec
from fopi_tune.report.figures.canvas import STYLES, Picture, labelled

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_STEP_S, _END_S = 0.25, 80.0


def alpha_against_pi() -> Picture:
    """Phase margin over tau, and the error after a step of the setpoint, of the robust brake and its PI."""
    found = pair(spec("brake"))
    taus = np.linspace(TAU_MIN_S, TAU_MAX_S, 41)
    names = (f"FOPI, alpha = {found.gains[0].alpha:.3f}", "PI")
    phases = [[margins(gains, brake_plant(tau_s=t)).phase_margin_deg for t in taus.tolist()] for gains in found.gains]
    steps = [step_of(gains, TAU_NOMINAL_S, 0.0, _STEP_S, _END_S) for gains in found.gains]

    def draw(figure: Figure) -> None:
        phase, error = figure.subplots(1, 2)
        for name, angles, (times, output), (colour, dashes) in zip(names, phases, steps, STYLES, strict=False):
            phase.plot(taus, np.array(angles, dtype=float), color=colour, linestyle=dashes, label=name)
            error.semilogy(times, np.abs(1.0 - output), color=colour, linestyle=dashes, label=name)
        error.axhline(0.02, color="black", linewidth=0.8, linestyle=":")
        error.set_ylim(1e-3, 1.0)
        labelled(phase, "phase margin, deg", "tau, s")
        labelled(error, "|r - y| after a unit step", f"time, s (tau = {TAU_NOMINAL_S:g} s)")
        phase.legend(loc="best")

    one, other = found.objectives
    return Picture(
        "Robust brake: fractional order against PI",
        f"Left: the phase margin over tau changes by {one:.2f} deg with the fractional order and by {other:.2f} deg "
        "with the PI. Right: after a unit step the error decays as a power of time with the fractional order, "
        "exponentially with the PI, on a logarithmic scale with the 2 % line.",
        draw,
        (8.0, 4.2),
    )
