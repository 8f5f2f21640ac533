"""Formulas as MathML, which browsers draw by themselves: a page needs no script and no network for them."""

from __future__ import annotations

from typing import Any

from docutils import nodes
from latex2mathml.converter import convert
from sphinx.application import Sphinx
from sphinx.errors import ExtensionError
from sphinx.writers.html5 import HTML5Translator

#: what the converter does not know, or draws without the space that belongs to it
_INSTEAD = {
    "\\arg": "\\operatorname{arg}",
    "\\lvert": "\\left|",
    "\\rvert": "\\right|",
    "\\mathrm": "\\operatorname",
}


def mathml(latex: str, display: str) -> str:
    """A formula in LaTeX as MathML.

    Args:
        latex: one line of it; what it does not know is refused rather than shown as it is written.
        display: "inline" or "block".

    Raises:
        ExtensionError: there is a command or an alignment that the converter does not know.
    """
    for word, instead in _INSTEAD.items():
        latex = latex.replace(word, instead)
    found = convert(latex, display=display)
    if "\\" in found or "<mi>&</mi>" in found:
        raise ExtensionError(f"this formula cannot be written as MathML: {latex}")
    return found


def _inline(self: HTML5Translator, node: nodes.math) -> None:
    self.body.append(f'<span class="math">{mathml(node.astext(), "inline")}</span>')
    raise nodes.SkipNode


def _block(self: HTML5Translator, node: nodes.math_block) -> None:
    self.body.append(f'<div class="math">{mathml(node.astext(), "block")}</div>')
    raise nodes.SkipNode


def setup(app: Sphinx) -> dict[str, Any]:
    """Registers the renderer `mathml`."""
    app.add_html_math_renderer("mathml", (_inline, None), (_block, None))
    return {"parallel_read_safe": True, "parallel_write_safe": True}
