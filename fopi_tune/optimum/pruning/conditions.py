"""Necessary conditions of gains that meet a spec with an objective better than a level.

A box in which one condition fails for all gains can be discarded.  Requirements without a condition are left out: this
relaxes the problem, so that the bound is weaker but still valid; `Conditions.left_out` names them.

The level of the objective is a condition too: a smaller peak of |S| is a limit of |S|, and a larger smallest slack (the
objective of a spec without one) shifts every limit.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from enum import StrEnum

from flint import arb

from fopi_tune.core.peaks import Response, Tilt
from fopi_tune.quantities import QUANTITIES
from fopi_tune.quantities.objectives import ObjectiveKind, default_horizon_s
from fopi_tune.quantities.responses import FrequencyFunction
from fopi_tune.spec.model import DesignSpec, Relation, Requirement, Scope


class Test(StrEnum):
    """How a box is tested for a condition; the value is its name in a certificate."""

    #: |R(j omega)| at one frequency of one plant stays on its side of e^level
    RESPONSE = "response"
    #: T |P/(1 + C P)| at s = 1/T stays below the level
    DISTURBANCE = "disturbance"
    #: the smallest angle between L and -1 over the gain crossovers, or the smallest lag less rate omega, is on its side
    #: of the level
    MARGIN = "margin"
    #: no phase crossover with -level < ln|L| < 0
    GAIN_MARGIN = "gain_margin"
    #: a gain crossover at or above e^level rad/s
    CROSSOVER = "crossover"
    #: |PM - PM(nominal)| stays below the level
    SPREAD = "spread"
    #: |ln|P/P0|| at the highest nominal crossover stays below the level
    GAIN_SPREAD = "gain_spread"
    #: a gain on its side of the level
    GAIN = "gain"
    #: every plant's loop is stable, behind more dead time where a delay margin asks for it
    STABILITY = "stability"
    #: at a crossover below the fixed one L is the nominal phase margin that is asked for from -1
    LOWER_CROSSOVER = "lower_crossover"


@dataclass(frozen=True)
class Condition:
    """One condition.

    Args:
        test: how a box is tested.
        name: the quantity, as in the spec.
        upper: it is an upper limit.
        level: neper, radian, or the gain itself; balls, so that no rounding of a limit is lost.
        requirement: its place in the spec; None of the objective, of stability and of the ranges.
        of_objective: whether the level depends on the level of the objective.
        nominal: whether it is about the nominal plant only.
        response: of a response.
        band_rad_s: of a response, both ends included.
        rate: of a delay margin, its limit, s; of stability the additional dead time, s.
        horizon_s: of the disturbance's error.
        line: of a response whose limit is a line over ln omega, what it rises by from the lower to the upper end of the
            band, neper; `level` is then that at the lower end.
        tilt: the same in floating point.
    """

    test: Test
    name: str
    upper: bool
    level: arb
    requirement: int | None = None
    of_objective: bool = False
    nominal: bool = False
    response: Response | None = None
    band_rad_s: tuple[float, float] = (0.0, math.inf)
    rate: arb | None = None
    horizon_s: float = 0.0
    line: arb | None = None
    tilt: Tilt | None = None

    def level_at(self, omega_rad_s: float) -> arb:
        """The level of a response's limit at a frequency, neper."""
        if self.line is None:
            return self.level
        low, high = (arb(end) for end in self.band_rad_s)
        return self.level + self.line * (arb(omega_rad_s) / low).log() / (high / low).log()

    @property
    def words(self) -> str:
        """The condition in words, for messages."""
        return self.name if not self.of_objective else f"{self.name} (objective)"


@dataclass(frozen=True)
class Conditions:
    """All conditions of one spec and one level.

    Args:
        every: in a fixed order, which does not depend on the level.
        left_out: requirements without a condition, in words.
    """

    every: tuple[Condition, ...]
    left_out: tuple[str, ...]


#: objectives that are equivalent to a limit of a response
_PEAKS = {
    ObjectiveKind.SENSITIVITY_PEAK: Response.SENSITIVITY,
    ObjectiveKind.CONTROL_SENSITIVITY_PEAK: Response.CONTROL_SENSITIVITY,
    ObjectiveKind.LOAD_SENSITIVITY_PEAK: Response.LOAD_SENSITIVITY,
}


def db(value: float) -> arb:
    """Decibels in neper."""
    return arb(value) * arb(10).log() / 20


def degrees(value: float) -> arb:
    """Degrees in radian."""
    return arb(value) * arb.pi() / 180


def kind_of(spec: DesignSpec) -> ObjectiveKind:
    """The objective; depth without one."""
    return ObjectiveKind(spec.objective.quantity) if spec.objective else ObjectiveKind.DEPTH


def is_maximized(spec: DesignSpec) -> bool:
    """Whether a larger objective is a better one."""
    return kind_of(spec) in (ObjectiveKind.KI, ObjectiveKind.DEPTH)


def conditions_of(spec: DesignSpec, beat: float | None) -> Conditions:
    """The conditions of meeting a spec with an objective better than a level.

    Args:
        spec: what is asked.
        beat: level of the objective, public unit; None for the requirements alone.
    """
    deeper = arb(0)
    if beat is not None and kind_of(spec) is ObjectiveKind.DEPTH:
        deeper = arb(beat)
    found = [Condition(Test.STABILITY, "stability", True, arb(0)), *_ranges(spec)]
    left_out: list[str] = []
    for place, requirement in enumerate(spec.requirements):
        own = list(_of_requirement(spec, place, requirement, deeper, left_out))
        found += own
    if margin := nominal_equality(spec, "phase_margin_deg"):
        found.append(Condition(Test.LOWER_CROSSOVER, "phase_margin_deg", True, degrees(margin.limits[0]), nominal=True))
    found += _of_objective(spec, beat)
    return Conditions(tuple(found), tuple(left_out))


