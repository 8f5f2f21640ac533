"""Step responses:  the family after a unit step of the reference and of a load."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import compress
from typing import TYPE_CHECKING

import numpy as np

from fopi_tune.core.bode_form import Array
from fopi_tune.core.crossings import gain_crossovers
from fopi_tune.core.text_tables.words import agreeing
from fopi_tune.errors import DomainError
from fopi_tune.report.figures.members import Members
from fopi_tune.report.figures.picture import STYLES, TWO_PANELS, Picture, label_axes, legend_below
from fopi_tune.report.text.formatting import number
from fopi_tune.simulation.fractional.linear import Signal, response_and_error

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_POINTS = 120
#: the longest time drawn, times 1/omega of the lowest gain crossover
_HORIZON = 25.0
#: relative to the largest value; a curve with a larger error is left out
_LARGEST_ERROR = 1e-4


def times_s(members: Members) -> Array:
    """Times at which responses are drawn, s; shape (n,), denser at the start, where outputs move."""
    omega = gain_crossovers(members.named_loops).omega_rad_s
    fastest = float(omega.min()) if len(omega) else 1.0
    return np.asarray(_HORIZON / fastest * np.linspace(0.0, 1.0, _POINTS) ** 1.7, dtype=float)


def step_response(members: Members, point: tuple[float, ...], signal: Signal, times: Array) -> Array | None:
    """The unit step response of one plant with the ideal controller; None if it is not accurate to 1e-4 (relative).

    Args:
        members: family and gains.
        point: the plant's uncertain numbers.
        signal: the input that is stepped and the output.
        times: ascending, s.
    """
    plant = members.documents.spec.plant.member(np.array(point))
    try:
        found = response_and_error(members.gains, plant, signal, times)
    except DomainError:
        return None
    size = float(np.abs(found.value).max(initial=0.0))
    return found.value if np.all(found.error <= _LARGEST_ERROR * max(size, 1e-12)) else None


def step_responses(members: Members) -> Picture | None:
    """Output after unit steps of reference and load, over the family; None if no response is accurate enough."""
    t = times_s(members)
    points = [tuple(row) for row in corner_points(members).tolist()]
    every_point = [*(member.point for member in members.named), *points]
    stable = members.stable_in_continuous_time(np.array(every_point, dtype=float))
    drawn, framed = {}, {}
    for signal in (Signal.OUTPUT_AFTER_REFERENCE, Signal.OUTPUT_AFTER_LOAD):
        named = [step_response(members, member.point, signal, t) for member in members.named]
        others = [step_response(members, point, signal, t) for point in points]
        drawn[signal] = (named, [row for row in others if row is not None])
        framed[signal] = [row for row, kept in zip((*named, *others), stable, strict=True) if kept and row is not None]
    if all(row is None for named, _ in drawn.values() for row in named):
        return None

    def draw(figure: Figure) -> None:
        every = figure.subplots(2, 1, sharex=True)
        for axes, (signal, (named, others)) in zip(every, drawn.items(), strict=True):
            for row in others:
                axes.plot(t, row, color="0.75", linewidth=0.7)
            for k, row in enumerate(named):
                if row is not None:
                    colour, dashes = STYLES[k]
                    axes.plot(t, row, color=colour, linestyle=dashes, label=members.named[k].label)
            step = signal is Signal.OUTPUT_AFTER_REFERENCE
            axes.axhline(1.0 if step else 0.0, color="black", linewidth=0.6, linestyle=":")
            label_axes(axes, "output, step of reference" if step else "output, step of load")
            axes.set_xlim(0.0, float(t[-1]))
            if framed[signal] and not np.all(stable):
                axes.set_ylim(*axis_limits(framed[signal], 1.0 if step else 0.0))
        every[-1].set_xlabel("time, s")
        legend_below(figure, every[0])

    told = _settling_words(members, t, drawn[Signal.OUTPUT_AFTER_REFERENCE][0][0])
    told += _unstable_note(len(set(compress(every_point, ~stable))), len(set(every_point)))
    title = f"{members.documents.spec.name}: unit steps of the reference and of a load at the plant's input"
    said = f"Output over time with the ideal controller, in continuous time; grey: plants of the family.{told}"
    return Picture(title, said, draw, TWO_PANELS)


def axis_limits(rows: Sequence[Array], final: float) -> tuple[float, float]:
    """Limits of an axis that shows all rows and their final value, with a margin."""
    low = min([0.0, final, *(float(row.min()) for row in rows)])
    high = max([0.0, final, *(float(row.max()) for row in rows)])
    margin = 0.05 * (high - low) or 0.05
    return low - margin, high + margin


def _unstable_note(unstable: int, many: int) -> str:
    """The sentence about unstable plants in a figure's description; empty without any."""
    if not unstable:
        return ""
    if unstable == many:
        return " The loop is unstable for every plant drawn."
    return (
        f" Of the {many} plants drawn {unstable} {agreeing(unstable, 'leaves', 'leave')} an unstable loop: the axis is "
        "that of the stable ones, and the others' outputs leave it."
    )


def _settling_words(members: Members, t: Array, nominal: Array | None) -> str:
    """The nominal step response in words, and how the loop settles."""
    told = ""
    if nominal is not None:
        told = (
            f" The nominal output's largest value is {number(float(nominal.max()), 4)}; at {number(float(t[-1]), 4)} s "
            f"it is {number(float(nominal[-1]), 4)}."
        )
    if not (members.documents.design["stability"] or {}).get("stable"):
        return f"{told} The loop is not shown to be stable for every plant."
    return told if members.gains.alpha == 1.0 else f"{told} A fractional loop settles with a slow algebraic tail."


def corner_points(members: Members) -> Array:
    """Plants beside the named ones: along the one uncertain number, or corners of the box; shape (m, p)."""
    family = members.documents.spec.plant
    if family.has_one_plant:
        return np.zeros((0, len(family.nominal_point)))
    if len(members.numbers) == 1:
        return members.points_along(members.parameter_values[::3])
    return family.corners(16)
