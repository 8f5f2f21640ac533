"""Figures of measured responses: what is drawn, against the curves."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from cases.measured import TWO, csv, text_of
from matplotlib.figure import Figure

from fopi_tune.pipeline.tune import tune
from fopi_tune.report.documents import documents_of_run
from fopi_tune.report.figures.measured import (
    MeasuredMembers,
    measured_bode,
    measured_members,
    measured_nyquist,
    measured_sensitivities,
)
from fopi_tune.report.figures.picture import Picture
from fopi_tune.results.design import Run
from fopi_tune.spec.load import load_spec


@pytest.fixture(scope="module")
def members(tmp_path_factory: pytest.TempPathFactory) -> MeasuredMembers:
    folder: Path = tmp_path_factory.mktemp("measured")
    (folder / "f.csv").write_bytes(csv(TWO, 0.01, 100.0, 61, 0.01))
    told = "{model: frequency_response, file: f.csv, unstable_poles: 0}"
    asked = "[{phase_margin_deg: {at_least: 50}}, {sensitivity_db: {at_most: 5}}]"
    (folder / "s.yaml").write_text(text_of(told, asked, "{maximize: ki}"))
    found = measured_members(documents_of_run(Run(tune(load_spec(folder / "s.yaml")), None)))
    assert found is not None
    return found


def _drawn(picture: Picture) -> Figure:
    figure = Figure(figsize=picture.size_inches)
    picture.draw(figure)
    return figure


def test_a_bode_plot_has_the_measured_points_on_the_line(members: MeasuredMembers) -> None:
    gain, phase = _drawn(measured_bode(members)).axes
    curve = members.family.members[0].table
    response = curve.log_at(curve.u) + np.log(members.gains(1j * curve.omega_rad_s))
    dots = {line.get_label(): line for line in gain.get_lines()}["measured"]
    np.testing.assert_allclose(np.asarray(dots.get_xdata(), dtype=float), curve.omega_rad_s, rtol=1e-9)
    np.testing.assert_allclose(
        np.asarray(dots.get_ydata(), dtype=float), response.real * 20.0 / np.log(10.0), atol=1e-9
    )
    turned = {line.get_label(): line for line in phase.get_lines()}["measured"]
    off = np.asarray(turned.get_ydata(), dtype=float) - np.degrees(response.imag)
    np.testing.assert_allclose(np.remainder(off + 180.0, 360.0) - 180.0, 0.0, atol=1e-6)


def test_every_figure_says_what_is_drawn(members: MeasuredMembers) -> None:
    for make in (measured_bode, measured_nyquist, measured_sensitivities):
        picture = make(members)
        assert "the band that 8 more members fill; dots are the measured frequencies" in picture.description
        assert _drawn(picture).axes


def test_sensitivities_stay_below_the_drawn_bound(members: MeasuredMembers) -> None:
    first = _drawn(measured_sensitivities(members)).axes[0]
    line = {line.get_label(): line for line in first.get_lines()}["nominal"]
    assert np.max(np.asarray(line.get_ydata(), dtype=float)) <= 5.0 + 1e-6
