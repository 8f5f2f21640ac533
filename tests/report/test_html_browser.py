"""The pages in a real browser, without network: the slider, the policy, widths, print, what a screen reader is told.

They are skipped where Playwright or a Chromium of the system is missing.
"""

from __future__ import annotations

import io
import itertools
import json
import re
import shutil
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any

import pytest
from cases import switched
from cases.pages import HOSTILE
from cases.plain_figures import RENDERED_BY, drawn_alone
from cases.plants import PUBLISHED_BRAKE, ROBUST_BRAKE
from cases.project import CONTINUOUS
from cases.reports import BRAKE, brake_page, without_gains
from cases.study_tables import result_of

import fopi_tune as ft
from fopi_tune.report.comparison_page import comparison_files
from fopi_tune.report.documents import documents_of, documents_of_run
from fopi_tune.report.html import report_files
from fopi_tune.report.study_page import study_page_files
from fopi_tune.report.system_page import system_report_files
from fopi_tune.report.words import name_and_unit
from fopi_tune.spec import parse_spec
from fopi_tune.spec.model import Sense
from fopi_tune.study.model import BestRule

playwright = pytest.importorskip("playwright.sync_api", reason="the package playwright is not installed")

PROGRAMS = ("chromium", "chromium-browser", "google-chrome")
#: nothing but files: no name is resolved, nothing is fetched behind the page's back
FLAGS = (
    "--no-sandbox",
    "--disable-gpu",
    "--disable-dev-shm-usage",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--no-first-run",
    "--host-resolver-rules=MAP * ~NOTFOUND",
)
CURVES = ("gain", "phase", "nyquist", "step")
PIXELS = """() => [document.documentElement.scrollWidth, document.documentElement.clientWidth]"""


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    program = next(filter(None, map(shutil.which, PROGRAMS)), None)
    if program is None:
        pytest.skip(f"no browser to test with: none of {', '.join(PROGRAMS)} is installed")
    with playwright.sync_playwright() as tool:
        started = tool.chromium.launch(executable_path=program, args=list(FLAGS))
        yield started
        started.close()


class Visit:
    """A page that was opened, and everything it said or asked for."""

    def __init__(self, browser: Any, path: Path, text: str, width: int = 1280) -> None:
        path.write_text(text, encoding="utf-8")
        self.address = path.as_uri()
        self.said: list[str] = []
        self.asked: list[str] = []
        self.page = browser.new_page(viewport={"width": width, "height": 900})
        self.page.on("console", lambda message: self.said.append(message.text))
        self.page.on("pageerror", lambda error: self.said.append(str(error)))
        self.page.on("dialog", lambda dialog: (self.said.append(dialog.message), dialog.dismiss()))
        self.page.on("request", lambda request: self.asked.append(request.url))
        self.page.goto(self.address)

    def __enter__(self) -> Visit:
        return self

    def __exit__(self, *_: object) -> None:
        self.page.close()

    def curves(self) -> list[str]:
        """What the slider moves."""
        return [self.page.get_attribute(f"#moved-{key}", "d") for key in CURVES]


@cache
def comparison_page() -> str:
    spec = parse_spec(BRAKE)
    named = [
        (name, documents_of(spec, json.loads(json.dumps(ft.prove(spec, gains).to_dict()))))
        for name, gains in (("tuned", ROBUST_BRAKE), ("published", PUBLISHED_BRAKE))
    ]
    return str(comparison_files(named)["compare.html"])


@cache
def system_page() -> str:
    return str(system_report_files(switched.certificate("held"))["system_report.html"])


@cache
def study_page() -> str:
    rows = [({"plant.time_constant_s.max": a, "b": b}, "met", {"iae": a * b}) for a in (1.0, 2.0) for b in (1.0, 3.0)]
    return str(study_page_files(result_of(rows, BestRule(Sense.MINIMIZE, "iae")))["report.html"])


def hostile_page(words: str) -> str:
    text = re.sub(r"^description:.*$", lambda _: f"description: {json.dumps(words)}", BRAKE, flags=re.MULTILINE)
    return str(report_files(without_gains(text, message=words))["report.html"])


