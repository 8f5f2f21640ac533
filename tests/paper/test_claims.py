"""The paper's study: the whole table against the golden one, its rows against closed forms, its figures."""

from __future__ import annotations

import csv
import io
import math
import re
import struct
from collections.abc import Callable, Iterable, Iterator, Mapping
from functools import cache
from itertools import pairwise
from xml.etree import ElementTree

import numpy as np
import pytest
from cases.plants import PUBLISHED_BRAKE, PUBLISHED_THROTTLE, ROBUST_BRAKE
from cases.project import ROOT
from cases.shipped_designs import design_of
from scipy import integrate, optimize, signal

import fopi_tune as ft
from fopi_tune.core.controller import FoPi
from fopi_tune.digital.discretize import discretize
from fopi_tune.errors import DomainError
from fopi_tune.paper import CLAIMS, FIGURES, PICTURES, Row, Verdict, figure_png, paper_csv, paper_markdown, paper_text
from fopi_tune.paper.claims.brake import fitted_plant
from fopi_tune.paper.claims.filters import published_poles, published_response
from fopi_tune.paper.claims.fopi_vs_pi import absolute_load_error, design_pair, settling_s, uncertain_gain
from fopi_tune.paper.published import BRAKE, FILTERS, THROTTLE, PublishedNumber
from fopi_tune.paper.table import COLUMNS, rounded_count, verdict_of
from fopi_tune.paper.variants import spec
from fopi_tune.report.figures.picture import STYLES, png_of, svg_of
from fopi_tune.spec.model import DigitalSpec

#: the group with designs of scenarios
SLOW = "manoeuvre"
GOLDEN = ROOT / "tests" / "cases" / "golden_paper.csv"
NUMBER = re.compile(r"(?<![\w.^])-?\d+(?:\.\d+)?(?:e-?\d+)?")

Table = Mapping[str, tuple[Row, ...]]


@cache
def group(name: str) -> tuple[Row, ...]:
    return CLAIMS[name]()


class Asked(Mapping[str, tuple[Row, ...]]):
    """The table, of which a group is computed when it is asked for."""

    def __init__(self, names: Iterable[str]) -> None:
        self._names = tuple(names)

    def __getitem__(self, name: str) -> tuple[Row, ...]:
        return group(name)

    def __iter__(self) -> Iterator[str]:
        return iter(self._names)

    def __len__(self) -> int:
        return len(self._names)


@pytest.fixture(scope="module", params=["quick", pytest.param("whole", marks=pytest.mark.long)])
def table(request: pytest.FixtureRequest) -> Table:
    """Every group, or all but the one whose designs take ten seconds."""
    return Asked(name for name in CLAIMS if request.param == "whole" or name != SLOW)


def row_of(table: Table, group: str, words: str) -> Row:
    (found,) = [row for row in table[group] if words in row.claim]
    return found


def numbers_of(text: str) -> list[float]:
    return [float(found) for found in NUMBER.findall(text)]


# ---- the whole table ----


def allowed(number: str, cell: str) -> float:
    """How far a number may be from the golden one.

    Numbers are rounded to what is stable; one on the border between two roundings may take either: a unit of the last
    digit.  Whole numbers are counts, or far from such a border, and exact; "about" counts have two digits.
    """
    if f"about {number} " in cell:
        return 10.0 if len(number) > 2 else 1.0
    digits, _, exponent = number.partition("e")
    places = len(digits.partition(".")[2])
    return 1.001 * 10.0 ** (int(exponent or 0) - places) if places else 0.0


def test_the_whole_table_is_the_golden_one(table: Table) -> None:
    found = list(csv.reader(io.StringIO(paper_csv(table))))
    golden = list(csv.reader(io.StringIO(GOLDEN.read_text(encoding="utf-8"))))
    golden = [golden[0], *(line for line in golden[1:] if line[0] in tuple(table))]
    assert [line[:3] + line[4:5] for line in found] == [line[:3] + line[4:5] for line in golden]
    for one, other in zip(found, golden, strict=True):
        for cell, wanted in zip(one, other, strict=True):
            assert NUMBER.sub("#", cell) == NUMBER.sub("#", wanted)
            for number, known in zip(NUMBER.findall(cell), NUMBER.findall(wanted), strict=True):
                assert abs(float(number) - float(known)) <= allowed(known, wanted), (cell, wanted)


