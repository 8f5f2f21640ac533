"""Figures for the pointer: they have what was drawn, and equal figures have equal JSON."""

from __future__ import annotations

import base64
import gzip
import json
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from matplotlib.figure import Figure
from matplotlib.patches import Circle, Rectangle

from fopi_tune.report.figures.interactive import interactive_json


def drawn() -> Figure:
    figure = Figure(figsize=(6.0, 5.0), layout="constrained")
    above, below = figure.subplots(2, 1, sharex=True)
    x = np.geomspace(0.1, 10.0, 50)
    above.set_xscale("log")
    above.plot(x, np.log(x), "--", color="#0072b2", label="nominal")
    above.fill_between(x, np.log(x) - 1.0, np.log(x) + 1.0, label="family", alpha=0.3)
    above.add_patch(Rectangle((0.1, 1.0), 1.0, 2.0, hatch="////", facecolor="none", edgecolor="0.45"))
    above.axhline(0.0, color="black")
    below.plot([1.0], [0.5], "o", color="#d55e00")
    below.plot(x, 1.0 / x, label="nominal")
    above.set_ylabel("gain, dB")
    below.set_xlabel("ω, rad/s")
    figure.draw_without_rendering()
    return figure


def models(value: Any) -> Iterator[dict[str, Any]]:
    """Every model of a layout."""
    if isinstance(value, dict):
        if value.get("type") == "object":
            yield value
        for each in value.values():
            yield from models(each)
    elif isinstance(value, list):
        for each in value:
            yield from models(each)


def column(model: dict[str, Any], name: str) -> np.ndarray:
    said = dict(model["attributes"]["data"]["entries"]).get(name, [])
    if isinstance(said, list):
        return np.zeros(0)  # of a legend's entry alone, or of a line without an end: no numbers
    return np.frombuffer(gzip.decompress(base64.b64decode(said["array"]["data"])), dtype=said["dtype"])


def test_equal_figures_give_equal_json() -> None:
    assert interactive_json(drawn()) == interactive_json(drawn())


def test_curves_have_the_numbers_that_were_drawn() -> None:
    found = list(models(json.loads(interactive_json(drawn()))))
    sources = [each for each in found if each["name"] == "ColumnDataSource"]
    x = np.geomspace(0.1, 10.0, 50)
    curves = [(column(s, "x"), column(s, "y")) for s in sources if len(column(s, "x")) == 50]
    assert any(np.allclose(h, x, rtol=1e-6) and np.allclose(v, np.log(x), atol=1e-6) for h, v in curves)
    assert any(np.allclose(h, x, rtol=1e-6) and np.allclose(v, 1.0 / x, rtol=1e-6) for h, v in curves)


def test_axes_legend_marks_and_hatching_are_there() -> None:
    found = list(models(json.loads(interactive_json(drawn()))))
    names = [each["name"] for each in found]
    # the panels share the axis of frequencies
    assert names.count("Range1d") == 3
    assert names.count("LogScale") == 2
    assert "HSpan" in names
    labels = {each["attributes"].get("axis_label") for each in found if each["name"].endswith("Axis")}
    assert {"gain, dB", "ω, rad/s"} <= labels
    said = [each["attributes"]["label"]["value"] for each in found if each["name"] == "LegendItem"]
    assert sorted(said) == ["family", "nominal"]
    hatches = [each["attributes"].get("hatch_pattern") for each in found if each["name"] == "Patch"]
    assert "right_diagonal_line" in hatches
    assert any(each["name"] == "Scatter" for each in found)


def test_a_circle_is_round_and_a_plane_keeps_its_angles() -> None:
    figure = Figure(figsize=(5.0, 5.0))
    axes = figure.subplots()
    axes.add_patch(Circle((-1.0, 0.0), 0.5, fill=False))
    axes.set_xlim(-2.0, 1.0)
    axes.set_ylim(-1.5, 1.5)
    axes.set_aspect("equal")
    figure.draw_without_rendering()
    found = list(models(json.loads(interactive_json(figure))))
    (source,) = [each for each in found if each["name"] == "ColumnDataSource"]
    x, y = column(source, "x"), column(source, "y")
    assert len(x) > 20
    np.testing.assert_allclose(np.hypot(x + 1.0, y), 0.5, rtol=2e-2)
    (panel,) = [each for each in found if each["name"] == "Figure"]
    assert panel["attributes"]["aspect_ratio"] == 1.0


def test_a_figure_with_fields_of_colours_or_axes_of_names_stays_a_drawing() -> None:
    figure = Figure()
    field, names = figure.subplots(1, 2)
    field.pcolormesh([[1.0, 2.0], [3.0, 4.0]])
    names.plot([0, 1], [0, 1])
    names.set_xticks([0, 1], ["kp", "ki"])
    figure.draw_without_rendering()
    assert interactive_json(figure) == ""
    figure = Figure()
    figure.subplots().plot([0, 1], [0, 1])
    figure.draw_without_rendering()
    assert interactive_json(figure) != ""
    figure.axes[0].scatter([0.0, 1.0], [1.0, 0.0], c=[1.0, 2.0])
    assert interactive_json(figure) == ""


def test_words_in_the_axes_and_named_lines_without_an_end_are_there() -> None:
    figure = Figure()
    axes = figure.subplots()
    axes.text(0.5, 0.5, "every loop is unstable", transform=axes.transAxes, ha="center")
    axes.axhline(0.25, color="black", label="setpoint")
    axes.axvline(0.75, color="black", label=r"a \$ sign")
    axes.set_yticks([])
    figure.draw_without_rendering()
    found = list(models(json.loads(interactive_json(figure))))
    (label,) = [each["attributes"] for each in found if each["name"] == "Label"]
    assert label["text"] == "every loop is unstable"
    assert (label["x"], label["y"]) == pytest.approx((0.5, 0.5), rel=1e-12)
    said = [each["attributes"]["label"]["value"] for each in found if each["name"] == "LegendItem"]
    assert sorted(said) == ["a $ sign", "setpoint"]
