"""A dense sample of a family's box, and loops on it.

Points of the box are normalised to x in [0, 1]^p.  A number whose range excludes 0 is scaled logarithmically.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from fopi_tune.core.bode_form import Array, Rows
from fopi_tune.core.controller import FoPi
from fopi_tune.core.loops import Loops, Plants
from fopi_tune.core.parallel_form import Implementation
from fopi_tune.core.plant import PlantFamily
from fopi_tune.core.sampled_loops import SampledLoops
from fopi_tune.errors import DomainError

#: m loops -> arrays (m,): value, frequency at which it is attained and, where it is counted, the work of each; nan
#: where a loop has no such value
LoopFunction = Callable[[Loops], tuple[Array, ...]]

#: grid points an axis, for one, two and three uncertain numbers
_GRID = {1: 65, 2: 17, 3: 9}
_MOST_CORNERS = 256
_SOBOL_POINTS = 1024
#: sets of places whose loops are kept
_MOST_KNOWN = 16
#: rows evaluated together, to limit the memory for crossings
_CHUNK = 1024


def with_work(value: Array, omega_rad_s: Array, work: int) -> tuple[Array, Array, Array]:
    """A `LoopFunction`'s result, from the work for all loops together."""
    return value, omega_rad_s, np.full(len(value), work / max(len(value), 1))


@dataclass(frozen=True)
class Sample:
    """Members of a family, with one controller.

    Args:
        family: the plants.
        gains: the controller.
        x: shape (m, p), normalised points of the members; grid points first, when there is a grid.
        per_axis: grid points an axis; 0 without a grid.
        nominal: the nominal member's row.
        implementation: the digital controller, of a loop on samples; None in continuous time.
        known: loops by the number and bytes of their places: searches for different quantities ask for the same ones.
        reference: the family whose nominal plant spreads are measured from; None for `family`.
    """

    family: PlantFamily
    gains: FoPi
    x: Array
    per_axis: int
    nominal: int
    implementation: Implementation | None = None
    known: dict[tuple[int, bytes], Loops] = field(default_factory=dict, compare=False, repr=False)
    reference: PlantFamily | None = None

    @classmethod
    def of(
        cls,
        family: PlantFamily,
        gains: FoPi,
        implementation: Implementation | None = None,
        reference: PlantFamily | None = None,
    ) -> Sample:
        """A grid with up to three uncertain numbers, else corners and a Sobol sequence; and the nominal member."""
        p = len(family.uncertain_names)
        per_axis = _GRID.get(p, 0)
        if p == 0:
            x = np.zeros((0, 0))
        elif per_axis:
            x = np.array(list(itertools.product(np.linspace(0.0, 1.0, per_axis), repeat=p)))
        else:
            x = np.concatenate([_corners(p), _sobol(p)])
        empty = cls(family, gains, x, per_axis, len(x), implementation, reference=reference)
        return replace(empty, x=np.concatenate([x, empty.nominal_x[None, :]]))

    @property
    def spacing(self) -> float:
        """Distance of neighbours in x."""
        return 1.0 / (self.per_axis - 1) if self.per_axis else 0.25

    @cached_property
    def nominal_x(self) -> Array:
        """Shape (p,), the nominal member's place."""
        low, high, nominal = self.family.low, self.family.high, self.family.nominal_point
        logarithmic = low * high > 0
        ratio = np.where(logarithmic, high / np.where(logarithmic, low, 1.0), np.e)
        position = np.where(logarithmic, nominal / np.where(logarithmic, low, 1.0), 1.0)
        return np.where(logarithmic, np.log(position) / np.log(ratio), (nominal - low) / (high - low))

    @cached_property
    def _box(self) -> tuple[Array, Array, Array, NDArray[np.bool_], Array]:
        """Ends and nominal point of the box; which numbers are scaled logarithmically, and the ratio of their ends."""
        low, high = self.family.low, self.family.high
        logarithmic = low * high > 0
        ratio = np.where(logarithmic, high / np.where(logarithmic, low, 1.0), 1.0)
        return low, high, self.family.nominal_point, logarithmic, ratio

    def points(self, x: Array) -> Array:
        """The uncertain numbers at these places, both of shape (m, p); exact at the ends and at the nominal member."""
        low, high, nominal, logarithmic, ratio = self._box
        points = np.where(logarithmic, low * ratio**x, low + (high - low) * x)
        points = np.where(x == self.nominal_x, nominal, points)
        return np.clip(np.where(x == 1.0, high, np.where(x == 0.0, low, points)), low, high)

    def loops_at(self, x: Array) -> Loops:
        """The loops at these places, shape (m, p)."""
        key = (len(x), x.tobytes())
        if key not in self.known:
            if len(self.known) >= _MOST_KNOWN:
                del self.known[next(iter(self.known))]
            self.known[key] = self._loops_at(x)
        return self.known[key]

    def _loops_at(self, x: Array) -> Loops:
        return self._loops_of(Plants.members(self.family, self.points(x)))

    def _loops_of(self, plants: Plants) -> Loops:
        if self.implementation is None:
            return Loops.of(self.gains, plants)
        return SampledLoops.implemented(self.gains, self.implementation, plants)

    @cached_property
    def loops(self) -> Loops:
        """The loops of the sample's own places."""
        return self.loops_at(self.x)

    @cached_property
    def nominal_loop(self) -> Loops:
        """The nominal member's, one row."""
        return self.loops_at(self.nominal_x[None, :])

    @cached_property
    def reference_loop(self) -> Loops:
        """The one that spreads are measured from, one row."""
        if self.reference is None:
            return self.nominal_loop
        return self._loops_of(Plants.of(self.reference.member(self.reference.nominal_point)))

    @cached_property
    def edges(self) -> tuple[Rows, Rows]:
        """Rows of neighbours: along the grid's axes; without a grid every place and the nominal one."""
        p, n = self.x.shape[1], self.per_axis
        if not n:
            rows = np.arange(len(self.x))
            return rows, np.full(len(rows), self.nominal)
        index = np.arange(n**p).reshape((n,) * p)
        first = [np.take(index, range(n - 1), axis=k).ravel() for k in range(p)]
        second = [np.take(index, range(1, n), axis=k).ravel() for k in range(p)]
        return np.concatenate(first), np.concatenate(second)

    def with_more(self, x: Array) -> Sample:
        """The sample and these places."""
        return replace(self, x=np.concatenate([self.x, x])) if len(x) else self