def colours(png: bytes) -> int:
    from PIL import Image

    with Image.open(io.BytesIO(png)) as image:
        return len(image.convert("RGB").getcolors(1_000_000) or ())


def test_a_report_says_nothing_to_the_console_and_asks_for_nothing_but_itself(browser: Any, tmp_path: Path) -> None:
    with Visit(browser, tmp_path / "report.html", brake_page()) as visit:
        visit.page.wait_for_load_state("networkidle")
        assert visit.said == []
        assert visit.asked == [visit.address]


def test_the_policy_stops_a_script_that_is_not_the_pages_own(browser: Any, tmp_path: Path) -> None:
    text = brake_page().replace("</body>", "<script>document.title = 'changed'</script></body>")
    with Visit(browser, tmp_path / "report.html", text) as visit:
        assert visit.page.title() == "brake: design report"
        assert any("Content Security Policy" in words for words in visit.said)


def test_keys_move_the_slider_and_every_curve(browser: Any, tmp_path: Path) -> None:
    data = json.loads(re.findall(r'id="curves">(.*?)</script>', brake_page(), re.DOTALL)[0])
    last = len(data["labels"]) - 1
    with Visit(browser, tmp_path / "report.html", brake_page()) as visit:
        nominal = int(visit.page.input_value("#slider"))
        seen = [visit.curves()]
        visit.page.focus("#slider")
        for key, k in (("ArrowRight", nominal + 1), ("Home", 0), ("End", last), ("ArrowLeft", last - 1)):
            visit.page.keyboard.press(key)
            seen.append(visit.curves())
            assert seen[-1] == [data["curves"][key][k] for key in CURVES]
            assert visit.page.inner_text("#slider-value") == data["labels"][k]
            assert visit.page.get_attribute("#slider", "aria-valuetext") == data["labels"][k]
        for before, after in itertools.pairwise(seen):
            assert all(a != b for a, b in zip(before, after, strict=True))
        assert visit.said == []


