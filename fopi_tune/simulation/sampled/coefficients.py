"""What the compiled simulation knows of controllers and modes:  Runtime, Hybrid -> rows of numbers, as in `layout`."""

from __future__ import annotations

import numpy as np

from fopi_tune.core.bode_form import Array
from fopi_tune.core.terms.feedforward import NOT_FED
from fopi_tune.digital.runtime import Runtime, init
from fopi_tune.simulation.sampled.layout import FED_STATIC, INTEGRATES, PROPORTIONAL, SECTIONS, Settings
from fopi_tune.simulation.scenario import Hybrid


def controller_coefficients(controller: Runtime, settings: Settings) -> Array:
    """A controller's coefficients in the order of `layout`; missing sections are 0 and stay 0."""
    end = SECTIONS + 3 * settings.sections
    low, high = controller.limits
    start = float(init(controller).output)
    last, used = end + 2 * settings.derivatives, controller.measurement_filter
    rows = np.zeros(last + 2 * (settings.filter_order > 0))
    rows[:INTEGRATES] = controller.direct, controller.tracking_gain, low, high, start
    rows[INTEGRATES:PROPORTIONAL] = controller.has_integrator, controller.most_change
    rows[PROPORTIONAL:FED_STATIC] = controller.proportional, controller.setpoint_weight
    if controller.derivative is not None:
        for place, row in enumerate((controller.derivative.gains, controller.derivative.shares)):
            rows[end + place : end + 2 * len(row) : 2] = row
    if used is not None:
        rows[last:] = used.share, used.damping or 0.0
    for place, row in enumerate((controller.poles, controller.weights, controller.residues)):
        rows[SECTIONS + place : SECTIONS + 3 * len(row) : 3] = row
    return rows


def mode_coefficients(hybrid: Hybrid | None, count: int) -> Array:
    """What a system says of its modes, in the order of `layout`, shape (count, 4)."""
    rows = np.tile([*NOT_FED, -np.inf, -np.inf], (count, 1))
    if hybrid is not None and hybrid.fed:
        rows[:, :2] = hybrid.fed
    if hybrid is not None and hybrid.hold_below:
        rows[:, 2] = [0.0 if np.isfinite(each) else each for each in hybrid.hold_below]
        rows[:, 3] = hybrid.hold_below
    return rows


def derivatives_of(controller: Runtime) -> int:
    """The number of the derivative's sections."""
    return 0 if controller.derivative is None else len(controller.derivative.gains)


def filter_order_of(controller: Runtime) -> int:
    """Of its measurement filter; 0 without one."""
    used = controller.measurement_filter
    return 0 if used is None else 1 if used.damping is None else 2