def _ranges(spec: DesignSpec) -> Iterator[Condition]:
    for name in ("kp", "ki", "kd") if spec.controller.has_derivative else ("kp", "ki"):
        side = getattr(spec.controller, name)
        for upper, level in ((False, side.min), (True, side.max)):
            if math.isfinite(level):
                yield Condition(Test.GAIN, name, upper, arb(level))


def _of_requirement(
    spec: DesignSpec, place: int, requirement: Requirement, deeper: arb, left_out: list[str]
) -> Iterator[Condition]:
    quantity = QUANTITIES[requirement.quantity]
    equals, by_depth = requirement.relation is Relation.EQUALS, kind_of(spec) is ObjectiveKind.DEPTH
    # an exact plant is its family's only member
    nominal = requirement.scope is Scope.NOMINAL or not spec.plant.uncertain_names
    for upper, limit in ((False, requirement.lower), (True, requirement.upper)):
        if not math.isfinite(limit):
            continue
        shift = arb(0) if equals else -deeper if upper else deeper
        common = {"requirement": place, "of_objective": by_depth and not equals, "nominal": nominal}
        name = requirement.quantity
        if isinstance(quantity, FrequencyFunction):
            yield Condition(
                Test.RESPONSE, name, upper, db(limit) + shift, **common,
                response=quantity.response, band_rad_s=(requirement.from_rad_s, requirement.to_rad_s),
                line=None if requirement.end_limit is None else db(requirement.end_limit) - db(limit),
                tilt=requirement.tilt,
            )  # fmt: skip
        elif name == "phase_margin_deg":
            yield Condition(Test.MARGIN, name, upper, degrees(limit) + shift, **common)
        elif name == "delay_margin_s" and spec.sampled_design is None:
            rate = arb(limit) + shift * abs(arb(limit))
            yield Condition(Test.MARGIN, name, upper, arb(0), **common, rate=rate)
            if not upper:  # a stable loop stays stable behind any more dead time below its delay margin
                yield Condition(Test.STABILITY, name, upper, arb(0), **common, rate=rate / 2)
        elif name == "gain_margin_db" and not upper:
            yield Condition(Test.GAIN_MARGIN, name, upper, db(limit) + shift, **common)
        elif name == "crossover_rad_s" and (
            not upper or (spec.plant.is_strictly_proper and spec.sampled_design is None)
        ):
            level = arb(limit).log() + shift
            if not upper:
                yield Condition(Test.CROSSOVER, name, upper, level, **common)
                continue
            # |L| -> 0 as omega -> inf: where |L| > 1 there is a higher crossover
            first = math.nextafter(float(level.exp().upper()), math.inf) if deeper != 0 else limit
            yield Condition(
                Test.RESPONSE, name, True, arb(0), **common,
                response=Response.LOOP_GAIN, band_rad_s=(first, math.inf),
            )  # fmt: skip
        else:
            left_out.append(f"{name} {'at most' if upper else 'at least'} {limit:g}")


def nominal_equality(spec: DesignSpec, quantity: str) -> Requirement | None:
    """The requirement that fixes a quantity of the nominal plant; None without one."""
    for requirement in spec.requirements:
        nominal = requirement.scope is Scope.NOMINAL or not spec.plant.uncertain_names
        if requirement.quantity == quantity and requirement.relation is Relation.EQUALS and nominal:
            return requirement
    return None


def _of_objective(spec: DesignSpec, beat: float | None) -> Iterator[Condition]:
    if beat is None:
        return
    kind, level = kind_of(spec), arb(beat)
    if kind is ObjectiveKind.KI:
        yield Condition(Test.GAIN, "ki", False, level, of_objective=True)
    elif kind is ObjectiveKind.IAE_DISTURBANCE:
        assert spec.objective is not None
        given = spec.objective.horizon_s
        horizon = default_horizon_s(spec.plant) if given is None else given
        yield Condition(Test.DISTURBANCE, kind.value, True, level, of_objective=True, horizon_s=horizon)
    elif kind in _PEAKS:
        yield Condition(Test.RESPONSE, kind.value, True, db(beat), of_objective=True, response=_PEAKS[kind])
    elif kind is ObjectiveKind.PHASE_MARGIN_SPREAD and (fixed := nominal_equality(spec, "phase_margin_deg")):
        # the nominal margin is known: the others lie within the level of it
        for upper, sign in ((False, -1), (True, 1)):
            margin = degrees(fixed.limits[0]) + sign * degrees(beat)
            yield Condition(Test.MARGIN, kind.value, upper, margin, of_objective=True)
    elif kind is ObjectiveKind.PHASE_MARGIN_SPREAD:
        yield Condition(Test.SPREAD, kind.value, True, degrees(beat), of_objective=True)
    elif kind is ObjectiveKind.CROSSOVER_SPREAD:
        yield Condition(Test.GAIN_SPREAD, kind.value, True, db(beat), of_objective=True)
    elif kind is not ObjectiveKind.DEPTH:
        raise ValueError(f"no condition is known for the objective {kind.value}")
    elif not any(r.relation is not Relation.EQUALS for r in spec.requirements):
        # depth without inequalities: minus ln of the largest |S|
        yield Condition(Test.RESPONSE, kind.value, True, -level, of_objective=True, response=Response.SENSITIVITY)