def test_the_table_has_every_verdict_and_says_how_often(table: Table) -> None:
    every = [row for rows in table.values() for row in rows]
    assert {row.verdict for row in every} == set(Verdict)
    said = " ".join(paper_text(table).plain.splitlines()[-2:])
    assert said.startswith(f"{len(every)} claims. ")
    assert numbers_of(said)[1:] == [sum(row.verdict is verdict for row in every) for verdict in Verdict]


def test_the_text_fits_a_terminal_and_has_every_claim(table: Table) -> None:
    text = paper_text(table).plain
    assert text.isascii()
    assert max(len(line) for line in text.splitlines()) <= 80
    flat = " ".join(text.split())
    for rows in table.values():
        for row in rows:
            for cell in (row.claim, row.published, row.recomputed, row.why):
                assert " ".join(cell.split()) in flat


def test_the_markdown_has_a_table_a_group_with_five_columns(table: Table) -> None:
    lines = paper_markdown(table).splitlines()
    assert [line[3:] for line in lines if line.startswith("## ")] == list(table)
    cells = [re.split(r"(?<!\\)\|", line)[1:-1] for line in lines if line.startswith("|")]
    assert {len(each) for each in cells} == {len(COLUMNS)}
    assert len(cells) == 2 * len(table) + sum(map(len, table.values()))


def test_rows_alone_need_no_groups(table: Table) -> None:
    rows = table["throttle"]
    assert paper_text(rows).plain.startswith(rows[0].claim[:40])
    assert "##" not in paper_markdown(rows)
    assert paper_csv(rows).splitlines()[1].startswith(",")


# ---- verdicts ----


@pytest.mark.parametrize(
    ("text", "value", "agrees"),
    [("0.7", 0.7499, True), ("0.7", 0.75, True), ("0.7", 0.7501, False), ("0.70", 0.7051, False), ("93", 92.6, True)],
)
def test_a_printed_number_is_known_to_half_a_unit(text: str, value: float, agrees: bool) -> None:
    assert PublishedNumber(text).agrees(value) is agrees


def test_a_number_that_is_missing_agrees_with_none() -> None:
    assert not PublishedNumber("0.7").agrees(None)
    assert not THROTTLE.agree(None)


def test_a_condition_does_not_make_true_what_is_not() -> None:
    assert verdict_of(True) is Verdict.HOLDS
    assert verdict_of(True, on_condition=True) is Verdict.HOLDS_WITH
    assert verdict_of(False, on_condition=True) is Verdict.DOES_NOT_HOLD


def test_counts_are_said_to_two_digits() -> None:
    assert [rounded_count(count) for count in (0, 4, 85, 261, 1499)] == ["0", "4", "85", "260", "1500"]


# ---- where it comes from ----


def test_the_packages_specs_are_the_shipped_ones() -> None:
    for folder in ("specs", "systems"):
        packaged = sorted((ROOT / "fopi_tune" / "paper" / folder).iterdir())
        assert packaged
        for path in packaged:
            assert path.read_bytes() == (ROOT / folder / path.name).read_bytes(), path.name


def test_the_printed_gains_are_the_tests_own() -> None:
    assert THROTTLE.gains == PUBLISHED_THROTTLE
    assert BRAKE.gains == PUBLISHED_BRAKE
    assert str(BRAKE) == "kp = 0.07, ki = 0.11, alpha = 0.45"


# ---- rows against closed forms ----


def root_of(function: Callable[[float], float], low: float, high: float) -> float:
    return float(optimize.brentq(function, low, high))  # pyright: ignore[reportArgumentType]


def brake_margin_deg(gains: ft.FoPi, omega: float, tau: float) -> float:
    return 180.0 + math.degrees(np.angle((gains.kp + gains.ki * (1j * omega) ** -gains.alpha) / (1j * omega * tau + 1)))


