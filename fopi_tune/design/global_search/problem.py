"""DesignSpec -> Problem:  rows, box, objective and tables, all scaled."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, fields, replace
from functools import cached_property, lru_cache
from typing import Any

import numpy as np

from fopi_tune.core.bode_form import Array
from fopi_tune.core.controller import FoPi
from fopi_tune.core.loops import Loops, Plants
from fopi_tune.core.sampled_loops import SampledLoops
from fopi_tune.design.constraints import (
    STABILITY_GUARD,
    Bound,
    Constraint,
    Scale,
    constraints_of,
    scale_of,
)
from fopi_tune.design.global_search.compiled import (
    CODE_OF_OBJECTIVE,
    COEFFICIENTS,
    CROSSOVER,
    CS,
    CS_PEAK,
    DELAY_MARGIN,
    DEPTH,
    KIND_OF_QUANTITY,
    PS,
    PS_PEAK,
    WIDTH,
    WITH_ORDERS,
    Box,
    Rows,
    Table,
)
from fopi_tune.design.global_search.samples import Samples
from fopi_tune.design.global_search.structures import LARGEST_GAIN, Structure
from fopi_tune.design.global_search.tables import Scaled, box_grid, frequency_grid, table_of, vertices
from fopi_tune.design.reasons import low_frequency_control_gain
from fopi_tune.digital import sections_of
from fopi_tune.digital.discretize import Method
from fopi_tune.digital.implementation import designed_implementation
from fopi_tune.quantities.objectives import ObjectiveKind, default_horizon_s
from fopi_tune.results.candidate import Violation
from fopi_tune.spec.model import DesignSpec, GainRange

#: inequalities are designed this much tighter (natural units), so that rounding does not undo them
TIGHTENING = 4e-7
#: natural units; costs that differ by less are the same
SAME_COST = 1e-9
#: relative
_SAME_CROSSOVER = 1e-9
#: tables that are kept: two a problem
_TABLES = 8
_SCAN_GRID = (10, 3)
_FINE_GRID = (20, 6)


@dataclass(frozen=True)
class _TableOf:
    """What a table is made of; `numbers` are all that it depends on."""

    grid: tuple[int, int]
    horizon_s: float
    numbers: tuple[object, ...]
    scaled: Scaled = field(compare=False)
    named: Array = field(compare=False)
    points: Array = field(compare=False)


@lru_cache(_TABLES)
def _table(of: _TableOf) -> Table:
    """The table; specs that differ in their limits alone, as in a study, share it."""
    omega = frequency_grid(of.scaled, of.named, *of.grid)
    return table_of(of.scaled, of.points, omega, of.horizon_s)


@dataclass(frozen=True)
class Problem:
    """A spec in the search's numbers.

    Args:
        spec: the spec.
        scale: omega_s and g_s.
        scaled: the family's coefficients, and what samples the loop.
        constraints: a row each, stability's guard of |S| last.
        objective: what is optimised.
        code: its code in the compiled parts.
        horizon_s: of the discounted error.
        tightening: of the inequalities, natural units.
        free: requirements that may be missed: the objective is then that the largest miss be smallest.
        violations: plants and frequencies at which a check refuted gains.
    """

    spec: DesignSpec
    scale: Scale
    scaled: Scaled
    constraints: tuple[Constraint, ...]
    objective: ObjectiveKind
    code: int
    horizon_s: float
    tightening: float = TIGHTENING
    free: frozenset[int] | None = None
    violations: tuple[Violation, ...] = ()

    @classmethod
    def of(
        cls, spec: DesignSpec, violations: Sequence[Violation] = (), crossover_rad_s: float | None = None
    ) -> Problem:
        """Scale the spec; its grids hold the plants and frequencies of violations that a check found."""
        spec.controller.refuse_filter_times("a search of gains alone")
        scale = scale_of(spec, crossover_rad_s)
        objective = ObjectiveKind(spec.objective.quantity) if spec.objective else ObjectiveKind.DEPTH
        given = spec.objective.horizon_s if spec.objective else None
        horizon = given if given is not None else default_horizon_s(spec.plant)
        sampled = spec.sampled_design
        # where the filter has to be exact at the crossover, a first guess of that
        samples = None if sampled is None else Samples(sampled, scale, scale.omega_rad_s)
        if samples is not None and samples.digital.method != Method.FIT:
            # a filter that cannot be made is refused as such
            orders = {} if spec.controller.mu is None else {"mu": spec.controller.mu.max}
            sections_of(spec.controller.controller(1.0, 1.0, spec.controller.alpha.max, 1.0, **orders), samples.digital)
        scaled = Scaled.of(spec.plant, scale, samples)
        return cls(
            spec, scale, scaled, _needed(constraints_of(spec)), objective, CODE_OF_OBJECTIVE[objective], horizon,
            violations=tuple(violations),
        )  # fmt: skip

    def with_limits_of(self, spec: DesignSpec) -> Problem:
        """The same plants and tables with the limits of another spec."""
        other = replace(self, spec=spec, constraints=_needed(constraints_of(spec)))
        return self._share_tables(other)

    @property
    def every_requirement(self) -> frozenset[int]:
        """Indices of all requirements."""
        return frozenset(range(len(self.spec.requirements)))

    @property
    def needs_crossover(self) -> bool:
        """Whether the loop is on samples with a filter that depends on its crossover."""
        return self.scaled.samples is not None and self.scaled.samples.digital.depends_on_crossover

    @property
    def has_bound(self) -> bool:
        """Whether `bound/` knows what no gains can reach.

        It is about kp + ki s^-alpha, and kp + ki/s with a derivative: not where gains with another crossover would have
        another filter, nor where integral and derivative have orders.
        """
        return not self.needs_crossover and not self.spec.controller.has_derivative_order

    def is_exact_at(self, crossover_rad_s: float | None) -> bool:
        """Whether the filter is exact at a crossover, up to what the polish leaves."""
        known = None if self.scaled.samples is None else self.scaled.samples.crossover_rad_s
        if known is None or crossover_rad_s is None:
            return known == crossover_rad_s
        return abs(crossover_rad_s / known - 1.0) < _SAME_CROSSOVER

    def exact_at(self, crossover_rad_s: float | None) -> Problem:
        """The same problem on samples with the filter that is exact at another crossover."""
        samples = self.scaled.samples
        assert samples is not None
        scaled = self.scaled.with_samples(replace(samples, crossover_rad_s=crossover_rad_s))
        other = self._share_tables(replace(self, scaled=scaled))
        for name in ("scan_table", "fine_table"):
            other.__dict__[name] = getattr(self, name)._replace(sampling=scaled.sampling)
        return other

    def missing(self, free: frozenset[int], dropped: frozenset[int]) -> Problem:
        """The problem of how little the requirements in `free` have to be missed, those in `dropped` left out."""
        kept = tuple(c for c in self.constraints if c.requirement not in dropped)
        other = replace(self, constraints=kept, free=free, objective=ObjectiveKind.DEPTH, code=DEPTH)
        return self._share_tables(other)

    def without_derivative(self) -> Problem:
        """The same problem with kd = 0."""
        controller = replace(self.spec.controller, kd=GainRange(0.0, 0.0))
        return self._share_tables(replace(self, spec=replace(self.spec, controller=controller)))

    def _share_tables(self, other: Problem) -> Problem:
        for name in ("scan_table", "fine_table", "fine_points"):
            other.__dict__[name] = getattr(self, name)
        return other

    @cached_property
    def _named(self) -> Array:
        ends = [w for c in self.constraints for w in (c.from_rad_s, c.to_rad_s) if 0.0 < w < math.inf]
        ends += [c.limit_public for c in self.constraints if c.quantity.name == "crossover_rad_s"]
        return np.array(sorted(set(ends)))

    @cached_property
    def scan_table(self) -> Table:
        """Vertices and the nominal plant on a coarse grid."""
        return _table(self._tables_of(_SCAN_GRID))

    @cached_property
    def fine_points(self) -> tuple[Array, Array]:
        """Plants of the whole box and their spacing."""
        points, spacing = box_grid(self.spec.plant)
        # of a list of plants one member may have fewer numbers than another
        seen = [v.theta + (0.0,) * (points.shape[1] - len(v.theta)) for v in self.violations]
        return (np.vstack([points, np.array(seen).reshape(len(seen), points.shape[1])]) if seen else points), spacing

    @cached_property
    def fine_table(self) -> Table:
        """Plants of the whole box on a fine grid."""
        return _table(self._tables_of(_FINE_GRID))

    def _tables_of(self, grid: tuple[int, int]) -> _TableOf:
        violations = self.violations if grid == _FINE_GRID else ()
        seen = [v.omega_rad_s for v in violations if 0.0 < v.omega_rad_s < math.inf]
        named = np.union1d(self._named, seen)
        points = self.fine_points[0] if grid == _FINE_GRID else vertices(self.spec.plant)
        digital = None if self.scaled.samples is None else self.spec.digital
        crossover = None if self.scaled.samples is None else self.scaled.samples.crossover_rad_s
        # filters and orders of the structure are numbers of the scale
        of_scale = (getattr(self.scale, each.name) for each in fields(self.scale))
        hashable = tuple(value.tobytes() if isinstance(value, np.ndarray) else value for value in of_scale)
        known = (repr(self.spec.plant), digital, crossover, hashable, named.tobytes(), points.tobytes())
        return _TableOf(grid, self.horizon_s, known, self.scaled, named, points)

    def rows(self, table: Table, relaxed: float = 0.0, tightening: float | None = None) -> Rows:
        """The constraints on a table's columns.

        Args:
            table: the table.
            relaxed: by how much inequalities are relaxed, natural units.
            tightening: other than the problem's.
        """
        tight = self.tightening if tightening is None else tightening
        kinds = [KIND_OF_QUANTITY[c.quantity.name] for c in self.constraints]
        limits = [self._limit(c, kind, tight - relaxed) for c, kind in zip(self.constraints, kinds, strict=True)]
        ends = [self._columns(c, table) for c in self.constraints]
        v_of = self.scaled.v_of
        low = [v_of(math.log(c.from_rad_s)) if c.from_rad_s > 0 else -math.inf for c in self.constraints]
        high = [v_of(math.log(c.to_rad_s)) if c.to_rad_s < math.inf else math.inf for c in self.constraints]
        scales = [c.scale / (self.scale.omega_rad_s if k == DELAY_MARGIN else 1.0)
                  for c, k in zip(self.constraints, kinds, strict=True)]  # fmt: skip
        return Rows(
            np.array(kinds, dtype=np.int64),
            np.array([c.bound.value for c in self.constraints], dtype=np.int64),
            np.array(limits),
            np.array([c.nominal for c in self.constraints]),
            np.array([e[0] for e in ends], dtype=np.int64),
            np.array([e[1] for e in ends], dtype=np.int64),
            np.array(scales),
            np.array([c.in_depth if self.free is None else c.requirement in self.free for c in self.constraints]),
            np.array(low),
            np.array(high),
            np.array([self.free is not None and c.requirement in self.free for c in self.constraints]),
            np.array([0.0 if c.tilt is None else c.tilt.power for c in self.constraints]),
        )

    def _limit(self, constraint: Constraint, kind: int, tighter: float) -> float:
        guard = constraint.requirement == STABILITY_GUARD
        limit = constraint.limit - (0.0 if guard else constraint.bound.value * tighter / constraint.scale)
        if constraint.tilt is not None:
            limit -= constraint.tilt.power * math.log(constraint.tilt.omega_rad_s / self.scale.omega_rad_s)
        if kind in (CS, PS):
            return limit + (1.0 if kind == CS else -1.0) * math.log(self.scale.gain)
        if kind == CROSSOVER:
            return limit - math.log(self.scale.omega_rad_s)
        return limit * self.scale.omega_rad_s if kind == DELAY_MARGIN else limit

    def _columns(self, constraint: Constraint, table: Table) -> tuple[int, int]:
        v, v_of, last = table.v, self.scaled.v_of, len(table.v) - 1
        if constraint.quantity.name == "crossover_rad_s":
            at = v_of(constraint.limit)
            # on samples a limit above Nyquist's frequency is at the end of the axis
            return last if at == math.inf else int(np.argmin(np.abs(v - at))), last
        low, high = constraint.from_rad_s, constraint.to_rad_s
        first = int(np.searchsorted(v, v_of(math.log(low)) - 1e-9)) if low > 0 else 0
        final = int(np.searchsorted(v, v_of(math.log(high)) + 1e-9)) - 1 if high < math.inf else last
        return first, final

    @property
    def structure(self) -> Structure:
        """What the numbers of the controller are."""
        return Structure.of(self.spec.controller)

    @cached_property
    def box(self) -> Box:
        """The ranges of the gains."""
        box, g = self.spec.controller, self.scale.gain
        ki = GainRange(0.0, 0.0) if self.without_integral else box.ki
        kp, kd = ((max(gain.min * unit, -LARGEST_GAIN), min(gain.max * unit, LARGEST_GAIN))
                  for gain, unit in ((box.kp, g), (box.kd, g * self.scale.omega_rad_s)))  # fmt: skip
        shape = box.alpha.min, box.alpha.max
        if box.has_derivative:
            shape = (-1.0, -1.0) if kd == (0.0, 0.0) else (1.0, 1.0) if kp == (0.0, 0.0) else (-1.0, 1.0)
        if box.has_derivative_order:
            # limited where its order is known
            kd = box.kd.min * g * self.scale.omega_rad_s, box.kd.max * g * self.scale.omega_rad_s
        return Box(
            *kp, ki.min, ki.max, box.alpha.min, box.alpha.max,
            math.log(self.scale.omega_rad_s), math.log(g), self._log_horizon, *kd, *shape,
        )  # fmt: skip

    @property
    def _log_horizon(self) -> float:
        if self.scaled.samples is None:
            return math.log(self.horizon_s * self.scale.omega_rad_s)
        return -math.log(self.scaled.horizon(self.horizon_s))

    @property
    def error_unit(self) -> float:
        """The discounted error in the user's unit of |F P/(1 + C P)| = 1 in scaled numbers.

        T g_s, and on samples g_s Ts e^(s (1 + delay) Ts)/(e^(s Ts) - 1) with s = 1/T, as the step does not wait for
        the computing delay.  1/F at the horizon's s takes a measurement filter out again, which is behind the output.
        """
        lag, square = self.scale.lag_and_square
        s = self.scaled.horizon(self.horizon_s)
        unit = self.scale.gain * (1.0 + s * (lag + s * square))
        if self.scaled.samples is None:
            return self.horizon_s * unit
        digital = self.scaled.samples.digital
        step = digital.sample_time_s / self.horizon_s
        early = digital.sample_time_s * math.exp(step * (1.0 + digital.delay_samples)) / math.expm1(step)
        return early * unit

    @cached_property
    def without_integral(self) -> bool:
        """Whether ki has to be 0: a plant's zero at s = 0 would cancel the integral."""
        members = self.fine_table.members
        # a fractional numerator's last coefficient may have a power of s
        last = members[:, WIDTH - 1] == 0.0
        if members.shape[1] == WITH_ORDERS:
            last |= members[:, COEFFICIENTS + WIDTH - 1] > 0.0
        return bool(np.any(last)) and self.spec.controller.ki.min <= 0.0 <= self.spec.controller.ki.max

    @cached_property
    def floor(self) -> float:
        """No gains with ki other than 0 cost less: that of |C S| as omega -> 0, which no gains change."""
        if self.code != CS_PEAK:
            return -math.inf
        plants = Plants.members(self.spec.plant, self.fine_points[0])
        return low_frequency_control_gain(plants) + self.peak_offset

    def is_at_floor(self, cost: float, x: Array) -> bool:
        """Whether gains with an integral cost as little as any of them."""
        return bool(x[1] != 0.0) and cost <= self.floor + SAME_COST

    @property
    def peak_offset(self) -> float:
        """What ln|C S| or ln|P S| in scaled numbers is larger by than in the user's unit."""
        return {CS_PEAK: 1.0, PS_PEAK: -1.0}.get(self.code, 0.0) * math.log(self.scale.gain)

    def loops(self, gains: FoPi, points: Array) -> Loops:
        """The loops of gains with the plants at points of the box.

        Raises:
            DomainError: there is no digital controller with these gains.
        """
        plants, implementation = Plants.members(self.spec.plant, points), designed_implementation(self.spec, gains)
        if implementation is None:
            return Loops.of(gains, plants)
        return SampledLoops.implemented(gains, implementation, plants)

    def gains(self, x: Array) -> FoPi:
        """Scaled numbers of a controller in the user's units, inside their ranges."""
        found, box = self.scale.controller(x), self.spec.controller
        sides = {name: box.ranges[name] for name in self.structure.names}
        inside = {name: min(max(getattr(found, name), side.min), side.max) for name, side in sides.items()}
        return replace(found, setpoint_weight=box.first_weight, **inside)


def _needed(constraints: tuple[Constraint, ...]) -> tuple[Constraint, ...]:
    """Without the guard of the phase margin, which the search has no use for: it counts stability itself."""
    return tuple(c for c in constraints if c.requirement != STABILITY_GUARD or c.bound is Bound.UPPER)


def with_objective(own: Rows, more: tuple[tuple[int, int], ...], table: Table) -> Rows:
    """The rows of requirements, `own`, then those of the objective, `more` with kind and side, on a `table`."""
    if not more:
        return own
    count, last = len(more), len(table.v) - 1

    def joined(a: Any, b: Any) -> Any:
        return np.concatenate([a, np.array(b, dtype=np.asarray(a).dtype)])

    return Rows(
        joined(own.kind, [kind for kind, _ in more]), joined(own.side, [side for _, side in more]),
        joined(own.limit, [0.0] * count), joined(own.nominal, [False] * count), joined(own.first, [0] * count),
        joined(own.last, [last] * count), joined(own.scale, [1.0] * count), joined(own.in_depth, [False] * count),
        joined(own.low_v, [-math.inf] * count), joined(own.high_v, [math.inf] * count),
        joined(own.soft, [False] * count), joined(own.tilt, [0.0] * count),
    )  # fmt: skip
