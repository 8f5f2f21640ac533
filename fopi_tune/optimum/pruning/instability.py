"""Instability of every controller of a box, with one plant behind more dead time.

The closed-loop poles on the right are counted for the controller at the centre of the box.  For the others:

by the axis           L is -1 nowhere on the imaginary axis for any controller, so that no pole crosses it;

by the crossovers     with b = 180 deg + arg L at the gain crossovers, Nyquist's criterion is

    Z = const - 2 sum +- floor(b/360 deg) ,      + where |L| falls below 1, - where it rises above it .            (1)

Crossovers of all controllers are in brackets of the frequency, and over box and bracket b is a continuous function, so
that any branch of it gives the change of (1) from the centre on.  Where a pole is on the axis itself, b is a multiple
of 360 deg, and the loop is unstable too.

The constant depends on the signs of the gains.  They are the same throughout a box without ki = 0, since the controller
has no zero where |L| > 1; and also in one with ki = 0 if kp and ki have the same sign, where C stays in a half-plane.

Source: (1) is that of `fopi_tune.core.stability`.
"""

from __future__ import annotations

from collections.abc import Sequence

from flint import arb

from fopi_tune.optimum.box_loop import BoxLoop, SampledBoxLoop
from fopi_tune.optimum.parametrization import ControllerBox
from fopi_tune.optimum.problem import Problem
from fopi_tune.optimum.pruning.crossings import GainCrossovers
from fopi_tune.optimum.pruning.loop_gain_bounds import LoopGainBounds
from fopi_tune.optimum.pruning.mean_value_forms import LoopBracket
from fopi_tune.optimum.samples.gains import BoxOnSamples
from fopi_tune.proof.balls.box import Interval
from fopi_tune.proof.balls.loop import BallLoop
from fopi_tune.proof.claims.poles import count_unstable_poles


def is_unstable(
    problem: Problem,
    controllers: ControllerBox,
    point: tuple[float, ...],
    brackets: Sequence[Interval],
    delay_s: arb,
) -> bool:
    """Whether a plant's loop is unstable for every controller.

    Args:
        problem: gives the plant.
        controllers: the box.
        point: the plant.
        brackets: of frequencies with all gain crossovers, rad/s; without any, the axis is looked at.
        delay_s: the additional dead time, s; not negative.
    """
    if brackets:
        return _by_crossovers(problem, controllers, point, brackets, delay_s)
    return _by_the_axis(problem, controllers, point, delay_s)


def _by_the_axis(problem: Problem, controllers: ControllerBox, point: tuple[float, ...], delay_s: arb) -> bool:
    """A pole can only cross the axis: near 0 the integral's term leads, near infinity the leading coefficients do."""
    plant = problem.plant(point)
    if controllers.mixes_integrals or plant.numerator[-1].value.contains(0) or plant.denominator[0].value.contains(0):
        return False
    bounds = LoopGainBounds.of(problem, controllers, point, whole=True)
    return bounds.is_never_minus_one(delay_s) and _poles_at_centre(problem, controllers, point, delay_s) > 0


def _poles_at_centre(problem: Problem, controllers: ControllerBox, point: tuple[float, ...], delay_s: arb) -> int:
    """Poles on the right; 0 where they are not known."""
    centre: BallLoop | None
    if isinstance(controllers, BoxOnSamples):
        centre = SampledBoxLoop.of(controllers, problem.unit_loop)
    else:
        centre = BoxLoop.of(controllers, problem.family, delay_s, problem.measurement_filter)
    return 0 if centre is None else count_unstable_poles(centre, point, 0.0) or 0


def _by_crossovers(
    problem: Problem,
    controllers: ControllerBox,
    point: tuple[float, ...],
    brackets: Sequence[Interval],
    delay_s: arb,
) -> bool:
    crossovers = GainCrossovers.of(problem, controllers, point, whole=True)
    if controllers.mixes_integrals and not crossovers.bounds.is_positive:
        return False
    fewer = 0
    for bracket in brackets:
        found = _fewer_poles(crossovers, bracket, delay_s)
        if found is None:
            return False
        fewer += found
    if not crossovers.are_in(brackets):
        return False
    return _poles_at_centre(problem, controllers, point, delay_s) - fewer > 0


def _fewer_poles(crossovers: GainCrossovers, bracket: Interval, delay_s: arb) -> int | None:
    """How many poles less than at the centre a controller has at most, due to the crossovers of a bracket.

    With every b in the same turn there are as many, however often |L| is 1 in the bracket.  Otherwise a single
    crossover is needed.  None where neither is known.
    """
    u = crossovers.problem.u_interval(bracket)
    at = LoopBracket.of(crossovers.problem, crossovers.controllers, crossovers.point, u)
    if at is None:
        return None
    b = at.lag(delay_s)
    low, own, high = (_whole_turns(angle) for angle in (b.lower, b.at_centre, b.upper))
    if low is None or own is None or high is None:
        return None
    if low == high:
        return 0
    falls = crossovers.bounds.is_decreasing(u)
    if not (falls or at.along.real > 0) or not crossovers.has_one_in(bracket):
        return None
    return 2 * (high - own) if falls else 2 * (own - low)


def _whole_turns(angle: arb) -> int | None:
    """floor(angle/360 deg); None where that is not known."""
    found = (angle / (2 * arb.pi())).floor().unique_fmpz()
    return None if found is None else int(found)
