"""The report: safe, whole, the same bytes twice; its figures against the check; its script against its data."""

from __future__ import annotations

import base64
import hashlib
import html
import json
import math
import re
import shutil
import subprocess
from collections import Counter
from dataclasses import replace
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest
from cases.pages import HOSTILE, Page
from cases.plain_figures import RENDERED_BY, drawn_alone
from cases.plants import ROBUST_BRAKE, brake, lag
from cases.reports import BRAKE, brake_documents, brake_files, brake_page, run_of, without_gains
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.patches import Circle, Polygon, Rectangle
from typer.testing import CliRunner

import fopi_tune as ft
from fopi_tune.cli import app
from fopi_tune.core.controller import FoPi
from fopi_tune.core.margins import margins
from fopi_tune.core.parallel_form import Implementation
from fopi_tune.errors import DomainError
from fopi_tune.montecarlo.statistics import histogram
from fopi_tune.report.documents import ResultDocuments, documents_of, documents_of_run
from fopi_tune.report.figures.frequency import bode, margins_along, nyquist, sensitivities
from fopi_tune.report.figures.members import Members, members_of
from fopi_tune.report.figures.picture import Picture
from fopi_tune.report.figures.slider import slider_of
from fopi_tune.report.figures.step_responses import step_responses
from fopi_tune.report.html import report_files
from fopi_tune.results.documents import margins_dict
from fopi_tune.spec import parse_spec
from fopi_tune.spec.model import Relation, Requirement

#: of a plant that is known, on no computer: a page that is soon made
KNOWN = BRAKE.replace("{nominal: 2.25, min: 1.6, max: 3.1}", "2.25").replace("digital:", "# digital:")


def loop_of(documents: ResultDocuments) -> Members:
    members = members_of(documents)
    assert members is not None
    return members


@pytest.mark.long
def test_a_report_is_the_same_bytes_twice() -> None:
    assert report_files(brake_documents()) == brake_files()


def test_a_report_from_the_documents_on_the_disk_is_that_of_the_run() -> None:
    run = run_of(BRAKE)
    assert run.digital is not None
    design, digital = (json.loads(json.dumps(each.to_dict(), indent=2)) for each in (run.design, run.digital))
    assert report_files(documents_of(run.spec, design, digital)) == brake_files()


def test_a_page_is_well_formed_small_and_needs_no_network() -> None:
    text = brake_page()
    page = Page(text)
    assert page.open == []
    assert len(text.encode()) <= 3_000_000
    assert [name for name, count in Counter(page.ids).items() if count > 1] == []
    assert page.asked == []
    # the library has this word in its own text
    assert "@import" not in re.sub(r"<script>.*?</script>", "", text, flags=re.DOTALL)
    # the slider and its curves, seven figures for the pointer, the library and what shows them
    assert page.tags["script"] == 2 + 7 + 2


def test_every_reference_within_a_page_is_to_something_in_it() -> None:
    page = Page(brake_page())
    named = {v[1:] for name, v in page.attributes if name in ("href", "xlink:href") and v.startswith("#")}
    named |= {found for _, v in page.attributes for found in re.findall(r"url\(#([^)]+)\)", v)}
    named |= {word for name, v in page.attributes if name in ("aria-labelledby", "for") for word in v.split()}
    assert named
    assert named <= set(page.ids)


def test_every_figure_has_words_for_those_who_do_not_see_it() -> None:
    text = brake_page()
    figures = re.findall(r"<figure[^>]*>.*?</figure>", text, re.DOTALL)
    assert len(figures) == 8  # the slider's, one in time, five of the loop, one of the filter
    for figure in figures:
        assert re.search(r"<figcaption>[^<]{40,}</figcaption>", figure)
        for svg in re.findall(r"<svg.*?</svg>", figure, re.DOTALL):
            assert 'role="img"' in svg
            assert re.search(r"<title[^>]*>[^<]+</title>", svg)
            assert re.search(r"<desc[^>]*>[^<]{20,}</desc>", svg)


