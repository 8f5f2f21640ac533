"""The brake's controller:  its loop with the stated plant, and the plant for which the printed margins are right."""

from __future__ import annotations

import cmath
import math
from dataclasses import dataclass

import numpy as np

from fopi_tune.core.margins import Margins, margins
from fopi_tune.paper.published import (
    BRAKE,
    FIG3_CROSSOVER_RAD_S,
    FIG3_PM_DEG,
    SPECIFIED_CROSSOVER_RAD_S,
    SPECIFIED_PM_DEG,
    TAU_MAX_S,
    TAU_MIN_S,
    TAU_NOMINAL_S,
)
from fopi_tune.paper.table import Row, verdict_of
from fopi_tune.paper.variants import brake_plant, nominal_requirements, spec, with_alpha, with_requirements
from fopi_tune.pipeline.tune import tune
from fopi_tune.report.text.formatting import number
from fopi_tune.results.status import Status

#: a plant gain that makes the published crossover about what is printed
PLANT_GAIN = 10.0
#: deg; the phase margin that specs/brake.yaml requires of every plant
_ROBUST_DEG = 80.0
_TAUS_S = (TAU_MIN_S, TAU_NOMINAL_S, TAU_MAX_S)
_SPECIFIED = f"{SPECIFIED_CROSSOVER_RAD_S:g} rad/s and {SPECIFIED_PM_DEG:g} deg"


@dataclass(frozen=True)
class FittedPlant:
    """The plant static_gain/(tau s + 1) that gives a crossover and a phase margin with the published gains."""

    static_gain: float
    tau_s: float


def brake() -> tuple[Row, ...]:
    """The published gains with the stated plant and with others, and gains that meet the specifications."""
    return (*_figure_3(), _phase_at_crossover(), _order(), _other_gains(), _family(), _robust())


def fitted_plant(crossover_rad_s: float, phase_margin_deg: float) -> FittedPlant:
    """The plant for which the published gains give this crossover and phase margin.

    At the crossover omega, PM = pi + arg C - arctan(tau omega) gives tau, and |C P| = 1 the static gain.
    """
    controller = _controller_at(crossover_rad_s)
    tau = math.tan(math.pi + cmath.phase(controller) - math.radians(phase_margin_deg)) / crossover_rad_s
    return FittedPlant(math.hypot(1.0, tau * crossover_rad_s) / abs(controller), tau)


def published_margins(static_gain: float, tau_s: float) -> Margins:
    """Margins of the published gains with a plant static_gain/(tau s + 1)."""
    return margins(BRAKE.gains, brake_plant(static_gain, tau_s))


def _controller_at(omega: float) -> complex:
    gains = BRAKE.gains
    return gains.kp + gains.ki * (1j * omega) ** -gains.alpha


def _figure_3() -> tuple[Row, ...]:
    stated, ten = published_margins(1.0, TAU_NOMINAL_S), published_margins(PLANT_GAIN, TAU_NOMINAL_S)
    assert stated.crossover_rad_s is not None
    assert stated.phase_margin_deg is not None
    needed = fitted_plant(FIG3_CROSSOVER_RAD_S.value, FIG3_PM_DEG.value)
    return (
        Row(
            "The brake's crossover is 0.7 rad/s (Fig. 3)",
            f"{FIG3_CROSSOVER_RAD_S.text} rad/s",
            f"{stated.crossover_rad_s:.5f} rad/s",
            verdict_of(FIG3_CROSSOVER_RAD_S.agrees(stated.crossover_rad_s)),
            f"For the stated plant 1/(tau s + 1) at tau = {TAU_NOMINAL_S:g} s, to half a unit of the printed digit.",
        ),
        Row(
            "The brake's phase margin is 93 deg (Fig. 3)",
            f"{FIG3_PM_DEG.text} deg",
            f"{stated.phase_margin_deg:.1f} deg",
            verdict_of(FIG3_PM_DEG.agrees(stated.phase_margin_deg)),
            f"For the stated plant at tau = {TAU_NOMINAL_S:g} s, to half a unit of the last printed digit.",
        ),
        Row(
            "Fig. 3 shows a brake of another static gain",
            f"{FIG3_CROSSOVER_RAD_S.text} rad/s, {FIG3_PM_DEG.text} deg",
            f"exactly so for a static gain of {needed.static_gain:.2f} and tau = {needed.tau_s:.3f} s; a gain of "
            f"{PLANT_GAIN:g} at {TAU_NOMINAL_S:g} s gives {ten.crossover_rad_s:.4f} rad/s, {ten.phase_margin_deg:.2f} "
            "deg",
            verdict_of(TAU_MIN_S <= needed.tau_s <= TAU_MAX_S, on_condition=True),
            "With a plant gain that is not printed; the tau it takes lies inside the printed interval, but is not the "
            "nominal one.",
        ),
    )


