"""What the oracle evaluates:  a constraint or the objective as slacks on a table of loops, or on loops of its own.

A function of frequency has up to three probes: its band, and the limits omega -> 0 and inf that its band includes, in
closed form.  A delay margin and a gain margin have probes at the ends too: |L| that stays above 1 leaves no delay
margin, and where L tends to a negative number, 1/|L| is a gain margin.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from enum import Enum

import numpy as np

from fopi_tune.core.bode_form import Array, Rows
from fopi_tune.core.crossings import Crossings, negative_ends
from fopi_tune.core.loops import Loops
from fopi_tune.core.margins import stays_large
from fopi_tune.core.peaks import Response, limit_at
from fopi_tune.design.constraints import Bound, Constraint
from fopi_tune.design.loop_grid import LoopGrid, LoopNumbers, Track, discounted_error, numbers_at
from fopi_tune.design.margin_sides import Sides
from fopi_tune.quantities.base import EvaluatedAt
from fopi_tune.quantities.objectives import ObjectiveKind
from fopi_tune.quantities.responses import FrequencyFunction

#: neper; local minima of a plant's slack this close to the smallest on the grid may be smaller between the grid points;
#: the smallest few are refined
_NEAR_DIP = 0.1
_MOST_DIPS = 3
#: natural units; a limit that no gain changes is met by less than the designed tightening as well as by much
NO_ROOM = 1e-6
#: neper; |L| has to fall below 1 by at least this as omega -> inf, for a delay margin
BELOW_ONE = 1e-5
#: natural units; what is violated without end is violated by so much
_FAR = 1e3


class Kind(Enum):
    """How the frequency of a probe is found."""

    BAND = "the worst of a band"
    END = "omega -> 0 or inf"
    GAIN_CROSSOVER = "|L| = 1"
    PHASE_CROSSOVER = "arg L = -180 deg"
    FIXED = "given"


@dataclass(frozen=True)
class Finding:
    """A plant and a frequency where a constraint (or the objective) is worst.

    Args:
        constraint: its index; None for the objective.
        slack: of the constraint in natural units, negative where violated; of the objective, minus its value.
        theta: the plant, a point of the box, shape (p,).
        omega_rad_s: the frequency; 0 and inf are limits.
        side, angle_rad: of a gain crossover, as in `fopi_tune.design.margin_sides`; of other frequencies the angle from
            -1 to L.
        track: what the frequency follows from plant to plant.
    """

    constraint: int | None
    slack: float
    theta: Array
    omega_rad_s: float
    side: float = 1.0
    angle_rad: float = 0.0
    track: Track = Track.STAY


@dataclass(frozen=True)
class Worst:
    """The smallest slack of each of m plants, its u, and of a gain crossover its side and angle; shapes (m,)."""

    slack: Array
    u: Array
    side: Array
    angle_rad: Array

    @classmethod
    def at(cls, slack: Array, u: Array) -> Worst:
        """At frequencies that are no gain crossovers."""
        return cls(slack, u, np.ones(len(u)), np.zeros(len(u)))

    def finding(self, constraint: int | None, row: int, theta: Array) -> Finding:
        """That of one plant."""
        omega_rad_s = float(np.exp(self.u[row]))
        return Finding(
            constraint, float(self.slack[row]), theta, omega_rad_s, float(self.side[row]), float(self.angle_rad[row])
        )


@dataclass(frozen=True)
class Probe:
    """One constraint or the objective, as functions that the oracle evaluates; slacks are negative where violated.

    Args:
        constraint: its index; None for the objective.
        kind: how its frequency is found.
        slack: of loops at frequencies, from the nominal phase margin too.
        nominal: whether only the nominal plant counts.
        highest: of several crossings the highest counts, else the one with the smallest value.
        low_u, high_u: the band, ln omega.
        value: the quantity itself.
        of_loops: the slack of whole loops; at an end, and of the discounted error.
        at_omega_rad_s: the end, or the frequency that stands for the discounted error.
        met_below_one: whether a stable loop with |L| < 1 everywhere meets it.
        met_above_one: whether a stable loop with |L| > 1 everywhere meets it.
        ripples: whether it is worst where L is negative, so that the turns of a dead time make it ripple.
    """

    constraint: int | None
    kind: Kind
    slack: Callable[[LoopNumbers, float], Array]
    nominal: bool = False
    highest: bool = False
    low_u: float = -math.inf
    high_u: float = math.inf
    value: Callable[[LoopNumbers], Array] = lambda numbers: numbers.phase_margin_rad
    of_loops: Callable[[Loops], Array] | None = None
    at_omega_rad_s: float = math.nan
    met_below_one: bool = False
    met_above_one: bool = False
    ripples: bool = False

    @property
    def moves_u(self) -> bool:
        """Whether the refinement moves the frequency freely."""
        return self.kind is Kind.BAND and self.low_u < self.high_u

    @property
    def track(self) -> Track:
        """What the frequency follows from plant to plant."""
        crossings = {Kind.GAIN_CROSSOVER: Track.GAIN_CROSSOVER, Kind.PHASE_CROSSOVER: Track.PHASE}
        return crossings.get(self.kind, Track.STAY)

    def clipped(self, u: Array) -> Array:
        """Clip to the band."""
        return np.clip(u, self.low_u, self.high_u) if self.kind is Kind.BAND else u

    def slack_at(self, numbers: LoopNumbers, loops: Loops, nominal_margin: float) -> Array:
        """Slacks of loops, at a frequency each."""
        return self.slack(numbers, nominal_margin) if self.of_loops is None else self.of_loops(loops)

    def places(self, table: LoopGrid, nominal_margin: float, row: int, worst: Finding) -> list[Finding]:
        """The finding of a plant, to refine: in a band, every local minimum of the slack close to the smallest."""
        if not self.moves_u:
            return [replace(worst, track=self.track)]
        one = np.array([row])
        grid, band = self._on_band(table, nominal_margin, one)
        padded = np.concatenate([[np.inf], grid[0], [np.inf]])
        dips = np.flatnonzero((padded[1:-1] <= padded[:-2]) & (padded[1:-1] < padded[2:]))
        near = dips[grid[0][dips] < grid[0].min() + _NEAR_DIP]
        deepest = near[np.argsort(grid[0][near])][:_MOST_DIPS]
        found = [replace(worst, omega_rad_s=float(np.exp(band[i]))) for i in deepest] or [worst]
        return [self._on_ripple(table, row, f) for f in found] if self.ripples else found

    def _on_ripple(self, table: LoopGrid, row: int, found: Finding) -> Finding:
        """Moved to the next ripple, which it then follows, where the grid is too coarse for a dead time's turns."""
        u = table.next_ripple(row, math.log(found.omega_rad_s))
        if u is None or not self.low_u <= u <= self.high_u:
            return found
        loops = table.loops.take(np.array([row]))
        slack = self.slack(numbers_at(loops, np.zeros(1, dtype=np.intp), np.array([u])), math.nan)
        return replace(found, omega_rad_s=math.exp(u), slack=float(slack[0]), angle_rad=0.0, track=Track.PHASE)

    def _on_band(self, table: LoopGrid, nominal_margin: float, rows: Rows) -> tuple[Array, Array]:
        slack: Callable[[LoopNumbers], Array] = lambda n: self.slack(n, nominal_margin)  # noqa: E731
        return table.in_band(slack, self.low_u, self.high_u, rows, self.ripples)

    def on_grid(self, table: LoopGrid, nominal_margin: float, nominal_u: float) -> Worst:
        """The smallest slack of each of the table's plants."""
        m = len(table.loops)
        if self.of_loops is not None:
            with np.errstate(divide="ignore"):
                return Worst.at(self.of_loops(table.loops), np.full(m, np.log(self.at_omega_rad_s)))
        if self.kind is Kind.BAND:
            grid, band = self._on_band(table, nominal_margin, np.arange(m))
            return Worst.at(grid.min(axis=1), band[np.argmin(grid, axis=1)])
        if self.kind is Kind.FIXED:
            u = np.full(m, nominal_u)
            return Worst.at(self.slack(numbers_at(table.loops, np.arange(m), u), nominal_margin), u)
        if self.kind is Kind.PHASE_CROSSOVER:
            rows, u = table.phase_crossings()
            numbers = numbers_at(table.loops, rows, u)
            order = np.lexsort((self.value(numbers), rows))
            value, where = np.full(m, np.inf), np.zeros(m)
            found, first = np.unique(rows[order], return_index=True)
            value[found], where[found] = self.slack(numbers, nominal_margin)[order][first], u[order][first]
            return Worst.at(value, where)
        sides = table.sides()
        worst = self.at_crossovers(table.loops, table.gain_crossings(), sides, nominal_margin)
        # Without a gain crossover a constraint is violated the more, the farther |L| stays from 1; but there a margin
        # of a stable loop is infinite.
        away, where = table.nearest_to_crossover()
        met = sides.stable & np.where(away > 0.0, self.met_above_one, self.met_below_one)
        absent = np.setdiff1d(np.arange(m), table.gain_crossings().row)
        worst.slack[absent] = np.where(met, np.inf, -1.0 - np.abs(away))[absent]
        worst.u[absent] = where[absent]
        return worst

    def at_crossovers(self, loops: Loops, crossings: Crossings, sides: Sides, nominal_margin: float) -> Worst:
        """The slack at the crossover that decides of each loop; inf where there is none."""
        m, rows, u = len(loops), crossings.row, crossings.u
        numbers = numbers_at(loops, rows, u, sides.side, sides.angle_rad)
        order = np.lexsort((-u if self.highest else self.value(numbers), rows))
        found, first = np.unique(rows[order], return_index=True)
        at = order[first]
        worst = Worst(np.full(m, np.inf), np.zeros(m), np.ones(m), np.zeros(m))
        worst.slack[found], worst.u[found] = self.slack(numbers, nominal_margin)[at], u[at]
        worst.side[found], worst.angle_rad[found] = sides.side[at], sides.angle_rad[at]
        return worst


