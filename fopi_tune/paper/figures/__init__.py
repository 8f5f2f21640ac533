"""The figures by name, in the order of the paper."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from importlib import import_module

from fopi_tune.errors import DomainError
from fopi_tune.report.figures.picture import Picture, png_of, svg_of

#: name -> module that draws it, with a function of its name
_MODULES = {
    "bode_brake": "bode",
    "bode_family": "bode",
    "filter_responses": "bode",
    "switching": "time_domain",
    "manoeuvre": "time_domain",
    "experiment_1": "time_domain",
    "experiment_2": "time_domain",
    "alpha_against_pi": "time_domain",
}


def _picture(name: str) -> Callable[[], Picture]:
    def made() -> Picture:
        return getattr(import_module(f"fopi_tune.paper.figures.{_MODULES[name]}"), name)()

    return made


def _svg(name: str) -> Callable[[], str]:
    def made() -> str:
        return svg_of(PICTURES[name]())

    return made


#: name -> the figure before it is drawn
PICTURES: Mapping[str, Callable[[], Picture]] = {name: _picture(name) for name in _MODULES}
#: name -> SVG text
FIGURES: Mapping[str, Callable[[], str]] = {name: _svg(name) for name in _MODULES}


def figure_png(name: str) -> bytes:
    """A figure as PNG bytes.

    Args:
        name: a key of `FIGURES`.

    Raises:
        DomainError: there is no such figure.
    """
    if name not in PICTURES:
        raise DomainError(f"there is no figure {name!r}; there is {', '.join(PICTURES)}")
    return png_of(PICTURES[name]())
