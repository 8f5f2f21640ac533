"""Designs side by side: what may be compared is compared, nothing else is; what is drawn; the command."""

from __future__ import annotations

import json
import math
import re
from collections import Counter
from functools import cache
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest
from cases.pages import HOSTILE, Page
from cases.plants import PUBLISHED_BRAKE, ROBUST_BRAKE
from cases.project import CONTINUOUS
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from scipy.optimize import brentq
from typer.testing import CliRunner

import fopi_tune as ft
from fopi_tune.cli import app
from fopi_tune.core.controller import FoPi
from fopi_tune.report.comparison import Comparison, compare_designs
from fopi_tune.report.comparison_page import comparison_files
from fopi_tune.report.documents import ResultDocuments, documents_of
from fopi_tune.report.figures.overlays import Overlay, overlay_pictures
from fopi_tune.report.figures.picture import STYLES, Picture
from fopi_tune.spec import parse_spec

pytestmark = pytest.mark.usefixtures("plain_figures")

BRAKE = (CONTINUOUS / "brake.yaml").read_text(encoding="utf-8")
#: cancels the nominal brake: L = 0.3/s there
PI = FoPi(0.675, 0.3, 1.0)
TAU = (1.6, 2.25, 3.1)
#: the robust gains are written to seven digits
ROUNDED = 1e-5
OTHER = BRAKE.replace("max: 3.1", "max: 3.0")
SOFTER = BRAKE.replace("phase_margin_deg: {at_least: 80}", "phase_margin_deg: {at_least: 70}")


@cache
def check(gains: FoPi, text: str = BRAKE) -> dict[str, Any]:
    return json.loads(json.dumps(ft.prove(parse_spec(text), gains, ROUNDED).to_dict()))


def documents(gains: FoPi, text: str = BRAKE, /, **said: Any) -> ResultDocuments:
    return documents_of(parse_spec(text), {**check(gains, text), **said}, file="check.json", command="fopi prove")


def fopi_against_pi() -> Comparison:
    return compare_designs([("fopi", documents(ROBUST_BRAKE)), ("pi", documents(PI))])


def sentence_about(comparison: Comparison, words: str) -> str:
    return next(sentence for sentence in comparison.sentences if words in sentence)


def phase_margin_deg(gains: FoPi, tau: float) -> float:
    """Of C/(tau s + 1), by bisection of |L| = 1."""

    def loop(omega: float) -> complex:
        s = 1j * omega
        return (gains.kp + gains.ki * s**-gains.alpha) / (tau * s + 1.0)

    omega = brentq(lambda w: abs(loop(w)) - 1.0, 1e-6, 1e3, xtol=1e-14)
    assert isinstance(omega, float)
    return 180.0 + math.degrees(np.angle(loop(omega)))


def test_who_is_better_is_who_has_the_better_worst_case() -> None:
    a, b = (min(phase_margin_deg(gains, tau) for tau in TAU) for gains in (ROBUST_BRAKE, PI))
    assert a > b
    found = sentence_about(fopi_against_pi(), "phase_margin_deg >= 80")
    assert found == f"A brake (fopi) is better in phase_margin_deg >= 80 (family): {a:.5g} against {b:.5g} (B)."
    line = next(line for line in fopi_against_pi().lines if line.what == "phase_margin_deg >= 80")
    assert [cell is not None and cell.is_best for cell in line.cells] == [True, False]


def test_values_that_agree_are_called_alike() -> None:
    found = sentence_about(fopi_against_pi(), "gain_margin_db")
    assert found == "A and B are alike in gain_margin_db >= 12.04 (family): infinite."


def test_the_objective_is_compared_where_both_have_it() -> None:
    def spread(gains: FoPi) -> float:
        return max(abs(phase_margin_deg(gains, tau) - phase_margin_deg(gains, 2.25)) for tau in TAU)

    found = sentence_about(fopi_against_pi(), "objective: minimize phase_margin_spread_deg")
    assert f"{spread(ROBUST_BRAKE):.5g} against {spread(PI):.5g} (B)" in found
    assert found.startswith("A brake (fopi) is better in")


