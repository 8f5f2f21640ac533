"""The paper's claims and figures: the table from the record that a test holds against recomputing, the figures drawn.

`<!-- paper: claims -->` and `<!-- paper: figures -->` in a page stand for them.
"""

from __future__ import annotations

import csv
import re
from html import escape
from pathlib import Path
from typing import Any

from sphinx.application import Sphinx

_PLACE = re.compile(r"^<!-- paper: (claims|figures) -->$", re.MULTILINE)
#: `fopi study studies/paper.yaml` computes the same lines; tests/paper/test_claims.py compares every number
_RECORD = Path(__file__).parents[2] / "tests" / "cases" / "golden_paper.csv"
_FOLDER = "figures"


def claims() -> str:
    """A table for each group of claims, and how many have which verdict."""
    from fopi_tune.paper import Row, Verdict, paper_markdown

    groups: dict[str, list[Row]] = {}
    with _RECORD.open(encoding="utf-8", newline="") as file:
        for line in csv.DictReader(file):
            row = Row(line["claim"], line["published"], line["recomputed"], Verdict(line["verdict"]), line["why"])
            groups.setdefault(line["group"], []).append(row)
    # a name's underscore is no emphasis, "<=" no HTML
    return re.sub(r"([_<>*])", r"\\\1", paper_markdown(groups)).replace("## ", "### ")


def figures(folder: Path) -> str:
    """Draws every figure into a folder; HTML that shows them, each with its title and its description in words."""
    from fopi_tune.paper import PICTURES, svg_of

    folder.mkdir(parents=True, exist_ok=True)
    parts = []
    for name, make in PICTURES.items():
        picture = make()
        (folder / f"{name}.svg").write_text(svg_of(picture), encoding="utf-8")
        said = escape(picture.description)
        parts.append(
            f'<figure><img src="{folder.name}/{name}.svg" alt="{said}" width="700">'
            f"<figcaption><b>{escape(picture.title)}.</b> {said}</figcaption></figure>"
        )
    return "\n\n".join(["```{raw} html", *parts, "```"])


def _fill(app: Sphinx, page: str, text: list[str]) -> None:
    def made(found: re.Match[str]) -> str:
        return claims() if found[1] == "claims" else figures(Path(app.outdir) / _FOLDER)

    text[0] = _PLACE.sub(made, text[0])


def setup(app: Sphinx) -> dict[str, Any]:
    """Fills the places in pages before they are read."""
    app.connect("source-read", _fill)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
