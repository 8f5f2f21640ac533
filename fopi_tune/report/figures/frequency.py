"""Frequency responses:  Bode and Nyquist plots of the loop, sensitivities, and margins over an uncertain number."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from fopi_tune.core.bode_form import Array, Complex
from fopi_tune.core.crossings import gain_crossovers
from fopi_tune.core.text_tables.words import agreeing
from fopi_tune.errors import DomainError
from fopi_tune.proof.verification.sample import LoopFunction, evaluate
from fopi_tune.quantities import QUANTITIES
from fopi_tune.quantities.objectives import ObjectiveKind
from fopi_tune.report.figures.forbidden_regions import (
    critical_phases,
    fit_with_limits,
    fit_y_limits,
    forbid_along,
    forbid_arcs,
    forbid_crossovers,
    forbid_discs,
    forbid_phases,
    forbid_values,
    mark_critical_phases,
    sensitivity_discs,
)
from fopi_tune.report.figures.members import Members
from fopi_tune.report.figures.picture import STYLES, TWO_PANELS, WIDE, Picture, label_axes, legend_below, log_axes
from fopi_tune.report.text.formatting import number
from fopi_tune.report.words import axis_label, name_and_unit
from fopi_tune.spec.model import Relation, Requirement, Scope

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from fopi_tune.core.loops import Loops

_DB = 20.0 / math.log(10.0)
_ENVELOPE = {"color": "#56b4e9", "alpha": 0.35, "linewidth": 0.0}
_NYQUIST_VIEW = (-2.2, 1.2, -1.9, 1.5)
#: members that the Nyquist figure draws in grey
_GREY = 25
_HATCHED = "Hatched: what the requirements forbid"


def bode(members: Members) -> Picture:
    """Gain and phase of L: the family's envelope, nominal and worst plants, and the forbidden regions."""
    family, named = members.family_log_loop, members.named_log_loop
    requirements = members.documents.spec.requirements
    crossings, of_named = _crossovers(members), gain_crossovers(members.named_loops)
    phases, own = np.degrees(of_named.phase_rad), of_named.row == 0
    turned = members.gains_at_phase_crossovers

    def draw(figure: Figure) -> None:
        gain, phase = figure.subplots(2, 1, sharex=True)
        for axes, band, lines in (
            (gain, _DB * family.real, _DB * named.real),
            (phase, np.degrees(family.imag), np.degrees(named.imag)),
        ):
            _plot_family(axes, members, band, lines)
        fit_y_limits(gain, [_DB * family.real, _DB * named.real], 160.0)
        fit_y_limits(phase, [np.degrees(family.imag), np.degrees(named.imag)], 300.0)
        mark_critical_phases(phase, phases)
        low, high = phase.get_ylim()
        exact = [r.limits[0] - 160.0 for r in requirements if _is_exact(r, "phase_margin_deg")]
        phase.set_ylim(min([low, *(each - 40.0 for each in exact)]), max([high, *exact]))
        gain.axhline(0.0, color="black", linewidth=0.6)
        forbid_values(gain, requirements, "loop_gain_db")
        forbid_crossovers(gain, requirements)
        if crossings is not None:
            forbid_phases(phase, requirements, crossings, (of_named.omega_rad_s[own], phases[own]))
        for row, omega, arg in zip(of_named.row, of_named.omega_rad_s, phases, strict=True):
            for axes, height in ((gain, 0.0), (phase, arg)):
                axes.plot([omega], [height], "o", color=STYLES[row][0], markersize=5, zorder=4)
            phase.plot([omega] * 2, [arg, float(critical_phases(arg))], color=STYLES[row][0], linewidth=0.8)
        for row, omega, size in turned:
            level = _DB * math.log(size)
            gain.plot([omega], [level], "s", color=STYLES[row][0], markersize=4, zorder=4)
            gain.plot([omega] * 2, [level, 0.0], color=STYLES[row][0], linewidth=0.8)
        label_axes(gain, "|L|, dB")
        label_axes(phase, "arg L, deg", "ω, rad/s")
        legend_below(figure, gain)

    at = "no plant has a gain crossover" if crossings is None else _range_phrase("gain crossovers", crossings, "rad/s")
    title = f"{members.documents.spec.name}: Bode, the loop L = C P"
    said = (
        f"Gain and phase of the loop over frequency, {_plants_phrase(members)}; {at}. {_hatching(members)} Dots: "
        "each line at its gain crossovers, and from there the distance to the nearest of -180 deg and of whole turns "
        "from it: the smallest is its phase margin. Squares: |L| at its lowest phase crossover, and from "
        "there the distance to 0 dB. A dot may not lie in a hatched part, its line may pass there. A "
        "cross marks what has to be met exactly."
    )
    return Picture(title, said, draw, TWO_PANELS)


