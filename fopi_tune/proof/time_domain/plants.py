"""A box of plants behind a zero-order hold, as polynomials in the delay x of one sample.

    D(x) y = N(x) u + M(x) w + start,      y, u: deviations from the rest before the first sample                    (1)

u is the control, which is D samples late (dead time and computing delay), w the load, which is late by the dead time.
A plant of first order, y' = -p y + k v, with D = d + f, d whole and 0 <= f <= 1, has

    D(x) = 1 - e^{-p Ts} x,      N(x) = x^{d+1} (W(1 - f) + e^{-p (1 - f) Ts} W(f) x),                             (2)

W(t) = (k/p) (1 - e^{-p Ts t}), where the pole may be 0 in the form k Ts t phi(p Ts t), phi(x) = (1 - e^{-x})/x.  phi
and its derivatives are integrals of s^n e^{-xs} over [0, 1] up to the sign, and so monotone: their values at the ends
of a ball enclose them.

A delay within 1e-12 of a whole number of samples counts as whole, as in the simulation; both readings are enclosed.
Where the dead time is uncertain a box must lie between two whole numbers, see `cut_at_whole_samples`.

Source: (2) Astrom and Wittenmark, Computer-Controlled Systems, 3rd ed., 1997, section 2.3.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from flint import arb, ctx

from fopi_tune.core.bode_form import Array
from fopi_tune.core.plant import PlantFamily
from fopi_tune.proof.balls.box import Box, ball_of, centre_of, with_interval
from fopi_tune.proof.time_domain.bounded import Delays, above
from fopi_tune.proof.time_domain.jets import Derivatives, Jet, assemble_jets
from fopi_tune.proof.time_domain.models import Model, number_model

#: a delay this close to a whole number of samples counts as whole; as in `simulation.sampled.plants`
WHOLE = 1e-12
#: a box may reach beyond a whole number of samples by so much; above the rounding of a dead time
_MOST_BEYOND = 1e-9
_U, _PRECISION = 2.0**-53, 128


@dataclass(frozen=True, eq=False)
class Polynomial:
    """A polynomial in x whose coefficients are uncertain:  base + sum_i coefficient_i basis_i.

    Args:
        base: exact; None for 0.
        terms: exact basis polynomials and their coefficients, models of length 1.
    """

    base: Delays | None
    terms: tuple[tuple[Delays, Model], ...]

    @property
    def centre(self) -> tuple[Delays, float]:
        """The polynomial at the centres of the coefficients, and the norm of its rounding."""
        return self._combined([float(model.values[0]) for _, model in self.terms], self.base)

    def along(self, axis: int) -> tuple[Delays, float]:
        """The slope along an axis, counted from 0, and the norm of its rounding."""
        return self._combined([float(model.slopes[axis, 0]) for _, model in self.terms], None)

    def pair(self, row: int) -> tuple[Delays, float]:
        """The same of a term of second order, in the order of `pairs_of`."""
        return self._combined([float(model.pairs[row, 0]) for _, model in self.terms], None)

    @property
    def rests(self) -> list[tuple[Delays, float]]:
        """Each basis polynomial with the largest |factor| that the terms up to second order leave out."""
        return [(basis, float(model.rest[0])) for basis, model in self.terms]

    def _combined(self, factors: Sequence[float], base: Delays | None) -> tuple[Delays, float]:
        parts = [(base, 1.0)] if base is not None else []
        parts += [(basis, factor) for (basis, _), factor in zip(self.terms, factors, strict=True)]
        first = min(basis.first for basis, _ in parts)
        values = np.zeros(max(basis.first + len(basis.values) for basis, _ in parts) - first)
        size = 0.0
        for basis, factor in parts:
            values[basis.first - first : basis.first - first + len(basis.values)] += factor * basis.values
            size += abs(factor) * basis.norm
        # one part a power: nothing was rounded
        rounding = 0.0 if len(parts) == 1 or not _overlap(parts) else above(2.0 * len(parts) * _U * size)
        return Delays(values, first), rounding


def _overlap(parts: Sequence[tuple[Delays, float]]) -> bool:
    powers = [basis.first + i for basis, _ in parts for i, value in enumerate(basis.values) if value]
    inexact = any(np.any((np.abs(basis.values) != 1.0) & (basis.values != 0.0)) for basis, _ in parts)
    return inexact or len(set(powers)) < len(powers)


@dataclass(frozen=True, eq=False)
class Arrivals:
    """dy/dt of plants of first order when an input arrives at the fraction `instant` of a sample.

        dy/dt = state y + control u_(k - delay) + control_before u_(k - delay - 1) + the same of the load             (3)

    Args:
        state, control, control_before, load, load_before: models of length 1.
        may_end: whether the instant may be the end of the sample, where the simulation counts it for the next one.
    """

    state: Model
    control: Model
    control_before: Model
    load: Model
    load_before: Model
    may_end: bool


@dataclass(frozen=True, eq=False)
class HeldPlants:
    """(1) over a box.

    Args:
        order: of the plants.
        radii: of the box, shape (p,).
        denominator: D.
        control: N.
        load: M; None without a load.
        past: the input before the first sample, a model of length 1.
        output: y before the first sample; y is the deviation from it.
        kick: what is added to the output at the first sample, of a start without input.
        delay: whole samples d of the control and of the load.
        pole, gain: p and k, models of length 1; None of plants of higher order.
        arrivals: of control and load, where one of them arrives between samples.
    """

    order: int
    radii: Array
    denominator: Polynomial
    control: Polynomial
    load: Polynomial | None
    past: Model
    output: float
    kick: float
    delay: tuple[int, int]
    pole: Model | None
    gain: Model | None
    arrivals: tuple[Arrivals, ...]


def order_of(family: PlantFamily) -> int | None:
    """The order of every plant of a family; None where they differ, or where a plant has a direct path."""
    theta = [ball_of((number.min, number.max)) for number in family.parameters.values() if not number.is_exact]
    numerator, denominator, _ = assemble_jets(family, theta)
    if len(numerator) >= len(denominator) or denominator[0].value.contains(0):
        return None
    return len(denominator) - 1


def radii_of(box: Box) -> Array:
    """The largest distance from the centre along each axis, rounded up; shape (p,)."""
    centre = centre_of(box)
    return np.array([max(high - c, c - low) * (1.0 + 4 * _U) for (low, high), c in zip(box, centre, strict=True)])


def _dead_time_cuts(family: PlantFamily, sample_time_s: float, more: set[float]) -> tuple[float, ...]:
    """Dead times inside their range, s, that are whole numbers of samples or just above, with one of more samples."""
    number, found = family.parameters["dead_time_s"], set()
    for extra in more:
        ends = (math.floor(number.min / sample_time_s + extra), math.ceil(number.max / sample_time_s + extra))
        for whole in range(*ends):
            cut = (whole + 1 - extra) * sample_time_s * (1.0 - 4 * _U)
            with ctx.workprec(_PRECISION):
                while not arb(cut) / arb(sample_time_s) + arb(extra) >= whole + 1:
                    cut = math.nextafter(cut, math.inf)
            if number.min < cut < number.max:
                found.add(cut)
    return tuple(sorted(found))


def cut_at_whole_samples(family: PlantFamily, sample_time_s: float, more: set[float]) -> list[Box]:
    """The family's box, cut where the dead time with one of these delays, in samples, is a whole number of samples."""
    box: Box = tuple((float(low), float(high)) for low, high in zip(family.low, family.high, strict=True))
    names = family.uncertain_names
    if "dead_time_s" not in names:
        return [box]
    axis = names.index("dead_time_s")
    edges = [box[axis][0], *_dead_time_cuts(family, sample_time_s, more), box[axis][1]]
    return [with_interval(box, axis, ends) for ends in itertools.pairwise(edges)]


