"""What one branch and bound is about:  spec, objective level to beat, conditions, coordinates; responses are cached."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from flint import acb, arb

from fopi_tune.core.bode_form import Array
from fopi_tune.core.controller import FoPi
from fopi_tune.core.parallel_form import Implementation, Sections
from fopi_tune.core.peaks import Response
from fopi_tune.core.plant import PlantFamily
from fopi_tune.core.terms.measurement_filter import MeasurementFilter
from fopi_tune.optimum.crossover_gains import CrossoverParametrization
from fopi_tune.optimum.derivative_gains import DerivativeParametrization
from fopi_tune.optimum.parametrization import GainParametrization, Parametrization
from fopi_tune.optimum.pruning.conditions import Condition, Conditions, conditions_of, degrees, nominal_equality
from fopi_tune.optimum.samples.filter_of_order import FilterOfOrder
from fopi_tune.optimum.samples.gains import SampledCrossoverParametrization, SampledGainParametrization
from fopi_tune.proof.balls.box import Box, Interval
from fopi_tune.proof.balls.loop import BallLoop
from fopi_tune.proof.balls.plant import PlantEnclosure, polynomial
from fopi_tune.proof.balls.responses import LoopEnclosure
from fopi_tune.proof.balls.sampled import SampledBallLoop
from fopi_tune.spec.model import DesignSpec

_MOST_CELLS = 50_000
#: relative; responses are read below this part of Nyquist's frequency
_BELOW_NYQUIST = 1e-6
#: |u| at which frequencies are cut off
_FARTHEST = 600.0


@dataclass(frozen=True)
class Problem:
    """Problem of one search.

    Args:
        spec: plant family, requirements and objective.
        beat: level of the objective to be improved upon, in its public unit; None for the requirements alone.
        conditions: necessary conditions of both.
        parametrization: the coordinates.
        roots: boxes that together contain every candidate.  Where the nominal phase margin is fixed too, those after
            the first are lines of constant psi: every controller whose angle at the fixed crossover is that margin.
    """

    spec: DesignSpec
    beat: float | None
    conditions: Conditions
    parametrization: Parametrization
    roots: tuple[Box, ...]

    @classmethod
    def of(cls, spec: DesignSpec, beat: float | None, reference_rad_s: float | None = None) -> Problem:
        """A fixed nominal crossover removes one dimension of the search, a fixed nominal phase margin a second one.

        With a derivative the coordinates are always the gains.

        The fixed crossover only implies |L0(j wc)| = 1.  The phase margin phi is the smallest angle over all
        crossovers, so it is that at wc, psi = phi or psi = -phi, unless a lower crossover has it.  Hence the first root
        contains all psi, and its boxes can also be discarded because no lower crossover has the margin; the others
        contain these two psi only.

        Args:
            spec: what is asked.
            beat: level of the objective.
            reference_rad_s: of `GainParametrization`; any frequency does, one at which the loop has a gain near 1 best.
                None: 1 rad/s.
        """
        conditions = conditions_of(spec, beat)
        crossover = nominal_equality(spec, "crossover_rad_s")
        nominal = tuple(spec.plant.nominal_point.tolist())
        if spec.controller.has_derivative:
            filter_time_s = spec.controller.derivative_filter_time_constant_s
            terms = DerivativeParametrization(1.0 if reference_rad_s is None else reference_rad_s, filter_time_s)
            return cls(spec, beat, conditions, terms, terms.roots(spec.controller))
        unit_loop = _unit_loop(spec)
        at = None
        if crossover is not None and not unit_loop.is_beyond(crossover.limits[0]):
            at = _response(unit_loop, nominal, crossover.limits[0])[1]
        reference = 1.0 if reference_rad_s is None else reference_rad_s
        filtered = None if spec.sampled_design is None else FilterOfOrder(spec.sampled_design)
        if crossover is None or at is None or not at.is_finite() or at.contains(0):
            gains = GainParametrization(reference)
            if filtered is not None:
                # |F| is counted from there: well below Nyquist's frequency
                half = 0.5 * math.pi / filtered.digital.sample_time_s
                gains = SampledGainParametrization(reference, filtered, _s_at(unit_loop, min(reference, half)).imag)
            return cls(spec, beat, conditions, gains, gains.roots(spec.controller))
        parametrization = CrossoverParametrization(crossover.limits[0], at)
        if filtered is not None:
            nu = _s_at(unit_loop, crossover.limits[0]).imag
            parametrization = SampledCrossoverParametrization(crossover.limits[0], at, filtered, nu)
        margin = nominal_equality(spec, "phase_margin_deg")
        if margin is None:
            circle = CrossoverParametrization.circle(spec.controller.alpha, -math.pi)
            return cls(spec, beat, conditions, parametrization, (circle,))
        exact = degrees(margin.limits[0])
        lag = math.nextafter(float(exact.mid()), -math.inf), math.nextafter(float(exact.mid()), math.inf)
        if not (arb(lag[0]) < exact < arb(lag[1])):
            raise ArithmeticError(f"{margin.limits[0]!r} degrees are not enclosed")
        alpha = (spec.controller.alpha.min, spec.controller.alpha.max)
        lines = [(alpha, psi) for psi in (lag, (-lag[1], -lag[0]))]
        roots = (CrossoverParametrization.circle(spec.controller.alpha, lag[0]), *lines)
        return cls(spec, beat, conditions, parametrization, roots)

    def beating(self, beat: float | None) -> Problem:
        """The same problem with another level."""
        return replace(self, beat=beat, conditions=conditions_of(self.spec, beat))

    @property
    def family(self) -> PlantFamily:
        """The plants."""
        return self.spec.plant

    @cached_property
    def nominal(self) -> tuple[float, ...]:
        """The nominal plant's uncertain numbers."""
        return tuple(self.family.nominal_point.tolist())

    @property
    def crossover_rad_s(self) -> float | None:
        """The nominal crossover, where it is fixed."""
        return self.parametrization.omega_rad_s if isinstance(self.parametrization, CrossoverParametrization) else None

    @property
    def reference_rad_s(self) -> float | None:
        """At which the boxes give the integral's gain, or compare gains; None where they are not of gains."""
        found = self.parametrization
        return found.omega_rad_s if isinstance(found, GainParametrization | DerivativeParametrization) else None

    @property
    def margin_is_fixed(self) -> bool:
        """Whether the nominal phase margin is fixed beside the nominal crossover."""
        return self.crossover_rad_s is not None and len(self.roots) > 1

    def is_line(self, box: Box) -> bool:
        """Whether a box is part of a line of constant psi."""
        return self.margin_is_fixed and any(box[-1] == root[-1] for root in self.roots[1:])

    def has_member(self, point: tuple[float, ...], nominal: bool) -> bool:
        """Whether a point is a plant of the family; with `nominal`, whether it is the nominal plant."""
        if nominal:
            return point == self.nominal
        low, high = self.family.low.tolist(), self.family.high.tolist()
        return len(point) == len(low) and all(a <= x <= b for a, x, b in zip(low, point, high, strict=True))

    @cached_property
    def unit_loop(self) -> BallLoop:
        """The loop with C = 1, so that L = P; with a measurement filter F, which is counted to the plant, L = F P."""
        return _unit_loop(self.spec)

    @property
    def measurement_filter(self) -> MeasurementFilter | None:
        """F."""
        return self.spec.controller.measurement_filter

    def squared_limit(self, condition: Condition, omega: float) -> arb:
        """M^2 of a response's limit at a frequency, for C without F and F P in the place of P.

        |C S| is |F| times that of such a loop, so that its limit is M/|F|; that of |P S| is M |F|.
        """
        limit, bottom = (2 * condition.level_at(omega)).exp(), self.unit_loop.filter_bottom
        if bottom is None or condition.response not in (Response.CONTROL_SENSITIVITY, Response.LOAD_SENSITIVITY):
            return limit
        square = abs(bottom.at(_s_at(self.unit_loop, omega))) ** 2
        return limit * square if condition.response is Response.CONTROL_SENSITIVITY else limit / square

    def squared_error_limit(self, condition: Condition, p: acb) -> arb:
        """M^2 of |S| from a limit of the discounted error:  T |P/(1 + C F P)| < level at s = 1/T, `p` = F P there.

        On samples the sum is Ts z/(z - 1) z^delay |P/(1 + C F P)| at z = e^(Ts/T).
        """
        scale, bottom = arb(condition.horizon_s), self.unit_loop.filter_bottom
        if isinstance(self.unit_loop, SampledBallLoop):
            step = self.unit_loop.sample_time / scale
            delay = arb(self.unit_loop.implementation.delay_samples)
            scale = self.unit_loop.sample_time * (step * (1 + delay)).exp() / step.expm1()
        limit = condition.level / (scale * abs(p))
        return limit**2 if bottom is None else (limit / bottom.at(acb(self._real_s(condition.horizon_s))).real) ** 2

    def _real_s(self, horizon_s: float) -> arb:
        """1/T; on samples w at z = e^(Ts/T)."""
        if isinstance(self.unit_loop, SampledBallLoop):
            return (self.unit_loop.sample_time / arb(horizon_s) / 2).tanh()
        return 1 / arb(horizon_s)

    @cached_property
    def _plants(self) -> dict[tuple[float, ...], PlantEnclosure]:
        return {}

    @cached_property
    def _responses(self) -> dict[tuple[tuple[float, ...], float], tuple[acb, acb]]:
        return {}

    @cached_property
    def _plant_enclosures(self) -> dict[tuple[tuple[float, ...], Interval], LoopEnclosure]:
        return {}

    @cached_property
    def plant_gain_bounds(self) -> dict[tuple[tuple[float, ...], Interval], tuple[arb, arb]]:
        """Bounds of |P| over the same intervals."""
        return {}

    @cached_property
    def gain_ratios(self) -> dict[tuple[tuple[float, ...], float, float], bool]:
        """What `fopi_tune.optimum.pruning.loop_gain_bounds.gain_ratio_stays_beyond` found."""
        return {}

    def plant_enclosure(self, point: tuple[float, ...], u: Interval) -> LoopEnclosure:
        """One plant over an interval of u; cached, since many boxes use the same."""
        if len(self._plant_enclosures) > _MOST_CELLS:
            self._plant_enclosures.clear()
            self.plant_gain_bounds.clear()
        key = (point, u)
        if key not in self._plant_enclosures:
            self._plant_enclosures[key] = self.unit_loop.enclosure(u, self.plant(point))
        return self._plant_enclosures[key]

    def plant(self, point: tuple[float, ...]) -> PlantEnclosure:
        """One plant."""
        if point not in self._plants:
            self._plants[point] = self.unit_loop.plant([arb(value) for value in point])
        return self._plants[point]

    def constant_gain_ratio(self, point: tuple[float, ...]) -> arb | None:
        """|P/P0| of plants of which it is the same at every frequency: they differ by their gain; None of others."""
        own, nominal = self.plant(point), self.plant(self.nominal)
        if self.is_on_samples:
            return None
        if not all(a.value == b.value for a, b in zip(own.denominator, nominal.denominator, strict=True)):
            return None
        if not all(c.value.is_zero() for c in (*own.numerator[:-1], *nominal.numerator[:-1])):
            return None
        ratio = abs(own.numerator[-1].value / nominal.numerator[-1].value)
        return ratio if ratio.is_finite() and ratio > 0 else None

    def response(self, point: tuple[float, ...], omega: float) -> tuple[acb, acb]:
        """ln(j omega), on samples ln w, and P there."""
        key = (point, omega)
        if key not in self._responses:
            self._responses[key] = _response(self.unit_loop, point, omega)
        return self._responses[key]

    def real_response(self, point: tuple[float, ...], horizon_s: float) -> tuple[acb, acb]:
        """ln(1/T), on samples ln w at z = e^(Ts/T), and P there."""
        key = (point, -horizon_s)
        if key not in self._responses:
            s = acb(self._real_s(horizon_s))
            self._responses[key] = s.log(), _plant_at(self.plant(point), s)
        return self._responses[key]

    # -- the frequency axis -------------------------------------------------------------------------------------------

    @property
    def is_on_samples(self) -> bool:
        """Whether the loop is the one on samples."""
        return isinstance(self.unit_loop, SampledBallLoop)

    @property
    def gain_vanishes(self) -> bool:
        """Whether |L| -> 0 at the end of the axis; on samples it does not at Nyquist's frequency."""
        return self.family.is_strictly_proper and not self.is_on_samples

    @cached_property
    def highest_rad_s(self) -> float:
        """A frequency next to the end of the axis: Nyquist's, or infinity."""
        if isinstance(self.unit_loop, SampledBallLoop):
            return self.unit_loop.implementation.nyquist_rad_s * (1.0 - _BELOW_NYQUIST)
        return math.inf

    def frequencies_rad_s(self, u: Array) -> Array:
        """Frequencies at values of u."""
        nu = np.exp(np.clip(u, -_FARTHEST, _FARTHEST))
        if isinstance(self.unit_loop, SampledBallLoop):
            return 2.0 / self.unit_loop.implementation.sample_time_s * np.arctan(nu)
        return nu

    def u_interval(self, bracket: Interval) -> Interval:
        """An interval of u that holds a bracket of frequencies in rad/s."""
        return self.unit_loop.band(*bracket)


