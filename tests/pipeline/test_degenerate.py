"""Terms of a controller that vanish, and gains at an end of their range."""

from __future__ import annotations

import pytest

import fopi_tune as ft
from fopi_tune.core.controller import FoPi
from fopi_tune.pipeline.degenerate import without_vanished_terms
from fopi_tune.spec import parse_spec
from fopi_tune.spec.model import ControllerSpec, GainRange

BOX = ControllerSpec(GainRange(0.0, 10.0), GainRange(0.0, 10.0), GainRange(0.3, 1.5))


def test_an_integral_is_gone_by_its_size_at_the_crossover() -> None:
    # 1e-5 at 100 rad/s is 1e-7 of kp, at 0.01 rad/s it is 1e-3
    gone = without_vanished_terms(BOX, FoPi(1.0, 1e-5, 1.0), 100.0)
    assert (gone.ki, gone.alpha) == (GainRange(0.0, 0.0), GainRange(1.0, 1.0))
    assert without_vanished_terms(BOX, FoPi(1.0, 1e-5, 1.0), 0.01) is BOX


def test_a_proportional_term_is_gone_in_the_same_way() -> None:
    gone = without_vanished_terms(BOX, FoPi(1e-9, 1.0, 1.0), 0.5)
    assert (gone.kp, gone.ki) == (GainRange(0.0, 0.0), BOX.ki)


@pytest.mark.parametrize("ki", [GainRange(1e-9, 1.0), GainRange(1e-9, 1e-9)])
def test_a_term_that_may_not_be_0_stays(ki: GainRange) -> None:
    box = ControllerSpec(BOX.kp, ki, BOX.alpha)
    assert without_vanished_terms(box, FoPi(1.0, 1e-9, 1.0), 1.0) is box


def test_a_gain_at_the_end_of_its_range_is_said() -> None:
    spec = parse_spec(
        """schema: 1
name: x
plant: {model: lag, static_gain: 1, time_constant_s: 2}
controller: {kp: {min: 0, max: 3}, ki: {min: 0, max: 1}, alpha: 1}
requirements:
  - sensitivity_db: {at_most: 3}
objective: {minimize: iae_disturbance}
"""
    )
    design = ft.tune(spec)
    assert design.status is ft.Status.SOLVED
    assert any(note.startswith("ki is at the upper end of its range, 1") for note in design.notes)
    assert design.to_dict()["notes"] == list(design.notes)
