"""Figures of what is proved of a system:  SystemCertificate -> an orbit in time, and where it was decided."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from fopi_tune.proof.switched import SystemCertificate
from fopi_tune.proof.switched.certificate import told
from fopi_tune.proof.switched.cycles import CycleProof, verify_cycle
from fopi_tune.report.figures.picture import (
    BLUE,
    GREEN,
    ORANGE,
    WIDE,
    Picture,
    label_axes,
    legend_below,
    plain_text,
    with_unit_label,
)
from fopi_tune.report.words import axis_label, in_words

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: periods of an orbit that are drawn, and samples at least
_PERIODS, _SAMPLES = 3, 40


def orbit_picture(certificate: SystemCertificate, unit: str = "") -> Picture | None:
    """The widest of the proved orbits against time, the second mode shaded; None without an orbit.

    Args:
        certificate: that was checked.
        unit: of the output, which a certificate does not hold.
    """
    if not certificate.cycles:
        return None
    shown = max(certificate.cycles, key=lambda each: each.highest - each.lowest)
    orbit = verify_cycle(certificate.model, shown)
    if orbit is None:
        return None
    model, brake = certificate.model, certificate.model.loops[1].name
    period = len(shown.modes)
    count = max(_PERIODS * period, _SAMPLES)
    time_s = model.sample_time_s * np.arange(count + 1)
    y = shown.setpoint + np.resize(orbit.deviations, count + 1)
    braking = np.resize([each == "B" for each in shown.modes], count)

    def draw(figure: Figure) -> None:
        axes = figure.subplots()
        edges = np.flatnonzero(np.diff(braking.astype(int), prepend=0, append=0))
        for k, (begin, end) in enumerate(zip(edges[::2], edges[1::2], strict=True)):
            label = plain_text(f"the {brake} is active") if k == 0 else None
            axes.axvspan(float(time_s[begin]), float(time_s[end]), color="0.85", linewidth=0, label=label)
        axes.plot(time_s, y, color=BLUE, marker=".", markersize=3, linewidth=0.9, label="output at the samples")
        axes.axhline(shown.setpoint, color=ORANGE, linestyle="--", linewidth=0.9, label="setpoint")
        for k, each in enumerate((model.lines.down, model.lines.up)):
            label = "lines of the hysteresis" if k == 0 else None
            line = each.level(shown.setpoint)
            axes.axhline(line, color=GREEN, linestyle=":", linewidth=0.9, label=label)
        axes.set_xlim(0.0, float(time_s[-1]))
        label_axes(axes, with_unit_label("output", unit), "time, s")
        legend_below(figure, axes)

    place = in_words(place_of(certificate, shown))
    attracts = "attracting " if shown.attracts else ""
    return Picture(
        f"{certificate.name}: a periodic orbit, proved",
        f"The output over {time_s[-1]:g} s on the {attracts}orbit at {place}: {period} samples or "
        f"{period * model.sample_time_s:g} s repeat for ever, between {shown.setpoint + shown.lowest:.4g} and "
        f"{shown.setpoint + shown.highest:.4g}{f' {unit}' if unit else ''}. Grey where the {brake} is active.",
        draw,
        (WIDE, 4.0),
    )


def region_picture(certificate: SystemCertificate, unit: str = "") -> Picture | None:
    """Setpoints and plants where settling or an orbit is proved; None where neither is.

    Args:
        certificate: that was checked.
        unit: of the output and the setpoint, which a certificate does not hold.
    """
    settling, cycles = certificate.settling, certificate.cycles
    if settling is None and not cycles:
        return None
    axis = _plant_axis(certificate)
    low, high = (0.0, 1.0) if axis is None else axis[2:]

    def draw(figure: Figure) -> None:
        axes = figure.subplots()
        if settling is not None:
            start, end = settling.setpoints
            axes.fill_between(
                [start, end], low, high, color=BLUE, alpha=0.25, hatch="//", linewidth=0, label="settles, proved"
            )
        if cycles:
            heights = [0.5 if axis is None else _number_of(each, axis) for each in cycles]
            setpoints = [each.setpoint for each in cycles]
            axes.plot(setpoints, heights, "o", color=ORANGE, markersize=5, label="periodic orbit, proved")
        for end in certificate.setpoints or ():
            axes.axvline(end, color="black", linestyle=":", linewidth=0.9)
        room = 0.08 * (high - low)
        axes.set_ylim(low - room, high + room)
        if axis is None:
            axes.set_yticks([])
        number = "" if axis is None else f"{certificate.model.loops[axis[0]].name}: {axis_label(axis[1])}"
        label_axes(axes, plain_text(number), with_unit_label("setpoint", unit))
        legend_below(figure, axes)

    return Picture(
        f"{certificate.name}: what is decided, by setpoint and plant", _region_words(certificate), draw, (WIDE, 3.6)
    )


def place_of(certificate: SystemCertificate, cycle: CycleProof) -> str:
    """Setpoint and plants of an orbit in words."""
    plants = zip(certificate.model.loops, cycle.plants, strict=True)
    numbers = [f"{loop.name}.{name} = {value:g}" for loop, plant in plants for name, value in plant.items()]
    return ", ".join([f"setpoint {cycle.setpoint:g}", *numbers])


def _plant_axis(certificate: SystemCertificate) -> tuple[int, str, float, float] | None:
    """Mode, name and range of the first uncertain number, the second mode's first; None without one."""
    for index in (1, 0):
        plant = certificate.model.loops[index].plant
        if plant.uncertain_names:
            name = plant.uncertain_names[0]
            return index, name, plant.parameters[name].min, plant.parameters[name].max
    return None


def _number_of(cycle: CycleProof, axis: tuple[int, str, float, float]) -> float:
    return cycle.plants[axis[0]][axis[1]]


def _region_words(certificate: SystemCertificate) -> str:
    settling, cycles = certificate.settling, certificate.cycles
    parts = []
    if settling is not None:
        low, high = map(told, settling.setpoints)
        parts.append(
            f"Settling is proved for every setpoint from {low} to {high} and "
            "every plant of the families, also one that varies."
        )
    if cycles:
        places = "one place" if len(cycles) == 1 else f"{len(cycles)} places"
        parts.append(f"A periodic orbit is proved at {places}, each a setpoint with constant plants.")
    if certificate.setpoints is not None:
        low, high = map(told, certificate.setpoints)
        parts.append(f"Asked for, between the dotted lines: {low} to {high}.")
    return " ".join([*parts, "Elsewhere nothing is said."])
