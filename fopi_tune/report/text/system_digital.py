"""The digital controllers of a system as text."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from fopi_tune.core.text_tables.words import counted

if TYPE_CHECKING:
    from rich.text import Text

    from fopi_tune.core.switching_lines import Threshold
    from fopi_tune.results.system import DiscretizedSystem


def system_digital_text(result: DiscretizedSystem) -> Text:
    """Gains, switching, and the errors of both filters."""
    from fopi_tune.report.text.formatting import BAD, QUIET, TIE, Line, entry, gains_lines, to_text, with_unit, wrapped

    spec, controllers = result.spec, result.controllers
    lines: list[Line] = [
        *wrapped(f"{spec.name}, digital: made. Both controllers and how they take turns are C code."),
        ("", ""),
        *gains_lines(result.gains),
        ("", ""),
    ]
    raising, lowering = (mode.name for mode in spec.modes)
    unit, dwell = spec.measurement_unit, spec.min_dwell_samples
    lines += entry("sampled", f"every {with_unit(spec.sample_time_s, 's')}")
    where, turns = (lambda line: _line(line, unit)), spec.lines
    lines += entry("switching", f"{lowering} from {where(turns.up)} on, {raising} from {where(turns.down)} on")
    if turns.coast_above is not None and turns.coast_below is not None:
        rests = f"{raising} rests from {where(turns.coast_above)} on, {lowering} from {where(turns.coast_below)} on"
        lines += entry("coasting", rests)
    if dwell > 1:
        lines += entry("dwell", f"at least {counted(dwell, 'sample')}, {with_unit(dwell * spec.sample_time_s, 's')}")
    for mode in spec.modes:
        if (fed := mode.feedforward) is not None:
            told = f"of the {mode.name}: {fed.static_gain:g} r + {fed.rate_gain:g} dr/dt, before the limits"
            lines += entry("feed-forward", told)
    lines += entry("inactive", spec.inactive)
    for mode, controller in zip(spec.modes, controllers, strict=True):
        errors = [f"{100 * error:.3g}{TIE}% up to {with_unit(omega, 'rad/s')}" for omega, error in controller.errors]
        low = with_unit(controller.errors_from_rad_s, "rad/s")
        lines += entry(mode.name, f"largest relative error of its filter from {low}: {', '.join(errors)}")
        if controller.band_note:
            lines += entry("", f"NOTE: {controller.band_note}", BAD)
    for note in result.notes:
        lines += wrapped(f"{note}.", "yellow")
    lines += [("", ""), *wrapped("Nothing is proved here: `fopi prove` says whether the system settles.", QUIET)]
    return to_text(lines)


def _line(line: Threshold, unit: str) -> str:
    """An output on a line, in words."""
    from fopi_tune.report.text.formatting import TIE, with_unit

    def told(value: float) -> str:
        return with_unit(value, unit) if unit else f"{value:g}"

    if line.is_absolute:
        return told(line.value)
    sign = "-" if math.copysign(1.0, line.value) < 0.0 else "+"
    return f"the setpoint{TIE}{sign}{TIE}{told(abs(line.value))}"