def probes_of(constraints: tuple[Constraint, ...]) -> tuple[Probe, ...]:
    """The probes of all constraints."""
    return tuple(probe for k, constraint in enumerate(constraints) for probe in _probes(k, constraint))


def _probes(k: int, constraint: Constraint) -> list[Probe]:
    quantity = constraint.quantity

    def slack(numbers: LoopNumbers, _: float) -> Array:
        return _slack(constraint, quantity.natural(numbers))

    kind = {
        EvaluatedAt.BAND: Kind.BAND,
        EvaluatedAt.GAIN_CROSSOVERS: Kind.GAIN_CROSSOVER,
        EvaluatedAt.HIGHEST_GAIN_CROSSOVER: Kind.GAIN_CROSSOVER,
        EvaluatedAt.PHASE_CROSSOVERS: Kind.PHASE_CROSSOVER,
    }[constraint.where]
    below, above = _met_without_crossover(constraint)
    main = Probe(
        k,
        kind,
        slack,
        constraint.nominal,
        constraint.where is EvaluatedAt.HIGHEST_GAIN_CROSSOVER,
        math.log(constraint.from_rad_s) if constraint.from_rad_s > 0 else -math.inf,
        math.log(constraint.to_rad_s) if constraint.to_rad_s < math.inf else math.inf,
        quantity.natural,
        met_below_one=below,
        met_above_one=above,
        ripples=constraint.bound is Bound.UPPER and _response(constraint) not in (None, Response.LOOP_GAIN),
    )
    ends = [
        Probe(k, Kind.END, slack, constraint.nominal, of_loops=_slack_at_end(constraint, end), at_omega_rad_s=end)
        for end in constraint.ends
    ]
    return [main, *ends]


