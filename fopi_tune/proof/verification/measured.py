"""Verification with measured responses:  every member, at every frequency of the band, between points as interpolated.

Members are a list, so that no box is searched.  A quantity's value at a frequency is its own formula
(`Quantity.natural`) at the points of a loop (`core/measured/loops.py`); where it is read says `Quantity.where`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from fopi_tune.core.bode_form import Array
from fopi_tune.core.controller import FoPi
from fopi_tune.core.margins import Margins
from fopi_tune.core.measured.family import MeasuredFamily
from fopi_tune.core.measured.loops import LoopPoints, MeasuredLoop
from fopi_tune.core.measured.stability import PoleCount, count_unstable_poles
from fopi_tune.core.peaks import Tilt
from fopi_tune.core.text_tables.words import counted
from fopi_tune.errors import DomainError
from fopi_tune.proof.verification.objectives import smallest_slack
from fopi_tune.proof.verification.requirements import assess_requirement
from fopi_tune.proof.verification.results import Extreme, Outcome, Place, RequirementResult, Stability, Verification
from fopi_tune.quantities import QUANTITIES
from fopi_tune.quantities.base import NEPER_PER_DB, EvaluatedAt, Quantity
from fopi_tune.quantities.objectives import ObjectiveKind
from fopi_tune.spec.model import DesignSpec, Objective, Requirement, Scope

#: value in the public unit, and omega; nan without a value
Found = tuple[float, float]
_PEAKS = {
    ObjectiveKind.SENSITIVITY_PEAK: "sensitivity_db",
    ObjectiveKind.CONTROL_SENSITIVITY_PEAK: "control_sensitivity_db",
    ObjectiveKind.LOAD_SENSITIVITY_PEAK: "load_sensitivity_db",
}
_PER_DB = 1.0 / NEPER_PER_DB


@dataclass(frozen=True, eq=False)
class MeasuredSample:
    """The loops of all members with one controller.

    Args:
        family: the members.
        loops: one for each.
        counts: of each, unstable poles.
    """

    family: MeasuredFamily
    loops: tuple[MeasuredLoop, ...]
    counts: tuple[PoleCount, ...]

    @classmethod
    def of(cls, family: MeasuredFamily, gains: FoPi) -> MeasuredSample:
        """The loops.

        Raises:
            DomainError: all gains are 0, or a dead time that turns the phase too often in the band.
        """
        loops = tuple(MeasuredLoop(gains, member.table, family.band_rad_s) for member in family.members)
        return cls(family, loops, tuple(count_unstable_poles(loop, family.unstable_poles) for loop in loops))

    def place(self, member: int, omega_rad_s: float | None) -> Place:
        """A member and a frequency in the user's terms; nan is no frequency."""
        omega = None if omega_rad_s is None or math.isnan(omega_rad_s) else omega_rad_s
        return Place(omega, {}, (float(member),), self.family.members[member].name)

    @property
    def stability(self) -> Stability:
        """Of the first unstable member, else of the first undecided one, else of that which comes closest to -1."""
        peaks = [_band(QUANTITIES["sensitivity_db"], loop, True, 0.0, math.inf) for loop in self.loops]
        worst = max(range(len(peaks)), key=lambda k: peaks[k][0])
        unstable = next((k for k, each in enumerate(self.counts) if (each.unstable or 0.0) > 0.5), None)
        open_one = next((k for k, each in enumerate(self.counts) if each.unstable is None), None)
        if unstable is not None:
            count = self.counts[unstable].unstable
            assert count is not None
            poles = round(count) if math.isfinite(count) else None
            there = "" if poles is None else f"{counted(poles, 'closed-loop pole')} in the right half-plane"
            reason = f"{there or 'the loop passes through -1'}; {self._assumed}"
            return Stability(False, peaks[unstable][0], self.place(unstable, peaks[unstable][1]), poles, reason)
        place = self.place(worst, peaks[worst][1])
        if open_one is not None:
            reason = self.counts[open_one].reason
            return Stability(False, peaks[worst][0], self.place(open_one, None), None, reason, undecided=True)
        reason = f"{self._assumed}; |S| stays below {peaks[worst][0] + 0.005:.2f} dB in the band"
        return Stability(True, peaks[worst][0], place, 0, reason)

    @property
    def _assumed(self) -> str:
        low, high = self.family.band_rad_s
        return (
            f"Nyquist's count in the measured band, with {self.family.unstable_poles} unstable poles of the plant; "
            f"assumed: below {low:.5g} rad/s the plant goes on as its lowest frequencies look, and above {high:.5g} "
            "rad/s |L| stays below 1"
        )


