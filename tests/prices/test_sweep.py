"""The sweep of one limit: against closed forms and scans, the check, and what mathematics says of its shape."""

from __future__ import annotations

import csv
import io
import json
import re
from dataclasses import replace
from functools import cache
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from cases.project import CONTINUOUS
from typer.testing import CliRunner

import fopi_tune as ft
from fopi_tune.cli import app
from fopi_tune.prices import PointStatus, Tradeoff, movable_limit, movable_limits
from fopi_tune.prices.prober import Probe, Prober
from fopi_tune.prices.sweep import monotone
from fopi_tune.proof import reassess, verify
from fopi_tune.report import tradeoff_svg, tradeoff_text
from fopi_tune.spec.model import GainRange

LAG = "{model: lag, static_gain: 1.0, time_constant_s: 1.0, dead_time_s: 0.2}"


def spec_of(*requirements: str, objective: str = "", controller: str | None = None, extra: str = "") -> ft.DesignSpec:
    box = controller or "{kp: {min: 0, max: 10}, ki: {min: 0, max: 10}, alpha: {min: 0.3, max: 1.5}}"
    lines = ["schema: 1", "name: t", f"plant: {LAG}", f"controller: {box}", "requirements:"]
    lines += [f"  - {{{requirement}}}" for requirement in requirements]
    lines += [f"objective: {{{objective}}}"] if objective else []
    return ft.parse_spec("\n".join([*lines, *([extra] if extra else [])]) + "\n")


@cache
def brake() -> Tradeoff:
    return ft.tradeoff(CONTINUOUS / "brake.yaml", 5, points=12)


