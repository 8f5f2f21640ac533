"""Signals of a few plants and their derivatives by the controller's numbers, by differences of the simulation itself.

With a step h of a number x that lies inside its range, and next to an end of it, to the inside,

    dy/dx = (y(x + h) - y(x - h))/(2 h),       dy/dx = (4 y(x + h) - y(x + 2 h) - 3 y(x))/(2 h) ,                   (1)

both exact to h^2.  So whatever the simulation knows, each structure, filter and limit, is designed for as it runs, and
a filter that depends on the crossover moves with it.  Where a signal has a kink, as at a limit of the control, (1) is
between the two slopes.

Source: Fornberg, Mathematics of Computation 51, 1988, table 1 and 3.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields

import numpy as np

from fopi_tune.core.bode_form import Array
from fopi_tune.simulation.scenario import Traces

#: h in sizes of the number: what (1) leaves out, h^2, is as small as what rounding leaves, 1e-16/h
_STEP = 1e-5
#: an output that grows beyond this does not end; differences of it are still numbers
_ENDLESS = 1e100


@dataclass(frozen=True, eq=False)
class Trajectories:
    """Signals of m plants, as in `simulation.scenario.Traces`, and their derivatives.

    Every array has the shape (m, steps, 1 + n): the value, and the derivatives by n numbers of the controller.

    Args:
        output: y just before the new control acts; shape (m, steps, 1 + n).
        rate: dy/dt there, per s.
        rate_after: dy/dt just after a new input arrives, per s.
        applied: the actuator's output from this sample on, undelayed; shape (m, steps, 1 + n).
    """

    output: Array
    rate: Array
    rate_after: Array
    applied: Array


def trajectories(
    simulated: Callable[[Array], Traces], x: Array, sizes: Array, box: tuple[Array, Array]
) -> Trajectories | None:
    """The signals at x and their derivatives, those by a number without a range 0; None where they grow without end.

    Args:
        simulated: the signals at some numbers, shape (n,).
        x: the numbers, inside their ranges.
        sizes: of the numbers, shape (n,).
        box: their ranges, shapes (n,).

    Raises:
        DomainError: there is no digital controller at x or next to it.
    """
    here = simulated(x)
    if not np.abs(here.output).max() < _ENDLESS:
        return None
    names = [each.name for each in fields(Trajectories)]
    found = {name: [getattr(here, name)] for name in names}
    for j, weights in enumerate(_differences(x, sizes, box)):
        ends = [(weight, here if move == 0.0 else simulated(_moved(x, j, move))) for move, weight in weights]
        for name in names:
            parts = [weight * getattr(end, name) for weight, end in ends]
            found[name].append(np.sum(parts, axis=0) if parts else np.zeros_like(getattr(here, name)))
    return Trajectories(**{name: np.stack(parts, axis=-1) for name, parts in found.items()})


def _differences(x: Array, sizes: Array, box: tuple[Array, Array]) -> list[tuple[tuple[float, float], ...]]:
    """(1) for each number: moves and the weights of the signals there; none of a number without a range."""
    found: list[tuple[tuple[float, float], ...]] = []
    for value, size, low, high in zip(x.tolist(), sizes.tolist(), *(end.tolist() for end in box), strict=True):
        h = min(_STEP * size, 0.25 * (high - low))
        if h == 0.0:
            found.append(())
        elif low <= value - h and value + h <= high:
            found.append(((h, 0.5 / h), (-h, -0.5 / h)))
        else:
            h = h if value - h < low else -h
            found.append(((h, 2.0 / h), (2.0 * h, -0.5 / h), (0.0, -1.5 / h)))
    return found


def _moved(x: Array, j: int, move: float) -> Array:
    moved = x.copy()
    moved[j] += move
    return moved
