"""The paper's claims recomputed, each with its verdict, and the paper's figures.

    CLAIMS["brake"]()            the rows of one group of claims
    FIGURES["bode_brake"]()      a figure as SVG text
    figure_png("bode_brake")     the same figure as PNG bytes
    picture = PICTURES[...]()    computed once, then svg_of(picture), png_of(picture)
    paper_text(rows), paper_markdown(rows), paper_csv(rows)

Nothing here writes to the disk or prints, and nothing is cached: each call computes.
"""

from fopi_tune.paper.claims import CLAIMS
from fopi_tune.paper.figures import FIGURES, PICTURES, figure_png
from fopi_tune.paper.table import Row, Verdict, paper_csv, paper_markdown, paper_text, summary
from fopi_tune.report.figures.picture import Picture, png_of, svg_of

__all__ = [
    "CLAIMS",
    "FIGURES",
    "PICTURES",
    "Picture",
    "Row",
    "Verdict",
    "figure_png",
    "paper_csv",
    "paper_markdown",
    "paper_text",
    "png_of",
    "summary",
    "svg_of",
]
