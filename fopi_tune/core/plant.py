"""Plants and families of plants.

A plant is  P(s) = N(s)/D(s) e^{-dead_time_s s}  with real polynomials; a family is the whole box of its uncertain
numbers.  To add a model, add one `PlantModel` to `PLANT_MODELS`: the spec language, the design and the proof read it
there.  `fopi init` has a start for every model (`spec/templates/sections.py`), and a test says so.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from fractions import Fraction
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fopi_tune.core.bode_form import Array
from fopi_tune.core.terms.numbers import keep_plain, plain_numbers
from fopi_tune.errors import DomainError

#: numerator and denominator coefficients in descending powers of s, then the dead time; of floats, arrays or symbols
Assembled = tuple[list[Any], list[Any], Any]


@dataclass(frozen=True)
class Uncertain:
    """A number known to lie in [min, max], in the unit of the number's name.

    Args:
        nominal: value of the nominal plant, same unit.
        min: smallest possible value, same unit.
        max: largest possible value, same unit.

    Raises:
        DomainError: not finite, min > max, or the nominal value lies outside.
    """

    nominal: float
    min: float
    max: float

    def __post_init__(self) -> None:
        keep_plain(self, "nominal", "min", "max")
        if self.min > self.max:
            raise DomainError(f"min {self.min!r} is greater than max {self.max!r}; swap them")
        if not self.min <= self.nominal <= self.max:
            raise DomainError(f"nominal {self.nominal!r} lies outside [{self.min!r}, {self.max!r}]")

    @classmethod
    def exactly(cls, value: float) -> Uncertain:
        """A number that is known: `value`, in any unit."""
        return cls(value, value, value)

    @classmethod
    def between(cls, low: float, high: float) -> Uncertain:
        """A number from `low` to `high`, in any unit, whose nominal value is the midpoint."""
        return cls(low + 0.5 * (high - low), low, high)

    @property
    def is_exact(self) -> bool:
        """Whether there is only one possible value."""
        return self.min == self.max


@dataclass(frozen=True)
class Plant:
    """One plant, P(s) = N(s)/D(s) e^{-dead_time_s s}.

    Args:
        numerator: coefficients of N in descending powers of s.
        denominator: coefficients of D in descending powers of s; the first is not 0.
        dead_time_s: dead time, >= 0.

    Raises:
        DomainError: not proper, not finite, a zero polynomial, or a negative dead time.
    """

    numerator: tuple[float, ...]
    denominator: tuple[float, ...]
    dead_time_s: float = 0.0

    def __post_init__(self) -> None:
        for name in ("numerator", "denominator"):
            object.__setattr__(self, name, plain_numbers(name, getattr(self, name)))
        keep_plain(self, "dead_time_s")
        if not all(math.isfinite(v) for v in (*self.numerator, *self.denominator)):
            raise DomainError("a plant's coefficients must be finite numbers")
        if not any(self.numerator):
            raise DomainError("the numerator is 0: there is no plant to control")
        if not self.denominator or self.denominator[0] == 0.0:
            raise DomainError("the denominator's first coefficient is 0; leave leading zeros out")
        if len(np.trim_zeros(self.numerator, "f")) > len(self.denominator):
            raise DomainError("the numerator's degree exceeds the denominator's; a plant must be proper")
        if self.dead_time_s < 0:
            raise DomainError(
                f"dead_time_s = {self.dead_time_s!r} is negative; a plant cannot answer before it is asked"
            )

    def batch(self, kind: Callable[[Array, Array, Array], Any]) -> Any:
        """The plant as a batch of one row, made by `kind` of arrays of shapes (1, a), (1, b) and (1,)."""
        return kind(np.array([self.numerator]), np.array([self.denominator]), np.array([self.dead_time_s]))

    @classmethod
    def from_control(cls, system: Any, dead_time_s: float = 0.0) -> Plant:
        """The plant of a continuous `control.TransferFunction` or `control.StateSpace` with one input and one output.

        Coefficients of a TransferFunction are copied; those of a StateSpace are exactly its matrices', rounded once.

        Args:
            system: stable or not; nothing in it is cancelled.
            dead_time_s: of the plant, s, which these objects cannot hold.

        Raises:
            DomainError: an object of another kind, discrete, improper, with several inputs or outputs, or 0.
        """
        from fopi_tune.core.external.control_objects import coefficients_of

        return cls(*coefficients_of(system), dead_time_s)


@dataclass(frozen=True)
class PlantModel:
    """A parametrisation of plants: its numbers, and how they determine N, D and the dead time.

    Args:
        name: the word after `model:` in a spec.
        scalars: names of its numbers, unit included; `dead_time_s` is optional and 0 when left out.
        lists: names of its coefficient lists; entry i of list x is the parameter "x[i]".
        assemble: parameters (floats, arrays of equal shape, or CasADi symbols) to coefficients.
        check: (name, Uncertain) to an error message for that number in this model, or None.
    """

    name: str
    scalars: tuple[str, ...]
    lists: tuple[str, ...]
    assemble: Callable[[Mapping[str, Any]], Assembled]
    check: Callable[[str, Uncertain], str | None]


def _lag(p: Mapping[str, Any]) -> Assembled:
    # P(s) = static_gain e^{-Ls} / (time_constant_s s + 1)
    return [p["static_gain"]], [p["time_constant_s"], 1.0], p["dead_time_s"]


def _pole(p: Mapping[str, Any]) -> Assembled:
    # P(s) = gain e^{-Ls} / (s + pole_rad_s)
    return [p["gain"]], [1.0, p["pole_rad_s"]], p["dead_time_s"]


def _transfer_function(p: Mapping[str, Any]) -> Assembled:
    def coefficients(name: str) -> list[Any]:
        return [value for key, value in p.items() if key.startswith(name + "[")]

    return coefficients("numerator"), coefficients("denominator"), p["dead_time_s"]


def _check_number(name: str, value: Uncertain) -> str | None:
    if name == "dead_time_s" and value.min < 0:
        return "must be at least 0; a plant cannot answer before it is asked"
    if name == "time_constant_s" and value.min <= 0:
        return "must be greater than 0; write an unstable or integrating plant as model: pole"
    if name in ("static_gain", "gain", "denominator[0]") and value.min <= 0 <= value.max:
        return "must not be or contain 0; the family's sign must be known"
    return None


PLANT_MODELS: dict[str, PlantModel] = {
    model.name: model
    for model in (
        PlantModel("lag", ("static_gain", "time_constant_s", "dead_time_s"), (), _lag, _check_number),
        PlantModel("pole", ("gain", "pole_rad_s", "dead_time_s"), (), _pole, _check_number),
        PlantModel(
            "transfer_function", ("dead_time_s",), ("numerator", "denominator"), _transfer_function, _check_number
        ),
    )
}


@dataclass(frozen=True)
class PlantFamily:
    """Every plant of a model whose numbers lie in their ranges: the whole box, its interior included.

    Args:
        model: a key of `PLANT_MODELS`.
        parameters: all of the model's numbers in order, name to `Uncertain`.
    """

    model: str
    parameters: Mapping[str, Uncertain]

    @property
    def uncertain_names(self) -> tuple[str, ...]:
        """Names of the numbers that are not exact, in order; the axes of the box."""
        return tuple(name for name, value in self.parameters.items() if not value.is_exact)

    @property
    def low(self) -> Array:
        """Lower corner of the box, shape (p,), in the parameters' units."""
        return np.array([self.parameters[n].min for n in self.uncertain_names], dtype=float)

    @property
    def high(self) -> Array:
        """Upper corner of the box, shape (p,)."""
        return np.array([self.parameters[n].max for n in self.uncertain_names], dtype=float)

    @property
    def nominal_point(self) -> Array:
        """The nominal plant as a point of the box, shape (p,)."""
        return np.array([self.parameters[n].nominal for n in self.uncertain_names], dtype=float)

    @property
    def has_one_plant(self) -> bool:
        """Whether every number is exact: there is only one possible plant."""
        return not self.uncertain_names

    def problem(self, name: str, value: Uncertain) -> str | None:
        """An error message for a range of the number called `name` in this model, or None."""
        return PLANT_MODELS[self.model].check(name, value)

    @property
    def dead_time(self) -> Uncertain:
        """The dead time, s."""
        return self.parameters["dead_time_s"]

    @property
    def dead_time_axis(self) -> int | None:
        """The box's axis that is the dead time; None where it is exact."""
        names = self.uncertain_names
        return names.index("dead_time_s") if "dead_time_s" in names else None

    @property
    def is_strictly_proper(self) -> bool:
        """Whether |P| -> 0 as omega -> inf for every member."""
        # leading coefficients that are 0 for every corner are 0 for every member: each is affine in each number
        top, bottom, _ = self.coefficients(self.corners())
        leading = np.flatnonzero(np.any(top != 0.0, axis=0))
        return len(leading) == 0 or top.shape[1] - leading[0] < bottom.shape[1]

    @property
    def is_affine_in_each_number(self) -> bool:
        """Whether every coefficient is, the other numbers fixed."""
        return True

    def refused(self, points: Array) -> NDArray[np.bool_]:
        """Which `points` of numbers, each of which may be such a number, are no plants together.

        Args:
            points: shape (m, p), of the box or outside, in the parameters' units.

        Returns:
            Shape (m,).
        """
        return np.zeros(len(points), dtype=bool)

    def why_refused(self, point: Array) -> str | None:
        """Why one `point`, shape (p,), in the parameters' units, is refused; None where it is not."""
        return None

    def corners(self, most: int = 64) -> Array:
        """The nominal point, then the box's corners, shape (1 + 2^p, p); two of them if there are more than `most`."""
        low, high = self.low, self.high
        if 2 ** len(low) > most:
            return np.array([self.nominal_point, low, high])
        every = list(itertools.product(*zip(low.tolist(), high.tolist(), strict=True)))
        return np.array([self.nominal_point.tolist(), *map(list, every)]).reshape(1 + len(every), len(low))

    def assemble(self, values: Mapping[str, Any], number: Callable[[Fraction], Any] = float) -> Assembled:
        """Coefficients from `values` of the uncertain numbers (floats, arrays, balls or symbols) by name.

        The exact ones are filled in; a value that is missing is the nominal one.  `number` makes one of their kind of a
        rational number that a family by parameters has in its coefficients.
        """
        full = {name: values.get(name, number.nominal) for name, number in self.parameters.items()}
        return PLANT_MODELS[self.model].assemble(full)

    def coefficients(self, points: Array) -> tuple[Array, Array, Array]:
        """Coefficients of many members at once.

        Args:
            points: shape (m, p), points of the box, columns as `uncertain_names`.

        Returns:
            numerators (m, a), denominators (m, b) in descending powers of s, dead times (m,) in s.
        """
        numerator, denominator, dead_time = self.assemble(dict(zip(self.uncertain_names, points.T, strict=True)))
        rows = len(points)

        def table(column: list[Any]) -> Array:
            found = np.empty((rows, len(column)))
            for k, entry in enumerate(column):
                found[:, k] = entry
            return found

        return table(numerator), table(denominator), table([dead_time])[:, 0]

    def batch(self, points: Array, kind: Callable[[Array, Array, Array], Any]) -> Any:
        """The members at `points`, shape (m, p), as a batch made by `kind` of what `coefficients` returns."""
        return kind(*self.coefficients(points))

    def member(self, point: Array) -> Plant:
        """The plant at one `point` of the box, shape (p,)."""
        numerator, denominator, dead_time = self.coefficients(np.asarray(point, dtype=float)[None, :])
        return Plant(tuple(numerator[0].tolist()), tuple(denominator[0].tolist()), float(dead_time[0]))

    def describe(self, point: Array) -> dict[str, float]:
        """The uncertain numbers of the member at `point`, shape (p,), by name, as results report their worst plant."""
        return {name: float(value) for name, value in zip(self.uncertain_names, point, strict=True)}


