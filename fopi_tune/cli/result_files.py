"""Files of a result:  what it holds (`data_files`) and its figures -> (file name, content), in the order of writing.

The spec is written first and the document that states the gains last.  Whenever writing ends early, a design with its
own spec beside it means that all its other files are there, of this result; every other state is refused or told.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from fopi_tune.results.saved.names import CONTROLLER_FIGURE, SPEC, TRADEOFF, simulation_kind

if TYPE_CHECKING:
    from fopi_tune.prices import Tradeoff
    from fopi_tune.results.design import Check, Design, Discretized, Run, Validated
    from fopi_tune.results.proved_system import ProvedSystem
    from fopi_tune.results.simulation import ScenarioResult, Simulated
    from fopi_tune.results.system import DiscretizedSystem, SimulatedSystem, ValidatedSystem
    from fopi_tune.results.system_design import DesignedSystem

    Result = (
        Design | Check | Discretized | Run | Validated | Simulated | Tradeoff | SimulatedSystem | ValidatedSystem
        | DesignedSystem | ProvedSystem | DiscretizedSystem
    )  # fmt: skip


def files_of(result: Result) -> Iterator[tuple[str, str | bytes]]:
    """The files of a result.

    Raises:
        DomainError: the controller cannot be exported as code.
    """
    held = dict(result.data_files())
    if SPEC in held:
        yield SPEC, held.pop(SPEC)
    yield from _figures_of(result)
    yield from held.items()


def _figures_of(result: Result) -> Iterator[tuple[str, str]]:
    from fopi_tune.results.design import Discretized, Run

    if isinstance(result, Discretized):
        yield CONTROLLER_FIGURE, _controller_figure(result)
    elif isinstance(result, Run) and result.digital is not None:
        yield CONTROLLER_FIGURE, _controller_figure(result.digital)
    elif type(result).__name__ in _OTHERS_WITH_FIGURES:
        yield from _other_figures(result)


#: classes whose modules are loaded for them alone
_OTHERS_WITH_FIGURES = ("Simulated", "SimulatedSystem", "Tradeoff")


def _other_figures(result: Result) -> Iterator[tuple[str, str]]:
    from fopi_tune.prices.result import Tradeoff
    from fopi_tune.results.simulation import Simulated
    from fopi_tune.results.system import SimulatedSystem

    if isinstance(result, Tradeoff):
        from fopi_tune.report import tradeoff_svg

        yield f"{TRADEOFF}.svg", tradeoff_svg(result)
    elif isinstance(result, Simulated | SimulatedSystem):
        for driven in result.driven:
            yield f"{simulation_kind(result.exact)}_{driven.scenario.name}.svg", _simulation_figure(result, driven)


def _simulation_figure(result: Simulated | SimulatedSystem, driven: ScenarioResult) -> str:
    from fopi_tune.report import simulation_svg

    return simulation_svg(result, driven)


def _controller_figure(result: Discretized) -> str:
    from fopi_tune.report import controller_bode_svg

    return controller_bode_svg(result)
