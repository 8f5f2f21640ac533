"""Self-contained HTML pages:  figures and text into a template -> HTML; equal values give equal bytes.

Style, script, curves and figures are inside the page; its content security policy forbids to load anything else.
"""

from __future__ import annotations

import base64
import gc
import hashlib
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, TypeVar

from fopi_tune.errors import DomainError
from fopi_tune.report.figures.picture import Picture, every_form_of
from fopi_tune.report.words import in_words

#: type of what figures are drawn from
Source = TypeVar("Source")
#: the folder of a page's figures
FIGURES = "figures"


@dataclass(frozen=True)
class RenderedFigure:
    """A figure in the formats of pages and files.

    Args:
        name: of its files, without ending.
        title: one line.
        caption: its description.
        svg: to be embedded in HTML.
        svg_file: the content of an SVG file.
        png: the content of a PNG file.
        live: the JSON of the same for the pointer; empty without.
    """

    name: str
    title: str
    caption: str
    svg: str
    svg_file: str
    png: bytes
    live: str


def render_figures(
    pictures: Mapping[str, Callable[[Source], Picture | None]], source: Source
) -> Iterator[RenderedFigure]:
    """Draw the pictures that exist; those that cannot be computed are left out."""
    for name, make in pictures.items():
        try:
            picture = make(source)
        except DomainError:
            picture = None  # too many crossings to list: the figure is left out
        if picture is not None:
            with _collected_when_done():
                svg, png, live = every_form_of(picture)
            yield RenderedFigure(name, picture.title, picture.description, _inline(svg, name), svg, png, live)


@contextmanager
def _collected_when_done() -> Iterator[None]:
    """No search for cycles before the end: what it finds in use meanwhile would be kept until all figures are drawn.

    A figure's artists and models all refer to each other.
    """
    was_enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        gc.collect(0)
        if was_enabled:
            gc.enable()


def _inline(svg: str, name: str) -> str:
    """An SVG file as part of a page: with ids of its own, as figures share ids, and labelled for screen readers."""
    body = svg[svg.index("<svg") :]
    body = re.sub(r"\s*<metadata>.*?</metadata>", "", body, count=1, flags=re.DOTALL)
    body = re.sub(r'\bid="', f'id="{name}-', body)
    body = re.sub(r"url\(#", f"url(#{name}-", body)
    body = re.sub(r'(xlink:href|href)="#', rf'\1="#{name}-', body)
    body = body.replace("<title>", f'<title id="{name}-title">', 1).replace("<desc>", f'<desc id="{name}-desc">', 1)
    return body.replace("<svg", f'<svg role="img" aria-labelledby="{name}-title {name}-desc"', 1)


def figure_files(figures: Sequence[RenderedFigure]) -> dict[str, str | bytes]:
    """The files of figures, by name."""
    made: dict[str, str | bytes] = {}
    for each in figures:
        made |= {f"{FIGURES}/{each.name}.svg": each.svg_file, f"{FIGURES}/{each.name}.png": each.png}
    return made


def render_template(template: str, values: Mapping[str, Any]) -> str:
    """Fill a template; everything in `values` is escaped, except figures (lists of `RenderedFigure`).

    The filter `words` puts identifiers of the language into words.
    """
    # loaded here: only pages need it
    from jinja2 import Environment, PackageLoader, StrictUndefined
    from markupsafe import Markup

    loader = PackageLoader("fopi_tune.report", "templates")
    environment = Environment(
        loader=loader,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
        autoescape=True,
    )
    environment.filters["words"] = in_words
    slider, live, style = (loader.get_source(environment, name)[0] for name in ("slider.js", "live.js", "report.css"))
    figures = {
        key: [_for_template(each) for each in value]
        for key, value in values.items()
        if isinstance(value, list) and value and isinstance(value[0], RenderedFigure)
    }
    shown = any(each["live"] for drawn in figures.values() for each in drawn)
    library = plot_library() if shown else ""
    scripts = {"slider_script": slider, "live_script": live if shown else "", "plot_library": library}
    hashes = " ".join(f"'{_digest(script)}'" for script in scripts.values() if script)
    own = {name: Markup(script) for name, script in scripts.items()}
    own |= {"script_hashes": Markup(hashes), "style": Markup(style)}
    return environment.get_template(template).render({**values, **figures, **own})


def _for_template(figure: RenderedFigure) -> dict[str, str]:
    from markupsafe import Markup

    # no element ends inside a script's text
    live = Markup(figure.live.replace("<", "\\u003c"))
    return {
        "name": figure.name, "title": figure.title, "caption": figure.caption, "svg": Markup(figure.svg), "live": live,
    }  # fmt: skip


def plot_library() -> str:
    """The script of Bokeh, as its package brings it, that shows figures with zoom and values under the pointer."""
    from bokeh.resources import Resources

    # the first is the library; what follows only sets how much it tells to the console
    return Resources(mode="inline", components=["bokeh"], minified=True).js_raw[0]


def _digest(script: str) -> str:
    return f"sha256-{base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()}"