def test_figures_are_files_that_programs_read() -> None:
    names = {name.removeprefix("figures/") for name in brake_files() if name.startswith("figures/")}
    stems = ("scenario_1", "bode", "nyquist", "sensitivities", "responses", "margins", "digital")
    assert names == {f"{stem}.{kind}" for stem in stems for kind in ("svg", "png")}
    for stem in stems:
        svg, png = brake_files()[f"figures/{stem}.svg"], brake_files()[f"figures/{stem}.png"]
        assert isinstance(svg, str)
        assert ElementTree.fromstring(svg).tag.endswith("svg")
        assert isinstance(png, bytes)
        assert png.startswith(b"\x89PNG\r\n\x1a\n")


def test_hostile_words_of_a_spec_are_shown_and_not_obeyed() -> None:
    words = (HOSTILE * (10_000 // len(HOSTILE) + 1))[:10_000]
    text = re.sub(r"^description:.*$", lambda _: f"description: {json.dumps(words)}", BRAKE, flags=re.MULTILINE)
    page = report_files(without_gains(text, message=HOSTILE, objective_quantity=HOSTILE))["report.html"]
    assert isinstance(page, str)
    read = Page(page)
    assert read.open == []
    assert read.tags["script"] == 0
    assert read.tags["img"] == 0
    assert words in "".join(read.text)
    assert f"Why: {HOSTILE}." in "".join(read.text)


def test_hostile_words_reach_no_script_of_a_whole_page() -> None:
    # the plants' numbers and the design's name are the only words of a spec in figures and curves
    with pytest.raises(ft.SpecError):
        parse_spec(BRAKE.replace("name: brake", f"name: {json.dumps(HOSTILE)}"))
    with pytest.raises(ft.SpecError):
        parse_spec(BRAKE.replace("static_gain: 1.0", f"{json.dumps(HOSTILE)}: 1.0"))


def test_the_pages_policy_allows_its_own_scripts_alone() -> None:
    scripts = re.findall(r"<script>(.*?)</script>", brake_page(), re.DOTALL)
    digests = [base64.b64encode(hashlib.sha256(script.encode()).digest()).decode() for script in scripts]
    assert len(scripts) == 3
    allowed = re.findall(r"script-src ([^\"]*)", brake_page())[0].replace("&#39;", "'")
    assert set(allowed.split()) == {f"'sha256-{digest}'" for digest in digests}
    assert "default-src 'none'" in brake_page().replace("&#39;", "'")


def test_the_table_says_what_the_documents_say() -> None:
    text = "".join(Page(brake_page()).text)
    for words in ("phase margin ≥ 80°", "82.906", "time constant = 3.1", "-20", "infinite", "7.3856"):
        assert words.replace(" = ", "\N{NO-BREAK SPACE}=\N{NO-BREAK SPACE}") in text
    assert "solved. All requirements hold for the whole family. Checked in floating point, not proved." in text
    assert "The loop on samples: violated." in text  # the gains are those of continuous time
    assert run_of(BRAKE).spec.sha256 in text


def test_verdicts_of_a_proof_are_told_with_their_signs() -> None:
    proofs = [
        {"verdict": verdict, "proved_from": None, "proved_to": 1.5, "relative_gap": None, "boxes": 1, "reason": ""}
        for verdict in ("proved", "refuted", "undecided")
    ]
    said = list(brake_documents().design["requirements"])
    entries = [{**entry, "proof": proof} for entry, proof in zip(said, proofs, strict=False)] + said[3:]
    page = str(report_files(without_gains(requirements=entries))["report.html"])
    cells = re.findall(r'<td class="verdict">(.*?)</td>', page)
    assert cells == ["✓ proved", "✗ violated", "? undecided", "✓ met", "✓ met"]


def test_a_loop_that_is_stable_with_its_limits_is_told() -> None:
    proof = {
        "verdict": "proved",
        "reason": "fine",
        "stability": {"verdict": "proved", "reason": "|S| is small"},
        "with_limits": {"statement": "stable with its limits, -1 to 0: proved"},
        "boxes": 10,
        "tolerance": 1e-6,
        "certificate_digest": "0" * 64,
    }
    page = report_files(without_gains(proof=proof))["report.html"]
    assert isinstance(page, str)
    assert "stable with its limits, -1 to 0: proved" in page


@pytest.mark.parametrize("reason", ["there are no gains that pass the check", "left out on demand: not proved"])
def test_no_sentence_of_the_page_begins_in_lower_case(reason: str) -> None:
    proof = {"verdict": "not_attempted", "reason": reason}
    page = str(report_files(without_gains(proof=proof, message="the gains are fixed"))["report.html"])
    shown = re.sub(r"<(script|style).*?</\1>", " ", page, flags=re.DOTALL)
    # each element of a table or a list begins anew
    words = re.sub(r"\s+", " ", html.unescape(re.sub(r"<[^>]*>", " | ", shown)))
    assert f"not attempted. {reason[0].upper()}{reason[1:]}." in words
    assert re.findall(r"[a-z)][.!?] [a-z][^|]*", words) == []


def test_a_design_of_another_spec_is_refused() -> None:
    found = brake_documents()
    with pytest.raises(DomainError, match="another spec"):
        documents_of(parse_spec(BRAKE.replace("max: 3.1", "max: 3.2")), found.design)
    # what changes nothing that the results depend on does not make them another spec's
    assert documents_of(parse_spec(BRAKE + "# a comment\n"), found.design).design == found.design


def test_documents_of_other_gains_are_left_out() -> None:
    found = brake_documents()
    assert found.digital is not None
    other = {**found.digital, "gains": {"kp": 1.0, "ki": 1.0, "alpha": 1.0}}
    assert documents_of(found.spec, found.design, other, other).digital is None
    assert documents_of(found.spec, found.design, other, other).evidence is None
    assert documents_of(found.spec, found.design, found.digital).digital == found.digital


def test_without_gains_there_is_a_report_without_figures() -> None:
    nothing = {"met": False, "achieved": None, "outcome": None, "score": None, "worst": None, "multiplier": None}
    entries = [{**entry, **nothing} for entry in brake_documents().design["requirements"]]
    files = report_files(without_gains(requirements=entries))
    assert list(files) == ["report.html"]
    assert "There is no loop to draw" in str(files["report.html"])
    assert re.findall(r'<td class="verdict">(.*?)</td>', str(files["report.html"])) == ["– open"] * 5


def test_drawn_loops_are_the_formula() -> None:
    members = loop_of(brake_documents())
    gains, omega = members.gains, members.omega
    s = 1j * omega
    controller = gains.kp + gains.ki * s**-gains.alpha
    # the nominal plant and the worst ones, by their time constants
    expected = [controller / (member.point[0] * s + 1.0) for member in members.named]
    # rounding of a logarithm and its exponential
    np.testing.assert_allclose(np.exp(members.named_log_loop), expected, rtol=1e-10)
    assert [member.point for member in members.named] == [(2.25,), (3.1,), (1.6,)]
    np.testing.assert_allclose(members.controller, controller, rtol=1e-12)


def test_on_samples_the_drawn_loop_is_the_filter_behind_its_hold() -> None:
    text = BRAKE.replace("delay_samples: 0}", "delay_samples: 0, design: sampled}")
    found = brake_documents()
    design = {**found.design, "stamp": {**found.design["stamp"], "spec_sha256": parse_spec(text).sha256}}
    digital = {**(found.digital or {}), "stamp": design["stamp"]}
    assert members_of(documents_of(parse_spec(text), design)) is None  # nothing is drawn of another loop
    members = loop_of(documents_of(parse_spec(text), design, digital))
    implementation = members.documents.implementation
    assert isinstance(implementation, Implementation)
    # ZOH of 1/(tau s + 1):  (1 - a)/(z - a), a = e^{-Ts/tau}
    z, a = np.exp(1j * members.omega * 0.2), math.exp(-0.2 / 2.25)
    expected = implementation.sections.response(members.omega) * (1.0 - a) / (z - a)
    # poles next to z = 1 cost digits in z - a, not in what is drawn
    np.testing.assert_allclose(np.exp(members.named_log_loop[0]), expected, rtol=1e-8)
    assert members.omega[-1] < math.pi / 0.2


def pi_members(text: str = BRAKE, **said: Any) -> Members:
    """Of the PI that cancels the nominal brake: L = 0.3/s there."""
    found = brake_documents()
    spec = parse_spec(text)
    stamp = {**found.design["stamp"], "spec_sha256": spec.sha256}
    gains = {"kp": 0.675, "ki": 0.3, "alpha": 1.0}
    return loop_of(documents_of(spec, {**found.design, "stamp": stamp, "gains": gains, **said}))


def axes_of(picture: Picture | None) -> list[Axes]:
    assert picture is not None
    figure = Figure(layout="constrained")
    picture.draw(figure)
    return figure.axes


def line_of(axes: Axes, label: str = "nominal") -> tuple[np.ndarray, np.ndarray]:
    line = next(line for line in axes.lines if line.get_label() == label)
    return np.asarray(line.get_xdata(), dtype=float), np.asarray(line.get_ydata(), dtype=float)


def hatched(axes: Axes) -> list[tuple[float, float, float, float, str]]:
    """Left, bottom, right and top of each forbidden region, and how it is hatched."""
    found = [patch for patch in axes.patches if isinstance(patch, Rectangle) and patch.get_hatch()]
    boxes = [(patch.get_bbox(), str(patch.get_hatch())) for patch in found]
    return [(float(box.x0), float(box.y0), float(box.x1), float(box.y1), hatch) for box, hatch in boxes]


def test_drawn_sensitivities_and_what_they_may_not_reach_are_the_specs() -> None:
    s_axes, t_axes, cs_axes = axes_of(sensitivities(pi_members()))
    omega, s_db = line_of(s_axes)
    s = 1j * omega
    # rounding of logarithms, in dB
    np.testing.assert_allclose(s_db, 20.0 * np.log10(np.abs(s / (s + 0.3))), atol=1e-8)
    np.testing.assert_allclose(line_of(t_axes)[1], 20.0 * np.log10(np.abs(0.3 / (s + 0.3))), atol=1e-8)
    control = (0.675 * s + 0.3) / (s + 0.3)
    np.testing.assert_allclose(line_of(cs_axes)[1], 20.0 * np.log10(np.abs(control)), atol=1e-8)
    # |S| <= -20 dB up to 0.02 rad/s: above that and to the left
    left, bottom, right, top, hatch = hatched(s_axes)[0]
    assert (left, bottom, right, top) == (*(s_axes.get_xlim()[0], -20.0, 0.02), s_axes.get_ylim()[1])
    assert hatch == "////"
    assert hatched(t_axes) == hatched(cs_axes) == []


def test_the_loads_response_is_drawn_with_its_limit_where_the_spec_asks_for_it() -> None:
    members = pi_members()
    asked = Requirement("load_sensitivity_db", Relation.AT_MOST, (3.0,), from_rad_s=0.5)
    spec = members.documents.spec
    spec = replace(spec, requirements=(*spec.requirements[:-1], asked))
    picture = sensitivities(replace(members, documents=replace(members.documents, spec=spec)))
    *_, axes = axes_of(picture)
    omega, drawn = line_of(axes)
    s = 1j * omega
    # P/(1 + L) of L = 0.3/s
    expected = 20.0 * np.log10(np.abs(s / (s + 0.3) / (2.25 * s + 1.0)))
    np.testing.assert_allclose(drawn, expected, atol=1e-8)
    left, bottom, right, top, _ = hatched(axes)[0]
    assert (left, bottom, right, top) == (0.5, 3.0, axes.get_xlim()[1], axes.get_ylim()[1])
    assert "load sensitivity P S" in picture.description
    assert ", P S " in picture.description


def test_a_limit_by_the_frequency_is_hatched_beyond_its_line() -> None:
    members = pi_members()
    lines = [
        Requirement("sensitivity_db", Relation.AT_MOST, (-30.0,), from_rad_s=0.01, to_rad_s=0.1, end_limit=-10.0),
        Requirement(
            "complementary_sensitivity_db", Relation.AT_LEAST, (-3.0,), from_rad_s=0.1, to_rad_s=1.0, end_limit=-12.0
        ),
    ]
    spec = members.documents.spec
    spec = replace(spec, requirements=(*spec.requirements[:-2], *lines))
    s_axes, t_axes, _ = axes_of(sensitivities(replace(members, documents=replace(members.documents, spec=spec))))
    (above,) = [patch for patch in s_axes.patches if isinstance(patch, Polygon)]
    (below,) = [patch for patch in t_axes.patches if isinstance(patch, Polygon)]
    top, bottom = s_axes.get_ylim()[1], t_axes.get_ylim()[0]
    assert above.get_xy()[:-1].tolist() == [[0.01, -30.0], [0.1, -10.0], [0.1, top], [0.01, top]]
    assert below.get_xy()[:-1].tolist() == [[0.1, -3.0], [1.0, -12.0], [1.0, bottom], [0.1, bottom]]
    assert above.get_hatch() == "////"


def test_drawn_steps_are_the_closed_form() -> None:
    reference, load = axes_of(step_responses(pi_members()))
    t, output = line_of(reference)
    # what is drawn may be wrong by 1e-4 at most
    np.testing.assert_allclose(output, 1.0 - np.exp(-0.3 * t), atol=1e-4)
    # P/(1 + C P)/s = 1/((2.25 s + 1)(s + 0.3))
    a, b = 0.3, 1.0 / 2.25
    np.testing.assert_allclose(line_of(load)[1], (np.exp(-a * t) - np.exp(-b * t)) / (b - a) / 2.25, atol=1e-4)


def test_a_drawn_loop_has_dots_at_its_crossovers_and_its_phases_are_forbidden_there() -> None:
    gain, phase = axes_of(bode(pi_members()))
    omega, db = line_of(gain)
    np.testing.assert_allclose(db, 20.0 * np.log10(0.3 / omega), atol=1e-8)
    np.testing.assert_allclose(line_of(phase)[1], -90.0, atol=1e-8)
    dots = [tuple(np.ravel(line.get_xydata())) for line in phase.lines if line.get_marker() == "o"]
    # |L| = 1 at 0.3 rad/s, to the root finder's tolerance
    assert dots[0] == pytest.approx((0.3, -90.0), rel=1e-9)
    crosses = [tuple(np.ravel(line.get_xydata())) for line in phase.lines if line.get_marker() == "x"]
    assert crosses == [pytest.approx((0.3, -90.0), rel=1e-9)]
    left, bottom, right, top, _ = hatched(phase)[0]
    assert (bottom, top) == (phase.get_ylim()[0], -100.0)
    assert left < min(x for x, _ in dots) < max(x for x, _ in dots) < right


def test_what_only_the_nominal_plant_may_not_do_is_hatched_the_other_way() -> None:
    text = BRAKE.replace("- phase_margin_deg: {at_least: 80}", "- phase_margin_deg: {at_least: 80}\n    on: nominal")
    picture = bode(pi_members(text))
    left, _, right, _, hatch = hatched(axes_of(picture)[1])[0]
    assert hatch == "\\" * 4
    assert left < 0.3 < right < 0.33  # the family's region ends at 1.05 times 0.33
    assert "slanted the other way: for the nominal plant alone" in picture.description
    assert "slanted" not in bode(pi_members()).description


def discs_of(picture: Picture) -> list[float]:
    """Radii of what is drawn around -1."""
    circles = (patch for patch in axes_of(picture)[0].patches if isinstance(patch, Circle))
    return [circle.radius for circle in circles if circle.center == (-1.0, 0.0)]


def test_of_an_unstable_loop_no_disc_is_claimed_to_be_free() -> None:
    said = {**brake_documents().design["stability"], "stable": False}
    picture = nyquist(pi_members(stability=said))
    assert "not shown to be stable" in picture.description
    assert discs_of(picture) == []
    peak_db = pi_members().documents.design["stability"]["peak_sensitivity_db"]
    assert discs_of(nyquist(pi_members())) == [pytest.approx(10.0 ** (-peak_db / 20.0))]


def test_the_figure_of_margins_has_one_label_below() -> None:
    phase, gain = axes_of(margins_along(pi_members()))
    assert (phase.get_xlabel(), gain.get_xlabel()) == ("", "time constant, s")
    tau, margin = (np.asarray(each, dtype=float) for each in phase.lines[0].get_data())
    expected = [margins(FoPi(0.675, 0.3, 1.0), brake().member(np.array([each]))).phase_margin_deg for each in tau]
    np.testing.assert_allclose(margin, np.array(expected, dtype=float), rtol=1e-9)


def half_unstable() -> Members:
    """Gains that leave the loop of 1/(s + p) unstable where p is below -0.12: s^2 + (kp + p) s + ki with alpha = 1."""
    plant = "plant: {model: pole, gain: 1, pole_rad_s: {nominal: 0.1, min: -0.5, max: 0.5}}\n"
    gains = "controller: {kp: 0.12, ki: 0.1, alpha: 1}\nrequirements: [{phase_margin_deg: {at_least: 30}}]\n"
    return loop_of(documents_of_run(run_of(f"schema: 1\nname: half\n{plant}{gains}"), None))


def test_margins_of_unstable_loops_are_left_out_and_said_to_be() -> None:
    picture = margins_along(half_unstable())
    assert picture is not None
    pole, margin = (np.asarray(each, dtype=float) for each in axes_of(picture)[0].lines[0].get_data())
    np.testing.assert_array_equal(np.isnan(margin), pole <= -0.12)
    unstable = int((pole <= -0.12).sum())
    assert f"Of the {len(pole)} plants along the curve {unstable} leave an unstable loop" in picture.description
    assert "unstable" not in (margins_along(pi_members()) or picture).description


def test_outputs_of_unstable_loops_do_not_set_the_axis() -> None:
    members = half_unstable()
    picture = step_responses(members)
    assert picture is not None
    assert "leave an unstable loop" in picture.description
    axes = axes_of(picture)[0]
    drawn = [np.asarray(line.get_ydata(), dtype=float) for line in axes.lines]
    low, high = axes.get_ylim()
    # the nominal step overshoots to less than 2; unstable ones grow with exp(0.2 t) over some hundred seconds
    assert -2.0 < low < 0.0 < 1.0 < high < 3.0
    assert max(float(row.max()) for row in drawn) > 1e3
    slider = slider_of(members)
    assert slider is not None
    step = slider.panels[-1]
    assert "unstable" in step.title
    words = [float(word) for _, word in step.y_ticks]
    assert max(words) <= 3.0


def test_legends_cover_no_curve() -> None:
    for picture in (
        bode(pi_members()),
        nyquist(pi_members()),
        sensitivities(pi_members()),
        step_responses(pi_members()),
    ):
        assert picture is not None
        figure = Figure(figsize=picture.size_inches, layout="constrained")
        picture.draw(figure)
        FigureCanvasAgg(figure).draw()
        legend = figure.legends[0].get_window_extent()
        assert not any(legend.overlaps(axes.get_tightbbox()) for axes in figure.axes)  # pyright: ignore[reportArgumentType]
        assert all(axes.get_legend() is None for axes in figure.axes)
        assert figure.bbox.x0 <= legend.x0 < legend.x1 <= figure.bbox.x1


def test_the_figure_of_margins_tells_their_range() -> None:
    low, high = (margins(ROBUST_BRAKE, brake().member(np.array([tau]))).phase_margin_deg for tau in (3.1, 1.6))
    assert low is not None
    assert high is not None
    # the gains of the run and those written down agree to five digits
    assert f"phase margin from {low:.4g} to {high:.4g} deg, gain margin infinite" in brake_page()


def test_the_slider_ends_at_the_ends_of_the_family_and_stands_at_the_nominal_plant() -> None:
    slider = slider_of(loop_of(brake_documents()))
    assert slider is not None
    assert slider.labels[0] == "time constant = 1.6\N{NO-BREAK SPACE}s"
    assert slider.labels[-1] == "time constant = 3.1\N{NO-BREAK SPACE}s"
    assert slider.labels[slider.nominal] == "time constant = 2.25\N{NO-BREAK SPACE}s"
    assert [panel.key for panel in slider.panels] == ["gain", "phase", "nyquist", "step"]
    for panel in slider.panels:
        assert len(panel.curves) == len(slider.labels)
        assert len(set(panel.curves)) == len(panel.curves)  # every value moves the curve
        assert all(re.fullmatch(r"M-?\d+\.\d -?\d+\.\d(L-?\d+\.\d -?\d+\.\d)+", curve) for curve in panel.curves)


def test_a_known_plant_has_no_slider() -> None:
    known = parse_spec(BRAKE.replace("{nominal: 2.25, min: 1.6, max: 3.1}", "2.25"))
    found = replace(brake_documents(), spec=known, digital=None)
    assert slider_of(Members(found, FoPi(1.0, 1.0, 0.5))) is None


#: a page of three elements, enough for the script; prints what it shows at first and after a move
STAGE = """
const fs = require("fs");
const [script, curves, keys, start, moved] = JSON.parse(fs.readFileSync(0, "utf8"));
const elements = {};
function element(id) {
  if (id === "number") return null;
  return elements[id] || (elements[id] = {
    attributes: {}, heard: {}, textContent: "", value: "",
    setAttribute(name, value) { this.attributes[name] = value; },
    addEventListener(name, told) { this.heard[name] = told; },
  });
}
globalThis.document = { getElementById: element };
element("curves").textContent = curves;
element("slider").value = start;
(0, eval)(script);
function seen() {
  return [element("slider-value").textContent, element("slider").attributes["aria-valuetext"],
          ...keys.map((key) => element("moved-" + key).attributes.d)];
}
const first = seen();
element("slider").value = moved;
element("slider").heard.input();
console.log(JSON.stringify([first, seen()]));
"""


def test_the_pages_script_moves_every_curve() -> None:
    node = shutil.which("node")
    if node is None:
        pytest.skip("no program `node` to run the page's script with")
    slider = slider_of(loop_of(brake_documents()))
    assert slider is not None
    text = brake_page()
    curves = re.findall(r'<script type="application/json" id="curves">(.*?)</script>', text, re.DOTALL)[0]
    script = re.findall(r"<script>(.*?)</script>", text, re.DOTALL)[0]
    keys = [panel.key for panel in slider.panels]
    told = json.dumps([script, curves, keys, str(slider.nominal), "0"])
    ran = subprocess.run([node, "-e", STAGE], input=told, capture_output=True, text=True, check=False)
    assert ran.stderr == ""
    for seen, k in zip(json.loads(ran.stdout), (slider.nominal, 0), strict=True):
        assert seen == [slider.labels[k], slider.labels[k], *(panel.curves[k] for panel in slider.panels)]


def test_the_pages_data_name_every_curve_that_the_page_has() -> None:
    text = brake_page()
    data = json.loads(re.findall(r'id="curves">(.*?)</script>', text, re.DOTALL)[0])
    ids = set(Page(text).ids)
    assert {"slider", "slider-value", "curves", *(f"moved-{key}" for key in data["curves"])} <= ids
    assert all(len(curves) == len(data["labels"]) for curves in data["curves"].values())
    assert f'max="{len(data["labels"]) - 1}"' in text


def test_a_histogram_counts_every_finite_value_once() -> None:
    values = np.random.default_rng(1).normal(size=1000)
    found = histogram(np.concatenate([values, [np.inf]]))
    assert found is not None
    counts, edges = np.histogram(values, bins=len(found.counts))
    np.testing.assert_allclose(found.edges, edges, rtol=1e-12)
    # a value on an edge may be rounded to either side
    assert np.abs(np.array(found.counts) - counts).sum() <= 2
    assert sum(found.counts) == 1000
    assert histogram(np.array([np.inf])) is None
    same = histogram(np.array([2.0, 2.0]))
    assert same is not None
    assert same.counts[0] == 2


def test_the_evidence_is_part_of_a_report(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(RENDERED_BY, drawn_alone)
    run = run_of(BRAKE)
    assert run.design.gains is not None
    evidence = json.loads(json.dumps(ft.validate(run.spec, run.design.gains, samples=50).to_dict()))
    files = report_files(brake_documents(evidence))
    assert "figures/plants.svg" in files
    text = "".join(Page(str(files["report.html"])).text)
    assert "met: 50 plants, random, seed 1" in text
    # Clopper-Pearson of 50 of 50 at 99 %: (0.005)^(1/50) = 0.89946
    assert "89.94 .. 100 %" in text


def test_a_run_writes_its_report_and_report_makes_it_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("brake.yaml").write_text(KNOWN, encoding="utf-8")
    ran = CliRunner().invoke(app, ["run", "brake.yaml", "--no-proof"])
    assert "wrote results/brake/report.html" in ran.stderr
    folder = Path("results", "brake")
    first = {p.name: p.read_bytes() for p in (folder / "report.html", *sorted((folder / "figures").iterdir()))}
    assert first["report.html"] == str(report_files(documents_of_run(run_of(KNOWN)))["report.html"]).encode()
    (folder / "report.html").unlink()
    again = CliRunner().invoke(app, ["report", "brake.yaml"])
    assert (again.exit_code, again.stdout) == (0, "results/brake/report.html\n")
    assert {
        name: (folder / ("" if name == "report.html" else "figures") / name).read_bytes() for name in first
    } == first
    Path("brake.yaml").write_text(KNOWN.replace("2.25", "2.26"), encoding="utf-8")
    from_folder = CliRunner().invoke(app, ["report", "results/brake"])
    assert (from_folder.exit_code, from_folder.stdout) == (0, "results/brake/report.html\n")
    assert (folder / "report.html").read_bytes() == first["report.html"]
    changed = CliRunner().invoke(app, ["report", "brake.yaml"])
    assert changed.exit_code == 2
    assert "of another spec" in changed.stderr


def test_a_spec_keeps_the_bytes_it_was_read_from() -> None:
    data = BRAKE.replace("\n", "\r\n").encode()
    assert parse_spec(data).source == data
    assert parse_spec(data).sha256 == hashlib.sha256(data).hexdigest()


def test_figures_that_a_new_report_does_not_draw_are_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(RENDERED_BY, drawn_alone)
    monkeypatch.chdir(tmp_path)
    Path("brake.yaml").write_text(KNOWN, encoding="utf-8")
    old = Path("results", "brake", "figures", "margins.svg")
    old.parent.mkdir(parents=True)
    old.write_text("old", encoding="utf-8")
    ran = CliRunner().invoke(app, ["run", "brake.yaml", "--no-proof"])
    assert "figures/margins.svg in results/brake is of an earlier result, not of this one" in ran.stderr
    assert old.read_text(encoding="utf-8") == "old"


def test_without_results_report_says_what_to_do(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("brake.yaml").write_text(BRAKE, encoding="utf-8")
    found = CliRunner().invoke(app, ["report", "brake.yaml"])
    assert found.exit_code == 2
    assert "there is no design.json to read in results/brake; make one with `fopi run`" in found.stderr
    (Path("results") / "brake").mkdir(parents=True)
    (Path("results") / "brake" / "design.json").write_text("{}", encoding="utf-8")
    assert "run `fopi run` again" in CliRunner().invoke(app, ["report", "brake.yaml"]).stderr


def test_an_unstable_loop_is_drawn_too() -> None:
    found = brake_documents()
    text = BRAKE.replace("dead_time_s: 0.0", "dead_time_s: 20.0")
    stamp = {**found.design["stamp"], "spec_sha256": parse_spec(text).sha256}
    gains = found.gains
    assert gains is not None
    nominal = margins(gains, lag(1.0, 2.25, 20.0).member(np.zeros(0)))
    assert not nominal.stable
    design = {**found.design, "stamp": stamp, "nominal": margins_dict(nominal)}
    files = report_files(documents_of(parse_spec(text), design))
    assert "figures/bode.svg" in files
    page = files["report.html"]
    assert isinstance(page, str)
    # 0.3 rad/s and -90 deg, less 20 s of dead time: 343.8 deg, or 253.8 deg from -1 by a lead
    assert "no margin: unstable; crosses |L| = 1 at\u00a00.3" in page.replace("at ", "at\u00a0")
    assert "106.23" in page
