"""Frequency responses:  the brake's loop (the paper's Figs. 3 and 4), and the printed filters."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from fopi_tune.core.controller import FoPi
from fopi_tune.core.margins import margins
from fopi_tune.core.plant import Plant
from fopi_tune.errors import DomainError
from fopi_tune.paper.claims.brake import PLANT_GAIN, fitted_plant
from fopi_tune.paper.claims.filters import published_response, tool_filter
from fopi_tune.paper.published import (
    BRAKE,
    FIG3_CROSSOVER_RAD_S,
    FIG3_PM_DEG,
    FILTERS,
    SAMPLE_TIME_S,
    TAU_MAX_S,
    TAU_MIN_S,
    TAU_NOMINAL_S,
)
from fopi_tune.paper.variants import brake_plant, spec
from fopi_tune.pipeline.tune import tune
from fopi_tune.report.figures.picture import STYLES, Picture, label_axes
from fopi_tune.results.status import Status

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_OMEGA = np.geomspace(1e-3, 1e2, 401)
_TAUS_S = (TAU_MIN_S, TAU_NOMINAL_S, TAU_MAX_S)
#: label, controller, plant
Curve = tuple[str, FoPi, Plant]


def bode_brake() -> Picture:
    """Fig. 3: the published gains with the stated plant, and with plants that give the printed margins."""
    needed = fitted_plant(FIG3_CROSSOVER_RAD_S.value, FIG3_PM_DEG.value)
    plants = ((1.0, TAU_NOMINAL_S), (PLANT_GAIN, TAU_NOMINAL_S), (needed.static_gain, needed.tau_s))
    curves = [
        (f"static gain {gain:.4g}, tau = {tau:.4g} s", BRAKE.gains, brake_plant(gain, tau)) for gain, tau in plants
    ]
    said = "; ".join(f"{label}: {_margins_words(gains, plant)}" for label, gains, plant in curves)
    return Picture(
        "Brake loop with the published gains (Fig. 3)",
        f"Bode plot of the brake's loop for three plants. {said}. The paper says {FIG3_CROSSOVER_RAD_S.text} rad/s and "
        f"{FIG3_PM_DEG.text} deg.",
        lambda figure: _bode(figure, [curves]),
    )


def bode_family() -> Picture:
    """Fig. 4: over tau, the published gains with a static gain of 10, and the robust design for the stated plant."""
    design = tune(spec("brake"), proof=False, bracket=False)
    if design.gains is None or design.status is not Status.SOLVED:
        raise DomainError(f"the robust brake is {design.status.value}: {design.message}; there is nothing to draw")
    families = []
    for gains, gain in ((BRAKE.gains, PLANT_GAIN), (design.gains, 1.0)):
        families.append([(f"tau = {tau:g} s", gains, brake_plant(gain, tau)) for tau in _TAUS_S])
    names = (f"published gains, static gain {PLANT_GAIN:g}", "robust design, static gain 1")
    said = ". ".join(
        f"{name}: " + "; ".join(f"{label}: {_margins_words(*rest)}" for label, *rest in family)
        for name, family in zip(names, families, strict=True)
    )
    return Picture(
        "Brake loop over the time constant (Fig. 4)",
        f"Two Bode plots side by side, three time constants each. {said}.",
        lambda figure: _bode(figure, families, names),
        (9.6, 6.0),
    )


def filter_responses() -> Picture:
    """|R_d| as printed, against s^(1-alpha) and s^-alpha, and the tool's filter of s^-alpha."""
    nyquist = np.pi / SAMPLE_TIME_S
    omega = np.geomspace(1e-3, nyquist * 0.999, 400)

    def draw(figure: Figure) -> None:
        for axes, (name, found) in zip(figure.subplots(1, 2, sharey=True), FILTERS.items(), strict=True):
            alpha = found.of.alpha.value
            # the tool's filter of s^-alpha alone
            sections = tool_filter(name, FoPi(0.0, 1.0, alpha)).sections
            lines = (
                (f"s^{1 - alpha:.2g}, what is stated", omega ** (1 - alpha)),
                (f"s^-{alpha:.2g}", omega**-alpha),
                ("printed coefficients", np.abs(published_response(found, omega))),
                ("this tool's s^-alpha", np.abs(sections.response(omega))),
            )
            for (label, gain), (colour, dashes) in zip(lines, STYLES, strict=False):
                axes.loglog(omega, gain, color=colour, linestyle=dashes, label=label)
            axes.set_title(name)
            axes.set_ylim(1e-2, 1e3)
            label_axes(axes, "|R|" if name == "throttle" else "", "omega, rad/s")
            axes.legend(loc="upper right")

    return Picture(
        "The printed filters R_d",
        "Gain over frequency of both printed filters. Above 1 rad/s they fall as s^-alpha does, where the stated "
        "s^(1 - alpha) rises; below, four digits have spoilt them. The filter of this tool follows "
        "s^-alpha over the band.",
        draw,
        (8.0, 4.2),
    )


def _margins_words(gains: FoPi, plant: Plant) -> str:
    found = margins(gains, plant)
    if found.crossover_rad_s is None or found.phase_margin_deg is None:
        return "no crossover" if found.stable else "unstable"
    return f"crossover {found.crossover_rad_s:.3g} rad/s, phase margin {found.phase_margin_deg:.1f} deg"


def _loop(gains: FoPi, plant: Plant) -> NDArray[np.complex128]:
    s = 1j * _OMEGA
    response = np.polyval(plant.numerator, s) / np.polyval(plant.denominator, s)
    return np.asarray((gains.kp + gains.ki * s**-gains.alpha) * response, dtype=complex)


def _bode(figure: Figure, families: Sequence[Sequence[Curve]], names: Sequence[str] = ("",)) -> None:
    """A column for each family: gain above phase, with the crossovers marked."""
    grid = figure.subplots(2, len(families), sharex=True, sharey="row", squeeze=False)
    for column, (family, name) in enumerate(zip(families, names, strict=True)):
        gain, phase = grid[0][column], grid[1][column]
        for (label, gains, plant), (colour, dashes) in zip(family, STYLES, strict=False):
            loop = _loop(gains, plant)
            gain.semilogx(_OMEGA, 20.0 * np.log10(np.abs(loop)), color=colour, linestyle=dashes, label=label)
            phase.semilogx(_OMEGA, np.degrees(np.unwrap(np.angle(loop))), color=colour, linestyle=dashes)
            _mark(gain, phase, gains, plant, colour)
        gain.axhline(0.0, color="black", linewidth=0.8)
        gain.legend(loc="lower left")
        gain.set_title(name)
        label_axes(gain, "" if column else "|L|, dB")
        label_axes(phase, "" if column else "arg L, deg", "omega, rad/s")


def _mark(gain: Axes, phase: Axes, gains: FoPi, plant: Plant, colour: str) -> None:
    found = margins(gains, plant)
    for omega, angle_deg in zip(found.gain_crossovers_rad_s, found.angles_from_minus_one_deg, strict=True):
        gain.plot([omega], [0.0], "o", color=colour, markersize=4)
        phase.plot([omega], [angle_deg - 180.0], "o", color=colour, markersize=4)