def test_designs_for_other_plants_are_shown_and_never_compared() -> None:
    comparison = compare_designs([("a", documents(ROBUST_BRAKE)), ("b", documents(PI, OTHER))])
    assert comparison.groups == ((0,), (1,))
    assert not any(cell is not None and cell.is_best for line in comparison.lines for cell in line.cells)
    assert all(cell is not None for cell in comparison.lines[2].cells)
    assert not any(re.search("better|best|alike|closer", sentence) for sentence in comparison.sentences)
    page = comparison_files([("a", documents(ROBUST_BRAKE)), ("b", documents(PI, OTHER))])["compare.html"]
    assert "The designs are not about the same plants and the same loop." in str(page)
    assert "time constant from 1.6 to 3, nominal 2.25" in str(page)


def test_a_nominal_value_alone_makes_other_plants() -> None:
    other = BRAKE.replace("nominal: 2.25", "nominal: 2.5")
    assert len(compare_designs([("a", documents(ROBUST_BRAKE)), ("b", documents(PI, other))]).groups) == 2


def test_the_loop_on_samples_is_not_compared_with_the_one_in_continuous_time() -> None:
    sampled = BRAKE.replace("delay_samples: 0}", "delay_samples: 0, design: sampled}")
    comparison = compare_designs([("a", documents(ROBUST_BRAKE)), ("b", documents(PI, sampled, loop="sampled"))])
    assert comparison.groups == ((0,), (1,))
    assert comparison.entries[1].loop == "on samples, every 0.2 s, 0 samples of delay"


def test_other_limits_of_one_quantity_are_told_and_the_values_compared() -> None:
    comparison = compare_designs([("a", documents(ROBUST_BRAKE)), ("b", documents(PI, SOFTER))])
    line = next(line for line in comparison.lines if line.what == "phase_margin_deg, least")
    notes = [cell.note for cell in line.cells if cell is not None]
    assert [note.split(";")[0] for note in notes] == ["asked: >= 80", "asked: >= 70"]
    assert "better in phase_margin_deg, least" in sentence_about(comparison, "phase_margin_deg, least")


def test_values_that_must_equal_other_numbers_are_not_compared() -> None:
    faster = BRAKE.replace("{equals: 0.3}", "{equals: 0.31}")
    comparison = compare_designs([("a", documents(ROBUST_BRAKE)), ("b", documents(PI, faster))])
    assert not any("crossover_rad_s (" in sentence for sentence in comparison.sentences)
    same = compare_designs([("a", documents(PI)), ("b", documents(PUBLISHED_BRAKE))])
    assert sentence_about(same, "crossover_rad_s").startswith("A brake (a) is closer to crossover_rad_s = 0.3")


def test_what_a_spec_does_not_ask_is_said_to_be_missing() -> None:
    without = BRAKE.replace("  - gain_margin_db: {at_least: 12.04}\n", "")
    named = [("a", documents(ROBUST_BRAKE)), ("b", documents(PI, without))]
    line = next(line for line in compare_designs(named).lines if line.what.startswith("gain_margin_db"))
    assert line.cells[1] is None
    assert str(comparison_files(named)["compare.html"]).count("not in its spec") == 1


def test_an_unstable_design_is_never_better() -> None:
    stability = {**check(PI)["stability"], "stable": False, "reason": "a pole on the right"}
    comparison = compare_designs([("a", documents(ROBUST_BRAKE)), ("b", documents(PI, stability=stability))])
    assert not any(re.search("better|alike|closer", sentence) for sentence in comparison.sentences)
    assert "B brake (b) is not shown to be stable for every plant: its values are not compared." in comparison.sentences


def test_an_infinite_margin_is_better_than_any_finite_one() -> None:
    said = [dict(each) for each in check(PI)["requirements"]]
    said[3] |= {"achieved": 20.0, "outcome": "met"}
    comparison = compare_designs([("a", documents(PI, requirements=said)), ("b", documents(ROBUST_BRAKE))])
    found = sentence_about(comparison, "gain_margin_db")
    assert found == "B brake (b) is better in gain_margin_db >= 12.04 (family): infinite against 20 (A)."


def test_gains_that_miss_requirements_are_said_to() -> None:
    comparison = compare_designs([("a", documents(PI)), ("b", documents(PUBLISHED_BRAKE))])
    assert comparison.sentences[:2] == (
        "A brake (a) meets all 5 requirements of its spec (met, proved).",
        "B brake (b) misses 3 of the 5 requirements of its spec (violated, refuted).",
    )


def drawn_axes(picture: Picture | None) -> list[Axes]:
    assert picture is not None
    figure = Figure(layout="constrained")
    picture.draw(figure)
    return figure.axes


