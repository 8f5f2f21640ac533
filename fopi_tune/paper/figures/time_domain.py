"""Time responses:  switching of the modes, the brake manoeuvre, Experiments I and II, and FOPI against PI."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from fopi_tune.core.margins import margins
from fopi_tune.paper.claims.fopi_vs_pi import design_pair, setpoint_step
from fopi_tune.paper.claims.manoeuvre import GAINS, READINGS
from fopi_tune.paper.published import BRAKE, COMFORT_M_S2, TAU_MAX_S, TAU_MIN_S, TAU_NOMINAL_S
from fopi_tune.paper.table import rounded_count
from fopi_tune.paper.variants import brake_plant, spec, system
from fopi_tune.paper.variants import manoeuvre as spec_of
from fopi_tune.pipeline.simulate import simulate
from fopi_tune.pipeline.systems import simulate_system
from fopi_tune.report.figures.picture import BLUE, ORANGE, STYLES, Picture, label_axes
from fopi_tune.report.figures.plots import shade_second_mode
from fopi_tune.results.simulation import ScenarioResult

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_KMH = 3.6
#: s; step and end of the responses to a step of the setpoint
_STEP_S, _END_S = 0.25, 80.0


def switching() -> Picture:
    """The modes without hysteresis, on samples; the start of sliding in continuous time is marked."""
    (driven,) = simulate_system(system("switching")).driven
    exact = simulate_system(system("switching"), exact=True).driven[0]
    slides = exact.switch_times_s[-1]

    def draw(figure: Figure) -> None:
        velocity, mode = figure.subplots(2, 1, sharex=True, height_ratios=(3, 1))
        _velocity(velocity, driven)
        velocity.axvline(slides, color="black", linewidth=0.8, linestyle=":", label="sliding in continuous time")
        velocity.legend(loc="upper right")
        mode.step(driven.traces.time_s, driven.traces.mode[0], where="post", color=BLUE, linewidth=0.7)
        mode.set_yticks([1, 2], ["throttle (S1)", "brake (S2)"])
        label_axes(mode, "", "time, s")

    return Picture(
        "Switching between throttle and brake without hysteresis",
        f"Velocity and active mode over {driven.scenario.duration_s:g} s with eps = 0, on samples: the "
        f"modes change about {rounded_count(driven.measures['switch_count'])} times. In continuous time the car slides "
        f"on the switching line from {slides:.2f} s on.",
        draw,
    )


def manoeuvre() -> Picture:
    """Velocity and acceleration from 30 km/h: a column for each plant gain, a line for each reading."""
    found = {gain: simulate(spec_of(gain), BRAKE.gains).driven for gain in GAINS}

    def draw(figure: Figure) -> None:
        grid = figure.subplots(2, len(GAINS), sharex=True, sharey="row")
        for column, gain in enumerate(GAINS):
            velocity, acceleration = grid[0][column], grid[1][column]
            for driven, (colour, dashes) in zip(found[gain], STYLES, strict=False):
                line: dict[str, Any] = {"color": colour, "linestyle": dashes}
                time_s = driven.traces.time_s
                velocity.plot(time_s, driven.traces.output[0], label=driven.scenario.name.replace("_", " "), **line)
                acceleration.plot(time_s, driven.traces.rate[0] / _KMH, **line)
            _comfort(acceleration)
            velocity.set_title(f"static gain {gain}")
            label_axes(velocity, "" if column else "velocity, km/h")
            label_axes(acceleration, "" if column else "acceleration, m/s^2", "time, s")
            acceleration.set_xlim(0.0, 40.0)
        grid[0][0].legend(loc="upper right")

    said = "; ".join(
        f"static gain {gain}, {READINGS[d.scenario.name]}: largest |a| {d.measures['acceleration_m_s2']:.2f} m/s^2"
        for gain, every in found.items()
        for d in every
    )
    return Picture(
        "Braking from 30 km/h under each reading of the start",
        f"Velocity and acceleration over time with the comfort limit of {COMFORT_M_S2:g} m/s^2. {said}.",
        draw,
        (9.6, 6.0),
    )


def experiment_1() -> Picture:
    """Experiment I on a plausible reference."""
    return _experiment("experiment_1", "Experiment I, on a plausible reference")


def experiment_2() -> Picture:
    """Experiment II on a plausible reference."""
    return _experiment("experiment_2", "Experiment II, on a plausible reference")


def alpha_against_pi() -> Picture:
    """Phase margin over tau, and the error after a step of the setpoint, of the robust brake and its PI."""
    found = design_pair(spec("brake"))
    taus = np.linspace(TAU_MIN_S, TAU_MAX_S, 41)
    names = (f"FOPI, alpha = {found.gains[0].alpha:.3f}", "PI")
    phases = [[margins(gains, brake_plant(tau_s=t)).phase_margin_deg for t in taus.tolist()] for gains in found.gains]
    steps = [setpoint_step(gains, TAU_NOMINAL_S, 0.0, _STEP_S, _END_S) for gains in found.gains]

    def draw(figure: Figure) -> None:
        phase, error = figure.subplots(1, 2)
        for name, angles, (times, output), (colour, dashes) in zip(names, phases, steps, STYLES, strict=False):
            phase.plot(taus, np.array(angles, dtype=float), color=colour, linestyle=dashes, label=name)
            error.semilogy(times, np.abs(1.0 - output), color=colour, linestyle=dashes, label=name)
        error.axhline(0.02, color="black", linewidth=0.8, linestyle=":")
        error.set_ylim(1e-3, 1.0)
        label_axes(phase, "phase margin, deg", "tau, s")
        label_axes(error, "|r - y| after a unit step", f"time, s (tau = {TAU_NOMINAL_S:g} s)")
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


def _experiment(name: str, title: str) -> Picture:
    (driven,) = simulate_system(system("car_held"), scenario=name).driven

    def draw(figure: Figure) -> None:
        velocity, acceleration, control = figure.subplots(3, 1, sharex=True)
        _velocity(velocity, driven)
        time_s = driven.traces.time_s
        acceleration.plot(time_s, driven.traces.rate[0] / _KMH, color=BLUE, linewidth=0.8)
        _comfort(acceleration)
        control.step(time_s, driven.traces.applied[0], where="post", color=ORANGE, linewidth=0.8)
        for axes, label in ((acceleration, "acceleration, m/s^2"), (control, "control")):
            label_axes(axes, label)
        control.set_xlabel("time, s")
        velocity.legend(loc="best")

    m = driven.measures
    return Picture(
        title,
        f"Velocity with its setpoint, acceleration and normalised control over {driven.scenario.duration_s:g} s; the "
        f"time with the brake is shaded. Largest |a| {m['acceleration_m_s2']:.2f} m/s^2, "
        f"about {rounded_count(m['switch_count'])} changes of the mode, mean error "
        f"{m['iae'] / driven.scenario.duration_s:.2f} km/h.",
        draw,
    )


def _velocity(axes: Axes, driven: ScenarioResult) -> None:
    """Plot output and setpoint, with the time of the brake shaded."""
    time_s = driven.traces.time_s
    shade_second_mode((axes,), time_s, driven.traces.mode[0], "brake")
    axes.step(time_s, driven.reference, "--", where="post", color="black", linewidth=0.8, label="setpoint")
    axes.plot(time_s, driven.traces.output[0], color=BLUE, label="velocity")
    label_axes(axes, "velocity, km/h")


def _comfort(axes: Axes) -> None:
    for limit in np.array([-COMFORT_M_S2, COMFORT_M_S2]):
        axes.axhline(float(limit), color="black", linewidth=0.8, linestyle=":")
