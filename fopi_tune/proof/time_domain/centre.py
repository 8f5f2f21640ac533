"""The trajectory of a box's centre in ball arithmetic, sample by sample.

Rounding alone is propagated here, and the precision is higher than it grows, which the radii of the result show.  What
the solution in floating point leaves of the centre is too much for a limit that is met by parts of a million.
"""

from __future__ import annotations

import numpy as np
from flint import arb, ctx

from fopi_tune.core.bode_form import Array
from fopi_tune.proof.time_domain.bounded import Signals
from fopi_tune.proof.time_domain.case import TimeDomainCase
from fopi_tune.proof.time_domain.patterns import Pattern
from fopi_tune.proof.time_domain.plants.held import HeldPlants, Polynomial

#: bits; of the result, and of what a sample may cost
_BITS, _BITS_A_SAMPLE = 100, 1


def centre_signals(case: TimeDomainCase, plants: HeldPlants, pattern: Pattern, start: float) -> tuple[Signals, Signals]:
    """y and v of the plant with the centres of all coefficients under a pattern; y as a deviation, columns of length K.

    Args:
        case: the loop.
        plants: of the box.
        pattern: of the limited samples.
        start: the integrator's state at the first sample.
    """
    controller, count = case.controller, case.samples
    with ctx.workprec(_BITS + _BITS_A_SAMPLE * count):
        reference = [arb(value) - arb(plants.output) for value in case.run.signals.reference.tolist()]
        past, direct, gain = arb(float(plants.past.values[0])), arb(controller.direct), arb(controller.tracking_gain)
        poles, residues, weights = ([arb(x) for x in row] for row in _rows(case))
        states = [arb(start) if k == 0 and controller.has_integrator else arb(0) for k in range(len(poles))]
        share, limited = pattern.share.tolist(), pattern.limited.tolist()
        own = [(power, -value) for power, value in _terms(plants.denominator) if power]
        inputs = _terms(plants.control)
        added = _added(case, plants)
        y: list[arb] = []
        u: list[arb] = []
        v: list[arb] = []
        for k in range(count):
            value = added[k]
            for power, factor in own:
                if power <= k:
                    value = value + factor * y[k - power]
            for power, factor in inputs:
                if power <= k:
                    value = value + factor * u[k - power]
            y.append(value)
            error = reference[k] - value
            demanded = direct * error
            for state in states:
                demanded = demanded + state
            v.append(demanded)
            if share[k]:
                correction = arb(limited[k]) - arb(share[k]) * demanded
                u.append(demanded + correction - past)
                correction = gain * correction
                states = [
                    q * (x + w * correction) + r * error
                    for q, x, w, r in zip(poles, states, weights, residues, strict=True)
                ]
            else:
                u.append(demanded - past)
                states = [q * x + r * error for q, x, r in zip(poles, states, residues, strict=True)]
        return _signals(y), _signals(v)


def _rows(case: TimeDomainCase) -> tuple[tuple[float, ...], ...]:
    return case.controller.poles, case.controller.residues, case.controller.weights


def _terms(polynomial: Polynomial) -> list[tuple[int, arb]]:
    return sorted(polynomial.exact_centre().items())


def _added(case: TimeDomainCase, plants: HeldPlants) -> list[arb]:
    """The load's part of the right side, and the start's."""
    found = [arb(0)] * case.samples
    if plants.load is not None and case.load is not None:
        load = case.load.tolist()
        for power, factor in _terms(plants.load):
            for k in range(power, case.samples):
                if load[k - power]:
                    found[k] = found[k] + factor * load[k - power]
    found[0] = found[0] + plants.kick
    return found


def _signals(balls: list[arb]) -> Signals:
    values = np.array([float(ball.mid()) for ball in balls])
    error = max(float(abs(ball - arb(value)).upper()) for ball, value in zip(balls, values.tolist(), strict=True))
    return Signals(_column(values), np.array([error * (1.0 + 2.0**-40)]))


def _column(values: Array) -> Array:
    return values[:, None]