def lines_of(axes: Axes, label: str) -> tuple[np.ndarray, np.ndarray]:
    line = next(line for line in axes.lines if line.get_label() == label)
    return np.asarray(line.get_xdata(), dtype=float), np.asarray(line.get_ydata(), dtype=float)


def overlay_axes(name: str) -> list[Axes]:
    return drawn_axes(overlay_pictures()[name](Overlay(fopi_against_pi())))


def test_drawn_loops_and_sensitivities_are_the_formula() -> None:
    omega, gain = lines_of(overlay_axes("compare_bode")[0], "B brake (pi)")
    # kp/ki = 2.25 s cancels the nominal lag; what is left are roundings of logarithms
    np.testing.assert_allclose(gain, 20.0 * np.log10(0.3 / omega), atol=1e-8)
    omega, sensitivity = lines_of(overlay_axes("compare_sensitivities")[0], "B brake (pi)")
    s = 1j * omega
    np.testing.assert_allclose(sensitivity, 20.0 * np.log10(np.abs(s / (s + 0.3))), atol=1e-8)


def test_drawn_steps_are_the_closed_form() -> None:
    reference, load = overlay_axes("compare_responses")
    t, output = lines_of(reference, "B brake (pi)")
    # what is drawn may be wrong by 1e-4 at most
    np.testing.assert_allclose(output, 1.0 - np.exp(-0.3 * t), atol=1e-4)
    t, output = lines_of(load, "B brake (pi)")
    # P/(1 + C P) = s/((2.25 s + 1)(s + 0.3)):  residues of a double root do not occur, 1/2.25 != 0.3
    a, b = 0.3, 1.0 / 2.25
    np.testing.assert_allclose(output, (np.exp(-a * t) - np.exp(-b * t)) / (b - a) / 2.25, atol=1e-4)


def test_drawn_margins_are_the_bisections() -> None:
    tau, margin = lines_of(overlay_axes("compare_margins")[0], "A brake (fopi)")
    expected = [phase_margin_deg(ROBUST_BRAKE, each) for each in tau]
    np.testing.assert_allclose(margin, expected, rtol=1e-9)


def test_a_comparison_is_the_same_bytes_twice_well_formed_and_needs_no_network() -> None:
    named = [("fopi", documents(ROBUST_BRAKE)), ("pi", documents(PI)), ("published", documents(PUBLISHED_BRAKE))]
    files = comparison_files(named)
    assert comparison_files(named) == files
    text = str(files["compare.html"])
    page = Page(text)
    assert page.open == []
    assert page.tags["script"] == page.figures_scripts
    assert "default-src 'none'" in text
    assert len(text.encode()) <= 3_000_000
    assert [name for name, count in Counter(page.ids).items() if count > 1] == []
    assert page.asked == []
    figures = re.findall(r"<figure[^>]*>.*?</figure>", text, re.DOTALL)
    assert len(figures) == 4
    assert all(re.search(r"<figcaption>[^<]{40,}</figcaption>", figure) for figure in figures)


def test_six_designs_differ_in_dashes_and_colour() -> None:
    named = [(str(k), documents(FoPi(0.3 + 0.01 * k, 0.3, 1.0))) for k in range(6)]
    axes = drawn_axes(overlay_pictures()["compare_bode"](Overlay(compare_designs(named))))[0]
    lines = [line for line in axes.lines if str(line.get_label()).startswith(tuple("ABCDEF"))]
    assert len({str(line.get_color()) for line in lines}) == 6
    assert len({str(dashes) for _, dashes in STYLES}) >= 6


def test_a_design_without_gains_has_its_column_and_no_lines() -> None:
    nothing = {"met": False, "achieved": None, "outcome": None, "score": None, "worst": None, "proof": None}
    said = {
        "gains": None, "status": "failed", "objective": None, "stability": None, "nominal": None,
        "requirements": [{**each, **nothing} for each in check(PI)["requirements"]],
        "proof": {"verdict": "not_attempted", "reason": "there are no gains"},
        "message": "", "advice": "", "clash": [],
    }  # fmt: skip
    named = [("a", documents(ROBUST_BRAKE)), ("b", documents(PI, **said))]
    page = "".join(Page(str(comparison_files(named)["compare.html"])).text)
    assert "Not drawn, for there is no loop: B brake (b)." in page
    assert not any(re.search("better|alike|closer", sentence) for sentence in compare_designs(named).sentences)