def verify_measured(spec: DesignSpec, family: MeasuredFamily, gains: FoPi, tolerance: float) -> Verification:
    """Check stability, every requirement and the objective, in the band of the measurement.

    Args:
        spec: requirements and objective.
        family: its plant.
        gains: the controller.
        tolerance: allowed violation, in neper or radian.

    Raises:
        DomainError: all gains are 0, the objective needs a transfer function, or the dead time turns the phase too
            often.
    """
    sample = MeasuredSample.of(family, gains)
    stability = sample.stability
    requirements = tuple(_requirement(each, sample, stability, tolerance) for each in spec.requirements)
    objective, place = _objective(spec.objective, sample, requirements)
    return Verification(
        gains, stability, requirements, objective, place, _nominal_margins(sample), tolerance
    )  # fmt: skip


def _requirement(
    requirement: Requirement, sample: MeasuredSample, stability: Stability, tolerance: float
) -> RequirementResult:
    quantity = QUANTITIES[requirement.quantity]
    rows = range(1 if requirement.scope is Scope.NOMINAL else len(sample.loops))
    counts = [sample.counts[k] for k in rows]
    sides = [side for side, limit in ((False, requirement.lower), (True, requirement.upper)) if math.isfinite(limit)]
    if quantity.is_margin and any((each.unstable or 0.0) > 0.5 for each in counts):
        row = next(k for k in rows if (sample.counts[k].unstable or 0.0) > 0.5)
        missing = tuple(Extreme(side, None, sample.place(row, None)) for side in sides)
        return assess_requirement(requirement, missing, tolerance)
    if quantity.is_margin and any(each.unstable is None for each in counts):
        place = sample.place(next(k for k in rows if sample.counts[k].unstable is None), None)
        extremes = tuple(Extreme(side, None, place) for side in sides)
        return RequirementResult(requirement, None, Outcome.UNDECIDED, None, None, place, extremes)
    extremes = tuple(_extreme(requirement, quantity, sample, rows, side) for side in sides)
    return assess_requirement(requirement, extremes, tolerance)


def _extreme(
    requirement: Requirement, quantity: Quantity, sample: MeasuredSample, rows: Sequence[int], largest: bool
) -> Extreme:
    found = [
        value_of(
            quantity, sample.loops[k], largest, requirement.from_rad_s, requirement.to_rad_s, requirement.tilt
        )
        for k in rows
    ]  # fmt: skip
    missing = next((k for k, (value, _) in enumerate(found) if math.isnan(value)), None)
    if missing is not None:
        return Extreme(largest, None, sample.place(missing, None))
    worst = (max if largest else min)(range(len(found)), key=lambda k: found[k][0])
    return Extreme(largest, found[worst][0], sample.place(worst, found[worst][1]))


def value_of(
    quantity: Quantity, loop: MeasuredLoop, largest: bool, from_rad_s: float, to_rad_s: float, tilt: Tilt | None = None
) -> Found:
    """A quantity of one loop in its public unit, and its frequency; of a margin, were the loop stable.

    Args:
        quantity: what is asked.
        loop: of one member.
        largest: of a frequency function, the largest value instead of the smallest.
        from_rad_s: lower end of its band.
        to_rad_s: upper end.
        tilt: of a limit that is a line over ln omega.

    Returns:
        nan where there is no such value, inf for a margin that does not end in the band.
    """
    if quantity.where is EvaluatedAt.BAND:
        return _band(quantity, loop, largest, from_rad_s, to_rad_s, tilt)
    if quantity.where is EvaluatedAt.PHASE_CROSSOVERS:
        points = loop.at(loop.phase_crossovers)
        return _smallest(quantity, points, points.log_gain <= 0.0)
    if quantity.where is EvaluatedAt.GAIN_CROSSOVERS:
        points = loop.at(loop.gain_crossovers)
        return _smallest(quantity, points, np.ones(len(points.u), dtype=bool))
    if not len(loop.gain_crossovers):
        return math.nan, math.nan
    points = loop.at(loop.gain_crossovers[-1:])
    return quantity.from_natural(float(np.asarray(quantity.natural(points))[0])), float(points.omega_rad_s[0])


def _smallest(quantity: Quantity, points: LoopPoints, counts: np.ndarray[tuple[int], np.dtype[np.bool_]]) -> Found:
    if not counts.any():
        return math.inf, math.nan
    values = np.where(counts, np.asarray(quantity.natural(points)), math.inf)
    k = int(values.argmin())
    return quantity.from_natural(float(values[k])), float(points.omega_rad_s[k])


def _band(
    quantity: Quantity, loop: MeasuredLoop, largest: bool, from_rad_s: float, to_rad_s: float, tilt: Tilt | None = None
) -> Found:
    def value(points: LoopPoints) -> Array:
        plain = np.asarray(quantity.natural(points), dtype=float)
        return plain if tilt is None else plain - tilt.log(points.omega_rad_s)

    found, u = loop.extreme(value, largest, from_rad_s, to_rad_s)
    return quantity.from_natural(found), math.exp(u)


