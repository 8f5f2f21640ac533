"""Registries of claims and figures:  module and name -> function.

A registry is a module with CLAIMS (name to a function that gives rows) and FIGURES (name to a function that gives SVG);
where it has PICTURES too (name to a function that gives a picture), with svg_of and png_of, a figure is both.  It is
named by text, which is sent to a worker.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from importlib import import_module
from typing import Any

#: the registry of the paper
REGISTRY = "fopi_tune.paper"


def entries(registry: str, what: str) -> Mapping[str, Callable[[], Any]]:
    """CLAIMS or FIGURES of a registry; empty where there is no such module or mapping."""
    try:
        return getattr(import_module(registry), what, {})
    except ModuleNotFoundError as error:
        if error.name is not None and registry.startswith(error.name):
            return {}
        raise


def render_figure(registry: str, name: str) -> dict[str, str | bytes]:
    """Draw a figure: file name to content."""
    pictures = entries(registry, "PICTURES")
    if name not in pictures:
        return {f"{name}.svg": entries(registry, "FIGURES")[name]()}
    module, picture = import_module(registry), pictures[name]()
    return {f"{name}.svg": module.svg_of(picture), f"{name}.png": module.png_of(picture)}


def entry_names(registry: str, what: str) -> tuple[str, ...]:
    """The names of all entries, in order."""
    return tuple(entries(registry, what))