def test_the_throttles_rejection_is_that_of_a_scan(table: Table) -> None:
    omega = np.geomspace(1e-6, 0.035, 20001)
    gains = PUBLISHED_THROTTLE
    loop = (gains.kp + gains.ki * (1j * omega) ** -gains.alpha) * 4.39 / (1j * omega + 0.1746)
    row = row_of(table, "throttle", "reject output disturbances")
    # printed to three digits
    assert numbers_of(row.recomputed)[0] == pytest.approx(20 * np.log10(np.abs(1 / (1 + loop)).max()), abs=6e-4)
    assert row.verdict is Verdict.HOLDS


def test_the_throttles_margins_are_where_the_loops_gain_is_one(table: Table) -> None:
    gains = PUBLISHED_THROTTLE

    def loop(omega: float) -> complex:
        return (gains.kp + gains.ki * (1j * omega) ** -gains.alpha) * 4.39 / (1j * omega + 0.1746)

    omega = root_of(lambda w: abs(loop(w)) - 1.0, 0.1, 1.0)
    found = numbers_of(row_of(table, "throttle", "meet their crossover").recomputed)
    assert found[0] == pytest.approx(omega, abs=6e-5)
    assert found[1] == pytest.approx(180.0 + math.degrees(np.angle(loop(omega))), abs=6e-3)


def test_the_published_brake_has_the_margins_of_the_stated_plant(table: Table) -> None:
    gains = PUBLISHED_BRAKE
    # |kp + ki s^-alpha|^2 = 1 + (tau omega)^2
    half = 0.5 * gains.alpha * math.pi
    omega = root_of(
        lambda w: (
            (gains.kp + gains.ki * w**-0.45 * math.cos(half)) ** 2
            + (gains.ki * w**-0.45 * math.sin(half)) ** 2
            - (1.0 + (2.25 * w) ** 2)
        ),
        1e-4,
        1.0,
    )
    cross, phase = row_of(table, "brake", "crossover is 0.7"), row_of(table, "brake", "phase margin is 93")
    assert numbers_of(cross.recomputed)[0] == pytest.approx(omega, abs=6e-6)
    assert numbers_of(phase.recomputed)[0] == pytest.approx(brake_margin_deg(gains, omega, 2.25), abs=0.06)
    assert cross.verdict is phase.verdict is Verdict.DOES_NOT_HOLD


def test_the_plant_that_explains_figure_3_has_its_crossover_and_margin() -> None:
    needed = fitted_plant(0.7, 93.0)
    found = ft.margins(PUBLISHED_BRAKE, ft.Plant((needed.static_gain,), (needed.tau_s, 1.0)))
    assert found.crossover_rad_s == pytest.approx(0.7, rel=1e-9)
    assert found.phase_margin_deg == pytest.approx(93.0, rel=1e-9)


def test_the_least_order_is_where_the_closed_form_of_kp_is_zero(table: Table) -> None:
    # kp = Re X + Im X cot(alpha pi/2), X = -j (1 + 0.675 j) = 0.675 - j
    root = root_of(lambda a: 0.675 - 1.0 / math.tan(0.5 * a * math.pi), 0.1, 0.99)
    row = row_of(table, "brake", "An order of 0.45")
    assert f"alpha >= {root:.4f}" in row.recomputed
    assert "infeasible" in row.recomputed


def test_other_gains_are_the_closed_form(table: Table) -> None:
    power, half = 0.3**0.8, 0.4 * math.pi
    ki = power / math.sin(half)
    kp = 0.675 - ki / power * math.cos(half)
    row = row_of(table, "brake", "Some gains meet")
    assert f"kp = {kp:.4f}, ki = {ki:.4f}" in row.recomputed


def test_the_robust_brake_spreads_as_its_closed_form_at_the_ends(table: Table) -> None:
    gains = ROBUST_BRAKE
    found = []
    for tau in (1.6, 3.1):
        omega = root_of(
            lambda w, tau=tau: abs(gains.kp + gains.ki * (1j * w) ** -gains.alpha) - math.hypot(1.0, tau * w), 0.1, 1.0
        )
        found.append(brake_margin_deg(gains, omega, tau))
    said = numbers_of(row_of(table, "brake", "A robust design").recomputed)
    assert said[3] == pytest.approx(found[1], abs=0.06)
    # the gains of the tests are rounded to five digits
    assert said[4] == pytest.approx(max(found[0] - 90.0, 90.0 - found[1]), abs=0.01)