def _response(constraint: Constraint) -> Response | None:
    quantity = constraint.quantity
    return quantity.response if isinstance(quantity, FrequencyFunction) else None


def _slack(constraint: Constraint, natural: Array) -> Array:
    distance = (constraint.limit - natural) * constraint.scale
    return -np.abs(distance) if constraint.bound is Bound.EQUAL else constraint.bound.value * distance


def _slack_at_end(constraint: Constraint, end: float) -> Callable[[Loops], Array]:
    """Loops -> the slack of their limits at an end of the axis; inf where there is nothing to be asked."""
    response = _response(constraint)

    def of_response(loops: Loops) -> Array:
        assert response is not None
        largest = constraint.bound is not Bound.LOWER
        value = limit_at(loops, response, end, largest)
        moved = limit_at(replace(loops, kp=1.1 * loops.kp, ki=1.1 * loops.ki), response, end, largest)
        slack = np.clip(_slack(constraint, value), -_FAR, _FAR)
        return np.where((value == moved) & (slack >= 0.0) & (slack < NO_ROOM), np.inf, slack)

    def of_delay_margin(loops: Loops) -> Array:
        gain, _ = loops.log.end()
        large = stays_large(loops) | ((np.abs(loops.log.slope_end()) < 1e-12) & (gain > -BELOW_ONE))
        return np.where(large, np.minimum(-gain, -BELOW_ONE), np.inf)

    def of_gain_margin(loops: Loops) -> Array:
        slack = np.full(len(loops), np.inf)
        at_end = negative_ends(loops)[0 if end == 0.0 else 1]
        with np.errstate(divide="ignore"):
            value = _slack(constraint, -np.log(at_end.gain))
        slack[at_end.row] = np.where(at_end.gain <= 1.0, value, np.inf)
        gain, _ = loops.log.end()
        turns = (end > 0.0) & (loops.log.delay > 0.0) & (loops.log.slope_end() > -1e-12) & (gain <= 0.0)
        return np.where(turns, _slack(constraint, -gain), slack)

    if response is not None:
        return of_response
    return of_gain_margin if constraint.where is EvaluatedAt.PHASE_CROSSOVERS else of_delay_margin


