"""What requirements forbid in the figures: distances of the phase to -1, on both sides and on every turn."""

from __future__ import annotations

import math

import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from fopi_tune.core.crossings import Crossings
from fopi_tune.report.figures.forbidden_regions import (
    critical_phases,
    forbid_arcs,
    forbid_phases,
    mark_critical_phases,
)
from fopi_tune.spec.model import Relation, Requirement, Scope

CROSSOVERS = (0.1, 1.0)
NONE = (np.zeros(0), np.zeros(0))


def axes_of(low: float, high: float) -> Axes:
    axes = Figure().subplots()
    axes.set_xlim(0.01, 10.0)
    axes.set_ylim(low, high)
    return axes


def hatched(axes: Axes) -> list[tuple[float, float]]:
    """The ranges of phases that are hatched."""
    found = [patch for patch in axes.patches if isinstance(patch, Rectangle)]
    return sorted((round(p.get_y(), 9), round(p.get_y() + p.get_height(), 9)) for p in found)


def crosses(axes: Axes) -> list[tuple[float, float]]:
    found = [line for line in axes.lines if line.get_marker() == "x"]
    return [(float(np.ravel(line.get_xdata())[0]), float(np.ravel(line.get_ydata())[0])) for line in found]


def margin(relation: Relation, *limits: float, scope: Scope = Scope.FAMILY) -> Requirement:
    return Requirement("phase_margin_deg", relation, limits, scope)


def test_the_nearest_phase_of_minus_one_is_at_the_angle_that_margins_are() -> None:
    phase = np.random.default_rng(1).uniform(-2000.0, 400.0, 1000)
    critical = critical_phases(phase)
    np.testing.assert_allclose(np.mod(critical, 360.0), 180.0, atol=1e-9)
    one = np.ones(len(phase))
    angle = Crossings(np.zeros(len(phase), dtype=np.intp), one, one, one, np.radians(phase), one)
    np.testing.assert_allclose(phase - critical, np.degrees(angle.angle_from_minus_one_rad), atol=1e-9)
    assert critical_phases(np.array([-90.0, -180.0, -200.0, -370.0, 30.0])).tolist() == [-180, -180, -180, -540, 180]


def test_a_phase_margin_forbids_both_sides_of_minus_one_on_every_turn() -> None:
    axes = axes_of(-700.0, 100.0)
    forbid_phases(axes, [margin(Relation.AT_LEAST, 60.0)], CROSSOVERS, NONE)
    # -180 -+ 60, -540 -+ 60, and from 180 - 60 on nothing is seen
    assert hatched(axes) == [(-600.0, -480.0), (-240.0, -120.0)]
    axes = axes_of(-200.0, 170.0)
    forbid_phases(axes, [margin(Relation.AT_LEAST, 60.0)], CROSSOVERS, NONE)
    assert hatched(axes) == [(-200.0, -120.0), (120.0, 170.0)]


def test_an_upper_limit_forbids_what_is_farther_from_minus_one() -> None:
    axes = axes_of(-200.0, 100.0)
    forbid_phases(axes, [margin(Relation.BETWEEN, 40.0, 100.0)], CROSSOVERS, NONE)
    assert hatched(axes) == [(-200.0, -140.0), (-80.0, 80.0)]


@pytest.mark.parametrize(
    ("phase", "height"), [(-95.0, -90.0), (-300.0, -270.0), (-400.0, -450.0), (100.0, 90.0), (-181.0, -270.0)]
)
def test_an_exact_phase_margin_is_marked_on_the_crossovers_own_side(phase: float, height: float) -> None:
    axes = axes_of(-700.0, 200.0)
    nominal = np.array([0.2, 0.5]), np.array([phase, critical_phases(np.array([phase]))[0] + 170.0])
    forbid_phases(axes, [margin(Relation.EQUALS, 90.0, scope=Scope.NOMINAL)], CROSSOVERS, nominal)
    # the crossover that is nearest to -1 sets the margin
    assert crosses(axes) == [(0.2, pytest.approx(height))]


def test_an_exact_phase_margin_without_a_crossover_is_marked_above_minus_180_deg() -> None:
    axes = axes_of(-300.0, 0.0)
    forbid_phases(axes, [margin(Relation.EQUALS, 70.0, scope=Scope.NOMINAL)], CROSSOVERS, NONE)
    assert crosses(axes) == [(1.0, -110.0)]


@pytest.mark.parametrize(
    ("phases", "lines"), [([-90.0, -200.0], [-180.0]), ([-90.0, -500.0], [-540.0, -180.0]), ([40.0], [-180.0, 180.0])]
)
def test_the_phases_of_minus_one_that_margins_are_read_from_are_lines(phases: list[float], lines: list[float]) -> None:
    axes = axes_of(-120.0, -60.0)
    mark_critical_phases(axes, np.array(phases))
    assert sorted(float(np.ravel(line.get_ydata())[0]) for line in axes.lines) == lines
    low, high = axes.get_ylim()
    assert low < lines[0]
    assert high > lines[-1]


def test_a_crossover_after_very_many_turns_does_not_widen_the_axis_without_end() -> None:
    axes = axes_of(-400.0, -60.0)
    mark_critical_phases(axes, np.array([-90.0, -36_000.0]))
    assert axes.get_ylim() == (-960.0, -60.0)


def test_a_phase_margin_forbids_the_arc_of_the_unit_circle_about_minus_one() -> None:
    axes = axes_of(-2.0, 2.0)
    forbid_arcs(axes, [margin(Relation.AT_LEAST, 60.0), Requirement("gain_margin_db", Relation.AT_LEAST, (6.0,))])
    (line,) = axes.lines
    x, y = np.asarray(line.get_xdata()), np.asarray(line.get_ydata())
    np.testing.assert_allclose(np.hypot(x, y), 1.0, rtol=1e-12)
    # |1 + L| <= 2 sin(60/2 deg) = 1 on the arc, with equality at its ends
    distance = np.hypot(1.0 + x, y)
    assert float(distance.max()) == pytest.approx(1.0, rel=1e-12)
    assert float(distance.min()) == pytest.approx(0.0, abs=1e-12)


def test_an_exact_phase_margin_is_marked_on_both_sides_of_minus_one() -> None:
    axes = axes_of(-2.0, 2.0)
    forbid_arcs(axes, [margin(Relation.EQUALS, 60.0, scope=Scope.NOMINAL)])
    (line,) = axes.lines
    assert np.asarray(line.get_xdata()).tolist() == pytest.approx([-0.5, -0.5])
    assert np.asarray(line.get_ydata()).tolist() == pytest.approx([math.sqrt(0.75), -math.sqrt(0.75)])
