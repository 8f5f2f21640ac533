"""A spec with measured responses in the search's numbers:  tables from the curves, and guards at the ends of the band.

The scan of rays works on a table of ln P, which the curves fill.  Below the band the table goes on as the lowest
frequencies look, above it |L| is small; so that the count of unstable poles can be made
(`core/measured/stability.py`), |L| has to be above 1 at the lower end and below 1 at the upper one.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from fopi_tune.core.bode_form import Array, Complex
from fopi_tune.core.controller import FoPi
from fopi_tune.core.measured.family import MeasuredFamily
from fopi_tune.core.measured.loops import MeasuredLoop
from fopi_tune.core.measured.stability import count_unstable_poles
from fopi_tune.design.constraints import STABILITY_GUARD, Bound, Constraint, Scale, constraints_of
from fopi_tune.design.global_search.compiled import CODE_OF_OBJECTIVE, COEFFICIENTS, END, WIDTH, Family, Table
from fopi_tune.design.global_search.problem import Problem
from fopi_tune.design.global_search.tables import Scaled
from fopi_tune.errors import DomainError
from fopi_tune.quantities import QUANTITIES
from fopi_tune.quantities.objectives import ObjectiveKind
from fopi_tune.results.candidate import Violation
from fopi_tune.spec.model import DesignSpec

#: columns a decade of the scan's table, and how often an interval that is not straight enough is halved
_PER_DECADE, _HALVINGS = 15, 4
#: how far ln P may be from a straight line between columns
_STRAIGHT = 0.05
#: neper: how far from 1 |L| is kept at the ends of the band
_BESIDE_ONE = 0.01
#: the plant's phase at the frequency that the search's numbers are scaled by, rad
_CHARACTERISTIC = math.radians(-120.0)
#: v beyond the ends of the band, where a table has its limits
_BEYOND = 3.0


@dataclass(frozen=True)
class MeasuredProblem(Problem):
    """The problem of a family of measured responses."""

    @classmethod
    def of(
        cls, spec: DesignSpec, violations: Sequence[Violation] = (), crossover_rad_s: float | None = None
    ) -> MeasuredProblem:
        """Scale the spec.

        Args:
            spec: with a measured plant.
            violations: plants and frequencies of a check, which has nothing that the search does not see.
            crossover_rad_s: of gains that are known to meet it; None for a guess.

        Raises:
            DomainError: without the number of unstable poles, or where a response's lowest frequencies show no
                asymptote: no gains are known to give a stable loop.
        """
        family = family_of(spec)
        _refuse_unknown_stability(family)
        scale = _scale_of(spec, family, crossover_rad_s)
        objective = ObjectiveKind(spec.objective.quantity) if spec.objective else ObjectiveKind.DEPTH
        # no polynomial is behind it
        scaled = Scaled(family, scale, Family(np.zeros((1, COEFFICIENTS)), 0.0, 0.0, np.zeros((0, 0))), None)
        # the discounted error needs P at a real s: refused when the spec is read
        horizon = 10.0 / scale.omega_rad_s
        return cls(
            spec, scale, scaled, _constraints(spec, family), objective, CODE_OF_OBJECTIVE[objective], horizon,
            violations=tuple(violations),
        )  # fmt: skip

    def with_limits_of(self, spec: DesignSpec) -> MeasuredProblem:
        """The same curves and tables with the limits of another spec."""
        other = replace(self, spec=spec, constraints=_constraints(spec, self.family))
        self._share_tables(other)
        return other

    @cached_property
    def floor(self) -> float:
        """Not known: the response at omega = 0 is not measured."""
        return -math.inf

    @property
    def family(self) -> MeasuredFamily:
        """The members."""
        return family_of(self.spec)

    @property
    def has_bound(self) -> bool:
        """No: the bound is about transfer functions."""
        return False

    @cached_property
    def without_integral(self) -> bool:
        """No: a response with a zero at s = 0 is refused."""
        return False

    @cached_property
    def scan_table(self) -> Table:
        """Every member on the columns of the scan."""
        return _table(self.family, self.scaled, self._named)

    @cached_property
    def fine_points(self) -> tuple[Array, Array]:
        """The members' places; they have no spacing."""
        return self.family.corners(), np.zeros(0)

    @cached_property
    def fine_table(self) -> Table:
        """The same as the scan's: what is exact is looked at on the curves themselves."""
        return self.scan_table

    def _columns(self, constraint: Constraint, table: Table) -> tuple[int, int]:
        # the limits omega -> 0 and infinity are not measured
        first, last = super()._columns(constraint, table)
        return max(first, 1), min(last, len(table.v) - 2)

    def gains(self, x: Array) -> FoPi:
        """Scaled numbers of a controller, `x`, in the user's units, inside their ranges."""
        ranges = self.spec.controller.alpha, self.spec.controller.mu
        for k, side in enumerate(ranges, 3):
            if len(x) > k and side is not None:
                # the program may leave a range by rounding, which an order must not
                x = np.where(np.arange(len(x)) == k, np.clip(x, side.min, side.max), x)
        return super().gains(x)

    def measured_loops(self, gains: FoPi) -> list[MeasuredLoop]:
        """The loops of gains with every member."""
        family = self.family
        return [MeasuredLoop(gains, member.table, family.band_rad_s) for member in family.members]

    def is_stable(self, gains: FoPi) -> bool:
        """Whether the loops of gains are shown to be stable with every member."""
        poles = self.family.unstable_poles
        return all(count_unstable_poles(loop, poles).unstable == 0.0 for loop in self.measured_loops(gains))


