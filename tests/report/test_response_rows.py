"""The table of measures against the simulations it is made from."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from cases.plants import PUBLISHED_BRAKE
from cases.project import ROOT

import fopi_tune as ft
from fopi_tune.pipeline.responses import family_responses
from fopi_tune.report.figures.scenarios import DrivenLoops
from fopi_tune.report.response_rows import driven_plants, measure_ranges
from fopi_tune.simulation.measures import measure_values
from fopi_tune.spec import load_spec
from fopi_tune.spec.model import Limit, Relation

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


def test_limits_say_how_many_plants_keep_them() -> None:
    peaks = sorted(float(row.nominal) for row in [each for each in measure_ranges(loops()) if "rise time" in each.what])
    limits = (Limit("rise_time_s", Relation.AT_MOST, peaks[0]), Limit("peak_control", Relation.AT_MOST, 0.0),
              Limit("iae", Relation.AT_LEAST, 0.0), Limit("iae", Relation.AT_MOST, 1.0, "another"))  # fmt: skip
    rows = {row.what.partition(",")[0]: row.judged for row in measure_ranges(replace(loops(), judged=limits))}
    values = measure_values(loops().responses[0].measures, "rise_time_s", "")
    kept = int(np.sum(values <= peaks[0]))
    assert rows["rise time"].startswith("≤")
    assert rows["rise time"].endswith("kept" if kept == 3 else f"kept by {kept} of 3")
    assert rows["peak control"].endswith("kept by 0 of 3")
    assert rows["∫|r − y| dt"].endswith(": kept")
    assert "another" not in rows["∫|r − y| dt"]
    assert rows["overshoot"] == ""


def test_the_number_of_plants_is_told() -> None:
    assert driven_plants(loops()) == "3"