@dataclass(frozen=True, eq=False)
class _Lateness:
    """A delay of whole + part samples over a box and at its centre; `beyond` is what a part may have above 1."""

    whole: int
    part: Jet
    centre: Jet
    beyond: float

    @property
    def is_whole(self) -> bool:
        """Whether no part of a sample is left."""
        return self.part.is_zero


def _lateness(
    dead_time: Jet, centre: Jet, ends: tuple[float, float], sample_time_s: float, more: float
) -> _Lateness | None:
    """The delay in samples; None when a box reaches across a whole number.

    Args:
        dead_time: over the box.
        centre: at its centre.
        ends: the smallest and the largest, s.
        sample_time_s: Ts.
        more: samples of delay beside the dead time.
    """
    low, high, middle = (arb(end) / arb(sample_time_s) + arb(more) for end in (*ends, centre.value))
    nearest = round(float(middle.mid()))
    if ends[0] == ends[1] and abs(middle - nearest) < WHOLE:
        nothing = Jet.constant(0, len(dead_time.slopes))
        return _Lateness(nearest, nothing, nothing, WHOLE)
    whole = math.floor(float(low.mid()) + 0.5 * WHOLE)
    beyond = max(float((high - (whole + 1)).upper()), float((whole - low).upper()), 0.0)
    if beyond > _MOST_BEYOND:
        return None
    within = arb(0).union(arb(1))
    part = low.union(high) - whole
    part = part.intersection(within) if part.overlaps(within) else arb(0)
    at_centre = arb(0).max(middle - whole).min(arb(1))
    slopes, pairs = ((dead_time / arb(sample_time_s)).slopes, dead_time.pairs)
    # a ball's rounding is beyond a whole number as well
    beyond = beyond + 1e-14 if beyond > 1e-30 else 0.0
    return _Lateness(whole, Jet(part, slopes, pairs), Jet(at_centre, slopes, pairs), beyond)