@cache
def brake_scan() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Over a dense scan of alpha: worst |S| up to 0.02 rad/s, dB; spread and smallest of the phase margin, deg.

    Crossover 0.3 rad/s and margin 90 deg of the nominal plant give kp and ki (PAPER's closed form); only gains inside
    their box are kept.  Every number here is a scan's or a bisection's: no solver, and nothing of the package.
    """
    alpha = np.linspace(0.3, 1.5, 6001)
    x = np.exp(-0.5j * np.pi) * (1.0 + 1j * 0.3 * 2.25)
    ki = -x.imag * 0.3**alpha / np.sin(0.5 * np.pi * alpha)
    kp = x.real - ki * 0.3**-alpha * np.cos(0.5 * np.pi * alpha)
    inside = (kp >= 0) & (ki >= 0)
    alpha, kp, ki = (v[inside][:, None] for v in (alpha, kp, ki))
    tau = np.linspace(1.6, 3.1, 7)[None, :]

    def loop(omega: np.ndarray) -> np.ndarray:
        return (kp + ki * (1j * omega) ** -alpha) / (1.0 + 1j * omega * tau)

    low, high = np.full((len(kp), 7), 1e-3), np.full((len(kp), 7), 10.0)
    for _ in range(60):
        middle = np.sqrt(low * high)
        above = np.abs(loop(middle)) > 1.0
        low, high = np.where(above, middle, low), np.where(above, high, middle)
    # below 180 deg of lag: no unwrapping
    margin = 180.0 + np.degrees(np.angle(loop(low)))
    responses = [loop(np.full_like(low, omega)) for omega in np.geomspace(1e-4, 0.02, 12)]
    worst = np.max([-20.0 * np.log10(np.abs(1.0 + values)).min(axis=1) for values in responses], axis=0)
    return worst, np.abs(margin - 90.0).max(axis=1), margin.min(axis=1)


def test_the_curve_of_the_brake_is_that_of_a_scan_over_alpha() -> None:
    worst, spread, _ = brake_scan()
    assert len(brake().met) == 12
    for point in brake().points:
        reference = spread[worst <= point.limit].min()
        # a step of alpha changes the spread by 2e-3 deg at the most: the scan can only be that much worse
        assert point.objective == pytest.approx(reference, abs=2e-3)
        assert point.objective is not None
        assert point.objective <= reference + 1e-5


def test_the_infeasible_end_of_the_brake_is_the_scans() -> None:
    worst, _, margin = brake_scan()
    last = worst[margin >= 80.0].min()
    (end,) = brake().ends
    assert end.infeasible is not None
    assert end.way == -1
    width = brake().points[-1].limit - brake().points[0].limit
    assert 0.0 < end.feasible - end.infeasible <= 1e-3 * width
    # a step of alpha changes the worst |S| by 4e-3 dB
    assert end.infeasible - 1e-6 <= last <= end.feasible + 5e-3


@pytest.mark.long
def test_a_sweep_over_one_free_gain_is_a_scan_over_it() -> None:
    spec = spec_of("sensitivity_db: {at_most: 3}", objective="maximize: ki",
                   controller="{kp: 0.8, ki: {min: 0, max: 10}, alpha: 1.2}")  # fmt: skip
    result = ft.tradeoff(spec, "sensitivity_db", start=2.0, stop=5.0, points=7)
    ki, omega = np.linspace(0.0, 10.0, 2001)[1:, None], np.geomspace(0.05, 50.0, 1500)[None, :]
    loop = (0.8 + ki * (1j * omega) ** -1.2) * np.exp(-0.2j * omega) / (1.0 + 1j * omega)
    peak = -20.0 * np.log10(np.abs(1.0 + loop)).min(axis=1)
    first_bad = [int(np.argmax(peak > point.limit)) for point in result.points]
    for point, k in zip(result.points, first_bad, strict=True):
        # the scan's step of ki is 5e-3; its frequencies see the peak to 1e-4 dB, 1e-4 of ki
        assert ki[k - 1, 0] - 2e-4 <= (point.objective or 0.0) <= ki[k, 0] + 2e-4


def test_relaxing_never_makes_the_objective_worse() -> None:
    objectives = [point.objective for point in brake().met]
    assert all(a >= b for a, b in pairwise(objectives) if a is not None and b is not None)


def test_every_point_passes_the_check_with_its_own_limit() -> None:
    result = brake()
    for point in result.points:
        assert point.gains is not None
        found = verify(result.knob.at(point.limit), point.gains)
        assert found.all_met
        assert found.objective == pytest.approx(point.objective, rel=1e-12)
        assert point.largest_score == pytest.approx(max(r.score or 0.0 for r in found.requirements), abs=1e-9)


def test_a_point_that_is_worse_than_a_tighter_one_is_solved_again() -> None:
    result = brake()
    movable = result.knob
    assert result.own.gains is not None
    prober = Prober.of(movable, result.own.gains)
    tight = Probe(-21.0, PointStatus.MET, _found(prober, -21.0))
    poor = Probe(-20.0, PointStatus.MET, reassess(movable.at(-20.0), _found(prober, -22.0)))
    assert poor.found is not None
    assert poor.found.all_met
    better = monotone(prober, [poor, replace(tight)], tight)
    assert [probe.limit for probe in better] == [-21.0, -20.0]
    assert better[1].objective == pytest.approx(result.own.objective, rel=1e-6)
    lost = monotone(prober, [Probe(-20.0, PointStatus.INFEASIBLE, None)], tight)
    assert lost[0].is_met


def _found(prober: Prober, limit: float) -> ft.Verification:
    probe = prober.from_neighbour(limit, prober.base)
    assert probe is not None
    assert probe.is_met
    assert probe.found is not None
    return probe.found


def test_the_check_of_the_same_gains_against_other_limits_needs_no_measuring() -> None:
    for name, number, limit in (("brake", "3", 85.0), ("brake_delay", "3", 2.0), ("throttle", "1", 0.5)):
        spec = ft.load_spec(CONTINUOUS / f"{name}.yaml")
        gains = ft.tune(spec, proof=False).gains
        assert gains is not None
        for asked in (spec, replace(spec, objective=None)):
            movable = movable_limit(asked, number)
            found = reassess(movable.at(limit), verify(asked, gains))
            assert found == verify(movable.at(limit), gains)
            assert not found.all_met


def test_a_point_that_the_check_refuses_is_marked_and_not_drawn(monkeypatch: pytest.MonkeyPatch) -> None:
    from fopi_tune.prices import prober

    def doubtful(spec: ft.DesignSpec, gains: ft.FoPi, **options: Any) -> ft.Verification:
        found = verify(spec, gains, **options)
        if spec.requirements[4].limits[0] > -21.0 or gains == brake().own.gains:
            return found
        return replace(found, stability=replace(found.stability, stable=False))

    monkeypatch.setattr(prober, "verify", doubtful)
    result = ft.tradeoff(CONTINUOUS / "brake.yaml", 5, start=-22.0, stop=-18.0, points=3)
    assert [p.status for p in result.points] == [PointStatus.REFUSED, PointStatus.MET, PointStatus.MET]
    assert result.status == "failed"
    assert result.points[0].objective is None
    assert len(result.met) == 2
    assert "refused" in tradeoff_text(result).plain
    assert "the check refused the gains at -22" in tradeoff_svg(result)


@pytest.mark.long
def test_an_equality_is_swept_both_ways() -> None:
    result = ft.tradeoff(CONTINUOUS / "pi_baseline.yaml", 1, start=0.28, stop=0.32, points=3)
    for point in result.points:
        x = np.exp(-0.5j * np.pi) * (1.0 + 2.25j * point.limit)
        assert point.gains is not None
        # the crossover is met to the check's 1e-6
        assert point.gains.ki == pytest.approx(-x.imag * point.limit, rel=1e-5)
        assert point.gains.kp == pytest.approx(x.real, rel=1e-5)
    assert {end.way for end in result.ends} == {-1, 1}


@pytest.mark.long
def test_without_an_objective_the_depth_is_swept() -> None:
    spec = spec_of(
        "phase_margin_deg: {at_least: 50}", "sensitivity_db: {at_most: 4}", "crossover_rad_s: {at_least: 1.0}"
    )
    result = ft.tradeoff(spec, 3, start=0.8, stop=1.2, points=3)
    depths = [ft.tune(result.knob.at(point.limit), proof=False).objective for point in result.points]
    assert [point.objective for point in result.points] == pytest.approx(depths, rel=1e-5)


def test_a_requirement_is_named_by_number_quantity_or_end() -> None:
    spec = spec_of(
        "phase_margin_deg: {between: [50, 60]}",
        "sensitivity_db: {at_most: 4}",
        "sensitivity_db: {at_most: 2}, to_rad_s: 1",
    )
    assert [movable.name for movable in movable_limits(spec)] == ["1.lower", "1.upper", "2", "3"]
    upper = movable_limit(spec, "phase_margin_deg.upper")
    assert (upper.limit, upper.tightens, upper.number) == (60.0, -1, 1)
    assert [r.relation.value for r in upper.at(58.0).requirements] == ["at_most", "at_most", "at_most", "at_least"]
    assert movable_limit(spec, "2").requirement == spec.requirements[1]
    for words in ("sensitivity_db", "1", "phase_margin_deg"):
        with pytest.raises(ft.DomainError, match="choose by number"):
            movable_limit(spec, words)
    for words in ("9", "gain_margin_db", "", "2.upper"):
        with pytest.raises(ft.DomainError, match="there is no requirement"):
            movable_limit(spec, words)
    with pytest.raises(ft.DomainError, match="up to 1 rad/s"):
        movable_limit(spec, "sensitivity_db")


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"start": -10.0, "stop": -30.0}, "must be smaller"),
        ({"points": 1}, "between 2 and"),
        ({"start": float("nan")}, "no finite number"),
        ({"requirement": 1, "start": -1.0}, "greater than 0"),
    ],
)
def test_a_range_that_makes_no_sense_is_refused(options: dict, said: str) -> None:
    with pytest.raises(ft.DomainError, match=said):
        ft.tradeoff(CONTINUOUS / "throttle.yaml", **({"requirement": 3} | options))


def test_there_is_nothing_to_sweep_without_free_gains_or_a_design_or_on_samples() -> None:
    fixed = spec_of("sensitivity_db: {at_most: 4}", controller="{kp: 1, ki: 1, alpha: 1}")
    with pytest.raises(ft.DomainError, match="the gains stay"):
        ft.tradeoff(fixed, 1)
    spec = ft.load_spec(CONTINUOUS / "brake.yaml")
    # crossover and margin need alpha >= 0.622
    infeasible = replace(spec, controller=replace(spec.controller, alpha=GainRange(0.45, 0.45)))
    with pytest.raises(ft.DomainError, match="infeasible"):
        ft.tradeoff(infeasible, 1)


def test_a_sweep_on_samples_is_of_the_loop_on_samples() -> None:
    spec = ft.load_spec(CONTINUOUS / "throttle.yaml")
    assert spec.digital is not None
    sampled = replace(spec, digital=replace(spec.digital, design="sampled"))
    curve = ft.tradeoff(sampled, 3, start=-22.0, stop=-18.0, points=3)
    own = ft.tune(sampled, proof=False)
    assert [point.status.value for point in curve.points] == ["met"] * 3
    assert curve.points[1].objective == pytest.approx(own.objective, rel=1e-6)
    objectives = [point.objective or 0.0 for point in curve.points]
    assert objectives == sorted(objectives)
    assert objectives[0] < objectives[-1]


def test_the_command_writes_json_csv_and_figure(tmp_path: Path) -> None:
    words = ["tune", str(CONTINUOUS / "throttle.yaml"), "--tradeoff", "sensitivity_db", "--from", "-40", "--to", "-15"]
    done = CliRunner().invoke(app, [*words, "--points", "6", "--out", str(tmp_path)])
    assert done.exit_code == 0, done.output
    assert max(map(len, done.stdout.splitlines())) <= 80
    assert {path.name for path in tmp_path.iterdir()} == {"tradeoff.json", "tradeoff.csv", "tradeoff.svg"}
    document = json.loads((tmp_path / "tradeoff.json").read_text(), parse_constant=lambda word: pytest.fail(word))
    statuses = [point["status"] for point in document["points"]]
    assert statuses == ["infeasible", *["met"] * 5]
    rows = list(csv.DictReader(io.StringIO((tmp_path / "tradeoff.csv").read_text())))
    assert [row["status"] for row in rows] == statuses
    assert float(rows[-1]["objective"]) == document["points"][-1]["objective"]
    assert (rows[0]["objective"], rows[0]["kp"]) == ("", "")
    assert document["ends"][0]["first_infeasible"] < document["ends"][0]["last_feasible"]
    svg = (tmp_path / "tradeoff.svg").read_text()
    assert svg.count("<title") == 1
    assert 'role="img"' in svg
    assert "what lies below it is taken for infeasible" in " ".join(svg.split())
    assert ">infeasible<" in svg
    assert "the spec's limit" in svg


@pytest.mark.long
def test_equal_sweeps_give_equal_files() -> None:
    result = brake()
    assert tradeoff_svg(result) == tradeoff_svg(result)
    assert ft.tradeoff(CONTINUOUS / "brake.yaml", 5, points=12).to_dict() == result.to_dict()


@pytest.mark.parametrize(
    ("arguments", "words", "python", "command"),
    [
        ({"points": 0}, ["--points", "0"], "`points` = 0 must lie between 2", "--points = 0 must lie between 2 and"),
        ({"start": -10.0, "stop": -20.0}, ["--from", "-10", "--to", "-20"],
         "`start` = -10 must be smaller than `stop` = -20", "--from = -10 must be smaller than --to = -20"),
    ],
)  # fmt: skip
def test_a_range_without_sense_is_told_in_the_words_of_who_asks(
    arguments: dict[str, Any], words: list[str], python: str, command: str
) -> None:
    source = CONTINUOUS / "throttle.yaml"
    with pytest.raises(ft.DomainError, match=re.escape(python)):
        ft.tradeoff(source, "sensitivity_db", **arguments)
    done = CliRunner().invoke(app, ["tune", str(source), "--tradeoff", "sensitivity_db", *words])
    assert done.exit_code == 2
    assert command in done.stderr


@pytest.mark.parametrize(
    "words",
    [["--points", "3"], ["--from", "1"], ["--tradeoff", "3", "--prices"], ["--tradeoff", "3", "second.yaml"]],
)
def test_options_that_do_not_go_together_are_refused(words: list[str]) -> None:
    done = CliRunner().invoke(app, ["tune", str(CONTINUOUS / "throttle.yaml"), *words])
    assert done.exit_code == 2
    assert done.stdout == ""