def evaluate(loops: Loops, criterion: LoopFunction) -> tuple[Array, ...]:
    """The function of every loop, in chunks; a chunk with too many crossings to list at once is halved."""
    if len(loops) > _CHUNK:
        return _halves(loops, criterion)
    try:
        return criterion(loops)
    except DomainError:
        if len(loops) <= 1:
            raise
        return _halves(loops, criterion)


def _halves(loops: Loops, criterion: LoopFunction) -> tuple[Array, ...]:
    rows, middle = np.arange(len(loops)), len(loops) // 2
    first = evaluate(loops.take(rows[:middle]), criterion)
    second = evaluate(loops.take(rows[middle:]), criterion)
    return tuple(np.concatenate(pair) for pair in zip(first, second, strict=True))


def _corners(p: int) -> Array:
    if 2**p <= _MOST_CORNERS:
        return np.array(list(itertools.product((0.0, 1.0), repeat=p)))
    chosen = np.random.default_rng(1).integers(0, 2, size=(_MOST_CORNERS, p)).astype(float)
    return np.concatenate([np.zeros((1, p)), np.ones((1, p)), chosen])


def _sobol(p: int) -> Array:
    from scipy.stats import qmc  # half a second, needed by large boxes only

    return qmc.Sobol(p, scramble=False).random(_SOBOL_POINTS)
