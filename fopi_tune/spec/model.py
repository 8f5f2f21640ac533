"""What a spec file says, as frozen data: the hand-over from `spec/` to every later stage."""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import StrEnum

from fopi_tune.core.plant import PlantFamily


class Relation(StrEnum):
    """How a quantity relates to its limit."""

    EQUALS = "equals"
    AT_LEAST = "at_least"
    AT_MOST = "at_most"
    BETWEEN = "between"


class Scope(StrEnum):
    """Which plants a requirement is about."""

    FAMILY = "family"
    NOMINAL = "nominal"


class Sense(StrEnum):
    """Which way an objective goes."""

    MINIMIZE = "minimize"
    MAXIMIZE = "maximize"


@dataclass(frozen=True)
class GainRange:
    """Where a gain may lie; an end the spec leaves open is infinite, min == max fixes the gain."""

    min: float = -math.inf
    max: float = math.inf

    @property
    def is_fixed(self) -> bool:
        """Whether the spec prescribes the gain."""
        return self.min == self.max


@dataclass(frozen=True)
class ControllerSpec:
    """The box of gains to search."""

    kp: GainRange
    ki: GainRange
    alpha: GainRange


@dataclass(frozen=True)
class Requirement:
    """One line of `requirements:`.

    Args:
        quantity: a key of `fopi_tune.quantities.QUANTITIES`.
        relation: how it relates to the limits.
        limits: one number, two for `between`; in the quantity's public unit.
        scope: the whole family or the nominal member.
        from_rad_s: lower end of the band of a frequency function; 0 is "all low frequencies".
        to_rad_s: upper end; infinite is "all high frequencies".  Equal ends are `at_rad_s`.
        line: line in the file, 0 when the spec did not come from a file.
    """

    quantity: str
    relation: Relation
    limits: tuple[float, ...]
    scope: Scope = Scope.FAMILY
    from_rad_s: float = 0.0
    to_rad_s: float = math.inf
    line: int = 0

    @property
    def lower(self) -> float:
        """The quantity must be at least this; -inf where there is no such limit."""
        return self.limits[0] if self.relation is not Relation.AT_MOST else -math.inf

    @property
    def upper(self) -> float:
        """The quantity must be at most this; inf where there is no such limit."""
        return self.limits[-1] if self.relation is not Relation.AT_LEAST else math.inf


@dataclass(frozen=True)
class Objective:
    """What to do with the freedom the requirements leave.

    `horizon_s` belongs to `iae_disturbance` alone; None lets the tool choose it from the plant.
    """

    sense: Sense
    quantity: str
    horizon_s: float | None = None


@dataclass(frozen=True)
class DigitalSpec:
    """How the gains become a controller on a computer.

    Args:
        sample_time_s: Ts.
        method: how s^-alpha is approximated.
        poles: of the approximation.
        band_rad_s: where it holds.
        rule: from s to z.
        delay_samples: from the measurement to the new control, in samples.
        prewarp: where Tustin's rule is exact: "none" (omega -> 0) or "crossover" (the nominal gain crossover).
        design: which loop the requirements are about, the "continuous" one or the "sampled" one.
        output_limits: of the control, lower first; None without.
        measurement_unit: text for people who read the exported code.
        output_unit: the same, of the control.
    """

    sample_time_s: float
    method: str = "oustaloup"
    poles: int = 7
    band_rad_s: tuple[float, float] = (1e-3, 1e3)
    rule: str = "tustin"
    delay_samples: float = 0.0
    prewarp: str = "none"
    design: str = "continuous"
    output_limits: tuple[float, float] | None = None
    measurement_unit: str = ""
    output_unit: str = ""

    @property
    def designs_sampled(self) -> bool:
        """Whether the requirements are about the loop on samples."""
        return self.design == "sampled"


@dataclass(frozen=True)
class ValidationSpec:
    """How many plants the Monte-Carlo stage draws, and from which seed."""

    samples: int = 10_000
    seed: int = 1


@dataclass(frozen=True)
class DesignSpec:
    """A whole spec.  `sha256` is of the file's bytes (or of the text it was made from)."""

    name: str
    plant: PlantFamily
    controller: ControllerSpec
    requirements: tuple[Requirement, ...]
    objective: Objective | None = None
    digital: DigitalSpec | None = None
    validation: ValidationSpec | None = None
    description: str = ""
    sha256: str = ""
    schema: int = 1
