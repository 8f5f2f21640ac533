"""How the pages are built: `sphinx-build -W -b html docs build/docs`.  Nothing here needs a network."""

import logging
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent / "_ext"))
# the checkout's package where none is installed: what an installed one has compiled is then used again
sys.path.append(str(Path(__file__).parents[1]))

from fopi_tune import __version__

# a style of colours makes all logs be printed, and what is printed is a warning of the pages
logging.getLogger("fopi_tune").setLevel(logging.WARNING)

project = "fopi-tune"
author = "the fopi-tune authors"
copyright = "the fopi-tune authors"
release = version = __version__
html_title = f"fopi-tune {release}"
html_theme = "furo"
html_static_path: list[str] = ["_static"]
html_css_files = ["pages.css"]
# the search index has the text already
html_copy_source = False
html_show_sourcelink = False

extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "sphinx.ext.napoleon",
    "docstrings",
    "language",
    "mathml",
    "reproduction",
]
exclude_patterns = ["_ext"]
myst_enable_extensions = ["dollarmath", "attrs_inline"]
myst_heading_anchors = 3
html_math_renderer = "mathml"

autodoc_member_order = "bysource"
autodoc_typehints = "signature"
autodoc_typehints_format = "short"
autodoc_class_signature = "mixed"
napoleon_numpy_docstring = False
# types in signatures are read, not followed
nitpicky = False