def _objective(
    objective: Objective | None, sample: MeasuredSample, results: tuple[RequirementResult, ...]
) -> tuple[float | None, Place | None]:
    """The objective's value and where it is worst; without one the smallest slack, or -ln of the largest |S|."""
    if objective is None:
        depth = smallest_slack(results)
        if depth is not None:
            return depth
        value, place = _worst(
            sample, [_band(QUANTITIES["sensitivity_db"], each, True, 0.0, math.inf) for each in sample.loops]
        )
        return (None if value is None else -value * NEPER_PER_DB), place
    kind = ObjectiveKind(objective.quantity)
    if kind is ObjectiveKind.KI:
        return sample.loops[0].gains.ki, None
    if kind in _PEAKS:
        return _worst(sample, [_band(QUANTITIES[_PEAKS[kind]], each, True, 0.0, math.inf) for each in sample.loops])
    if kind is ObjectiveKind.PHASE_MARGIN_SPREAD:
        if any(each.unstable is None or each.unstable > 0.5 for each in sample.counts):
            return None, None
        margins = [value_of(QUANTITIES["phase_margin_deg"], each, False, 0.0, math.inf) for each in sample.loops]
        return _spread(sample, margins)
    if kind is ObjectiveKind.CROSSOVER_SPREAD:
        # |ln|L|| of every member at the nominal crossover
        crossover = sample.loops[0].gain_crossovers[-1:]
        gains = [each.at(crossover).log_gain for each in sample.loops]
        found = [
            (float(gain[0]) * _PER_DB, math.exp(crossover[0])) if len(gain) else (math.nan, math.nan) for gain in gains
        ]
        return _spread(sample, found)
    raise DomainError(f"{objective.quantity} needs the plant's transfer function, which a measured response has not")


def _spread(sample: MeasuredSample, found: list[Found]) -> tuple[float | None, Place | None]:
    off = [(abs(value - found[0][0]) if math.isfinite(value) else math.nan, omega) for value, omega in found]
    return _worst(sample, off)


def _worst(sample: MeasuredSample, found: list[Found]) -> tuple[float | None, Place | None]:
    missing = next((k for k, (value, _) in enumerate(found) if math.isnan(value)), None)
    if missing is not None:
        return None, sample.place(missing, None)
    worst = max(range(len(found)), key=lambda k: found[k][0])
    return found[worst][0], sample.place(worst, found[worst][1])


def _nominal_margins(sample: MeasuredSample) -> Margins:
    """Of the first member, in the band; without stability, or where it is undecided, no margins."""
    loop, stable = sample.loops[0], sample.counts[0].unstable is not None and (sample.counts[0].unstable or 0.0) < 0.5
    crossings, phase = loop.at(loop.gain_crossovers), loop.at(loop.phase_crossovers)
    angle, gain, delay = (
        value_of(QUANTITIES[name], loop, False, 0.0, math.inf)
        for name in ("phase_margin_deg", "gain_margin_db", "delay_margin_s")
    )
    reductions = -phase.log_gain[phase.log_gain > 0.0] * _PER_DB

    def number(value: float) -> float | None:
        return None if not stable or math.isnan(value) else value

    has_crossover = len(crossings.u) > 0
    signed = np.degrees(np.pi - np.mod(-crossings.phase_rad, 2.0 * np.pi))
    return Margins(
        stable=stable,
        crossover_rad_s=float(crossings.omega_rad_s[-1]) if has_crossover else None,
        phase_margin_deg=number(angle[0]),
        phase_margin_rad_s=number(angle[1]),
        gain_margin_db=number(gain[0]),
        gain_margin_rad_s=number(gain[1]),
        gain_reduction_margin_db=number(float(reductions.max(initial=-math.inf))),
        delay_margin_s=number(delay[0]),
        delay_margin_rad_s=number(delay[1]),
        phase_slope_deg_per_decade=(
            math.degrees(float(crossings.slope_rad[-1])) * math.log(10.0) if has_crossover else None
        ),
        gain_crossovers_rad_s=tuple(crossings.omega_rad_s.tolist()),
        angles_from_minus_one_deg=tuple(signed.tolist()),
    )


def reassessed(spec: DesignSpec, found: Verification) -> Verification:
    """The same gains against other limits of the same requirements; the extremes are reused.

    Args:
        spec: with other limits of the same requirements, in the same order.
        found: the verification.
    """
    results = tuple(
        old if old.outcome is Outcome.UNDECIDED else assess_requirement(requirement, old.extremes, found.tolerance)
        for requirement, old in zip(spec.requirements, found.requirements, strict=True)
    )
    # without an objective it is the smallest slack
    depth = smallest_slack(results) if spec.objective is None else None
    objective, place = (found.objective, found.objective_worst) if depth is None else depth
    return replace(found, requirements=results, objective=objective, objective_worst=place)
