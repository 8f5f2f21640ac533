"""Plants of first order behind a zero-order hold.

    y' = -p y + k v:      D(x) = 1 - e^{-p Ts} x,      N(x) = x^{d+1} (W(1 - f) + e^{-p (1 - f) Ts} W(f) x)          (1)

with an input that is d + f samples late and W(t) = (k/p) (1 - e^{-p Ts t}), where the pole may be 0 in the form
k Ts t phi(p Ts t), phi(x) = (1 - e^{-x})/x.  phi and its derivatives are integrals of s^n e^{-xs} over [0, 1] up to the
sign, and so monotone: their values at the ends of a ball enclose them.

Source: Astrom and Wittenmark, Computer-Controlled Systems, 3rd ed., 1997, section 2.3.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np
from flint import arb

from fopi_tune.core.bode_form import Array
from fopi_tune.proof.time_domain.bounded import Delays, above
from fopi_tune.proof.time_domain.jets import Derivatives, Jet
from fopi_tune.proof.time_domain.models import Model, number_model
from fopi_tune.proof.time_domain.plants.held import Arrivals, HeldPlants, Polynomial, Start
from fopi_tune.proof.time_domain.plants.lateness import MOST_BEYOND, WHOLE, Lateness


def _phi(x: arb) -> Derivatives:
    """phi and its derivatives, each over a ball by its ends."""

    def ends(n: int) -> arb:
        low, high = ((-arb(end)).hypgeom_1f1(arb(n), arb(n + 1)) for end in (x.lower(), x.upper()))
        return low.union(high)

    return ends(1), -ends(2) / 2, ends(3) / 3


def _held(static_gain: Jet | None, gain: Jet, pole: Jet, time: Jet) -> Jet:
    """W of (1) after a time in s."""
    if static_gain is not None:
        return static_gain * (1 - (-(pole * time)).exp())
    return gain * time * (pole * time).through(_phi)


#: pole, gain, static gain (None where the pole may be 0) and the instant in a sample
Numbers = tuple[Jet, Jet, Jet | None, Jet]
Formula = Callable[[Jet, Jet, Jet | None, Jet], Jet]


@dataclass(frozen=True, eq=False)
class FirstOrder:
    """The numbers of plants of first order over a box and at its centre."""

    over: Numbers
    centre: Numbers
    radii: Array

    def at(self, late: Lateness) -> FirstOrder:
        """The same with the part of a sample by which an input is late."""
        return FirstOrder((*self.over[:3], late.part), (*self.centre[:3], late.centre), self.radii)

    def model(self, formula: Formula, wider: float = 0.0) -> Model:
        """A function of the numbers as a model."""
        return number_model(formula(*self.over), formula(*self.centre), self.radii, wider)


def first_order(
    one: FirstOrder, ts: arb, late: tuple[Lateness, Lateness], start: Start, inputs: tuple[float, bool]
) -> HeldPlants:
    """The plants of a box.

    Args:
        one: their numbers.
        ts: Ts.
        late: of control and load.
        start: at rest, or without input.
        inputs: computing delay in samples, and whether there is a load.
    """
    radii, (delay_samples, loaded) = one.radii, inputs
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
        past=start.past,
        output=start.output if start.rests else 0.0,
        kick=0.0 if start.rests else start.output,
        delay=(late[0].whole, late[1].whole),
        pole=one.model(lambda p, k, g, f: p),
        gain=one.model(lambda p, k, g, f: k),
        arrivals=_arrivals(one, ts, late, delay_samples, loaded) if between else (),
    )


def _arrivals(
    one: FirstOrder, ts: arb, late: tuple[Lateness, Lateness], delay_samples: float, loaded: bool
) -> tuple[Arrivals, ...]:
    """dy/dt at the instants of control and load; how far these are apart does not depend on the dead time."""
    apart = delay_samples - late[0].whole + late[1].whole
    apart = 0.0 if abs(apart) < WHOLE else apart
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
        found.append(Arrivals(*models, may_end=bool(each.part.value.upper() > 1 - MOST_BEYOND)))
    return tuple(found[: 2 if loaded else 1])


def _new_input(since: float, ts: arb, p: Jet, k: Jet, g: Jet | None, a: Jet) -> Jet:
    if since < 0.0:
        return k * 0
    return k - p * _held(g, k, p, Jet.constant(arb(since) * ts, len(p.slopes)))


def _old_input(since: float, ts: arb, p: Jet, k: Jet, g: Jet | None, a: Jet) -> Jet:
    if since < 0.0:
        return k - p * _held(g, k, p, a * ts)
    return -p * (-p * (arb(since) * ts)).exp() * _held(g, k, p, (a - arb(since)) * ts)
