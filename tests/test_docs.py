"""The pages keep their word: they build without a warning and without a network, and all that is in them runs."""

from __future__ import annotations

import ast
import json
import os
import re
import shutil
import subprocess
import sys
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit

import pytest
from cases.markdown_pages import ROOT, blocks_of, copy_the_clone, load, looks_like, run_page, unknown_words
from cases.project import IMPORTED

import fopi_tune
from fopi_tune.cli.starting.init import Model
from fopi_tune.core.plant import PLANT_MODELS
from fopi_tune.paper import CLAIMS, FIGURES
from fopi_tune.quantities import QUANTITIES
from fopi_tune.quantities.objectives import OBJECTIVES
from fopi_tune.spec.model import MEASURES, Relation

DOCS = ROOT / "docs"
PAGES = {path.relative_to(DOCS).with_suffix("").as_posix(): path for path in sorted(DOCS.rglob("*.md"))}
CODE = {name: blocks_of(path.read_text(encoding="utf-8")) for name, path in PAGES.items()}
#: commands that a page needs and that do not come with the package
NEEDS = {"howto/c_on_target": ("gcc", "make")}
#: pages whose commands take half a minute each, and are run with `-m long`
LONG_PAGES = ["paper", "tutorial", "api"]
LONG_PAGES += [f"howto/{name}" for name in ("comfort", "what_a_limit", "own_plant", "two_loops", "fractional_plant")]
LONG_PAGES += [
    f"howto/{name}" for name in ("c_on_target", "derivative", "reports", "dask", "batch", "evidence", "python", "where")
]


