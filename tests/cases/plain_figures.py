"""Figures of reports that are drawn but not rendered, for tests of something else: rendering takes seconds a report.

What is drawn wrongly still raises; SVG and PNG have the titles alone.  The real ones are tested in `tests/report/`.
"""

from __future__ import annotations

from html import escape

from fopi_tune.report.figures.picture import Picture

#: what reports call to render a figure
RENDERED_BY = "fopi_tune.report.page.every_form_of"


def drawn_alone(picture: Picture) -> tuple[str, bytes, str]:
    """In place of `every_form_of`."""
    # loaded here: plotting costs half a second
    from matplotlib.figure import Figure

    picture.draw(Figure(figsize=picture.size_inches))
    title, description = (escape(words, quote=False) for words in (picture.title, picture.description))
    svg = f'<svg xmlns="http://www.w3.org/2000/svg"><title>{title}</title><desc>{description}</desc></svg>\n'
    return svg, b"\x89PNG\r\n\x1a\n" + title.encode("utf-8", "replace"), ""