def nyquist(members: Members) -> Picture:
    """L in the complex plane, with the circle around -1 that no plant enters and the forbidden discs."""
    near, loops = members.near_unit_gain, members.family_loops
    crossings, turned = gain_crossovers(members.named_loops), members.gains_at_phase_crossovers
    named = np.exp(near.named_log_loop)
    grey = np.exp(near.log_loop(loops.take(np.arange(0, len(loops), max(1, len(loops) // _GREY)))))
    stability = members.documents.design["stability"] or {}
    # for an unstable family the value is that of the unstable plant
    peak_db = stability.get("peak_sensitivity_db") if stability.get("stable") else None
    radius = None if peak_db is None else 10.0 ** (-peak_db / 20.0)

    def draw(figure: Figure) -> None:
        from matplotlib.patches import Circle

        axes = figure.subplots()
        for row in grey:
            axes.plot(row.real, row.imag, color="0.75", linewidth=0.6)
        for k, row in enumerate(named):
            colour, dashes = STYLES[k]
            axes.plot(row.real, row.imag, color=colour, linestyle=dashes, label=members.named[k].label)
        axes.add_patch(Circle((0.0, 0.0), 1.0, fill=False, linewidth=0.6, linestyle=":"))
        if radius is not None:
            axes.add_patch(Circle((-1.0, 0.0), radius, fill=False, linestyle=":", edgecolor="0.3", linewidth=1.0))
        forbid_discs(axes, members.documents.spec.requirements)
        forbid_arcs(axes, members.documents.spec.requirements)
        for row, phase in zip(crossings.row, crossings.phase_rad, strict=True):
            axes.plot([math.cos(phase)], [math.sin(phase)], "o", color=STYLES[row][0], markersize=5, zorder=4)
        for row, _, size in turned:
            axes.plot([-size], [0.0], "s", color=STYLES[row][0], markersize=4, zorder=4)
        axes.plot([-1.0], [0.0], "k+", markersize=9)
        axes.set_xlim(*_NYQUIST_VIEW[:2])
        axes.set_ylim(*_NYQUIST_VIEW[2:])
        axes.set_aspect("equal")
        label_axes(axes, "Im L", "Re L")
        legend_below(figure, axes)

    kept = " The loop is not shown to be stable for every plant." if peak_db is None else (
        f" The largest |S| that the check found is {number(peak_db)} dB: no plant that it looked at comes closer to -1 "
        f"than {number(radius or 0.0)}, the dotted circle around it."
    )  # fmt: skip
    title = f"{members.documents.spec.name}: Nyquist, the loop L = C P"
    requirements = members.documents.spec.requirements
    asked = "; hatched: where |S| would be above its limit at any frequency" if sensitivity_discs(requirements) else ""
    if any(r.quantity == "phase_margin_deg" and r.lower > 0.0 for r in requirements):
        asked += "; thick or crossed, on the unit circle: where a phase margin would be missed, or is to be met exactly"
    said = (
        "The loop in the complex plane near -1 (marked +), positive frequencies; grey: other plants; dots: gain "
        f"crossovers; squares: lowest phase crossovers{asked}.{kept}"
    )
    return Picture(title, said, draw, (6.4, 6.4))


def sensitivities(members: Members) -> Picture:
    """|S|, |T| and |C S| with their bounds, and |P S| where the spec asks for it."""
    requirements, words = members.documents.spec.requirements, _panels(members)
    family, named = decibels(members, members.family_log_loop), decibels(members, members.named_log_loop)

    def draw(figure: Figure) -> None:
        every = figure.subplots(len(words), 1, sharex=True)
        for axes, word in zip(every, words, strict=True):
            _plot_family(axes, members, family[word], named[word])
            fit_with_limits(axes, [family[word], named[word]], requirements, word)
            label_axes(axes, f"|{_WORDS[word]}|, dB")
        every[-1].set_xlabel("ω, rad/s")
        legend_below(figure, every[0])

    peaks = ", ".join(f"{_WORDS[word]} {round(float(family[word].max()), 2) + 0.0:.2f} dB" for word in words)
    title = f"{members.documents.spec.name}: sensitivities"
    others = ", control sensitivity C S and load sensitivity P S" if _LOAD in words else " and control sensitivity C S"
    said = (
        f"Sensitivity S = 1/(1 + L), complementary sensitivity T = L/(1 + L){others} over "
        f"frequency, {_plants_phrase(members)}. Largest values drawn: {peaks}. {_hatching(members)}"
    )
    return Picture(title, said, draw, (WIDE, 6.8 if len(words) == 3 else 8.6))


def margins_along(members: Members) -> Picture | None:
    """Phase and gain margin over the first uncertain number, with gaps where the loop is unstable; None without one."""
    names = members.numbers
    if not names:
        return None
    values = members.parameter_values
    try:
        found = margin_curves(members)
    except DomainError:
        return None  # more crossings than can be listed
    requirements, nominal = members.documents.spec.requirements, float(members.documents.spec.plant.nominal_point[0])

    def draw(figure: Figure) -> None:
        for axes, (word, curve) in zip(figure.subplots(2, 1, sharex=True), found.items(), strict=True):
            bounds = [limit for r in requirements if r.quantity == word for limit in r.limits]
            if np.any(np.isfinite(curve)):
                axes.plot(values, np.where(np.isfinite(curve), curve, np.nan), color=STYLES[0][0], marker=".")
            else:
                axes.text(0.5, 0.7, without_a_curve(curve), transform=axes.transAxes, ha="center")
            axes.set_xlim(values[0], values[-1])
            fit_y_limits(axes, [curve, np.array(bounds or [0.0])], math.inf)
            forbid_along(axes, requirements, word, nominal)
            axes.axvline(nominal, color="black", linewidth=0.6, linestyle=":")
            label_axes(axes, word.replace("_deg", ", deg").replace("_db", ", dB").replace("_", " "))
            axes.set_xlabel(axis_label(names[0]) if word == "gain_margin_db" else "")

    others = "" if len(names) == 1 else "; the other uncertain numbers are nominal"
    called = name_and_unit(names[0])[0]
    title = f"{members.documents.spec.name}: margins against the {called}"
    told = f"{_margin_ranges(found)}.{_unstable_note(found)}"
    said = f"Phase margin and gain margin against the {called}{others}: {told} Dotted: nominal. {_HATCHED}."
    return Picture(title, said, draw, (WIDE, 4.6))


def margin_curves(members: Members) -> dict[str, Array]:
    """Phase and gain margin at `parameter_values`, by quantity, shape (n,) each; nan where the loop is unstable.

    Raises:
        DomainError: more crossings than can be listed.
    """
    loops = members.loops_at(members.points_along(members.parameter_values))
    return {word: evaluate(loops, _measure_of(word))[0] for word in ("phase_margin_deg", "gain_margin_db")}


_LOAD = "load_sensitivity_db"
#: a panel's quantity -> its letters
_WORDS = {"sensitivity_db": "S", "complementary_sensitivity_db": "T", "control_sensitivity_db": "C S", _LOAD: "P S"}


def _panels(members: Members) -> list[str]:
    """The quantities that are drawn; the load's where a requirement or the objective is about it."""
    spec = members.documents.spec
    asked = any(r.quantity == _LOAD for r in spec.requirements)
    asked = asked or (spec.objective is not None and spec.objective.quantity == ObjectiveKind.LOAD_SENSITIVITY_PEAK)
    return [word for word in _WORDS if asked or word != _LOAD]


def _measure_of(word: str) -> LoopFunction:
    def read(loops: Loops) -> tuple[Array, Array]:
        measured = QUANTITIES[word].measure(loops, False, 0.0, math.inf)
        return measured.value, measured.omega_rad_s

    return read


def _plants_phrase(members: Members) -> str:
    """Which plants a figure shows, in words."""
    if members.documents.spec.plant.has_one_plant:
        return "of the one plant there is"
    return f"{len(members.family_loops)} plants of the family as a band, the nominal plant and the worst ones as lines"


def _is_exact(r: Requirement, quantity: str) -> bool:
    return r.quantity == quantity and r.relation is Relation.EQUALS


def _hatching(members: Members) -> str:
    """What hatching means; also that of requirements on the nominal plant alone."""
    spec = members.documents.spec
    alone = any(r.scope is Scope.NOMINAL and r.relation is not Relation.EQUALS for r in spec.requirements)
    of_nominal = (
        "; slanted the other way: for the nominal plant alone" if alone and not spec.plant.has_one_plant else ""
    )
    return f"{_HATCHED}{of_nominal}."


def _margin_ranges(found: dict[str, Array]) -> str:
    parts = []
    for word, curve in found.items():
        finite = curve[np.isfinite(curve)]
        name, unit = word.rsplit("_", 1)
        if len(finite):
            endless = int(np.isinf(curve).sum())
            some = f" (infinite for {endless} of {len(curve)} plants)" if endless else ""
            parts.append(_range_phrase(name.replace("_", " "), (float(finite.min()), float(finite.max())), unit) + some)
        else:
            parts.append(f"{name.replace('_', ' ')} {'none' if np.all(np.isnan(curve)) else 'infinite'}")
    return ", ".join(parts)


def without_a_curve(margins: Array) -> str:
    """The text in place of a curve of margins none of which is finite; nan is that of an unstable loop."""
    unstable = np.isnan(margins)
    if np.all(unstable):
        return "every loop is unstable"
    return "infinite for every stable plant" if np.any(unstable) else "infinite for every plant"


def _unstable_note(found: dict[str, Array]) -> str:
    """The sentence about unstable plants; empty without any."""
    curve = found["gain_margin_db"]
    many, unstable = len(curve), int(np.isnan(curve).sum())
    if not unstable:
        return ""
    return (
        f" Of the {many} plants along the curve {unstable} {agreeing(unstable, 'leaves', 'leave')} an unstable loop, "
        "which has no margins: a gap there."
    )


def _range_phrase(what: str, ends: tuple[float, float], unit: str) -> str:
    unit = {"db": "dB"}.get(unit, unit)
    low, high = (number(end, 4) for end in ends)
    return f"{what} from {low} to {high} {unit}" if low != high else f"{what} {low} {unit}"


def _plot_family(axes: Axes, members: Members, family: Array, named: Array) -> None:
    """Plot the band of the family and a line for each named plant."""
    log_axes(axes)
    axes.set_xlim(float(members.omega[0]), float(members.omega[-1]))
    if len(family) > 1:
        # a worst plant may lie between those of the grid
        family = np.concatenate([family, named])
        axes.fill_between(members.omega, family.min(axis=0), family.max(axis=0), label="family", **_ENVELOPE)
    for k, row in enumerate(named):
        colour, dashes = STYLES[k]
        axes.plot(members.omega, row, color=colour, linestyle=dashes, label=members.named[k].label)


def decibels(members: Members, log_loop: Complex) -> dict[str, Array]:
    """|S|, |T|, |C S| and |P S| in dB by their quantities' names, shape (m, n) each."""
    with np.errstate(over="ignore", divide="ignore"):
        # 1 + L from ln L: where L overflows, ln|1 + L| is ln|L|
        large = log_loop.real > 300.0
        returned = np.where(large, log_loop.real, np.log(np.abs(1.0 + np.exp(np.where(large, 0.0, log_loop)))))
    s = -_DB * returned
    loop, controller = _DB * log_loop.real, _DB * np.log(np.abs(members.controller))
    return dict(zip(_WORDS, (s, s + loop, s + controller, s + loop - controller), strict=True))


def _crossovers(members: Members) -> tuple[float, float] | None:
    """Lowest and highest gain crossover of the grid's plants, rad/s."""
    omega = gain_crossovers(members.family_loops).omega_rad_s
    return (float(omega.min()), float(omega.max())) if len(omega) else None
