"""A family of measured responses:  one curve a file, or several about a measured one by its standard deviation.

A member is no point of a box but one of a list; a place is (k,), the member's index from 0.  With a standard deviation
sigma of ln P (per frequency, gain and phase alike unless both are given) a measurement stands for nine members,

    ln P ,   ln P + 2 (sigma_gain cos(m 45 deg) + j sigma_phase sin(m 45 deg)) ,   m = 0 ... 7:                    (1)

the measured response, and eight that are off by two standard deviations at every frequency at once, in gain, in phase
or in both.  The first member is the nominal plant.

Source: derived; to first order the error of ln P is that of P over P.
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from fractions import Fraction
from typing import Any, NoReturn

import numpy as np
from numpy.typing import NDArray

from fopi_tune.core.bode_form import Array
from fopi_tune.core.measured.curve import Curve, InterpolationError
from fopi_tune.core.plant import PlantFamily, Uncertain
from fopi_tune.errors import DomainError

#: the word after `model:`
FREQUENCY_RESPONSE = "frequency_response"
#: of a standard deviation, and the directions of (1)
SIGMAS, DIRECTIONS = 2.0, 8
#: what a measured response cannot do
NO_COEFFICIENTS = (
    "a measured frequency response is known at its frequencies alone and has no transfer function, which this needs; "
    "fit one to it and write it as plant: {model: transfer_function, ...}"
)


@dataclass(frozen=True)
class MeasuredMember:
    """One response.

    Args:
        name: for reports; empty where there is only one.
        sha256: of its numbers.
        table: the curve; equal ones have equal digests.
    """

    name: str
    sha256: str
    table: Curve = field(compare=False, repr=False)

    @classmethod
    def of(cls, name: str, curve: Curve) -> MeasuredMember:
        """The member of a curve; `name` as above."""
        numbers = np.concatenate([curve.omega_rad_s, curve.log_gain, curve.phase_rad, [curve.dead_time_s]])
        return cls(name, hashlib.sha256(numbers.astype("<f8").tobytes()).hexdigest(), curve)


@dataclass(frozen=True)
class MeasuredFamily(PlantFamily):
    """Every member's response, in the band that all of them have.

    Args:
        model: stands for the model.
        parameters: none.
        members: at least one; the first is nominal.
        unstable_poles: of the plant, in the open right half-plane; None where that is not known.
        source_files: that the members were read from, as a spec names them; their numbers count, not their names.
    """

    members: tuple[MeasuredMember, ...] = ()
    unstable_poles: int | None = None
    source_files: tuple[str, ...] = ()

    @classmethod
    def of(
        cls, members: Sequence[MeasuredMember], unstable_poles: int | None, source_files: Sequence[str] = ()
    ) -> MeasuredFamily:
        """The family.

        Args:
            members: the nominal one first.
            unstable_poles: of the plant; None where that is not known.
            source_files: that the members were read from, as a spec names them.

        Raises:
            DomainError: there is no member, or they have no band in common.
        """
        if not members:
            raise DomainError("a family of measured responses needs at least one")
        found = cls(FREQUENCY_RESPONSE, {}, tuple(members), unstable_poles, tuple(source_files))
        low, high = found.band_rad_s
        if not low < high:
            raise DomainError("the responses have no band of frequencies in common; measure them over one band")
        return found

    @property
    def band_rad_s(self) -> tuple[float, float]:
        """The lowest and the highest frequency that every member has, rad/s."""
        bands = [member.table.band_rad_s for member in self.members]
        return max(low for low, _ in bands), min(high for _, high in bands)

    @property
    def interpolation_error(self) -> InterpolationError:
        """The largest estimate of any member."""
        every = [member.table.interpolation_error for member in self.members]
        gain, phase = max(every, key=lambda e: e.gain_db), max(every, key=lambda e: e.phase_deg)
        return InterpolationError(gain.gain_db, phase.phase_deg, gain.gain_rad_s, phase.phase_rad_s)

    @property
    def uncertain_names(self) -> tuple[str, ...]:
        """None: members are no points of a box."""
        return ()

    @property
    def nominal_point(self) -> Array:
        """The place of the first member, shape (1,)."""
        return np.zeros(1)

    @property
    def has_one_plant(self) -> bool:
        """Whether there is only one member."""
        return len(self.members) == 1

    @property
    def dead_time(self) -> Uncertain:
        """The further dead time, s."""
        return Uncertain.exactly(self.members[0].table.dead_time_s)

    def corners(self, most: int = 64) -> Array:
        """The place of every member, shape (m, 1); `most` has no meaning here."""
        return np.arange(float(len(self.members)))[:, None]

    def describe(self, point: Array) -> dict[str, float]:
        """No number: a member at a place, `point` of shape (1,), is told by its name."""
        return {}

    def name_at(self, point: Array) -> str:
        """The name of the member at a place, `point` of shape (1,)."""
        return self.members[int(point[0])].name

    def refused(self, points: Array) -> NDArray[np.bool_]:
        """None of the places, `points` of shape (m, 1)."""
        return np.zeros(len(points), dtype=bool)

    @property
    def is_strictly_proper(self) -> bool:
        """Beyond the band nothing is known; |L| < 1 is assumed there."""
        return True

    @property
    def dead_time_axis(self) -> None:
        """There is no box."""
        return None

    def problem(self, name: str, value: Uncertain) -> NoReturn:
        """Refused: `name` and `value`, in any unit, are of no member.

        Raises:
            DomainError: always.
        """
        raise DomainError(NO_COEFFICIENTS)

    def assemble(self, values: Any, number: Callable[[Fraction], Any] = float) -> NoReturn:
        """Refused: `values`, in any unit, and what makes a `number` of them are of no member.

        Raises:
            DomainError: always.
        """
        raise DomainError(NO_COEFFICIENTS)

    def coefficients(self, points: Array) -> NoReturn:
        """Refused at any `points`.

        Raises:
            DomainError: always.
        """
        raise DomainError(NO_COEFFICIENTS)

    def member(self, point: Array) -> NoReturn:
        """Refused at any `point`.

        Raises:
            DomainError: always.
        """
        raise DomainError(NO_COEFFICIENTS)


def members_within(
    name: str, curve: Curve, gain_deviation: Array | None, phase_deviation: Array | None
) -> list[MeasuredMember]:
    """(1) of a measured response with a standard deviation; without one the response alone.

    Args:
        name: of the measurement.
        curve: the measured response.
        gain_deviation: standard deviation of ln|P| at each point, or None.
        phase_deviation: of arg P, rad, or None.
    """
    found = [MeasuredMember.of(name, curve)]
    if gain_deviation is None or phase_deviation is None:
        return found
    for k in range(DIRECTIONS):
        angle = 2.0 * math.pi * k / DIRECTIONS
        gain = curve.log_gain + SIGMAS * gain_deviation * round(math.cos(angle), 15)
        phase = curve.phase_rad + SIGMAS * phase_deviation * round(math.sin(angle), 15)
        off = Curve(curve.omega_rad_s, gain, phase, curve.dead_time_s)
        found.append(MeasuredMember.of(f"{name}{' ' if name else ''}{_direction(k)}", off))
    return found


def _direction(k: int) -> str:
    """What is off, in words:  +2 sigma in gain, ..."""
    gain, phase = round(math.cos(2.0 * math.pi * k / DIRECTIONS), 6), round(math.sin(2.0 * math.pi * k / DIRECTIONS), 6)
    parts = [f"{'+' if part > 0 else '-'}{what}" for part, what in ((gain, "gain"), (phase, "phase")) if part]
    return f"{SIGMAS:g} sigma {' '.join(parts)}"