def test_every_uncertain_number_can_be_chosen_and_moved(
    browser: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # the slider's panels are none of the figures that are rendered
    monkeypatch.setattr(RENDERED_BY, drawn_alone)
    three = (CONTINUOUS / "lag_gain_and_delay.yaml").read_text(encoding="utf-8")
    spec = parse_spec(three.replace("{nominal: 2.25, min: 1.6, max: 3.1}", "2.25"))
    assert len(spec.plant.uncertain_names) == 2
    text = str(report_files(documents_of_run(ft.run(spec, proof=False)))["report.html"])
    data = json.loads(re.findall(r'id="curves">(.*?)</script>', text, re.DOTALL)[0])
    with Visit(browser, tmp_path / "report.html", text) as visit:
        usual = visit.curves()
        for index, name in enumerate(spec.plant.uncertain_names):
            called, unit = name_and_unit(name)
            visit.page.select_option("#number", label=called)
            first, last, nominal = data["places"][index]
            # the nominal plant, whichever number is to be moved
            assert visit.curves() == usual
            assert visit.page.get_attribute("#slider", "aria-valuetext") == data["labels"][nominal]
            for key, place, end in (("Home", first, spec.plant.low), ("End", last, spec.plant.high)):
                visit.page.focus("#slider")
                visit.page.keyboard.press(key)
                label = f"{called} = {float(end[index]):.4g}{unit}"
                assert visit.page.inner_text("#slider-value") == data["labels"][place] == label
                assert visit.page.inner_text("#slider-first" if key == "Home" else "#slider-last") == label
                assert visit.curves() == [data["curves"][each][place] for each in CURVES]
                # a gain turns no phase, a dead time changes no gain
                still = {"static_gain": ["phase"], "dead_time_s": ["gain"]}.get(name, [])
                assert [key for key, a, b in zip(CURVES, visit.curves(), usual, strict=True) if a == b] == still
        assert visit.said == []


def test_the_pointer_moves_the_slider_and_what_is_seen(browser: Any, tmp_path: Path) -> None:
    with Visit(browser, tmp_path / "report.html", brake_page()) as visit:
        panels = visit.page.locator(".panels")
        before, shown = visit.curves(), panels.screenshot()
        box = visit.page.locator("#slider").bounding_box()
        visit.page.mouse.click(box["x"] + 0.05 * box["width"], box["y"] + 0.5 * box["height"])
        assert all(a != b for a, b in zip(before, visit.curves(), strict=True))
        assert panels.screenshot() != shown


def test_a_screenshot_is_made_and_not_blank(browser: Any, tmp_path: Path) -> None:
    with Visit(browser, tmp_path / "report.html", brake_page()) as visit:
        visit.page.screenshot(path=tmp_path / "report.png", full_page=True)
        # letters alone have the greys of their edges; the lines and bands of figures have colours
        assert colours((tmp_path / "report.png").read_bytes()) > 100
        visit.page.set_content("<!DOCTYPE html><title>empty</title>")
        assert colours(visit.page.screenshot()) == 1


@pytest.mark.thinned(2)
@pytest.mark.parametrize("width", [1280, 400])
@pytest.mark.parametrize("make", [brake_page, comparison_page, system_page, study_page])
def test_no_page_is_wider_than_its_window(browser: Any, tmp_path: Path, make: Any, width: int) -> None:
    with Visit(browser, tmp_path / "page.html", make(), width) as visit:
        scroll, client = visit.page.evaluate(PIXELS)
        assert scroll <= client
        assert visit.said == []
        assert visit.asked == [visit.address]


@pytest.mark.thinned(3)
@pytest.mark.parametrize("width", [1280, 400])
@pytest.mark.parametrize(
    "words", [(HOSTILE * 200)[:10_000], "W" * 10_000, "\"'" * 5_000], ids=["script", "one word", "quotes"]
)
def test_hostile_words_are_read_and_not_run(browser: Any, tmp_path: Path, words: str, width: int) -> None:
    with Visit(browser, tmp_path / "report.html", hostile_page(words), width) as visit:
        assert (visit.said, visit.asked) == ([], [visit.address])
        assert visit.page.locator(".description").text_content() == words
        assert visit.page.locator("script").count() == 0
        scroll, client = visit.page.evaluate(PIXELS)
        assert scroll <= client
        # the long text is in a box of its own: the verdict is on the first screen
        assert visit.page.locator(".status").first.bounding_box()["y"] < 900


def test_print_leaves_the_slider_out_and_every_figure_in(browser: Any, tmp_path: Path) -> None:
    with Visit(browser, tmp_path / "report.html", brake_page()) as visit:
        assert visit.page.locator("#slider").is_visible()
        visit.page.emulate_media(media="print")
        assert not visit.page.locator("#slider").is_visible()
        # what moves is left out; its curves at the nominal plant are in the figures too
        shown = [figure.is_visible() for figure in visit.page.locator("figure").all()]
        assert shown == [True, False] + [True] * 6
        assert visit.page.pdf(format="A4").startswith(b"%PDF")


@pytest.mark.parametrize(
    ("make", "pictures"), [(brake_page, 11), (comparison_page, 4), (system_page, 2), (study_page, 2)]
)
def test_a_screen_reader_is_told_of_every_figure(browser: Any, tmp_path: Path, make: Any, pictures: int) -> None:
    with Visit(browser, tmp_path / "page.html", make()) as visit:
        told = re.findall(
            r"""^\s*- '?(?:img|group) "(.*?)"'?:""", visit.page.locator("body").aria_snapshot(), re.MULTILINE
        )
        # the slider's four panels and seven figures; four figures; an orbit and a region
        assert len(told) == pictures
        assert all(len(words) > 40 for words in told)
        if make is brake_page:
            assert (
                visit.page.get_by_role("slider").get_attribute("aria-valuetext")
                == "time constant = 2.25\N{NO-BREAK SPACE}s"
            )
            assert visit.page.get_by_label(re.compile("^Slide from time constant = 1.6")).count() == 1


#: what every range of the page's layouts shows
RANGES = """() => Object.values(Bokeh.index.roots || Bokeh.index).flatMap((view) =>
  [...view.model.document._all_models.values()].filter((model) => model.type === "Range1d")
    .map((range) => [range.start, range.end]))"""
#: pixels for a unit of the real part, and of the imaginary one
SCALES = """() => {
  const below = (view) => [...(view.child_views || []), ...(view.grid_view ? [view.grid_view] : [])];
  const all = (view) => [view, ...below(view).flatMap(all)];
  const views = [...Bokeh.index.roots].flatMap(all);
  const plane = views.find((view) => view.model.type === "Figure" && view.model.aspect_ratio === 1);
  const { x_range, y_range } = plane.model;
  const { width, height } = plane.frame.bbox;
  return [width / (x_range.end - x_range.start), height / (y_range.end - y_range.start)];
}"""
#: the button of a name, wherever its shadow is
FOCUS = """(name) => {
  const find = (node) => {
    if (node.getAttribute && node.getAttribute("aria-label") === name && node.getAttribute("role") === "button") {
      return node;
    }
    const below = [...node.children, ...(node.shadowRoot ? node.shadowRoot.children : [])];
    for (const each of below) {
      const found = find(each);
      if (found) { return found; }
    }
    return null;
  };
  const button = find(document.getElementById("live-bode"));
  button.focus();
  return button.tabIndex;
}"""


def see_figure(visit: Visit, name: str) -> None:
    visit.page.locator(f"#live-{name}").evaluate("each => each.parentElement.scrollIntoView()")
    visit.page.locator(f"figure.shown #live-{name}").wait_for(state="attached")


def test_keys_zoom_a_figure_and_reset_it(browser: Any, tmp_path: Path) -> None:
    with Visit(browser, tmp_path / "report.html", brake_page()) as visit:
        see_figure(visit, "bode")
        before = visit.page.evaluate(RANGES)
        assert visit.page.evaluate(FOCUS, "Zoom In") == 0
        visit.page.keyboard.press("Enter")
        zoomed = visit.page.evaluate(RANGES)
        assert any(abs(b - a) < abs(d - c) for (a, b), (c, d) in zip(zoomed, before, strict=True))
        visit.page.evaluate(FOCUS, "Reset")
        visit.page.keyboard.press("Enter")
        assert visit.page.evaluate(RANGES) == before
        assert (visit.said, visit.asked) == ([], [visit.address])


@pytest.mark.parametrize("width", [1280, 400])
def test_a_plane_with_a_legend_keeps_its_angles_wide_and_narrow(browser: Any, tmp_path: Path, width: int) -> None:
    with Visit(browser, tmp_path / "report.html", brake_page(), width) as visit:
        see_figure(visit, "nyquist")
        across, up = visit.page.evaluate(SCALES)
        assert across == pytest.approx(up, rel=0.02)
        assert visit.said == []


def test_figures_are_there_without_scripts(browser: Any, tmp_path: Path) -> None:
    path = tmp_path / "report.html"
    path.write_text(brake_page(), encoding="utf-8")
    page = browser.new_context(java_script_enabled=False).new_page()
    page.goto(path.as_uri())
    assert page.locator("figure .still svg").count() == 7
    assert all(each.is_visible() for each in page.locator("figure .still svg").all())
    page.close()


@pytest.mark.thinned(2)
@pytest.mark.parametrize("make", [brake_page, comparison_page, system_page, study_page])
def test_pages_have_no_serious_violation_of_accessibility(browser: Any, tmp_path: Path, make: Any) -> None:
    axe = pytest.importorskip("axe_playwright_python.sync_playwright", reason="axe-playwright-python is not installed")
    # axe is a script of its own, which the page's policy would stop
    text = re.sub(r"<meta http-equiv[^>]*>", "", make())
    with Visit(browser, tmp_path / "page.html", text) as visit:
        for figure in visit.page.locator("figure[data-live]").all():
            figure.scroll_into_view_if_needed()
        visit.page.wait_for_function("document.querySelectorAll('figure[data-live]:not(.shown)').length === 0")
        found = axe.Axe().run(visit.page).response["violations"]
        serious = [each for each in found if each["impact"] in ("serious", "critical")]
        assert [(each["id"], [node["html"] for node in each["nodes"]]) for each in serious] == []
