"""Whether the switched car settles, with its limits and anti-windup:  proved or refuted, for every brake."""

from __future__ import annotations

import math
from dataclasses import replace

from fopi_tune.paper.published import BRAKE, THROTTLE
from fopi_tune.paper.table import Row, Verdict, verdict_of
from fopi_tune.paper.variants import system
from fopi_tune.pipeline.prove_system import prove_system, recheck_system
from fopi_tune.results.proved_system import ProvedSystem

#: km/h, s; where an orbit is shown
_SETPOINT, _TAU_S = 6.0, 3.1
#: km/h; what the car is driven at
_SETPOINTS = (2.0, 22.0)
_PRINTED = "taken to be obvious"


def settling() -> tuple[Row, ...]:
    """The claim with a memory that is held, and with one that is reset."""
    return (_held(), _reset())


def _proved(inactive: str, setpoints: tuple[float, float] | None) -> ProvedSystem:
    car = replace(system("car_held"), inactive=inactive)
    gains = dict(zip((mode.name for mode in car.modes), (THROTTLE.gains, BRAKE.gains), strict=True))
    return prove_system(car, gains, setpoints=setpoints)


def _is_sound(found: ProvedSystem) -> bool:
    return recheck_system(found.certificate_document())[1].accepted


def _upwards(bound: float) -> float:
    """A bound with three decimals, not below it."""
    return math.ceil(1e3 * bound) / 1e3


def _held() -> Row:
    found = _proved("held", None)
    cycles = found.certificate.cycles
    places = [(each.setpoint, each.plants[1]["time_constant_s"]) for each in cycles]
    orbit = cycles[places.index((_SETPOINT, _TAU_S))] if (_SETPOINT, _TAU_S) in places else None
    shown = orbit is not None and orbit.attracts and _is_sound(found)
    where = f"r = {_SETPOINT:g} km/h, tau = {_TAU_S:g} s"
    return Row(
        "The car settles on its setpoint while the controllers take turns (x+ = x, memories held)",
        _PRINTED,
        f"at {where} it ends in a periodic orbit of {len(orbit.modes)} samples, from {orbit.lowest:+.2f} to "
        f"{orbit.highest:+.2f} km/h around the setpoint"
        if orbit is not None and shown
        else f"no orbit was shown at {where}",
        Verdict.DOES_NOT_HOLD if shown else Verdict.NOT_PRINTED,
        f"The orbit and that it attracts are proved in balls, with eps = 0.5 km/h and the limits 0 to 1 and -1 to 0; "
        f"about {len(cycles)} such places were found.",
    )


def _reset() -> Row:
    found = _proved("reset", _SETPOINTS)
    proof = found.certificate.settling
    settles = found.status.value == "settles" and _is_sound(found)
    low, high = _SETPOINTS
    return Row(
        "The car settles on its setpoint while the controllers take turns (memories reset)",
        _PRINTED,
        f"for every r from {low:g} to {high:g} km/h and every brake, also one that varies: at most two more switches, "
        f"and then at most {_upwards(proof.undershoot):.3f} km/h below the setpoint"
        if proof is not None and settles
        else "not shown",
        verdict_of(settles, on_condition=True),
        "Proved in balls, with eps = 0.5 km/h and the limits 0 to 1 and -1 to 0, from every state with the throttle "
        "active; a reset is not printed.",
    )