@dataclass(frozen=True)
class JointFamily(PlantFamily):
    """Several families as one box of uncertain numbers, each named FAMILY.NUMBER.  The box itself is no plant.

    Args:
        members: the families by name.
        shared: numbers that all of them have with the same range, and that are one number of the box, by its own name.
    """

    members: Mapping[str, PlantFamily] = field(default_factory=dict)
    shared: tuple[str, ...] = ()

    @classmethod
    def of(cls, members: Mapping[str, PlantFamily], shared: tuple[str, ...] = ()) -> JointFamily:
        """The joint box of `members`; `shared` as above."""
        numbers = {
            key if key in shared else f"{name}.{key}": value
            for name, one in members.items()
            for key, value in one.parameters.items()
        }
        return cls(" and ".join(members), numbers, members, shared)

    def columns(self, name: str) -> list[int]:
        """The box's axes that are the uncertain numbers of the member called `name`, in their order."""
        axes = self.uncertain_names
        numbers = self.members[name].uncertain_names
        return [axes.index(key if key in self.shared else f"{name}.{key}") for key in numbers]

    def problem(self, name: str, value: Uncertain) -> str | None:
        if name in self.shared:
            every = (member.problem(name, value) for member in self.members.values())
            return next((wrong for wrong in every if wrong is not None), None)
        member, _, number = name.partition(".")
        return self.members[member].problem(number, value)

    def refused(self, points: Array) -> NDArray[np.bool_]:
        found = np.zeros(len(points), dtype=bool)
        for name, member in self.members.items():
            found |= member.refused(points[:, self.columns(name)])
        return found

    def why_refused(self, point: Array) -> str | None:
        for name, member in self.members.items():
            if (why := member.why_refused(point[self.columns(name)])) is not None:
                return f"{name}: {why}"
        return None