def problem_of(spec: DesignSpec, violations: Sequence[Violation] = (), crossover_rad_s: float | None = None) -> Problem:
    """The problem of a spec; arguments and errors as of `Problem.of` and `MeasuredProblem.of`."""
    kind = MeasuredProblem if spec.is_measured else Problem
    return kind.of(spec, violations, crossover_rad_s)


def family_of(spec: DesignSpec) -> MeasuredFamily:
    """The plant of a spec with measured responses."""
    assert isinstance(spec.plant, MeasuredFamily)
    return spec.plant


def _refuse_unknown_stability(family: MeasuredFamily) -> None:
    if family.unstable_poles is None:
        raise DomainError(
            "gains are chosen among those with a stable loop, which needs the number of the plant's unstable poles; "
            "write unstable_poles: 0 under plant: for a stable plant"
        )
    for member in family.members:
        if member.table.low_end is None:
            named = f"{member.name}: " if member.name else ""
            raise DomainError(
                f"{named}the response at its lowest frequencies, from {member.table.band_rad_s[0]:.5g} rad/s, does not "
                "look like a constant, an integrator or a double one, so that no loop can be shown to be stable: "
                "measure from lower frequencies"
            )


def _constraints(spec: DesignSpec, family: MeasuredFamily) -> tuple[Constraint, ...]:
    """Those of the spec without the guard of the phase margin, and the guards of |L| at the ends of the band."""
    own = [c for c in constraints_of(spec) if c.requirement != STABILITY_GUARD or c.bound is Bound.UPPER]
    low, high = family.band_rad_s
    integrates = any(m.table.low_end is not None and m.table.low_end.exponent < 0 for m in family.members)
    ki = spec.controller.ki
    ends = [(Bound.UPPER, -_BESIDE_ONE, high)]
    if integrates or not ki.min == ki.max == 0.0:
        ends.append((Bound.LOWER, _BESIDE_ONE, low))
    quantity = QUANTITIES["loop_gain_db"]
    guards = [
        Constraint(
            STABILITY_GUARD, quantity, bound, limit, quantity.from_natural(limit), 1.0, False, omega, omega, False
        )
        for bound, limit, omega in ends
    ]  # fmt: skip
    return (*own, *guards)


