"""Terms of a controller that vanish, and gains at an end of their range."""

from __future__ import annotations

import pytest

import fopi_tune as ft
from fopi_tune.core.controller import FoPi
from fopi_tune.pipeline.degenerate import without_vanished_terms
from fopi_tune.spec import parse_spec
from fopi_tune.spec.model import ControllerSpec, GainRange

FLAT = """schema: 1
name: flat
plant: {model: lag, static_gain: 1, time_constant_s: 0.1, dead_time_s: 2}
controller: {kp: {min: 0, max: 5}, ki: {min: 0, max: 5}, alpha: 1}
requirements:
  - crossover_rad_s: {equals: 0.3}
  - phase_margin_deg: {at_least: 50}
objective: {maximize: ki}
"""
BOX = ControllerSpec(GainRange(0.0, 10.0), GainRange(0.0, 10.0), GainRange(0.3, 1.5))


def test_an_integral_is_gone_by_its_size_at_the_crossover() -> None:
    # 1e-5 at 100 rad/s is 1e-7 of kp, at 0.01 rad/s it is 1e-3
    gone = without_vanished_terms(BOX, FoPi(1.0, 1e-5, 1.0), 100.0)
    assert (gone.ki, gone.alpha) == (GainRange(0.0, 0.0), GainRange(1.0, 1.0))
    assert without_vanished_terms(BOX, FoPi(1.0, 1e-5, 1.0), 0.01) is BOX


def test_a_proportional_term_is_gone_in_the_same_way() -> None:
    gone = without_vanished_terms(BOX, FoPi(1e-9, 1.0, 1.0), 0.5)
    assert (gone.kp, gone.ki) == (GainRange(0.0, 0.0), BOX.ki)
    # 1e-3 of the integral term is a choice
    assert without_vanished_terms(BOX, FoPi(1e-3, 0.5, 1.0), 0.5) is BOX


def test_a_proportional_term_that_gains_nothing_is_left_out() -> None:
    # |C(j 0.3)|^2 = kp^2 + (ki/0.3)^2 is given: the largest ki is that of kp = 0, near which it is flat
    design = ft.tune(parse_spec(FLAT))
    assert design.status is ft.Status.SOLVED
    assert design.gains is not None
    assert design.gains.kp == 0.0
    # ki = 0.3 |1 + 0.03j|
    assert design.gains.ki == pytest.approx(0.3 * abs(1 + 0.03j), rel=1e-6)
    assert "no proportional action: the best gains have kp = 0" in design.notes


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


@pytest.mark.parametrize(
    ("band", "digital", "said"),
    [
        ("to_rad_s: 100", "digital: {sample_time_s: 0.1, design: sampled}", True),
        ("to_rad_s: 30", "digital: {sample_time_s: 0.1, design: sampled}", False),
        ("from_rad_s: 1", "digital: {sample_time_s: 0.1, design: sampled}", False),
        ("to_rad_s: 100", "digital: {sample_time_s: 0.1}", False),
    ],
)
def test_a_band_of_which_samples_tell_a_part_is_said(band: str, digital: str, said: bool) -> None:
    spec = parse_spec(
        "schema: 1\nname: x\nplant: {model: lag, static_gain: 1, time_constant_s: 2}\n"
        "controller: {kp: 1, ki: 0.5, alpha: 1}\n"
        f"requirements: [{{sensitivity_db: {{at_most: 6}}, {band}}}]\n{digital}\n"
    )
    (note,) = [note for note in ft.tune(spec).notes if "Nyquist" in note] or [None]
    assert (note is not None) == said
    if note is not None:
        assert note.startswith("requirement 1, sensitivity_db: its band reaches to 100 rad/s")
        assert "31.42 rad/s" in note


@pytest.mark.parametrize(
    ("filter_s", "more", "named"),
    [
        (0.09, "", ["derivative_filter_time_constant_s = 0.09 s"]),
        (0.1, "", []),
        (
            0.05,
            ", measurement_filter: {order: 2, time_constant_s: 0.02}",
            ["derivative_filter_time_constant_s = 0.05 s", "measurement_filter.time_constant_s = 0.02 s"],
        ),
    ],
)
def test_a_filter_that_the_discretizer_refuses_is_said_by_a_continuous_design(
    filter_s: float, more: str, named: list[str]
) -> None:
    text = (
        "schema: 1\nname: fast\nplant: {model: lag, static_gain: 1, time_constant_s: 2}\n"
        f"controller: {{structure: pid, kp: 1, ki: 1, kd: 0.3, derivative_filter_time_constant_s: {filter_s}{more}}}\n"
        "requirements: [{sensitivity_db: {at_most: 9}}]\ndigital: {sample_time_s: 0.2}\n"
    )
    design = ft.tune(parse_spec(text), proof=False)
    assert design.gains is not None
    notes = [note for note in design.notes if "is below half the sample time, 0.1 s" in note]
    assert [note.partition(" is below")[0] for note in notes] == named
    if named:
        with pytest.raises(ft.DomainError, match="is below half the sample time"):
            ft.discretize(design.spec, design.gains)
    else:
        assert ft.discretize(design.spec, design.gains) is not None
