"""Figures of a system's certificate:  the orbit is that of the loop, and the region is what is proved."""

from __future__ import annotations

from dataclasses import replace

import matplotlib.figure
import numpy as np
import pytest
from cases import switched
from oracles.switched_loop import run

from fopi_tune.report.figures.picture import Picture, svg_of
from fopi_tune.report.figures.switched import orbit_picture, region_picture


def drawn(picture: Picture | None) -> matplotlib.figure.Figure:
    assert picture is not None
    figure = matplotlib.figure.Figure()
    picture.draw(figure)
    return figure


def line(figure: matplotlib.figure.Figure, label: str) -> np.ndarray:
    (found,) = [each for each in figure.axes[0].get_lines() if each.get_label() == label]
    return np.array(found.get_xydata())


def test_the_drawn_orbit_is_followed_by_the_loop() -> None:
    held = switched.certificate("held")
    widest = max(held.cycles, key=lambda each: each.highest - each.lowest)
    points = line(drawn(orbit_picture(held)), "output at the samples")
    period = len(widest.modes)
    assert points[1, 0] == pytest.approx(0.2)
    assert len(points) > 3 * period
    assert points[period:, 1] == pytest.approx(points[:-period, 1])
    model, samples = switched.model("held"), 40_000
    memories = [np.zeros((size, 1)) for size in model.sizes]
    memories[0][0, 0] = 25.0 * 0.1746 / 4.39
    share = np.full((samples, 1), -np.expm1(-0.2 / widest.plants[1]["time_constant_s"]))
    throttle = -np.expm1(-0.2 * 0.1746), 4.39 / 0.1746
    start = np.array([widest.setpoint]), np.array([25.0]), np.zeros(1, dtype=np.int64)
    found = run(model, *start, memories, throttle, (share, 1.0)).y[-period:, 0]
    # the same outputs, from another sample of the period on; what is left of the start is small
    assert np.sort(found) == pytest.approx(np.sort(points[:period, 1]), abs=2e-3)


def test_the_region_is_what_is_proved() -> None:
    reset, held = switched.certificate("reset"), switched.certificate("held")
    (area,) = drawn(region_picture(reset)).axes[0].collections
    corners = np.array(area.get_paths()[0].vertices)
    assert (corners.min(axis=0).tolist(), corners.max(axis=0).tolist()) == ([2.0, 1.6], [22.0, 3.1])
    places = line(drawn(region_picture(held)), "periodic orbit, proved")
    assert places.tolist() == [[each.setpoint, each.plants[1]["time_constant_s"]] for each in held.cycles]


def test_pictures_say_in_words_what_is_seen() -> None:
    held, reset = switched.certificate("held"), switched.certificate("reset")
    orbit, region, settles = orbit_picture(held), region_picture(held), region_picture(reset)
    assert orbit is not None
    assert region is not None
    assert settles is not None
    assert "attracting orbit at setpoint" in orbit.description
    assert f"proved at {len(held.cycles)} places" in region.description
    assert "for every setpoint from 2 to 22" in settles.description


def test_without_a_proof_nothing_is_drawn() -> None:
    reset = replace(switched.certificate("reset"), settling=None)
    assert orbit_picture(reset) is None
    assert region_picture(reset) is None


def test_an_orbit_that_is_none_is_not_drawn() -> None:
    held = switched.certificate("held")
    false = replace(held.cycles[0], setpoint=held.cycles[0].setpoint + 5.0)
    assert orbit_picture(replace(held, cycles=(false,))) is None


def test_without_an_uncertain_plant_the_axis_is_the_setpoint_alone() -> None:
    held = switched.certificate("held")
    throttle, brake = held.model.loops
    exact = replace(brake, plant=replace(brake.plant, parameters=throttle.plant.parameters))
    plain = replace(held, model=replace(held.model, loops=(throttle, exact)))
    assert set(line(drawn(region_picture(plain)), "periodic orbit, proved")[:, 1].tolist()) == {0.5}


def test_names_are_drawn_as_they_are() -> None:
    held = switched.certificate("held")
    odd = r"$\bad$"
    throttle, brake = (replace(loop, name=odd) for loop in held.model.loops)
    named = replace(held, name=odd, model=replace(held.model, loops=(throttle, brake)))
    for make in (orbit_picture, region_picture):
        picture = make(named, odd)
        assert picture is not None
        assert r">setpoint, $\bad$<" in svg_of(picture) or r">output, $\bad$<" in svg_of(picture)