def _unit_loop(spec: DesignSpec) -> BallLoop:
    controller = FoPi(1.0, 0.0, 1.0, measurement_filter=spec.controller.measurement_filter)
    if spec.sampled_design is None:
        return BallLoop(controller, spec.plant)
    one = Sections(spec.sampled_design.sample_time_s, 1.0, (), ())
    return SampledBallLoop(controller, spec.plant, Implementation(one, spec.sampled_design.delay_samples))


def _s_at(loop: BallLoop, omega: float) -> acb:
    """j omega, or w = j tan(omega Ts/2)."""
    if isinstance(loop, SampledBallLoop):
        return acb(0, (arb(omega) * loop.sample_time / 2).tan())
    return acb(0, arb(omega))


def _response(unit_loop: BallLoop, point: tuple[float, ...], omega: float) -> tuple[acb, acb]:
    plant, s = unit_loop.plant([arb(value) for value in point]), _s_at(unit_loop, omega)
    return acb(s.imag.log(), arb.pi() / 2), _plant_at(plant, s)


def _plant_at(plant: PlantEnclosure, s: acb) -> acb:
    """The plant with its delay; behind a hold a function of w."""
    top, bottom = (polynomial([c.value for c in side], s) for side in (plant.numerator, plant.denominator))
    late = (-s * plant.dead_time.value).exp()
    if plant.late:
        late = late * ((1 - s) / (1 + s)) ** plant.late
    return plant.gain.value * top * late / bottom
