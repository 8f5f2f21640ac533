"""A list of plants:  several families, each with its own model and its own ranges; requirements hold for all of them.

The list is no box and has no ranges of its own: whatever asks it for a box is refused.  Its members stay apart, and a
place in it is

    (k, theta_1, ..., theta_p) ,

the member's index from 0 and its uncertain numbers.  Where places of several members make a table, shorter ones are
filled up with zeros at the end, and polynomials of lower degree with zeros at the beginning.  Stages that search a box
(check, proof) do so in each member; the design has one table of the plants of all of them.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Any, NoReturn

import numpy as np
from numpy.typing import NDArray

from fopi_tune.core.bode_form import Array
from fopi_tune.core.measured.family import MeasuredFamily
from fopi_tune.core.plant import Plant, PlantFamily, Uncertain
from fopi_tune.errors import DomainError

#: what stands for the model
LIST = "list"


@dataclass(frozen=True)
class PlantMember:
    """One member of a list.

    Args:
        name: for messages and reports, another for each.
        family: its plants.
        weight: how often Monte Carlo draws it, relative to the others; > 0.
    """

    name: str
    family: PlantFamily
    weight: float = 1.0


@dataclass(frozen=True)
class PlantList(PlantFamily):
    """Every plant of every member.  The nominal plant is that of the first one.

    Args:
        model: stands for the models of the members.
        parameters: none: each member has its own.
        members: at least one, in the order of the spec.
    """

    members: tuple[PlantMember, ...] = ()

    @classmethod
    def of(cls, members: Sequence[PlantMember]) -> PlantList:
        """The list.

        Args:
            members: in the order of the spec.

        Raises:
            DomainError: there is no member, or two of them have the same name.
        """
        names = [member.name for member in members]
        if not names or len(set(names)) < len(names):
            raise DomainError("a list of plants needs at least one, each with a name of its own")
        return cls(LIST, {}, tuple(members))

    @property
    def width(self) -> int:
        """Columns of a table of places: 1 + the largest number of uncertain numbers."""
        return 1 + max(len(member.family.uncertain_names) for member in self.members)

    @property
    def first(self) -> PlantFamily:
        """The member whose nominal plant is the list's."""
        return self.members[0].family

    def place(self, index: int, points: Array) -> Array:
        """Places in the list, shape (m, width).

        Args:
            index: of the member, from 0.
            points: of its box, shape (m, p), in its numbers' units.
        """
        found = np.zeros((len(points), self.width))
        found[:, 0] = index
        found[:, 1 : 1 + points.shape[1]] = points
        return found

    def parts(self, places: Array) -> Iterator[tuple[int, NDArray[np.intp], Array]]:
        """Of each member in `places`, shape (m, width): its index, the rows that are its, their points of its box."""
        for index in range(len(self.members)):
            rows = np.flatnonzero(places[:, 0] == index)
            if len(rows):
                yield index, rows, self.point(index, places[rows])

    def point(self, index: int, places: Array) -> Array:
        """Points of a member's box, shape (m, p), in its numbers' units.

        Args:
            index: of the member, from 0.
            places: in the list, all of them that member's, shape (m, width).
        """
        return np.ascontiguousarray(places[:, 1 : 1 + len(self.members[index].family.uncertain_names)])

    @property
    def has_one_plant(self) -> bool:
        """Whether there is only one member, and of this only one possible plant."""
        return len(self.members) == 1 and self.first.has_one_plant

    @property
    def nominal_point(self) -> Array:
        """The first member's nominal plant as a place in the list, shape (width,)."""
        return self.place(0, self.first.nominal_point[None, :])[0]

    @property
    def dead_time(self) -> Uncertain:
        """The nominal plant's dead time, between the shortest and the longest of any member, s."""
        every = [member.family.dead_time for member in self.members]
        return Uncertain(every[0].nominal, min(each.min for each in every), max(each.max for each in every))

    @property
    def is_strictly_proper(self) -> bool:
        """Whether every member's plants are."""
        return all(member.family.is_strictly_proper for member in self.members)

    @property
    def is_affine_in_each_number(self) -> bool:
        """Whether every member's coefficients are."""
        return all(member.family.is_affine_in_each_number for member in self.members)

    def corners(self, most: int = 64) -> Array:
        """The corners of every member's box, each member's nominal plant before its own; shape (m, width).

        Args:
            most: corners of a box; of one with more only two.
        """
        return np.vstack([self.place(k, each.family.corners(most)) for k, each in enumerate(self.members)])

    def coefficients(self, points: Array) -> tuple[Array, Array, Array]:
        """Coefficients at places in the list, shape (m, width).

        Args:
            points: the places, shape (m, width).

        Returns:
            numerators (m, a), denominators (m, b) in descending powers of s, those of lower degree with zeros at the
            beginning, and dead times (m,) in s.
        """
        parts = [(rows, self.members[k].family.coefficients(own)) for k, rows, own in self.parts(points)]
        numerator, denominator = (
            _stacked(len(points), [(rows, found[side]) for rows, found in parts]) for side in (0, 1)
        )
        dead_time = np.zeros(len(points))
        for rows, found in parts:
            dead_time[rows] = found[2]
        return numerator, denominator, dead_time

    def member(self, point: Array) -> Plant:
        """The plant at a place, `point` of shape (width,)."""
        index, own = self._split(point)
        return self.members[index].family.member(own)

    def describe(self, point: Array) -> dict[str, float]:
        """The uncertain numbers of the plant at a place, `point` of shape (width,), by name."""
        index, own = self._split(point)
        return self.members[index].family.describe(own)

    def name_at(self, point: Array) -> str:
        """The name of the member at a place, `point` of shape (width,)."""
        return self.members[self._split(point)[0]].name

    def _split(self, point: Array) -> tuple[int, Array]:
        found = np.asarray(point, dtype=float)
        index = int(found[0])
        return index, found[1 : 1 + len(self.members[index].family.uncertain_names)]

    def refused(self, points: Array) -> NDArray[np.bool_]:
        """Which places, `points` of shape (m, width), are no plants of their members; shape (m,)."""
        found = np.zeros(len(points), dtype=bool)
        for index, rows, own in self.parts(points):
            found[rows] = self.members[index].family.refused(own)
        return found

    def why_refused(self, point: Array) -> str | None:
        """Why a place, `point` of shape (width,), is refused; None where it is not."""
        index, own = self._split(point)
        why = self.members[index].family.why_refused(own)
        return None if why is None else f"{self.members[index].name}: {why}"

    @property
    def uncertain_names(self) -> NoReturn:
        """Refused: each member has its own.

        Raises:
            DomainError: always.
        """
        self._no_box()

    @property
    def dead_time_axis(self) -> NoReturn:
        """Refused: each member has its own.

        Raises:
            DomainError: always.
        """
        self._no_box()

    def problem(self, name: str, value: Uncertain) -> NoReturn:
        """Refused: `name` and `value`, in any unit, are of no member.

        Raises:
            DomainError: always.
        """
        self._no_box()

    def assemble(self, values: Any, number: Callable[[Fraction], Any] = float) -> NoReturn:
        """Refused: `values`, in any unit, and what makes a `number` of them are of no member.

        Raises:
            DomainError: always.
        """
        self._no_box()

    def _no_box(self) -> NoReturn:
        raise DomainError(
            "a list of plants has no common box of uncertain numbers, which this needs; take `plant:` with one of them"
        )


def members_of(family: PlantFamily) -> tuple[PlantMember, ...]:
    """The members of a list; of another family itself, without a name."""
    return family.members if isinstance(family, PlantList) else (PlantMember("", family),)


def named_place(family: PlantFamily, point: Array) -> str:
    """The name of the member of a list, or of measured responses, at a place of it; empty for another family."""
    return family.name_at(point) if isinstance(family, PlantList | MeasuredFamily) else ""


def _stacked(count: int, parts: Sequence[tuple[NDArray[np.intp], Array]]) -> Array:
    """Rows of polynomials in descending powers, of any degrees, as one table with zeros at the beginning."""
    found = np.zeros((count, max((rows.shape[1] for _, rows in parts), default=1)))
    for rows, polynomials in parts:
        found[rows, found.shape[1] - polynomials.shape[1] :] = polynomials
    return found