def test_hostile_names_are_shown_and_not_obeyed() -> None:
    names = (HOSTILE + "$x^2$\n\x07\udcff", "b" * 10_000)
    files = comparison_files([(name, documents(ROBUST_BRAKE)) for name in names])
    page = Page(str(files["compare.html"]))
    assert page.open == []
    assert (page.tags["script"], page.tags["img"]) == (page.figures_scripts, 0)
    assert all(text.encode() for text in page.text)
    assert "b" * 28 + "..." + "b" * 28 in "".join(page.text)
    for name, content in files.items():
        if name.endswith(".svg"):
            assert ElementTree.fromstring(str(content)).tag.endswith("svg")


def prove(folder: str, gains: FoPi, spec: str = "brake.yaml") -> None:
    words = ["prove", spec, "--kp", str(gains.kp), "--ki", str(gains.ki), "--alpha", str(gains.alpha), "--out", folder]
    assert CliRunner().invoke(app, words).exit_code in (0, 1)


def compare(*words: str) -> tuple[int, str, str]:
    ran = CliRunner().invoke(app, ["report", "--compare", *words])
    return ran.exit_code, ran.stdout, ran.stderr


@pytest.fixture
def results(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Folders `tuned` and `published`, made by the command."""
    monkeypatch.chdir(tmp_path)
    Path("brake.yaml").write_text(BRAKE, encoding="utf-8")
    prove("tuned", ROBUST_BRAKE)
    prove("published", PUBLISHED_BRAKE)
    return tmp_path


def test_the_command_compares_folders_with_gains_from_anywhere(results: Path) -> None:
    code, printed, _ = compare("tuned", "published")
    assert (code, printed) == (0, "results/compare/compare.html\n")
    page = "".join(Page((results / printed.strip()).read_text(encoding="utf-8")).text)
    assert "A brake (tuned); B brake (published)" in page
    assert "violated; proof: refuted" in page
    names = {path.name for path in (results / "results" / "compare" / "figures").iterdir()}
    stems = ("bode", "margins", "responses", "sensitivities")
    assert names == {f"compare_{stem}.{kind}" for stem in stems for kind in ("svg", "png")}


def test_a_design_and_a_check_of_one_folder_are_told_apart_by_their_files(results: Path) -> None:
    tuned = CliRunner().invoke(app, ["tune", "brake.yaml", "--no-proof", "--out", "published"])
    assert tuned.exit_code == 0
    code, printed, _ = compare("published/design.json", "published/check.json", "--out", "page")
    assert (code, printed) == (0, "page/compare.html\n")
    page = "".join(Page((results / printed.strip()).read_text(encoding="utf-8")).text)
    assert "A brake (published/design.json); B brake (published/check.json)" in page
    _, _, said = compare("published", "tuned")
    assert "published: of the design; published/check.json is there too, name it to compare its gains" in said


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("tuned",), "--compare takes 2 to 6 designs, not 1"),
        (("tuned",) * 7, "--compare takes 2 to 6 designs, not 7"),
        (("tuned", "nowhere"), "nowhere"),
        (("tuned", "empty"), "spec.yaml"),
        (("tuned", "brake.yaml"), "brake.yaml: there is no design.json to read in results/brake"),
        (
            ("tuned", "stale"),
            "stale: check.json is of another spec, or this one's plant changed since; run `fopi prove` again",
        ),
        (("tuned", "broken"), "broken: check.json is no result of this tool"),
    ],
)
def test_what_cannot_be_compared_is_refused_with_the_reason(results: Path, words: tuple[str, ...], said: str) -> None:
    (results / "empty").mkdir()
    for name, spec, document in (("stale", BRAKE.replace("max: 3.1", "max: 3.2"), None), ("broken", BRAKE, "{}")):
        (results / name).mkdir()
        (results / name / "spec.yaml").write_text(spec, encoding="utf-8")
        made = (results / "tuned" / "check.json").read_text(encoding="utf-8")
        (results / name / "check.json").write_text(document or made, encoding="utf-8")
    code, printed, told = compare(*words)
    assert (code, printed) == (2, "")
    assert said in told
    assert "Traceback" not in told
    assert not (results / "results" / "compare").exists()


def test_results_with_holes_are_refused_and_not_a_failure_of_the_tool(results: Path) -> None:
    path = results / "published" / "check.json"
    document = json.loads(path.read_text(encoding="utf-8"))
    del document["stability"]
    path.write_text(json.dumps(document), encoding="utf-8")
    code, _, told = compare("tuned", "published")
    assert code == 2
    assert "published: check.json is not as this tool writes it: stability is missing; run `fopi prove` again" in told
