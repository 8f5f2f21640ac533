"""Degenerate designs:  terms of the controller that vanish, gains at an end of their range, and what to say of them."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace

from fopi_tune.core.controller import DERIVATIVE_NAMES, MU_MAX, WEIGHT_NAME, FoPi, derivative_of
from fopi_tune.results.design import Design
from fopi_tune.results.equalities import in_percent
from fopi_tune.results.measured import measured_notes
from fopi_tune.results.status import Status
from fopi_tune.spec.default_objective import default_notes
from fopi_tune.spec.model import ControllerSpec, DesignSpec, GainRange

#: a term smaller than this part of the whole controller at the crossover is gone
_VANISHED = 1e-6
#: the proportional and the derivative one: where the best value is 0 the objective is flat, and the search ends at the
#: root of its tolerance
_VANISHED_PROPORTIONAL = 1e-4
#: a gain this close, relative to its range, to an end of the range has reached it
_AT_END = 1e-6
#: a steady-state error below this is none
_NO_ERROR = 1e-9


def without_vanished_terms(controller: ControllerSpec, gains: FoPi, crossover_rad_s: float | None) -> ControllerSpec:
    """The box of gains with a term that has vanished fixed at 0; itself where none has, or where it may not be 0.

    Args:
        controller: the box.
        gains: those found.
        crossover_rad_s: where the sizes of the terms are compared; None for 1 rad/s.  That of a derivative is its
            largest, of a PID kd/Tf.
    """
    omega = 1.0 if crossover_rad_s is None else crossover_rad_s
    proportional, integral = abs(gains.kp), abs(gains.ki) * omega**-gains.alpha
    derivative = derivative_of(gains).largest
    total = proportional + integral + derivative
    if not (math.isfinite(integral) and total > 0.0):
        return controller
    if integral <= _VANISHED * (total - integral) and not controller.ki.is_fixed and _holds_zero(controller.ki):
        # without its term the order has no meaning; 1 where the range allows it
        order = min(max(1.0, controller.alpha.min), controller.alpha.max)
        return replace(controller, ki=GainRange(0.0, 0.0), alpha=GainRange(order, order))
    for name, size in (("kp", proportional), ("kd", derivative)):
        gain = getattr(controller, name)
        if size <= _VANISHED_PROPORTIONAL * (total - size) and not gain.is_fixed and _holds_zero(gain):
            return replace(controller, **{name: GainRange(0.0, 0.0)})
    return controller


def _holds_zero(gain: GainRange) -> bool:
    return gain.min <= 0.0 <= gain.max


def design_notes(asked: DesignSpec, design: Design) -> tuple[str, ...]:
    """What a user should know of a solved design besides its table; empty for an ordinary one.

    Args:
        asked: the spec as written.
        design: solved for what it was completed to.
    """
    notes = [*default_notes(asked), *_noise(asked), *_beyond_sampling(asked), *_too_fast_to_sample(asked, design.gains)]
    notes += _measured(asked, design)
    if design.status is Status.SOLVED and design.gains is not None:
        notes += [*_vanished(asked, design.gains, design.steady_state_error), *_at_ends(asked.controller, design.gains)]
    return tuple(notes)


def _measured(asked: DesignSpec, design: Design) -> Iterator[str]:
    """What measured responses leave open."""
    if asked.is_measured and design.gains is not None:
        yield from measured_notes(asked, design.gains)


def _vanished(asked: DesignSpec, gains: FoPi, error: float | None) -> Iterator[str]:
    if gains.ki == 0.0 and not asked.controller.ki.is_fixed:
        if error is not None and error > _NO_ERROR:
            yield (
                f"no integral action: the steady-state error of a constant reference is up to {in_percent(error)}; "
                "for none, give ki a lower end (controller: ki: {min: ...}) or ask for "
                "sensitivity_db: {at_most: ...} at low frequencies (to_rad_s: ...)"
            )
        elif asked.controller.structure == "pid":
            yield "no integral action: the best gains have ki = 0"
        else:
            yield "no integral action: the best gains have ki = 0, so that alpha has no meaning"
    if gains.kp == 0.0 and not asked.controller.kp.is_fixed:
        yield "no proportional action: the best gains have kp = 0"
    if derivative_of(gains).kd == 0.0 and not asked.controller.kd.is_fixed:
        order = ", so that mu has no meaning" if asked.controller.has_derivative_order else ""
        yield f"no derivative action: the best gains have kd = 0{order}"


def _noise(asked: DesignSpec) -> Iterator[str]:
    """Of a derivative that costs nothing: no limit of |C S| up to high frequencies, and no end of kd away from 0."""
    kd = asked.controller.kd
    if kd.is_fixed or (math.isfinite(kd.min) and math.isfinite(kd.max)):
        return
    name = "control_sensitivity"
    limited = any(
        r.quantity == f"{name}_db" and math.isfinite(r.upper) and r.to_rad_s == math.inf for r in asked.requirements
    )
    if not limited and not (asked.objective is not None and asked.objective.quantity == f"{name}_peak_db"):
        yield (
            "nothing bounds what derivative action costs in noise: add control_sensitivity_db: {at_most: ...} or an "
            f"{'upper' if math.isinf(kd.max) else 'lower'} end of kd"
        )


def _beyond_sampling(asked: DesignSpec) -> Iterator[str]:
    """Of bands of which samples tell a part alone."""
    if asked.sampled_design is None:
        return
    nyquist = math.pi / asked.sampled_design.sample_time_s
    for place, each in enumerate(asked.requirements, 1):
        if math.isfinite(each.to_rad_s) and each.from_rad_s < nyquist < each.to_rad_s:
            yield (
                f"requirement {place}, {each.quantity}: its band reaches to {each.to_rad_s:g} rad/s, and the loop on "
                f"samples has a response up to Nyquist's frequency, {nyquist:.4g} rad/s: nothing is said of what lies "
                "above; sample faster for that"
            )


def _too_fast_to_sample(asked: DesignSpec, gains: FoPi | None) -> Iterator[str]:
    """Of filters of a continuous design that no controller on its samples has; a design on samples refuses them."""
    if asked.digital is None or asked.digital.designs_sampled:
        return
    controller, half = asked.controller, 0.5 * asked.digital.sample_time_s
    controller = controller if gains is None else controller.with_times_of(gains)
    filtered = controller.measurement_filter
    for name, time in (
        ("derivative_filter_time_constant_s", controller.derivative_filter_time_constant_s),
        ("measurement_filter.time_constant_s", 0.0 if filtered is None else filtered.time_constant_s),
    ):
        if 0.0 < time < half:
            yield (
                f"{name} = {time:g} s is below half the sample time, {half:g} s: these gains are for the continuous "
                "loop alone, as the discretizer refuses such a filter; write a longer time or sample faster"
            )


def _at_ends(controller: ControllerSpec, gains: FoPi) -> Iterator[str]:
    for name, side in controller.ranges.items():
        value = getattr(gains, name)
        is_idle = (
            (name == "alpha" and gains.ki == 0.0)
            or (name == "mu" and derivative_of(gains).kd == 0.0)
            or (name == WEIGHT_NAME and gains.kp == 0.0)
        )
        # the controller is proper up to mu = 1: there is no wider range
        if side.is_fixed or is_idle or (name == "mu" and value == side.max == MU_MAX):
            continue
        for word, end in (("lower", side.min), ("upper", side.max)):
            if value != 0.0 and math.isfinite(end) and abs(value - end) <= _AT_END * max(abs(end), abs(value)):
                yield f"{name} is at the {word} end of its range, {end:g}: a wider range may give a better design"
    times = controller.filter_times
    for name, (low, high) in ({} if times is None else times.ranges).items():
        if name == DERIVATIVE_NAMES[1] and derivative_of(gains).kd == 0.0:
            continue
        time = _time_of(gains, name)
        for word, end in (("lower", low), ("upper", high)):
            if time == end:
                yield f"{name} is at the {word} end of its range, {end:g} s: a wider range may give a better design"


def _time_of(gains: FoPi, name: str) -> float:
    """A filter's time, s, by its name in a spec."""
    if name == DERIVATIVE_NAMES[1]:
        return derivative_of(gains).filter_s
    return 0.0 if gains.measurement_filter is None else gains.measurement_filter.time_constant_s
