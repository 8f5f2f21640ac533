"""What a time-domain requirement is about: the loop, the scenario and the limit, and what all boxes of plants share."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from flint import arb, ctx

from fopi_tune.core.bode_form import Array
from fopi_tune.core.parallel_form import Implementation, Sections
from fopi_tune.core.plant import PlantFamily
from fopi_tune.digital.runtime import Runtime, init
from fopi_tune.proof.time_domain.bounded import Causal, above
from fopi_tune.simulation.measures import horizon_of, scenario_of
from fopi_tune.simulation.scenario import Horizon, InitialInput, Scenario
from fopi_tune.spec.measures import ACCELERATION, PER_M_S, velocity_unit
from fopi_tune.spec.model import Limit, ScenarioSpec

#: precision of the filter's coefficients and of plants, bits
PRECISION = 128
#: limits from here on are none: a controller without output limits stores the largest numbers of its precision
_NO_LIMIT = 1e300


@dataclass(frozen=True)
class TimeDomainCase:
    """A limit in a scenario, of the sampled loop with its stored filter, for every plant of a family.

    The stored doubles of the filter and of the sampled signals are taken as exact, and the loop's arithmetic as exact
    arithmetic of real numbers.

    Args:
        family: of the plants.
        controller: the filter with its limits and anti-windup, in float64.
        sample_time_s: Ts.
        delay_samples: computing delay, in units of the sample time.
        scenario: the spec's.
        limit: the requirement; `undershoot` is known here as well.
        measurement_unit: of the output; an acceleration needs a velocity.
        acts_on_error: whether the controller acts on r - y alone; nothing is proved of another one.
    """

    family: PlantFamily
    controller: Runtime
    sample_time_s: float
    delay_samples: float
    scenario: ScenarioSpec
    limit: Limit
    measurement_unit: str = ""
    acts_on_error: bool = True

    @cached_property
    def run(self) -> Scenario:
        """The scenario on samples."""
        sections = Sections(self.sample_time_s, self.controller.direct, self.controller.poles, self.controller.residues)
        return scenario_of(self.scenario, Implementation(sections, self.delay_samples), 0)

    @cached_property
    def horizon(self) -> Horizon:
        """The samples that count and the steps that are judged."""
        return horizon_of(self.scenario, self.run)

    @property
    def samples(self) -> int:
        """K."""
        return len(self.run.signals)

    @property
    def delays(self) -> set[float]:
        """What control and, where there is one, load are late by beside the dead time, samples."""
        return {self.delay_samples, 0.0} if self.load is not None else {self.delay_samples}

    @property
    def rests(self) -> bool:
        """Whether an input holds the initial output before the first sample."""
        return self.run.start.before is InitialInput.REST or self.run.start.output == 0.0

    @property
    def output_limits(self) -> tuple[float, float]:
        """Of the control, infinite where there is none.

        Returns:
            The lower and the upper one, in the control's unit.
        """
        low, high = self.controller.limits
        return low if low > -_NO_LIMIT else -math.inf, high if high < _NO_LIMIT else math.inf

    @property
    def per_unit(self) -> float:
        """How many of the output's units are one of the measure's; not 1 for an acceleration alone."""
        unit = velocity_unit(self.measurement_unit)
        return PER_M_S[unit] if self.limit.measure == ACCELERATION and unit is not None else 1.0

    @cached_property
    def path(self) -> Causal:
        """C: the filter from the error to its output."""
        with ctx.workprec(PRECISION):
            found = [arb(self.controller.direct)]
            states = [arb(residue) for residue in self.controller.residues]
            poles = [arb(pole) for pole in self.controller.poles]
            for _ in range(self.samples - 1):
                found.append(sum(states, arb(0)))
                states = [state * pole for state, pole in zip(states, poles, strict=True)]
            return _rounded(found)

    @cached_property
    def correction(self) -> Causal:
        """H: the anti-windup from u - v to the filter's output."""
        with ctx.workprec(PRECISION):
            found = [arb(0)]
            gain, poles = arb(self.controller.tracking_gain), [arb(pole) for pole in self.controller.poles]
            states = [arb(weight) * pole for weight, pole in zip(self.controller.weights, poles, strict=True)]
            for _ in range(self.samples - 1):
                found.append(gain * sum(states, arb(0)))
                states = [state * pole for state, pole in zip(states, poles, strict=True)]
            return _rounded(found)

    @property
    def first_output(self) -> float:
        """Of a controller that starts from 0, or from the limit next to it: its integrator's state."""
        return float(init(self.controller).output) if self.controller.has_integrator else 0.0

    @property
    def load(self) -> Array | None:
        """The load, shape (K,); None without one."""
        return self.run.signals.load


def _rounded(terms: list[arb]) -> Causal:
    """Terms as doubles, with the sum of what this leaves out."""
    values = np.array([float(term.mid()) for term in terms])
    off = [float(abs(term - arb(value)).upper()) for term, value in zip(terms, values, strict=True)]
    return Causal(values, above(sum(off), len(off)))