def _phase_at_crossover() -> Row:
    """At the specified crossover the phase margin does not depend on the plant's static gain."""
    controller = _controller_at(SPECIFIED_CROSSOVER_RAD_S)
    found = [
        180.0 + math.degrees(cmath.phase(controller) - math.atan(tau * SPECIFIED_CROSSOVER_RAD_S)) for tau in _TAUS_S
    ]
    return Row(
        f"The brake's gains meet the specified {_SPECIFIED}",
        str(BRAKE),
        f"whatever the plant's gain, a crossover of {SPECIFIED_CROSSOVER_RAD_S:g} rad/s comes with {found[1]:.1f} deg "
        f"at tau = {TAU_NOMINAL_S:g} s ({found[2]:.1f} to {found[0]:.1f} deg over tau)",
        verdict_of(found[2] <= SPECIFIED_PM_DEG <= found[0]),
        "A static gain does not turn the phase; arctan(tau omega) is monotonic in tau, so that its ends decide.",
    )


def _order() -> Row:
    """kp >= 0 where cot(alpha pi/2) <= -Re X/Im X, with X = e^{j(pm - pi)}/P(j omega) = C(j omega) at the crossover."""
    omega, margin = SPECIFIED_CROSSOVER_RAD_S, math.radians(SPECIFIED_PM_DEG)
    x = cmath.exp(1j * (margin - math.pi)) * complex(1.0, omega * TAU_NOMINAL_S)
    least = 2.0 / math.pi * math.atan2(-x.imag, x.real)
    wanted = spec("brake")
    design = tune(
        with_alpha(with_requirements(wanted, *nominal_requirements(wanted)), BRAKE.alpha.value, BRAKE.alpha.value),
        proof=False,
        bracket=False,
    )
    return Row(
        f"An order of {BRAKE.alpha.text} can meet {_SPECIFIED}",
        f"alpha = {BRAKE.alpha.text}",
        f"kp >= 0 needs alpha >= {least:.4f}; tuned with alpha = {BRAKE.alpha.text}: {design.status.value}",
        verdict_of(design.status is Status.SOLVED and least <= BRAKE.alpha.value),
        "Two equalities leave alpha as the one free number, and kp as a function of it.",
    )


def _other_gains() -> Row:
    wanted = spec("brake")
    design = tune(
        with_alpha(with_requirements(wanted, *nominal_requirements(wanted)), 0.8, 0.8), proof=False, bracket=False
    )
    gains = design.gains
    return Row(
        f"Some gains meet {_SPECIFIED} on the stated plant",
        str(BRAKE),
        "none" if gains is None else f"kp = {gains.kp:.4f}, ki = {gains.ki:.4f}, alpha = {gains.alpha:g}",
        verdict_of(design.status is Status.SOLVED, on_condition=True),
        "With other gains than the printed ones; one pair for every alpha from 0.622 on.",
    )


def _family() -> Row:
    """Margins decrease with tau, so that the ends of its interval give their ranges; a grid confirms it."""
    grid = np.linspace(TAU_MIN_S, TAU_MAX_S, 31).tolist()
    every = [published_margins(PLANT_GAIN, tau) for tau in grid]
    phase = [m.phase_margin_deg for m in every if m.phase_margin_deg is not None]
    cross = [m.crossover_rad_s for m in every if m.crossover_rad_s is not None]
    stated = [published_margins(1.0, tau).phase_margin_deg for tau in (TAU_MIN_S, TAU_MAX_S)]
    return Row(
        "The brake's loop is robust to its time constant (Fig. 4)",
        "no numbers",
        f"with a static gain of {PLANT_GAIN:g}: phase margin {min(phase):.1f} to {max(phase):.1f} deg, crossover "
        f"{min(cross):.3f} to {max(cross):.3f} rad/s; with 1: {stated[1]:.1f} to {stated[0]:.1f} deg",
        verdict_of(len(phase) == len(grid) and min(phase) >= _ROBUST_DEG, on_condition=True),
        f"With a static gain of {PLANT_GAIN:g}; robust: at least {_ROBUST_DEG:g} deg for every tau. With the stated "
        "gain of 1 the margin is robust as well, at a crossover that is of no use.",
    )


def _robust() -> Row:
    design = tune(spec("brake"), bracket=False)
    gains = design.gains
    solved = design.status is Status.SOLVED
    least = next(r for r in design.requirements if r.requirement.lower == _ROBUST_DEG)
    said = "none"
    if gains and least.result is not None and least.result.achieved is not None and design.objective is not None:
        said = (
            f"kp = {number(gains.kp, 4)}, ki = {number(gains.ki, 4)}, alpha = {number(gains.alpha, 4)}: margin >= "
            f"{least.result.achieved:.1f} deg, within {design.objective:.2f} deg of the nominal plant's"
        )
    return Row(
        f"A robust design meets {_SPECIFIED} on the stated plant",
        str(BRAKE),
        said,
        verdict_of(solved, on_condition=True),
        "With other gains, and the gain margin as an inequality: the least spread of the phase margin with |S| <= -20 "
        "dB up to 0.02 rad/s. Proved for every tau and every frequency.",
    )
