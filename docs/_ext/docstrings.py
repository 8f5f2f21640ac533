"""The package's docstrings as reStructuredText: what is plain text there, such as |L|, stays plain text here."""

from __future__ import annotations

import re
from typing import Any

from sphinx.application import Sphinx

_CODE = re.compile(r"`([^`]+)`")


def escaped(line: str) -> str:
    """A line with `code` as literal text, and with |L|, s*, name_ as they are written."""
    parts = _CODE.split(line)
    # code is every second part
    return "".join(
        f"``{part}``" if i % 2 else re.sub(r"([|*\\]|_(?!\w))", r"\\\1", part) for i, part in enumerate(parts)
    )


def _escape(app: Sphinx, what: str, name: str, obj: Any, options: Any, lines: list[str]) -> None:
    lines[:] = [escaped(line) for line in lines]


def setup(app: Sphinx) -> dict[str, Any]:
    """Escapes before the sections `Args:` and so on are read."""
    app.connect("autodoc-process-docstring", _escape, priority=100)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
