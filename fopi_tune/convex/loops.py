"""The loop that a task is about, in continuous time or on samples, for a fixed order alpha affine in the gains.

    C = kp + ki F ,       F = s^-alpha, or on samples the filter that the section `digital` makes of it .            (1)

The coordinate u of a loop is ln omega, on samples ln tan(omega Ts/2).

Source: (1) is the form of every filter of `fopi_tune.digital`.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from fopi_tune.core.bode_form import Array, Complex, Rows
from fopi_tune.core.controller import FoPi
from fopi_tune.core.loops import Loops, Plants
from fopi_tune.core.parallel_form import Implementation, Sections
from fopi_tune.core.sampled_loops import SampledLoops, SampledPlants, shifted
from fopi_tune.digital import sections_of
from fopi_tune.spec.model import DigitalSpec

#: step of u for derivatives of F
_STEP = 1e-5


@dataclass(frozen=True)
class LoopKind:
    """Continuous time, or the filter, hold and delay of a section `digital`.

    Args:
        digital: the section of a spec with `design: sampled`; None in continuous time.
        crossover_rad_s: where the filter is exact, if it depends on the loop's crossover.
    """

    digital: DigitalSpec | None
    crossover_rad_s: float | None = None

    @property
    def needs_crossover(self) -> bool:
        """Whether F depends on the loop's crossover."""
        return self.digital is not None and self.digital.depends_on_crossover

    def exact_at(self, crossover_rad_s: float | None) -> LoopKind:
        """The same with another crossover."""
        return replace(self, crossover_rad_s=crossover_rad_s) if self.needs_crossover else self

    def plants(self, plants: Plants) -> Plants:
        """The continuous plants themselves, or behind the hold.

        Raises:
            DomainError: a delay of too many samples.
        """
        if self.digital is None:
            return plants
        delay_s = self.digital.delay_samples * self.digital.sample_time_s
        return SampledPlants.behind_hold(plants, self.digital.sample_time_s, delay_s)

    def filter(self, alpha: float) -> Sections | None:
        """F on samples; None in continuous time.

        Raises:
            DomainError: the filter cannot be made.
        """
        return None if self.digital is None else _filter_of(self.digital, alpha, self.crossover_rad_s)

    def loops(self, gains: FoPi, plants: Plants) -> Loops:
        """One controller with every one of what `plants` returned."""
        unit = self.filter(gains.alpha)
        if unit is None:
            return Loops.of(gains, plants)
        assert isinstance(plants, SampledPlants)
        scaled = tuple(gains.ki * residue for residue in unit.residues)
        sections = Sections(unit.sample_time_s, gains.kp + gains.ki * unit.direct, unit.poles, scaled)
        if gains.ki == 0.0:
            sections = Sections(unit.sample_time_s, gains.kp, (), ())
        rows = np.ones(len(plants))
        return SampledLoops(gains.kp * rows, gains.ki * rows, gains.alpha * rows, plants, sections)

    def integral(self, alpha: float, u: Array) -> tuple[Complex, Complex]:
        """F and dF/du; shape of u."""
        unit = self.filter(alpha)
        if unit is None:
            value: Complex = np.exp(-alpha * (u + 0.5j * np.pi))
            return value, -alpha * value
        ends = [unit.at(shifted(u + step)) for step in (_STEP, -_STEP)]
        return unit.at(shifted(u)), (ends[0] - ends[1]) / (2.0 * _STEP)

    def plant_response(self, plants: Plants, rows: Rows, u: Array) -> Complex:
        """P of row `rows` at u; shape of u."""
        return plants.at(rows, u) if isinstance(plants, SampledPlants) else np.exp(plants.log.value(rows, u))

    def discounted(self, plants: Plants, alpha: float, horizon_s: float) -> tuple[Array, Array, float]:
        """The disturbance's discounted response without feedback T P, P and F at s = 1/T, on samples z = e^{Ts/T}.

        Shape (m,) each; iae_disturbance is |T P/(1 + C P)|.  On samples T P stands for Ts z/(z - 1) z^delay P(z), the
        sum over the samples: the computing delay is in the loop, and not between the step and the plant.
        """
        s, unit = 1.0 / horizon_s, self.filter(alpha)
        if unit is None or self.digital is None or not isinstance(plants, SampledPlants):
            plant = _at_real(plants, s) * np.exp(-s * plants.dead_time_s)
            return horizon_s * plant, plant, s**-alpha
        step = s * unit.sample_time_s
        delta = float(np.expm1(step))
        plant = _at_real(plants, delta) * np.exp(-step * plants.late)
        early = np.exp(step * (1.0 + self.digital.delay_samples)) * unit.sample_time_s / delta
        return early * plant, plant, float(unit.at(np.array([delta + 0j])).real[0])

    def implementation(self, gains: FoPi) -> Implementation | None:
        """The digital controller of these gains; None in continuous time."""
        if self.digital is None:
            return None
        return Implementation(sections_of(gains, self.digital, self.crossover_rad_s), self.digital.delay_samples)


def _at_real(plants: Plants, s: float) -> Array:
    powers = s ** np.arange(max(plants.numerator.shape[1], plants.denominator.shape[1]), dtype=float)
    top = plants.numerator[:, ::-1] @ powers[: plants.numerator.shape[1]]
    bottom = plants.denominator[:, ::-1] @ powers[: plants.denominator.shape[1]]
    with np.errstate(divide="ignore"):
        return np.asarray(top / bottom, dtype=float)


@lru_cache(maxsize=1024)
def _filter_of(digital: DigitalSpec, alpha: float, crossover_rad_s: float | None) -> Sections:
    """F: kp = 0 and ki = 1."""
    return sections_of(FoPi(0.0, 1.0, alpha), digital, crossover_rad_s)