def _phi(x: arb) -> Derivatives:
    """phi and its derivatives, each over a ball by its ends."""

    def ends(n: int) -> arb:
        low, high = ((-arb(end)).hypgeom_1f1(arb(n), arb(n + 1)) for end in (x.lower(), x.upper()))
        return low.union(high)

    return ends(1), -ends(2) / 2, ends(3) / 3


def _held(static_gain: Jet | None, gain: Jet, pole: Jet, time: Jet) -> Jet:
    """W of (2) after a time in s."""
    if static_gain is not None:
        return static_gain * (1 - (-(pole * time)).exp())
    return gain * time * (pole * time).through(_phi)


#: pole, gain, static gain (None where the pole may be 0) and the instant in a sample
_Numbers = tuple[Jet, Jet, Jet | None, Jet]
_Formula = Callable[[Jet, Jet, Jet | None, Jet], Jet]


@dataclass(frozen=True, eq=False)
class _FirstOrder:
    """The numbers of plants of first order over a box and at its centre."""

    over: _Numbers
    centre: _Numbers
    radii: Array

    def at(self, late: _Lateness) -> _FirstOrder:
        """The same with the part of a sample by which an input is late."""
        return _FirstOrder((*self.over[:3], late.part), (*self.centre[:3], late.centre), self.radii)

    def model(self, formula: _Formula, wider: float = 0.0) -> Model:
        """A function of the numbers as a model."""
        return number_model(formula(*self.over), formula(*self.centre), self.radii, wider)


def hold_plants(
    family: PlantFamily, box: Box, sample_time_s: float, delay_samples: float, start: tuple[float, bool], loaded: bool
) -> HeldPlants | None:
    """(1) over a box.

    Args:
        family: whose numbers the box is about.
        box: of the uncertain numbers.
        sample_time_s: Ts.
        delay_samples: computing delay.
        start: output before the first sample, and whether an input held it there.
        loaded: whether there is a load.

    Returns:
        None when the box must be split: it reaches across a whole number of samples of delay.
    """
    radii = radii_of(box)
    top, bottom, dead_time = assemble_jets(family, [ball_of(interval) for interval in box])
    top_0, bottom_0, dead_time_0 = assemble_jets(family, [arb(value) for value in centre_of(box)])
    number, names = family.parameters["dead_time_s"], family.uncertain_names
    ends = (number.min, number.max) if number.is_exact else box[names.index("dead_time_s")]
    late = [_lateness(dead_time, dead_time_0, ends, sample_time_s, more) for more in (delay_samples, 0.0)]
    if late[0] is None or late[1] is None:
        return None
    integrates = bottom[1].value.contains(0)

    def numbers(n: Sequence[Jet], d: Sequence[Jet]) -> _Numbers:
        return d[1] / d[0], n[0] / d[0], None if integrates else n[0] / d[1], Jet.constant(0, len(radii))

    one = _FirstOrder(numbers(top, bottom), numbers(top_0, bottom_0), radii)
    past = Model.constant(np.zeros(1), radii)
    if start[1] and start[0]:
        past = number_model(bottom[1] / top[0] * start[0], bottom_0[1] / top_0[0] * start[0], radii)
    return _first_order(one, arb(sample_time_s), (late[0], late[1]), (past, *start), (delay_samples, loaded))