def _scale_of(spec: DesignSpec, family: MeasuredFamily, crossover_rad_s: float | None) -> Scale:
    """omega_s: where the nominal plant has a phase of -120 deg, as far as limits of the crossover allow; g_s there."""
    low, high = family.band_rad_s
    curve, controller = family.members[0].table, spec.controller
    if crossover_rad_s is None:
        u = np.linspace(math.log(low), math.log(high), 400)
        lags = np.flatnonzero(curve.log_at(u).imag < _CHARACTERISTIC)
        found = math.exp(u[lags[0]]) if len(lags) and lags[0] > 0 else math.sqrt(low * high)
        limits = [each for each in spec.requirements if each.quantity == "crossover_rad_s"]
        found = min([found, *(each.upper for each in limits)])
        crossover_rad_s = max([found, *(each.lower for each in limits)])
    omega = min(max(crossover_rad_s, low), high)
    gain = math.exp(float(curve.log_at(np.array([math.log(omega)])).real[0]))
    return Scale(
        omega, gain, np.geomspace(low, high, 50), controller.derivative_filter_time_constant_s,
        controller.has_derivative_order, controller.measurement_filter,
    )  # fmt: skip


def _table(family: MeasuredFamily, scaled: Scaled, named: Array) -> Table:
    """The table of every member, scaled, with columns at `named` frequencies in rad/s among them."""
    scale, u = scaled.scale, _scan_columns(family, named)
    log: Complex = np.array([member.table.log_at(u) for member in family.members])
    filtered: Complex = np.zeros(len(u), dtype=complex)
    if scale.measurement_filter is not None:
        filtered = np.asarray(np.log(scale.measurement_filter(1j * np.exp(u))), dtype=complex)
    log_gain, m = math.log(scale.gain), len(log)
    ends = [member.table.low_end for member in family.members]
    slope = np.array([0.0 if end is None else float(end.exponent) for end in ends])
    start = np.array([-math.pi if end is not None and end.is_negative else 0.0 for end in ends])

    def with_ends(inside: Array) -> Array:
        first = np.where(slope < 0.0, END, inside[:, 0])
        return np.column_stack([first, inside, np.full(m, -END)])

    plant_gain, phase = log.real - log_gain, log.imag + filtered.imag
    gain = with_ends(plant_gain + filtered.real)
    phase = np.column_stack([start + 0.5 * math.pi * slope, phase, phase[:, -1]])
    v = u - math.log(scale.omega_rad_s)
    v = np.concatenate([[v[0] - _BEYOND], v, [v[-1] + _BEYOND]])
    omega = np.exp(v)
    omega[0], omega[-1] = 0.0, np.inf
    linear, none = np.exp(gain), np.zeros(m)
    members = np.zeros((m, COEFFICIENTS))
    # read as N(0)/D(0), which is neither 0 nor infinite
    members[:, WIDTH - 1] = members[:, 2 * WIDTH - 1] = 1.0
    filter_gain = np.concatenate([[0.0], filtered.real, [filtered.real[-1]]])
    return Table(
        v, omega, gain, phase, linear * np.cos(phase), linear * np.sin(phase), none,
        np.full(m, family.unstable_poles or 0, dtype=np.int64), start, slope, np.full(m, -1.0),
        np.full(m, len(v), dtype=np.int64), np.ones(m), members, family.corners(), v.copy(), none.copy(),
        scaled.sampling, filter_gain,
        np.ascontiguousarray(with_ends(plant_gain)),
    )  # fmt: skip


def _scan_columns(family: MeasuredFamily, named: Array) -> Array:
    """ln omega of the columns: evenly, and closer where a response is not straight between them."""
    low, high = family.band_rad_s
    count = int(_PER_DECADE * math.log10(high / low)) + 2
    inside = named[(named > low) & (named < high)]
    u = np.unique(np.concatenate([np.linspace(math.log(low), math.log(high), count), np.log(inside)]))

    def log_plants(at: Array) -> Complex:
        return np.array([member.table.log_at(at) for member in family.members])

    for _ in range(_HALVINGS):
        middle = 0.5 * (u[1:] + u[:-1])
        ends = log_plants(u)
        off = np.abs(log_plants(middle) - 0.5 * (ends[:, 1:] + ends[:, :-1])).max(axis=0)
        bent = middle[off > _STRAIGHT]
        if not len(bent):
            break
        u = np.union1d(u, bent)
    return u[np.concatenate([[True], np.diff(u) > 1e-9])]