def _met_without_crossover(constraint: Constraint) -> tuple[bool, bool]:
    """Whether a stable loop with |L| < 1 everywhere meets it, and one with |L| > 1 everywhere.

    The phase margin of both is infinite; the delay margin of the first is, that of the second is 0.
    """
    if not constraint.quantity.is_margin or constraint.bound is Bound.EQUAL:
        return False, False
    lower, of_delay = constraint.bound is Bound.LOWER, constraint.quantity.name == "delay_margin_s"
    return lower, lower is not of_delay


def objective_probes(objective: ObjectiveKind, horizon_s: float) -> tuple[Probe, ...]:
    """The objective as probes whose slack is minus its value; none for those without a worst member."""

    def peak(response: Response, slack: Callable[[LoopNumbers, float], Array]) -> tuple[Probe, ...]:
        def at(end: float) -> Probe:
            return Probe(
                None, Kind.END, slack, of_loops=lambda loops: -limit_at(loops, response, end), at_omega_rad_s=end
            )

        return (Probe(None, Kind.BAND, slack, ripples=True), at(0.0), at(math.inf))

    if objective is ObjectiveKind.SENSITIVITY_PEAK:
        return peak(Response.SENSITIVITY, lambda n, _: n.log_return_difference)
    if objective is ObjectiveKind.CONTROL_SENSITIVITY_PEAK:
        return peak(Response.CONTROL_SENSITIVITY, lambda n, _: n.log_return_difference - n.log_controller)
    if objective is ObjectiveKind.PHASE_MARGIN_SPREAD:
        return (Probe(None, Kind.GAIN_CROSSOVER, lambda n, m: -np.abs(n.phase_margin_rad - m)),)
    if objective is ObjectiveKind.CROSSOVER_SPREAD:
        return (Probe(None, Kind.FIXED, lambda n, _: -np.abs(n.log_gain)),)
    if objective is ObjectiveKind.IAE_DISTURBANCE:
        error: Callable[[Loops], Array] = lambda loops: -np.log(discounted_error(loops, horizon_s))  # noqa: E731
        return (Probe(None, Kind.FIXED, lambda n, _: -n.log_gain, of_loops=error, at_omega_rad_s=1.0 / horizon_s),)
    return ()
