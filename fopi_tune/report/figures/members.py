"""The members of a family that a report draws:  nominal plant, worst plants, a grid; and their loops over frequency."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from fopi_tune.core.bode_form import Array, Complex
from fopi_tune.core.controller import FoPi
from fopi_tune.core.crossings import gain_crossovers, phase_crossovers
from fopi_tune.core.families.plant_list import PlantList, named_place
from fopi_tune.core.loops import Loops, Plants
from fopi_tune.core.plant import PlantFamily
from fopi_tune.core.sampled_loops import SampledLoops
from fopi_tune.core.stability import is_stable
from fopi_tune.errors import DomainError
from fopi_tune.proof.verification.sample import Sample
from fopi_tune.report.documents import ReportedRequirement, ResultDocuments
from fopi_tune.report.text.formatting import number
from fopi_tune.report.words import in_words
from fopi_tune.results.documents import loop_name

_POINTS = 240
#: worst plants that are drawn: more lines than this cannot be told apart
_MOST_WORST = 3
#: decades beyond the outermost frequency of interest, and the most decades in all
_BEYOND, _MOST_DECADES = 1.5, 9.0
#: of Nyquist's frequency; where the axis ends on samples
_BELOW_NYQUIST = 0.9999
#: range of |L| that a Nyquist figure shows
_NEAR_UNIT_GAIN = (0.02, 6.0)


@dataclass(frozen=True)
class Member:
    """A plant that is drawn as a line of its own.

    Args:
        label: for the legend.
        point: its uncertain numbers.
    """

    label: str
    point: tuple[float, ...]


@dataclass(frozen=True)
class Members:
    """A family of loops with one controller, to be drawn.

    Args:
        documents: of a design that has gains.
        gains: of the design.
        range_rad_s: ends of the frequency axis; chosen from crossovers, poles and requirements where left out.
    """

    documents: ResultDocuments
    gains: FoPi
    range_rad_s: tuple[float, float] | None = None

    @cached_property
    def sample(self) -> Sample:
        """The grid that the check in floating point starts from."""
        return Sample.of(self.documents.spec.plant, self.gains, self.documents.implementation)

    @property
    def numbers(self) -> tuple[str, ...]:
        """Names of the uncertain numbers that figures go along; a list of plants has none in common."""
        family = self.documents.spec.plant
        return () if isinstance(family, PlantList) else family.uncertain_names

    @cached_property
    def family_loops(self) -> Loops:
        """The loops of the grid, of a list of plants of every member's grid."""
        family = self.documents.spec.plant
        if not isinstance(family, PlantList):
            return self.sample.loops
        places = []
        for k, member in enumerate(family.members):
            sample = Sample.of(member.family, self.gains, self.documents.implementation)
            places.append(family.place(k, sample.points(sample.x)))
        return self.loops_at(np.vstack(places))

    @cached_property
    def named(self) -> tuple[Member, ...]:
        """The nominal plant, then the worst ones of the requirements; of a list also other members' nominal plants."""
        family = self.documents.spec.plant
        nominal = tuple(family.nominal_point.tolist())
        listed = named_place(family, family.nominal_point)
        members = [Member(f"nominal: {listed}" if listed else "nominal", nominal)]
        for found in self.documents.requirements:
            point = _worst_point(family, found)
            if point is not None and point not in (member.point for member in members):
                members.append(Member(f"worst: {_point_label(family, point)}", point))
        if isinstance(family, PlantList):
            for k, each in enumerate(family.members):
                point = tuple(family.place(k, each.family.nominal_point[None, :])[0].tolist())
                if point not in (member.point for member in members):
                    members.append(Member(each.name, point))
        return tuple(members[: 1 + _MOST_WORST])

    def loops_at(self, points: Array) -> Loops:
        """The loops of plants, shape (m, p)."""
        plants = Plants.members(self.documents.spec.plant, points)
        implementation = self.documents.implementation
        if implementation is None:
            return Loops.of(self.gains, plants)
        return SampledLoops.implemented(self.gains, implementation, plants)

    @cached_property
    def named_loops(self) -> Loops:
        """A row for each of `named`."""
        return self.loops_at(np.array([member.point for member in self.named], dtype=float))

    def stable_in_continuous_time(self, points: Array) -> NDArray[np.bool_]:
        """Whether each plant's loop with the ideal controller is stable, shape (m,); False where that is undecided."""
        try:
            return is_stable(Loops.of(self.gains, Plants.members(self.documents.spec.plant, points)))
        except DomainError:  # |L| stays on 1
            return np.zeros(len(points), dtype=bool)

    @cached_property
    def gains_at_phase_crossovers(self) -> list[tuple[int, float, float]]:
        """Of each of `named` that has one: its row, its lowest phase crossover, rad/s, and |L| there, above 0."""
        try:
            found = phase_crossovers(self.named_loops)
        except DomainError:  # too many to list: the figure does without them
            return []
        rows, first = np.unique(found.row, return_index=True)
        every = zip(rows.tolist(), found.omega_rad_s[first].tolist(), found.gain[first].tolist(), strict=True)
        return [each for each in every if each[2] > 0.0]

    @cached_property
    def parameter_values(self) -> Array:
        """Values of the first uncertain number, as `values_of`; empty without one."""
        return self.values_of(0, 21) if self.numbers else np.zeros(0)

    def values_of(self, index: int, count: int) -> Array:
        """Values of an uncertain number over its range, ascending, with the nominal value among them; shape (n,)."""
        family = self.documents.spec.plant
        low, high = float(family.low[index]), float(family.high[index])
        spaced = np.geomspace(low, high, count) if low > 0.0 else np.linspace(low, high, count)
        return np.unique(np.concatenate([spaced[1:-1], [low, high, float(family.nominal_point[index])]]))

    def points_along(self, values: Array, index: int = 0) -> Array:
        """Points with these values of one uncertain number and the others nominal; shape (m, p)."""
        points = np.tile(self.documents.spec.plant.nominal_point, (len(values), 1))
        points[:, index] = values
        return points

    @cached_property
    def omega(self) -> Array:
        """Frequencies to draw, rad/s; below Nyquist's."""
        loops = self.named_loops
        if self.range_rad_s is not None:
            top = min(self.range_rad_s[1], _BELOW_NYQUIST * loops.highest_rad_s)
            return np.geomspace(self.range_rad_s[0], top, _POINTS)
        turned = [omega for _, omega, _ in self.gains_at_phase_crossovers]
        crossings = np.append(gain_crossovers(loops).omega_rad_s, turned)
        ends = [end for r in self.documents.spec.requirements for end in (r.from_rad_s, r.to_rad_s)]
        said = [
            found.reported["worst"]["omega_rad_s"] for found in self.documents.requirements if found.reported["worst"]
        ]
        poles = Plants.members(self.documents.spec.plant, self.extreme_points()).pole_sizes_rad_s
        every = [*crossings.tolist(), *ends, *(float(each) for each in said if each), *poles.tolist()]
        middle = [omega for omega in every if 1e-9 < omega < 1e9] or [1.0]
        low, high = math.log10(min(middle)) - _BEYOND, math.log10(max(middle)) + _BEYOND
        low = max(low, high - _MOST_DECADES)
        if math.isfinite(loops.highest_rad_s):
            high = min(high, math.log10(_BELOW_NYQUIST * loops.highest_rad_s))
            low = min(low, high - 2.0)
        return np.asarray(np.logspace(low, high, _POINTS), dtype=float)

    @cached_property
    def near_unit_gain(self) -> Members:
        """The same over the frequencies where |L| is near 1: those that a Nyquist figure shows."""
        size = self.named_log_loop.real
        inside = np.flatnonzero(
            np.any((size > math.log(_NEAR_UNIT_GAIN[0])) & (size < math.log(_NEAR_UNIT_GAIN[1])), axis=0)
        )
        if len(inside) < 2:
            return self
        last = len(self.omega) - 1
        ends = self.omega[[max(int(inside[0]) - 1, 0), min(int(inside[-1]) + 1, last)]].tolist()
        return replace(self, range_rad_s=(ends[0], ends[1]))

    def extreme_points(self) -> Array:
        """The nominal plant and the box's two extreme corners; of a list of plants those of every member."""
        family = self.documents.spec.plant
        if isinstance(family, PlantList):
            return family.corners(0)
        return np.array([family.nominal_point, family.low, family.high])

    def log_loop(self, loops: Loops) -> Complex:
        """ln L of m loops at `omega`, unwrapped; shape (m, n)."""
        rows = np.repeat(np.arange(len(loops)), len(self.omega))
        u = np.tile(loops.u_of(self.omega), len(loops))
        return loops.log_response(rows, u).reshape(len(loops), len(self.omega))

    @cached_property
    def family_log_loop(self) -> Complex:
        """ln L of the whole grid, shape (m, n)."""
        return self.log_loop(self.family_loops)

    @cached_property
    def named_log_loop(self) -> Complex:
        """ln L of `named`, shape (m, n)."""
        return self.log_loop(self.named_loops)

    @cached_property
    def controller(self) -> Complex:
        """C at `omega`: of the digital controller where the loop is the one on samples."""
        implementation = self.documents.implementation
        if implementation is not None:
            return implementation.sections.response(self.omega, self.gains.measurement_filter)
        return self.gains(1j * self.omega)


def members_of(documents: ResultDocuments) -> Members | None:
    """The plants to draw; None where there is no loop, or its digital controller is not among the documents.

    Nor of measured responses, which have figures of their own.
    """
    if documents.spec.is_measured:
        return None
    gains = documents.gains
    if loop_name(documents.spec) == "sampled" and documents.implementation is None:
        return None
    return None if gains is None or gains.is_zero else Members(documents, gains)


def _worst_point(family: PlantFamily, found: ReportedRequirement) -> tuple[float, ...] | None:
    worst = found.reported["worst"] or {}
    plant = worst.get("plant")
    if isinstance(family, PlantList):
        index = next((k for k, each in enumerate(family.members) if each.name == worst.get("member")), None)
        if index is None or plant is None:
            return None
        own = [float(plant[name]) for name in family.members[index].family.uncertain_names]
        return tuple(family.place(index, np.array([own]))[0].tolist())
    return tuple(float(plant[name]) for name in family.uncertain_names) if plant else None


def _point_label(family: PlantFamily, point: Sequence[float]) -> str:
    place = np.array(point)
    numbers = ", ".join(f"{name} = {number(value, 4)}" for name, value in family.describe(place).items())
    return in_words(": ".join(part for part in (named_place(family, place), numbers) if part))