def test_with_crossover_and_margin_given_no_order_makes_the_gain_margin_finite() -> None:
    for alpha in np.linspace(0.6221, 1.5, 60).tolist():
        ki = 0.3**alpha / math.sin(0.5 * alpha * math.pi)
        kp = 0.675 - 1.0 / math.tan(0.5 * alpha * math.pi)
        found = ft.margins(ft.FoPi(kp, ki, alpha), ft.Plant((1.0,), (2.25, 1.0)))
        assert found.phase_margin_deg == pytest.approx(90.0, abs=1e-6)
        assert found.gain_margin_db == math.inf


def test_the_misprinted_equation_is_off_by_the_same_at_every_such_loop(table: Table) -> None:
    # |L| = 1/4:  20 log10(1/4) - 1/4
    row = row_of(table, "gain_margin", "N4")
    assert numbers_of(row.recomputed)[0] == pytest.approx(-20 * math.log10(4) - 0.25, abs=6e-3)
    assert row.verdict is Verdict.DOES_NOT_HOLD


@pytest.mark.parametrize("name", ["throttle", "brake"])
def test_the_printed_filters_are_scipys(name: str) -> None:
    found = FILTERS[name]
    omega = np.geomspace(0.01, 10.0, 50)
    _, expected = signal.freqz(found.b, found.a, worN=omega * 0.2)  # pyright: ignore[reportArgumentType]
    # near the unit circle seven poles cost some digits
    np.testing.assert_allclose(published_response(found, omega), expected, rtol=1e-8)
    _, poles, _ = signal.tf2zpk(found.b, found.a)
    np.testing.assert_allclose(np.sort(np.abs(published_poles(found))), np.sort(np.abs(poles)), rtol=1e-6)


def test_the_printed_denominators_change_sign_outside_the_unit_circle(table: Table) -> None:
    # a monic polynomial of odd degree that is negative at 1 has a real root beyond 1, and likewise below -1
    assert sum(FILTERS["throttle"].a) < 0.0
    assert np.polyval(FILTERS["brake"].a, 1.0) < 0.0 < np.polyval(FILTERS["brake"].a, -1.0)
    for name, roots in (("throttle", [1.0487]), ("brake", [1.0151, -1.0010])):
        row = row_of(table, "filters", f"The {name}'s filter runs")
        assert numbers_of(row.recomputed) == roots


def test_the_models_states_are_counted_by_their_fractions(table: Table) -> None:
    assert "9 components" in row_of(table, "hybrid", "x does not change").recomputed
    assert "29 with the brake" in row_of(table, "hybrid", "x does not change").recomputed


@pytest.mark.long
def test_a_released_pedal_slows_the_car_by_its_own_plant(table: Table) -> None:
    row = row_of(table, "manoeuvre", "static gain 1, the pedal is released")
    # (y - u)/tau as the brake begins, of the drawn plant with the least tau, some 4e-5 above 1.6; u = -30 times the
    # direct path of the controller on samples
    sections = discretize(FoPi(0.07, 0.11, 0.45), DigitalSpec(0.2)).sections
    assert numbers_of(row.recomputed)[-1] == pytest.approx(30.0 * (1.0 + sections.direct) / 1.6 / 3.6, abs=6e-3)
    assert row.verdict is Verdict.DOES_NOT_HOLD


def test_a_held_pedal_lets_the_car_be_braked_as_far_as_the_loop_rejects_a_load() -> None:
    # y(60) = 30/(s (1 + L)) inverted by another program: Talbot's method of mpmath
    mpmath = pytest.importorskip("mpmath")
    gains = PUBLISHED_BRAKE

    def transform(s: object) -> object:
        loop = (gains.kp + gains.ki / mpmath.power(s, 0.45)) / (2.25 * s + 1)  # pyright: ignore[reportOperatorIssue]
        return 30 / (s * (1 + loop))  # pyright: ignore[reportOperatorIssue]

    exact = float(mpmath.invertlaplace(transform, 60.0, method="talbot"))
    found = ft.simulate(ROOT / "systems" / "manoeuvre_gain_1.yaml", gains, scenario="held_step", exact=True).driven[0]
    assert found.measures["final_error"] == pytest.approx(exact, abs=1e-4)