def _first_order(
    one: _FirstOrder, ts: arb, late: tuple[_Lateness, _Lateness], start: tuple[Model, float, bool],
    inputs: tuple[float, bool],
) -> HeldPlants:  # fmt: skip
    radii, (delay_samples, loaded) = one.radii, inputs
    past, output, rests = start
    pole, gain = (each.value for each in one.over[:2])
    # what the weights of a delay just beyond a whole number of samples differ from those of that number
    most = float((abs(gain) * ts * (abs(pole) * ts).exp()).upper())
    polynomials = []
    for each in late:
        wider = above(most * each.beyond)
        now = one.at(each)
        terms = [(each.whole + 1, now.model(lambda p, k, g, f: _held(g, k, p, (1 - f) * ts), wider))]
        if not each.is_whole:
            old = now.model(lambda p, k, g, f: (-p * ((1 - f) * ts)).exp() * _held(g, k, p, f * ts), wider)
            terms.append((each.whole + 2, old))
        if each.beyond:
            nothing = Model.constant(np.zeros(1), radii).wider(np.array([wider]))
            terms += [(power, nothing) for power in (each.whole, each.whole + 2 + (not each.is_whole)) if power]
        polynomials.append(Polynomial(None, tuple((Delays(np.ones(1), power), model) for power, model in terms)))
    decay = one.model(lambda p, k, g, f: (-p * ts).exp())
    between = not all(each.is_whole for each in late[: 2 if loaded else 1])
    return HeldPlants(
        order=1,
        radii=radii,
        denominator=Polynomial(Delays(np.ones(1)), ((Delays(-np.ones(1), 1), decay),)),
        control=polynomials[0],
        load=polynomials[1] if loaded else None,
        past=past,
        output=output if rests else 0.0,
        kick=0.0 if rests else output,
        delay=(late[0].whole, late[1].whole),
        pole=one.model(lambda p, k, g, f: p),
        gain=one.model(lambda p, k, g, f: k),
        arrivals=_arrivals(one, ts, late, delay_samples, loaded) if between else (),
    )


def _arrivals(
    one: _FirstOrder, ts: arb, late: tuple[_Lateness, _Lateness], delay_samples: float, loaded: bool
) -> tuple[Arrivals, ...]:
    """(3) at the instants of control and load; how far these are apart does not depend on the dead time."""
    apart = delay_samples - late[0].whole + late[1].whole
    apart = 0.0 if abs(apart) < _MOST_BEYOND else apart
    pole, gain = (each.value for each in one.over[:2])
    beyond = max(late[0].beyond, late[1].beyond)
    scale = ((1 + abs(pole)) ** 2 * (1 + abs(gain)) * (1 + ts) * (abs(pole) * ts).exp()).upper()
    # `apart` is rounded
    wider = above(4.0 * float(scale) * (beyond + 1e-15)) if beyond or apart else 0.0
    found = []
    for each, distances in zip(late, ((0.0, apart), (-apart, 0.0)), strict=True):
        own = one.at(each)
        models = [own.model(lambda p, k, g, a: -p * (-p * a * ts).exp(), wider)]
        for since in distances:
            # the new value acts for the time `since` already; before it arrives there is only the old one
            models += [own.model(partial(form, since, ts), wider) for form in (_new_input, _old_input)]
        found.append(Arrivals(*models, may_end=bool(each.part.value.upper() > 1 - _MOST_BEYOND)))
    return tuple(found[: 2 if loaded else 1])


def _new_input(since: float, ts: arb, p: Jet, k: Jet, g: Jet | None, a: Jet) -> Jet:
    if since < 0.0:
        return k * 0
    return k - p * _held(g, k, p, Jet.constant(arb(since) * ts, len(p.slopes)))


def _old_input(since: float, ts: arb, p: Jet, k: Jet, g: Jet | None, a: Jet) -> Jet:
    if since < 0.0:
        return k - p * _held(g, k, p, a * ts)
    return -p * (-p * (arb(since) * ts)).exp() * _held(g, k, p, (a - arb(since)) * ts)
