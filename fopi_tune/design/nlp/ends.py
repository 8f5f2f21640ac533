"""The limits omega -> 0 and inf of a loop's responses, in closed form in the gains.

A plant is its leading term there, P -> p s^n, and so is the controller: kp as omega -> inf, ki s^-alpha as omega -> 0
unless ki is fixed at 0.  With l = kp p for n = 0, and l = 0 where P vanishes, and the dead time L,

    |S| = 1/d ,   |T| = |l|/d ,   |C S| = |kp|/d ,   d = |1 + l| ,                                                  (1)
    d = 1 - |l| (largest) or 1 + |l| (smallest)  where omega L turns without end,                                   (2)

and where |L| grows without end |S| -> 0, |T| -> 1 and |C S| -> 1/|P|, whatever the gains are.

Source: derived; `fopi_tune.core.peaks.limit_at` has the same limits as numbers.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from fopi_tune.core.loops import Plants
from fopi_tune.core.peaks import Response
from fopi_tune.design.constraints import Bound, Constraint, Scale
from fopi_tune.design.nlp.symbols import SymbolicLoop
from fopi_tune.design.probes import NO_ROOM
from fopi_tune.quantities.base import EvaluatedAt
from fopi_tune.quantities.responses import FrequencyFunction

#: |l| is rounded at 0 by this
_TINY = 1e-12
#: 1 - |l| below this is continued linearly: the solver may come by
_LEAST_DISTANCE = 1e-4
#: neper; a response that vanishes or grows without end
_ENDLESS = 50.0
#: parameters of a slot: p in the plant's own scale, weights of l and |l| in d, a constant value, weight of (1)
WIDTH = 5


@dataclass(frozen=True)
class End:
    """A plant's limit as a slot's parameters, and whether the gains matter."""

    gain: float = 0.0
    signed: float = 0.0
    absolute: float = 0.0
    constant: float = 0.0
    formula: float = 0.0

    @property
    def parameters(self) -> tuple[float, ...]:
        """In the order of a slot's parameters."""
        return self.gain, self.signed, self.absolute, self.constant, self.formula


def end_of(
    plants: Plants, row: int, scale: Scale, end: float, integral: bool, response: Response | None, largest: bool
) -> End:
    """The limit of one plant's response.

    Args:
        plants, row: the plant.
        scale: of the gains.
        end: omega, 0 or inf.
        integral: whether ki is anything but 0.
        response: which; None of a margin, which is read from |L|.
        largest: the limit superior, else the limit inferior.
    """
    which = -1 if end == 0.0 else 0
    numerator, denominator = plants.numerator[row], plants.denominator[row]
    if not numerator.any():
        return End(signed=1.0, formula=1.0)
    # from the end of a polynomial of lower degrees as omega -> 0, of higher ones as omega -> inf
    of_top, of_bottom = np.flatnonzero(numerator)[which], np.flatnonzero(denominator)[which]
    top, bottom = numerator[of_top], denominator[of_bottom]
    power = (len(numerator) - of_top) - (len(denominator) - of_bottom)
    # towards the end of the axis L grows, is constant or vanishes
    towards = power if end > 0.0 else -power
    grows = towards > 0 or (end == 0.0 and integral)
    if grows:
        inverse = math.log(abs(bottom / top)) if power == 0 else (-_ENDLESS if towards > 0 else _ENDLESS)
        constants = {
            Response.SENSITIVITY: -_ENDLESS,
            Response.COMPLEMENTARY_SENSITIVITY: 0.0,
            Response.CONTROL_SENSITIVITY: inverse,
        }
        return End(constant=constants.get(response or Response.LOOP_GAIN, _ENDLESS))
    gain = float(top / bottom) / scale.gain if power == 0 else 0.0
    turns = end > 0.0 and plants.dead_time_s[row] > 0.0
    if not turns:
        return End(gain, signed=1.0, formula=1.0)
    return End(gain, absolute=-1.0 if largest else 1.0, formula=1.0)


def asked_of(
    constraint: Constraint, plants: Plants, row: int, scale: Scale, end: float, integral: bool, kp: float
) -> End | None:
    """The limit of what a constraint is about; None where there is nothing to ask.

    That is where no gain changes that it is met; and of a margin where L does not tend to a number, or not to one that
    counts.

    Args:
        constraint: with this end among its own.
        plants, row: the plant.
        scale: of the gains.
        end: omega, 0 or inf.
        integral: whether ki is anything but 0.
        kp: at first.
    """
    quantity = constraint.quantity
    response = quantity.response if isinstance(quantity, FrequencyFunction) else None
    found = end_of(plants, row, scale, end, integral, response, constraint.bound is not Bound.LOWER)
    if response is None:
        is_number = found.formula > 0.0 and found.gain != 0.0
        counts = constraint.where is not EvaluatedAt.PHASE_CROSSOVERS or found.signed == 0.0 or kp * found.gain < 0.0
        return found if is_number and counts else None
    if found.formula == 0.0 and 0.0 <= constraint.slack(found.constant) < NO_ROOM:
        return None
    return found


def limit_loop(scale: Scale) -> Callable[[Any, Any, Any, Any], SymbolicLoop]:
    """(1) and (2) in symbols:  kp, parameters of an `End`, two floors -> what a slot's quantities are computed from.

    kp is in the plant's own scale.  ln|kp| is exact above the first floor, in the user's unit, ln|l| above the second.
    """
    kp, parameters = ca.SX.sym("kp"), ca.SX.sym("end", WIDTH)
    kp_floor, loop_floor = ca.SX.sym("kp_floor"), ca.SX.sym("loop_floor")
    gain, signed, absolute = parameters[0], parameters[1], parameters[2]
    loop = kp * gain
    distance = 1.0 + signed * loop + absolute * ca.sqrt(loop**2 + _TINY**2)
    beyond = math.log(_LEAST_DISTANCE) + (distance - _LEAST_DISTANCE) / _LEAST_DISTANCE
    near = ca.log(ca.fmax(distance, _LEAST_DISTANCE))
    turning = ca.if_else(distance > _LEAST_DISTANCE, near, beyond)
    outputs = [
        _log_size(loop, loop_floor),
        ca.if_else(absolute < 0.0, turning, _log_size(distance, _LEAST_DISTANCE)),
        _log_size(kp, kp_floor * scale.gain) - math.log(scale.gain),
    ]
    function = ca.Function("limit", [kp, parameters, kp_floor, loop_floor], outputs)

    def at(*inputs: Any) -> SymbolicLoop:
        log_gain, log_return_difference, log_controller = function(*inputs)
        nothing = ca.SX(0)
        return SymbolicLoop(
            log_gain=log_gain,
            phase_rad=nothing,
            phase_margin_rad=nothing,
            lag_to_minus_one_rad=nothing,
            phase_slope_rad=nothing,
            log_return_difference=log_return_difference,
            log_controller=log_controller,
            log_omega=nothing,
            omega_rad_s=nothing,
        )

    return at


def _log_size(value: Any, floor: Any) -> Any:
    """ln|value|, continued from `floor` on to a finite number at 0: a solver that comes by is not thrown off."""
    square, least = value**2, floor**2
    below = square / least - 1.0
    return 0.5 * ca.if_else(square > least, ca.log(ca.fmax(square, least)), ca.log(least) + below - 0.5 * below**2)