def test_the_brake_breaks_the_limit_above_the_speed_its_plant_allows(table: Table) -> None:
    speeds = numbers_of(row_of(table, "experiments", "whatever the controller").recomputed)[:3]
    assert speeds == [pytest.approx(7.2 * tau, abs=0.051) for tau in (1.6, 2.25, 3.1)]


def test_the_largest_acceleration_is_where_the_brakes_mode_begins() -> None:
    for name in ("experiment_1", "experiment_2"):
        (driven,) = ft.simulate_system(ROOT / "systems" / "car_held.yaml", scenario=name).driven
        t = driven.traces
        worst = int(np.abs(t.rate[0]).argmax())
        # at the sample that changes to mode 2, or the next one
        assert 2 in t.mode[0, worst - 1 : worst + 2]
        assert 1 in t.mode[0, worst - 2 : worst + 1]


# ---- FOPI against PI ----


def test_the_pi_of_the_comparison_is_the_baseline_spec() -> None:
    found = design_pair(spec("brake"))
    baseline = design_of("pi_baseline", proof=False)
    assert found.integer.objective == pytest.approx(baseline.objective, rel=1e-9)
    # crossover 0.3, 90 deg, tau 2.25: the PI's zero cancels the plant's pole
    assert found.gains[1].kp == pytest.approx(0.675, rel=1e-6)
    assert found.gains[1].ki == pytest.approx(0.3, rel=1e-6)
    assert found.pays


def test_the_spread_at_the_crossover_has_no_controller_in_it(table: Table) -> None:
    # 20 log10 |P/P_nominal| at 0.3 rad/s: the larger at the ends of tau
    ends = [10 * math.log10((1 + (0.3 * 2.25) ** 2) / (1 + (0.3 * tau) ** 2)) for tau in (1.6, 3.1)]
    row = row_of(table, "fopi_vs_pi", "gain at the crossover")
    expected = max(map(abs, ends))
    assert numbers_of(row.recomputed) == [pytest.approx(expected, abs=6e-4)] * 2
    assert row.verdict is Verdict.DOES_NOT_HOLD


def test_a_flat_phase_is_where_the_fractional_order_pays_most() -> None:
    found = design_pair(uncertain_gain())
    scan = []
    for alpha in (found.gains[0].alpha - 0.02, found.gains[0].alpha, found.gains[0].alpha + 0.02, 1.0):
        # closed form of the gains at 0.3 rad/s and 60 deg, then every corner of gain and tau, by bisection
        x = np.exp(1j * math.radians(60.0 - 180.0)) * (1 + 0.675j)
        ki = -x.imag * 0.3**alpha / math.sin(0.5 * alpha * math.pi)
        gains = ft.FoPi(x.real - ki * 0.3**-alpha * math.cos(0.5 * alpha * math.pi), ki, alpha)
        worst = 0.0
        for gain in np.geomspace(0.5, 2.0, 9).tolist():
            for tau in np.linspace(1.6, 3.1, 9).tolist():
                omega = root_of(
                    lambda w, g=gain, t=tau, c=gains: (
                        abs(g * (c.kp + c.ki * (1j * w) ** -c.alpha)) - math.hypot(1, t * w)
                    ),
                    1e-3,
                    10.0,
                )
                worst = max(worst, abs(brake_margin_deg(gains, omega, tau) - 60.0))
        scan.append(worst)
    # the worst plants are on the grid: corners of the box
    assert scan[1] == pytest.approx(found.objectives[0], abs=1e-3)
    assert scan[3] == pytest.approx(found.objectives[1], abs=1e-3)
    assert scan[1] < min(scan[0], scan[2])


def test_a_pi_settles_as_its_exponential_does() -> None:
    # kp = 0.675, ki = 0.3, tau = 2.25: L = 0.3/s, the error e^{-0.3 t}
    found = settling_s(ft.FoPi(0.675, 0.3, 1.0), 2.25)
    assert found == pytest.approx(math.log(50.0) / 0.3, abs=0.1)  # the step of the times


