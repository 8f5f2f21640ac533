"""The table of measures against the simulations it is made from."""

from __future__ import annotations

import math

import numpy as np
from cases.plants import PUBLISHED_BRAKE
from cases.project import ROOT

import fopi_tune as ft
from fopi_tune.pipeline.responses import family_responses
from fopi_tune.report.figures.scenarios import DrivenLoops
from fopi_tune.report.response_rows import driven_plants, measure_ranges
from fopi_tune.spec import load_spec

TAUS = (2.25, 1.6, 3.1)


def loops() -> DrivenLoops:
    spec = load_spec(ROOT / "specs/brake.yaml")
    responses = family_responses(spec, PUBLISHED_BRAKE, np.array(TAUS)[:, None])
    return DrivenLoops(spec.name, spec.plant, ("nominal",), responses, ("km/h", ""))


def test_a_row_has_the_nominal_value_the_range_and_the_worst_plant() -> None:
    spec = load_spec(ROOT / "specs/brake.yaml")
    alone = [ft.simulate(spec, PUBLISHED_BRAKE, plant={"time_constant_s": tau}).driven[0].measures for tau in TAUS]
    rows = {row.what: row for row in measure_ranges(loops())}
    for what, name in (("settling time, s", "settling_time_s"), ("peak control, control unit", "peak_control"),
                       ("∫|r − y| dt, km/h s", "iae"), ("acceleration, m/s²", "acceleration_m_s2")):  # fmt: skip
        values = [each[name] for each in alone]
        shown = [f"{value:.4g}" if math.isfinite(value) else "never" for value in (values[0], min(values), max(values))]
        assert [rows[what].nominal, rows[what].least, rows[what].largest] == shown
        if len(set(values)) > 1:
            worst = TAUS[int(np.argmax(np.abs(values)))]
            assert f"{worst:.4g}" in rows[what].worst
    assert not any("switch" in what for what in rows)


def test_a_measure_that_all_plants_share_names_none() -> None:
    row = next(row for row in measure_ranges(loops()) if row.what == "saturation time, s")
    assert (row.nominal, row.least, row.largest, row.worst) == ("0", "0", "0", "")


def test_the_number_of_plants_is_told() -> None:
    assert driven_plants(loops()) == "3"
