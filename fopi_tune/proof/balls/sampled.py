"""L on samples over a box of frequencies and plants, in ball arithmetic:  digital controller, hold and delays.

With z = (1 + w)/(1 - w), w = j nu, nu = tan(omega Ts/2) (see `fopi_tune.core.sampled_loops`), u = ln nu, the loop is
rational in w, and the formulas for continuous loops hold with w in place of s.  C(w) is computed in
`fopi_tune.proof.balls.sampled_controllers`.

The hold equivalent is that of `zero_order_hold`.  The delay of one sample is z^-1 = (1 - w)/(1 + w) = e^{-2j atan nu}.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from functools import cached_property

from flint import acb, arb, ctx

from fopi_tune.core.bode_form import Array
from fopi_tune.core.fractional_plants.family import ON_SAMPLES, refuse_fractional_family
from fopi_tune.core.loops import Loops, Plants
from fopi_tune.core.parallel_form import Implementation
from fopi_tune.core.sampled_loops import MOST_DELAY_SAMPLES, WHOLE, SampledLoops
from fopi_tune.errors import DomainError
from fopi_tune.proof.balls.box import Cuts, Interval, axes_without_width, ball_of
from fopi_tune.proof.balls.computed_once import computed_once
from fopi_tune.proof.balls.controllers import ControllerOnInterval
from fopi_tune.proof.balls.loop import BallLoop
from fopi_tune.proof.balls.plant import (
    Dual,
    PlantEnclosure,
    Polynomial,
    assemble,
    filtered,
    without_axes,
    without_gradient,
)
from fopi_tune.proof.balls.responses import LoopEnclosure
from fopi_tune.proof.balls.sampled_controllers import (
    SampledControllerOnInterval,
    Sections,
    has_integrator,
    sections_of,
    value_and_derivative,
    value_far_up,
)
from fopi_tune.proof.balls.whole_samples import Pieces, pieces_of, rounded_down
from fopi_tune.proof.balls.zero_order_hold import hold_equivalent, samples_spanned, sharpened

#: bits next to Nyquist's frequency, where the tangent is unbounded
_PLACE_PRECISION = 192


@dataclass(frozen=True)
class SampledBallLoop(BallLoop):
    """A digital controller with a family of plants behind a hold.

    Args:
        gains: what the controller approximates.
        family: the plants.
        implementation: the controller.
    """

    implementation: Implementation

    @cached_property
    def sample_time(self) -> arb:
        """Ts, s."""
        return arb(self.implementation.sample_time_s)

    @cached_property
    def filter_time(self) -> arb:
        """2 T/Ts: by Tustin's rule F has the same form in w."""
        return 2 * super().filter_time / self.sample_time

    @cached_property
    def sections(self) -> Sections:
        """Poles and residues of C in w."""
        return self.compute_sections()

    def compute_sections(self) -> Sections:
        """The same at the current precision, without the cache."""
        return sections_of(self.implementation)

    @cached_property
    def has_integrator(self) -> bool:
        """Whether the controller has a pole at z = 1."""
        return has_integrator(self.sections)

    def samples(self, dead_time: Dual) -> Dual:
        """The whole delay in samples; an exact delay within 1e-12 of a whole number is rounded to it.

        0.6 s are three samples of 0.2 s, although the quotient of these two doubles is slightly less.

        Raises:
            DomainError: more than 10,000 samples.
        """
        samples = dead_time / self.sample_time + arb(self.implementation.delay_samples)
        if not samples.value < MOST_DELAY_SAMPLES:
            raise DomainError(f"the delay is more than {MOST_DELAY_SAMPLES} samples long; take a longer sample time")
        whole = (samples.value + arb(0.5)).floor().unique_fmpz()
        if whole is not None and not samples.gradient and abs(samples.value - arb(whole)) < WHOLE:
            return Dual.of(int(whole))
        return samples

    @cached_property
    def whole_samples(self) -> int | None:
        """The family's delay when it is known and a whole number of samples."""
        number = self.family.dead_time
        samples = self.samples(Dual.of(number.min)).value
        whole = samples.unique_fmpz()
        return int(whole) if number.is_exact and whole is not None and samples == whole else None

    def controller(self, u: arb) -> tuple[acb, acb]:
        """C and d ln C/du over a ball of u."""
        value, slope = value_and_derivative(self.sections, acb(0, u.exp()))
        return value, slope / value

    def controller_far_up(self, inverse: acb) -> acb:
        """C at w = 1/t."""
        return value_far_up(self.sections, inverse)

    def plant(self, theta: Sequence[arb]) -> PlantEnclosure:
        """The plants behind the hold, as polynomials in w without the whole samples of delay."""
        plant = self._continuous(theta)
        return self._held(plant, theta, self._span_of(plant, None))

    def _continuous(self, theta: Sequence[arb]) -> PlantEnclosure:
        """The plants in s, without the measurement filter, which is behind the sampler; no fractional ones."""
        refuse_fractional_family(self.family, "the loop on samples", ON_SAMPLES)
        return assemble(self.family, theta)

    def plants_over(self, box: Sequence[Interval]) -> PlantEnclosure:
        """The plants of a box, behind the hold, with the derivatives along the axes that have a width.

        Of a family with pieces, those of the box's piece.
        """
        theta = [ball_of(side) for side in box]
        plant = self._continuous(theta)
        return self._held(plant, theta, self._span_of(plant, box), axes_without_width(tuple(box)))

    def _span_of(self, plant: PlantEnclosure, box: Sequence[Interval] | None) -> tuple[int, int]:
        """The whole samples at the ends of a delay, rounded down; one number for a box in one piece of the family."""
        samples = self.samples(plant.dead_time)
        if samples.gradient and plant.has_direct_path:
            if box is None or self.pieces is None:
                whole = rounded_down(samples.value)
            else:
                whole = self.pieces.whole_samples(box[self._delay_axis - 1])
            if whole is not None:
                return whole, whole
        return samples_spanned(samples)

    def _held(
        self, plant: PlantEnclosure, theta: Sequence[arb], span: tuple[int, int], fixed: Collection[int] = ()
    ) -> PlantEnclosure:
        """The plants behind the hold, with F; without their derivatives along the fixed axes."""
        return filtered(self._held_alone(plant, theta, span, fixed), self.filter_bottom)

    def _held_alone(
        self, plant: PlantEnclosure, theta: Sequence[arb], span: tuple[int, int], fixed: Collection[int]
    ) -> PlantEnclosure:
        samples = self.samples(plant.dead_time)
        samples = Dual(samples.value, {axis: g for axis, g in samples.gradient.items() if axis not in fixed})
        over = hold_equivalent(without_axes(plant, fixed), self.sample_time, samples, self.axes, span)
        if len(plant.denominator) <= 2 or all(ball.rad() == 0 for ball in theta):
            return over
        # at the centre no derivative is needed, which is most of the work
        middle = [arb(ball.mid()) for ball in theta]
        at = without_gradient(self._continuous(middle))
        late = at.dead_time / self.sample_time + arb(self.implementation.delay_samples)
        if not plant.dead_time.gradient:
            late = self.samples(at.dead_time)
        centre = hold_equivalent(at, self.sample_time, late, self.axes, span)
        return sharpened(over, centre, [ball - c for ball, c in zip(theta, middle, strict=True)])

    @cached_property
    def _delay_axis(self) -> int:
        axis = self.family.dead_time_axis
        assert axis is not None, "only a family with pieces has cuts, and its dead time is uncertain"
        return 1 + axis

    @cached_property
    def pieces(self) -> Pieces | None:
        """The family cut at whole samples of an uncertain delay, where a direct path jumps; None without such."""
        number = self.family.dead_time
        whole = self._continuous([ball_of(side) for side in self.family_box])
        if number.is_exact or not whole.has_direct_path:
            return None
        step, delay = self.implementation.sample_time_s, self.implementation.delay_samples
        return pieces_of(
            (number.min, number.max), lambda s: arb(s) / self.sample_time + arb(delay), lambda m: (m - delay) * step
        )

    @cached_property
    def cuts(self) -> Cuts:
        """The whole samples at which the family is cut."""
        return {} if self.pieces is None else {self._delay_axis: self.pieces.cuts}

    @cached_property
    def _plant_work(self) -> int:
        """Measured: the exponentials of the plant and of its derivatives, n^2 (1 + p)/2 for p uncertain numbers."""
        order = len(self._continuous([ball_of(side) for side in self.family_box]).denominator) - 1
        return max(order**2 * self.axes // 2, 1)

    def loops_at(self, points: Array) -> Loops:
        """The same loops in floating point for these plants, shape (m, p); used only to choose what to examine."""
        return SampledLoops.implemented(self.gains, self.implementation, Plants.members(self.family, points))

    def enclosure(self, u: Interval, plant: PlantEnclosure) -> LoopEnclosure:
        """The loop with these plants over an interval of u; measured: it takes twice the time of a continuous one."""
        if u[0] < u[1]:
            self._cache.work += 1
        return SampledLoopEnclosure(self, self.controller_on(u), plant)

    def new_controller_on(self, u: Interval) -> ControllerOnInterval:
        """C over an interval of u, without the cache."""
        return SampledControllerOnInterval(self, u, self.sections)

    def u_of(self, log_omega: float) -> float:
        """inf from Nyquist's frequency on."""
        half = 0.5 * math.exp(min(log_omega, 700.0)) * self.implementation.sample_time_s
        return math.log(math.tan(half)) if 0.0 < half < 0.5 * math.pi else math.copysign(math.inf, half - 1.0)

    def inner_u_of(self, log_omega: float, upper: bool) -> float:
        """u_of, rounded down for an upper limit and up for a lower one: the strict side of the limit.

        inf from Nyquist's frequency on.
        """
        with ctx.workprec(_PLACE_PRECISION):
            return self._places(arb(log_omega).exp())[0 if upper else 1]

    def band(self, from_rad_s: float, to_rad_s: float) -> Interval:
        """Interval of u that contains a band of frequencies; both ends are inf from Nyquist's frequency on."""
        low = self._places(arb(from_rad_s))[0] if from_rad_s > 0.0 else -math.inf
        if self.implementation.is_beyond_nyquist(to_rad_s):
            return low, math.inf
        return low, self._places(arb(to_rad_s))[1]

    def _places(self, omega: arb) -> Interval:
        """Doubles just below and above ln tan(omega Ts/2); inf from Nyquist's frequency on."""
        with ctx.workprec(_PLACE_PRECISION):
            half = omega * self.sample_time / 2
            if not half < arb.pi() / 2:
                return math.inf, math.inf
            u = half.tan().log()
            return math.nextafter(float(u.lower()), -math.inf), math.nextafter(float(u.upper()), math.inf)

    def frequency(self, omega: arb) -> arb:
        """omega = (2/Ts) atan nu, rad/s."""
        return 2 * omega.atan() / self.sample_time

    def stretch(self, omega: arb) -> arb:
        """d ln omega/du = (nu/(1 + nu^2))/atan nu."""
        return 1 / ((omega + 1 / omega) * omega.atan())

    def has_upper_limit(self, over: LoopEnclosure) -> bool:
        """At z = -1."""
        return True

    def is_beyond(self, omega_rad_s: float) -> bool:
        """Whether a frequency is at or above Nyquist's, up to rounding."""
        return omega_rad_s >= self.implementation.nyquist_rad_s * (1.0 - 1e-15)


class SampledLoopEnclosure(LoopEnclosure):
    """The loop on samples over one box; `omega` and `s` are nu and w."""

    loop: SampledBallLoop
    at: SampledControllerOnInterval

    @computed_once
    def delay(self) -> acb | None:
        """z^-late and the plant's gain."""
        late, gain = self.plant.late, self.plant.gain.value
        turned = self.at.turn(late)[0]
        return turned * (-gain if self.high_tail and late % 2 else gain)

    @computed_once
    def _over_power(self) -> tuple[acb, acb]:
        """N and D over w^k, k the degree of D, as polynomials in 1/w, which are sharp towards z = -1."""
        inverse, top, bottom = self.at.inverse, self.plant.top, self.plant.bottom
        return self._to_degree(top.reversed.at(inverse), top.degree), bottom.reversed.at(inverse)

    def _to_degree(self, value: acb, degree: int) -> acb:
        """X/w^k of X/w^degree."""
        return value * self.at.inverse ** (self.degree - degree) if degree < self.degree else value

    @property
    def sides(self) -> tuple[acb, acb]:
        """N z^-late and D, but for a common factor."""
        (top, bottom), delay = self._filtered_sides, self.delay
        assert delay is not None, "a hold is late by a sample at least"
        return top * delay, bottom

    @property
    def _filtered_sides(self) -> tuple[acb, acb]:
        return self._over_power if self.at.is_beyond_one else super()._filtered_sides

    @computed_once
    def plant_sides(self) -> tuple[acb, acb]:
        """P without delay, `gain` and measurement filter as a quotient; `delay` has the gain."""
        if not self.at.is_beyond_one:
            return super().plant_sides
        inverse, top, bottom = self.at.inverse, self.plant.top, self.loop.filter_bottom or Polynomial([arb(1)])
        value = top.reversed.at(inverse) * bottom.reversed.at(inverse)
        return self._to_degree(value, top.degree + bottom.degree), self._over_power[1]

    def term_share(self, power: int, coefficient: arb, above: bool) -> acb:
        """coefficient w^power over N, or over D."""
        if not self.at.is_beyond_one:
            return super().term_share(power, coefficient, above)
        inverse = self.at.inverse ** (self.degree - power)
        return inverse * coefficient / self._over_power[0 if above else 1]

    @computed_once
    def size(self) -> arb:
        """An upper bound of |L|."""
        return self.gain.abs_upper()

    def _own_slope(self, coefficients: Polynomial, value: acb) -> acb:
        """w X'/X; for |w| > 1 as degree - t Y'/Y, Y(t) = X(w)/w^degree with t = 1/w, which is sharp towards z = -1."""
        if coefficients.degree < 2 or not self.at.is_beyond_one:
            return super()._own_slope(coefficients, value)
        inverse, ascending = self.at.inverse, coefficients.reversed
        return coefficients.degree - ascending.own_derivative(inverse) / ascending.at(inverse)

    @computed_once
    def _delay_slope(self) -> acb:
        """d ln z^-late/du = -2j late nu/(1 + nu^2)."""
        return self.at.turn(self.plant.late)[1]

    @computed_once
    def characteristic_slope(self) -> acb:
        """d/du of D + C N z^-late; not in a tail."""
        controller, steepness = self.at.value_and_derivative
        plant, delay = self.plant, self.delay
        assert delay is not None
        inner = (steepness + controller * self._delay_slope) * self.numerator
        return plant.bottom.own_derivative(self.s) + (inner + controller * plant.top.own_derivative(self.s)) * delay

    @computed_once
    def log_gradient(self) -> list[acb]:
        """d ln L/dtheta_k, k = 1 ... p."""
        gradient = list(super().log_gradient)
        gain = self.plant.gain
        for axis, slope in gain.gradient.items():
            gradient[axis - 1] = gradient[axis - 1] + slope / gain.value
        return gradient

    @computed_once
    def log_slope(self) -> acb:
        """d ln L/du; not in a tail."""
        plant = self.plant
        slope = self.controller_slope + self._own_slope(plant.top, self.numerator)
        return slope - self._own_slope(plant.bottom, self.d) + self._delay_slope

    # -- second derivatives, for the slope of the phase -----------------------------------------------------------

    def _own_curvature(self, coefficients: Polynomial, value: acb) -> acb:
        """d/du of w X'/X; for |w| > 1, with Y(t) = X(w)/w^degree and t = 1/w:  t (t Y')'/Y - (t Y'/Y)^2."""
        if coefficients.degree < 2 or not self.at.is_beyond_one:
            return super()._own_curvature(coefficients, value)
        inverse, ascending = self.at.inverse, coefficients.reversed
        size = ascending.at(inverse)
        slope = ascending.own_derivative(inverse) / size
        return ascending.own_curvature(inverse) / size - slope * slope

    @computed_once
    def log_curvature(self) -> acb:
        """d2 ln L/du2; not in a tail.

        With g = nu/(1 + nu^2), dg/du = g (1 - nu^2)/(1 + nu^2), and d ln z^-late/du = -2j late g.
        """
        plant = self.plant
        curvature = self.at.controller_curvature + self._own_curvature(plant.top, self.numerator)
        curvature = curvature - self._own_curvature(plant.bottom, self.d)
        return curvature + self._delay_slope * self._cosine

    @computed_once
    def _cosine(self) -> arb:
        """(1 - nu^2)/(1 + nu^2) = cos(omega Ts)."""
        return (2 * self.omega.atan()).cos()

    @computed_once
    def phase_slope(self) -> arb:
        """d arg L/d ln omega, rad; not in a tail."""
        return self.log_slope.imag / self.loop.stretch(self.omega)

    @computed_once
    def phase_slope_derivatives(self) -> list[arb]:
        """Derivatives of `phase_slope` with respect to u and theta_k, k = 1 ... p; not in a tail.

        With the stretch h = d ln omega/du = g/atan nu, h'/h = cos(omega Ts) - h:

            d/du (Im (ln L)'/h) = Im (ln L)''/h - (Im (ln L)'/h) (cos(omega Ts) - h) .
        """
        stretch = self.loop.stretch(self.omega)
        along = self.log_curvature.imag / stretch - self.phase_slope * (self._cosine - stretch)
        return [along, *(g.imag / stretch for g in self.log_slope_gradient)]
