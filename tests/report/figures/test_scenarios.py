"""What is drawn of the loop as it runs, against the traces."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from cases.reports import brake_documents
from matplotlib.figure import Figure

from fopi_tune.report.figures.members import members_of
from fopi_tune.report.figures.scenarios import DrivenLoops, driven_loops, shown_samples


@pytest.fixture(scope="module")
def driven() -> DrivenLoops:
    documents = brake_documents()
    return driven_loops(documents, members_of(documents))


def test_the_figure_has_the_traces_of_the_nominal_and_the_worst_plants(driven: DrivenLoops) -> None:
    (response,) = driven.responses
    picture = driven.pictures["scenario_1"](driven)
    assert picture is not None
    figure = Figure()
    picture.draw(figure)
    above, below = figure.axes
    lines = {line.get_label(): line for line in above.get_lines()}
    kept = np.isin(response.traces.time_s, np.asarray(lines["nominal"].get_xdata()))
    for k, label in enumerate(driven.labels):
        np.testing.assert_array_equal(np.asarray(lines[label].get_ydata()), response.traces.output[k][kept])
    controls = [np.asarray(line.get_ydata()) for line in below.get_lines()]
    np.testing.assert_array_equal(controls[0], response.traces.applied[0][kept])
    assert f"{response.traces.output.max():.4g}" in picture.description


def test_plants_at_the_ends_of_the_range_are_driven_once_each(driven: DrivenLoops) -> None:
    (response,) = driven.responses
    taus = response.points[:, 0].tolist()
    assert {1.6, 2.25, 3.1} <= set(taus)
    assert len(set(taus)) == len(taus)
    assert taus[0] == 2.25


def test_extremes_of_long_signals_are_drawn() -> None:
    signal = np.zeros((2, 50_000))
    signal[0, 31_234], signal[1, 49_998] = 5.0, -3.0
    kept = shown_samples(signal)
    assert {0, 31_234, 49_998, 49_999} <= set(kept.tolist())
    assert len(kept) < 1000
    assert np.all(np.diff(kept) > 0)


def test_without_a_digital_controller_the_reason_is_told() -> None:
    documents = replace(brake_documents(), digital=None)
    found = driven_loops(documents, members_of(documents))
    assert found.responses == ()
    assert "no digital controller" in found.why_none