def test_a_pis_error_after_a_load_has_the_integral_of_its_reciprocal() -> None:
    # the error keeps its sign, so that the integral of |e| is 1/ki; over 200 s nothing is left, h = 0.1 s costs h^2/12
    assert absolute_load_error(ft.FoPi(0.675, 0.3, 1.0), 2.25, 0.0, 0.1, 200.0) == pytest.approx(1.0 / 0.3, rel=1e-3)


def test_the_fractional_error_after_a_load_is_that_of_the_simulated_loop() -> None:
    gains = ROBUST_BRAKE
    text = f"""
schema: 1
name: load
plant: {{model: lag, static_gain: 1, time_constant_s: 2.25}}
controller: {{kp: {gains.kp}, ki: {gains.ki}, alpha: {gains.alpha}}}
requirements: [{{phase_margin_deg: {{at_least: 60}}}}]
digital: {{sample_time_s: 0.2}}
scenarios: [{{name: load, duration_s: 60, load: [{{at_s: 0, value: 1}}], reference: [{{at_s: 0, value: 0}}]}}]
"""
    (driven,) = ft.simulate(ft.parse_spec(text), gains, exact=True).driven
    expected = integrate.trapezoid(np.abs(driven.traces.output[0]), driven.traces.time_s)
    # another method in time, on finer steps
    assert absolute_load_error(gains, 2.25, 0.0, 0.1, 60.0) == pytest.approx(expected, rel=1e-3)


# ---- figures ----


@pytest.mark.thinned(slow=["filter_responses", "bode", "switching", "alpha"])
@pytest.mark.parametrize("name", FIGURES)
def test_a_figure_says_in_words_what_it_shows(name: str) -> None:
    picture = PICTURES[name]()
    assert len(picture.title) > 10
    assert len(picture.description) > 80
    root = ElementTree.fromstring(svg_of(picture))
    space = {"svg": "http://www.w3.org/2000/svg", "dc": "http://purl.org/dc/elements/1.1/"}
    assert root.findtext("svg:title", namespaces=space) == picture.title
    assert root.findtext("svg:desc", namespaces=space) == picture.description
    assert root.findtext(".//dc:description", namespaces=space) == picture.description
    shown = " ".join(element.text or "" for element in root.iter("{http://www.w3.org/2000/svg}text"))
    assert picture.title in shown


def test_the_same_figure_has_the_same_bytes() -> None:
    picture = PICTURES["bode_brake"]()
    assert FIGURES["bode_brake"]() == svg_of(picture)
    data = figure_png("bode_brake")
    assert data == png_of(picture)
    assert data.startswith(b"\x89PNG\r\n\x1a\n")
    # 6.4 and 6 inches at 150 dots
    assert struct.unpack(">II", data[16:24]) == (960, 900)
    assert picture.description.encode() in data


def test_the_switched_car_cycles_with_memories_held_and_settles_with_reset_ones(table: Table) -> None:
    held, reset = table["settling"]
    assert held.verdict is Verdict.DOES_NOT_HOLD
    assert "at r = 6 km/h, tau = 3.1 s it ends in a periodic orbit" in held.recomputed
    assert reset.verdict is Verdict.HOLDS_WITH
    # the bound that an independent program found is 4.994
    assert "at most 4.994 km/h below the setpoint" in reset.recomputed


def test_an_unknown_figure_is_named() -> None:
    with pytest.raises(DomainError, match="there is bode_brake, bode_family"):
        figure_png("bode")


def test_the_study_file_names_every_group_and_figure() -> None:
    yaml = pytest.importorskip("ruamel.yaml").YAML(typ="safe", pure=True)
    study = yaml.load((ROOT / "studies" / "paper.yaml").read_text(encoding="utf-8"))
    assert study["schema"] == 1
    assert study["claims"] == list(CLAIMS)
    assert study["figures"] == list(FIGURES)


def test_the_figures_lines_differ_without_colour() -> None:
    dashes = [str(style) for _, style in STYLES]
    assert len(set(dashes)) == len(dashes)
    # luminance of neighbours, ITU-R BT.709
    grey = [np.dot([int(c[k : k + 2], 16) for k in (1, 3, 5)], [0.2126, 0.7152, 0.0722]) for c, _ in STYLES]
    assert all(abs(a - b) > 5.0 for a, b in pairwise(grey))