class Page(HTMLParser):
    """What a built page has: its ids, its links, what it loads, and its text."""

    def __init__(self, path: Path) -> None:
        super().__init__()
        self.ids: set[str] = set()
        self.links: list[str] = []
        self.loaded: list[str] = []
        self.words: list[str] = []
        self.feed(path.read_text(encoding="utf-8"))

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        told = {name: value or "" for name, value in attrs}
        self.ids |= {told["id"]} if "id" in told else set()
        if tag == "a" and "href" in told:
            self.links.append(told["href"])
        elif tag == "link" and told.get("rel") in ("stylesheet", "icon", "preload", "shortcut icon", "preconnect"):
            self.loaded.append(told["href"])
        self.loaded += [told[name] for name in ("src", "srcset", "data", "poster") if told.get(name)]

    def handle_data(self, data: str) -> None:
        self.words.append(data)

    @property
    def text(self) -> str:
        """What a reader sees, and the page's scripts."""
        return "".join(self.words)


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The pages as HTML, built with every warning an error."""
    folder = tmp_path_factory.mktemp("docs")
    # with the package that these tests have imported: the checkout's would be compiled again
    environment = os.environ | {"PYTHONPATH": str(IMPORTED), "PYTHONSAFEPATH": "1"}
    command = [sys.executable, "-m", "sphinx", "-q", "-W", "--keep-going", "-b", "html"]
    done = subprocess.run(
        [*command, "-d", str(folder / "trees"), str(DOCS), str(folder / "html")],
        capture_output=True,
        text=True,
        check=False,
        env=environment,
    )
    assert done.returncode == 0, done.stderr
    assert done.stderr == ""
    return folder / "html"


def test_every_page_is_built_and_every_link_between_them_leads_somewhere(built: Path) -> None:
    pages = {path.relative_to(built).as_posix(): Page(path) for path in built.rglob("*.html")}
    assert {f"{name}.html" for name in PAGES} <= set(pages)
    for name, page in pages.items():
        for link in page.links:
            to = urlsplit(link)
            if to.scheme:
                continue
            target = (built / name).parent.joinpath(unquote(to.path)).resolve() if to.path else built / name
            assert target.is_file(), f"{name} links {link}"
            if to.fragment and target.suffix == ".html":
                ids = pages[target.relative_to(built.resolve()).as_posix()].ids if to.path else page.ids
                assert unquote(to.fragment) in ids, f"{name} links {link}"


def test_no_page_loads_anything_from_a_network(built: Path) -> None:
    for path in built.rglob("*.html"):
        for loaded in Page(path).loaded:
            assert not urlsplit(loaded).scheme or loaded.startswith("data:"), f"{path.name} loads {loaded}"
            assert not loaded.startswith("//"), f"{path.name} loads {loaded}"
            assert loaded.startswith("data:") or (path.parent / urlsplit(loaded).path).is_file(), loaded
    for path in built.rglob("*.css"):
        loads = re.findall(r"@import[^;]+|url\(\s*['\"]?(?!data:)([^)'\"]+)", path.read_text(encoding="utf-8"))
        assert loads == [], path.name
    # formulas are MathML in the pages, which no script draws
    mathematics = (built / "mathematics.html").read_text(encoding="utf-8")
    assert mathematics.count("<math") > 50


def test_the_language_page_has_every_word_of_the_language(built: Path) -> None:
    page = Page(built / "spec.html").text
    objectives = [word for words in OBJECTIVES.values() for word in words]
    numbers = [name for model in PLANT_MODELS.values() for name in (*model.scalars, *model.lists)]
    relations = [relation.value for relation in Relation]
    words = [*QUANTITIES, *PLANT_MODELS, *objectives, *numbers, *relations, *MEASURES, "hysteresis", "limit_cells"]
    assert [word for word in words if re.search(rf"(?<!\w){word}(?!\w)", page) is None] == []
    # sections are filled in, and say what holds when a key is left out
    assert "language:" not in page
    assert "oustaloup" in page
    for quantity in QUANTITIES.values():
        assert " ".join(quantity.meaning.split()) in " ".join(page.split()), quantity.name


def test_the_library_page_has_every_public_name(built: Path) -> None:
    ids = Page(built / "api.html").ids
    wanted = [f"fopi_tune.{name}" for name in fopi_tune.__all__]
    # autodoc writes what is re-exported under the name that it is asked for
    assert [name for name in wanted if name not in ids] == []


def test_the_papers_page_has_every_claim_and_figure(built: Path) -> None:
    page = Page(built / "paper.html")
    headings = set(re.findall(r'id="([a-z0-9-]+)"', (built / "paper.html").read_text(encoding="utf-8")))
    assert {group.replace("_", "-") for group in CLAIMS} <= headings
    assert {f"figures/{name}.svg" for name in FIGURES} <= set(page.loaded)
    assert "63 claims. Holds: 11, holds with a condition: 14, does not hold: 29, not printed: 9." in page.text


def test_every_kind_of_plant_that_init_starts_from_is_told() -> None:
    page = PAGES["howto/own_plant"].read_text(encoding="utf-8")
    assert [model.value for model in Model if f"--plant {model.value}`" not in page] == []


@pytest.mark.parametrize("name", PAGES)
def test_commands_and_options_in_sentences_exist(name: str) -> None:
    assert unknown_words(PAGES[name].read_text(encoding="utf-8")) == []


@pytest.mark.parametrize("name", [name for name, code in CODE.items() if any(b.language == "yaml" for b in code)])
def test_specs_systems_and_studies_on_a_page_can_be_used(name: str, tmp_path: Path) -> None:
    copy_the_clone(tmp_path)
    for block in CODE[name]:
        if block.language == "yaml":
            file = tmp_path / (block.file or "page.yaml")
            file.write_text(block.text, encoding="utf-8")
            assert load(file), f"{name}:{block.line}"


@pytest.mark.thinned(slow=LONG_PAGES)
@pytest.mark.parametrize(
    "name", [name for name, code in CODE.items() if any(b.language in ("sh", "python") for b in code)]
)
def test_commands_and_programs_on_a_page_run_and_print_what_it_shows(name: str, tmp_path: Path) -> None:
    missing = [command for command in NEEDS.get(name, ()) if shutil.which(command) is None]
    if missing:
        pytest.skip(f"there is no command {missing[0]}")
    copy_the_clone(tmp_path)
    printed = dict(run_page(CODE[name], tmp_path))
    assert printed
    last = None
    for block in CODE[name]:
        if block in printed:
            last = printed[block]
        elif block.language == "text":
            assert last is not None, f"{name}:{block.line} shows what nothing printed"
            assert looks_like(last, block.text), f"{name}:{block.line} does not show what is printed:\n{last}"


def test_the_notebook_runs_and_its_cells_show_something(monkeypatch: pytest.MonkeyPatch) -> None:
    """Cells as a notebook runs them: a last expression is shown as HTML where it can be."""
    monkeypatch.setenv("MPLBACKEND", "Agg")
    names: dict[str, object] = {}
    shown = []
    for cell in json.loads((DOCS / "howto" / "brake.ipynb").read_text(encoding="utf-8"))["cells"]:
        if cell["cell_type"] != "code":
            continue
        assert cell["outputs"] == []
        program = ast.parse("".join(cell["source"]))
        last = program.body.pop()
        assert isinstance(last, ast.Expr)
        exec(compile(program, "cell", "exec"), names)
        value = eval(compile(ast.Expression(last.value), "cell", "eval"), names)
        shown.append(value._repr_html_() if hasattr(value, "_repr_html_") else repr(value))
    design, *_, evidence, sections = shown
    assert design.count("<td>proved</td>") == 3
    assert "all at once" in evidence
    assert sections.startswith("Sections(sample_time_s=0.2")


def test_a_page_that_shows_something_else_is_found_out(tmp_path: Path) -> None:
    assert looks_like("a\nb\nc\n", "a\n…\nc\n")
    assert looks_like("a\nc\n", "a\n…\nc\n")
    assert looks_like("a 1\nc\n", "a …\nc\n")
    assert not looks_like("a\nb\nc\n", "a\nc\n")
    assert not looks_like("a\nb\n", "a\n")
    assert not looks_like("a 1\nb\n", "a …\n")
    with pytest.raises(AssertionError):
        run_page(blocks_of("```sh\ntrue\nfalse\ntrue\n```\n"), tmp_path)


def test_every_fence_of_a_page_is_of_a_kind_that_is_tested() -> None:
    known = {"sh", "python", "text", "yaml", "c"}
    for name, path in PAGES.items():
        # the fence that ends a block has no word
        fences = re.findall(r"^```([^\n`]+)$", path.read_text(encoding="utf-8"), re.MULTILINE)
        own = [word for word in fences if word not in ("{toctree}", "{eval-rst}", "{include} ../CHANGELOG.md")]
        assert len(own) == len(CODE[name]), name
        assert {block.language for block in CODE[name]} <= known, name
